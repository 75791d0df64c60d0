//! Gaussian mixtures in files, as priors on the pose.

use std::path::Path;

use vitruvian_reference::fitting::prior::GaussianMixture;
use vitruvian_runtime::file::npz::Npz;

use super::refuse;
use crate::failure::Result;

/// Reads a mixture: means \[K,D\], covariances \[K,D,D\] (or covars), weights \[K\].
pub fn read(path: &Path) -> Result<GaussianMixture> {
    let mut npz = Npz::open(path)?;
    let means = npz.shaped::<f64>("means", &[None, None])?;
    let (k, d) = (means.shape[0], means.shape[1]);
    let name = if npz.contains("covariances") { "covariances" } else { "covars" };
    let covariances = npz.shaped::<f64>(name, &[Some(k), Some(d), Some(d)])?;
    let weights = npz.shaped::<f64>("weights", &[Some(k)])?;
    let rows =
        |values: &[f64], width: usize| values.chunks_exact(width.max(1)).map(<[f64]>::to_vec).collect();
    let covariances: Vec<Vec<f64>> = rows(&covariances.values, d * d);
    GaussianMixture::new(rows(&means.values, d), &covariances, &weights.values)
        .map_err(|fault| refuse(path, fault.to_string()))
}

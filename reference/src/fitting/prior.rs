//! What a fit knows before it sees the joints: limbs bend one way, bodies are near the mean, poses are near others.
//!
//! | prior | residuals | source |
//! |---|---|---|
//! | [bend](bend_residual) | λ_θ · 0.317 α · exp(−φ) for each elbow and knee | eq. 2.5 |
//! | shape | λ_β · β | eq. 2.6 (erratum E1) |
//! | weak pose | λ_θ · 0.01 · θ | – |
//! | [mixture](GaussianMixture) | λ_θ · (residual_k, √(−ln w_k)) | Bogo et al. 2016 |
//!
//! # References
//! Li 2021, eq. 2.1, 2.5, 2.6; Bogo, Kanazawa, Lassner, Gehler, Romero, Black 2016, "Keep it SMPL".

use crate::linalg::cholesky::Cholesky;
use crate::linalg::dense::Dense;

/// The residual of one limb that bends by φ radians beyond rest, and its derivative by φ.
///
/// factor · exp(−φ): near zero for natural bends, growing without bound as the limb is bent backwards. φ is the flexion of a
/// [hinge](crate::body::Hinge); with SMPL's rest pose φ = −θ₅₅, θ₅₈, θ₁₂, θ₁₅ for left elbow, right elbow, left knee, right
/// knee.
///
/// # Conventions
/// The thesis prints exp(θ_i) for all four, which would punish natural bends of three of them; α and λ both multiply, and
/// whether the term is squared is not said. The signs, the factor 0.317 and the square are SMPLify's (erratum E4).
///
/// ```
/// use vitruvian_reference::fitting::prior::bend_residual;
/// // Four straight limbs at λ = 4.78 cost 918.405 in SMPLify's last stage.
/// let (r, _) = bend_residual(0.0, 4.78 * 3.17);
/// assert!((4.0 * r * r - 918.405).abs() < 1e-3);
/// ```
pub fn bend_residual(flexion_rad: f64, factor: f64) -> (f64, f64) {
    let r = factor * (-flexion_rad).exp();
    (r, -r)
}

/// A mixture of Gaussians over the body pose (θ without its root), as least squares by its nearest component.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianMixture {
    means: Vec<Vec<f64>>,
    /// L_k with L_k L_kᵀ = Σ_k⁻¹, row-major n×n, lower triangular.
    precision_roots: Vec<Dense>,
    /// −ln of the effective weights, ≥ 0.
    penalties: Vec<f64>,
}

/// Why a mixture cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MixtureFault {
    /// Means, covariances and weights differ in number or size, or there are none.
    Sizes,
    /// A number is not finite or a weight not positive.
    Numbers,
    /// This component's covariance is not positive definite.
    Covariance(usize),
}

impl std::fmt::Display for MixtureFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            MixtureFault::Sizes => {
                write!(f, "means [K,n], covariances [K,n,n] and weights [K] do not fit each other")
            }
            MixtureFault::Numbers => write!(f, "a number is not finite or a weight is not positive"),
            MixtureFault::Covariance(k) => {
                write!(f, "the covariance of component {k} is not positive definite")
            }
        }
    }
}

impl std::error::Error for MixtureFault {}

impl GaussianMixture {
    /// The mixture Σ_k π_k N(μ_k, Σ_k), from K means of n numbers, K covariances (n×n, row-major) and K weights.
    ///
    /// # Errors
    /// If sizes do not fit, numbers are not finite, or a covariance is not positive definite.
    pub fn new(
        means: Vec<Vec<f64>>,
        covariances: &[Vec<f64>],
        weights: &[f64],
    ) -> Result<GaussianMixture, MixtureFault> {
        let components = means.len();
        let n = means.first().map_or(0, Vec::len);
        let sizes_fit = n > 0
            && covariances.len() == components
            && weights.len() == components
            && means.iter().all(|m| m.len() == n)
            && covariances.iter().all(|c| c.len() == n * n);
        if !sizes_fit {
            return Err(MixtureFault::Sizes);
        }
        let mut numbers = means.iter().chain(covariances).flatten().chain(weights);
        if !numbers.all(|x| x.is_finite()) || weights.iter().any(|&w| w <= 0.0) {
            return Err(MixtureFault::Numbers);
        }
        let mut precision_roots = Vec::with_capacity(components);
        let mut half_log_determinants = Vec::with_capacity(components);
        for (k, covariance) in covariances.iter().enumerate() {
            let covariance = Dense::new(n, n, covariance.clone());
            let factor = Cholesky::factor(&covariance).ok_or(MixtureFault::Covariance(k))?;
            let columns: Vec<Vec<f64>> = (0..n)
                .map(|c| {
                    let mut unit = vec![0.0; n];
                    unit[c] = 1.0;
                    factor.solve(&unit)
                })
                .collect();
            let mut precision = Dense::zeros(n, n);
            for i in 0..n {
                for j in 0..n {
                    precision[(i, j)] = 0.5 * (columns[j][i] + columns[i][j]);
                }
            }
            let root = Cholesky::factor(&precision).ok_or(MixtureFault::Covariance(k))?;
            let root = root.lower();
            // ln √det Σ = −ln det L.
            half_log_determinants.push(-(0..n).map(|i| root[(i, i)].ln()).sum::<f64>());
            precision_roots.push(root.clone());
        }
        let least = half_log_determinants.iter().copied().fold(f64::INFINITY, f64::min);
        let total: f64 = weights.iter().sum();
        let normaliser = 0.5 * n as f64 * std::f64::consts::TAU.ln();
        let penalties = weights
            .iter()
            .zip(&half_log_determinants)
            .map(|(w, half_log)| (-(w / total).ln() + normaliser + (half_log - least)).max(0.0))
            .collect();
        Ok(GaussianMixture { means, precision_roots, penalties })
    }

    /// n, the length of a pose without its root.
    pub fn dimension(&self) -> usize {
        self.means[0].len()
    }

    /// The component nearest to `x`: the k of least ‖residual_k‖² − ln w_k.
    ///
    /// # Panics
    /// If `x` does not have n numbers.
    pub fn nearest(&self, x: &[f64]) -> usize {
        let cost = |k: usize| self.whitened(k, x).iter().map(|r| r * r).sum::<f64>() + self.penalties[k];
        (0..self.means.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).expect("a component")
    }

    /// The n + 1 residuals at `x`: (√½ (x − μ_k)ᵀ L_k, √(−ln w_k)) of the nearest component k.
    ///
    /// L_k is the Cholesky factor of Σ_k⁻¹; w_k = π_k/((2π)^{n/2} · √det Σ_k / min_j √det Σ_j). The last has no
    /// derivative; it makes the energy that of −ln of the component.
    ///
    /// # Panics
    /// If `x` does not have n numbers.
    pub fn residuals(&self, x: &[f64]) -> Vec<f64> {
        let k = self.nearest(x);
        let mut r = self.whitened(k, x);
        r.push(self.penalties[k].sqrt());
        r
    }

    /// The derivative of [`GaussianMixture::residuals`] by x while the nearest component stays: √½ L_kᵀ over a row of
    /// zeros, (n + 1)×n.
    ///
    /// # Panics
    /// If `x` does not have n numbers.
    pub fn derivative(&self, x: &[f64]) -> Dense {
        let (n, root) = (self.dimension(), &self.precision_roots[self.nearest(x)]);
        let mut derivative = Dense::zeros(n + 1, n);
        for c in 0..n {
            for i in c..n {
                derivative[(c, i)] = root[(i, c)] * std::f64::consts::FRAC_1_SQRT_2;
            }
        }
        derivative
    }

    fn whitened(&self, k: usize, x: &[f64]) -> Vec<f64> {
        let n = self.dimension();
        assert!(x.len() == n, "GaussianMixture: x has {} numbers, the means {n}", x.len());
        let d: Vec<f64> = x.iter().zip(&self.means[k]).map(|(x, m)| x - m).collect();
        let mut r = self.precision_roots[k].apply_transposed(&d);
        r.iter_mut().for_each(|r| *r *= std::f64::consts::FRAC_1_SQRT_2);
        r
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    fn mixture() -> GaussianMixture {
        let means = vec![vec![0.0, 0.0], vec![3.0, -1.0]];
        let covariances = [vec![1.0, 0.3, 0.3, 0.5], vec![0.2, 0.0, 0.0, 0.4]];
        GaussianMixture::new(means, &covariances, &[0.75, 0.25]).expect("a mixture")
    }

    #[test]
    fn bend_energy_golden() {
        // Four limbs at rest, computed by an independent script.
        let golden = [
            (404.0, 6_560_565.05),
            (91.0, 332_859.76),
            (58.0, 135_218.0),
            (57.4, 132_434.86),
            (47.4, 90_309.87),
        ];
        for (weight, energy) in golden {
            let (r, _) = bend_residual(0.0, 3.17 * weight);
            assert!((4.0 * r * r - energy).abs() < 6e-3, "λ = {weight}: {}", 4.0 * r * r);
        }
    }

    #[test]
    fn natural_bends_are_free_and_backward_ones_are_not() {
        let (at, slope) = bend_residual(0.3, 2.0);
        assert!(
            (slope - (bend_residual(0.3 + 1e-6, 2.0).0 - bend_residual(0.3 - 1e-6, 2.0).0) / 2e-6).abs()
                < 1e-9
        );
        assert!(bend_residual(PI / 2.0, 2.0).0 < 0.5 * at && bend_residual(-1.0, 2.0).0 > 2.0 * at);
    }

    #[test]
    fn energy_is_half_the_mahalanobis_distance_plus_the_penalty() {
        let mixture = mixture();
        let x = [0.4, -0.6];
        // Σ₀⁻¹ = [0.5, −0.3; −0.3, 1]/0.41.
        let mahalanobis = (0.5 * 0.16 + 2.0 * 0.3 * 0.24 + 0.36) / 0.41;
        let smallest = 0.08f64.sqrt();
        let penalty = -(0.75 / (TAU * (0.41f64.sqrt() / smallest))).ln();
        let energy: f64 = mixture.residuals(&x).iter().map(|r| r * r).sum();
        assert!((energy - 0.5 * mahalanobis - penalty).abs() < 1e-12, "{energy}");
        assert_eq!((mixture.nearest(&x), mixture.nearest(&[2.8, -1.2])), (0, 1));
    }

    #[test]
    fn mixture_derivative_is_its_central_difference() {
        let mixture = mixture();
        for x in [[0.4, -0.6], [2.5, -0.7]] {
            let derivative = mixture.derivative(&x);
            for j in 0..2 {
                let moved = |h: f64| {
                    let mut x = x;
                    x[j] += h;
                    mixture.residuals(&x)
                };
                for (i, (above, below)) in moved(1e-5).iter().zip(moved(-1e-5)).enumerate() {
                    assert!((derivative[(i, j)] - (above - below) / 2e-5).abs() < 1e-9, "{x:?} {i} {j}");
                }
            }
        }
    }

    #[test]
    fn faults_are_named() {
        let new = |covariance: Vec<f64>, weight: f64| {
            GaussianMixture::new(vec![vec![0.0, 0.0]], &[covariance], &[weight]).expect_err("a fault")
        };
        assert_eq!(new(vec![1.0, 2.0, 2.0, 1.0], 1.0), MixtureFault::Covariance(0));
        assert_eq!(new(vec![1.0; 3], 1.0), MixtureFault::Sizes);
        assert_eq!(new(vec![1.0, 0.0, 0.0, 1.0], f64::NAN), MixtureFault::Numbers);
        assert!(new(vec![1.0, 2.0, 2.0, 1.0], 1.0).to_string().contains("component 0"));
    }
}

//! The body model that a command works with: a file in SMPL's arrays, or the built-in mannequin.

use std::path::Path;

use vitruvian_reference::body::{BodyModel, mannequin};
use vitruvian_runtime::file::npz::Npz;

use crate::failure::Result;

/// Reads `path`, or makes the mannequin where none is given.
pub fn load(path: Option<&Path>) -> Result<BodyModel> {
    let Some(path) = path else { return Ok(mannequin()) };
    let mut npz = Npz::open(path)?;
    let v = npz.shaped::<f64>("v_template", &[None, Some(3)])?;
    let count = v.shape[0];
    let rows = |values: &[f64]| values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect::<Vec<_>>();
    let faces = npz.shaped::<f64>("f", &[None, Some(3)])?;
    let parents = npz.array::<f64>("kintree_table")?;
    let joints = parents.shape[1];
    Ok(BodyModel {
        v_template: rows(&v.values),
        faces: rows(&faces.values).iter().map(|f| f.map(|i| i as u32)).collect(),
        shapedirs: npz.shaped::<f64>("shapedirs", &[Some(count), Some(3), None])?.values,
        posedirs: npz.shaped::<f64>("posedirs", &[Some(count), Some(3), None])?.values,
        j_regressor: npz.shaped::<f64>("J_regressor", &[Some(joints), Some(count)])?.values,
        lbs_weights: npz.shaped::<f64>("weights", &[Some(count), Some(joints)])?.values,
        parents: parents.values[..joints].iter().map(|&p| (p >= 0.0 && p < joints as f64).then_some(p as usize)).collect(),
    })
}

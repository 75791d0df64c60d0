//! The body model that a command works with: a file in SMPL's arrays, or the built-in mannequin.

use std::path::Path;

use vitruvian_reference::body::{BodyModel, mannequin};
use vitruvian_runtime::file::body;

use crate::failure::Result;

/// Reads and checks `path`, or makes the mannequin where none is given.
pub fn load(path: Option<&Path>) -> Result<BodyModel> {
    let Some(path) = path else { return Ok(mannequin()) };
    let arrays = body::read(path)?;
    Ok(BodyModel {
        v_template: arrays.v_template,
        faces: arrays.faces,
        shapedirs: arrays.shapedirs,
        posedirs: arrays.posedirs,
        j_regressor: arrays.j_regressor,
        lbs_weights: arrays.lbs_weights,
        parents: arrays.parents,
    })
}

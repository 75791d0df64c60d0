//! The body model that a command works with: a file in SMPL's arrays, or the built-in mannequin.

use std::path::Path;

use vitruvian_conformance::convert;
use vitruvian_reference::body::{BodyModel, mannequin};
use vitruvian_runtime::file::body::{self, BodyArrays};

use crate::failure::{Failure, Result};

/// The arrays of the body at `path`, or of the mannequin, for the runtime.
pub fn load_arrays(path: Option<&Path>) -> Result<BodyArrays> {
    let Some(path) = path else { return Ok(convert::body_to_runtime(&mannequin())) };
    Ok(body::read(path)?)
}

/// Reads and checks `path`, or makes the mannequin where none is given.
pub fn load(path: Option<&Path>) -> Result<BodyModel> {
    let Some(path) = path else { return Ok(mannequin()) };
    Ok(convert::body_to_reference(body::read(path)?))
}

/// Like [`load`], for commands that invent poses, which are those of SMPL's 24 joints.
pub fn load_to_pose(path: Option<&Path>) -> Result<BodyModel> {
    let body = load(path)?;
    if body.joint_count() == 24 {
        return Ok(body);
    }
    Err(Failure::Usage(format!(
        "{}: has {} joints; poses are drawn for SMPL's 24: give a 24-joint body",
        path.unwrap_or(Path::new("the mannequin")).display(),
        body.joint_count()
    )))
}

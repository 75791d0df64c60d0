//! Writing a capture: what `synthesize` puts on disk.

use std::fs;
use std::path::Path;

use super::{View, cameras_json, picture};
use crate::error::{Error, Result};
use crate::file::npy::Values;
use crate::file::npz::{self, Named};
use crate::file::{atomic, keypoints, obj};
use crate::mesh::Mesh;

/// The parameters that the pictured body was made with.
#[derive(Clone, Copy, Debug)]
pub struct BodyTruth<'a> {
    /// 3J axis-angle components in radians.
    pub poses: &'a [f64],
    /// The shape's B betas.
    pub betas: &'a [f64],
    /// Metres.
    pub trans: [f64; 3],
    /// J world positions in metres.
    pub joints: &'a [[f64; 3]],
}

/// Writes a capture into the folder `path`, which is made if needed.
///
/// Each file appears whole or not at all, and `cameras.json` last: a folder that has it has the rest.
/// Views are written as they are; [`super::Capture::read`] brings them back, undistorted if their camera distorts.
///
/// # Errors
/// A camera fails [`super::Camera::check`], a picture or mask has not its camera's size, or a file cannot be written.
pub fn write(path: &Path, views: &[View], mesh: Option<&Mesh>, body: Option<BodyTruth<'_>>) -> Result<()> {
    for folder in ["images", "masks", "keypoints"] {
        let folder = path.join(folder);
        fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
    }
    for view in views {
        let camera = &view.camera;
        let fail = |message: String| Error::camera(path, &camera.name, message);
        camera.check().map_err(fail)?;
        let expected = (camera.width, camera.height);
        let sizes = [view.image.as_ref().map(|i| i.dimensions()), view.mask.as_ref().map(|m| m.dimensions())];
        if let Some(found) = sizes.into_iter().flatten().find(|&size| size != expected) {
            return Err(fail(format!(
                "a picture of {found:?} pixels was given for a camera of {expected:?}"
            )));
        }
        let name =
            |folder: &str, extension: &str| path.join(folder).join(format!("{}.{extension}", camera.name));
        if let Some(image) = &view.image {
            picture::write_rgb(&name("images", "png"), image)?;
        }
        if let Some(mask) = &view.mask {
            picture::write_gray(&name("masks", "png"), mask)?;
        }
        if let Some(points) = &view.keypoints {
            keypoints::write(&name("keypoints", "json"), points)?;
        }
    }
    if let Some(mesh) = mesh {
        obj::write(&path.join("mesh.obj"), mesh)?;
    }
    if let Some(body) = body {
        npz::write(
            &path.join("body.npz"),
            &[
                Named { name: "poses", shape: &[body.poses.len()], values: Values::F64(body.poses) },
                Named { name: "betas", shape: &[body.betas.len()], values: Values::F64(body.betas) },
                Named { name: "trans", shape: &[3], values: Values::F64(&body.trans) },
                Named {
                    name: "joints",
                    shape: &[body.joints.len(), 3],
                    values: Values::F64(body.joints.as_flattened()),
                },
            ],
        )?;
    }
    let cameras: Vec<_> = views.iter().map(|v| v.camera.clone()).collect();
    atomic::write(&path.join("cameras.json"), cameras_json::to_text(&cameras).as_bytes())
}

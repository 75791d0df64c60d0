//! The views that a result has a body for, and where their cameras stand.

use std::path::Path;

use vitruvian_reference::linalg::vector::distance;
use vitruvian_runtime::capture::{self, Camera, Extrinsics};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npz::Npz;

use crate::failure::Result;

/// Cameras that differ by no more than rounding are the same: metres, and parts of a rotation matrix.
const SAME: f64 = 1e-6;

/// The views that a result has a body for.
pub struct Views {
    /// Their names, as the result has them.
    pub names: Vec<String>,
    /// The capture's cameras of these names.
    pub cameras: Vec<Extrinsics>,
    /// Those that a fit found; a regression is in their axes already.
    pub found: Option<Vec<Extrinsics>>,
}

impl Views {
    /// What a result's parameters say of its views; `None` for a body that is to be compared in the world.
    pub fn read(parameters: &Path, capture: &Path, per_view: bool) -> Result<Option<Views>> {
        let is_npz =
            parameters.is_file() && parameters.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        let mut npz = if is_npz { Some(Npz::open(parameters)?) } else { None };
        let (names, found) = match &mut npz {
            Some(npz) if npz.contains("names") => (npz.texts("names")?, None),
            Some(npz) if per_view || npz.contains("camera_names") => {
                let (names, cameras) = found(npz)?;
                (names, Some(cameras))
            }
            _ if per_view => {
                let message = "is not there; --per-view needs the cameras in it".to_owned();
                return Err(Error::file(parameters, message).into());
            }
            _ => return Ok(None),
        };
        let all = capture::read_cameras(capture)?;
        if !per_view && let Some(found) = &found {
            warn_of_another_world(&names, found, &all, parameters);
            return Ok(None);
        }
        let camera = |name: &String| camera_of(&all, name, capture, parameters);
        let cameras = names.iter().map(camera).collect::<Result<_>>()?;
        Ok(Some(Views { names, cameras, found }))
    }
}

/// The cameras of a fit: R, t and camera_names.
fn found(npz: &mut Npz) -> Result<(Vec<String>, Vec<Extrinsics>)> {
    let rotations = npz.shaped::<f64>("R", &[None, Some(3), Some(3)])?;
    let n = rotations.shape[0];
    let translations = npz.shaped::<f64>("t", &[Some(n), Some(3)])?;
    let names = npz.texts("camera_names")?;
    let is_finite = rotations.values.iter().chain(&translations.values).all(|x| x.is_finite());
    if names.len() != n || !is_finite {
        let message = format!(
            "arrays \"R\", \"t\" and \"camera_names\" hold {n} cameras and {} names; expected as many of both, and finite \
             numbers",
            names.len()
        );
        return Err(Error::file(npz.path(), message).into());
    }
    let rows = |values: &[f64]| values.chunks_exact(3).map(|r| [r[0], r[1], r[2]]).collect::<Vec<_>>();
    let turns = rows(&rotations.values);
    let places = turns.chunks_exact(3).zip(rows(&translations.values));
    Ok((names, places.map(|(r, t)| Extrinsics { r: [r[0], r[1], r[2]], t }).collect()))
}

/// Says that only alignment makes two worlds comparable, if a fit has found cameras elsewhere than where they stand.
fn warn_of_another_world(names: &[String], found: &[Extrinsics], all: &[Camera], parameters: &Path) {
    let is_same = |(name, found): (&String, &Extrinsics)| {
        let camera = all.iter().find(|camera| camera.name == *name).and_then(|camera| camera.extrinsics);
        camera.is_none_or(|camera| {
            let rows = camera.r.iter().zip(&found.r);
            rows.chain([(&camera.t, &found.t)]).all(|(&a, &b)| distance(a, b) < SAME)
        })
    };
    if !names.iter().zip(found).all(is_same) {
        eprintln!(
            "warning: {}: its cameras are not the capture's, so that it has a world of its own: only what is aligned can be \
             compared there; --per-view compares in each camera's axes",
            parameters.display()
        );
    }
}

/// Where the camera of an image's name stands; the name may have a folder and an extension.
fn camera_of(cameras: &[Camera], name: &str, capture: &Path, parameters: &Path) -> Result<Extrinsics> {
    let stem = Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let camera = cameras
        .iter()
        .find(|camera| camera.name == name)
        .or_else(|| cameras.iter().find(|camera| Some(&camera.name) == stem.as_ref()));
    let Some(camera) = camera else {
        let known: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
        let message =
            format!("is of the image {name}, but {} has the cameras {}", capture.display(), known.join(", "));
        return Err(Error::file(parameters, message).into());
    };
    camera.extrinsics.ok_or_else(|| {
        let message = "has no R and t, so that the truth cannot be seen from it".to_owned();
        Error::camera(capture, name, message).into()
    })
}

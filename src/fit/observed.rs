//! A capture as the fit sees it.

use std::path::{Path, PathBuf};

use vitruvian_conformance::convert;
use vitruvian_reference::fitting::{Extrinsics, Keypoint, KeypointSet, Observation, View};
use vitruvian_reference::silhouette::Mask;
use vitruvian_runtime::capture::{Capture, Need, Needs};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::keypoints::JointSet;

use super::refuse;
use super::settings::{Cameras, Method, Settings};
use crate::failure::{Failure, Result};

/// A capture, and what is known of it before the fit.
pub struct Observed {
    /// The capture's folder.
    pub path: PathBuf,
    /// Pictures, masks and keypoints as they were read; for `smplify` of the first view alone.
    pub capture: Capture,
    /// The same for the reference.
    pub observation: Observation,
    /// A mask for every view that has one.
    pub masks: Vec<Option<Mask>>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Observed {
    /// Reads and checks the capture in the folder `path`.
    pub fn read(path: &Path, settings: &Settings) -> Result<Observed> {
        let silhouette = settings.method == Method::Silhouette;
        let masks = if silhouette { Need::Required } else { Need::Optional };
        let images = if settings.needs_images() { Need::Required } else { Need::Optional };
        let needs = Needs { images, masks, keypoints: Need::Optional };
        let mut capture = Capture::read(path, needs)?;
        if settings.method == Method::Smplify {
            capture.views.truncate(1);
        }
        let keypoint_set = one_set(path, &capture)?;
        // This method does not look where the cameras stand.
        let cameras =
            if settings.method == Method::MvSmplify { Some(Cameras::Unknown) } else { settings.cameras };
        let extrinsics = extrinsics(path, &capture, cameras)?;
        let mut warnings = Vec::new();
        let views = capture.views.iter().map(|view| {
            let name = &view.camera.name;
            let mut camera = view.camera.clone();
            if camera.k[0][1].abs() < LEAST_SKEW_PX {
                camera.k[0][1] = 0.0;
            }
            if extrinsics == Extrinsics::Unknown {
                camera.extrinsics = Some(NOWHERE);
            }
            let camera = convert::camera_to_reference(&camera).ok_or_else(|| {
                let message = format!(
                    "has skewed pixels (K[0][1] = {}), which the fit does not describe: undistort the pictures to K[0][1] = 0",
                    view.camera.k[0][1]
                );
                Failure::from(Error::camera(path, name, message))
            })?;
            let keypoints = match &view.keypoints {
                Some(found) => found.points.iter().map(|&[u, v, c]| keypoint(u, v, c)).collect(),
                None => {
                    warnings.push(format!(
                        "{}: camera \"{name}\": has no keypoints (keypoints/{name}.json): its joints are not used",
                        path.display()
                    ));
                    vec![Keypoint { pixel_px: [0.0; 2], confidence: 0.0 }; keypoint_set.count()]
                }
            };
            Ok(View { camera, keypoints })
        });
        let views = views.collect::<Result<Vec<View>>>()?;
        let masks = capture.views.iter().map(|view| view.mask.as_ref().map(mask)).collect();
        let observation = Observation { views, keypoint_set, extrinsics };
        Ok(Observed { path: path.to_owned(), capture, observation, masks, warnings })
    }

    /// The name of view `index`.
    pub fn name(&self, index: usize) -> &str {
        &self.capture.views[index].camera.name
    }
}

/// Less skew than this moves no pixel by a hundredth: a calibration's rounding.
const LEAST_SKEW_PX: f64 = 0.01;

/// Stands in for the extrinsics of a camera that has none, or whose own are not to be used.
const NOWHERE: vitruvian_runtime::capture::Extrinsics = vitruvian_runtime::capture::Extrinsics {
    r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    t: [0.0; 3],
};

/// A keypoint; where the confidence is zero the pixel means nothing and may be anything.
fn keypoint(u: f64, v: f64, confidence: f64) -> Keypoint {
    let pixel_px = if confidence == 0.0 { [0.0; 2] } else { [u, v] };
    Keypoint { pixel_px, confidence }
}

fn mask(picture: &image::GrayImage) -> Mask {
    let inside = picture.pixels().map(|p| p.0[0] >= 128).collect();
    Mask::new(picture.width() as usize, picture.height() as usize, inside)
}

/// The set that all views use.
fn one_set(path: &Path, capture: &Capture) -> Result<KeypointSet> {
    let mut sets =
        capture.views.iter().filter_map(|v| Some((&v.camera.name, v.keypoints.as_ref()?.joint_set)));
    let Some((first, set)) = sets.next() else {
        return Err(refuse(
            path,
            "has no keypoints in any view; expected OpenPose JSON in keypoints/NAME.json, NAME being the camera's",
        ));
    };
    if let Some((other, different)) = sets.find(|(_, other)| *other != set) {
        let message = format!(
            "has {} keypoints, but camera \"{first}\" has {}: detect all views with one model",
            different.name(),
            set.name()
        );
        return Err(Error::camera(path, other, message).into());
    }
    Ok(match set {
        JointSet::Body25 => KeypointSet::Body25,
        JointSet::Coco18 => KeypointSet::Coco18,
        JointSet::Coco17 => KeypointSet::Coco17,
        JointSet::Smpl24 => KeypointSet::Smpl24,
    })
}

fn extrinsics(path: &Path, capture: &Capture, asked: Option<Cameras>) -> Result<Extrinsics> {
    let nowhere = capture.views.iter().find(|view| view.camera.extrinsics.is_none());
    match (asked, nowhere) {
        (Some(Cameras::Unknown), _) | (None, Some(_)) => Ok(Extrinsics::Unknown),
        (_, None) => Ok(Extrinsics::Known),
        (Some(Cameras::Known), Some(view)) => {
            let message = "has no R and t: add them, or use --cameras unknown";
            Err(Error::camera(path, &view.camera.name, message).into())
        }
    }
}

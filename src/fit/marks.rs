//! The keypoints of a view beside the fitted body's.

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::keypoint_set::{BodyKeypoint, BodyPoint};
use vitruvian_reference::linalg::vector::{Vector3, ZERO, add_scaled};

use super::fitted::Fitted;
use super::observed::Observed;

/// A keypoint that was detected.
pub struct Mark {
    /// Its name in its set.
    pub name: &'static str,
    /// Where it was detected, pixels.
    pub detected_px: [f64; 2],
    /// Where the fitted body has it; `None` if the body lacks it, or has it behind the camera.
    pub found_px: Option<[f64; 2]>,
}

impl Mark {
    /// The distance between the two, pixels.
    pub fn distance_px(&self) -> Option<f64> {
        let [u, v] = self.found_px?;
        Some((u - self.detected_px[0]).hypot(v - self.detected_px[1]))
    }
}

/// The marks of view `index` with a confidence above zero.
pub fn of_view(observed: &Observed, fitted: &Fitted, body: &BodyModel, index: usize) -> Vec<Mark> {
    let set = observed.observation.keypoint_set;
    let camera = &fitted.parameters.cameras[index];
    let detected = &observed.observation.views[index].keypoints;
    let place = |keypoint: &BodyKeypoint| -> Vector3 {
        match &keypoint.point {
            BodyPoint::Joints(joints) => {
                joints.iter().fold(ZERO, |sum, &(j, weight)| add_scaled(sum, fitted.posed.joints[j], weight))
            }
            BodyPoint::Vertex(v) => fitted.posed.vertices[*v],
        }
    };
    let marks = detected.iter().zip(set.on_body(body)).enumerate();
    marks
        .filter(|(_, (keypoint, _))| keypoint.confidence > 0.0)
        .map(|(k, (keypoint, on_body))| Mark {
            name: set.name(k),
            detected_px: keypoint.pixel_px,
            found_px: on_body.and_then(|on_body| camera.project(place(&on_body))),
        })
        .collect()
}

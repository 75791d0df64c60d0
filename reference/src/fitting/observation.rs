//! What a fit is given: cameras and 2-D keypoints, and the refusals for data that cannot be fitted.

use super::keypoint_set::{BodyKeypoint, KeypointSet};
use crate::camera::Pinhole;
use crate::linalg::matrix::{IDENTITY, determinant, max_abs, mul, sub, transpose};
use std::fmt;

/// A detected keypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// (u, v), pixels from the image's top-left corner.
    pub pixel_px: [f64; 2],
    /// 0 to [`MOST_CONFIDENCE`]; the residual's weight. 0 for a keypoint that was not found, whose pixel then means nothing.
    pub confidence: f64,
}

/// One image of the person.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera. Of an [unknown](Extrinsics::Unknown) one only focal length, principal point and lens are read.
    pub camera: Pinhole,
    /// The keypoints, in the order of the observation's set.
    pub keypoints: Vec<Keypoint>,
}

/// Whether rotations and translations of the cameras are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extrinsics {
    /// R and t of every view are data; the answer lives in their world.
    Known,
    /// They are unknowns. The world is then the frame of view 0's camera: R_0 = I, t_0 = 0.
    Unknown,
}

/// One person at one moment, seen by N ≥ 1 cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The N views.
    pub views: Vec<View>,
    /// What the keypoints are.
    pub keypoint_set: KeypointSet,
    /// What is known of the cameras.
    pub extrinsics: Extrinsics,
}

/// The least number of usable keypoints: four points fix a camera's pose, three leave up to four.
pub const LEAST_KEYPOINTS: usize = 4;

/// The largest confidence. Detectors give 0 to 1, or the height of a peak that is not normalized, some tens; beyond a thousand
/// stands another quantity, and squares of it leave other marks nothing to say.
pub const MOST_CONFIDENCE: f64 = 1e3;

/// Why there is no fit.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// There is no view.
    NoViews,
    /// The body's tree is not SMPL's, so that the keypoints' names mean nothing on it.
    ForeignTree {
        /// J of the body.
        joints: usize,
    },
    /// A view's list of keypoints does not fit the set.
    KeypointCount {
        /// The view.
        view: usize,
        /// Keypoints in its list.
        found: usize,
        /// Keypoints of the set.
        expected: usize,
    },
    /// A pixel is NaN or infinite, or a confidence is not between 0 and [`MOST_CONFIDENCE`].
    BadKeypoint {
        /// The view.
        view: usize,
        /// The keypoint's index in the set.
        keypoint: usize,
        /// Its name.
        name: &'static str,
        /// What was found.
        found: Keypoint,
    },
    /// A camera is not one: a focal length that is not positive, a number that is not finite, R not a rotation.
    BadCamera {
        /// The view.
        view: usize,
        /// What is wrong.
        fault: &'static str,
    },
    /// Fewer than [`LEAST_KEYPOINTS`] different keypoints, at different places, are usable in all views together.
    TooFewKeypoints {
        /// How many are.
        usable: usize,
    },
    /// Fewer than [`LEAST_KEYPOINTS`] are usable in a view whose camera is unknown.
    TooFewKeypointsInView {
        /// The view.
        view: usize,
        /// How many are.
        usable: usize,
    },
    /// The pose prior is not for this body: its means do not have 3(J − 1) numbers.
    PriorSize {
        /// Numbers of a mean.
        found: usize,
        /// 3(J − 1).
        expected: usize,
    },
    /// The start that was handed in is for another body or another number of views, or not finite.
    BadInitial {
        /// What is wrong.
        fault: &'static str,
    },
    /// No start puts the body in front of every camera.
    NoStart,
    /// The descent left the finite numbers: something that was given is finite, but too large to be squared.
    Overflow,
    /// There is not one start for each view.
    StartCount {
        /// Starts.
        found: usize,
        /// Views.
        expected: usize,
    },
    /// A view's start is for another body, or not finite.
    BadStart {
        /// The view.
        view: usize,
        /// What is wrong.
        fault: &'static str,
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refusal::NoViews => write!(f, "there is no view to fit to"),
            Refusal::ForeignTree { joints } => {
                write!(f, "the body's tree of {joints} joints is not SMPL's; keypoints have no joints on it")
            }
            Refusal::KeypointCount { view, found, expected } => {
                write!(f, "view {view} has {found} keypoints; the set has {expected}")
            }
            Refusal::BadKeypoint { view, keypoint, name, found } => write!(
                f,
                "view {view}, keypoint {keypoint} ({name}) is ({}, {}) with confidence {}; expected finite numbers and a \
                 confidence from 0 to {MOST_CONFIDENCE}",
                found.pixel_px[0], found.pixel_px[1], found.confidence
            ),
            Refusal::BadCamera { view, fault } => write!(f, "the camera of view {view} {fault}"),
            Refusal::TooFewKeypoints { usable } => {
                write!(
                    f,
                    "{usable} usable keypoints at different places in all views together; at least {LEAST_KEYPOINTS} are needed"
                )
            }
            Refusal::TooFewKeypointsInView { view, usable } => write!(
                f,
                "{usable} usable keypoints at different places in view {view}; at least {LEAST_KEYPOINTS} are needed to find its \
                 camera"
            ),
            Refusal::PriorSize { found, expected } => {
                write!(
                    f,
                    "the pose prior is for {found} numbers; this body's pose has {expected} without the root"
                )
            }
            Refusal::BadInitial { fault } => write!(f, "the start that was handed in {fault}"),
            Refusal::NoStart => write!(f, "no start puts the body in front of every camera"),
            Refusal::Overflow => {
                write!(
                    f,
                    "the fit left the finite numbers: a keypoint, a camera, the start or the body is far too large"
                )
            }
            Refusal::StartCount { found, expected } => {
                write!(f, "{found} starts for {expected} views; every view has its own")
            }
            Refusal::BadStart { view, fault } => write!(f, "the start of view {view} {fault}"),
        }
    }
}

impl std::error::Error for Refusal {}

impl Observation {
    /// The weight of every keypoint in every view, base weight · confidence, N×K; 0 for those without a point on the body.
    ///
    /// # Errors
    /// The refusals for data that cannot be fitted, in the order of [`Refusal`].
    pub(super) fn checked_weights(&self, body: &[Option<BodyKeypoint>]) -> Result<Vec<Vec<f64>>, Refusal> {
        if self.views.is_empty() {
            return Err(Refusal::NoViews);
        }
        let expected = self.keypoint_set.count();
        for (view, v) in self.views.iter().enumerate() {
            let found = v.keypoints.len();
            if found != expected {
                return Err(Refusal::KeypointCount { view, found, expected });
            }
            for (keypoint, &found) in v.keypoints.iter().enumerate() {
                let [x, y] = found.pixel_px;
                let is_weight = (0.0..=MOST_CONFIDENCE).contains(&found.confidence);
                if !(is_weight && x.is_finite() && y.is_finite()) {
                    let name = self.keypoint_set.name(keypoint);
                    return Err(Refusal::BadKeypoint { view, keypoint, name, found });
                }
            }
            if let Some(fault) = camera_fault(&v.camera, self.extrinsics) {
                return Err(Refusal::BadCamera { view, fault });
            }
        }
        let weight = |k: usize, found: &Keypoint| {
            body[k].as_ref().map_or(0.0, |on_body| on_body.base_weight * found.confidence)
        };
        let weights: Vec<Vec<f64>> = self
            .views
            .iter()
            .map(|v| v.keypoints.iter().enumerate().map(|(k, found)| weight(k, found)).collect())
            .collect();
        // Marks at one and the same place (a detector's default, a collapsed picture) say no more than one of them.
        let says_something = |view: usize, k: usize| {
            let marks = &self.views[view].keypoints;
            let is_repeated = |j: usize| weights[view][j] > 0.0 && marks[j].pixel_px == marks[k].pixel_px;
            weights[view][k] > 0.0 && !(0..k).any(is_repeated)
        };
        let usable =
            (0..expected).filter(|&k| (0..weights.len()).any(|view| says_something(view, k))).count();
        if usable < LEAST_KEYPOINTS {
            return Err(Refusal::TooFewKeypoints { usable });
        }
        if self.extrinsics == Extrinsics::Unknown {
            for view in 0..weights.len() {
                let usable = (0..expected).filter(|&k| says_something(view, k)).count();
                if usable < LEAST_KEYPOINTS {
                    return Err(Refusal::TooFewKeypointsInView { view, usable });
                }
            }
        }
        Ok(weights)
    }
}

/// What is wrong with a camera, if something is.
fn camera_fault(camera: &Pinhole, extrinsics: Extrinsics) -> Option<&'static str> {
    let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    if !finite(&camera.focal_px) || camera.focal_px.iter().any(|&f| f <= 0.0) {
        return Some("has a focal length that is not a positive number");
    }
    if !finite(&camera.principal_px) || !finite(&camera.distortion) {
        return Some("has a principal point or a distortion that is not finite");
    }
    if extrinsics == Extrinsics::Unknown {
        return None;
    }
    if !finite(camera.rotation.as_flattened()) || !finite(&camera.translation) {
        return Some("has a rotation or a translation that is not finite");
    }
    let gram = mul(&camera.rotation, &transpose(&camera.rotation));
    let is_rotation = max_abs(&sub(&gram, &IDENTITY)) < 1e-4 && determinant(&camera.rotation) > 0.0;
    (!is_rotation).then_some("has a matrix R that is not a rotation")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::test_scene::body;

    fn observation() -> Observation {
        let keypoint = |k: u8| Keypoint { pixel_px: [10.0 + f64::from(k), 20.0], confidence: 0.5 };
        let keypoints: Vec<Keypoint> = (0..24).map(keypoint).collect();
        let camera = Pinhole::ideal(500.0, [160.0, 120.0]);
        Observation {
            views: vec![View { camera, keypoints }; 2],
            keypoint_set: KeypointSet::Smpl24,
            extrinsics: Extrinsics::Known,
        }
    }

    fn refusal(change: impl FnOnce(&mut Observation)) -> String {
        let mut observation = observation();
        change(&mut observation);
        let keypoints = observation.keypoint_set.on_body(body());
        observation.checked_weights(&keypoints).expect_err("a refusal").to_string()
    }

    #[test]
    fn confidence_is_the_weight() {
        let keypoints = KeypointSet::Smpl24.on_body(body());
        assert_eq!(observation().checked_weights(&keypoints), Ok(vec![vec![0.5; 24]; 2]));
    }

    #[test]
    fn refusals_name_the_view_and_the_keypoint() {
        let nan = refusal(|o| o.views[1].keypoints[16].pixel_px[1] = f64::NAN);
        assert!(nan.contains("view 1, keypoint 16 (left_shoulder) is (26, NaN)"), "{nan}");
        let negative = refusal(|o| o.views[0].keypoints[3].confidence = -0.1);
        assert!(negative.contains("view 0, keypoint 3 (spine1)") && negative.contains("-0.1"), "{negative}");
        let huge = refusal(|o| o.views[0].keypoints[3].confidence = 1e200);
        assert!(huge.contains("view 0, keypoint 3 (spine1)") && huge.contains("from 0 to 1000"), "{huge}");
        let short = refusal(|o| o.views[1].keypoints.truncate(23));
        assert!(short.contains("view 1 has 23 keypoints; the set has 24"), "{short}");
        let mirrored = refusal(|o| o.views[0].camera.rotation[2][2] = -1.0);
        assert!(mirrored.contains("view 0 has a matrix R that is not a rotation"), "{mirrored}");
        let flat = refusal(|o| o.views[1].camera.focal_px[0] = 0.0);
        assert!(flat.contains("view 1 has a focal length"), "{flat}");
        assert!(refusal(|o| o.views.clear()).contains("no view"));
    }

    #[test]
    fn fewer_than_four_usable_keypoints_are_refused() {
        let keep = |o: &mut Observation, view: usize, from: usize| {
            o.views[view].keypoints[from..].iter_mut().for_each(|k| k.confidence = 0.0);
        };
        let total = refusal(|o| {
            keep(o, 0, 3);
            keep(o, 1, 2);
        });
        assert!(total.starts_with("3 usable keypoints"), "{total}");
        let one_place = refusal(|o| {
            o.views.iter_mut().flat_map(|v| &mut v.keypoints).for_each(|k| k.pixel_px = [160.0, 120.0]);
        });
        assert!(one_place.starts_with("1 usable keypoints at different places"), "{one_place}");
        let one_view = refusal(|o| {
            o.extrinsics = Extrinsics::Unknown;
            keep(o, 1, 3);
        });
        assert!(one_view.contains("3 usable keypoints at different places in view 1"), "{one_view}");
    }
}

//! The synthetic people of the experiments of chapters 2 and 3: a bare body, and cameras of 320×240 around it.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use vitruvian_conformance::convert;
use vitruvian_reference::body::{BodyModel, Posed};
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::{Extrinsics, Keypoint, KeypointSet, Observation, View};
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_runtime::capture::{Camera, look_at};

use super::pose::{a_pose, limbs_are_apart, random_pose};
use super::{normal, scene_rng};

/// The thesis' picture size.
pub const WIDTH: u32 = 320;
/// The thesis' picture size.
pub const HEIGHT: u32 = 240;
/// Focal length in pixels, and distance of the cameras in metres: a person of 1.7 m is 170 pixels tall.
const FOCAL_PX: f64 = 400.0;
const DISTANCE_M: f64 = 4.0;

/// In which pose a person stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stance {
    /// Arms 45° down, everything else at rest: chapter 3's synthetic bodies.
    APose,
    /// Something that people do.
    Any,
}

/// A person, and who looks at it.
pub struct Subject {
    /// θ \[72\], radians.
    pub pose: Vec<f64>,
    /// β.
    pub betas: Vec<f64>,
    /// Metres.
    pub trans: Vector3,
    /// Skin and joints, world frame.
    pub posed: Posed,
    /// Around the body, looking at it.
    pub cameras: Vec<Pinhole>,
    /// Draws the noise of the detections, the same directions at every level.
    noise: ChaCha8Rng,
}

impl Subject {
    /// Person `index` of a seed: random shape, heading and rig; camera k stands at about k·360°/`views`.
    pub fn random(body: &BodyModel, stance: Stance, views: usize, seed: u64, index: u64) -> Subject {
        let mut rng = scene_rng(seed, index);
        let betas: Vec<f64> = (0..body.beta_count().min(10)).map(|_| normal(&mut rng, 2.5)).collect();
        let rest = body.pose(&vec![0.0; 3 * body.joint_count()], &betas, [0.0; 3]);
        let pose = match stance {
            Stance::APose => a_pose(&mut rng, &rest.joints),
            Stance::Any => random_pose(&mut rng, &rest.joints, |pose| {
                limbs_are_apart(&body.pose(pose, &betas, [0.0; 3]).joints, 0.17)
            }),
        };
        let trans = std::array::from_fn(|_| 0.08 * normal(&mut rng, 2.0));
        let posed = body.pose(&pose, &betas, trans);
        let cameras = (0..views).map(|k| camera(&mut rng, k as f64 / views as f64)).collect();
        Subject { pose, betas, trans, posed, cameras, noise: rng }
    }

    /// The 24 joints as every camera sees them, with noise N(0, `noise_px`²) on both coordinates and confidence 1.
    pub fn observation(&self, noise_px: f64, extrinsics: Extrinsics) -> Observation {
        let mut rng = self.noise.clone();
        let mut see = |camera: &Pinhole, joint: Vector3| {
            let exact = camera.project(joint).expect("the cameras stand 4 m away and look at the body");
            let pixel_px = exact.map(|x| x + noise_px * normal(&mut rng, 4.0));
            Keypoint { pixel_px, confidence: 1.0 }
        };
        let views = self.cameras.iter().map(|&camera| View {
            camera,
            keypoints: self.posed.joints.iter().map(|&joint| see(&camera, joint)).collect(),
        });
        Observation { views: views.collect(), keypoint_set: KeypointSet::Smpl24, extrinsics }
    }
}

/// A camera at `turn` of the circle, give or take 8°, between knee and head height.
fn camera(rng: &mut ChaCha8Rng, turn: f64) -> Pinhole {
    let heading = std::f64::consts::TAU * turn + rng.random_range(-8f64..8.0).to_radians();
    let distance = DISTANCE_M * rng.random_range(0.97..1.03);
    let eye = [distance * heading.sin(), rng.random_range(-0.3..0.6), distance * heading.cos()];
    let extrinsics = look_at(eye, [0.0; 3]).expect("the eye is 4 m from where it looks");
    let focal_px = FOCAL_PX * rng.random_range(0.97..1.03);
    let k =
        [[focal_px, 0.0, 0.5 * f64::from(WIDTH)], [0.0, focal_px, 0.5 * f64::from(HEIGHT)], [0.0, 0.0, 1.0]];
    let name = format!("{:.0}", heading.to_degrees());
    convert::camera_to_reference(&Camera {
        name,
        width: WIDTH,
        height: HEIGHT,
        k,
        extrinsics: Some(extrinsics),
        distortion: [0.0; 5],
    })
    .expect("it has extrinsics")
}

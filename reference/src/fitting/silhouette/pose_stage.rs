//! Pose, shape and translation to outlines: rounds of pairing and of the [outline problem](super::outline_problem).
//!
//! The reach of the pairing shrinks geometrically from round to round, and with it the scale of the robust loss: first limbs
//! find their place, then contour points within two centimetres decide.

use super::options::PoseRefinement;
use super::outline_problem::{KeypointPair, OutlineProblem, Sigmas};
use super::result::{SilhouetteStage, StageKind};
use super::scene::Scene;
use super::shape_stage::energy;
use super::state::State;
use super::unfold::Damping;
use crate::camera::Pinhole;
use crate::least_squares::{Dogleg, Termination};
use crate::linalg::vector::Vector3;

/// Accepted steps within one round of the pose refinement: the pairs change, so the minimum of a round is worth little.
const STEPS_PER_ROUND: usize = 2;
/// Of the last round, which is to end at its minimum.
const LAST_ROUND_STEPS: usize = 30;

/// The least reach: contour points lie up to half a pixel diagonal beside the outline.
const LEAST_REACH_PX: f64 = 2.0;

/// Pose, shape and translation, and if they are free the cameras, to outlines and keypoints; undone if it lowers the overlap.
///
/// Beside the report, by how many pixels the masks are too large all round for the body found: a segmentation's habit, or
/// clothes. What the keypoints say of the pose is not given up for it; the offsets that follow are to explain the masks as they
/// are.
pub fn pose_stage(
    state: &mut State,
    scene: &mut Scene,
    keypoints: &[KeypointPair],
    cameras_free: bool,
    options: &PoseRefinement,
) -> (SilhouetteStage, f64) {
    let prior_pose = state.pose.clone();
    let mut report = SilhouetteStage {
        kind: StageKind::Pose,
        energy_before: f64::INFINITY,
        energy: f64::INFINITY,
        iterations: 0,
        evaluations: 0,
        termination: Termination::IterationLimit,
        correspondences: 0,
        iou: Vec::new(),
        damping: Damping::NONE,
        reverted: false,
    };
    let before = (state.pose.clone(), state.betas.clone(), state.trans, scene.cameras().to_vec());
    let vertices_before = state.vertices();
    let mut mask_bias_px = 0.0;
    for round in 0..options.rounds {
        let last = round + 1 == options.rounds;
        let dogleg = Dogleg {
            max_iterations: if last { LAST_ROUND_STEPS } else { STEPS_PER_ROUND },
            improvement_tolerance: 1e-4,
            ..Dogleg::default()
        };
        let progress = round as f64 / (options.rounds - 1).max(1) as f64;
        let reach_m = options.reach_m[0] * (options.reach_m[1] / options.reach_m[0]).powf(progress);
        let reach_px = reaches_px(scene.cameras(), state.joints()[0], reach_m);
        let seen = scene.see(&state.vertices());
        let pairs = scene.outline_pairs(&seen, &reach_px);
        let sigmas = Sigmas {
            contour_px: options.contour_sigma_px,
            keypoint_px: options.keypoint_sigma_px,
            pose_rad: options.pose_sigma_rad,
            mask_bias_px: options.mask_bias_sigma_px,
        };
        let problem = OutlineProblem::new(
            state.body,
            &state.skeleton,
            scene.cameras(),
            cameras_free,
            &state.offsets,
            &pairs,
            keypoints,
            &prior_pose,
            sigmas,
        );
        let start = problem.start(&state.pose, &state.betas, state.trans, mask_bias_px);
        let solution = dogleg.minimize(&problem, &start);
        report.energy_before = energy(&problem, &start);
        report.energy = solution.energy;
        report.iterations += solution.iterations;
        report.evaluations += solution.evaluations;
        report.termination = solution.termination;
        report.correspondences = pairs.len();
        let (pose, betas, trans, bias, cameras) = problem.finish(&solution.x);
        mask_bias_px = bias;
        (state.pose, state.betas, state.trans) = (pose, betas, trans);
        if cameras_free {
            scene.set_cameras(cameras);
        }
    }
    report.iou = scene.iou(&state.vertices());
    let found_cameras = scene.cameras().to_vec();
    let overlap = scene.unbiased_overlap(&state.vertices(), mask_bias_px);
    let (pose, betas, trans, cameras) = before;
    scene.set_cameras(cameras);
    if overlap < scene.unbiased_overlap(&vertices_before, mask_bias_px) {
        (state.pose, state.betas, state.trans) = (pose, betas, trans);
        mask_bias_px = 0.0;
        report.reverted = true;
        report.iou = scene.iou(&vertices_before);
    } else {
        scene.set_cameras(found_cameras);
    }
    (report, mask_bias_px)
}

/// A length at a place, as every camera sees it, in pixels; [`LEAST_REACH_PX`] at least.
fn reaches_px(cameras: &[Pinhole], place: Vector3, length_m: f64) -> Vec<f64> {
    let seen = |camera: &Pinhole| camera.focal_px[0] * length_m / camera.to_camera(place)[2];
    cameras.iter().map(|camera| seen(camera).max(LEAST_REACH_PX)).collect()
}

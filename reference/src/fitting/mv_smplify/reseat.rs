//! Orientations sought anew, where a regressor was wrong about which way a person faces.
//!
//! A root half a turn off is a valley of its own, which 100 steps of 10⁻² rad do not leave. The mean pose of all views is hardly
//! touched by it, though: its points are landmarks, and the camera that sees them where they were seen is found by
//! [resection](crate::fitting::resection), which searches all headings.

use super::shared_stage::{Shared, SharedStage};
use super::view_term::Placement;
use crate::fitting::resection::{Landmark, Resected, resect};
use crate::linalg::vector::sub;
use crate::rotation::{angle_between, logarithm, rodrigues};

/// A view faces elsewhere if its root turns by more than this, radians; less is what the stages are for.
const ELSEWHERE_RAD: f64 = 1.0;
/// A new orientation is taken if it leaves less than this of the view's loss.
const MUCH_LESS: f64 = 0.5;
/// Candidates for each view.
const CANDIDATES: usize = 3;

/// `begin` with the views turned elsewhere that gain much by it; `None` if none does.
pub(super) fn reseated(stage: &SharedStage, begin: &Shared, sigma_px: f64) -> Option<Shared> {
    let mut pose = stage.figure.room();
    stage.figure.pose(&begin.body_pose, &begin.betas, &mut pose);
    let upright = rodrigues([std::f64::consts::PI, 0.0, 0.0]);
    let mut found = begin.clone();
    let mut moved = false;
    for (view, placement) in stage.views.iter().zip(&mut found.placements) {
        let landmarks: Vec<Landmark> = view
            .marks
            .iter()
            .filter_map(|mark| {
                let seen = view.camera.normalized(mark.pixel_px)?;
                Some(Landmark { point: pose.points[mark.keypoint], seen, weight: mark.weight })
            })
            .collect();
        let focal = (view.camera.focal_px[0] * view.camera.focal_px[1]).sqrt();
        let sigma = sigma_px / (view.crop_scale * focal);
        let loss = |at: &Placement| view.losses(at, &pose.points, pose.pelvis).iter().sum::<f64>();
        let current = rodrigues(placement.root);
        let best = resect(&landmarks, &upright, sigma, CANDIDATES)
            .into_iter()
            .filter(|camera| is_finite(camera) && angle_between(&camera.rotation, &current) > ELSEWHERE_RAD)
            .map(|camera| Placement {
                root: logarithm(&camera.rotation),
                translation: sub(camera.translation, pose.pelvis),
            })
            .min_by(|a, b| loss(a).total_cmp(&loss(b)));
        if let Some(best) = best
            && loss(&best) < MUCH_LESS * loss(placement)
        {
            *placement = best;
            moved = true;
        }
    }
    moved.then_some(found)
}

/// Landmarks that are too large to be squared are resected to NaN, which is nowhere.
fn is_finite(camera: &Resected) -> bool {
    camera.rotation.iter().flatten().chain(&camera.translation).all(|x| x.is_finite())
}

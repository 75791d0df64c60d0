//! What a collaborative fit gives back, and whether it may teach.

use super::shared_stage::{Shared, SharedStage};
use crate::linalg::vector::Vector3;

/// One body in N views.
#[derive(Clone, Debug, PartialEq)]
pub struct MvFit {
    /// r_i: the root's orientation in each view's camera axes, axis–angle, N.
    pub roots: Vec<Vector3>,
    /// θ̃: the shared pose without its root, 3(J − 1) numbers, radians.
    pub body_pose: Vec<f64>,
    /// β, shared, B numbers.
    pub betas: Vec<f64>,
    /// t_i: the body's translation in each view's camera frame, metres, N.
    pub translations: Vec<Vector3>,
    /// The robust loss of every keypoint of the set, summed over the views, square pixels of the crop; 0 for one that no view
    /// counts.
    pub keypoint_losses: Vec<f64>,
    /// The mean robust loss of a counted keypoint in each view, N: the view that does not fit stands out.
    pub view_losses: Vec<f64>,
    /// The mean of `keypoint_losses` over the keypoints that some view counts.
    pub mean_loss: f64,
    /// `mean_loss` < [`VALID_BELOW`]: only such fits supervise the regressor.
    pub valid: bool,
}

/// A fit is valid if the loss, summed over the views and averaged over the keypoints, stays below this: square pixels of the
/// crop. With four views that is an error of some 3.5 px in each coordinate.
pub const VALID_BELOW: f64 = 100.0;

impl MvFit {
    /// What a stage's unknowns mean, with the losses they leave.
    pub(super) fn of(stage: &SharedStage, shared: Shared) -> MvFit {
        let (losses, count) = (stage.losses(&shared), stage.figure.keypoint_count());
        let mut keypoint_losses = vec![0.0; count];
        let mut is_counted = vec![false; count];
        for (view, losses) in stage.views.iter().zip(&losses) {
            for (mark, loss) in view.marks.iter().zip(losses) {
                keypoint_losses[mark.keypoint] += loss;
                is_counted[mark.keypoint] = true;
            }
        }
        let counted = is_counted.iter().filter(|counted| **counted).count();
        let mean_loss = keypoint_losses.iter().sum::<f64>() / counted as f64;
        MvFit {
            roots: shared.placements.iter().map(|p| p.root).collect(),
            body_pose: shared.body_pose,
            betas: shared.betas,
            translations: shared.placements.iter().map(|p| p.translation).collect(),
            keypoint_losses,
            view_losses: losses.iter().map(|l| l.iter().sum::<f64>() / l.len() as f64).collect(),
            mean_loss,
            valid: mean_loss < VALID_BELOW,
        }
    }

    /// Whether every number is one. A descent that overflows somewhere ends in NaN everywhere.
    pub(super) fn is_finite(&self) -> bool {
        let placements = self.roots.iter().chain(&self.translations).flatten();
        let body = self.body_pose.iter().chain(&self.betas);
        let losses = self.keypoint_losses.iter().chain(&self.view_losses).chain([&self.mean_loss]);
        placements.chain(body).chain(losses).all(|x| x.is_finite())
    }

    /// θ in the camera of `view`: its root and the shared rest, 3J numbers.
    ///
    /// # Panics
    /// If there is no such view.
    pub fn pose(&self, view: usize) -> Vec<f64> {
        [&self.roots[view][..], &self.body_pose[..]].concat()
    }
}

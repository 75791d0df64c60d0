//! Where a fit begins: what the regressor said of each view, checked, and brought together.

use super::options::{MeanPose, MvSmplifyOptions, StartingTranslation};
use super::view_term::Placement;
use crate::fitting::camera_translation::least_squares_translation;
use crate::fitting::observation::{Refusal, View};
use crate::linalg::vector::{Vector3, add};
use crate::rotation::{arithmetic_mean, logarithm, mean, rodrigues, rotate};

/// What a regressor says of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewStart {
    /// The root's orientation in camera axes, axis–angle, radians: about a half turn about x for someone upright.
    pub root: Vector3,
    /// The body's translation in the camera's frame, metres: X_c = body + translation.
    pub translation: Vector3,
    /// The pose without its root, 3(J − 1) numbers, radians.
    pub body_pose: Vec<f64>,
    /// β; fewer than B are taken as followed by zeros.
    pub betas: Vec<f64>,
    /// The side of the person's square crop that the regressor saw, pixels of the view's picture; `None` for 1.2 times the
    /// longer side of the box around the view's marks.
    pub side_px: Option<f64>,
}

/// The sizes of a start.
///
/// # Errors
/// [`Refusal::StartCount`] and [`Refusal::BadStart`].
pub(super) fn check(
    starts: &[ViewStart],
    views: usize,
    pose_len: usize,
    beta_count: usize,
) -> Result<(), Refusal> {
    if starts.len() != views {
        return Err(Refusal::StartCount { found: starts.len(), expected: views });
    }
    for (view, start) in starts.iter().enumerate() {
        let mut numbers =
            start.body_pose.iter().chain(&start.betas).chain(&start.root).chain(&start.translation);
        let fault = if start.body_pose.len() != pose_len {
            "has a body pose of another length than 3(J − 1)"
        } else if start.betas.len() > beta_count {
            "has more betas than this body"
        } else if !numbers.all(|x| x.is_finite()) {
            "holds a number that is not finite"
        } else if start.side_px.is_some_and(|side| !(side.is_finite() && side > 0.0)) {
            "has a crop whose side is not a positive number"
        } else {
            continue;
        };
        return Err(Refusal::BadStart { view, fault });
    }
    Ok(())
}

/// The pose that the views share at first. A joint without a chordal mean takes the first view's rotation.
pub(super) fn mean_pose(starts: &[ViewStart], how: MeanPose) -> Vec<f64> {
    let joint = |j: usize| -> Vector3 {
        let turns: Vec<Vector3> =
            starts.iter().map(|s| std::array::from_fn(|c| s.body_pose[3 * j + c])).collect();
        let middle = match how {
            MeanPose::AxisAngle => arithmetic_mean(&turns),
            MeanPose::Chordal => {
                let matrices: Vec<_> = turns.iter().map(|&turn| rodrigues(turn)).collect();
                mean(&matrices).map(|m| logarithm(&m))
            }
        };
        middle.unwrap_or(turns[0])
    };
    (0..starts[0].body_pose.len() / 3).flat_map(joint).collect()
}

/// β̄ of B numbers.
pub(super) fn mean_betas(starts: &[ViewStart], beta_count: usize) -> Vec<f64> {
    let mut betas = vec![0.0; beta_count];
    for start in starts {
        for (sum, beta) in betas.iter_mut().zip(&start.betas) {
            *sum += beta / starts.len() as f64;
        }
    }
    betas
}

/// Where the body of a view begins; `points` are q_k relative to the pelvis, `weights` those of the marks in the shared stage.
///
/// A translation that is to be kept but puts a point behind the camera is sought by least squares as well: a regressor that has
/// learnt nothing yet gives such. `None` if there is none.
pub(super) fn placement(
    start: &ViewStart,
    view: &View,
    points: &[Vector3],
    pelvis: Vector3,
    weights: &[f64],
    options: &MvSmplifyOptions,
) -> Option<Placement> {
    let turned: Vec<Vector3> = points.iter().map(|&q| add(rotate(start.root, q), pelvis)).collect();
    let in_front = |t: Vector3| turned.iter().zip(weights).all(|(p, w)| *w == 0.0 || p[2] + t[2] > NEAREST_M);
    let sought = || {
        let mut marks = view.keypoints.clone();
        for (mark, weight) in marks.iter_mut().zip(weights) {
            mark.confidence = *weight;
        }
        least_squares_translation(&view.camera, &turned, &marks).filter(|t| in_front(*t))
    };
    let given = Some(start.translation).filter(|t| in_front(*t));
    let translation = match options.starting_translation {
        StartingTranslation::Given => given.or_else(sought),
        StartingTranslation::LeastSquares => sought().or(given),
    };
    translation.map(|translation| Placement { root: start.root, translation })
}

/// A body nearer than this to the camera's centre is in nobody's picture.
const NEAREST_M: f64 = 0.05;

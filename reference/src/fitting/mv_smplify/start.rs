//! Where a fit begins: what the regressor said of each view, checked, and brought together.

use super::options::{MeanPose, StartingTranslation};
use super::view_term::{Placement, ViewTerm};
use crate::fitting::camera_translation::least_squares_translation;
use crate::fitting::observation::{Keypoint, Refusal};
use crate::linalg::matrix::apply;
use crate::linalg::vector::{Vector3, add};
use crate::rotation::{arithmetic_mean, logarithm, mean, rodrigues};

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

/// An angle beyond this, a thousand turns, is a number that means something else; its square may overflow.
const MOST_RADIANS: f64 = 2e3 * std::f64::consts::PI;

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
        let mut angles = start.body_pose.iter().chain(&start.root);
        let fault = if start.body_pose.len() != pose_len {
            "has a body pose of another length than 3(J − 1)"
        } else if start.betas.len() > beta_count {
            "has more betas than this body"
        } else if !numbers.all(|x| x.is_finite()) {
            "holds a number that is not finite"
        } else if angles.any(|x| x.abs() > MOST_RADIANS) {
            "holds an angle of more than a thousand turns; expected radians"
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

/// A body nearer than this to the camera's centre, metres, is in nobody's picture.
const NEAREST_M: f64 = 0.05;

/// Where the body of a view begins; `points` are q_k relative to the pelvis, `term` has the view's marks.
///
/// A translation that is to be kept but puts a marked point behind the camera is sought by least squares as well: a regressor
/// that has learnt nothing yet gives such. `None` if there is none.
pub(super) fn placement(
    start: &ViewStart,
    term: &ViewTerm,
    points: &[Vector3],
    pelvis: Vector3,
    how: StartingTranslation,
) -> Option<Placement> {
    let turn = rodrigues(start.root);
    let turned: Vec<Vector3> =
        term.marks.iter().map(|m| add(apply(&turn, points[m.keypoint]), pelvis)).collect();
    let is_in_front = |t: &Vector3| turned.iter().all(|p| p[2] + t[2] > NEAREST_M);
    let sought = || {
        let seen: Vec<Keypoint> =
            term.marks.iter().map(|m| Keypoint { pixel_px: m.pixel_px, confidence: m.weight }).collect();
        least_squares_translation(&term.camera, &turned, &seen).filter(is_in_front)
    };
    let given = Some(start.translation).filter(is_in_front);
    let translation = match how {
        StartingTranslation::Given => given.or_else(sought),
        StartingTranslation::LeastSquares => sought().or(given),
    };
    translation.map(|translation| Placement { root: start.root, translation })
}

#[cfg(test)]
mod tests {
    use super::super::test_views::{figure_of, marked_views};
    use super::*;
    use crate::fitting::KeypointSet;
    use crate::fitting::test_scene::body;
    use crate::linalg::vector::distance;
    use std::f64::consts::PI;

    fn start(body_pose: Vec<f64>) -> ViewStart {
        ViewStart {
            root: [PI, 0.0, 0.0],
            translation: [0.0, 0.0, 4.0],
            body_pose,
            betas: vec![],
            side_px: None,
        }
    }

    #[test]
    fn beside_a_half_turn_the_two_means_part() {
        let turned = |x: f64| start([vec![x, 0.0, 0.0], vec![0.2 * x, 0.0, 0.0]].concat());
        let starts = [turned(PI - 0.1), turned(0.1 - PI)];
        let chordal = mean_pose(&starts, MeanPose::Chordal);
        assert!((chordal[0].abs() - PI).abs() < 1e-12 && chordal[3].abs() < 1e-12, "{chordal:?}");
        assert_eq!(mean_pose(&starts, MeanPose::AxisAngle), [0.0; 6]);
    }

    #[test]
    fn a_joint_without_a_chordal_mean_is_the_first_view_s() {
        let starts = [start(vec![0.3, 0.0, 0.0]), start(vec![0.3 - PI, 0.0, 0.0])];
        assert_eq!(mean_pose(&starts, MeanPose::Chordal), [0.3, 0.0, 0.0]);
    }

    #[test]
    fn missing_betas_are_zeros() {
        let mut starts = [start(Vec::new()), start(Vec::new())];
        starts[0].betas = vec![1.0, 2.0];
        assert_eq!(mean_betas(&starts, 3), [0.5, 1.0, 0.0]);
    }

    #[test]
    fn a_translation_behind_the_camera_is_sought_from_the_marks() {
        let skeleton = body().skeleton();
        let figure = figure_of(&skeleton, None, KeypointSet::Smpl24);
        let (mut terms, shared) = marked_views(&figure, 1, 3);
        let mut pose = figure.room();
        figure.pose(&shared.body_pose, &shared.betas, &mut pose);
        let truth = shared.placements[0];
        let turn = rodrigues(truth.root);
        let camera = terms[0].camera;
        for mark in &mut terms[0].marks {
            let point = add(add(apply(&turn, pose.points[mark.keypoint]), pose.pelvis), truth.translation);
            mark.pixel_px = camera.project(point).expect("in front");
        }
        let begin = |z: f64, how: StartingTranslation| {
            let start = ViewStart { root: truth.root, translation: [0.0, 0.0, z], ..start(Vec::new()) };
            placement(&start, &terms[0], &pose.points, pose.pelvis, how).expect("a place").translation
        };
        assert!(distance(begin(-3.0, StartingTranslation::Given), truth.translation) < 1e-9);
        assert!(distance(begin(4.0, StartingTranslation::LeastSquares), truth.translation) < 1e-9);
        assert_eq!(begin(4.0, StartingTranslation::Given), [0.0, 0.0, 4.0]);
    }
}

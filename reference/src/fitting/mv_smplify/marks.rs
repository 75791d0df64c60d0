//! From a view's keypoints to the marks that count, in pixels of the person's crop.

use super::view_term::{Loss, Mark, ViewTerm};
use crate::camera::Pinhole;
use crate::fitting::KeypointSet;
use crate::fitting::keypoint_set::BodyKeypoint;
use crate::fitting::observation::{Extrinsics, Observation, Refusal, View};
use crate::linalg::matrix::IDENTITY;
use crate::linalg::vector::ZERO;

/// A person's crop is this much larger than the box around the marks.
const CROP_MARGIN: f64 = 1.2;

/// Base weight times confidence of every keypoint in every view, N×K.
///
/// # Errors
/// The refusals of [`Observation`]: no view, a wrong number of keypoints, numbers that are not finite, a camera that is none, or a
/// view with fewer than four usable keypoints at different places: six unknowns are its own.
pub(super) fn weights(
    views: &[View],
    set: KeypointSet,
    on_body: &[Option<BodyKeypoint>],
) -> Result<Vec<Vec<f64>>, Refusal> {
    Observation { views: views.to_vec(), keypoint_set: set, extrinsics: Extrinsics::Unknown }
        .checked_weights(on_body)
}

/// The side of the square crop around the marks of a view, pixels of the photograph: 1.2 times the longer side of their box.
pub(super) fn person_side_px(view: &View) -> f64 {
    let side = |axis: usize| {
        let seen = || view.keypoints.iter().filter(|k| k.confidence > 0.0).map(|k| k.pixel_px[axis]);
        seen().fold(f64::NEG_INFINITY, f64::max) - seen().fold(f64::INFINITY, f64::min)
    };
    CROP_MARGIN * side(0).max(side(1))
}

/// Stage 2's marks: all with a weight, squared, under ρ.
pub(super) fn shared_term(view: &View, weights: &[f64], crop_scale: f64, sigma_px: f64) -> ViewTerm {
    let mark = |keypoint: usize| Mark {
        keypoint,
        pixel_px: view.keypoints[keypoint].pixel_px,
        weight: weights[keypoint] * weights[keypoint],
    };
    ViewTerm {
        camera: Pinhole { rotation: IDENTITY, translation: ZERO, ..view.camera },
        crop_scale,
        marks: (0..weights.len()).filter(|&k| weights[k] > 0.0).map(mark).collect(),
        loss: Loss::GemanMcClure(sigma_px),
    }
}

/// Stage 1's marks: the four of the torso with weight 1 under the plain square, or all of stage 2 if one of the four was not
/// seen.
///
/// Hips count here whatever their base weight: which way a person faces does not depend on a few centimetres.
pub(super) fn torso_term(
    view: &View,
    torso: [usize; 4],
    on_body: &[Option<BodyKeypoint>],
    shared: &ViewTerm,
) -> ViewTerm {
    let is_seen = |k: usize| view.keypoints[k].confidence > 0.0 && on_body[k].is_some();
    let mark = |keypoint: usize| Mark { keypoint, pixel_px: view.keypoints[keypoint].pixel_px, weight: 1.0 };
    let marks = if torso.iter().all(|&k| is_seen(k)) {
        torso.map(mark).to_vec()
    } else {
        shared.marks.iter().map(|m| mark(m.keypoint)).collect()
    };
    ViewTerm { marks, loss: Loss::Square, ..shared.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::test_scene::{body, observe_set, person, ring};

    fn seen(set: KeypointSet) -> (View, Vec<Option<BodyKeypoint>>) {
        (observe_set(&person(0), &ring(1), set).views.remove(0), set.on_body(body()))
    }

    #[test]
    fn hips_of_a_detector_serve_the_torso_alone() {
        let set = KeypointSet::Coco17;
        let (view, on_body) = seen(set);
        let weights = weights(std::slice::from_ref(&view), set, &on_body).expect("twelve joints").remove(0);
        let shared = shared_term(&view, &weights, 1.0, 100.0);
        assert!(shared.marks.iter().all(|m| !set.name(m.keypoint).ends_with("hip")));
        let torso: Vec<usize> =
            torso_term(&view, set.torso(), &on_body, &shared).marks.iter().map(|m| m.keypoint).collect();
        assert_eq!(torso, set.torso());
    }

    #[test]
    fn without_a_shoulder_all_marks_stand_for_the_torso() {
        let set = KeypointSet::Smpl24;
        let (mut view, on_body) = seen(set);
        view.keypoints[16].confidence = 0.0;
        let weights = weights(std::slice::from_ref(&view), set, &on_body).expect("23 joints").remove(0);
        let shared = shared_term(&view, &weights, 1.0, 100.0);
        assert_eq!(torso_term(&view, set.torso(), &on_body, &shared).marks.len(), 23);
    }

    #[test]
    fn a_crop_is_a_fifth_larger_than_the_marks() {
        let (mut view, _) = seen(KeypointSet::Smpl24);
        for (k, keypoint) in view.keypoints.iter_mut().enumerate() {
            keypoint.pixel_px = [100.0 + k as f64, 50.0 + 4.0 * k as f64];
        }
        // An unseen keypoint's pixel means nothing.
        view.keypoints[23].confidence = 0.0;
        assert!((person_side_px(&view) - 1.2 * 88.0).abs() < 1e-12);
    }
}

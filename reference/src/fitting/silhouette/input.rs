//! What a silhouette fit is given, checked, and the refusals.

use super::outline_problem::KeypointPair;
use super::result::{SilhouetteRefusal, Warning};
use super::scene::Scene;
use super::state::State;
use crate::body::BodyModel;
use crate::fitting::{Observation, Parameters};
use crate::silhouette::Mask;
use crate::silhouette::dilation::{StructuringElement, dilate};

/// A mask whose overlap with the rendered start is less shows another person or another pose: the worst start of a joint fit
/// from 2 px noise overlaps by 0.6.
const LEAST_IOU: f64 = 0.3;
/// The share of the start's joints that may project outside of the mask.
const JOINTS_OUTSIDE: f64 = 0.5;
/// Joints this near to the mask count as inside: they may lie close under the skin, and the start is not exact.
const MARGIN: StructuringElement = StructuringElement::Square { size: 9 };

/// The warnings, or the first refusal that needs no rendering.
pub fn check(
    body: &BodyModel,
    start: &Parameters,
    masks: &[Mask],
    keypoints: Option<&Observation>,
) -> Result<Vec<Warning>, SilhouetteRefusal> {
    if masks.is_empty() || start.cameras.is_empty() {
        return Err(SilhouetteRefusal::NoViews);
    }
    if masks.len() != start.cameras.len() {
        return Err(SilhouetteRefusal::MaskCount { cameras: start.cameras.len(), masks: masks.len() });
    }
    if start.pose.len() != 3 * body.joint_count() {
        return Err(SilhouetteRefusal::BadStart { what: "pose has another number of joints than the body" });
    }
    if start.betas.len() > body.beta_count() {
        return Err(SilhouetteRefusal::BadStart { what: "betas are more than the body has" });
    }
    if keypoints.is_some_and(|observation| observation.views.len() != masks.len()) {
        return Err(SilhouetteRefusal::BadStart {
            what: "keypoints have another number of views than cameras",
        });
    }
    let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    if !finite(&start.pose) || !finite(&start.betas) || !finite(&start.trans) {
        return Err(SilhouetteRefusal::BadStart { what: "pose, betas or translation are not finite" });
    }
    for camera in &start.cameras {
        let numbers = [
            &camera.focal_px[..],
            &camera.principal_px,
            &camera.distortion,
            camera.rotation.as_flattened(),
            &camera.translation,
        ];
        if !numbers.into_iter().all(finite) || camera.focal_px.iter().any(|&f| f <= 0.0) {
            return Err(SilhouetteRefusal::BadStart { what: "cameras have numbers that no camera has" });
        }
    }
    for (view, mask) in masks.iter().enumerate() {
        match mask.area_px() {
            0 => return Err(SilhouetteRefusal::EmptyMask { view }),
            area if area == mask.inside.len() => return Err(SilhouetteRefusal::FullMask { view }),
            _ => (),
        }
    }
    let cut =
        |(view, mask): (usize, &Mask)| mask.touches_border().then_some(Warning::MaskTouchesBorder { view });
    Ok(masks.iter().enumerate().filter_map(cut).collect())
}

/// The overlap of the start with every mask, or the refusal of the first mask that shows something else.
pub fn agreement(scene: &Scene, state: &State, masks: &[Mask]) -> Result<Vec<f64>, SilhouetteRefusal> {
    let overlaps = scene.iou(&state.vertices());
    let joints = state.joints();
    for (view, (mask, &iou)) in masks.iter().zip(&overlaps).enumerate() {
        let near = dilate(mask, MARGIN);
        let inside =
            |joint: &&_| scene.cameras()[view].project(**joint).is_some_and(|pixel| near.holds(pixel));
        let joints_outside = joints.len() - joints.iter().filter(inside).count();
        // A body that the image cuts off has joints outside of every mask: then the overlap decides alone.
        let cut_off = mask.touches_border();
        if iou < LEAST_IOU || (!cut_off && joints_outside as f64 > JOINTS_OUTSIDE * joints.len() as f64) {
            return Err(SilhouetteRefusal::MaskDisagrees { view, iou, joints_outside, joints: joints.len() });
        }
    }
    Ok(overlaps)
}

/// The keypoints that count, with their points on the body.
pub fn keypoint_pairs(body: &BodyModel, observation: &Observation) -> Vec<KeypointPair> {
    let on_body = observation.keypoint_set.on_body(body);
    let mut pairs = Vec::new();
    for (view, seen) in observation.views.iter().enumerate() {
        for (keypoint, place) in seen.keypoints.iter().zip(&on_body) {
            let Some(place) = place else { continue };
            let weight = place.base_weight * keypoint.confidence;
            if weight > 0.0 && keypoint.pixel_px.iter().all(|x| x.is_finite()) {
                pairs.push(KeypointPair {
                    view,
                    point: place.point.clone(),
                    pixel_px: keypoint.pixel_px,
                    weight,
                });
            }
        }
    }
    pairs
}

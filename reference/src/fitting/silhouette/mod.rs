//! Chapter 3, second half: shape from silhouettes, starting from the body that the joints gave.
//!
//! Every point of a mask's outline is a ray that the body touches. The rays are taken back into the zero pose, vertex by
//! vertex, and the zero-pose body t(β, D) = t̄ + B_S(β) + D is pulled onto them (eq. 3.8), while the offsets D stay smooth
//! (E_L) and small (E_B). Three stages with falling weights and scales (Table 3.1), correspondences anew before each.
//!
//! Our extension, [`PoseRefinement`], fits pose, shape and translation to the outlines first. The thesis keeps the pose of
//! the joint fit, so that offsets have to explain its errors.
//!
//! # Reading order
//! [`options`]: Table 3.1 and what the thesis leaves open. [`rays`]: from outline to ray, and into the zero pose (eq. 3.5–3.7).
//! [`correspondence`]: which ray belongs to which vertex. [`shape_problem`]: the energy; [`regulariser`]: its terms
//! on the offsets; [`shape_jacobian`]: its step.
//! [`unfold`]: what keeps the surface a surface. [`outline_problem`]: the energy of the
//! extension. [`scene`] renders and pairs, [`result`] is what comes back, [`fit_silhouettes`] puts all together.
//!
//! # References
//! Li 2021, ch. 3 §3.3, Algorithm 1 (read with errata E9–E14e); Alldieck, Magnor, Xu, Theobalt, Pons-Moll 2018, "Video Based
//! Reconstruction of 3D People Models".

pub mod correspondence;
mod input;
pub mod options;
pub mod outline_problem;
mod pose_stage;
pub mod rays;
pub mod regulariser;
pub mod result;
pub mod scene;
pub mod shape_jacobian;
pub mod shape_problem;
mod shape_stage;
mod state;
#[cfg(test)]
mod tests;
pub mod unfold;

pub use options::{PoseRefinement, Schedule, ShapeStage, SilhouetteOptions, Terms, Unknowns};
pub use result::{SilhouetteFit, SilhouetteRefusal, SilhouetteStage, StageKind, Warning};

use self::pose_stage::pose_stage;
use self::regulariser::Regulariser;
use self::scene::Scene;
use self::shape_stage::shape_stage;
use self::state::State;
use super::{Extrinsics, Observation, Parameters};
use crate::body::BodyModel;
use crate::linalg::vector::ZERO;
use crate::silhouette::Mask;

/// Fits shape, and if asked pose, to the masks of N views, starting from the joint fit.
///
/// `start` brings θ, β, trans and the N cameras; `masks` one mask for each camera; `keypoints` the observation that the
/// joint fit was made of (same views), which the pose refinement weighs against the outlines; None leaves them out. If its
/// extrinsics are unknown the refinement moves all cameras but the first as well.
///
/// # Errors
/// A [`SilhouetteRefusal`] for masks without an outline, masks that show something else than the start, and starts that
/// are none.
///
/// # Panics
/// If the body is not consistent, or offsets are free and a stage has no positive ω_B.
pub fn fit_silhouettes(
    body: &BodyModel,
    start: &Parameters,
    masks: &[Mask],
    keypoints: Option<&Observation>,
    options: &SilhouetteOptions,
) -> Result<SilhouetteFit, SilhouetteRefusal> {
    let warnings = input::check(body, start, masks, keypoints)?;
    let mut betas = start.betas.clone();
    betas.resize(body.beta_count(), 0.0);
    let mut scene = Scene::new(body, &start.cameras, masks);
    let mut state = State {
        body,
        skeleton: body.skeleton(),
        pose: start.pose.clone(),
        betas,
        trans: start.trans,
        offsets: vec![ZERO; body.vertex_count()],
    };
    let iou_before = input::agreement(&scene, &state, masks)?;

    let mut stages = Vec::new();
    let mut mask_bias_px = 0.0;
    if let Some(refinement) = options.refine_pose.as_ref().filter(|refinement| refinement.rounds > 0) {
        let pairs = keypoints.map(|observation| input::keypoint_pairs(body, observation)).unwrap_or_default();
        // Cameras that the joint fit has found are no better known than the joints.
        let cameras_free = keypoints.is_some_and(|observation| observation.extrinsics == Extrinsics::Unknown);
        let (report, bias) = pose_stage(&mut state, &mut scene, &pairs, cameras_free, refinement);
        stages.push(report);
        mask_bias_px = bias;
    }
    let prior_betas = state.betas.clone();
    let mut regulariser: Option<Regulariser> = None;
    for k in 0..options.stages.len() {
        if options.unknowns == Unknowns::BetasAndOffsets {
            let (shaped, faces) = (state.shaped(), &body.faces);
            regulariser = Some(match &regulariser {
                Some(before) => before.of_moved(&shaped, faces),
                None => Regulariser::of(&shaped, faces),
            });
        }
        stages.push(shape_stage(&mut state, &scene, &prior_betas, regulariser.as_ref(), k, options));
    }

    let vertices = state.vertices();
    Ok(SilhouetteFit {
        joints: state.joints(),
        iou: stages.last().map_or_else(|| iou_before.clone(), |stage| stage.iou.clone()),
        iou_before,
        vertices,
        parameters: Parameters {
            pose: state.pose,
            betas: state.betas,
            trans: state.trans,
            cameras: scene.cameras().to_vec(),
        },
        offsets: state.offsets,
        mask_bias_px,
        stages,
        warnings,
    })
}

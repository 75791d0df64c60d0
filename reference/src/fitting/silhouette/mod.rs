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
pub mod rays;
pub mod regulariser;
pub mod result;
pub mod scene;
pub mod shape_jacobian;
pub mod shape_problem;
pub mod unfold;

pub use options::{PoseRefinement, Schedule, ShapeStage, SilhouetteOptions, Terms, Unknowns};
pub use result::{SilhouetteFit, SilhouetteRefusal, SilhouetteStage, StageKind, Warning};

use self::outline_problem::{KeypointPair, OutlineProblem, Sigmas};
use self::regulariser::Regulariser;
use self::scene::Scene;
use self::shape_problem::{ShapeProblem, Weights};
use self::unfold::{Damping, Surface};
use super::{Observation, Parameters};
use crate::body::BodyModel;
use crate::body::blend_shapes::shape_blend;
use crate::body::posed_body::PosedBody;
use crate::body::skeleton::Skeleton;
use crate::least_squares::{Dogleg, Problem};
use crate::linalg::matrix::Matrix3;
use crate::linalg::vector::{Vector3, ZERO, add};
use crate::silhouette::Mask;

/// Fits shape, and if asked pose, to the masks of N views, starting from the joint fit.
///
/// `start` brings θ, β, trans and the N cameras; `masks` one mask for each camera; `keypoints` the observation that the
/// joint fit was made of (same views), which the pose refinement weighs against the outlines; None leaves them out.
///
/// # Errors
/// A [`SilhouetteRefusal`] for masks without an outline, masks that show something else than the start, and starts that
/// are none.
pub fn fit_silhouettes(
    body: &BodyModel,
    start: &Parameters,
    masks: &[Mask],
    keypoints: Option<&Observation>,
    options: &SilhouetteOptions,
) -> Result<SilhouetteFit, SilhouetteRefusal> {
    let warnings = input::check(body, start, masks)?;
    let mut betas = start.betas.clone();
    betas.resize(body.beta_count(), 0.0);
    let scene = Scene::new(body, &start.cameras, masks);
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
    if let Some(refinement) = &options.refine_pose {
        let pairs = keypoints.map(|observation| input::keypoint_pairs(body, observation)).unwrap_or_default();
        stages.push(refine_pose(&mut state, &scene, &pairs, refinement));
    }
    let prior_betas = state.betas.clone();
    for k in 0..options.stages.len() {
        stages.push(shape_stage(&mut state, &scene, &prior_betas, k, options));
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
            cameras: start.cameras.clone(),
        },
        offsets: state.offsets,
        stages,
        warnings,
    })
}

/// The unknowns.
struct State<'a> {
    body: &'a BodyModel,
    skeleton: Skeleton,
    pose: Vec<f64>,
    betas: Vec<f64>,
    trans: Vector3,
    offsets: Vec<Vector3>,
}

impl State<'_> {
    fn posed<'s>(&'s self, offsets: &'s [Vector3]) -> PosedBody<'s> {
        self.body.at_pose(&self.skeleton, &self.pose, &self.betas, offsets, self.trans)
    }

    fn vertices(&self) -> Vec<Vector3> {
        self.body.pose_with_offsets(&self.pose, &self.betas, &self.offsets, self.trans).vertices
    }

    /// t̄ + B_S(β): the zero pose without offsets.
    fn shaped(&self) -> Vec<Vector3> {
        shape_blend(&self.body.v_template, &self.body.shapedirs, &self.betas)
    }

    fn joints(&self) -> Vec<Vector3> {
        let joints = self.skeleton.posed_joints(&self.pose, &self.betas);
        joints.into_iter().map(|joint| add(joint, self.trans)).collect()
    }

    /// Damps the offsets until they keep the surface.
    fn unfold(&mut self) -> Damping {
        let bare = self.posed(&[]);
        let (posed, linear): (Vec<Vector3>, Vec<Matrix3>) =
            (0..self.offsets.len()).map(|i| (bare.position(i), bare.by_offset(i))).unzip();
        let unposed = self.shaped();
        let surface = Surface { faces: &self.body.faces, unposed: &unposed, posed: &posed, linear: &linear };
        let (offsets, damping) = surface.unfold(&self.offsets);
        self.offsets = offsets;
        damping
    }
}

/// One row of the schedule.
fn shape_stage(
    state: &mut State,
    scene: &Scene,
    prior_betas: &[f64],
    k: usize,
    options: &SilhouetteOptions,
) -> SilhouetteStage {
    let stage = options.stages[k];
    let vertices = state.vertices();
    let seen = scene.see(&vertices);
    let pairs = scene.ray_pairs(&vertices, &seen, options);
    let free = options.unknowns == Unknowns::BetasAndOffsets;
    let regulariser = free.then(|| Regulariser::of(&state.shaped(), scene.faces));
    let weights = Weights {
        laplacian: stage.laplacian_weight,
        model: stage.model_weight,
        shape: options.shape_weight,
        sigma_m: stage.sigma_m,
    };
    let with_pixels = options.terms == Terms::RaysAndPixels;
    let (betas, offsets) = (state.betas.clone(), state.offsets.clone());
    let problem = ShapeProblem::new(
        state.body,
        &state.posed(&offsets),
        scene.cameras,
        &pairs,
        with_pixels,
        &betas,
        prior_betas,
        &offsets,
        regulariser.as_ref(),
        weights,
    );
    let dogleg = Dogleg {
        max_iterations: options.max_iterations,
        improvement_tolerance: options.improvement_tolerance,
        ..Dogleg::default()
    };
    let start = problem.start();
    let solution = dogleg.minimize(&problem, &start);
    let correspondences = problem.pair_count();
    let energy_before = energy(&problem, &start);
    (state.betas, state.offsets) = problem.split(&solution.x);
    let damping = if free { state.unfold() } else { Damping::NONE };
    SilhouetteStage {
        kind: StageKind::Shape(k),
        energy_before,
        energy: solution.energy,
        iterations: solution.iterations,
        evaluations: solution.evaluations,
        termination: solution.termination,
        correspondences,
        iou: scene.iou(&state.vertices()),
        damping,
    }
}

fn energy(problem: &impl Problem, x: &[f64]) -> f64 {
    problem.residuals(x).map_or(f64::INFINITY, |r| r.iter().map(|r| r * r).sum())
}

/// Accepted steps within one round of the pose refinement: the pairs change, so the minimum of a round is worth little.
const STEPS_PER_ROUND: usize = 2;

/// Pose, shape and translation to outlines and keypoints.
fn refine_pose(
    state: &mut State,
    scene: &Scene,
    keypoints: &[KeypointPair],
    options: &PoseRefinement,
) -> SilhouetteStage {
    let prior_pose = state.pose.clone();
    let mut report = SilhouetteStage {
        kind: StageKind::Pose,
        energy_before: f64::INFINITY,
        energy: f64::INFINITY,
        iterations: 0,
        evaluations: 0,
        termination: crate::least_squares::Termination::IterationLimit,
        correspondences: 0,
        iou: Vec::new(),
        damping: Damping::NONE,
    };
    let dogleg = Dogleg { max_iterations: STEPS_PER_ROUND, improvement_tolerance: 1e-4, ..Dogleg::default() };
    for round in 0..options.rounds {
        let progress = round as f64 / (options.rounds - 1).max(1) as f64;
        let reach_px = options.reach_px[0] * (options.reach_px[1] / options.reach_px[0]).powf(progress);
        let seen = scene.see(&state.vertices());
        let pairs = scene.outline_pairs(&seen, reach_px);
        let sigmas = Sigmas {
            contour_px: options.contour_sigma_px,
            robust_px: 0.5 * reach_px,
            keypoint_px: options.keypoint_sigma_px,
            pose_rad: options.pose_sigma_rad,
        };
        let problem = OutlineProblem::new(
            state.body,
            &state.skeleton,
            scene.cameras,
            &state.offsets,
            &pairs,
            keypoints,
            &prior_pose,
            sigmas,
        );
        let start: Vec<f64> =
            [&state.pose, &state.betas, &state.trans.to_vec()].into_iter().flatten().copied().collect();
        let solution = dogleg.minimize(&problem, &start);
        report.energy_before = energy(&problem, &start);
        report.energy = solution.energy;
        report.iterations += solution.iterations;
        report.evaluations += solution.evaluations;
        report.termination = solution.termination;
        report.correspondences = pairs.len();
        let (pose, rest) = solution.x.split_at(state.pose.len());
        let (betas, trans) = rest.split_at(state.betas.len());
        (state.pose, state.betas) = (pose.to_vec(), betas.to_vec());
        state.trans = [trans[0], trans[1], trans[2]];
    }
    report.iou = scene.iou(&state.vertices());
    report
}

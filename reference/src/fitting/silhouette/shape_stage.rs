//! One row of Table 3.1: correspondences, then the dogleg, then the surface.

use super::options::{SilhouetteOptions, Terms};
use super::regulariser::Regulariser;
use super::result::{SilhouetteStage, StageKind};
use super::scene::Scene;
use super::shape_problem::{ShapeProblem, Weights};
use super::state::State;
use super::unfold::Damping;
use crate::least_squares::{Dogleg, Problem};

/// One row of the schedule; with a regulariser (of the body as the stage finds it) offsets are free.
pub fn shape_stage(
    state: &mut State,
    scene: &Scene,
    prior_betas: &[f64],
    regulariser: Option<&Regulariser>,
    k: usize,
    options: &SilhouetteOptions,
) -> SilhouetteStage {
    let stage = options.stages[k];
    let vertices = state.vertices();
    let seen = scene.see(&vertices);
    let pairs = scene.ray_pairs(&vertices, &seen, options);
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
        scene.cameras(),
        &pairs,
        with_pixels,
        &betas,
        prior_betas,
        &offsets,
        regulariser,
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
    let damping = if regulariser.is_some() { state.unfold() } else { Damping::NONE };
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
        reverted: false,
    }
}

/// ‖r(x)‖², infinite where r is undefined.
pub fn energy(problem: &impl Problem, x: &[f64]) -> f64 {
    problem.residuals(x).map_or(f64::INFINITY, |r| r.iter().map(|r| r * r).sum())
}

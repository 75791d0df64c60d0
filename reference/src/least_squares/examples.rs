//! Small problems and a log of trials, for the tests beside.

use super::{Dogleg, Problem, Solution, StepKind};
use crate::linalg::dense::Dense;

/// Residuals and Jacobian as functions.
pub(super) struct Functions<R, J>(pub R, pub J);

impl<R: Fn(&[f64]) -> Option<Vec<f64>>, J: Fn(&[f64]) -> Dense> Problem for Functions<R, J> {
    type Jacobian = Dense;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        self.0(x)
    }

    fn jacobian(&self, x: &[f64]) -> Dense {
        self.1(x)
    }
}

/// What a trial leaves in the log.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub iteration: usize,
    pub kind: StepKind,
    pub step_norm: f64,
    pub gain_ratio: f64,
    pub radius: f64,
    pub accepted: bool,
    pub x: Vec<f64>,
}

pub(super) fn log(dogleg: &Dogleg, problem: &impl Problem, x0: &[f64]) -> (Solution, Vec<Line>) {
    let mut lines = Vec::new();
    let solution = dogleg.minimize_traced(problem, x0, &mut |t| {
        lines.push(Line {
            iteration: t.iteration,
            kind: t.kind,
            step_norm: t.step_norm,
            gain_ratio: t.gain_ratio,
            radius: t.radius,
            accepted: t.accepted,
            x: t.x.to_vec(),
        });
    });
    (solution, lines)
}

pub(super) fn rosenbrock() -> impl Problem<Jacobian = Dense> {
    Functions(
        |x: &[f64]| Some(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]),
        |x: &[f64]| Dense::new(2, 2, vec![-20.0 * x[0], 10.0, -1.0, 0.0]),
    )
}

pub(super) fn arctan() -> impl Problem<Jacobian = Dense> {
    Functions(
        |x: &[f64]| Some(vec![x[0].atan()]),
        |x: &[f64]| Dense::new(1, 1, vec![1.0 / (1.0 + x[0] * x[0])]),
    )
}

/// Goldens have ten decimals or digits.
pub(super) fn close(found: f64, golden: f64) -> bool {
    (found - golden).abs() <= 1e-9 * golden.abs().max(0.1)
}

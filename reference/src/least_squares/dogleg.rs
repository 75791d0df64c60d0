//! Powell's dogleg method.
//!
//! At x there are two candidates for a step. The *Cauchy point* is the minimum of the quadratic model
//! ‖r‖² − 2 g·d + ‖J d‖² along steepest descent g = −Jᵀr:
//!
//! ```text
//! cauchy_point = (‖g‖²/‖J g‖²) g.
//! ```
//!
//! The *Gauss–Newton step*, JᵀJ d = g, is the minimum of the model over all d. The first is always safe and slow, the
//! second fast near the solution and wild elsewhere. Powell's path goes from x to the Cauchy point and from there straight
//! to the Gauss–Newton step: a leg with one bend. The step is where it leaves the ball ‖d‖ ≤ radius in which the model
//! is trusted:
//!
//! ```text
//!           .──────────.
//!        .´      g ↑     `.                        x   where we are
//!      .´          C───────●──────────── N         C   cauchy_point
//!     /            │       ↑\                      N   gauss_newton_step
//!    │             │       step, ‖d‖ = radius      ●   the dogleg step
//!    │             x          │
//! ```
//!
//! Along the path the length grows and the model falls, so this point is unique and the best of the path inside the ball.
//! If the ball ends before C the step is a piece of the first leg ([`StepKind::Cauchy`]), if it holds N the step is N
//! ([`StepKind::GaussNewton`]), else the point between ([`StepKind::Dogleg`]).
//!
//! The step is tried. With predicted_reduction = 2 g·d − ‖J d‖² the model's promise,
//!
//! ```text
//! gain_ratio ρ = (‖r(x)‖² − ‖r(x + d)‖²) / predicted_reduction
//! ```
//!
//! says how well the promise was kept: ρ > 0 accepts the step, ρ > 0.9 lets the radius grow to 2.5 ‖d‖, ρ < 0.05
//! quarters it, anything between leaves it.
//!
//! # Conventions
//! The rules are those of chumpy's `minimize_dogleg`, which SMPLify and its successors use. They differ from Madsen,
//! Nielsen, Tingleff 2004, algorithm 3.21, in this:
//! * the first radius is the length of the first Gauss–Newton step, which is therefore always tried whole;
//! * the radius changes by (2.5, 0.25) at (0.9, 0.05) instead of by (3, ½) at (¾, ¼);
//! * an iteration is an *accepted* step: rejected trials reuse the Jacobian and the Gauss–Newton step and are not counted;
//! * if the energy rises, ρ is not divided by the prediction, because only its sign matters then;
//! * there is a criterion e₃ on the relative fall of the energy, and none on ‖r‖.
//!
//! Lengths are Euclidean in the parameters as they are; where radians, metres and pixels mix, the caller scales.
//!
//! What chumpy leaves to chance is decided here: a trial whose residuals are undefined, NaN or infinite is a rejected one;
//! a Gauss–Newton step that is not finite is replaced by the Cauchy point; a Jacobian that is not finite ends the run at
//! the last good x; with no iteration allowed none is made.
//!
//! # References
//! Powell 1970, "A hybrid method for nonlinear equations". Madsen, Nielsen, Tingleff 2004, "Methods for non-linear least
//! squares problems", 2nd ed., section 3.3. Loper, chumpy, `optimization_internal.py`.

use super::problem::{Jacobian, Problem};
use super::termination::Termination;

/// Powell's dogleg method, as a set of stopping criteria. The default is chumpy's.
#[derive(Clone, Debug, PartialEq)]
pub struct Dogleg {
    /// The most accepted steps; 200.
    pub max_iterations: usize,
    /// The most evaluations of the residuals, the first included; no limit.
    pub max_evaluations: usize,
    /// e₁: stop when ‖Jᵀr‖_∞ is below; 10⁻¹⁵.
    pub gradient_tolerance: f64,
    /// e₂: stop when the step or the radius is at most this fraction of ‖x‖; 10⁻¹⁵.
    pub step_tolerance: f64,
    /// e₃: stop when a step lowers ‖r‖² by less than this fraction; 0, which is never.
    pub improvement_tolerance: f64,
    /// The first radius; `None` for the length of the first Gauss–Newton step.
    pub initial_radius: Option<f64>,
}

impl Default for Dogleg {
    fn default() -> Dogleg {
        Dogleg {
            max_iterations: 200,
            max_evaluations: usize::MAX,
            gradient_tolerance: 1e-15,
            step_tolerance: 1e-15,
            improvement_tolerance: 0.0,
            initial_radius: None,
        }
    }
}

/// Where a minimisation ended, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The best x found.
    pub x: Vec<f64>,
    /// ‖r(x)‖²; NaN if r(x₀) is undefined.
    pub energy: f64,
    /// Iterations begun: Jacobians from which a step was tried, or found too small to be.
    pub iterations: usize,
    /// Evaluations of the residuals.
    pub evaluations: usize,
    /// Why it ended.
    pub termination: Termination,
}

/// Which part of the path a step comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepKind {
    /// The end of the path.
    GaussNewton,
    /// A point of the second leg.
    Dogleg,
    /// A point of the first leg.
    Cauchy,
}

/// One trial step, for those who watch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial<'a> {
    /// The iteration, from 1; all but the last trial of an iteration are rejected.
    pub iteration: usize,
    /// Where on the path.
    pub kind: StepKind,
    /// ‖d‖.
    pub step_norm: f64,
    /// ρ; if the energy rose, the undivided ‖r(x)‖² − ‖r(x + d)‖², and −∞ if r(x + d) is undefined or not finite.
    pub gain_ratio: f64,
    /// The radius after the trial.
    pub radius: f64,
    /// Whether x moved.
    pub accepted: bool,
    /// x + d.
    pub x: &'a [f64],
    /// ‖r(x + d)‖²; NaN if undefined.
    pub energy: f64,
}

impl Dogleg {
    /// Minimises ‖r(x)‖² from x₀.
    ///
    /// # Panics
    /// If the initial radius is not positive.
    pub fn minimize<P: Problem>(&self, problem: &P, x0: &[f64]) -> Solution {
        self.minimize_traced(problem, x0, &mut |_| ())
    }

    /// [`Dogleg::minimize`], showing each trial to `trace`.
    ///
    /// # Panics
    /// If the initial radius is not positive.
    pub fn minimize_traced<P: Problem>(
        &self,
        problem: &P,
        x0: &[f64],
        trace: &mut impl FnMut(&Trial),
    ) -> Solution {
        let first = self.initial_radius.unwrap_or(f64::INFINITY);
        assert!(first > 0.0, "Dogleg: an initial radius of {first}");
        let mut x = x0.to_vec();
        let (mut iterations, mut evaluations) = (0, 1);
        let start = problem.residuals(&x);
        let mut energy = start.as_ref().map_or(f64::NAN, |r| dot(r, r));
        let mut radius = self.initial_radius;
        let termination = 'ended: {
            let Some(mut residuals) = start.filter(|_| energy.is_finite()) else {
                break 'ended Termination::NotFinite;
            };
            loop {
                let jacobian = problem.jacobian(&x);
                let gradient: Vec<f64> = jacobian.apply_transposed(&residuals).iter().map(|g| -g).collect();
                if !all_finite(&gradient) {
                    break 'ended Termination::JacobianNotFinite;
                }
                if gradient.iter().all(|g| g.abs() < self.gradient_tolerance) {
                    break 'ended Termination::SmallGradient;
                }
                if radius.is_some_and(|radius| radius <= self.step_tolerance * norm(&x)) {
                    break 'ended Termination::SmallRadius;
                }
                if iterations >= self.max_iterations {
                    break 'ended Termination::IterationLimit;
                }
                if evaluations >= self.max_evaluations {
                    break 'ended Termination::EvaluationLimit;
                }
                let Some(mut path) = Path::new(&jacobian, &gradient) else {
                    break 'ended Termination::JacobianNotFinite;
                };
                iterations += 1;
                loop {
                    let (step, kind) = path.leave_region(radius);
                    let step_norm = norm(&step);
                    if step_norm <= self.step_tolerance * norm(&x) {
                        break 'ended Termination::SmallStep;
                    }
                    let trial_x: Vec<f64> = x.iter().zip(&step).map(|(x, d)| x + d).collect();
                    let trial_residuals = problem.residuals(&trial_x);
                    evaluations += 1;
                    let trial_energy = trial_residuals.as_ref().map_or(f64::NAN, |r| dot(r, r));
                    let gain_ratio = gain_ratio(energy - trial_energy, || path.predicted_reduction(&step));
                    let accepted = gain_ratio > 0.0;

                    // Before the first trial the region is all of space; that trial is the whole Gauss–Newton step.
                    let mut after = radius.unwrap_or(step_norm);
                    if gain_ratio > 0.9 {
                        after = after.max(2.5 * step_norm);
                    } else if gain_ratio < 0.05 {
                        after *= 0.25;
                    }
                    radius = Some(after);
                    trace(&Trial {
                        iteration: iterations,
                        kind,
                        step_norm,
                        gain_ratio,
                        radius: after,
                        accepted,
                        x: &trial_x,
                        energy: trial_energy,
                    });

                    if let Some(trial_residuals) = trial_residuals.filter(|_| accepted) {
                        let improvement = (energy - trial_energy) / energy;
                        (x, residuals, energy) = (trial_x, trial_residuals, trial_energy);
                        if improvement < self.improvement_tolerance {
                            break 'ended Termination::SmallImprovement;
                        }
                        break;
                    }
                    if after <= self.step_tolerance * norm(&x) {
                        break 'ended Termination::SmallRadius;
                    }
                    if evaluations >= self.max_evaluations {
                        break 'ended Termination::EvaluationLimit;
                    }
                }
            }
        };
        Solution { x, energy, iterations, evaluations, termination }
    }
}

/// ρ of a trial. An `actual` reduction that is not a number ranks below every other.
fn gain_ratio(actual: f64, predicted: impl FnOnce() -> f64) -> f64 {
    let ratio = if actual > 0.0 { actual / predicted() } else { actual };
    if ratio.is_nan() { f64::NEG_INFINITY } else { ratio }
}

/// Powell's path at one x: 0 → `cauchy_point` → `gauss_newton_step`.
struct Path<'a, J> {
    jacobian: &'a J,
    /// g = −Jᵀ r.
    gradient: &'a [f64],
    cauchy_point: Vec<f64>,
    /// Solved for when the path is first followed beyond the Cauchy point.
    gauss_newton_step: Option<Vec<f64>>,
}

impl<'a, J: Jacobian> Path<'a, J> {
    /// The path of a gradient; `None` if its Cauchy point is not finite.
    fn new(jacobian: &'a J, gradient: &'a [f64]) -> Option<Path<'a, J>> {
        let slope = jacobian.apply(gradient);
        let g_squared = dot(gradient, gradient);
        // Only e₁ = 0 lets a vanishing gradient come here.
        let stretch = if g_squared == 0.0 { 0.0 } else { g_squared / dot(&slope, &slope) };
        let cauchy_point: Vec<f64> = gradient.iter().map(|g| stretch * g).collect();
        let path = Path { jacobian, gradient, cauchy_point, gauss_newton_step: None };
        all_finite(&path.cauchy_point).then_some(path)
    }

    /// The point where the path leaves the ball of this radius, or its end; `None` is the ball that holds everything.
    fn leave_region(&mut self, radius: Option<f64>) -> (Vec<f64>, StepKind) {
        let c = &self.cauchy_point;
        let c_norm = norm(c);
        if let Some(radius) = radius.filter(|radius| c_norm >= *radius) {
            return (c.iter().map(|c| radius / c_norm * c).collect(), StepKind::Cauchy);
        }
        let n = self.gauss_newton_step.get_or_insert_with(|| {
            let step = self.jacobian.gauss_newton_step(self.gradient);
            if all_finite(&step) { step } else { c.clone() }
        });
        let Some(radius) = radius.filter(|radius| norm(n) > *radius) else {
            return (n.clone(), StepKind::GaussNewton);
        };
        // ‖c + b (n − c)‖ = radius, 0 < b < 1. Of the two forms of the root this one adds positive numbers: the angle
        // between the legs is never acute.
        let leg: Vec<f64> = n.iter().zip(c).map(|(n, c)| n - c).collect();
        let rest = radius * radius - c_norm * c_norm;
        let along = dot(&leg, c);
        let b = rest / (along + (along * along + dot(&leg, &leg) * rest).sqrt());
        (c.iter().zip(&leg).map(|(c, leg)| c + b * leg).collect(), StepKind::Dogleg)
    }

    /// ‖r‖² − ‖r + J d‖² = 2 g·d − ‖J d‖².
    fn predicted_reduction(&self, d: &[f64]) -> f64 {
        let slope = self.jacobian.apply(d);
        2.0 * dot(self.gradient, d) - dot(&slope, &slope)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

fn all_finite(a: &[f64]) -> bool {
    a.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::super::examples::{Functions, arctan, close, log, rosenbrock};
    use super::*;
    use crate::linalg::dense::Dense;

    #[test]
    fn start_without_finite_residuals_is_returned() {
        for start in [None, Some(vec![f64::NAN]), Some(vec![f64::INFINITY]), Some(vec![1e200])] {
            let problem =
                Functions(move |_: &[f64]| start.clone(), |_: &[f64]| unreachable!("no derivative there"));
            let solution = Dogleg::default().minimize(&problem, &[7.0]);
            assert_eq!(solution.termination, Termination::NotFinite);
            assert_eq!((solution.x, solution.iterations, solution.evaluations), (vec![7.0], 0, 1));
            assert!(!solution.energy.is_finite());
        }
    }

    #[test]
    fn undefined_and_nan_trials_shrink_the_radius() {
        // √x − 3 ends at 0. From 100 the Gauss–Newton step leads to −40, where it is undefined or NaN, and the second, a
        // quarter as long, to 65.
        let nan = |x: &[f64]| Some(vec![x[0].sqrt() - 3.0]);
        let undefined = |x: &[f64]| (x[0] >= 0.0).then(|| vec![x[0].sqrt() - 3.0]);
        let jacobian = |x: &[f64]| Dense::new(1, 1, vec![0.5 / x[0].sqrt()]);
        let (a, with_nan) = log(&Dogleg::default(), &Functions(nan, jacobian), &[100.0]);
        let (b, with_none) = log(&Dogleg::default(), &Functions(undefined, jacobian), &[100.0]);
        assert_eq!(a, b);
        assert!(a.termination.was_successful() && (a.x[0] - 9.0).abs() < 1e-13, "{a:?}");
        for lines in [with_nan, with_none] {
            assert!(!lines[0].accepted && lines[0].gain_ratio == f64::NEG_INFINITY, "{:?}", lines[0]);
            assert!(close(lines[0].step_norm, 140.0) && close(lines[0].radius, 35.0), "{:?}", lines[0]);
            assert!(lines[1].accepted && close(lines[1].x[0], 65.0), "{:?}", lines[1]);
        }
    }

    #[test]
    fn walled_in_point_ends_with_a_small_radius() {
        let problem =
            Functions(|x: &[f64]| (x[0] >= 1.0).then(|| x.to_vec()), |_: &[f64]| Dense::new(1, 1, vec![1.0]));
        let solution = Dogleg::default().minimize(&problem, &[1.0]);
        assert_eq!((solution.termination, solution.x), (Termination::SmallRadius, vec![1.0]));
    }

    #[test]
    fn jacobian_that_turns_out_not_finite_ends_at_the_last_good_point() {
        for number in [f64::NAN, f64::INFINITY] {
            let problem = Functions(
                |x: &[f64]| Some(vec![x[0] * x[0] - 1.0]),
                move |x: &[f64]| Dense::new(1, 1, vec![if x[0] < 2.0 { number } else { 2.0 * x[0] }]),
            );
            let solution = Dogleg::default().minimize(&problem, &[3.0]);
            assert_eq!(solution.termination, Termination::JacobianNotFinite);
            // Newton: 3 − 8/6.
            assert!(
                close(solution.x[0], 5.0 / 3.0) && close(solution.energy, (16.0 / 9.0f64).powi(2)),
                "{solution:?}"
            );
        }
    }

    #[test]
    fn wrong_jacobian_ends_without_moving() {
        let problem = Functions(|x: &[f64]| Some(x.to_vec()), |_: &[f64]| Dense::new(1, 1, vec![-1.0]));
        let solution = Dogleg::default().minimize(&problem, &[2.0]);
        assert_eq!((solution.termination, solution.x), (Termination::SmallRadius, vec![2.0]));
    }

    #[test]
    fn gauss_newton_step_that_is_not_finite_gives_way_to_the_cauchy_point() {
        struct Unsolvable(Dense);
        impl Jacobian for Unsolvable {
            fn apply(&self, d: &[f64]) -> Vec<f64> {
                self.0.apply(d)
            }
            fn apply_transposed(&self, r: &[f64]) -> Vec<f64> {
                self.0.apply_transposed(r)
            }
            fn gauss_newton_step(&self, gradient: &[f64]) -> Vec<f64> {
                vec![f64::NAN; gradient.len()]
            }
        }
        struct Line;
        impl Problem for Line {
            type Jacobian = Unsolvable;
            fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
                Some(vec![x[0] - 1.0, 2.0 * (x[1] + 3.0)])
            }
            fn jacobian(&self, _: &[f64]) -> Unsolvable {
                Unsolvable(Dense::new(2, 2, vec![1.0, 0.0, 0.0, 2.0]))
            }
        }
        let solution = Dogleg::default().minimize(&Line, &[5.0, 5.0]);
        assert!((solution.x[0] - 1.0).abs() < 1e-12 && (solution.x[1] + 3.0).abs() < 1e-12, "{solution:?}");
    }

    #[test]
    fn every_criterion_ends_by_its_name() {
        let start = [-1.2, 1.0];
        let ending = |dogleg: Dogleg| {
            let solution = dogleg.minimize(&rosenbrock(), &start);
            (solution.termination, solution.iterations, solution.evaluations)
        };
        let default = Dogleg::default;
        assert_eq!(ending(Dogleg { max_iterations: 0, ..default() }), (Termination::IterationLimit, 0, 1));
        assert_eq!(ending(Dogleg { max_iterations: 3, ..default() }), (Termination::IterationLimit, 3, 7));
        assert_eq!(ending(Dogleg { max_evaluations: 1, ..default() }), (Termination::EvaluationLimit, 0, 1));
        assert_eq!(ending(Dogleg { max_evaluations: 4, ..default() }), (Termination::EvaluationLimit, 2, 4));
        assert_eq!(
            ending(Dogleg { gradient_tolerance: 1e6, ..default() }),
            (Termination::SmallGradient, 0, 1)
        );
        assert_eq!(ending(Dogleg { step_tolerance: 10.0, ..default() }), (Termination::SmallStep, 1, 1));
        assert_eq!(
            ending(Dogleg { initial_radius: Some(1e-20), ..default() }),
            (Termination::SmallRadius, 0, 1)
        );
        let impatient = Dogleg { improvement_tolerance: 0.999, ..default() };
        assert_eq!(ending(impatient), (Termination::SmallImprovement, 1, 3));
        // Without e₁ a vanishing gradient ends as a step of length 0.
        let stubborn = Dogleg { gradient_tolerance: 0.0, ..default() };
        assert_eq!(stubborn.minimize(&rosenbrock(), &[1.0, 1.0]).termination, Termination::SmallStep);
    }

    #[test]
    fn first_radius_limits_the_first_step() {
        let dogleg = Dogleg { initial_radius: Some(0.125), ..Dogleg::default() };
        let (_, lines) = log(&dogleg, &rosenbrock(), &[-1.2, 1.0]);
        assert!(lines[0].kind == StepKind::Cauchy && close(lines[0].step_norm, 0.125), "{:?}", lines[0]);
    }

    #[test]
    #[should_panic(expected = "an initial radius of NaN")]
    fn radius_must_be_a_length() {
        Dogleg { initial_radius: Some(f64::NAN), ..Dogleg::default() }.minimize(&arctan(), &[1.0]);
    }
}

//! Nonlinear least squares: the x that minimises ‖r(x)‖².
//!
//! Every fit of this crate is written as a vector of residuals r and its Jacobian J = ∂r/∂x ([`Problem`]). Near x,
//! r(x + d) ≈ r + J d, so the energy is nearly the quadratic
//!
//! ```text
//! ‖r + J d‖² = ‖r‖² − 2 g·d + ‖J d‖²,      g = −Jᵀ r,
//! ```
//!
//! whose minimum solves the normal equations JᵀJ d = g. How far that picture can be trusted is what a method must find
//! out, and [`Dogleg`] keeps it as one number, the radius of the region of trust.
//!
//! | module | what |
//! |---|---|
//! | [`problem`] | what the caller gives: residuals and a Jacobian |
//! | [`dogleg`] | Powell's method, with the rules of chumpy |
//! | [`termination`] | every way in which it ends |
//! | [`sparse_jacobian`] | Gauss–Newton steps where J is mostly zeros |
//! | [`finite_difference`] | is the Jacobian the derivative of the residuals? |
//! | [`adam`] | first-order descent, for energies that are no sum of squares |
//!
//! ```
//! use vitruvian_reference::{least_squares::{Dogleg, Problem}, linalg::dense::Dense};
//!
//! /// Rosenbrock's valley: r = (10(y − x²), 1 − x).
//! struct Rosenbrock;
//!
//! impl Problem for Rosenbrock {
//!     type Jacobian = Dense;
//!     fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
//!         Some(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]])
//!     }
//!     fn jacobian(&self, x: &[f64]) -> Dense {
//!         Dense::new(2, 2, vec![-20.0 * x[0], 10.0, -1.0, 0.0])
//!     }
//! }
//!
//! let solution = Dogleg::default().minimize(&Rosenbrock, &[-1.2, 1.0]);
//! assert!(solution.termination.was_successful());
//! assert!((solution.x[0] - 1.0).abs() < 1e-12 && (solution.x[1] - 1.0).abs() < 1e-12);
//! ```

pub mod adam;
pub mod dogleg;
#[cfg(test)]
mod examples;
pub mod finite_difference;
#[cfg(test)]
mod goldens;
pub mod problem;
pub mod sparse_jacobian;
pub mod termination;

pub use dogleg::{Dogleg, Solution, StepKind, Trial};
pub use problem::{Jacobian, Problem};
pub use sparse_jacobian::{NormalEquations, SparseJacobian};
pub use termination::Termination;

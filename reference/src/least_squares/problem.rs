//! What the caller of a least-squares method gives.

use crate::linalg::cholesky::Cholesky;
use crate::linalg::complete_orthogonal::CompleteOrthogonal;
use crate::linalg::dense::Dense;

/// A least-squares problem min ‖r(x)‖², r: ℝⁿ → ℝᵐ.
pub trait Problem {
    /// J = ∂r/∂x, dense or sparse.
    type Jacobian: Jacobian;

    /// r(x), m numbers; `None` where r is undefined, such as when a point comes to lie behind a camera.
    ///
    /// A method never steps to such an x; it tries a shorter step instead.
    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>>;

    /// J(x), m×n. Only asked for at points where r is defined and finite.
    fn jacobian(&self, x: &[f64]) -> Self::Jacobian;
}

/// The derivative of the residuals, as a linear map.
pub trait Jacobian {
    /// J d, m numbers.
    fn apply(&self, d: &[f64]) -> Vec<f64>;

    /// Jᵀ r, n numbers.
    fn apply_transposed(&self, r: &[f64]) -> Vec<f64>;

    /// The Gauss–Newton step: d with JᵀJ d = g, for a g in the range of Jᵀ.
    ///
    /// Where JᵀJ is singular there are many; the shortest is the one to return, because along the others the residuals
    /// have said nothing.
    fn gauss_newton_step(&self, gradient: &[f64]) -> Vec<f64>;
}

impl Jacobian for Dense {
    fn apply(&self, d: &[f64]) -> Vec<f64> {
        Dense::apply(self, d)
    }

    fn apply_transposed(&self, r: &[f64]) -> Vec<f64> {
        Dense::apply_transposed(self, r)
    }

    /// By Cholesky's factorisation of JᵀJ; where that is not positive definite in f64, by the complete orthogonal
    /// decomposition of J, which sees twice as many digits.
    fn gauss_newton_step(&self, gradient: &[f64]) -> Vec<f64> {
        match Cholesky::factor(&self.gram()) {
            Some(cholesky) => cholesky.solve(gradient),
            None => CompleteOrthogonal::factor(self).solve_normal_equations(gradient),
        }
    }
}

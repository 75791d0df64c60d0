//! Derivatives by differences: is the Jacobian the derivative of the residuals?
//!
//! ∂r/∂x_j ≈ (r(x + h e_j) − r(x − h e_j)) / 2h errs by h² r‴/6 from truncation and by ε |r|/h from rounding. With
//! h = ∛ε max(1, |x_j|) ≈ 6·10⁻⁶ both are near 10⁻¹¹ where r and its third derivative are near 1: a wrong sign, index or
//! factor stands out by ten orders of magnitude.

use super::problem::{Jacobian, Problem};
use crate::linalg::dense::Dense;
use std::fmt;

/// The m×n matrix of central differences; `None` if r is undefined at a point used.
///
/// # Panics
/// If r changes its length.
pub fn central_differences(problem: &impl Problem, x: &[f64]) -> Option<Dense> {
    let columns: Vec<Vec<f64>> =
        (0..x.len()).map(|j| central_difference(problem, x, j)).collect::<Option<Vec<_>>>()?;
    let m = match columns.first() {
        Some(column) => column.len(),
        None => problem.residuals(x)?.len(),
    };
    let mut matrix = Dense::zeros(m, x.len());
    for (j, column) in columns.iter().enumerate() {
        for (i, d) in column.iter().enumerate() {
            matrix[(i, j)] = *d;
        }
    }
    Some(matrix)
}

/// Column j: ∂r/∂x_j.
fn central_difference(problem: &impl Problem, x: &[f64], j: usize) -> Option<Vec<f64>> {
    let h = f64::EPSILON.cbrt() * x[j].abs().max(1.0);
    let mut y = x.to_vec();
    y[j] = x[j] + h;
    let (after, r_after) = (y[j], problem.residuals(&y)?);
    y[j] = x[j] - h;
    let (before, r_before) = (y[j], problem.residuals(&y)?);
    assert!(
        r_after.len() == r_before.len(),
        "central_differences: {} residuals beside x, {} on its other side",
        r_after.len(),
        r_before.len()
    );
    // The distance as rounded, not 2h.
    Some(r_after.iter().zip(&r_before).map(|(a, b)| (a - b) / (after - before)).collect())
}

/// The entry at which a Jacobian is farthest from the differences.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorstDifference {
    /// The residual.
    pub row: usize,
    /// The unknown.
    pub column: usize,
    /// What the Jacobian says.
    pub analytic: f64,
    /// What the differences say.
    pub numeric: f64,
    /// |analytic − numeric| / max(1, |analytic|, |r_row|): in units of what rounding can explain, times ∛ε⁻².
    pub relative: f64,
}

impl fmt::Display for WorstDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let WorstDifference { row, column, analytic, numeric, relative } = self;
        write!(
            f,
            "∂r[{row}]/∂x[{column}] is {analytic:e}, by differences {numeric:e}, relative difference {relative:e}"
        )
    }
}

/// Compares J(x), column by column as `apply` gives it, with central differences.
///
/// `None` if r is undefined at x or beside it, or if there are no entries. A NaN on either side is the worst difference.
///
/// # Panics
/// If J has not as many rows as there are residuals.
pub fn worst_difference(problem: &impl Problem, x: &[f64]) -> Option<WorstDifference> {
    let residuals = problem.residuals(x)?;
    let jacobian = problem.jacobian(x);
    let mut worst: Option<WorstDifference> = None;
    for column in 0..x.len() {
        let mut unit = vec![0.0; x.len()];
        unit[column] = 1.0;
        let analytic = jacobian.apply(&unit);
        let numeric = central_difference(problem, x, column)?;
        assert!(
            analytic.len() == numeric.len() && numeric.len() == residuals.len(),
            "worst_difference: the Jacobian has {} rows, there are {} residuals",
            analytic.len(),
            residuals.len()
        );
        for (row, (analytic, numeric)) in analytic.into_iter().zip(numeric).enumerate() {
            let scale = analytic.abs().max(residuals[row].abs()).max(1.0);
            let relative = (analytic - numeric).abs() / scale;
            let relative = if relative.is_nan() { f64::INFINITY } else { relative };
            if worst.is_none_or(|worst| relative > worst.relative) {
                worst = Some(WorstDifference { row, column, analytic, numeric, relative });
            }
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    /// r = (x y, sin x, a x³ where x > −1), with a mistake of the caller's choice in ∂r₂/∂x.
    struct Example {
        mistake: f64,
    }

    impl Problem for Example {
        type Jacobian = Dense;

        fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
            (x[0] > -1.0).then(|| vec![x[0] * x[1], x[0].sin(), 2.0 * x[0].powi(3)])
        }

        fn jacobian(&self, x: &[f64]) -> Dense {
            Dense::new(3, 2, vec![x[1], x[0], x[0].cos(), 0.0, 6.0 * x[0] * x[0] + self.mistake, 0.0])
        }
    }

    #[test]
    fn right_jacobian_agrees() {
        let problem = Example { mistake: 0.0 };
        let x = [0.7, -3.0];
        let worst = worst_difference(&problem, &x).expect("defined");
        assert!(worst.relative < 1e-10, "{worst}");
        let (numeric, analytic) = (central_differences(&problem, &x).expect("defined"), problem.jacobian(&x));
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
            assert!((numeric[(i, j)] - analytic[(i, j)]).abs() < 1e-9, "({i}, {j})");
        }
    }

    #[test]
    fn mistake_is_found_where_it_is() {
        for mistake in [1e-6, -3.0, f64::NAN] {
            let worst = worst_difference(&Example { mistake }, &[0.7, -3.0]).expect("defined");
            assert!((worst.row, worst.column) == (2, 0) && worst.relative > 1e-7, "{worst}");
        }
    }

    #[test]
    fn undefined_neighbours_have_no_differences() {
        assert_eq!(worst_difference(&Example { mistake: 0.0 }, &[-1.0 + 1e-6, 0.0]), None);
        assert_eq!(central_differences(&Example { mistake: 0.0 }, &[-2.0, 0.0]), None);
    }
}

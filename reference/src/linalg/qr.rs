//! Least squares by Householder's QR factorisation.

use super::dense::Dense;

/// The x that minimises ‖A x − b‖₂, or `None` if the columns of A are linearly dependent as far as f64 can tell.
///
/// A = Q R by Householder reflections H = I − 2 v vᵀ/‖v‖², with v = a + sign(a₁)‖a‖ e₁ so that nothing cancels; then
/// R x = (Qᵀ b)₁…ₙ. The condition number of A enters once, where the normal equations square it. A is m×n, m ≥ n; a
/// square A makes this a linear solver.
///
/// # Panics
/// If b does not have m numbers, or m < n.
///
/// # References
/// Golub, Van Loan, "Matrix Computations", the section on Householder QR and least squares.
pub fn least_squares(a: &Dense, b: &[f64]) -> Option<Vec<f64>> {
    let (m, n) = (a.rows(), a.columns());
    assert!(b.len() == m, "least_squares: b has {} numbers, A is {m}×{n}", b.len());
    assert!(m >= n, "least_squares: A is {m}×{n}, fewer equations than unknowns");
    let mut r = a.clone();
    let mut rhs = b.to_vec();
    // What rounding can leave of a column that depends on those before it.
    let largest = (0..n).map(|c| column_norm(a, c, 0)).fold(0.0, f64::max);
    let noise = largest * f64::EPSILON * m as f64;
    for c in 0..n {
        let length = column_norm(&r, c, c);
        if length.is_nan() || length <= noise {
            return None;
        }
        let alpha = if r[(c, c)] > 0.0 { -length } else { length };
        let mut v: Vec<f64> = (c..m).map(|i| r[(i, c)]).collect();
        v[0] -= alpha;
        let v_squared: f64 = v.iter().map(|x| x * x).sum();
        for k in c..n {
            let along: f64 = (c..m).map(|i| v[i - c] * r[(i, k)]).sum();
            for i in c..m {
                r[(i, k)] -= 2.0 * along / v_squared * v[i - c];
            }
        }
        let along: f64 = (c..m).map(|i| v[i - c] * rhs[i]).sum();
        for i in c..m {
            rhs[i] -= 2.0 * along / v_squared * v[i - c];
        }
    }
    let mut x = vec![0.0; n];
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| r[(i, k)] * x[k]).sum();
        x[i] = (rhs[i] - sum) / r[(i, i)];
    }
    Some(x)
}

/// The norm of column `c` from row `from` on.
fn column_norm(a: &Dense, c: usize, from: usize) -> f64 {
    (from..a.rows()).map(|i| a[(i, c)] * a[(i, c)]).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_through_three_points_by_hand() {
        // (0, 6), (1, 0), (2, 0): the normal equations [[3, 3], [3, 5]] x = [6, 0] give y = 5 − 3 x.
        let a = Dense::new(3, 2, vec![1.0, 0.0, 1.0, 1.0, 1.0, 2.0]);
        let x = least_squares(&a, &[6.0, 0.0, 0.0]).expect("two independent columns");
        assert!((x[0] - 5.0).abs() < 1e-14 && (x[1] + 3.0).abs() < 1e-14, "{x:?}");
    }

    #[test]
    fn residual_is_orthogonal_to_the_columns() {
        let a = Dense::new(4, 3, vec![1.0, 2.0, 0.5, -3.0, 1.0, 1.0, 0.0, 4.0, -2.0, 2.0, 2.0, 5.0]);
        let b = [1.0, -2.0, 3.0, 0.25];
        let x = least_squares(&a, &b).expect("three independent columns");
        let residual: Vec<f64> = a.apply(&x).iter().zip(b).map(|(ax, b)| ax - b).collect();
        for g in a.apply_transposed(&residual) {
            assert!(g.abs() < 1e-14, "{g}");
        }
    }

    #[test]
    fn ill_conditioned_columns_keep_their_digits() {
        // Läuchli's matrix: the normal equations lose δ² = 10⁻¹⁶ entirely, the reflections do not.
        let delta = 1e-8;
        let a = Dense::new(3, 2, vec![1.0, 1.0, delta, 0.0, 0.0, delta]);
        let x = least_squares(&a, &[2.0, delta, delta]).expect("independent");
        assert!((x[0] - 1.0).abs() < 1e-7 && (x[1] - 1.0).abs() < 1e-7, "{x:?}");
        assert!(crate::linalg::cholesky::Cholesky::factor(&a.gram()).is_none());
    }

    #[test]
    fn dependent_columns_have_no_solution() {
        let a = Dense::new(3, 2, vec![1.0, 2.0, 2.0, 4.0, 3.0, 6.0]);
        assert_eq!(least_squares(&a, &[1.0, 0.0, 0.0]), None);
    }
}

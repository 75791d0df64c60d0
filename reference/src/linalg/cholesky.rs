//! The Cholesky factorisation A = L Lᵀ.

use super::dense::Dense;

/// The lower-triangular L with A = L Lᵀ.
#[derive(Clone, Debug, PartialEq)]
pub struct Cholesky {
    factor: Dense,
}

impl Cholesky {
    /// Factors a symmetric n×n matrix; `None` unless it is positive definite in f64. Only the lower triangle is read.
    ///
    /// l_jj = √(a_jj − Σ_k l_jk²), l_ij = (a_ij − Σ_k l_ik l_jk)/l_jj. A pivot below n·ε·a_jj is rounding noise: the matrix is
    /// then singular as far as f64 can tell, and the caller should damp it or turn to [`super::qr`].
    ///
    /// # Panics
    /// If A is not square.
    pub fn factor(a: &Dense) -> Option<Cholesky> {
        let n = a.rows();
        assert!(a.columns() == n, "Cholesky::factor: A is {n}×{}", a.columns());
        let mut factor = Dense::zeros(n, n);
        for j in 0..n {
            for i in j..n {
                let sum: f64 = (0..j).map(|k| factor[(i, k)] * factor[(j, k)]).sum();
                let rest = a[(i, j)] - sum;
                if i > j {
                    factor[(i, j)] = rest / factor[(j, j)];
                } else if rest > n as f64 * f64::EPSILON * a[(j, j)] {
                    factor[(j, j)] = rest.sqrt();
                } else {
                    // Also NaN, which compares false.
                    return None;
                }
            }
        }
        Some(Cholesky { factor })
    }

    /// The solution x of A x = b, by L y = b and Lᵀ x = y.
    ///
    /// # Panics
    /// If b does not have n numbers.
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let n = self.factor.rows();
        assert!(b.len() == n, "Cholesky::solve: b has {} numbers, A is {n}×{n}", b.len());
        let mut x = b.to_vec();
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.factor[(i, k)] * x[k]).sum();
            x[i] = (x[i] - sum) / self.factor[(i, i)];
        }
        for i in (0..n).rev() {
            let sum: f64 = (i + 1..n).map(|k| self.factor[(k, i)] * x[k]).sum();
            x[i] = (x[i] - sum) / self.factor[(i, i)];
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_and_solution_by_hand() {
        // L = [[2, 0, 0], [6, 1, 0], [−8, 5, 3]].
        let a = Dense::new(3, 3, vec![4.0, 12.0, -16.0, 12.0, 37.0, -43.0, -16.0, -43.0, 98.0]);
        let cholesky = Cholesky::factor(&a).expect("positive definite");
        assert_eq!(cholesky.factor, Dense::new(3, 3, vec![2.0, 0.0, 0.0, 6.0, 1.0, 0.0, -8.0, 5.0, 3.0]));
        assert_eq!(cholesky.solve(&a.apply(&[1.0, -2.0, 3.0])), [1.0, -2.0, 3.0]);
    }

    #[test]
    fn singular_indefinite_and_nan_have_no_factor() {
        for data in [vec![1.0, 1.0, 1.0, 1.0], vec![1.0, 2.0, 2.0, 1.0], vec![f64::NAN, 0.0, 0.0, 1.0]] {
            assert_eq!(Cholesky::factor(&Dense::new(2, 2, data)), None);
        }
    }
}

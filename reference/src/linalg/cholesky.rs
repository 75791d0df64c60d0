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
        let mut factor = a.clone();
        let mut column = vec![0.0; n];
        for j in 0..n {
            // The sum over k < j is already subtracted.
            let pivot = factor[(j, j)];
            if pivot.is_nan() || pivot <= n as f64 * f64::EPSILON * a[(j, j)] {
                return None;
            }
            let root = pivot.sqrt();
            factor.row_mut(j)[j] = root;
            factor.row_mut(j)[j + 1..].fill(0.0);
            for i in j + 1..n {
                column[i] = factor[(i, j)] / root;
                factor[(i, j)] = column[i];
            }
            // Subtract the products of column j at once, along rows: contiguous, and independent of each other.
            for i in j + 1..n {
                let l_ij = column[i];
                if l_ij != 0.0 {
                    for (rest, l_kj) in factor.row_mut(i)[j + 1..=i].iter_mut().zip(&column[j + 1..=i]) {
                        *rest -= l_ij * l_kj;
                    }
                }
            }
        }
        Some(Cholesky { factor })
    }

    /// L, n×n; zero above the diagonal.
    pub fn lower(&self) -> &Dense {
        &self.factor
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
            let row = self.factor.row(i);
            let sum: f64 = row[..i].iter().zip(&x).map(|(l, x)| l * x).sum();
            x[i] = (x[i] - sum) / row[i];
        }
        for i in (0..n).rev() {
            let row = self.factor.row(i);
            x[i] /= row[i];
            let x_i = x[i];
            for (x, l) in x[..i].iter_mut().zip(row) {
                *x -= l * x_i;
            }
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

//! The complete orthogonal decomposition: least squares for matrices of any rank.
//!
//! Householder reflections with column pivoting bring A to Q [T; 0], where the k rows of T span the rows of A, and k is
//! the rank. Reflections from the other side bring T to [Uᵀ 0] Zᵀ with U upper triangular. In between, Q, which drops out
//! of the normal equations, is forgotten:
//!
//! ```text
//! AᵀA = TᵀT = Z [U Uᵀ  0] Zᵀ.
//!               [ 0    0]
//! ```
//!
//! The last n − k columns of Z are the directions that A does not see; a solution without a share in them is the shortest.

use super::dense::Dense;

/// A matrix as far as AᵀA is concerned, split into what it sees and what it does not.
#[derive(Clone, Debug, PartialEq)]
pub struct CompleteOrthogonal {
    /// The Householder vectors of Z, n numbers each, of length √2 so that H = I − v vᵀ.
    reflections: Vec<Vec<f64>>,
    /// Column j of U, k numbers of which the first j + 1 count.
    upper: Vec<Vec<f64>>,
}

impl CompleteOrthogonal {
    /// Decomposes an m×n matrix, of any shape.
    ///
    /// The rank is judged after the columns are scaled to length 1, so that it does not depend on the units of the
    /// unknowns: what is left of a column once its share in the others is taken away counts as zero below 8 max(m, n) ε, a
    /// few roundings of each element. The shortest solution is meant in the units given.
    pub fn factor(a: &Dense) -> CompleteOrthogonal {
        let (m, n) = (a.rows(), a.columns());
        let mut columns: Vec<Vec<f64>> = (0..n).map(|c| (0..m).map(|r| a[(r, c)]).collect()).collect();
        let scales: Vec<f64> = columns.iter().map(|column| norm(column)).collect();
        for (column, &scale) in columns.iter_mut().zip(&scales) {
            if scale > 0.0 {
                column.iter_mut().for_each(|a| *a /= scale);
            }
        }
        let mut order: Vec<usize> = (0..n).collect();
        let noise = 8.0 * m.max(n) as f64 * f64::EPSILON;
        let mut rank = 0;
        while rank < m.min(n) {
            let rest = |c: usize| norm(&columns[c][rank..]);
            let pivot = (rank..n).max_by(|&b, &c| rest(b).total_cmp(&rest(c))).expect("rank < n");
            if rest(pivot) <= noise {
                break;
            }
            columns.swap(rank, pivot);
            order.swap(rank, pivot);
            let v = reflection(&mut columns[rank], rank);
            for column in &mut columns[rank + 1..] {
                reflect(&v, column);
            }
            rank += 1;
        }
        // The rows of T, in the order and the units of the unknowns, are the columns to triangulate now.
        let mut rows = vec![vec![0.0; n]; rank];
        for (column, &c) in columns.iter().zip(&order) {
            for (row, t) in rows.iter_mut().zip(column) {
                row[c] = t * scales[c];
            }
        }
        let mut reflections = Vec::with_capacity(rank);
        for i in 0..rank {
            let v = reflection(&mut rows[i], i);
            for row in &mut rows[i + 1..] {
                reflect(&v, row);
            }
            reflections.push(v);
        }
        for row in &mut rows {
            row.truncate(rank);
        }
        CompleteOrthogonal { reflections, upper: rows }
    }

    /// k, the number of independent columns.
    pub fn rank(&self) -> usize {
        self.upper.len()
    }

    /// The shortest x with AᵀA x = g, for g in the range of Aᵀ; for other g that of g's part in the range.
    ///
    /// # Panics
    /// If g does not have n numbers.
    pub fn solve_normal_equations(&self, g: &[f64]) -> Vec<f64> {
        let mut x = g.to_vec();
        let k = self.rank();
        for v in &self.reflections {
            assert!(
                v.len() == g.len(),
                "CompleteOrthogonal: g has {} numbers, A has {} columns",
                g.len(),
                v.len()
            );
            reflect(v, &mut x);
        }
        x[k..].fill(0.0);
        // U a = g, from below …
        for j in (0..k).rev() {
            let column = &self.upper[j];
            x[j] /= column[j];
            for i in 0..j {
                x[i] -= column[i] * x[j];
            }
        }
        // … and Uᵀ x = a, from above.
        for j in 0..k {
            let column = &self.upper[j];
            let sum: f64 = column[..j].iter().zip(&x).map(|(u, x)| u * x).sum();
            x[j] = (x[j] - sum) / column[j];
        }
        for v in self.reflections.iter().rev() {
            reflect(v, &mut x);
        }
        x
    }
}

/// The v, zero before `from`, whose reflection maps the rest of `a` onto ∓‖a‖ e_from; `a` becomes its image.
fn reflection(a: &mut [f64], from: usize) -> Vec<f64> {
    let length = norm(&a[from..]);
    let alpha = if a[from] > 0.0 { -length } else { length };
    let mut v = vec![0.0; a.len()];
    v[from..].copy_from_slice(&a[from..]);
    v[from] -= alpha;
    let v_norm = norm(&v);
    if v_norm > 0.0 {
        v.iter_mut().for_each(|v| *v *= std::f64::consts::SQRT_2 / v_norm);
    }
    a[from..].fill(0.0);
    a[from] = alpha;
    v
}

/// x ← (I − v vᵀ) x.
fn reflect(v: &[f64], x: &mut [f64]) {
    let along: f64 = v.iter().zip(&*x).map(|(v, x)| v * x).sum();
    for (x, v) in x.iter_mut().zip(v) {
        *x -= along * v;
    }
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|a| a * a).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in (−1, 1) from a multiplicative congruential generator.
    fn noise(count: usize, seed: u64) -> Vec<f64> {
        let mut state = seed.wrapping_mul(2).wrapping_add(1);
        (0..count)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
            })
            .collect()
    }

    /// m×k times k×n: a matrix of rank k.
    fn planted(m: usize, n: usize, k: usize, seed: u64) -> Dense {
        let (left, right) = (noise(m * k, seed), noise(k * n, seed + 1000));
        let mut a = Dense::zeros(m, n);
        for r in 0..m {
            for c in 0..n {
                a[(r, c)] = (0..k).map(|i| left[r * k + i] * right[i * n + c]).sum();
            }
        }
        a
    }

    #[test]
    fn two_equal_columns_share_the_answer() {
        // x + y = 2 has the shortest solution (1, 1).
        let a = Dense::new(3, 2, vec![1.0, 1.0, 2.0, 2.0, 2.0, 2.0]);
        let decomposition = CompleteOrthogonal::factor(&a);
        assert_eq!(decomposition.rank(), 1);
        let x = decomposition.solve_normal_equations(&[18.0, 18.0]);
        assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 1.0).abs() < 1e-15, "{x:?}");
    }

    #[test]
    fn matrix_of_zeros_has_rank_zero_and_answers_zero() {
        let decomposition = CompleteOrthogonal::factor(&Dense::zeros(3, 2));
        assert_eq!(
            (decomposition.rank(), decomposition.solve_normal_equations(&[0.0, 0.0])),
            (0, vec![0.0, 0.0])
        );
    }

    #[test]
    fn planted_rank_is_found_and_the_solution_is_the_shortest() {
        for (m, n) in [(9, 6), (6, 9), (7, 7), (200, 40)] {
            for k in 1..=m.min(n) {
                let a = planted(m, n, k, (m * 100 + n * 10 + k) as u64);
                let decomposition = CompleteOrthogonal::factor(&a);
                assert_eq!(decomposition.rank(), k, "{m}×{n}");
                // x = Aᵀ y is in the range of Aᵀ, so it is the shortest of all with the same A x.
                let x = a.apply_transposed(&noise(m, k as u64));
                let found = decomposition.solve_normal_equations(&a.apply_transposed(&a.apply(&x)));
                let error = norm(&found.iter().zip(&x).map(|(f, x)| f - x).collect::<Vec<_>>());
                // The smallest singular value of a planted matrix is a small fraction of the largest; squared.
                assert!(error < 1e-7 * norm(&x), "{m}×{n} of rank {k}: error {error:e} of {}", norm(&x));
            }
        }
    }

    #[test]
    fn rank_does_not_depend_on_units() {
        let mut a = planted(8, 5, 3, 7);
        for r in 0..8 {
            for c in 0..5 {
                a[(r, c)] *= [1e-9, 1e6, 1.0, 1e3, 1e-3][c];
            }
        }
        assert_eq!(CompleteOrthogonal::factor(&a).rank(), 3);
        assert_eq!(CompleteOrthogonal::factor(&planted(8, 5, 5, 8)).rank(), 5);
    }

    #[test]
    fn nearly_dependent_columns_that_cholesky_gives_up_are_solved() {
        // Läuchli's matrix with δ² below ε.
        let delta = 1e-9;
        let a = Dense::new(3, 2, vec![1.0, 1.0, delta, 0.0, 0.0, delta]);
        assert!(crate::linalg::cholesky::Cholesky::factor(&a.gram()).is_none());
        let decomposition = CompleteOrthogonal::factor(&a);
        assert_eq!(decomposition.rank(), 2);
        let x = decomposition.solve_normal_equations(&[1.0, -1.0]);
        let expected = 1.0 / (delta * delta);
        assert!((x[0] / expected - 1.0).abs() < 1e-6 && (x[1] / expected + 1.0).abs() < 1e-6, "{x:?}");
    }
}

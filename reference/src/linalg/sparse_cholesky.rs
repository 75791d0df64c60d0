//! The Cholesky factorisation of sparse matrices, P A Pᵀ = L Lᵀ.
//!
//! Where L has non-zeros follows from where A has them: if l_ij ≠ 0 for the first i > j below the diagonal of column j, then
//! column i inherits the rest of column j's pattern. That i is the *parent* of j in the elimination tree, and row k of L is
//! non-zero exactly on the paths that lead from the non-zeros of row k of A up the tree to k. So the work is split:
//!
//! * [`SymbolicCholesky::analyze`] looks at the pattern alone: the order of [`minimum_degree()`], the tree, the rows of L.
//!   It serves all matrices of one pattern;
//! * [`SymbolicCholesky::factor`] computes the numbers, row by row: row k of L solves L₁…ₖ₋₁ l = a_k.
//!
//! [`minimum_degree()`]: super::minimum_degree::minimum_degree
//!
//! # References
//! Davis 2006, "Direct Methods for Sparse Linear Systems", chapter 4 (up-looking Cholesky). Liu 1990, "The role of
//! elimination trees in sparse factorization".

use super::minimum_degree::minimum_degree;
use super::sparse::Sparse;
use std::sync::Arc;

/// Everything about L that the pattern of A determines.
#[derive(Clone, Debug, PartialEq)]
pub struct SymbolicCholesky {
    /// P: the k-th unknown to be eliminated.
    order: Vec<usize>,
    /// P⁻¹: when each unknown is eliminated.
    place: Vec<usize>,
    /// The columns j < k of row k of L, ascending: `row_columns[row_starts[k]..row_starts[k + 1]]`.
    row_starts: Vec<usize>,
    row_columns: Vec<usize>,
    /// The rows i > j of column j of L, ascending: `column_rows[column_starts[j]..column_starts[j + 1]]`.
    column_starts: Vec<usize>,
    column_rows: Vec<usize>,
}

/// The numbers of L.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseCholesky {
    symbolic: Arc<SymbolicCholesky>,
    diagonal: Vec<f64>,
    /// Below the diagonal, by columns, at the places of `column_rows`.
    below: Vec<f64>,
}

impl SymbolicCholesky {
    /// Analyses the pattern of a symmetric n×n matrix, both of whose triangles are stored.
    ///
    /// # Panics
    /// If A is not square.
    pub fn analyze(a: &Sparse) -> Arc<SymbolicCholesky> {
        SymbolicCholesky::analyze_in_order(a, minimum_degree(a))
    }

    /// [`SymbolicCholesky::analyze`] with an order of elimination that the caller knows to be good.
    ///
    /// # Panics
    /// If A is not square, or the order is no permutation of its unknowns.
    pub fn analyze_in_order(a: &Sparse, order: Vec<usize>) -> Arc<SymbolicCholesky> {
        let n = a.rows();
        assert!(a.columns() == n, "SymbolicCholesky: A is {n}×{}", a.columns());
        let mut place = vec![usize::MAX; n];
        for (k, &i) in order.iter().enumerate() {
            assert!(
                i < n && place[i] == usize::MAX,
                "SymbolicCholesky: {i} is outside of 0..{n} or ordered twice"
            );
            place[i] = k;
        }
        assert!(order.len() == n, "SymbolicCholesky: {} of {n} unknowns ordered", order.len());

        // Climb from each non-zero of row k to the first node that row k has met; a root met on the way has its parent
        // in k.
        let mut parent = vec![usize::MAX; n];
        let mut met = vec![usize::MAX; n];
        let (mut row_starts, mut row_columns) = (vec![0], Vec::new());
        let mut column_counts = vec![0; n + 1];
        for k in 0..n {
            met[k] = k;
            let start = row_columns.len();
            for &i in a.row(order[k]).0 {
                let mut j = place[i];
                while j < k && met[j] != k {
                    met[j] = k;
                    row_columns.push(j);
                    column_counts[j + 1] += 1;
                    if parent[j] == usize::MAX {
                        parent[j] = k;
                    }
                    j = parent[j];
                }
            }
            row_columns[start..].sort_unstable();
            row_starts.push(row_columns.len());
        }
        for j in 0..n {
            column_counts[j + 1] += column_counts[j];
        }
        let column_starts = column_counts;
        let mut next = column_starts.clone();
        let mut column_rows = vec![0; row_columns.len()];
        for k in 0..n {
            for &j in &row_columns[row_starts[k]..row_starts[k + 1]] {
                column_rows[next[j]] = k;
                next[j] += 1;
            }
        }
        Arc::new(SymbolicCholesky { order, place, row_starts, row_columns, column_starts, column_rows })
    }

    /// n.
    pub fn size(&self) -> usize {
        self.order.len()
    }

    /// How many numbers L has, the diagonal included.
    pub fn stored(&self) -> usize {
        self.size() + self.column_rows.len()
    }

    /// Factors a matrix of the pattern analysed, or of a part of it; `None` unless it is positive definite in f64.
    ///
    /// A pivot below n·ε·a_kk is rounding noise, as in [`super::cholesky`].
    ///
    /// # Panics
    /// If A is not n×n, or has a number outside of the pattern.
    pub fn factor(self: &Arc<Self>, a: &Sparse) -> Option<SparseCholesky> {
        let n = self.size();
        assert!(
            (a.rows(), a.columns()) == (n, n),
            "SymbolicCholesky::factor: A is {}×{}, the pattern {n}×{n}",
            a.rows(),
            a.columns()
        );
        let mut diagonal = vec![0.0; n];
        let mut below = vec![0.0; self.column_rows.len()];
        // Where column j ends so far: its rows < k.
        let mut ends = self.column_starts[..n].to_vec();
        let mut x = vec![0.0; n];
        let mut allowed = vec![usize::MAX; n];
        for k in 0..n {
            let row = &self.row_columns[self.row_starts[k]..self.row_starts[k + 1]];
            row.iter().for_each(|&j| allowed[j] = k);
            allowed[k] = k;
            for (i, a_ki) in a.entries(self.order[k]) {
                let j = self.place[i];
                if j <= k {
                    assert!(
                        allowed[j] == k,
                        "SymbolicCholesky::factor: ({}, {i}) is not in the pattern",
                        self.order[k]
                    );
                    x[j] = a_ki;
                }
            }
            let a_kk = std::mem::take(&mut x[k]);
            let mut pivot = a_kk;
            for &j in row {
                let l_kj = std::mem::take(&mut x[j]) / diagonal[j];
                let known = self.column_starts[j]..ends[j];
                for (&i, l_ij) in self.column_rows[known.clone()].iter().zip(&below[known]) {
                    x[i] -= l_ij * l_kj;
                }
                pivot -= l_kj * l_kj;
                below[ends[j]] = l_kj;
                ends[j] += 1;
            }
            if pivot.is_nan() || pivot <= n as f64 * f64::EPSILON * a_kk {
                return None;
            }
            diagonal[k] = pivot.sqrt();
        }
        Some(SparseCholesky { symbolic: self.clone(), diagonal, below })
    }
}

impl SparseCholesky {
    /// Analyses and factors a symmetric n×n matrix, both of whose triangles are stored; `None` unless it is positive
    /// definite in f64.
    ///
    /// # Panics
    /// If A is not square.
    pub fn factor(a: &Sparse) -> Option<SparseCholesky> {
        SymbolicCholesky::analyze(a).factor(a)
    }

    /// What can be used again for another matrix of this pattern.
    pub fn symbolic(&self) -> &Arc<SymbolicCholesky> {
        &self.symbolic
    }

    /// The solution x of A x = b.
    ///
    /// # Panics
    /// If b does not have n numbers.
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let b: Vec<[f64; 1]> = b.iter().map(|&b| [b]).collect();
        self.solve_many(&b).into_iter().flatten().collect()
    }

    /// The solutions X of A X = B for K right-hand sides at once, `b[i][k]`: L is read once for all.
    ///
    /// With K = 3 this solves (A ⊗ I₃) x = b, in which every vertex has three coordinates.
    ///
    /// # Panics
    /// If B does not have n rows.
    pub fn solve_many<const K: usize>(&self, b: &[[f64; K]]) -> Vec<[f64; K]> {
        let symbolic = &*self.symbolic;
        let n = symbolic.size();
        assert!(b.len() == n, "SparseCholesky: B has {} rows, A is {n}×{n}", b.len());
        let mut x: Vec<[f64; K]> = symbolic.order.iter().map(|&i| b[i]).collect();
        for j in 0..n {
            let x_j = x[j].map(|x| x / self.diagonal[j]);
            x[j] = x_j;
            for (i, l_ij) in self.column(j) {
                let x_i = &mut x[i];
                for k in 0..K {
                    x_i[k] -= l_ij * x_j[k];
                }
            }
        }
        for j in (0..n).rev() {
            let mut x_j = x[j];
            for (i, l_ij) in self.column(j) {
                let x_i = &x[i];
                for k in 0..K {
                    x_j[k] -= l_ij * x_i[k];
                }
            }
            x[j] = x_j.map(|x| x / self.diagonal[j]);
        }
        symbolic.place.iter().map(|&k| x[k]).collect()
    }

    /// The numbers of column j of L below the diagonal.
    fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.symbolic.column_starts[j]..self.symbolic.column_starts[j + 1];
        self.symbolic.column_rows[range.clone()].iter().copied().zip(self.below[range].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;
    use crate::linalg::{cholesky::Cholesky, dense::Dense};
    use std::collections::BTreeSet;

    fn dense(a: &Sparse) -> Dense {
        let mut full = Dense::zeros(a.rows(), a.columns());
        for r in 0..a.rows() {
            for (c, v) in a.entries(r) {
                full[(r, c)] = v;
            }
        }
        full
    }

    /// 4 on the diagonal of a path with two chords, −1 beside it.
    fn example() -> Sparse {
        let mut triplets: Vec<_> = (0..7).map(|i| (i, i, 4.0)).collect();
        for (i, j) in [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (0, 4), (2, 6)] {
            triplets.extend([(i, j, -1.0), (j, i, -1.0)]);
        }
        Sparse::from_triplets(7, 7, &triplets)
    }

    fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn solution_is_that_of_the_dense_factorisation() {
        let a = example();
        let b = [1.0, -2.0, 0.5, 4.0, 0.0, 1.0, -3.0];
        let x = SparseCholesky::factor(&a).expect("diagonally dominant").solve(&b);
        let y = Cholesky::factor(&dense(&a)).expect("diagonally dominant").solve(&b);
        assert!(largest_difference(&x, &y) < 1e-15, "{x:?} {y:?}");
    }

    #[test]
    fn many_right_hand_sides_are_as_many_solutions() {
        let factor = SparseCholesky::factor(&example()).expect("diagonally dominant");
        let b: Vec<[f64; 3]> = (0..7).map(|i| [i as f64, 1.0, -(i as f64).powi(2)]).collect();
        let x = factor.solve_many(&b);
        for k in 0..3 {
            let column: Vec<f64> = b.iter().map(|b| b[k]).collect();
            assert_eq!(factor.solve(&column), x.iter().map(|x| x[k]).collect::<Vec<_>>());
        }
    }

    #[test]
    fn analysis_serves_other_numbers_and_parts_of_the_pattern() {
        let symbolic = SymbolicCholesky::analyze(&example());
        let doubled = Sparse::combination(2.0, &example(), 1.0, &Sparse::identity(7));
        for a in [doubled, Sparse::identity(7)] {
            let factor = symbolic.factor(&a).expect("positive definite");
            assert!(largest_difference(&factor.solve(&a.apply(&[1.0; 7])), &[1.0; 7]) < 1e-15);
        }
    }

    #[test]
    fn singular_indefinite_and_nan_have_no_factor() {
        let laplacian = Sparse::combination(1.0, &example(), -4.0, &Sparse::identity(7));
        assert_eq!(SparseCholesky::factor(&laplacian), None);
        for numbers in [[1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 2.0, 1.0], [f64::NAN, 0.0, 0.0, 1.0]] {
            let places = [(0, 0), (0, 1), (1, 0), (1, 1)];
            let triplets: Vec<_> = places.iter().zip(numbers).map(|(&(r, c), v)| (r, c, v)).collect();
            assert_eq!(SparseCholesky::factor(&Sparse::from_triplets(2, 2, &triplets)), None);
        }
    }

    #[test]
    #[should_panic(expected = "is not in the pattern")]
    fn numbers_outside_of_the_pattern_are_refused() {
        SymbolicCholesky::analyze(&Sparse::identity(7)).factor(&example());
    }

    #[test]
    fn laplacian_of_a_body_is_factored_with_little_fill() {
        // The offsets of chapter 3: ω_L² LᵀL + ω_B² I over the mesh, each vertex against the mean of its neighbours.
        let body = mannequin();
        let n = body.vertex_count();
        let edges: BTreeSet<(usize, usize)> = body
            .faces
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a), (b, a), (c, b), (a, c)])
            .map(|(a, b)| (a as usize, b as usize))
            .collect();
        let mut degree = vec![0.0; n];
        edges.iter().for_each(|&(a, _)| degree[a] += 1.0);
        let mut triplets: Vec<_> = (0..n).map(|i| (i, i, 1.0)).collect();
        triplets.extend(edges.iter().map(|&(a, b)| (a, b, -1.0 / degree[a])));
        let laplacian = Sparse::from_triplets(n, n, &triplets);
        let a = Sparse::combination(16.0, &laplacian.gram(), 0.25, &Sparse::identity(n));

        let factor = SparseCholesky::factor(&a).expect("positive definite");
        let fill = factor.symbolic().stored() as f64 / a.stored() as f64;
        assert!(fill < 4.0, "L has {fill} times the numbers of A");
        let x: Vec<f64> = (0..n).map(|i| (0.37 * i as f64).sin()).collect();
        // ‖A‖/λ_min is at most (16·4 + ¼)/¼ = 257.
        assert!(largest_difference(&factor.solve(&a.apply(&x)), &x) < 1e-12);
    }
}

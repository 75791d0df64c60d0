//! Sparse matrices, stored by rows.

/// An m×n matrix of which only the non-zeros are stored: compressed sparse rows.
///
/// Row r holds `values[k]` in column `indices[k]` for `starts[r]` ≤ k < `starts[r + 1]`, columns ascending. What is stored
/// is the *pattern*; a stored number may be zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Sparse {
    columns: usize,
    starts: Vec<usize>,
    indices: Vec<usize>,
    values: Vec<f64>,
}

impl Sparse {
    /// The m×n matrix with the sum of all `v` of `(r, c, v)` at (r, c): assembling is listing.
    ///
    /// # Panics
    /// If a triplet lies outside of m×n.
    pub fn from_triplets(rows: usize, columns: usize, triplets: &[(usize, usize, f64)]) -> Sparse {
        // Sorting by counting, once by column and once by row, keeps columns ascending in each row.
        let mut by_column: Vec<usize> = vec![0; columns + 1];
        for &(r, c, _) in triplets {
            assert!(
                r < rows && c < columns,
                "Sparse::from_triplets: ({r}, {c}) is outside of {rows}×{columns}"
            );
            by_column[c + 1] += 1;
        }
        accumulate(&mut by_column);
        let mut order = vec![0; triplets.len()];
        for (t, &(_, c, _)) in triplets.iter().enumerate() {
            order[by_column[c]] = t;
            by_column[c] += 1;
        }
        let mut next = vec![0; rows + 1];
        for &(r, _, _) in triplets {
            next[r + 1] += 1;
        }
        accumulate(&mut next);
        let ends = next[1..].to_vec();
        let mut sorted = vec![(0, 0.0); triplets.len()];
        for &t in &order {
            let (r, c, v) = triplets[t];
            sorted[next[r]] = (c, v);
            next[r] += 1;
        }
        let mut matrix = Sparse::empty(columns, triplets.len());
        let mut begin = 0;
        for end in ends {
            let row_start = matrix.indices.len();
            for &(c, v) in &sorted[begin..end] {
                if matrix.indices.len() > row_start && matrix.indices.last() == Some(&c) {
                    *matrix.values.last_mut().expect("as many values as indices") += v;
                } else {
                    matrix.indices.push(c);
                    matrix.values.push(v);
                }
            }
            matrix.starts.push(matrix.indices.len());
            begin = end;
        }
        matrix
    }

    /// The n×n identity.
    pub fn identity(n: usize) -> Sparse {
        Sparse { columns: n, starts: (0..=n).collect(), indices: (0..n).collect(), values: vec![1.0; n] }
    }

    /// A matrix without rows yet.
    fn empty(columns: usize, capacity: usize) -> Sparse {
        let (indices, values) = (Vec::with_capacity(capacity), Vec::with_capacity(capacity));
        Sparse { columns, starts: vec![0], indices, values }
    }

    /// m.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// n.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// How many numbers are stored.
    pub fn stored(&self) -> usize {
        self.values.len()
    }

    /// The columns of the numbers stored in row `r`, ascending, and the numbers.
    pub fn row(&self, r: usize) -> (&[usize], &[f64]) {
        let range = self.starts[r]..self.starts[r + 1];
        (&self.indices[range.clone()], &self.values[range])
    }

    /// The numbers stored in row `r` with their columns, ascending.
    pub fn entries(&self, r: usize) -> impl Iterator<Item = (usize, f64)> {
        let (indices, values) = self.row(r);
        indices.iter().copied().zip(values.iter().copied())
    }

    /// All numbers stored, row after row, to be changed; the pattern stays.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Whether both store numbers at the same places.
    pub fn has_pattern_of(&self, other: &Sparse) -> bool {
        (self.columns, &self.starts, &self.indices) == (other.columns, &other.starts, &other.indices)
    }

    /// A x, m numbers.
    ///
    /// # Panics
    /// If x does not have n numbers.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let (m, n) = (self.rows(), self.columns);
        assert!(x.len() == n, "Sparse::apply: x has {} numbers, A is {m}×{n}", x.len());
        (0..m).map(|r| self.entries(r).map(|(c, a)| a * x[c]).sum()).collect()
    }

    /// Aᵀ y, n numbers.
    ///
    /// # Panics
    /// If y does not have m numbers.
    pub fn apply_transposed(&self, y: &[f64]) -> Vec<f64> {
        let (m, n) = (self.rows(), self.columns);
        assert!(y.len() == m, "Sparse::apply_transposed: y has {} numbers, A is {m}×{n}", y.len());
        let mut product = vec![0.0; n];
        for (r, y) in y.iter().enumerate() {
            for (c, a) in self.entries(r) {
                product[c] += a * y;
            }
        }
        product
    }

    /// Aᵀ.
    pub fn transposed(&self) -> Sparse {
        let mut next = vec![0; self.columns + 1];
        for &c in &self.indices {
            next[c + 1] += 1;
        }
        accumulate(&mut next);
        let starts = next.clone();
        let (mut indices, mut values) = (vec![0; self.stored()], vec![0.0; self.stored()]);
        for r in 0..self.rows() {
            for (c, a) in self.entries(r) {
                (indices[next[c]], values[next[c]]) = (r, a);
                next[c] += 1;
            }
        }
        Sparse { columns: self.rows(), starts, indices, values }
    }

    /// The Gram matrix Aᵀ A, n×n: the left-hand side of the normal equations.
    pub fn gram(&self) -> Sparse {
        self.weighted_gram(&vec![1.0; self.rows()])
    }

    /// Aᵀ diag(w) A, n×n: the normal equations of residuals with weights w ≥ 0, one for each row.
    ///
    /// Row i of the result is the sum of the rows r of A that have a number in column i, each times w_r a_ri (Gustavson
    /// 1978). Symmetric to the last bit, because the same products are summed in the same order on both sides.
    ///
    /// # Panics
    /// If there are not m weights.
    pub fn weighted_gram(&self, weights: &[f64]) -> Sparse {
        let (m, n) = (self.rows(), self.columns);
        assert!(weights.len() == m, "Sparse::weighted_gram: {} weights, A is {m}×{n}", weights.len());
        let transposed = self.transposed();
        let mut gram = Sparse::empty(n, 4 * self.stored());
        let mut sums = vec![0.0; n];
        let mut met = vec![usize::MAX; n];
        for i in 0..n {
            let start = gram.indices.len();
            for (r, a_ri) in transposed.entries(i) {
                for (j, a_rj) in self.entries(r) {
                    if met[j] != i {
                        met[j] = i;
                        sums[j] = 0.0;
                        gram.indices.push(j);
                    }
                    sums[j] += weights[r] * (a_ri * a_rj);
                }
            }
            gram.indices[start..].sort_unstable();
            gram.values.extend(gram.indices[start..].iter().map(|&j| sums[j]));
            gram.starts.push(gram.indices.len());
        }
        gram
    }

    /// α A + β B.
    ///
    /// # Panics
    /// If A and B differ in shape.
    pub fn combination(alpha: f64, a: &Sparse, beta: f64, b: &Sparse) -> Sparse {
        assert!(
            (a.rows(), a.columns) == (b.rows(), b.columns),
            "Sparse::combination: A is {}×{}, B is {}×{}",
            a.rows(),
            a.columns,
            b.rows(),
            b.columns
        );
        let mut sum = Sparse::empty(a.columns, a.stored() + b.stored());
        for r in 0..a.rows() {
            let (mut left, mut right) = (a.entries(r).peekable(), b.entries(r).peekable());
            loop {
                let column = match (left.peek(), right.peek()) {
                    (Some(&(i, _)), Some(&(j, _))) => i.min(j),
                    (Some(&(i, _)), None) | (None, Some(&(i, _))) => i,
                    (None, None) => break,
                };
                let x = left.next_if(|&(i, _)| i == column).map_or(0.0, |(_, x)| alpha * x);
                let y = right.next_if(|&(j, _)| j == column).map_or(0.0, |(_, y)| beta * y);
                sum.indices.push(column);
                sum.values.push(x + y);
            }
            sum.starts.push(sum.indices.len());
        }
        sum
    }
}

/// Counts, one place late, become where each group starts.
fn accumulate(counts: &mut [usize]) {
    for k in 1..counts.len() {
        counts[k] += counts[k - 1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [[1, 0, 2], [0, 0, 0], [−1, 3, 0], [0, 0, 4]], with the 2 in two parts.
    fn example() -> Sparse {
        let triplets = [(2, 1, 3.0), (0, 2, 0.5), (3, 2, 4.0), (0, 0, 1.0), (0, 2, 1.5), (2, 0, -1.0)];
        Sparse::from_triplets(4, 3, &triplets)
    }

    #[test]
    fn triplets_are_sorted_and_summed() {
        let a = example();
        assert_eq!((a.rows(), a.columns(), a.stored()), (4, 3, 5));
        assert_eq!(a.row(0), ([0, 2].as_slice(), [1.0, 2.0].as_slice()));
        assert_eq!(a.row(1), ([].as_slice(), [].as_slice()));
        assert_eq!(a.row(2), ([0, 1].as_slice(), [-1.0, 3.0].as_slice()));
    }

    #[test]
    fn products_by_hand() {
        let a = example();
        assert_eq!(a.apply(&[1.0, 2.0, 3.0]), [7.0, 0.0, 5.0, 12.0]);
        assert_eq!(a.apply_transposed(&[1.0, 9.0, 2.0, 0.5]), [-1.0, 6.0, 4.0]);
        assert_eq!(a.transposed().apply(&[1.0, 9.0, 2.0, 0.5]), [-1.0, 6.0, 4.0]);
        assert_eq!(a.transposed().transposed(), a);
    }

    #[test]
    fn gram_matrices_by_hand() {
        let gram =
            [(0, 0, 2.0), (0, 1, -3.0), (0, 2, 2.0), (1, 0, -3.0), (1, 1, 9.0), (2, 0, 2.0), (2, 2, 20.0)];
        assert_eq!(example().gram(), Sparse::from_triplets(3, 3, &gram));
        let weighted =
            [(0, 0, 3.0), (0, 1, -3.0), (0, 2, 4.0), (1, 0, -3.0), (1, 1, 9.0), (2, 0, 4.0), (2, 2, 8.0)];
        assert_eq!(example().weighted_gram(&[2.0, 7.0, 1.0, 0.0]), Sparse::from_triplets(3, 3, &weighted));
    }

    #[test]
    fn combination_joins_patterns() {
        let sum = Sparse::combination(
            2.0,
            &Sparse::from_triplets(2, 2, &[(0, 1, 1.0)]),
            -1.0,
            &Sparse::identity(2),
        );
        assert_eq!(sum, Sparse::from_triplets(2, 2, &[(0, 0, -1.0), (0, 1, 2.0), (1, 1, -1.0)]));
    }

    #[test]
    #[should_panic(expected = "(1, 2) is outside of 2×2")]
    fn triplets_outside_are_refused() {
        Sparse::from_triplets(2, 2, &[(1, 2, 1.0)]);
    }
}

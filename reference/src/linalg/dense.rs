//! Dense matrices of any size.

use std::ops::{Index, IndexMut};

/// An m×n matrix, row-major; `a[(row, column)]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    rows: usize,
    columns: usize,
    data: Vec<f64>,
}

impl Dense {
    /// The m×n matrix of zeros.
    pub fn zeros(rows: usize, columns: usize) -> Dense {
        Dense { rows, columns, data: vec![0.0; rows * columns] }
    }

    /// The m×n matrix of `data`, row by row.
    ///
    /// # Panics
    /// If there are not m·n numbers.
    pub fn new(rows: usize, columns: usize, data: Vec<f64>) -> Dense {
        assert!(data.len() == rows * columns, "Dense::new: {} numbers for {rows}×{columns}", data.len());
        Dense { rows, columns, data }
    }

    /// m.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// n.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Row `r`, n numbers.
    pub fn row(&self, r: usize) -> &[f64] {
        &self.data[r * self.columns..(r + 1) * self.columns]
    }

    /// A x, m numbers.
    ///
    /// # Panics
    /// If x does not have n numbers.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        assert!(
            x.len() == self.columns,
            "Dense::apply: x has {} numbers, A is {}×{}",
            x.len(),
            self.rows,
            self.columns
        );
        (0..self.rows).map(|r| self.row(r).iter().zip(x).map(|(a, x)| a * x).sum()).collect()
    }

    /// Aᵀ y, n numbers.
    ///
    /// # Panics
    /// If y does not have m numbers.
    pub fn apply_transposed(&self, y: &[f64]) -> Vec<f64> {
        assert!(
            y.len() == self.rows,
            "Dense::apply_transposed: y has {} numbers, A is {}×{}",
            y.len(),
            self.rows,
            self.columns
        );
        let mut product = vec![0.0; self.columns];
        for (r, y) in y.iter().enumerate() {
            for (sum, a) in product.iter_mut().zip(self.row(r)) {
                *sum += a * y;
            }
        }
        product
    }

    /// Row `r`, n numbers, to be changed.
    pub fn row_mut(&mut self, r: usize) -> &mut [f64] {
        &mut self.data[r * self.columns..(r + 1) * self.columns]
    }

    /// The Gram matrix Aᵀ A, n×n and symmetric: the left-hand side of the normal equations.
    ///
    /// A sum of outer products of rows, four rows at a time: each element of the result is then loaded and stored once for
    /// four products.
    pub fn gram(&self) -> Dense {
        let n = self.columns;
        let mut gram = Dense::zeros(n, n);
        let zeros = vec![0.0; n];
        for first in (0..self.rows).step_by(4) {
            let row = |k: usize| if first + k < self.rows { self.row(first + k) } else { &zeros };
            let (a, b, c, d) = (row(0), row(1), row(2), row(3));
            for i in 0..n {
                // Jacobians of bodies are sparse: a residual depends on few joints.
                if a[i] != 0.0 || b[i] != 0.0 || c[i] != 0.0 || d[i] != 0.0 {
                    let sums = &mut gram.data[i * n..i * n + i + 1];
                    let rows = a.iter().zip(b).zip(c).zip(d);
                    for (sum, (((aj, bj), cj), dj)) in sums.iter_mut().zip(rows) {
                        *sum += a[i] * aj + b[i] * bj + c[i] * cj + d[i] * dj;
                    }
                }
            }
        }
        for i in 0..n {
            for j in 0..i {
                gram.data[j * n + i] = gram.data[i * n + j];
            }
        }
        gram
    }
}

impl Index<(usize, usize)> for Dense {
    type Output = f64;

    fn index(&self, (r, c): (usize, usize)) -> &f64 {
        &self.data[r * self.columns..(r + 1) * self.columns][c]
    }
}

impl IndexMut<(usize, usize)> for Dense {
    fn index_mut(&mut self, (r, c): (usize, usize)) -> &mut f64 {
        &mut self.data[r * self.columns..(r + 1) * self.columns][c]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_by_hand() {
        let a = Dense::new(2, 3, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(a.apply(&[1.0, 0.0, -1.0]), [-2.0, -2.0]);
        assert_eq!(a.apply_transposed(&[1.0, -1.0]), [-3.0, -3.0, -3.0]);
        assert_eq!(a.gram(), Dense::new(3, 3, vec![17.0, 22.0, 27.0, 22.0, 29.0, 36.0, 27.0, 36.0, 45.0]));
    }

    #[test]
    #[should_panic(expected = "5 numbers for 2×3")]
    fn wrong_length_is_refused() {
        Dense::new(2, 3, vec![0.0; 5]);
    }
}

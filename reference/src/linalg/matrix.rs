//! 3×3 matrices as plain arrays, row-major: `m[row][column]`.

use super::vector::{Vector3, cross, dot, scale};

/// A 3×3 matrix; `m[row][column]`.
pub type Matrix3 = [[f64; 3]; 3];

/// The identity.
pub const IDENTITY: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A + B.
pub fn add(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| a[r][c] + b[r][c]))
}

/// A − B.
pub fn sub(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| a[r][c] - b[r][c]))
}

/// s·A.
pub fn scaled(a: &Matrix3, s: f64) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| a[r][c] * s))
}

/// A·B.
pub fn mul(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|r| {
        std::array::from_fn(|c| a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c])
    })
}

/// A·v, with v a column.
pub fn apply(a: &Matrix3, v: Vector3) -> Vector3 {
    [dot(a[0], v), dot(a[1], v), dot(a[2], v)]
}

/// Aᵀ.
pub fn transpose(a: &Matrix3) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| a[c][r]))
}

/// Aᵀ·v, without forming Aᵀ.
pub fn apply_transposed(a: &Matrix3, v: Vector3) -> Vector3 {
    std::array::from_fn(|c| a[0][c] * v[0] + a[1][c] * v[1] + a[2][c] * v[2])
}

/// a·bᵀ.
pub fn outer(a: Vector3, b: Vector3) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| a[r] * b[c]))
}

/// Column `c` of A.
pub fn column(a: &Matrix3, c: usize) -> Vector3 {
    [a[0][c], a[1][c], a[2][c]]
}

/// The matrix with the given columns.
pub fn from_columns(c0: Vector3, c1: Vector3, c2: Vector3) -> Matrix3 {
    std::array::from_fn(|r| [c0[r], c1[r], c2[r]])
}

/// diag(d).
pub fn diagonal(d: Vector3) -> Matrix3 {
    [[d[0], 0.0, 0.0], [0.0, d[1], 0.0], [0.0, 0.0, d[2]]]
}

/// The trace.
pub fn trace(a: &Matrix3) -> f64 {
    a[0][0] + a[1][1] + a[2][2]
}

/// The determinant: the triple product of the rows.
pub fn determinant(a: &Matrix3) -> f64 {
    dot(a[0], cross(a[1], a[2]))
}

/// A⁻¹ by the adjugate, or `None` if det A = 0 (or is not finite).
///
/// The columns of A⁻¹ are the vector products of A's rows, divided by det A.
pub fn inverse(a: &Matrix3) -> Option<Matrix3> {
    let det = determinant(a);
    if det == 0.0 || !det.is_finite() {
        return None;
    }
    let (c0, c1, c2) = (cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1]));
    Some(from_columns(scale(c0, 1.0 / det), scale(c1, 1.0 / det), scale(c2, 1.0 / det)))
}

/// The largest absolute entry, max |a_rc|.
pub fn max_abs(a: &Matrix3) -> f64 {
    a.iter().flatten().fold(0.0, |m, x| x.abs().max(m))
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Matrix3 = [[2.0, 1.0, 0.0], [-1.0, 3.0, 4.0], [0.5, 0.0, 1.0]];
    const B: Matrix3 = [[1.0, 0.0, 2.0], [0.0, -1.0, 1.0], [3.0, 2.0, 0.0]];

    #[test]
    fn product_of_hand_computed_matrices() {
        assert_eq!(mul(&A, &B), [[2.0, -1.0, 5.0], [11.0, 5.0, 1.0], [3.5, 2.0, 1.0]]);
    }

    #[test]
    fn transposing_reverses_products() {
        assert_eq!(transpose(&mul(&A, &B)), mul(&transpose(&B), &transpose(&A)));
    }

    #[test]
    fn apply_transposed_is_apply_of_the_transpose() {
        let v = [0.25, -3.0, 2.0];
        assert_eq!(apply_transposed(&A, v), apply(&transpose(&A), v));
    }

    #[test]
    fn determinant_by_hand() {
        assert_eq!(determinant(&A), 9.0);
    }

    #[test]
    fn inverse_times_matrix_is_identity() {
        let product = mul(&inverse(&A).expect("A is regular"), &A);
        assert!(max_abs(&sub(&product, &IDENTITY)) < 1e-15, "{product:?}");
        assert_eq!(inverse(&outer([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])), None);
    }
}

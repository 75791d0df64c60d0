//! The singular value decomposition of a 3×3 matrix.

use super::matrix::{IDENTITY, Matrix3, column, determinant, from_columns, mul, transpose};
use super::vector::{Vector3, add_scaled, cross, dot, norm, scale};

/// A = U diag(s) Vᵀ with U and V orthogonal and s₁ ≥ s₂ ≥ s₃ ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Svd3 {
    /// U, left singular vectors in columns.
    pub u: Matrix3,
    /// s, descending.
    pub singular_values: Vector3,
    /// V, right singular vectors in columns.
    pub v: Matrix3,
}

/// More sweeps than any 3×3 matrix needs: convergence is quadratic, five or six are usual.
const MAX_SWEEPS: usize = 60;

/// Decomposes `a` by one-sided Jacobi rotations.
///
/// Columns of W = A V are rotated pairwise until they are orthogonal; their lengths are the singular values and their
/// directions the columns of U. Small singular values come out with high relative accuracy. The columns of U that
/// belong to singular values of zero complete an orthonormal basis.
///
/// # Panics
/// If an entry is not finite.
///
/// # References
/// Demmel, Veselić 1992, "Jacobi's method is more accurate than QR".
pub fn svd3(a: &Matrix3) -> Svd3 {
    assert!(a.iter().flatten().all(|x| x.is_finite()), "svd3: {a:?} is not finite");
    let mut w: [Vector3; 3] = std::array::from_fn(|c| column(a, c));
    let mut v: [Vector3; 3] = std::array::from_fn(|c| column(&IDENTITY, c));
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (pp, qq, pq) = (dot(w[p], w[p]), dot(w[q], w[q]), dot(w[p], w[q]));
            if pq.abs() <= f64::EPSILON * (pp * qq).sqrt() {
                continue;
            }
            rotated = true;
            // The smaller root of t² + 2ζt − 1 = 0 makes the two columns orthogonal.
            let zeta = (qq - pp) / (2.0 * pq);
            let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
            let cos = 1.0 / t.hypot(1.0);
            let sin = cos * t;
            for columns in [&mut w, &mut v] {
                let (x, y) = (columns[p], columns[q]);
                columns[p] = add_scaled(scale(x, cos), y, -sin);
                columns[q] = add_scaled(scale(x, sin), y, cos);
            }
        }
        if !rotated {
            break;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| norm(w[j]).total_cmp(&norm(w[i])));
    let (w, v) = (order.map(|c| w[c]), order.map(|c| v[c]));
    let singular_values = w.map(norm);
    Svd3 { u: orthonormal_basis(w, singular_values), singular_values, v: from_columns(v[0], v[1], v[2]) }
}

/// The directions of the orthogonal columns `w` of lengths `s` (descending), completed where a length is as good as zero.
fn orthonormal_basis(w: [Vector3; 3], s: Vector3) -> Matrix3 {
    // Shorter columns have directions made of rounding errors.
    let negligible = s[0] * f64::EPSILON;
    if s[0] == 0.0 {
        return IDENTITY;
    }
    let u0 = scale(w[0], 1.0 / s[0]);
    let u1 = if s[1] > negligible { scale(w[1], 1.0 / s[1]) } else { any_orthogonal(u0) };
    let u2 = if s[2] > negligible { scale(w[2], 1.0 / s[2]) } else { cross(u0, u1) };
    from_columns(u0, u1, u2)
}

/// A unit vector orthogonal to the unit vector `u`.
fn any_orthogonal(u: Vector3) -> Vector3 {
    // Crossing with the axis that u has least of cannot vanish.
    let least = (0..3).min_by(|&i, &j| u[i].abs().total_cmp(&u[j].abs())).expect("three axes");
    let candidate = cross(u, IDENTITY[least]);
    scale(candidate, 1.0 / norm(candidate))
}

/// The rotation nearest to `a` in the Frobenius norm: U diag(1, 1, det U Vᵀ) Vᵀ.
///
/// # Panics
/// If an entry is not finite.
///
/// # References
/// Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns".
pub fn nearest_rotation(a: &Matrix3) -> Matrix3 {
    let Svd3 { u, v, .. } = svd3(a);
    let sign = determinant(&mul(&u, &transpose(&v))).signum();
    let flipped = from_columns(column(&u, 0), column(&u, 1), scale(column(&u, 2), sign));
    mul(&flipped, &transpose(&v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::{diagonal, max_abs, outer, scaled, sub};
    use crate::rotation::rodrigues;

    fn assert_decomposes(a: &Matrix3) -> Vector3 {
        let Svd3 { u, singular_values: s, v } = svd3(a);
        let size = max_abs(a).max(f64::MIN_POSITIVE);
        let rebuilt = mul(&mul(&u, &diagonal(s)), &transpose(&v));
        assert!(max_abs(&sub(&rebuilt, a)) <= 1e-14 * size, "U S Vᵀ = {rebuilt:?}, A = {a:?}");
        for basis in [u, v] {
            let gram = mul(&transpose(&basis), &basis);
            assert!(max_abs(&sub(&gram, &IDENTITY)) < 1e-14, "{basis:?}");
        }
        assert!(s[0] >= s[1] && s[1] >= s[2] && s[2] >= 0.0, "{s:?}");
        s
    }

    #[test]
    fn singular_values_of_a_rotated_diagonal_are_its_entries() {
        let (left, right) = (rodrigues([0.3, -0.2, 0.5]), rodrigues([-1.0, 2.0, 0.4]));
        let s = assert_decomposes(&mul(&mul(&left, &diagonal([0.5, 3.0, -2.0])), &right));
        for (found, wanted) in s.iter().zip([3.0, 2.0, 0.5]) {
            assert!((found - wanted).abs() < 1e-14, "{s:?}");
        }
    }

    #[test]
    fn matrices_of_every_rank_decompose() {
        assert_decomposes(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 10.0]]);
        assert_decomposes(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
        assert_decomposes(&outer([1.0, -2.0, 0.5], [0.0, 3.0, 1.0]));
        assert_decomposes(&[[0.0; 3]; 3]);
        assert_decomposes(&scaled(&IDENTITY, -1.0));
    }

    #[test]
    fn nearest_rotation_of_a_stretched_rotation_is_that_rotation() {
        let r = rodrigues([0.7, 0.1, -2.0]);
        let stretched = mul(&r, &diagonal([1.2, 0.9, 1.05]));
        assert!(max_abs(&sub(&nearest_rotation(&stretched), &r)) < 1e-14);
    }

    #[test]
    fn nearest_rotation_never_reflects() {
        let mirrored = diagonal([1.0, 1.0, -0.3]);
        assert!((determinant(&nearest_rotation(&mirrored)) - 1.0).abs() < 1e-14);
    }
}

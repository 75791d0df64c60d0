//! The similarity that brings one set of points closest to another.

use crate::linalg::matrix::{self, Matrix3};
use crate::linalg::vector::{Vector3, add, centroid, norm_squared, scale, sub};

/// x ↦ s·R·x + t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// s ≥ 0.
    pub scale: f64,
    /// R, orthonormal with determinant +1.
    pub rotation: Matrix3,
    /// t.
    pub translation: Vector3,
}

impl Similarity {
    /// The similarity that minimises Σ ‖s·R·xᵢ + t − yᵢ‖² over rotations, scales and translations.
    ///
    /// With aᵢ, bᵢ the points relative to their centroids x̄, ȳ and a unit quaternion q for R, the sum Σ bᵢ·(R
    /// aᵢ) is the quadratic form qᵀNq of a symmetric 4×4 matrix N made of the sums Σ aᵢ bᵢᵀ. Its largest
    /// eigenvalue λ belongs to the best q, and
    ///
    /// ```text
    /// s = λ / Σ ‖aᵢ‖²,    t = ȳ − s·R·x̄.
    /// ```
    ///
    /// A quaternion cannot be a reflection, so the mirror image of a pose stays an error; the usual route by
    /// singular values needs its sign correction diag(1, 1, sign det) for that and gives the same R. If all xᵢ
    /// coincide, s = 0 and the answer is ȳ.
    ///
    /// # Panics
    ///
    /// If the two sets differ in size or are empty.
    ///
    /// # References
    ///
    /// Horn 1987, "Closed-form solution of absolute orientation using unit quaternions". Li 2021, ch. 4,
    /// measures its reconstruction error after this alignment.
    pub fn aligning(from: &[Vector3], to: &[Vector3]) -> Similarity {
        assert_eq!(from.len(), to.len(), "Procrustes: {} points to align with {}", from.len(), to.len());
        assert!(!from.is_empty(), "Procrustes: no points to align");
        let (mean_from, mean_to) = (centroid(from), centroid(to));
        let mut sums = [[0.0; 3]; 3];
        let mut spread = 0.0;
        for (&x, &y) in from.iter().zip(to) {
            let (a, b) = (sub(x, mean_from), sub(y, mean_to));
            sums = matrix::add(&sums, &matrix::outer(a, b));
            spread += norm_squared(a);
        }
        let (eigenvalue, quaternion) = largest_eigenpair(quaternion_form(&sums));
        let scale_factor = if spread > 0.0 { eigenvalue / spread } else { 0.0 };
        let rotation = rotation_of(quaternion);
        let translation = sub(mean_to, scale(matrix::apply(&rotation, mean_from), scale_factor));
        Similarity { scale: scale_factor, rotation, translation }
    }

    /// The image of a point.
    pub fn apply(&self, point: Vector3) -> Vector3 {
        add(scale(matrix::apply(&self.rotation, point), self.scale), self.translation)
    }
}

/// Horn's N, from S = Σ a bᵀ: qᵀNq = Σ b·(R(q) a) for a unit quaternion q = (w, x, y, z).
fn quaternion_form(s: &Matrix3) -> [[f64; 4]; 4] {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = *s;
    [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ]
}

/// The rotation matrix of a unit quaternion (w, x, y, z).
fn rotation_of([w, x, y, z]: [f64; 4]) -> Matrix3 {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Sweeps of Jacobi's method. It converges quadratically; 4×4 matrices need about five, the rest does nothing.
const SWEEPS: usize = 12;

/// The largest eigenvalue of a symmetric matrix and its unit eigenvector, by Jacobi's rotations.
///
/// Each rotation by the angle φ in the plane of axes p and q makes element (p, q) zero: tan 2φ = 2 m_pq / (m_qq
/// − m_pp), the smaller of the two angles (Golub and Van Loan 2013, section 8.5.2).
fn largest_eigenpair(mut m: [[f64; 4]; 4]) -> (f64, [f64; 4]) {
    // Column k is the eigenvector of m[k][k] in the making.
    let mut vectors =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        for p in 0..3 {
            for q in p + 1..4 {
                if m[p][q] == 0.0 {
                    continue;
                }
                let tau = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
                let tangent = tau.signum() / (tau.abs() + tau.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let sine = tangent * cosine;
                for row in m.iter_mut().chain(&mut vectors) {
                    (row[p], row[q]) = (cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]);
                }
                for column in 0..4 {
                    let (above, below) = (m[p][column], m[q][column]);
                    m[p][column] = cosine * above - sine * below;
                    m[q][column] = sine * above + cosine * below;
                }
            }
        }
    }
    let largest = (0..4).max_by(|&a, &b| m[a][a].total_cmp(&m[b][b])).expect("four eigenvalues");
    (m[largest][largest], vectors.map(|row| row[largest]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::distance;

    const POINTS: [Vector3; 5] =
        [[0.0, 1.0, 0.2], [0.7, 0.5, 0.1], [-0.2, 0.5, 0.9], [0.3, 1.6, -0.1], [0.1, -0.4, 0.5]];

    fn assert_close(a: &Matrix3, b: &Matrix3) {
        assert!(matrix::max_abs(&matrix::sub(a, b)) < 1e-14, "{a:?} against {b:?}");
    }

    #[test]
    fn a_planted_similarity_is_found() {
        // A turn by 2π/3 about (1, 1, 1) takes x to y to z.
        let rotation = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let planted = Similarity { scale: 1.7, rotation, translation: [3.0, -2.0, 0.5] };
        let found = Similarity::aligning(&POINTS, &POINTS.map(|p| planted.apply(p)));
        assert!((found.scale - 1.7).abs() < 1e-14);
        assert_close(&found.rotation, &rotation);
        assert!(distance(found.translation, planted.translation) < 1e-13);
    }

    #[test]
    fn a_half_turn_is_found() {
        // w = 0, where formulas that divide by it fail.
        let rotation = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        let turned = POINTS.map(|p| matrix::apply(&rotation, p));
        assert_close(&Similarity::aligning(&POINTS, &turned).rotation, &rotation);
    }

    #[test]
    fn the_answer_is_a_rotation_even_for_a_mirror_image() {
        let mirrored = POINTS.map(|[x, y, z]| [-x, y, z]);
        let found = Similarity::aligning(&POINTS, &mirrored);
        assert_close(&matrix::mul(&found.rotation, &matrix::transpose(&found.rotation)), &matrix::IDENTITY);
        assert!((matrix::determinant(&found.rotation) - 1.0).abs() < 1e-14);
        assert!(POINTS.iter().zip(&mirrored).any(|(&p, &q)| distance(found.apply(p), q) > 0.1));
    }

    #[test]
    fn no_small_change_of_the_answer_is_better() {
        // Some other points; the sum of squares must have its least value at the answer.
        let target = POINTS.map(|[x, y, z]| [y * z + x, x - 0.3 * y, z * z - 0.5 * x]);
        let error = |map: &Similarity| -> f64 {
            POINTS.iter().zip(&target).map(|(&p, &q)| norm_squared(sub(map.apply(p), q))).sum()
        };
        let best = Similarity::aligning(&POINTS, &target);
        let least = error(&best);
        let small = 1e-4_f64;
        for sign in [-small, small] {
            assert!(error(&Similarity { scale: best.scale * (1.0 + sign), ..best }) > least);
            for axis in 0..3 {
                let mut translation = best.translation;
                translation[axis] += sign;
                assert!(error(&Similarity { translation, ..best }) > least);
                let mut quaternion = [sign.cos(), 0.0, 0.0, 0.0];
                quaternion[1 + axis] = sign.sin();
                // Turned about the centroid of the image, where the translation has no part in it.
                let turn = rotation_of(quaternion);
                let centre = centroid(&target);
                let rotation = matrix::mul(&turn, &best.rotation);
                let translation = add(matrix::apply(&turn, sub(best.translation, centre)), centre);
                assert!(error(&Similarity { rotation, translation, ..best }) > least);
            }
        }
    }

    #[test]
    fn points_in_one_place_go_to_the_centre() {
        let found = Similarity::aligning(&[[1.0, 2.0, 3.0]; 5], &POINTS);
        assert_eq!(found.scale, 0.0);
        assert!(distance(found.apply([1.0, 2.0, 3.0]), centroid(&POINTS)) < 1e-15);
    }

    #[test]
    fn the_eigenvector_belongs_to_its_eigenvalue() {
        let m = [[2.0, -1.0, 0.5, 0.0], [-1.0, 1.0, 0.3, -0.2], [0.5, 0.3, -3.0, 0.7], [0.0, -0.2, 0.7, 0.1]];
        let (value, vector) = largest_eigenpair(m);
        for row in 0..4 {
            let product: f64 = (0..4).map(|column| m[row][column] * vector[column]).sum();
            assert!((product - value * vector[row]).abs() < 1e-14);
        }
        assert!(value > 2.0, "at least the largest diagonal element");
        let length_squared: f64 = vector.iter().map(|x| x * x).sum();
        assert!((length_squared - 1.0).abs() < 1e-14);
    }
}

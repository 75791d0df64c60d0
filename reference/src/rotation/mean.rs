//! The mean of rotations.

use crate::linalg::matrix::{Matrix3, add, determinant, mul, scaled, transpose};
use crate::linalg::svd::{Svd3, nearest_rotation, svd3};
use crate::linalg::vector::{Vector3, centroid};

/// Where the mean matrix decides by less than this between two rotations, its rounding (10⁻¹⁶) would turn the answer by
/// more than 10⁻⁷ rad.
const UNDECIDED: f64 = 1e-9;

/// The chordal mean of rotations: the R that minimises Σ ‖R − R_i‖² (Frobenius), or `None` where there is none.
///
/// It is the rotation nearest to M = (1/n) Σ R_i: with M = U S Vᵀ, R = U diag(1, 1, det U Vᵀ) Vᵀ. It depends on the
/// rotations alone, not on how they are written: mean(A R_i B) = A mean(R_i) B, and for two rotations it lies half-way
/// on the arc between them.
///
/// There is none without rotations, or where several are equally near: s₂ + det(U Vᵀ)·s₃ = 0, as for two rotations half
/// a turn apart.
///
/// # Conventions
/// For poses of several views the thesis averages axis–angle vectors ([`arithmetic_mean`]); this is the reading taken
/// (erratum E46), because v and v − 2πv/‖v‖ are one rotation and their mean is another.
///
/// # Panics
/// If an entry is not finite.
///
/// # References
/// Moakher 2002, "Means and averaging in the group of rotations"; Hartley, Trumpf, Dai, Li 2013, "Rotation averaging"
/// (the chordal L₂ mean).
///
/// ```
/// use vitruvian_reference::rotation::{logarithm, mean, rodrigues};
/// // Two arms just beside a half turn, written with opposite axes: 0.2 rad apart.
/// let turns = [[0.0, 3.04, 0.0], [0.0, -3.04, 0.0]].map(rodrigues);
/// let between = logarithm(&mean(&turns).expect("0.2 rad apart"));
/// assert!((between[1].abs() - std::f64::consts::PI).abs() < 1e-12);
/// ```
pub fn mean(rotations: &[Matrix3]) -> Option<Matrix3> {
    let sum = rotations.iter().copied().reduce(|a, b| add(&a, &b))?;
    let average = scaled(&sum, 1.0 / rotations.len() as f64);
    let Svd3 { u, singular_values: [_, s2, s3], v } = svd3(&average);
    let handedness = determinant(&mul(&u, &transpose(&v))).signum();
    (s2 + handedness * s3 > UNDECIDED).then(|| nearest_rotation(&average))
}

/// The arithmetic mean of axis–angle vectors (1/n) Σ v_i, or `None` of none: what Li 2021, ch. 4 §3.3 prints, for
/// comparison with it.
///
/// Close to [`mean`] for rotations that differ little and stay away from a half turn; without meaning beside one, where the
/// mean of v and the equal rotation v − 2πv/‖v‖ points anywhere along v (erratum E46).
pub fn arithmetic_mean(axis_angles: &[Vector3]) -> Option<Vector3> {
    (!axis_angles.is_empty()).then(|| centroid(axis_angles))
}

#[cfg(test)]
mod tests {
    use super::super::{angle_between, logarithm, rodrigues};
    use super::*;
    use crate::linalg::matrix::{IDENTITY, diagonal, max_abs, sub};
    use crate::linalg::vector::{distance, norm, scale};
    use std::f64::consts::PI;

    #[test]
    fn the_mean_of_two_rotations_lies_half_way_between_them() {
        let (a, b) = (rodrigues([0.3, -0.2, 0.5]), rodrigues([-1.0, 0.4, 1.2]));
        let m = mean(&[a, b]).expect("less than half a turn apart");
        let whole = angle_between(&a, &b);
        assert!((angle_between(&a, &m) - 0.5 * whole).abs() < 1e-14, "{whole} rad apart");
        assert!((angle_between(&m, &b) - 0.5 * whole).abs() < 1e-14, "{whole} rad apart");
    }

    #[test]
    fn the_mean_of_one_rotation_many_times_is_that_rotation() {
        let r = rodrigues([PI - 1e-9, 0.0, 0.0]);
        assert!(max_abs(&sub(&mean(&[r; 4]).expect("one rotation"), &r)) < 1e-15);
    }

    #[test]
    fn no_mean_is_no_answer() {
        assert_eq!(mean(&[]), None, "of nothing");
        assert_eq!(arithmetic_mean(&[]), None, "of nothing");
        let r = rodrigues([0.4, 1.0, -0.3]);
        let half_turn = mul(&r, &diagonal([-1.0, -1.0, 1.0]));
        assert_eq!(mean(&[r, half_turn]), None, "half a turn apart: two arcs are equally short");
        let klein = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(diagonal);
        assert_eq!(mean(&klein), None, "their mean matrix is zero");
    }

    #[test]
    fn beside_a_half_turn_only_the_mean_of_matrices_has_a_meaning() {
        let turns = [[PI - 0.1, 0.0, 0.0], [0.1 - PI, 0.0, 0.0]];
        let between = mean(&turns.map(rodrigues)).expect("0.2 rad apart");
        assert!((norm(logarithm(&between)) - PI).abs() < 1e-14, "half-way over the half turn");
        assert_eq!(rodrigues(arithmetic_mean(&turns).expect("two")), IDENTITY, "as far off as can be");
    }

    #[test]
    fn small_rotations_have_nearly_the_arithmetic_mean() {
        let turns = [[1e-3, 2e-3, 0.0], [0.0, -1e-3, 1e-3], [-2e-3, 0.0, 1e-3]];
        let of_matrices = logarithm(&mean(&turns.map(rodrigues)).expect("close together"));
        // The difference is of third order in the angles.
        assert!(distance(of_matrices, arithmetic_mean(&turns).expect("three")) < 1e-8);
        assert_eq!(arithmetic_mean(&[scale([1.0; 3], 2.0), [0.0; 3]]), Some([1.0; 3]));
    }
}

//! Rotations of ℝ³: axis–angle vectors, matrices, the six numbers that networks regress, and means.
//!
//! An *axis–angle* vector v stands for the rotation by ‖v‖ radians about v, counter-clockwise seen from the
//! tip of v. Matrices act on columns: x ↦ R x.

use crate::linalg::matrix::{IDENTITY, Matrix3, add, apply, column, mul, scaled, sub, trace, transpose};
use crate::linalg::vector::{Vector3, dot, norm, normalize, scale};
use std::f64::consts::PI;

mod mean;
mod six_d;

pub use mean::{arithmetic_mean, mean};
pub use six_d::{from_six_d, to_six_d};

/// Below this angle (radians) the coefficients of the exponential are taken from their Taylor series.
///
/// The first omitted terms are α⁴/120 relative to 1: under 10⁻¹⁸ here, so the branch is exact in f64, while
/// the closed forms lose half of the digits to cancellation (1 − cos α ≈ α²/2).
const SMALL_ANGLE: f64 = 1e-4;

/// The matrix `[v]×` with `[v]× p = v × p`.
pub fn skew(v: Vector3) -> Matrix3 {
    [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]]
}

/// The vector v of the antisymmetric part of `m`: `vee(skew(v)) = v`.
pub fn vee(m: &Matrix3) -> Vector3 {
    [0.5 * (m[2][1] - m[1][2]), 0.5 * (m[0][2] - m[2][0]), 0.5 * (m[1][0] - m[0][1])]
}

/// (sin α)/α, (1 − cos α)/α² and (α − sin α)/α³, which are smooth and even in α.
fn exponential_coefficients(angle_rad: f64) -> [f64; 3] {
    let a2 = angle_rad * angle_rad;
    if angle_rad < SMALL_ANGLE {
        return [1.0 - a2 / 6.0, 0.5 - a2 / 24.0, 1.0 / 6.0 - a2 / 120.0];
    }
    let (sin, cos) = angle_rad.sin_cos();
    // 1 − cos α = 2 sin²(α/2) keeps its digits when α is small.
    let half = (0.5 * angle_rad).sin();
    let one_minus_cos = if cos > 0.5 { 2.0 * half * half } else { 1.0 - cos };
    // α − sin α cancels up to about α = 1: α³·(1/6 − α²/120 + …) converges fast there.
    let third = if angle_rad < 1.0 {
        let mut term = 1.0 / 6.0;
        let mut sum = term;
        for n in 2..12 {
            let k = 2.0 * f64::from(n);
            term *= -a2 / (k * (k + 1.0));
            sum += term;
        }
        sum
    } else {
        (angle_rad - sin) / (a2 * angle_rad)
    };
    [sin / angle_rad, one_minus_cos / a2, third]
}

/// The rotation matrix of an axis–angle vector (radians), by Rodrigues' formula.
///
/// R = I + (sin α)/α · `[v]×` + (1 − cos α)/α² · `[v]×`², α = ‖v‖.
///
/// # Conventions
/// Exact at and near v = 0 (Taylor branch). SMPL's common code instead adds 10⁻⁸ to every component before it
/// takes the norm, so it differs from this function by about 10⁻⁸ close to zero.
///
/// ```
/// use vitruvian_reference::rotation::rodrigues;
/// let quarter_turn = rodrigues([0.0, 0.0, std::f64::consts::FRAC_PI_2]);
/// assert!((quarter_turn[1][0] - 1.0).abs() < 1e-15); // x ↦ y
/// ```
pub fn rodrigues(axis_angle: Vector3) -> Matrix3 {
    let [s, c, _] = exponential_coefficients(norm(axis_angle));
    let k = skew(axis_angle);
    add(&IDENTITY, &add(&scaled(&k, s), &scaled(&mul(&k, &k), c)))
}

/// The axis–angle vector (radians) of a rotation matrix: the inverse of [`rodrigues`], with 0 ≤ ‖v‖ ≤ π.
///
/// With w = vee(R) = sin α · n and cos α = (tr R − 1)/2 the angle is atan2(‖w‖, cos α), accurate everywhere.
/// Below ¾π the axis is w/‖w‖. Towards π, where w vanishes, it comes from the symmetric
/// part: (R + Rᵀ)/2 = cos α I + (1 − cos α) n nᵀ, whose largest column is n up to sign, and w gives the sign.
///
/// # Conventions
/// At exactly α = π both ±n describe R; the one whose largest component is positive is returned.
///
/// # Panics
/// If `r` is not a rotation: ‖R Rᵀ − I‖_max > 10⁻⁶ or det R < 0.
pub fn logarithm(r: &Matrix3) -> Vector3 {
    let deviation = crate::linalg::matrix::max_abs(&sub(&mul(r, &transpose(r)), &IDENTITY));
    let det = crate::linalg::matrix::determinant(r);
    assert!(
        deviation <= 1e-6 && det > 0.0,
        "logarithm: not a rotation: R Rᵀ − I up to {deviation:e}, det {det}"
    );
    let w = vee(r);
    let (sin, cos) = (norm(w), 0.5 * (trace(r) - 1.0));
    let angle = sin.atan2(cos);
    if sin < SMALL_ANGLE && cos > 0.0 {
        // α/sin α = 1 + α²/6 + …
        return scale(w, 1.0 + angle * angle / 6.0);
    }
    if angle < 0.75 * PI {
        return scale(w, angle / sin);
    }
    // S − cos α I = (1 − cos α) n nᵀ; its columns are multiples of n, the one with the largest diagonal the longest.
    let symmetric = scaled(&add(r, &transpose(r)), 0.5);
    let projector = sub(&symmetric, &scaled(&IDENTITY, cos));
    let largest =
        (0..3).max_by(|&i, &j| projector[i][i].total_cmp(&projector[j][j])).expect("three diagonal entries");
    let axis = normalize(column(&projector, largest));
    let sign = if dot(axis, w) < 0.0 { -1.0 } else { 1.0 };
    scale(axis, sign * angle)
}

/// The left Jacobian of the exponential map, J_l(v), with exp(v + δ) ≈ exp(J_l(v) δ) · exp(v).
///
/// J_l(v) = I + (1 − cos α)/α² `[v]×` + (α − sin α)/α³ `[v]×`². It turns a change of the parameters into the angular
/// velocity in the outer frame: ∂(R p)/∂v_i = (J_l e_i) × (R p).
pub fn left_jacobian(axis_angle: Vector3) -> Matrix3 {
    let [_, c, d] = exponential_coefficients(norm(axis_angle));
    let k = skew(axis_angle);
    add(&IDENTITY, &add(&scaled(&k, c), &scaled(&mul(&k, &k), d)))
}

/// The three matrices ∂R/∂v_i of [`rodrigues`] at `axis_angle`.
///
/// ∂R/∂v_i = `[J_l(v) e_i]×` R; at v = 0 this is `[e_i]×`.
pub fn rodrigues_derivative(axis_angle: Vector3) -> [Matrix3; 3] {
    let (r, j) = (rodrigues(axis_angle), left_jacobian(axis_angle));
    std::array::from_fn(|i| mul(&skew(column(&j, i)), &r))
}

/// The angle (radians, 0…π) between two rotations: ‖log(Aᵀ B)‖.
pub fn angle_between(a: &Matrix3, b: &Matrix3) -> f64 {
    norm(logarithm(&mul(&transpose(a), b)))
}

/// R p for an axis–angle vector: [`rodrigues`] and a product, for callers that rotate one point.
pub fn rotate(axis_angle: Vector3, p: Vector3) -> Vector3 {
    apply(&rodrigues(axis_angle), p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::max_abs;
    use crate::linalg::vector::{add as plus, add_scaled, distance};

    fn assert_close(a: &Matrix3, b: &Matrix3, bound: f64) {
        assert!(max_abs(&sub(a, b)) <= bound, "{a:?}\nagainst {b:?}");
    }

    #[test]
    fn rodrigues_golden() {
        // Computed once in plain double precision by an independent script, nine digits kept.
        let golden = [
            [0.859533899, -0.497991537, -0.114916954],
            [0.439867633, 0.835315605, -0.329794338],
            [0.260226714, 0.232921164, 0.937032437],
        ];
        assert_close(&rodrigues([0.3, -0.2, 0.5]), &golden, 5e-10);
    }

    #[test]
    fn rotating_by_zero_is_identity() {
        assert_eq!(rodrigues([0.0; 3]), IDENTITY);
        assert_eq!(left_jacobian([0.0; 3]), IDENTITY);
        assert_eq!(logarithm(&IDENTITY), [0.0; 3]);
    }

    #[test]
    fn quarter_turn_about_z_takes_x_to_y() {
        assert!(distance(rotate([0.0, 0.0, PI / 2.0], [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0]) < 1e-15);
    }

    #[test]
    fn tiny_rotations_keep_their_digits_through_the_logarithm() {
        for angle in [1e-300, 1e-12, 1e-8, 9.999e-5, 1.0001e-4, 1e-3] {
            let v = scale(normalize([1.0, -2.0, 0.5]), angle);
            assert!(distance(logarithm(&rodrigues(v)), v) <= 1e-15 * angle, "angle {angle:e}");
        }
    }

    #[test]
    fn rotations_near_a_half_turn_keep_their_axis_through_the_logarithm() {
        let axis = normalize([0.2, -0.9, 0.4]);
        for gap in [1e-15, 1e-12, 1e-8, 1e-4, 0.1, 0.7, 0.8] {
            let v = scale(axis, PI - gap);
            assert!(distance(logarithm(&rodrigues(v)), v) < 1e-14, "gap {gap:e}");
        }
    }

    #[test]
    fn exact_half_turns_take_the_positive_axis() {
        for axis in 0..3 {
            let mut half_turn = scaled(&IDENTITY, -1.0);
            half_turn[axis][axis] = 1.0;
            let mut v = [0.0; 3];
            v[axis] = PI;
            assert_eq!(logarithm(&half_turn), v);
        }
    }

    #[test]
    #[should_panic(expected = "not a rotation")]
    fn reflections_have_no_logarithm() {
        logarithm(&scaled(&IDENTITY, -1.0));
    }

    #[test]
    fn coefficients_agree_where_their_branches_meet() {
        for (low, high) in [(SMALL_ANGLE, SMALL_ANGLE), (1.0, 1.0), (PI / 3.0, PI / 3.0)] {
            let below = exponential_coefficients(low * (1.0 - 1e-15));
            let above = exponential_coefficients(high * (1.0 + 1e-15));
            for k in 0..3 {
                assert!((below[k] - above[k]).abs() < 4e-15, "{low}: {below:?} {above:?}");
            }
        }
    }

    #[test]
    fn derivative_of_rodrigues_is_its_central_difference() {
        const STEP: f64 = 1e-5;
        for v in [[0.0; 3], [1e-6, -2e-6, 1e-6], [0.3, -0.2, 0.5], [2.0, 1.0, -1.5]] {
            let analytic = rodrigues_derivative(v);
            for i in 0..3 {
                let mut e = [0.0; 3];
                e[i] = STEP;
                let (above, below) = (rodrigues(plus(v, e)), rodrigues(sub_vectors(v, e)));
                let numeric = scaled(&sub(&above, &below), 0.5 / STEP);
                // Truncation STEP²/6 and rounding ε/STEP are both about 2·10⁻¹¹.
                assert_close(&analytic[i], &numeric, 1e-10);
            }
        }
    }

    fn sub_vectors(a: Vector3, b: Vector3) -> Vector3 {
        add_scaled(a, b, -1.0)
    }

    #[test]
    fn left_jacobian_composes_small_rotations() {
        let (v, delta) = ([0.4, -1.1, 0.7], [2e-6, 1e-6, -3e-6]);
        let composed = mul(&rodrigues(apply(&left_jacobian(v), delta)), &rodrigues(v));
        // The neglected term is of order ‖δ‖² ≈ 10⁻¹¹.
        assert_close(&rodrigues(plus(v, delta)), &composed, 5e-11);
    }
}

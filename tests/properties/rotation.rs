//! Laws of rotations: the exponential, its logarithm, its derivative, and the six-number representation.

use approx::abs_diff_eq;
use proptest::prelude::*;
use std::f64::consts::PI;
use vitruvian_reference::linalg::matrix::{
    IDENTITY, Matrix3, apply, determinant, max_abs, mul, sub, transpose,
};
use vitruvian_reference::linalg::svd::nearest_rotation;
use vitruvian_reference::linalg::vector::{Vector3, add, distance, norm, normalize, scale};
use vitruvian_reference::rotation::{
    angle_between, from_six_d, left_jacobian, logarithm, rodrigues, to_six_d,
};

/// Unit vectors, uniform enough: directions of points of a cube that are not too near to its centre.
fn axis() -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-1.0..1.0f64)
        .prop_filter_map("a direction", |v| (norm(v) > 0.1).then(|| normalize(v)))
}

/// Angles over the whole range with the corners over-represented: sizes down to 10⁻¹² from 0 and from π.
fn angle() -> impl Strategy<Value = f64> {
    prop_oneof![
        0.0..PI,
        (-12.0..0.0f64).prop_map(|e| 10f64.powf(e)),
        (-12.0..0.0f64).prop_map(|e| PI - 10f64.powf(e))
    ]
}

fn axis_angle() -> impl Strategy<Value = Vector3> {
    (axis(), angle()).prop_map(|(axis, angle)| scale(axis, angle))
}

fn difference(a: &Matrix3, b: &Matrix3) -> f64 {
    max_abs(&sub(a, b))
}

proptest! {
    #[test]
    fn rotations_are_orthonormal(v in axis_angle()) {
        let r = rodrigues(v);
        prop_assert!(difference(&mul(&r, &transpose(&r)), &IDENTITY) < 2e-15);
        prop_assert!(abs_diff_eq!(determinant(&r), 1.0, epsilon = 2e-15));
    }

    #[test]
    fn opposite_vectors_give_inverse_rotations(v in axis_angle()) {
        prop_assert!(difference(&rodrigues(scale(v, -1.0)), &transpose(&rodrigues(v))) < 1e-15);
    }

    #[test]
    fn rotations_fix_their_axis(v in axis_angle()) {
        prop_assert!(distance(apply(&rodrigues(v), v), v) <= 2e-15 * norm(v));
    }

    #[test]
    fn whole_turns_change_nothing(axis in axis(), angle in 0.1..PI) {
        prop_assert!(difference(&rodrigues(scale(axis, angle + 2.0 * PI)), &rodrigues(scale(axis, angle))) < 1e-14);
    }

    #[test]
    fn logarithm_undoes_the_exponential(v in axis_angle()) {
        let back = logarithm(&rodrigues(v));
        // Rounding may carry an angle beside π over it, where the vector of the same rotation points the other way.
        let other = scale(normalize(add(v, [f64::MIN_POSITIVE; 3])), norm(v) - 2.0 * PI);
        prop_assert!(distance(back, v).min(distance(back, other)) < 1e-14, "{v:?} came back as {back:?}");
    }

    #[test]
    fn exponential_undoes_the_logarithm(v in axis_angle(), w in axis_angle()) {
        let r = mul(&rodrigues(v), &rodrigues(w));
        prop_assert!(difference(&rodrigues(logarithm(&r)), &r) < 4e-15);
    }

    #[test]
    fn left_jacobian_is_the_angular_velocity(v in axis_angle(), i in 0..3usize) {
        const STEP: f64 = 1e-5;
        let mut e = [0.0; 3];
        e[i] = STEP;
        let step = mul(&rodrigues(add(v, e)), &transpose(&rodrigues(add(v, scale(e, -1.0)))));
        let velocity = scale(logarithm(&step), 0.5 / STEP);
        let j = left_jacobian(v);
        // Truncation is of order STEP², rounding ε/STEP.
        prop_assert!(distance(velocity, [j[0][i], j[1][i], j[2][i]]) < 5e-10);
    }

    #[test]
    fn six_numbers_carry_a_rotation(v in axis_angle()) {
        let r = rodrigues(v);
        prop_assert!(difference(&from_six_d(&to_six_d(&r)), &r) < 4e-15);
    }

    #[test]
    fn any_six_numbers_make_a_rotation(a in axis(), b in axis(), stretch in 0.01..100.0f64) {
        prop_assume!(norm(vitruvian_reference::linalg::vector::cross(a, b)) > 1e-3);
        let r = from_six_d(&[stretch * a[0], b[0], stretch * a[1], b[1], stretch * a[2], b[2]]);
        prop_assert!(difference(&mul(&transpose(&r), &r), &IDENTITY) < 1e-12);
        prop_assert!(abs_diff_eq!(determinant(&r), 1.0, epsilon = 1e-12));
        prop_assert!(distance([r[0][0], r[1][0], r[2][0]], a) < 1e-14, "the first column keeps its direction");
    }

    #[test]
    fn angle_between_is_left_invariant(u in axis_angle(), v in axis_angle(), w in axis_angle()) {
        let (u, v, w) = (rodrigues(u), rodrigues(v), rodrigues(w));
        prop_assert!(abs_diff_eq!(angle_between(&mul(&u, &v), &mul(&u, &w)), angle_between(&v, &w), epsilon = 1e-7));
    }

    #[test]
    fn nearest_rotation_is_at_least_as_near_as_any_other(
        m in prop::array::uniform3(prop::array::uniform3(-2.0..2.0f64)),
        v in axis_angle(),
    ) {
        let frobenius = |r: &Matrix3| sub(r, &m).iter().flatten().map(|x| x * x).sum::<f64>();
        let nearest = nearest_rotation(&m);
        prop_assert!(abs_diff_eq!(determinant(&nearest), 1.0, epsilon = 1e-12));
        prop_assert!(frobenius(&nearest) <= frobenius(&rodrigues(v)) + 1e-12);
    }
}

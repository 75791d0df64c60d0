//! Laws of rotations: the exponential, its logarithm, its derivative, and the six-number representation.

use approx::abs_diff_eq;
use proptest::prelude::*;
use std::f64::consts::PI;
use vitruvian_reference::linalg::matrix::{
    IDENTITY, Matrix3, apply, determinant, max_abs, mul, sub, transpose,
};
use vitruvian_reference::linalg::svd::nearest_rotation;
use vitruvian_reference::linalg::vector::{Vector3, add, cross, distance, dot, norm, normalize, scale};
use vitruvian_reference::rotation::{
    angle_between, from_six_d, left_jacobian, logarithm, mean, rodrigues, to_six_d,
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

/// Angles at and beside 0 and π, down to the last digit and below, and any between.
fn hard_angle() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(PI),
        (-320.0..0.0f64).prop_map(|e| 10f64.powf(e)),
        (-9.0..-3.0f64).prop_map(|e| 10f64.powf(e)),
        (-9.0..-3.0f64).prop_map(|e| PI - 10f64.powf(e)),
        (-17.0..0.0f64).prop_map(|e| PI - 10f64.powf(e)),
        0.0..PI
    ]
}

/// Axes in general position, along a coordinate axis, in a coordinate plane, and all but.
fn hard_axis() -> impl Strategy<Value = Vector3> {
    let component = || {
        prop_oneof![
            Just(0.0),
            Just(1.0),
            Just(-1.0),
            -1.0..1.0f64,
            (-200.0..-6.0f64).prop_map(|e| 10f64.powf(e))
        ]
    };
    [component(), component(), component()]
        .prop_filter_map("a direction", |v| (norm(v) > 0.1).then(|| normalize(v)))
}

fn hard_axis_angle() -> impl Strategy<Value = Vector3> {
    (hard_axis(), hard_angle()).prop_map(|(axis, angle)| scale(axis, angle))
}

/// Exponents of ten for the lengths of columns.
fn power() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), -150.0..150.0f64]
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
        prop_assert!(difference(&from_six_d(&to_six_d(&r)).expect("a rotation"), &r) < 4e-15);
    }

    #[test]
    fn six_numbers_to_matrix_to_axis_angle_and_back_closes(v in hard_axis_angle(), p in power(), q in power()) {
        let r = rodrigues(v);
        let (p, q) = (10f64.powf(p), 10f64.powf(q));
        let scaled = [p * r[0][0], q * r[0][1], p * r[1][0], q * r[1][1], p * r[2][0], q * r[2][1]];
        let six = from_six_d(&scaled).expect("two directions");
        prop_assert!(difference(&six, &r) < 4e-15, "lengths {p:e} and {q:e} turn {r:?} into {six:?}");
        let back = rodrigues(logarithm(&six));
        prop_assert!(difference(&back, &six) < 4e-15, "{v:?} came back as {:?}", logarithm(&six));
        let again = from_six_d(&to_six_d(&back)).expect("a rotation");
        prop_assert!(difference(&again, &r) < 1e-14, "{again:?} for {r:?}");
    }

    #[test]
    fn any_six_numbers_make_a_rotation_or_none(a in axis(), off in axis(), angle in hard_angle(), p in power(), q in power()) {
        // The second column lies at `angle` from the first: parallel and opposite within rounding at the ends.
        let turn = normalize(add(cross(a, off), [1e-300; 3]));
        let b = apply(&rodrigues(scale(turn, angle)), a);
        let (p, q) = (10f64.powf(p), 10f64.powf(q));
        match from_six_d(&[p * a[0], q * b[0], p * a[1], q * b[1], p * a[2], q * b[2]]) {
            None => prop_assert!(angle.sin() < 2e-12, "columns {angle} rad apart are two directions"),
            Some(r) => {
                prop_assert!(angle.sin() > 0.5e-12, "columns {angle} rad apart are one direction");
                prop_assert!(difference(&mul(&transpose(&r), &r), &IDENTITY) < 2e-15);
                prop_assert!(abs_diff_eq!(determinant(&r), 1.0, epsilon = 2e-15));
                prop_assert!(distance([r[0][0], r[1][0], r[2][0]], a) < 1e-15, "the first column keeps its direction");
                let second = [r[0][1], r[1][1], r[2][1]];
                prop_assert!(dot(second, b) > 0.0 || angle.sin() < 1e-9, "the second leans as it was given");
                prop_assert!(difference(&rodrigues(logarithm(&r)), &r) < 1e-14);
            }
        }
    }

    #[test]
    fn the_mean_turns_with_its_rotations(
        rotations in prop::collection::vec(axis_angle(), 1..6),
        before in axis_angle(),
        after in axis_angle(),
    ) {
        let rotations: Vec<Matrix3> = rotations.into_iter().map(rodrigues).collect();
        let (before, after) = (rodrigues(before), rodrigues(after));
        let turned: Vec<Matrix3> = rotations.iter().map(|r| mul(&mul(&after, r), &before)).collect();
        if let (Some(m), Some(turned)) = (mean(&rotations), mean(&turned)) {
            // Means that are nearly undecided lose digits to the rounding of the turned rotations.
            prop_assert!(difference(&turned, &mul(&mul(&after, &m), &before)) < 1e-6);
        }
    }

    #[test]
    fn the_mean_is_at_least_as_near_as_any_other(
        rotations in prop::collection::vec(axis_angle(), 1..6),
        other in axis_angle(),
    ) {
        let rotations: Vec<Matrix3> = rotations.into_iter().map(rodrigues).collect();
        let spread = |m: &Matrix3| -> f64 {
            rotations.iter().map(|r| sub(r, m).iter().flatten().map(|x| x * x).sum::<f64>()).sum()
        };
        let m = mean(&rotations);
        prop_assume!(m.is_some());
        prop_assert!(m.is_some_and(|m| spread(&m) <= spread(&rodrigues(other)) + 1e-12));
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

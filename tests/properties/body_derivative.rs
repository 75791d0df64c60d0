//! Laws of the body's derivatives: each is its central difference, in ordinary poses and in the corners.

use crate::bodies::{Named, betas, bodies, pose};
use proptest::prelude::*;
use proptest::sample::Index;
use vitruvian_reference::body::hinge::Hinge;
use vitruvian_reference::linalg::dense::Dense;
use vitruvian_reference::linalg::vector::{Vector3, cross, distance, dot, norm, scale, sub};
use vitruvian_reference::rotation::rotate;

const STEP: f64 = 1e-5;
/// Truncation is h²/6 times a third derivative, a few times the length of the body at most, 10⁻¹⁰; rounding is ε/h times a
/// coordinate and the sums behind it, 10⁻¹⁰ too.
const BOUND: f64 = 2e-9;

fn offsets(named: &Named, seed: f64) -> Vec<Vector3> {
    (0..named.body.vertex_count())
        .map(|i| std::array::from_fn(|a| 0.02 * (seed + (3 * i + a) as f64).sin()))
        .collect()
}

fn chosen(named: &Named, picks: &[Index]) -> Vec<usize> {
    picks.iter().map(|p| p.index(named.body.vertex_count())).collect()
}

/// The entry where `analytic` is furthest from central differences of `f` about `x`.
fn worst(analytic: &Dense, x: &[f64], f: impl Fn(&[f64]) -> Vec<Vector3>) -> f64 {
    assert_eq!(analytic.columns(), x.len(), "one column for each parameter");
    let at = |n: usize, step: f64| {
        let mut y = x.to_vec();
        y[n] += step;
        f(&y).concat()
    };
    let error = |n: usize| {
        let (above, below) = (at(n, STEP), at(n, -STEP));
        assert_eq!(above.len(), analytic.rows(), "one row for each coordinate");
        let entry = |row: usize| (analytic[(row, n)] - (above[row] - below[row]) / (2.0 * STEP)).abs();
        (0..above.len()).map(entry).fold(0.0, f64::max)
    };
    (0..x.len()).map(error).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn skeleton_has_the_joints_of_the_mesh(pose in pose(), betas in betas()) {
        for Named { name, body, skeleton } in bodies() {
            let (alone, with_mesh) = (skeleton.posed_joints(&pose, &betas), body.pose(&pose, &betas, [0.0; 3]).joints);
            for (a, b) in alone.iter().zip(with_mesh) {
                prop_assert!(distance(*a, b) < 1e-12, "{name}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn joint_derivatives_are_central_differences(pose in pose(), betas in betas()) {
        for Named { name, skeleton, .. } in bodies() {
            let d = skeleton.joint_derivatives(&pose, &betas);
            let by_pose = worst(&d.by_pose, &pose, |pose| skeleton.posed_joints(pose, &betas));
            let by_betas = worst(&d.by_betas, &betas, |betas| skeleton.posed_joints(&pose, betas));
            prop_assert!(by_pose < BOUND && by_betas < BOUND, "{name}: {by_pose:e} {by_betas:e}");
        }
    }

    #[test]
    fn vertex_derivatives_are_central_differences(
        pose in pose(),
        betas in betas(),
        seed in 0.0..6.0f64,
        picks in prop::collection::vec(any::<Index>(), 6),
    ) {
        for named in bodies() {
            let Named { name, body, skeleton } = named;
            let (offsets, chosen) = (offsets(named, seed), chosen(named, &picks));
            let positions = |pose: &[f64], betas: &[f64], offsets: &[Vector3]| -> Vec<Vector3> {
                let held = body.at_pose(skeleton, pose, betas, offsets, [0.0; 3]);
                chosen.iter().map(|&i| held.position(i)).collect()
            };
            let d = body.at_pose(skeleton, &pose, &betas, &offsets, [0.0; 3]).vertex_derivatives(&chosen);
            let by_pose = worst(&d.by_pose, &pose, |pose| positions(pose, &betas, &offsets));
            let by_betas = worst(&d.by_betas, &betas, |betas| positions(&pose, betas, &offsets));
            prop_assert!(by_pose < BOUND && by_betas < BOUND, "{name}, {chosen:?}: {by_pose:e} {by_betas:e}");

            for (n, &i) in chosen.iter().enumerate() {
                let by_offset = Dense::new(3, 3, d.by_offset[n].concat());
                let error = worst(&by_offset, &offsets[i], |offset| {
                    let mut moved = offsets.clone();
                    moved[i].copy_from_slice(offset);
                    vec![positions(&pose, &betas, &moved)[n]]
                });
                prop_assert!(error < BOUND, "{name}, vertex {i}: {error:e}");
            }
        }
    }

    #[test]
    fn unposing_takes_posed_vertices_back_to_rest(
        pose in pose(),
        betas in betas(),
        seed in 0.0..6.0f64,
        trans in prop::array::uniform3(-3.0..3.0f64),
        picks in prop::collection::vec(any::<Index>(), 20),
    ) {
        for named in bodies() {
            let Named { name, body, skeleton } = named;
            let offsets = offsets(named, seed);
            let posed = body.pose_with_offsets(&pose, &betas, &offsets, trans);
            let held = body.at_pose(skeleton, &pose, &betas, &offsets, trans);
            for i in chosen(named, &picks) {
                prop_assert!(distance(held.position(i), posed.vertices[i]) < 1e-13, "{name}, vertex {i}");
                // Where joints turn against each other by nearly a half turn there may be no way back.
                if let Some(unpose) = held.unposing(i) {
                    let error = distance(unpose.apply(posed.vertices[i]), held.shaped(i));
                    let stretch = unpose.linear.iter().map(|row| norm(*row)).fold(1.0, f64::max);
                    prop_assert!(error < 2e-14 * stretch, "{name}, vertex {i}: {error:e}, stretched {stretch}");
                }
            }
        }
    }
}

/// Which way a small bend moves the joint after `hinge`.
fn bend_moves(named: &Named, hinge: &Hinge, after: usize) -> Vector3 {
    let rest = &named.skeleton.template;
    let lower = sub(rest[after], rest[hinge.joint]);
    sub(rotate(scale(hinge.axis, 0.05), lower), lower)
}

#[test]
fn elbows_bend_forward_and_knees_backward_on_every_body() {
    for named in bodies() {
        let hinges = named.skeleton.hinges().map(|h| h.expect("arms that hang, legs that stand"));
        for (hinge, (before, after, forward)) in
            hinges.iter().zip([(16, 20, 1.0), (17, 21, 1.0), (1, 7, -1.0), (2, 8, -1.0)])
        {
            let upper = sub(named.skeleton.template[hinge.joint], named.skeleton.template[before]);
            assert!((norm(hinge.axis) - 1.0).abs() < 1e-15);
            assert!(dot(upper, hinge.axis).abs() < 0.35 * norm(upper), "{}: {hinge:?}", named.name);
            assert!(forward * bend_moves(named, hinge, after)[2] > 0.0, "{}: {hinge:?}", named.name);
        }
        // Left and right are mirror images: of an axis, the reflection in x keeps the x component.
        for [left, right] in [[hinges[0], hinges[1]], [hinges[2], hinges[3]]] {
            let mirrored = [right.axis[0], -right.axis[1], -right.axis[2]];
            assert!(distance(left.axis, mirrored) < 1e-3, "{}: {left:?} {right:?}", named.name);
            assert!((left.rest_flexion_rad - right.rest_flexion_rad).abs() < 1e-3, "{}", named.name);
        }
    }
}

#[test]
fn bent_elbows_of_an_a_pose_are_found_and_its_straight_knees_are_those_of_smpl() {
    let Some(Named { skeleton, .. }) = bodies().iter().find(|b| b.name == "mh24") else { return };
    let [elbow, _, knee, _] = skeleton.hinges().map(|h| h.expect("a hinge"));
    // Its makers say: arms about 45° down, elbows bent forward by about 42°.
    assert!((elbow.rest_flexion_rad.to_degrees() - 42.0).abs() < 1.0, "{elbow:?}");
    let lowered = cross([1.0, -1.0, 0.0], [0.0, 0.0, 1.0]);
    assert!(dot(elbow.axis, lowered) / norm(lowered) > 5f64.to_radians().cos(), "{elbow:?}");
    assert_eq!((knee.axis, knee.rest_flexion_rad), ([1.0, 0.0, 0.0], 0.0));
}

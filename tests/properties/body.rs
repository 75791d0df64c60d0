//! Laws of the body model, on the mannequin.

use crate::bodies::{self, Named};
use crate::plain_body::plain_pose;
use proptest::prelude::*;
use std::f64::consts::TAU;
use std::sync::OnceLock;
use vitruvian_reference::body::mannequin::MIRRORED_JOINT;
use vitruvian_reference::body::{BodyModel, mannequin};
use vitruvian_reference::linalg::matrix::mul;
use vitruvian_reference::linalg::vector::{Vector3, add, distance, lerp, norm, scale, sub};
use vitruvian_reference::rotation::{logarithm, rodrigues};

fn body() -> &'static BodyModel {
    static BODY: OnceLock<BodyModel> = OnceLock::new();
    BODY.get_or_init(mannequin)
}

fn pose() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.2..1.2f64, 72)
}

fn betas() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-2.5..2.5f64, 10)
}

fn trans() -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-3.0..3.0f64)
}

fn furthest(a: &[Vector3], b: &[Vector3]) -> f64 {
    assert_eq!(a.len(), b.len(), "two bodies of one model");
    a.iter().zip(b).map(|(a, b)| distance(*a, *b)).fold(0.0, f64::max)
}

fn mirrored(v: Vector3) -> Vector3 {
    [-v[0], v[1], v[2]]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn zero_pose_is_the_shaped_template(betas in betas()) {
        let posed = body().pose(&[0.0; 72], &betas, [0.0; 3]);
        for (i, v) in posed.vertices.iter().enumerate() {
            let shaped: Vector3 = std::array::from_fn(|axis| {
                let row = &body().shapedirs[(3 * i + axis) * 10..][..10];
                body().v_template[i][axis] + row.iter().zip(&betas).map(|(d, b)| d * b).sum::<f64>()
            });
            prop_assert!(distance(*v, shaped) < 1e-14);
        }
        prop_assert!(furthest(&posed.joints, &body().rest_joints(&betas)) < 1e-14);
    }

    #[test]
    fn shape_is_linear_at_rest(a in betas(), b in betas(), t in -1.0..2.0f64) {
        let mixed: Vec<f64> = a.iter().zip(&b).map(|(a, b)| (1.0 - t) * a + t * b).collect();
        let at = |betas: &[f64]| body().pose(&[0.0; 72], betas, [0.0; 3]).vertices;
        let blended: Vec<Vector3> = at(&a).iter().zip(at(&b)).map(|(a, b)| lerp(*a, b, t)).collect();
        prop_assert!(furthest(&at(&mixed), &blended) < 1e-14);
    }

    #[test]
    fn translation_moves_everything_alike(pose in pose(), betas in betas(), trans in trans()) {
        let (here, there) = (body().pose(&pose, &betas, [0.0; 3]), body().pose(&pose, &betas, trans));
        let moved = |points: &[Vector3]| -> Vec<Vector3> { points.iter().map(|p| add(*p, trans)).collect() };
        prop_assert!(furthest(&moved(&here.vertices), &there.vertices) < 1e-14);
        prop_assert!(furthest(&moved(&here.joints), &there.joints) < 1e-14);
    }

    #[test]
    fn root_turns_the_whole_body_about_the_pelvis(pose in pose(), betas in betas(), turn in prop::array::uniform3(-2.0..2.0f64)) {
        let r = rodrigues(turn);
        let mut turned = pose.clone();
        turned[..3].copy_from_slice(&logarithm(&mul(&r, &rodrigues([pose[0], pose[1], pose[2]]))));
        let (before, after) = (body().pose(&pose, &betas, [0.0; 3]), body().pose(&turned, &betas, [0.0; 3]));
        let pelvis = before.joints[0];
        let rotate = |p: &Vector3| add(pelvis, vitruvian_reference::linalg::matrix::apply(&r, sub(*p, pelvis)));
        prop_assert!(furthest(&before.vertices.iter().map(rotate).collect::<Vec<_>>(), &after.vertices) < 1e-13);
        prop_assert!(furthest(&before.joints.iter().map(rotate).collect::<Vec<_>>(), &after.joints) < 1e-13);
    }

    #[test]
    fn bones_keep_their_length_in_every_pose(pose in pose(), betas in betas()) {
        let (posed, rest) = (body().pose(&pose, &betas, [0.0; 3]).joints, body().rest_joints(&betas));
        for (child, parent) in body().parents.iter().enumerate() {
            if let Some(parent) = *parent {
                let change = distance(posed[child], posed[parent]) - distance(rest[child], rest[parent]);
                prop_assert!(change.abs() < 1e-14, "bone {parent}–{child}");
            }
        }
    }

    #[test]
    fn a_joint_moves_only_what_hangs_on_it(pose in pose(), joint in 1..24usize, turn in prop::array::uniform3(-1.0..1.0f64)) {
        let mut other = pose.clone();
        other[3 * joint..3 * joint + 3].copy_from_slice(&turn);
        let (a, b) = (body().pose(&pose, &[], [0.0; 3]), body().pose(&other, &[], [0.0; 3]));
        let hangs = |mut j: usize| loop {
            if j == joint {
                return true;
            }
            match body().parents[j] {
                Some(parent) => j = parent,
                None => return false,
            }
        };
        for (i, (v, w)) in a.vertices.iter().zip(&b.vertices).enumerate() {
            if (0..24).all(|j| body().lbs_weights[24 * i + j] == 0.0 || !hangs(j)) {
                prop_assert!(v == w, "vertex {i} moved with joint {joint}");
            }
        }
    }

    #[test]
    fn mirrored_poses_make_mirrored_bodies(pose in pose(), betas in betas()) {
        // Reflecting in x keeps the x component of a rotation vector and turns the other two round.
        let mut reflected = vec![0.0; 72];
        for j in 0..24 {
            let m = 3 * MIRRORED_JOINT[j];
            reflected[m] = pose[3 * j];
            reflected[m + 1] = -pose[3 * j + 1];
            reflected[m + 2] = -pose[3 * j + 2];
        }
        let (a, b) = (body().pose(&pose, &betas, [0.0; 3]), body().pose(&reflected, &betas, [0.0; 3]));
        let joints: Vec<Vector3> = (0..24).map(|j| mirrored(a.joints[MIRRORED_JOINT[j]])).collect();
        prop_assert!(furthest(&joints, &b.joints) < 1e-13);
        // Vertices are not listed by pairs; the same points in another order have the same extremes along any direction.
        for direction in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, -0.5, 0.8], [-0.7, 0.2, 0.1]] {
            let reach = |points: &[Vector3], d: Vector3| {
                points.iter().map(|p| p[0] * d[0] + p[1] * d[1] + p[2] * d[2]).fold(f64::NEG_INFINITY, f64::max)
            };
            let difference = reach(&a.vertices, direction) - reach(&b.vertices, mirrored(direction));
            prop_assert!(difference.abs() < 1e-12, "{difference:e}");
        }
    }
}

proptest! {
    // Each case poses every body twice, one of them large.
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn forward_model_is_the_plain_one_in_every_corner(pose in bodies::pose(), betas in betas(), trans in trans()) {
        for Named { name, body, .. } in bodies::bodies() {
            let (posed, plain) = (body.pose(&pose, &betas, trans), plain_pose(body, &pose, &betas, trans));
            prop_assert!(furthest(&posed.vertices, &plain.vertices) < 1e-13, "{name}");
            prop_assert!(furthest(&posed.joints, &plain.joints) < 1e-13, "{name}");
        }
    }

    #[test]
    fn whole_turns_change_nothing(pose in bodies::pose(), betas in betas(), turns in prop::collection::vec(-2..=2i32, 24)) {
        // θ and θ + 2π m n are one rotation, whether the turn is small, about π, or beyond 2π.
        let mut further = pose.clone();
        for (vector, m) in further.chunks_exact_mut(3).zip(turns) {
            let angle = norm([vector[0], vector[1], vector[2]]);
            if angle > 0.0 {
                vector.iter_mut().for_each(|x| *x *= 1.0 + f64::from(m) * TAU / angle);
            }
        }
        for Named { name, body, .. } in bodies::bodies() {
            let (once, again) = (body.pose(&pose, &betas, [0.0; 3]), body.pose(&further, &betas, [0.0; 3]));
            prop_assert!(furthest(&once.vertices, &again.vertices) < 1e-12, "{name}");
            prop_assert!(furthest(&once.joints, &again.joints) < 1e-12, "{name}");
        }
    }

    #[test]
    fn small_turns_move_the_body_by_their_derivative(axes in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 24), betas in betas()) {
        let pose: Vec<f64> = axes.concat().iter().map(|x| 1e-4 * x).collect();
        for Named { name, body, skeleton } in bodies::bodies() {
            let chosen: Vec<usize> = (0..body.vertex_count()).step_by(101).collect();
            let rest = body.at_pose(skeleton, &[0.0; 72], &betas, &[], [0.0; 3]).vertex_derivatives(&chosen);
            let back: Vec<f64> = pose.iter().map(|x| -x).collect();
            let (there, back) = (body.pose(&pose, &betas, [0.0; 3]), body.pose(&back, &betas, [0.0; 3]));
            let first_order = rest.by_pose.apply(&pose);
            for (n, &i) in chosen.iter().enumerate() {
                let half_way = scale(sub(there.vertices[i], back.vertices[i]), 0.5);
                // What is left is of third order: (at most ten joints of 1.7·10⁻⁴ rad)³/6 times two metres.
                let error = distance(half_way, [first_order[3 * n], first_order[3 * n + 1], first_order[3 * n + 2]]);
                prop_assert!(error < 2e-9, "{name}, vertex {i}: {error:e}");
            }
        }
    }
}

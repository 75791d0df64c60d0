//! Laws of the fit of chapter 2.

use std::sync::OnceLock;

use proptest::prelude::*;
use vitruvian_reference::body::{BodyModel, mannequin};
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::{
    Extrinsics, Fit, Keypoint, KeypointSet, MultiviewSmplify, Observation, Options, View,
};
use vitruvian_reference::linalg::matrix::{apply, mul, transpose};
use vitruvian_reference::linalg::vector::{Vector3, add, distance, sub};
use vitruvian_reference::metric::joints::{mean_joint_error, pa_mpjpe};
use vitruvian_reference::rotation::rodrigues;

/// A fit takes milliseconds; more cases are for the seeds that fail.
const CASES: u32 = 24;

fn body() -> &'static BodyModel {
    static BODY: OnceLock<BodyModel> = OnceLock::new();
    BODY.get_or_init(mannequin)
}

fn fit(observation: &Observation) -> Fit {
    static FITTER: OnceLock<MultiviewSmplify> = OnceLock::new();
    let fitter = FITTER.get_or_init(|| MultiviewSmplify::new(body()).expect("SMPL's tree"));
    fitter.fit(observation, &Options::default(), None).expect("a fit")
}

/// θ of everyday poses: any heading, small turns everywhere, arms, hips and knees larger.
fn pose() -> impl Strategy<Value = Vec<f64>> {
    let small = proptest::collection::vec(-0.2f64..0.2, 72);
    let large = (-0.8f64..0.4, -0.4f64..0.8, 0.0f64..1.0, 0.0f64..1.0, -1.2f64..0.6, -0.6f64..1.2);
    (small, large, -3.1f64..3.1).prop_map(|(mut pose, (a, b, c, d, e, f), heading)| {
        pose[1] = heading;
        for (n, angle) in [(3, a), (6, b), (12, c), (15, d), (50, e), (53, f)] {
            pose[n] += angle;
        }
        pose
    })
}

fn betas() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(-1.5f64..1.5, 10)
}

/// Four cameras around the person, jittered.
fn rig() -> impl Strategy<Value = Vec<Pinhole>> {
    proptest::collection::vec((-0.2f64..0.2, -0.15f64..0.15, 3.8f64..4.3), 4).prop_map(|jitter| {
        jitter
            .iter()
            .enumerate()
            .map(|(i, &(yaw, pitch, depth))| Pinhole {
                rotation: mul(
                    &rodrigues([std::f64::consts::PI + pitch, 0.0, 0.0]),
                    &rodrigues([0.0, 1.571 * i as f64 + yaw, 0.0]),
                ),
                translation: [0.0, 0.0, depth],
                ..Pinhole::ideal(400.0, [160.0, 120.0])
            })
            .collect()
    })
}

fn joints(pose: &[f64], betas: &[f64]) -> Vec<Vector3> {
    static SKELETON: OnceLock<vitruvian_reference::body::Skeleton> = OnceLock::new();
    SKELETON.get_or_init(|| body().skeleton()).posed_joints(pose, betas)
}

/// What the cameras see of the joints, moved by a fixed pattern of up to `noise_px` pixels.
fn observe(joints: &[Vector3], cameras: &[Pinhole], extrinsics: Extrinsics, noise_px: f64) -> Observation {
    let view = |(i, camera): (usize, &Pinhole)| View {
        camera: *camera,
        keypoints: joints
            .iter()
            .enumerate()
            .map(|(k, &joint)| {
                let [u, v] = camera.project(joint).expect("in front");
                let phase = (7 * k + 31 * i) as f64;
                let pixel_px = [u + noise_px * (3.1 * phase).sin(), v + noise_px * (1.7 * phase).cos()];
                Keypoint { pixel_px, confidence: 0.3 + 0.02 * k as f64 }
            })
            .collect(),
    };
    Observation {
        views: cameras.iter().enumerate().map(view).collect(),
        keypoint_set: KeypointSet::Smpl24,
        extrinsics,
    }
}

/// Marks (u, v, confidence), 24 in a view.
fn marked(marks: &[(f64, f64, f64)], cameras: &[Pinhole], known: bool) -> Observation {
    let view = |(camera, marks): (&Pinhole, &[(f64, f64, f64)])| View {
        camera: *camera,
        keypoints: marks.iter().map(|m| Keypoint { pixel_px: [m.0, m.1], confidence: m.2 }).collect(),
    };
    Observation {
        views: cameras.iter().zip(marks.chunks_exact(24)).map(view).collect(),
        keypoint_set: KeypointSet::Smpl24,
        extrinsics: if known { Extrinsics::Known } else { Extrinsics::Unknown },
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(CASES))]

    #[test]
    fn exact_joints_of_known_cameras_are_found(pose in pose(), betas in betas(), rig in rig()) {
        let truth = joints(&pose, &betas);
        let fit = fit(&observe(&truth, &rig, Extrinsics::Known, 0.0));
        prop_assert!(mean_joint_error(&fit.joints, &truth) < 5e-5, "{} m", mean_joint_error(&fit.joints, &truth));
    }

    #[test]
    fn exact_joints_of_unknown_cameras_are_found_up_to_similarity(pose in pose(), betas in betas(), rig in rig()) {
        let truth = joints(&pose, &betas);
        let fit = fit(&observe(&truth, &rig, Extrinsics::Unknown, 0.0));
        prop_assert!(pa_mpjpe(&fit.joints, &truth) < 1e-4, "{} m", pa_mpjpe(&fit.joints, &truth));
    }

    #[test]
    fn moving_the_world_moves_the_answer(
        pose in pose(), betas in betas(), rig in rig(), turn in prop::array::uniform3(-2.0f64..2.0),
        shift in prop::array::uniform3(-3.0f64..3.0),
    ) {
        let observation = observe(&joints(&pose, &betas), &rig, Extrinsics::Known, 1.5);
        let here = fit(&observation);
        // X ↦ Q X + s, so that R X + t = (R Qᵀ)(Q X + s) + t − R Qᵀ s.
        let q = rodrigues(turn);
        let mut moved = observation.clone();
        for view in &mut moved.views {
            view.camera.rotation = mul(&view.camera.rotation, &transpose(&q));
            view.camera.translation = sub(view.camera.translation, apply(&view.camera.rotation, shift));
        }
        let there = fit(&moved);
        for (a, b) in here.joints.iter().zip(&there.joints) {
            // Both descents stop at a ten-thousandth of the energy.
            prop_assert!(distance(add(apply(&q, *a), shift), *b) < 2e-3);
        }
    }

    #[test]
    fn the_order_of_views_does_not_matter(pose in pose(), betas in betas(), rig in rig()) {
        let mut observation = observe(&joints(&pose, &betas), &rig, Extrinsics::Known, 1.5);
        let one = fit(&observation);
        observation.views.rotate_left(1);
        observation.views.swap(0, 2);
        let other = fit(&observation);
        prop_assert!(mean_joint_error(&one.joints, &other.joints) < 1e-3);
        observation.extrinsics = Extrinsics::Unknown;
        let gauge = fit(&observation);
        observation.views.swap(0, 1);
        let another = fit(&observation);
        prop_assert!(pa_mpjpe(&gauge.joints, &another.joints) < 5e-3, "{}", pa_mpjpe(&gauge.joints, &another.joints));
    }

    #[test]
    fn scaling_all_confidences_does_not_move_the_answer(
        pose in pose(), betas in betas(), rig in rig(), exponent in -3i32..4,
    ) {
        let mut observation = observe(&joints(&pose, &betas), &rig, Extrinsics::Known, 1.5);
        let one = fit(&observation);
        for keypoint in observation.views.iter_mut().flat_map(|v| &mut v.keypoints) {
            keypoint.confidence *= 2f64.powi(exponent);
        }
        let other = fit(&observation);
        // Powers of two scale without rounding.
        prop_assert_eq!(one.joints, other.joints);
    }

    #[test]
    fn scaling_the_picture_scales_the_noise_alone(pose in pose(), betas in betas(), rig in rig()) {
        let observation = observe(&joints(&pose, &betas), &rig, Extrinsics::Known, 1.5);
        let mut larger = observation.clone();
        for view in &mut larger.views {
            view.camera.focal_px = view.camera.focal_px.map(|f| 2.0 * f);
            view.camera.principal_px = view.camera.principal_px.map(|c| 2.0 * c);
            view.keypoints.iter_mut().for_each(|k| k.pixel_px = k.pixel_px.map(|x| 2.0 * x));
        }
        let (one, two) = (fit(&observation), fit(&larger));
        prop_assert!(mean_joint_error(&one.joints, &two.joints) < 1e-3);
        let ratio = two.noise_px.expect("polished") / one.noise_px.expect("polished");
        prop_assert!((ratio - 2.0).abs() < 0.1, "{ratio}");
    }

    #[test]
    fn whatever_is_marked_ends_in_a_refusal_or_in_numbers(
        marks in proptest::collection::vec((-1e3f64..1e3, -1e3f64..1e3, prop_oneof![Just(0.0), 0.0f64..2.0]), 48),
        known in any::<bool>(), rig in rig(), odd in prop::option::of((0usize..48, prop_oneof![Just(f64::NAN), Just(1e300), Just(-1.0)])),
    ) {
        let mut marks = marks;
        if let Some((at, value)) = odd {
            marks[at].0 = value;
            marks[at].2 = value.min(1.0);
        }
        let fitter = MultiviewSmplify::new(body()).expect("SMPL's tree");
        match fitter.fit(&marked(&marks, &rig, known), &Options::default(), None) {
            Err(refusal) => prop_assert!(!refusal.to_string().is_empty()),
            Ok(fit) => {
                prop_assert!(fit.joints.iter().flatten().all(|x| x.is_finite()));
                prop_assert!(fit.parameters.pose.iter().chain(&fit.parameters.betas).all(|x| x.is_finite()));
            }
        }
    }

    /// Marks in four views are twice as many numbers as a body and its cameras have; fewer might be met by somebody.
    #[test]
    fn random_marks_are_nobody(
        marks in proptest::collection::vec((-1e3f64..1e3, -1e3f64..1e3, 0.1f64..2.0), 96), known in any::<bool>(), rig in rig(),
    ) {
        let observation = marked(&marks, &rig, known);
        let fitter = MultiviewSmplify::new(body()).expect("SMPL's tree");
        if let Ok(fit) = fitter.fit(&observation, &Options::default(), None) {
            prop_assert!(!fit.verdict.is_success(), "{} {:?}", fit.verdict, fit.views);
        }
    }
}

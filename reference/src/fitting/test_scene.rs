//! The mannequin in a planted pose, seen by a ring of cameras.

use super::keypoint_set::{BodyPoint, KeypointSet};
use super::{Extrinsics, Keypoint, MultiviewSmplify, Observation, View};
use crate::body::{BodyModel, mannequin};
use crate::camera::Pinhole;
use crate::linalg::matrix::mul;
use crate::linalg::vector::{Vector3, add_scaled, sub};
use crate::rotation::rodrigues;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Building takes a tenth of a second: the tests share one.
pub fn body() -> &'static BodyModel {
    static BODY: OnceLock<BodyModel> = OnceLock::new();
    BODY.get_or_init(mannequin)
}

pub fn fitter() -> &'static MultiviewSmplify<'static> {
    static FITTER: OnceLock<MultiviewSmplify> = OnceLock::new();
    FITTER.get_or_init(|| MultiviewSmplify::new(body()).expect("SMPL's tree"))
}

/// The mannequin cut down to as many vertices as SMPL has, so that keypoints on vertices have a point.
pub fn body_of_smpl_size() -> BodyModel {
    let (body, v) = (body(), super::keypoint_set::SMPL_VERTEX_COUNT);
    let all = body.vertex_count();
    let (j, b, p) = (body.joint_count(), body.beta_count(), body.pose_feature_count());
    let j_regressor = body.j_regressor.chunks_exact(all).flat_map(|row| {
        let sum: f64 = row[..v].iter().sum();
        // A joint whose vertices are all cut off hangs on one that is left.
        (0..v).map(move |i| if sum > 0.1 { row[i] / sum } else { f64::from(u8::from(i == 0)) })
    });
    BodyModel {
        v_template: body.v_template[..v].to_vec(),
        faces: Vec::new(),
        shapedirs: body.shapedirs[..3 * v * b].to_vec(),
        posedirs: body.posedirs[..3 * v * p].to_vec(),
        j_regressor: j_regressor.collect(),
        lbs_weights: body.lbs_weights[..v * j].to_vec(),
        parents: body.parents.clone(),
    }
}

/// Cameras 4 m from the origin, 80° apart, 320×240, f = 400 px, slightly raised and rolled.
pub fn ring(count: usize) -> Vec<Pinhole> {
    (0..count)
        .map(|i| {
            let around = rodrigues([0.0, 1.4 * i as f64 + 0.3, 0.0]);
            let upright = rodrigues([PI - 0.1 * i as f64, 0.0, 0.02]);
            Pinhole {
                rotation: mul(&upright, &around),
                translation: [0.05, -0.1, 4.0 + 0.1 * i as f64],
                ..Pinhole::ideal(400.0, [160.0, 120.0])
            }
        })
        .collect()
}

/// A person: pose, shape, place.
pub struct Person {
    pub pose: Vec<f64>,
    pub betas: Vec<f64>,
    pub trans: Vector3,
}

/// A walking pose with a raised arm, facing anywhere; `seed` varies it.
pub fn person(seed: u32) -> Person {
    let wave = |n: usize| (1.7 * f64::from(seed) + 2.3 * n as f64).sin();
    let mut pose: Vec<f64> = (0..72).map(|n| 0.12 * wave(n)).collect();
    pose[..3].copy_from_slice(&[0.05, 3.0 * wave(1), 0.08]);
    // Hips, knees, shoulders, elbows.
    for (n, angle) in
        [(3, -0.5), (6, 0.3), (12, 0.6), (15, 0.4), (50, -0.9), (53, 0.7), (55, -0.8), (58, 0.5)]
    {
        pose[n] += angle;
    }
    let betas = (0..10).map(|l| 0.9 * wave(l + 100)).collect();
    Person { pose, betas, trans: [0.1 * wave(3), 0.2, 0.1 * wave(4)] }
}

/// The person's posed joints.
pub fn joints(person: &Person) -> Vec<Vector3> {
    fitter()
        .skeleton()
        .posed_joints(&person.pose, &person.betas)
        .into_iter()
        .map(|p| add_scaled(p, person.trans, 1.0))
        .collect()
}

/// What the cameras see of the person's 24 joints.
pub fn observe(person: &Person, cameras: &[Pinhole], extrinsics: Extrinsics) -> Observation {
    let joints = joints(person);
    let view = |camera: &Pinhole| View {
        camera: *camera,
        keypoints: joints
            .iter()
            .map(|&joint| Keypoint { pixel_px: camera.project(joint).expect("in front"), confidence: 1.0 })
            .collect(),
    };
    Observation { views: cameras.iter().map(view).collect(), keypoint_set: KeypointSet::Smpl24, extrinsics }
}

/// What they see of the keypoints of another set, by the set's own joints; points on vertices are not found.
pub fn observe_set(person: &Person, cameras: &[Pinhole], set: KeypointSet) -> Observation {
    let joints = joints(person);
    let points = set.on_body(body());
    let view = |camera: &Pinhole| View {
        camera: *camera,
        keypoints: points
            .iter()
            .map(|point| match point.as_ref().map(|p| &p.point) {
                Some(BodyPoint::Joints(from)) => Keypoint {
                    pixel_px: camera.project(joints[from[0].0]).expect("in front"),
                    confidence: 1.0,
                },
                _ => Keypoint { pixel_px: [0.0; 2], confidence: 0.0 },
            })
            .collect(),
    };
    Observation {
        views: cameras.iter().map(view).collect(),
        keypoint_set: set,
        extrinsics: Extrinsics::Known,
    }
}

/// Moves every mark by normal noise of this many pixels, the same for the same seed.
pub fn add_noise(observation: &mut Observation, noise_px: f64, seed: u64) {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    };
    for keypoint in observation.views.iter_mut().flat_map(|v| &mut v.keypoints) {
        for x in &mut keypoint.pixel_px {
            let (u, v) = (uniform(), uniform());
            *x += noise_px * (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos();
        }
    }
}

/// The person's joints in the frame of view 0.
pub fn joints_in_view_0(person: &Person, cameras: &[Pinhole]) -> Vec<Vector3> {
    joints(person).into_iter().map(|p| cameras[0].to_camera(p)).collect()
}

/// The largest distance between corresponding points.
pub fn largest_difference(a: &[Vector3], b: &[Vector3]) -> f64 {
    a.iter().zip(b).map(|(p, q)| crate::linalg::vector::norm(sub(*p, *q))).fold(0.0, f64::max)
}

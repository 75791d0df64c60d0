//! The silhouette fit on scenes of the mannequin whose truth is known.

use super::outline_problem::{KeypointPair, OutlineProblem, Sigmas};
use super::regulariser::Regulariser;
use super::scene::Scene;
use super::shape_problem::{ShapeProblem, Weights};
use super::unfold::VOLUME_TOLERANCE;
use super::*;
use crate::body::blend_shapes::shape_blend;
use crate::body::mannequin;
use crate::camera::Pinhole;
use crate::fitting::keypoint_set::BodyPoint;
use crate::fitting::{Extrinsics, Keypoint, KeypointSet, View};
use crate::least_squares::{Jacobian, Problem};
use crate::linalg::matrix::mul;
use crate::linalg::vector::{Vector3, cross, distance, dot, norm, sub};
use crate::rotation::{angle_between, rodrigues};
use crate::silhouette::dilation::{StructuringElement, dilate, erode};
use crate::silhouette::raster::Raster;
use crate::surface::mesh::Mesh;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::OnceLock;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

fn body() -> &'static BodyModel {
    static BODY: OnceLock<BodyModel> = OnceLock::new();
    BODY.get_or_init(mannequin)
}

/// Numbers of variance 1 without a generator: sines of incommensurable phases.
fn noise(n: usize, seed: f64) -> f64 {
    2f64.sqrt() * (12.9898 * (n as f64 + 1.0) + 78.233 * seed).sin()
}

/// Arms lowered by half a right angle, knees and elbows a little bent.
fn truth() -> Parameters {
    let mut pose = vec![0.0; 72];
    (pose[1], pose[3 * 16 + 2], pose[3 * 17 + 2]) = (0.4, -0.7, 0.7);
    (pose[3 * 18 + 1], pose[3 * 19 + 1], pose[3 * 4], pose[3 * 5]) = (-0.4, 0.3, 0.2, 0.1);
    let betas = (0..10).map(|l| 0.8 * noise(l, 3.0)).collect();
    Parameters { pose, betas, trans: [0.05, 0.1, -0.03], cameras: cameras() }
}

/// Four cameras around the body, 4 m away.
fn cameras() -> Vec<Pinhole> {
    (0..4)
        .map(|k| Pinhole {
            rotation: mul(&rodrigues([PI, 0.0, 0.0]), &rodrigues([0.0, FRAC_PI_2 * f64::from(k) + 0.1, 0.0])),
            translation: [0.02, -0.05, 4.0],
            ..Pinhole::ideal(400.0, [160.0, 120.0])
        })
        .collect()
}

fn vertices(of: &Parameters) -> Vec<Vector3> {
    body().pose(&of.pose, &of.betas, of.trans).vertices
}

fn masks(of: &Parameters) -> Vec<Mask> {
    let skin = vertices(of);
    of.cameras.iter().map(|camera| Raster::of(&skin, &body().faces, camera, WIDTH, HEIGHT).mask).collect()
}

/// The joints' pixels, off by `noise_px` a coordinate.
fn keypoints(of: &Parameters, noise_px: f64) -> Observation {
    let joints = body().pose(&of.pose, &of.betas, of.trans).joints;
    let view = |(k, camera): (usize, &Pinhole)| View {
        camera: *camera,
        keypoints: joints
            .iter()
            .enumerate()
            .map(|(j, joint)| {
                let [u, v] = camera.project(*joint).expect("in front");
                let off = |axis: usize| noise_px * noise(2 * (24 * k + j) + axis, 1.0);
                Keypoint { pixel_px: [u + off(0), v + off(1)], confidence: 1.0 }
            })
            .collect(),
    };
    Observation {
        views: of.cameras.iter().enumerate().map(view).collect(),
        keypoint_set: KeypointSet::Smpl24,
        extrinsics: Extrinsics::Known,
    }
}

/// The truth as a joint fit of noisy keypoints would find it: joints off by 16 mm or so.
fn start() -> Parameters {
    let mut start = truth();
    start.pose.iter_mut().enumerate().for_each(|(n, angle)| *angle += 0.05 * noise(n, 0.3));
    start.betas.iter_mut().enumerate().for_each(|(l, beta)| *beta += 0.3 * noise(l, 0.7));
    start.trans[2] += 0.006;
    start
}

fn mean_distance(a: &[Vector3], b: &[Vector3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| distance(*a, *b)).sum::<f64>() / a.len() as f64
}

fn refining() -> SilhouetteOptions {
    SilhouetteOptions { refine_pose: Some(PoseRefinement::default()), ..SilhouetteOptions::default() }
}

/// The largest change of the volume, and whether a triangle turned, with and without the fit's offsets.
fn assert_surface_kept(fit: &SilhouetteFit) {
    let (p, offsets) = (&fit.parameters, &fit.offsets);
    let zero = vec![0.0; 72];
    for pose in [&zero, &p.pose] {
        let without = body().pose(pose, &p.betas, p.trans).vertices;
        let with = body().pose_with_offsets(pose, &p.betas, offsets, p.trans).vertices;
        let normal = |vertices: &[Vector3], face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| vertices[v as usize]);
            cross(sub(b, a), sub(c, a))
        };
        let turned =
            body().faces.iter().filter(|face| dot(normal(&without, face), normal(&with, face)) <= 0.0);
        assert_eq!(turned.count(), 0);
        let volume = |vertices: Vec<Vector3>| Mesh::new(vertices, body().faces.clone()).signed_volume();
        assert!((volume(with) / volume(without) - 1.0).abs() <= VOLUME_TOLERANCE);
    }
}

#[test]
fn shape_alone_raises_the_overlap_and_keeps_the_surface() {
    let fit = fit_silhouettes(body(), &start(), &masks(&truth()), None, &SilhouetteOptions::default())
        .expect("masks of this body");
    let [before, after] = fit.mean_iou();
    assert!(after >= before + 0.03, "{before} to {after}");
    assert_eq!(fit.parameters.pose, start().pose);
    assert_eq!(fit.parameters.trans, start().trans);
    assert_eq!(fit.stages.len(), 3);
    assert!(fit.was_successful() && fit.stages.iter().all(|stage| stage.energy < stage.energy_before));
    assert_surface_kept(&fit);
    assert!(fit.warnings.is_empty());
}

#[test]
fn pose_and_shape_find_the_truth_and_offsets_have_little_to_add() {
    let (truth, start) = (truth(), start());
    let fit = fit_silhouettes(body(), &start, &masks(&truth), Some(&keypoints(&truth, 2.0)), &refining())
        .expect("masks of this body");
    let [_, after] = fit.mean_iou();
    let errors = [&vertices(&start), &fit.vertices].map(|v| mean_distance(v, &vertices(&truth)));
    assert!(after >= 0.98, "{after}");
    assert!(errors[1] < 0.5 * errors[0] && errors[1] < 0.008, "{errors:?}");
    assert_eq!(fit.stages[0].kind, StageKind::Pose);
    assert!(fit.offsets.iter().map(|d| norm(*d)).sum::<f64>() / (fit.offsets.len() as f64) < 0.002);
    assert_surface_kept(&fit);
}

#[test]
fn the_truth_is_nearly_a_fixed_point() {
    // Half a pixel of quantisation, 5 mm, is what the masks leave open at a single point; all together far less.
    let truth = truth();
    let fit = fit_silhouettes(body(), &truth, &masks(&truth), Some(&keypoints(&truth, 0.0)), &refining())
        .expect("masks of this body");
    assert_eq!(fit.iou_before, [1.0; 4]);
    assert!(fit.mean_iou()[1] > 0.985, "{:?}", fit.iou);
    assert!(mean_distance(&fit.vertices, &vertices(&truth)) < 0.002);
}

#[test]
fn masks_that_are_too_large_or_too_small_all_round_are_seen_through() {
    let (truth, start) = (truth(), start());
    let (element, marks) = (StructuringElement::Square { size: 3 }, keypoints(&truth, 2.0));
    for (change, bias) in [(dilate as fn(&Mask, StructuringElement) -> Mask, 1.0), (erode, -1.0)] {
        let masks: Vec<Mask> = masks(&truth).iter().map(|mask| change(mask, element)).collect();
        let fit =
            fit_silhouettes(body(), &start, &masks, Some(&marks), &refining()).expect("masks of this body");
        // A square of three pixels grows slanted outlines by up to √2.
        assert!((fit.mask_bias_px / bias - 1.2).abs() < 0.35, "{} of {bias}", fit.mask_bias_px);
        // θ and β see through it; D then explains the masks as they are (measured 0.965 and 0.939).
        let errors = [&start, &fit.parameters].map(|p| mean_distance(&vertices(p), &vertices(&truth)));
        assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
        assert!(fit.mean_iou()[1] > 0.93, "{:?}", fit.iou);
    }
}

#[test]
fn cameras_of_unknown_extrinsics_are_found_with_the_pose() {
    let (truth, mut start) = (truth(), start());
    for (k, camera) in start.cameras.iter_mut().enumerate().skip(1) {
        let turn = [0, 1, 2].map(|axis| 0.02 * noise(3 * k + axis, 0.9));
        camera.rotation = mul(&rodrigues(turn), &camera.rotation);
        camera.translation[0] += 0.05 * noise(k, 0.8);
    }
    let mut observation = keypoints(&truth, 2.0);
    observation.extrinsics = Extrinsics::Unknown;
    let fit = fit_silhouettes(body(), &start, &masks(&truth), Some(&observation), &refining())
        .expect("masks of this body");
    assert!(fit.mean_iou()[1] > 0.975, "{:?}", fit.mean_iou());
    assert_eq!(fit.parameters.cameras[0], truth.cameras[0]);
    let off = |cameras: &[Pinhole]| -> f64 {
        (1..4).map(|k| angle_between(&cameras[k].rotation, &truth.cameras[k].rotation)).sum()
    };
    let (before, after) = (off(&start.cameras), off(&fit.parameters.cameras));
    assert!(after < 0.5 * before, "{before} to {after} rad");
}

#[test]
fn betas_alone_leave_no_offsets_and_offsets_explain_more() {
    let masks = masks(&truth());
    let overlap = |unknowns: Unknowns, terms: Terms| {
        let options = SilhouetteOptions { unknowns, terms, ..SilhouetteOptions::default() };
        let fit = fit_silhouettes(body(), &start(), &masks, None, &options).expect("masks of this body");
        assert_eq!(unknowns == Unknowns::Betas, fit.offsets.iter().all(|d| *d == ZERO));
        fit.mean_iou()
    };
    let [before, betas] = overlap(Unknowns::Betas, Terms::RaysAndPixels);
    let [_, rays] = overlap(Unknowns::BetasAndOffsets, Terms::Rays);
    let [_, both] = overlap(Unknowns::BetasAndOffsets, Terms::RaysAndPixels);
    assert!(before < betas && betas < rays && rays < both, "{before} {betas} {rays} {both}");
}

#[test]
fn masks_that_show_something_else_are_refused() {
    let (truth, good) = (truth(), masks(&truth()));
    let refusal = |change: &dyn Fn(&mut Vec<Mask>, &mut Parameters)| {
        let (mut masks, mut start) = (good.clone(), truth.clone());
        change(&mut masks, &mut start);
        fit_silhouettes(body(), &start, &masks, None, &SilhouetteOptions::default()).expect_err("a refusal")
    };
    assert_eq!(
        refusal(&|masks, _| masks[2] = Mask::empty(WIDTH, HEIGHT)),
        SilhouetteRefusal::EmptyMask { view: 2 }
    );
    assert_eq!(refusal(&|masks, _| masks[1].inside.fill(true)), SilhouetteRefusal::FullMask { view: 1 });
    assert_eq!(refusal(&|masks, _| drop(masks.pop())), SilhouetteRefusal::MaskCount { cameras: 4, masks: 3 });
    // Another person, 60 pixels to the side.
    let elsewhere = refusal(&|masks, _| masks[3].inside.rotate_right(60));
    assert!(matches!(elsewhere, SilhouetteRefusal::MaskDisagrees { view: 3, .. }), "{elsewhere}");
    assert!(elsewhere.to_string().contains("of 24 joints outside"), "{elsewhere}");
    let lost = refusal(&|_, start| start.trans[0] = f64::NAN);
    assert!(matches!(lost, SilhouetteRefusal::BadStart { .. }), "{lost}");
    let behind = refusal(&|_, start| start.trans[2] = 50.0);
    assert!(matches!(behind, SilhouetteRefusal::MaskDisagrees { .. }), "{behind}");
    let short = keypoints(&truth, 0.0);
    let two = Observation { views: short.views[..2].to_vec(), ..short };
    let views = fit_silhouettes(body(), &truth, &good, Some(&two), &refining()).expect_err("a refusal");
    assert!(matches!(views, SilhouetteRefusal::BadStart { .. }), "{views}");
    let none = refusal(&|masks, start| (masks.clear(), start.cameras.clear()).1);
    assert_eq!(none, SilhouetteRefusal::NoViews);
}

#[test]
fn a_mask_at_the_border_warns_and_is_no_outline_there() {
    // The camera is turned upwards until the feet are out of the picture.
    let mut truth = truth();
    for camera in &mut truth.cameras {
        camera.principal_px[1] = 175.0;
    }
    let (mut start, masks) = (start(), masks(&truth));
    start.cameras = truth.cameras.clone();
    let fit = fit_silhouettes(body(), &start, &masks, None, &SilhouetteOptions::default()).expect("a fit");
    assert_eq!(fit.warnings, [0, 1, 2, 3].map(|view| Warning::MaskTouchesBorder { view }));
    let [before, after] = fit.mean_iou();
    assert!(after > before, "{before} to {after}");
}

/// Central differences of `problem`'s residuals along the unit vectors `columns`, against J: the largest difference.
fn worst_column(problem: &impl Problem, x: &[f64], columns: impl Iterator<Item = usize>) -> f64 {
    let (jacobian, step) = (problem.jacobian(x), 1e-6);
    let mut worst: f64 = 0.0;
    for n in columns {
        let mut unit = vec![0.0; x.len()];
        unit[n] = 1.0;
        let moved = |by: f64| {
            let mut y = x.to_vec();
            y[n] += by;
            problem.residuals(&y).expect("in front of the cameras")
        };
        let slopes = jacobian.apply(&unit);
        for (slope, (above, below)) in slopes.iter().zip(moved(step).iter().zip(moved(-step))) {
            worst = worst.max((slope - (above - below) / (2.0 * step)).abs());
        }
    }
    worst
}

#[test]
fn shape_stage_has_the_derivatives_of_its_residuals_and_solves_its_normal_equations() {
    let (masks, start) = (masks(&truth()), start());
    let scene = Scene::new(body(), &start.cameras, &masks);
    let skin = vertices(&start);
    let pairs = scene.ray_pairs(&skin, &scene.see(&skin), &SilhouetteOptions::default());
    let skeleton = body().skeleton();
    let offsets: Vec<Vector3> =
        (0..skin.len()).map(|i| [0, 1, 2].map(|axis| 0.002 * noise(3 * i + axis, 0.1))).collect();
    let posed = body().at_pose(&skeleton, &start.pose, &start.betas, &offsets, start.trans);
    let rest = shape_blend(&body().v_template, &body().shapedirs, &start.betas);
    let regulariser = Regulariser::of(&rest, &body().faces);
    let weights = Weights { laplacian: 6.5, model: 0.9, shape: 0.03, sigma_m: 0.03 };
    let prior = [0.0; 10];
    let problem = ShapeProblem::new(
        body(),
        &posed,
        &start.cameras,
        &pairs,
        true,
        &start.betas,
        &prior,
        &offsets,
        Some(&regulariser),
        weights,
    );
    assert_eq!(problem.split(&problem.start()), (start.betas.clone(), offsets.clone()));
    let mut x = problem.start();
    x.iter_mut().enumerate().for_each(|(n, x)| *x += 0.001 * noise(n, 0.2));
    // All betas, and the offsets of some vertices that are matched and of one that may not be.
    let matched =
        pairs.iter().step_by(997).flat_map(|pair| (0..3).map(|axis| 10 + 3 * pair.vertex as usize + axis));
    let worst = worst_column(&problem, &x, (0..10).chain(matched).chain([10 + 3 * 100]));
    assert!(worst < 1e-7, "{worst:e}");

    let jacobian = problem.jacobian(&x);
    let residuals = problem.residuals(&x).expect("in front of the cameras");
    let gradient = jacobian.apply_transposed(&residuals);
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let along = jacobian.apply(&gradient);
    let scale = inner(&gradient, &gradient);
    assert!((inner(&along, &residuals) - scale).abs() < 1e-9 * scale);
    let step = jacobian.gauss_newton_step(&gradient);
    let left = jacobian.apply_transposed(&jacobian.apply(&step));
    let off: Vec<f64> = left.iter().zip(&gradient).map(|(a, b)| a - b).collect();
    assert!(inner(&off, &off) < 1.1e-6 * scale);
}

#[test]
fn outline_round_has_the_derivatives_of_its_residuals() {
    let (masks, start) = (masks(&truth()), start());
    let scene = Scene::new(body(), &start.cameras, &masks);
    let pairs = scene.outline_pairs(&scene.see(&vertices(&start)), &[8.0; 4]);
    assert!(pairs.len() > 2000, "{}", pairs.len());
    let mut marks = input::keypoint_pairs(body(), &keypoints(&truth(), 2.0));
    marks.push(KeypointPair {
        view: 1,
        point: BodyPoint::Vertex(4321),
        pixel_px: [150.0, 90.0],
        weight: 0.5,
    });
    let offsets: Vec<Vector3> =
        (0..body().vertex_count()).map(|i| [0.003 * noise(i, 0.4), 0.0, 0.001]).collect();
    let few: Vec<_> = pairs.iter().step_by(20).copied().collect();
    let (skeleton, prior) = (body().skeleton(), vec![0.0; 72]);
    let sigmas = Sigmas { contour_px: 0.7, keypoint_px: 2.0, pose_rad: 0.3, mask_bias_px: 0.5 };
    let problem =
        OutlineProblem::new(body(), &skeleton, &start.cameras, true, &offsets, &few, &marks, &prior, sigmas);
    let mut x = problem.start(&start.pose, &start.betas, start.trans, 0.3);
    assert_eq!(x.len(), 86 + 18);
    x[86..].iter_mut().enumerate().for_each(|(n, change)| *change = 0.02 * noise(n, 0.6));
    let worst = worst_column(&problem, &x, 0..x.len());
    // Pixels per radian are hundreds, divided by σ: relative 10⁻⁷.
    assert!(worst < 1e-4, "{worst:e}");
}

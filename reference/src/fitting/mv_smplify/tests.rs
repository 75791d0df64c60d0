//! Laws of the whole fit.

use super::{Descent, MeanPose, MvFit, MvPreset, MvSmplify, MvSmplifyOptions, ViewStart};
use crate::body::Skeleton;
use crate::camera::Pinhole;
use crate::fitting::test_scene::{Person, add_noise, body, body_of_smpl_size, observe, person, ring};
use crate::fitting::{Extrinsics, Keypoint, KeypointSet, Refusal, View};
use crate::linalg::matrix::{apply, mul};
use crate::linalg::vector::{Vector3, add, distance, scale, sub};
use crate::metric::joints::pa_mpjpe;
use crate::rotation::{angle_between, logarithm, rodrigues};
use std::f64::consts::PI;
use std::sync::OnceLock;

fn skeleton() -> &'static Skeleton {
    static SKELETON: OnceLock<Skeleton> = OnceLock::new();
    SKELETON.get_or_init(|| body().skeleton())
}

fn fitter() -> MvSmplify<'static> {
    MvSmplify::of_skeleton(skeleton().clone(), KeypointSet::Smpl24).expect("SMPL's tree")
}

/// A wave between −1 and 1.
fn wave(n: usize) -> f64 {
    (1.9 * n as f64 + 0.7).sin()
}

/// What cameras say who see the person as it is.
fn exact_starts(person: &Person, cameras: &[Pinhole]) -> Vec<ViewStart> {
    let pelvis = skeleton().rest_joints(&person.betas)[0];
    let root = rodrigues([person.pose[0], person.pose[1], person.pose[2]]);
    cameras
        .iter()
        .map(|camera| ViewStart {
            root: logarithm(&mul(&camera.rotation, &root)),
            translation: sub(camera.to_camera(add(pelvis, person.trans)), pelvis),
            body_pose: person.pose[3..].to_vec(),
            betas: person.betas.clone(),
            side_px: None,
        })
        .collect()
}

/// What a regressor says: joints and root about 0.2 rad, shape 0.5, distance 4 % off, differently in each view.
fn regressed_starts(person: &Person, cameras: &[Pinhole]) -> Vec<ViewStart> {
    let mut starts = exact_starts(person, cameras);
    for (i, start) in starts.iter_mut().enumerate() {
        let off = |n: usize| wave(97 * i + n);
        start.root = add(start.root, std::array::from_fn(|c| 0.15 * off(c)));
        start.translation = scale(start.translation, 1.0 + 0.04 * off(3));
        start.body_pose.iter_mut().enumerate().for_each(|(n, x)| *x += 0.18 * off(10 + n));
        start.betas.iter_mut().enumerate().for_each(|(n, x)| *x += 0.7 * off(80 + n));
    }
    starts
}

fn views(person: &Person, cameras: &[Pinhole], noise_px: f64) -> Vec<View> {
    let mut observation = observe(person, cameras, Extrinsics::Known);
    add_noise(&mut observation, noise_px, 5);
    observation.views
}

/// The largest PA-MPJPE of a view, metres.
fn error(fit: &MvFit, person: &Person, cameras: &[Pinhole]) -> f64 {
    let truth = crate::fitting::test_scene::joints(person);
    (0..cameras.len())
        .map(|view| {
            let seen: Vec<Vector3> = truth.iter().map(|&p| cameras[view].to_camera(p)).collect();
            pa_mpjpe(&skeleton().posed_joints(&fit.pose(view), &fit.betas), &seen)
        })
        .fold(0.0, f64::max)
}

#[test]
fn every_preset_brings_four_regressed_bodies_together() {
    let (cameras, fitter) = (ring(4), fitter());
    for seed in 0..6 {
        let person = person(seed);
        // 2 px of 512 are 1 px of 240.
        let (views, starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
        for (preset, bound_m) in
            [(MvPreset::Thesis, 0.035), (MvPreset::Released, 0.025), (MvPreset::Refined, 0.015)]
        {
            let fit = fitter.fit(&views, &starts, &preset.options()).expect("a fit");
            let error = error(&fit, &person, &cameras);
            assert!(fit.valid && error < bound_m, "{preset:?} {seed}: {error} m, {} px²", fit.mean_loss);
        }
    }
}

#[test]
fn the_truth_with_exact_marks_moves_only_by_the_priors() {
    let (cameras, person) = (ring(3), person(1));
    let (views, starts) = (views(&person, &cameras, 0.0), exact_starts(&person, &cameras));
    let fit = fitter().fit(&views, &starts, &MvPreset::Refined.options()).expect("a fit");
    // Adam takes even rounding for a slope, so the first steps leave the minimum, and the later ones come back.
    let error = error(&fit, &person, &cameras);
    assert!(fit.mean_loss < 1.0 && error < 0.005, "{error} m, {} px²", fit.mean_loss);
}

#[test]
fn the_order_of_views_does_not_matter() {
    let (cameras, person) = (ring(4), person(2));
    let (views, starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
    let order = [2, 0, 3, 1];
    let views_2: Vec<View> = order.iter().map(|&i| views[i].clone()).collect();
    let starts_2: Vec<ViewStart> = order.iter().map(|&i| starts[i].clone()).collect();
    for preset in MvPreset::ALL {
        let a = fitter().fit(&views, &starts, &preset.options()).expect("a fit");
        let b = fitter().fit(&views_2, &starts_2, &preset.options()).expect("a fit");
        // Sums in another order; each of 250 steps may double what rounding has left.
        for (i, &from) in order.iter().enumerate() {
            assert!(distance(b.roots[i], a.roots[from]) < 1e-6, "{preset:?}");
            assert!(distance(b.translations[i], a.translations[from]) < 1e-6, "{preset:?}");
        }
        for (x, y) in a.body_pose.iter().chain(&a.betas).zip(b.body_pose.iter().chain(&b.betas)) {
            assert!((x - y).abs() < 1e-6, "{preset:?}: {x} {y}");
        }
    }
}

#[test]
fn extrinsics_and_resolution_do_not_matter() {
    let (cameras, person) = (ring(2), person(3));
    let (views, starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
    let fit = fitter().fit(&views, &starts, &MvSmplifyOptions::default()).expect("a fit");
    let mut twice = views.clone();
    for view in &mut twice {
        // The same picture with twice the pixels, from a camera that is said to stand anywhere.
        view.camera = Pinhole::ideal(800.0, [320.0, 240.0]);
        view.keypoints.iter_mut().for_each(|k| k.pixel_px = k.pixel_px.map(|x| 2.0 * x));
    }
    let other = fitter().fit(&twice, &starts, &MvSmplifyOptions::default()).expect("a fit");
    assert!((fit.mean_loss - other.mean_loss).abs() < 1e-6 * fit.mean_loss);
    assert!(distance(fit.translations[1], other.translations[1]) < 1e-6);
}

#[test]
fn the_thesis_keeps_the_translations_of_stage_one() {
    let (cameras, person) = (ring(2), person(4));
    let (views, starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
    let thesis = MvPreset::Thesis.options();
    let torso_alone = MvSmplifyOptions { shared: Descent::constant(0, 1e-2), ..thesis.clone() };
    let ends = |options: &MvSmplifyOptions| fitter().fit(&views, &starts, options).expect("a fit");
    assert_eq!(ends(&thesis).translations, ends(&torso_alone).translations);
    assert_ne!(ends(&thesis).roots, ends(&torso_alone).roots);
    assert_ne!(ends(&MvPreset::Released.options()).translations, ends(&torso_alone).translations);
}

#[test]
fn a_view_that_faces_the_wrong_way_is_noticed_and_turned() {
    let (cameras, person) = (ring(4), person(0));
    let (views, mut starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
    let turned = mul(&rodrigues(starts[2].root), &rodrigues([0.0, PI, 0.0]));
    starts[2].root = logarithm(&turned);
    let thesis = fitter().fit(&views, &starts, &MvPreset::Thesis.options()).expect("a fit");
    assert!(!thesis.valid, "{}", thesis.mean_loss);
    let worst = (0..4).max_by(|&a, &b| thesis.view_losses[a].total_cmp(&thesis.view_losses[b]));
    assert_eq!(worst, Some(2), "the view stands out: {:?}", thesis.view_losses);

    let fit = fitter().fit(&views, &starts, &MvSmplifyOptions::default()).expect("a fit");
    let found = rodrigues(fit.roots[2]);
    let root = rodrigues([person.pose[0], person.pose[1], person.pose[2]]);
    let off = angle_between(&found, &mul(&cameras[2].rotation, &root));
    assert!(fit.valid && off < 0.1, "{off} rad");
    assert!(error(&fit, &person, &cameras) < 0.015);
}

#[test]
fn hidden_marks_are_not_asked() {
    let (cameras, person) = (ring(4), person(5));
    let (mut views, starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
    // A right arm that only two views see, a torso without a shoulder, a view of the head and an arm.
    for k in [17, 19, 21, 23] {
        for view in &mut views[..2] {
            view.keypoints[k] = Keypoint { pixel_px: [-1e4, 1e4], confidence: 0.0 };
        }
    }
    for (k, keypoint) in views[3].keypoints.iter_mut().enumerate() {
        if ![12, 15, 16, 18, 20].contains(&k) {
            keypoint.confidence = 0.0;
        }
    }
    // One that no view sees.
    views.iter_mut().for_each(|view| view.keypoints[10].confidence = 0.0);
    let fit = fitter().fit(&views, &starts, &MvSmplifyOptions::default()).expect("a fit");
    assert!(fit.valid && error(&fit, &person, &cameras) < 0.04, "{}", error(&fit, &person, &cameras));
    assert_eq!(fit.keypoint_losses[10], 0.0);
    let mean = fit.keypoint_losses.iter().sum::<f64>() / 23.0;
    assert!((fit.mean_loss - mean).abs() < 1e-12);
}

#[test]
fn one_view_ends_nearer_than_it_started() {
    let (cameras, person) = (ring(1), person(2));
    let (views, starts) = (views(&person, &cameras, 1.0), regressed_starts(&person, &cameras));
    let begin = MvSmplifyOptions {
        torso: Descent::constant(0, 1e-2),
        shared: Descent::constant(0, 1e-2),
        ..MvPreset::Thesis.options()
    };
    let begin = fitter().fit(&views, &starts, &begin).expect("a fit");
    let fit = fitter().fit(&views, &starts, &MvSmplifyOptions::default()).expect("a fit");
    assert!(error(&fit, &person, &cameras) < 0.7 * error(&begin, &person, &cameras));
}

#[test]
fn keypoints_on_the_skin_are_fitted_on_whole_bodies() {
    let small = body_of_smpl_size();
    let fitter = MvSmplify::new(&small, KeypointSet::Body25).expect("SMPL's tree");
    let person = person(1);
    let skeleton = small.skeleton();
    let figure = crate::fitting::figure::Figure::new(&small, &skeleton, KeypointSet::Body25);
    let points = figure.points(&person.pose, &person.betas);
    let cameras = ring(3);
    let views: Vec<View> = cameras
        .iter()
        .map(|camera| {
            let see = |&p: &Vector3| Keypoint {
                pixel_px: camera.project(add(p, person.trans)).expect("in front"),
                confidence: 0.8,
            };
            View { camera: *camera, keypoints: points.iter().map(see).collect() }
        })
        .collect();
    let pelvis = skeleton.rest_joints(&person.betas)[0];
    let mut starts = regressed_starts(&person, &cameras);
    for (start, camera) in starts.iter_mut().zip(&cameras) {
        start.translation = sub(camera.to_camera(add(pelvis, person.trans)), pelvis);
    }
    let fit = fitter.fit(&views, &starts, &MvSmplifyOptions::default()).expect("a fit");
    assert!(fit.valid, "{}", fit.mean_loss);
    // The neck and the hips of a detector are not asked.
    for (k, loss) in fit.keypoint_losses.iter().enumerate() {
        assert_eq!(*loss == 0.0, [1, 9, 12].contains(&k), "{}", KeypointSet::Body25.name(k));
    }
    let found = figure.points(&fit.pose(0), &fit.betas);
    let root = rodrigues([person.pose[0], person.pose[1], person.pose[2]]);
    let truth: Vec<Vector3> = points.iter().map(|&p| apply(&cameras[0].rotation, p)).collect();
    assert!(pa_mpjpe(&found, &truth) < 0.02, "{}", pa_mpjpe(&found, &truth));
    assert!(angle_between(&rodrigues(fit.roots[0]), &mul(&cameras[0].rotation, &root)) < 0.15);
}

#[test]
fn refusals_name_the_view() {
    let (cameras, person) = (ring(2), person(0));
    let (good_views, good_starts) = (views(&person, &cameras, 0.0), exact_starts(&person, &cameras));
    let refusal = |change: &dyn Fn(&mut Vec<View>, &mut Vec<ViewStart>)| {
        let (mut views, mut starts) = (good_views.clone(), good_starts.clone());
        change(&mut views, &mut starts);
        fitter().fit(&views, &starts, &MvSmplifyOptions::default()).expect_err("a refusal").to_string()
    };
    assert!(refusal(&|v, s| (v.clear(), s.clear()).0).contains("no view"));
    assert!(refusal(&|_, s| s.truncate(1)).contains("1 starts for 2 views"));
    assert!(refusal(&|_, s| s[1].root[2] = f64::NAN).contains("start of view 1 holds a number"));
    assert!(refusal(&|_, s| s[1].body_pose[4] = 1e4).contains("start of view 1 holds an angle"));
    assert!(refusal(&|_, s| s[1].body_pose.truncate(60)).contains("start of view 1 has a body pose"));
    assert!(refusal(&|_, s| s[0].betas.resize(11, 0.0)).contains("start of view 0 has more betas"));
    assert!(refusal(&|_, s| s[0].side_px = Some(0.0)).contains("start of view 0 has a crop"));
    let pixel = refusal(&|v, _| v[1].keypoints[4].pixel_px[0] = f64::INFINITY);
    assert!(pixel.contains("view 1, keypoint 4"), "{pixel}");
    let sure = refusal(&|v, _| v[1].keypoints[4].confidence = 1e200);
    assert!(sure.contains("view 1, keypoint 4") && sure.contains("from 0 to 1000"), "{sure}");
    let hidden = refusal(&|v, _| v[1].keypoints.iter_mut().for_each(|k| k.confidence = 0.0));
    assert!(hidden.contains("0 usable keypoints") && hidden.contains("view 1"), "{hidden}");
    let focal = refusal(&|v, _| v[0].camera.focal_px[0] = -1.0);
    assert!(focal.contains("camera of view 0"), "{focal}");
    // Marks at the far side of the picture's centre: no place in front of the camera shows the body upside down.
    let behind = refusal(&|v, s| {
        s[0].translation[2] = -4.0;
        for keypoint in &mut v[0].keypoints {
            keypoint.pixel_px = [320.0 - keypoint.pixel_px[0], 240.0 - keypoint.pixel_px[1]];
        }
    });
    assert!(behind.contains("start of view 0 puts the body behind the camera"), "{behind}");
}

#[test]
fn whatever_is_finite_but_huge_ends_in_a_refusal_or_in_numbers() {
    let (cameras, person) = (ring(2), person(0));
    let (good_views, good_starts) = (views(&person, &cameras, 0.0), exact_starts(&person, &cameras));
    let changes: [fn(&mut View, &mut ViewStart, f64); 7] = [
        |view, _, huge| view.keypoints[4].pixel_px[0] = huge,
        |view, _, huge| view.camera.focal_px[0] = huge,
        |view, _, huge| view.camera.principal_px[1] = -huge,
        |_, start, huge| start.root[0] = huge,
        |_, start, huge| start.translation[2] = huge,
        |_, start, huge| start.betas[0] = huge,
        |_, start, huge| start.body_pose[7] = huge,
    ];
    let mut overflows = 0;
    for huge in [1e9, 1e100, 1e200, f64::MAX] {
        for (n, change) in changes.iter().enumerate() {
            let (mut views, mut starts) = (good_views.clone(), good_starts.clone());
            change(&mut views[1], &mut starts[1], huge);
            match fitter().fit(&views, &starts, &MvSmplifyOptions::default()) {
                Ok(fit) => assert!(fit.is_finite(), "{n} {huge:e}"),
                Err(refusal) => overflows += usize::from(refusal == Refusal::Overflow),
            }
        }
    }
    assert!(overflows > 0, "some squares do overflow");
}

#[test]
fn equal_starts_have_equal_means() {
    let (cameras, person) = (ring(2), person(1));
    let (views, starts) = (views(&person, &cameras, 1.0), exact_starts(&person, &cameras));
    let with = |mean_pose| MvSmplifyOptions { mean_pose, ..MvPreset::Thesis.options() };
    let a = fitter().fit(&views, &starts, &with(MeanPose::AxisAngle)).expect("a fit");
    let b = fitter().fit(&views, &starts, &with(MeanPose::Chordal)).expect("a fit");
    assert!(a.body_pose.iter().zip(&b.body_pose).all(|(x, y)| (x - y).abs() < 1e-6));
}

//! Planted people are found; what cannot be found is refused or named.

use super::test_scene::{
    add_noise, fitter, joints, joints_in_view_0, largest_difference, observe, observe_set, person, ring,
};
use super::*;
use crate::metric::joints::{mean_joint_error, pa_mpjpe};

fn fit(observation: &Observation) -> Fit {
    fitter().fit(observation, &Options::default(), None).expect("a fit")
}

#[test]
fn exact_joints_of_known_cameras_are_met_exactly() {
    for seed in 0..6 {
        let person = person(seed);
        for views in 2..5 {
            let fit = fit(&observe(&person, &ring(views), Extrinsics::Known));
            let error = largest_difference(&fit.joints, &joints(&person));
            assert!(error < 1e-5, "person {seed}, {views} views: {error} m");
            assert_eq!(fit.verdict, Verdict::Success);
            assert!(fit.views.iter().all(|v| v.count == 24 && v.max_px < 1e-2), "{:?}", fit.views);
        }
    }
}

#[test]
fn exact_joints_of_unknown_cameras_are_met_up_to_scale() {
    for seed in 0..6 {
        let person = person(seed);
        for views in [2, 4] {
            let cameras = ring(views);
            let fit = fit(&observe(&person, &cameras, Extrinsics::Unknown));
            let error = pa_mpjpe(&fit.joints, &joints(&person));
            assert!(error < 1e-5, "person {seed}, {views} views: {error} m");
            // The world is view 0's frame; the person's size is known but for the prior on shapes.
            assert_eq!(fit.parameters.cameras[0].translation, [0.0; 3]);
            let truth = joints_in_view_0(&person, &cameras);
            assert!(mean_joint_error(&fit.joints, &truth) < 0.05 * 4.0, "person {seed}, {views} views");
        }
    }
}

#[test]
fn one_view_is_met_in_its_picture() {
    let person = person(1);
    let fit = fit(&observe(&person, &ring(1), Extrinsics::Known));
    assert!(fit.verdict.is_success() && fit.views[0].mean_px < 1.0, "{:?} {:?}", fit.verdict, fit.views);
    let depth = fit.parameters.trans[2];
    assert!(depth.is_finite() && pa_mpjpe(&fit.joints, &joints(&person)) < 0.12);
}

#[test]
fn noisy_joints_give_less_error_than_triangulation_and_their_noise() {
    let (mut errors, mut noises, mut unknown) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..12 {
        let person = person(seed);
        let mut observation = observe(&person, &ring(4), Extrinsics::Known);
        add_noise(&mut observation, 2.0, u64::from(seed));
        let known = fit(&observation);
        assert!(known.verdict.is_success(), "{}", known.verdict);
        errors.push(mean_joint_error(&known.joints, &joints(&person)));
        noises.push(known.noise_px.expect("polished"));
        observation.extrinsics = Extrinsics::Unknown;
        unknown.push(pa_mpjpe(&fit(&observation).joints, &joints(&person)));
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    // Joint by joint, triangulation leaves 20 mm.
    assert!(mean(&errors) < 0.017, "{} m", mean(&errors));
    assert!(mean(&unknown) < 0.017, "{} m", mean(&unknown));
    assert!((mean(&noises) - 2.0).abs() < 0.2, "{} px", mean(&noises));
}

#[test]
fn missing_joints_are_filled_in_by_the_others() {
    let person = person(2);
    for extrinsics in [Extrinsics::Known, Extrinsics::Unknown] {
        let mut observation = observe(&person, &ring(4), extrinsics);
        for (i, view) in observation.views.iter_mut().enumerate() {
            for k in (i..24).step_by(4) {
                view.keypoints[k] = Keypoint { pixel_px: [0.0; 2], confidence: 0.0 };
            }
        }
        let fit = fit(&observation);
        assert!(fit.verdict.is_success() && fit.views.iter().all(|v| v.count == 18));
        let error = pa_mpjpe(&fit.joints, &joints(&person));
        assert!(error < 1e-4, "{extrinsics:?}: {error} m");
    }
}

#[test]
fn a_few_wrong_detections_do_no_harm() {
    let person = person(3);
    for extrinsics in [Extrinsics::Known, Extrinsics::Unknown] {
        let mut observation = observe(&person, &ring(4), extrinsics);
        for (view, k) in [(0, 20), (1, 7), (3, 15)] {
            observation.views[view].keypoints[k].pixel_px[0] += 70.0;
        }
        observation.views[2].keypoints[4].pixel_px = [1e12, -1e12];
        let fit = fit(&observation);
        assert!(fit.verdict.is_success(), "{}", fit.verdict);
        let error = pa_mpjpe(&fit.joints, &joints(&person));
        assert!(error < 1e-3, "{extrinsics:?}: {error} m");
    }
}

#[test]
fn keypoints_of_detectors_find_the_joints_that_they_mark() {
    let person = person(4);
    for set in [KeypointSet::Body25, KeypointSet::Coco18, KeypointSet::Coco17, KeypointSet::Lsp14] {
        let fit = fit(&observe_set(&person, &ring(4), set));
        assert!(fit.verdict.is_success(), "{set:?}: {}", fit.verdict);
        let truth = joints(&person);
        for joint in [4, 5, 7, 8, 16, 17, 18, 19, 20, 21] {
            let error = crate::linalg::vector::distance(fit.joints[joint], truth[joint]);
            assert!(error < 1e-3, "{set:?}, joint {joint}: {error} m");
        }
        assert!(
            !fit.left_out.is_empty()
                && fit.left_out.iter().all(|&k| set.on_body(super::test_scene::body())[k].is_none())
        );
    }
}

#[test]
fn presets_of_the_thesis_descend_and_are_biased() {
    let person = person(5);
    let observation = observe(&person, &ring(4), Extrinsics::Known);
    for preset in [Preset::Smplify, Preset::Ch2, Preset::Ch3] {
        let fit = fitter().fit(&observation, &preset.options(), None).expect("a fit");
        assert_eq!((fit.stages.len(), fit.noise_px), (4, None));
        let error = mean_joint_error(&fit.joints, &joints(&person));
        assert!(
            fit.verdict.is_success() && error < 0.03,
            "{}: {error} m, {} {:?}",
            preset.name(),
            fit.verdict,
            fit.views
        );
        assert!(error > 1e-4, "{}: the bend prior pushes", preset.name());
    }
}

#[test]
fn start_of_the_thesis_faces_view_0_and_finds_a_person_who_does() {
    let mut person = person(0);
    // Cameras are at most 40° apart and the person faces the first.
    let cameras: Vec<_> = ring(4)
        .into_iter()
        .enumerate()
        .map(|(i, camera)| crate::camera::Pinhole {
            rotation: crate::rotation::rodrigues([std::f64::consts::PI, 0.0, 0.0]),
            translation: [0.02 * i as f64, 0.0, 4.0],
            ..camera
        })
        .collect();
    person.pose[..3].copy_from_slice(&[0.0, 0.2, 0.0]);
    let options = Options { start: Start::Identity, ..Preset::Ch2.options() };
    let fit = fitter().fit(&observe(&person, &cameras, Extrinsics::Unknown), &options, None).expect("a fit");
    assert!(fit.views.iter().all(|v| v.mean_px < 4.0), "{:?}", fit.views);
}

#[test]
fn warm_start_is_kept_where_it_is_good_and_dropped_where_it_is_not() {
    let person = person(6);
    for extrinsics in [Extrinsics::Known, Extrinsics::Unknown] {
        let observation = observe(&person, &ring(4), extrinsics);
        let cold = fit(&observation);
        let warm = fitter().fit(&observation, &Options::default(), Some(&cold.parameters)).expect("a fit");
        assert!(warm.energy <= 1.01 * cold.energy, "{extrinsics:?}: {} {}", warm.energy, cold.energy);
        assert!(pa_mpjpe(&warm.joints, &joints(&person)) < 1e-5);

        let mut wrong = cold.parameters.clone();
        wrong.pose[..3].copy_from_slice(&[0.0, 0.0, 1.5]);
        wrong.trans[0] += 0.5;
        let recovered = fitter().fit(&observation, &Options::default(), Some(&wrong)).expect("a fit");
        assert!(pa_mpjpe(&recovered.joints, &joints(&person)) < 1e-4, "{extrinsics:?}");
    }
}

#[test]
fn views_of_other_people_disagree() {
    let mut observation = observe(&person(0), &ring(4), Extrinsics::Known);
    let mut other = person(3);
    other.pose[1] += 1.5;
    observation.views[2] = observe(&other, &ring(4), Extrinsics::Known).views[2].clone();
    assert_eq!(fit(&observation).verdict, Verdict::ViewsDisagree { views: vec![2] });
}

#[test]
fn exchanged_sides_are_noticed() {
    let set = KeypointSet::Smpl24;
    let observation = observe(&person(1), &ring(4), Extrinsics::Known);
    let mut exchanged = observation.clone();
    for (view, marked) in exchanged.views.iter_mut().zip(&observation.views) {
        for k in 0..24 {
            view.keypoints[k] = marked.keypoints[set.mirrored(k)];
        }
    }
    assert_eq!(fit(&exchanged).verdict, Verdict::SidesExchanged);
}

#[test]
fn wrong_priors_and_starts_are_refused() {
    let observation = observe(&person(0), &ring(2), Extrinsics::Known);
    let mixture = prior::GaussianMixture::new(
        vec![vec![0.0; 3]],
        &[vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]],
        &[1.0],
    );
    let options =
        Options { pose_prior: PosePrior::Mixture(mixture.expect("a mixture")), ..Preset::Smplify.options() };
    assert_eq!(
        fitter().fit(&observation, &options, None),
        Err(Refusal::PriorSize { found: 3, expected: 69 })
    );
    let mut initial = fit(&observation).parameters;
    initial.pose[7] = f64::NAN;
    assert!(matches!(
        fitter().fit(&observation, &Options::default(), Some(&initial)),
        Err(Refusal::BadInitial { .. })
    ));
}

#[test]
fn a_mixture_prior_pulls_towards_its_mean() {
    let person = person(2);
    let observation = observe(&person, &ring(4), Extrinsics::Known);
    let with_mean = |mean: Vec<f64>| {
        let mut covariance = vec![0.0; 69 * 69];
        (0..69).for_each(|i| covariance[70 * i] = 0.01);
        let mixture = prior::GaussianMixture::new(vec![mean], &[covariance], &[1.0]).expect("a mixture");
        let options = Options { pose_prior: PosePrior::Mixture(mixture), ..Preset::Ch3.options() };
        mean_joint_error(&fitter().fit(&observation, &options, None).expect("a fit").joints, &joints(&person))
    };
    // The truth as its own prior leaves the bend prior's bias alone.
    let (right, wrong) = (with_mean(person.pose[3..].to_vec()), with_mean(vec![0.0; 69]));
    assert!(right < 0.7 * wrong, "{right} m against {wrong} m");
}

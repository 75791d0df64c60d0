//! Laws of the collaborative fit of chapter 4.

use std::sync::OnceLock;

use proptest::prelude::*;
use vitruvian_reference::body::{Skeleton, mannequin};
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::{
    Keypoint, KeypointSet, MvFit, MvSmplify, MvSmplifyOptions, View, ViewStart,
};
use vitruvian_reference::linalg::matrix::mul;
use vitruvian_reference::linalg::vector::{Vector3, add, distance, scale};
use vitruvian_reference::metric::joints::pa_mpjpe;
use vitruvian_reference::rotation::{logarithm, rodrigues};

const CASES: u32 = 12;
const VIEWS: usize = 3;

fn skeleton() -> &'static Skeleton {
    static SKELETON: OnceLock<Skeleton> = OnceLock::new();
    SKELETON.get_or_init(|| mannequin().skeleton())
}

fn fit(views: &[View], starts: &[ViewStart]) -> MvFit {
    let fitter = MvSmplify::of_skeleton(skeleton().clone(), KeypointSet::Smpl24).expect("SMPL's tree");
    fitter.fit(views, starts, &MvSmplifyOptions::default()).expect("a fit")
}

/// A person in three views, exactly marked, what a regressor says of each, and the joints in the first camera's axes.
#[derive(Clone, Debug)]
struct Scene {
    views: Vec<View>,
    starts: Vec<ViewStart>,
    joints: Vec<Vector3>,
}

fn scene() -> impl Strategy<Value = Scene> {
    let numbers = |count: usize, size: f64| proptest::collection::vec(-size..size, count);
    let each = (numbers(3, 0.15), numbers(69, 0.2), numbers(10, 0.5), -0.04f64..0.04);
    let starts = proptest::collection::vec(each, VIEWS);
    (numbers(69, 0.3), numbers(10, 1.0), -3.1f64..3.1, starts).prop_map(|(pose, betas, heading, off)| {
        let (mut views, mut starts, mut all) = (Vec::new(), Vec::new(), Vec::new());
        for (i, (turn, joints_off, betas_off, depth_off)) in off.into_iter().enumerate() {
            let yaw = heading + 1.6 * i as f64;
            let root = logarithm(&mul(&rodrigues([3.1, 0.0, 0.0]), &rodrigues([0.0, yaw, 0.0])));
            let translation = [0.05, 0.1, 4.0];
            let camera = Pinhole::ideal(900.0, [256.0, 256.0]);
            let joints = skeleton().posed_joints(&[&root[..], &pose].concat(), &betas);
            let see = |&p: &Vector3| Keypoint {
                pixel_px: camera.project(add(p, translation)).expect("4 m away"),
                confidence: 1.0,
            };
            views.push(View { camera, keypoints: joints.iter().map(see).collect() });
            all.push(joints);
            starts.push(ViewStart {
                root: add(root, [turn[0], turn[1], turn[2]]),
                translation: scale(translation, 1.0 + depth_off),
                body_pose: pose.iter().zip(&joints_off).map(|(x, d)| x + d).collect(),
                betas: betas.iter().zip(&betas_off).map(|(x, d)| x + d).collect(),
                side_px: None,
            });
        }
        Scene { views, starts, joints: all.swap_remove(0) }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(CASES))]

    #[test]
    fn a_planted_person_is_found_from_what_each_view_says(scene in scene()) {
        let fit = fit(&scene.views, &scene.starts);
        let found = skeleton().posed_joints(&fit.pose(0), &fit.betas);
        let error_m = pa_mpjpe(&found, &scene.joints);
        prop_assert!(fit.valid && error_m < 0.03, "{error_m} m, {} px²", fit.mean_loss);
    }

    #[test]
    fn turning_the_list_of_views_turns_the_answers(scene in scene(), by in 1..VIEWS) {
        let (mut views, mut starts) = (scene.views.clone(), scene.starts.clone());
        views.rotate_left(by);
        starts.rotate_left(by);
        let (a, b) = (fit(&scene.views, &scene.starts), fit(&views, &starts));
        for i in 0..VIEWS {
            let from = (i + by) % VIEWS;
            // Sums in another order, over 250 steps.
            prop_assert!(distance(b.roots[i], a.roots[from]) < 1e-5);
            prop_assert!(distance(b.translations[i], a.translations[from]) < 1e-5);
        }
        prop_assert!(a.body_pose.iter().zip(&b.body_pose).all(|(x, y)| (x - y).abs() < 1e-5));
    }
}

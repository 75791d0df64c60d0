//! Views for the tests of the stages: a person, marks beside where the cameras see it.

use super::shared_stage::Shared;
use super::unrooted::Unrooted;
use super::view_term::{Loss, Mark, Placement, ViewTerm};
use crate::body::{BodyModel, Skeleton};
use crate::camera::Pinhole;
use crate::fitting::KeypointSet;
use crate::fitting::test_scene::{person, ring};
use crate::linalg::matrix::{IDENTITY, apply, mul};
use crate::linalg::vector::{ZERO, add, sub};
use crate::rotation::{logarithm, rodrigues};

pub fn figure_of<'a>(skeleton: &'a Skeleton, body: Option<&'a BodyModel>, set: KeypointSet) -> Unrooted<'a> {
    let keypoints = match body {
        Some(body) => set.on_body(body),
        None => set.on_skeleton(skeleton),
    };
    Unrooted::new(skeleton, body, &keypoints)
}

/// A wave between −1 and 1.
fn wave(n: usize, seed: u32) -> f64 {
    (1.3 * n as f64 + 2.1 * f64::from(seed) + 0.4).sin()
}

/// Who the person of `seed` is in the cameras of a ring, with marks up to 40 px beside it, of all confidences; cameras with
/// and without a lens.
pub fn marked_views(figure: &Unrooted, count: usize, seed: u32) -> (Vec<ViewTerm>, Shared) {
    let person = person(seed);
    let mut pose = figure.room();
    figure.pose(&person.pose[3..], &person.betas, &mut pose);
    let root = rodrigues([person.pose[0], person.pose[1], person.pose[2]]);
    let (mut terms, mut placements) = (Vec::new(), Vec::new());
    for (view, camera) in ring(count).into_iter().enumerate() {
        // X_c = R (root q + J_0 + trans) + t.
        let middle = add(apply(&camera.rotation, add(pose.pelvis, person.trans)), camera.translation);
        let placement = Placement {
            root: logarithm(&mul(&camera.rotation, &root)),
            translation: sub(middle, pose.pelvis),
        };
        let lens = if view % 2 == 0 { [0.0; 5] } else { [-0.1, 0.02, 0.002, -0.001, 0.01] };
        let camera = Pinhole { rotation: IDENTITY, translation: ZERO, distortion: lens, ..camera };
        let turn = rodrigues(placement.root);
        let marks = (0..pose.points.len())
            .map(|keypoint| {
                let point = add(apply(&turn, pose.points[keypoint]), middle);
                let [u, v] = camera.project(point).expect("in front");
                let (a, b) = (wave(3 * keypoint + view, seed), wave(5 * keypoint + 2 * view, seed));
                Mark {
                    keypoint,
                    pixel_px: [u + 40.0 * a, v + 40.0 * b],
                    weight: 0.3 + 0.02 * keypoint as f64,
                }
            })
            .collect();
        terms.push(ViewTerm { camera, crop_scale: 0.8, marks, loss: Loss::GemanMcClure(100.0) });
        placements.push(placement);
    }
    (terms, Shared { body_pose: person.pose[3..].to_vec(), betas: person.betas, placements })
}

/// Half a radian and some decimetres beside a placement.
pub fn start_near(at: &Placement, seed: u32) -> Placement {
    let off = |n: usize| std::array::from_fn(|c| 0.3 * wave(n + c, seed));
    Placement { root: add(at.root, off(0)), translation: add(at.translation, off(3)) }
}

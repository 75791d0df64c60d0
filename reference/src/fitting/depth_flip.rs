//! Bodies beside a minimum: one end of the body nearer instead of farther.
//!
//! Rays that are nearly parallel, as those of opposite cameras are, fix a point across but hardly along them. A bone of known
//! length then fits twice, b and b − 2 (b·r) r for the line of sight r (Taylor's ambiguity of one view), and a descent does
//! not cross from one to the other.
//!
//! # References
//! Taylor 2000, "Reconstruction of articulated objects from point correspondences in a single uncalibrated image".

use super::result::Parameters;
use crate::body::Skeleton;
use crate::linalg::matrix::{IDENTITY, apply_transposed, mul, transpose};
use crate::linalg::vector::{add, add_scaled, cross, dot, norm, normalize, scale, sub};
use crate::rotation::{logarithm, rodrigues};

/// The body with the bone to one of its ends (feet, hands, head) flipped along the line of sight of view 0, for each end whose
/// bone is not along or across it.
pub fn depth_flips(skeleton: &Skeleton, at: &Parameters) -> Vec<Parameters> {
    let transforms = skeleton.pose(&at.pose, &at.betas);
    let joints = skeleton.posed_joints(&at.pose, &at.betas);
    let camera = &at.cameras[0];
    let centre = scale(apply_transposed(&camera.rotation, camera.translation), -1.0);
    let is_end = |j: &usize| !skeleton.parents.contains(&Some(*j));
    let flip = |end: usize| {
        let parent = skeleton.parents[end]?;
        let bone = normalize(sub(joints[end], joints[parent]));
        let ray = normalize(sub(add(joints[parent], at.trans), centre));
        let flipped = add_scaled(bone, ray, -2.0 * dot(bone, ray));
        // The least turn from one to the other.
        let axis = cross(bone, flipped);
        (norm(axis) > 1e-9).then(|| {
            let turn = rodrigues(scale(normalize(axis), norm(axis).atan2(dot(bone, flipped))));
            let before = skeleton.parents[parent].map_or(IDENTITY, |p| transforms[p].rotation);
            let local = mul(&transpose(&before), &mul(&turn, &transforms[parent].rotation));
            let mut flipped = at.clone();
            flipped.pose[3 * parent..3 * parent + 3].copy_from_slice(&logarithm(&local));
            flipped
        })
    };
    (0..joints.len()).filter(is_end).filter_map(flip).collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{body, person, ring};
    use super::*;
    use crate::linalg::vector::distance;

    #[test]
    fn one_end_moves_along_the_line_of_sight_and_back() {
        let (skeleton, person, cameras) = (body().skeleton(), person(3), ring(2));
        let at = Parameters { pose: person.pose, betas: person.betas, trans: person.trans, cameras };
        let before = skeleton.posed_joints(&at.pose, &at.betas);
        let flips = depth_flips(&skeleton, &at);
        // Two feet, two hands, the head.
        assert_eq!(flips.len(), 5);
        for (n, flipped) in flips.iter().enumerate() {
            let after = skeleton.posed_joints(&flipped.pose, &flipped.betas);
            let moved: Vec<usize> = (0..24).filter(|&j| distance(before[j], after[j]) > 1e-9).collect();
            let [end] = moved[..] else { panic!("{moved:?} moved") };
            let parent = skeleton.parents[end].expect("an end");
            let length = |x: &[[f64; 3]]| distance(x[end], x[parent]);
            assert!((length(&before) - length(&after)).abs() < 1e-12);
            let camera = &at.cameras[0];
            let centre = scale(apply_transposed(&camera.rotation, camera.translation), -1.0);
            let ray = sub(add(before[parent], at.trans), centre);
            assert!(norm(cross(sub(after[end], before[end]), normalize(ray))) < 1e-9);
            let back = &depth_flips(&skeleton, flipped)[n];
            assert!(distance(skeleton.posed_joints(&back.pose, &back.betas)[end], before[end]) < 1e-9);
        }
    }
}

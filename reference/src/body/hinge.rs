//! Elbows and knees: about which axis they bend, and how far they are bent at rest.
//!
//! A prior that forbids hyper-extension needs to know which turns of a joint extend it. SMPL's users write that down as
//! indices into θ with signs (θ₅₅ −, θ₅₈ +, θ₁₂ +, θ₁₅ +), which holds for SMPL's T-pose alone. Here it is read off the
//! skeleton: with d the direction of the upper bone into the joint and e that of the lower bone out of it, both at rest,
//!
//! ```text
//!     natural axis   a ∝ d × z  for an elbow (the forearm comes forward),  a ∝ −d × z  for a knee (the shank goes back)
//!     rest flexion   φ₀ = angle from d to e about a
//!     flexion        φ = φ₀ + a·θ
//! ```
//!
//! The last line is of first order in θ, as SMPL's own prior is: it takes single components of the axis–angle vector.

use super::skeleton::Skeleton;
use crate::linalg::vector::{Vector3, cross, dot, norm, scale, sub};

/// Below this angle (radians, 20°) directions are taken to be what SMPL's rest pose means by them.
///
/// The bones of SMPL's own template leave the coordinate axes by up to about ten degrees, elbows and knees are bent by as
/// much, and its prior disregards both.
const SMPL_LIKE_RAD: f64 = 0.35;

/// A joint that bends one way: an elbow or a knee.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// The joint.
    pub joint: usize,
    /// The unit axis a in the rest frame; a positive turn about it bends the joint.
    pub axis: Vector3,
    /// φ₀, how far the joint is bent at rest, radians.
    pub rest_flexion_rad: f64,
}

impl Hinge {
    /// The flexion φ = φ₀ + a·θ in a pose of 3J numbers, radians: 0 for a straight limb, negative for a hyper-extended one.
    pub fn flexion_rad(&self, pose: &[f64]) -> f64 {
        let theta = &pose[3 * self.joint..3 * self.joint + 3];
        self.rest_flexion_rad + dot(self.axis, [theta[0], theta[1], theta[2]])
    }
}

/// (joint before, hinge, joint after) and whether it bends forward: left elbow, right elbow, left knee, right knee.
///
/// The numbers are SMPL's; SMPL-H and SMPL-X share them.
const LIMBS: [([usize; 3], bool); 4] =
    [([16, 18, 20], true), ([17, 19, 21], true), ([1, 4, 7], false), ([2, 5, 8], false)];

impl Skeleton {
    /// The hinges of a skeleton with SMPL's first 22 joints: left elbow, right elbow, left knee, right knee.
    ///
    /// Three cases, from the rest joints at β = 0:
    /// 1. The natural axis is within 20° of a coordinate axis and the rest flexion below 20°: SMPL's convention itself, the
    ///    exact coordinate axis and φ₀ = 0.
    /// 2. The limb is bent by more than 20° at rest, within 45° of the natural way: the axis is that of the bend, d × e.
    /// 3. Otherwise the natural axis, with φ₀ the part of the bend that is about it.
    ///
    /// `None` for a limb that tells nothing: joints that are not there or not connected, a bone without length, or a
    /// straight limb that points forward or backward, to which no bend is natural. An upper bone within 20° of ±z has no
    /// natural axis; a visible bend is then taken as it is.
    ///
    /// ```
    /// let [left_elbow, _, left_knee, _] = vitruvian_reference::body::mannequin().skeleton().hinges();
    /// assert_eq!(left_elbow.expect("a T-pose").axis, [0.0, -1.0, 0.0]); // θ₅₅ with sign −
    /// assert_eq!(left_knee.expect("a T-pose").axis, [1.0, 0.0, 0.0]); // θ₁₂ with sign +
    /// ```
    pub fn hinges(&self) -> [Option<Hinge>; 4] {
        LIMBS.map(|([before, joint, after], forward)| {
            let connected = after < self.joint_count()
                && self.parents[joint] == Some(before)
                && self.parents[after] == Some(joint);
            let d = direction(self.template.get(before)?, self.template.get(joint)?)?;
            let e = direction(self.template.get(joint)?, self.template.get(after)?)?;
            let (axis, rest_flexion_rad) = bend(d, e, forward)?;
            connected.then_some(Hinge { joint, axis, rest_flexion_rad })
        })
    }
}

/// The axis and the rest flexion of a hinge between bones of directions d and e.
fn bend(d: Vector3, e: Vector3, forward: bool) -> Option<(Vector3, f64)> {
    let natural = cross(d, [0.0, 0.0, if forward { 1.0 } else { -1.0 }]);
    let natural = (norm(natural) > SMPL_LIKE_RAD.sin()).then(|| scale(natural, 1.0 / norm(natural)));
    let normal = cross(d, e);
    let angle = norm(normal).atan2(dot(d, e));
    // Folded back upon itself, a limb has as little of a plane as when it is straight.
    let visible = angle > SMPL_LIKE_RAD && norm(normal) > SMPL_LIKE_RAD.sin();
    let bent = visible.then(|| (scale(normal, 1.0 / norm(normal)), angle));

    let Some(natural) = natural else {
        return bent;
    };
    if let Some((axis, angle)) = bent
        && dot(axis, natural) > std::f64::consts::FRAC_1_SQRT_2
    {
        return Some((axis, angle));
    }
    // d is orthogonal to the natural axis, so the part of e along it does not count.
    let rest_flexion = dot(natural, normal).atan2(dot(d, e));
    match nearest_coordinate_axis(natural) {
        Some(axis) if rest_flexion.abs() < SMPL_LIKE_RAD => Some((axis, 0.0)),
        _ => Some((natural, rest_flexion)),
    }
}

/// The coordinate axis, with its sign, within 20° of the unit vector `a`.
fn nearest_coordinate_axis(a: Vector3) -> Option<Vector3> {
    let close = a.iter().position(|x| x.abs() > SMPL_LIKE_RAD.cos())?;
    let mut axis = [0.0; 3];
    axis[close] = a[close].signum();
    Some(axis)
}

fn direction(from: &Vector3, to: &Vector3) -> Option<Vector3> {
    let bone = sub(*to, *from);
    let length = norm(bone);
    (length > 0.0 && length.is_finite()).then(|| scale(bone, 1.0 / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;
    use crate::linalg::vector::{add_scaled, distance, normalize};
    use crate::rotation::rotate;

    /// The mannequin's skeleton with the left arm re-drawn: the upper bone along `d`, the lower along `e`.
    fn left_arm(d: Vector3, e: Vector3) -> Skeleton {
        let mut skeleton = mannequin().skeleton();
        skeleton.template[18] = add_scaled(skeleton.template[16], d, 0.28);
        skeleton.template[20] = add_scaled(skeleton.template[18], e, 0.25);
        skeleton
    }

    fn left_elbow(d: Vector3, e: Vector3) -> Option<Hinge> {
        left_arm(d, e).hinges()[0]
    }

    #[test]
    fn t_pose_has_the_indices_and_signs_of_smpl() {
        let hinges = mannequin().skeleton().hinges().map(|h| h.expect("a T-pose"));
        // θ₅₅ −, θ₅₈ +, θ₁₂ +, θ₁₅ +, and nothing bent.
        for (hinge, (index, sign)) in hinges.iter().zip([(55, -1.0), (58, 1.0), (12, 1.0), (15, 1.0)]) {
            let mut pose = [0.0; 72];
            assert_eq!(hinge.flexion_rad(&pose), 0.0);
            pose[index] = 0.5;
            assert_eq!(hinge.flexion_rad(&pose), sign * 0.5);
            assert_eq!(norm(hinge.axis), 1.0);
        }
    }

    #[test]
    fn small_bends_and_tilts_of_a_template_are_those_of_a_t_pose() {
        let hinge = left_elbow(normalize([1.0, -0.2, -0.1]), normalize([1.0, 0.05, 0.1])).expect("a T-pose");
        assert_eq!((hinge.axis, hinge.rest_flexion_rad), ([0.0, -1.0, 0.0], 0.0));
    }

    #[test]
    fn planted_axis_and_flexion_of_an_a_pose_are_found() {
        // The arm 45° down, turned about its own length by some degrees, the elbow bent by a planted angle.
        let d = normalize([1.0, -1.0, 0.1]);
        for twist in [-0.6, 0.0, 0.5] {
            let axis = rotate(scale(d, twist), normalize(cross(d, [0.0, 0.0, 1.0])));
            for flexion in [0.4, 0.73, 1.5, 2.4] {
                let hinge = left_elbow(d, rotate(scale(axis, flexion), d)).expect("a bent arm");
                assert!(distance(hinge.axis, axis) < 1e-12, "{hinge:?}");
                assert!((hinge.rest_flexion_rad - flexion).abs() < 1e-12, "{hinge:?}");
                assert_eq!(hinge.joint, 18);
            }
        }
    }

    #[test]
    fn straight_arm_of_an_a_pose_bends_forward() {
        let d = normalize([1.0, -1.0, 0.0]);
        let hinge = left_elbow(d, d).expect("an A-pose");
        assert!(distance(hinge.axis, normalize([-1.0, -1.0, 0.0])) < 1e-15 && hinge.rest_flexion_rad == 0.0);
        // A positive turn moves the forearm forward.
        assert!(rotate(scale(hinge.axis, 0.3), d)[2] > 0.2);
    }

    #[test]
    fn hyper_extended_rest_is_a_negative_flexion() {
        let d = normalize([1.0, -1.0, 0.0]);
        let back = rotate(scale(normalize([-1.0, -1.0, 0.0]), -0.5), d);
        let hinge = left_elbow(d, back).expect("bent the wrong way");
        assert!((hinge.rest_flexion_rad + 0.5).abs() < 1e-12, "{hinge:?}");
        assert!(distance(hinge.axis, normalize([-1.0, -1.0, 0.0])) < 1e-15);
    }

    #[test]
    fn knees_bend_backward() {
        let mut skeleton = mannequin().skeleton();
        // The left leg spread, bent by 60° so that the shank points back.
        let d = normalize([0.7, -0.7, 0.0]);
        let axis = normalize(cross(d, [0.0, 0.0, -1.0]));
        skeleton.template[4] = add_scaled(skeleton.template[1], d, 0.4);
        skeleton.template[7] = add_scaled(skeleton.template[4], rotate(scale(axis, 1.0), d), 0.4);
        let knee = skeleton.hinges()[2].expect("a bent knee");
        assert!(skeleton.template[7][2] < skeleton.template[4][2]);
        assert!(distance(knee.axis, axis) < 1e-12 && (knee.rest_flexion_rad - 1.0).abs() < 1e-12);
    }

    #[test]
    fn limbs_that_tell_nothing_have_no_hinge() {
        let z = [0.0, 0.0, 1.0];
        assert_eq!(left_elbow(z, z), None, "a straight arm stretched forward");
        assert!(left_elbow(z, normalize([0.0, 1.0, 1.0])).is_some_and(|h| h.axis == [-1.0, 0.0, 0.0]));
        assert_eq!(left_elbow([0.0; 3], z), None, "no upper arm");
        assert_eq!(left_elbow(z, [f64::NAN; 3]), None);
        let mut other_tree = mannequin().skeleton();
        other_tree.parents[20] = Some(17);
        assert_eq!(other_tree.hinges()[0], None);
        let few = Skeleton { template: vec![[0.0; 3]; 8], shapedirs: Vec::new(), parents: vec![None; 8] };
        assert_eq!(few.hinges(), [None; 4]);
    }
}

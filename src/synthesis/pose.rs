//! Random poses that a person could take, for any body with SMPL's tree, whatever its rest pose.
//!
//! Limbs are drawn as *directions* in the rest frame (an arm hangs, reaches or is raised; a knee bends backwards), and
//! the joint's rotation is the smallest one that carries the rest direction there. So a body resting in a T-pose and
//! one resting with hanging, bent arms take the same poses.

use rand::Rng;
use vitruvian_reference::linalg::matrix::{Matrix3, apply, mul};
use vitruvian_reference::linalg::vector::{Vector3, cross, dot, norm, normalize, scale, sub};
use vitruvian_reference::rotation::{logarithm, rodrigues};

use super::normal;

const X: Vector3 = [1.0, 0.0, 0.0];
const Y: Vector3 = [0.0, 1.0, 0.0];
const Z: Vector3 = [0.0, 0.0, 1.0];

/// How often a random pose is drawn again because limbs run through each other.
const ATTEMPTS: usize = 200;

/// Draws a pose θ \[72\] (axis-angle, radians, SMPL's joint order) with a uniform heading.
///
/// `rest_joints` are the body's 24 rest joints in metres, from which the limbs' rest directions are read. `clear` says
/// whether a pose keeps the limbs apart; the last draw is returned if none does.
pub fn random_pose(rng: &mut impl Rng, rest_joints: &[Vector3], clear: impl Fn(&[f64]) -> bool) -> Vec<f64> {
    let mut pose = draw(rng, rest_joints);
    for _ in 0..ATTEMPTS {
        if clear(&pose) {
            break;
        }
        pose = draw(rng, rest_joints);
    }
    pose
}

/// Draws a heading for a body that stands in the A-pose: upper arms 45° down to the sides, forearms in line with them,
/// everything else at rest. θ \[72\]; `rest_joints` as for [`random_pose`].
pub fn a_pose(rng: &mut impl Rng, rest_joints: &[Vector3]) -> Vec<f64> {
    let mut rotations = vec![rodrigues([0.0; 3]); 24];
    rotations[0] = about(Y, rng.random_range(0.0..std::f64::consts::TAU));
    for (side, [shoulder, elbow, wrist]) in [(1.0, [16, 18, 20]), (-1.0, [17, 19, 21])] {
        let upper = normalize(sub(rest_joints[elbow], rest_joints[shoulder]));
        rotations[shoulder] = smallest_rotation(upper, normalize([side, -1.0, 0.0]));
        rotations[elbow] = hinge(rest_joints, [shoulder, elbow, wrist], Y, 0.0);
    }
    rotations.iter().flat_map(logarithm).collect()
}

fn draw(rng: &mut impl Rng, rest: &[Vector3]) -> Vec<f64> {
    let mut rotations = vec![rodrigues([0.0; 3]); 24];
    let heading = rng.random_range(0.0..std::f64::consts::TAU);
    rotations[0] = mul(&about(Y, heading), &wobble(rng, [6.0, 0.0, 4.0]));
    for joint in [3, 6, 9] {
        rotations[joint] = mul(&about(X, degrees(rng, 3.0, 5.0)), &wobble(rng, [0.0, 5.0, 4.0]));
    }
    for joint in [12, 15] {
        rotations[joint] = wobble(rng, [9.0, 12.0, 6.0]);
    }
    for (side, [hip, knee, ankle]) in [(1.0, [1, 4, 7]), (-1.0, [2, 5, 8])] {
        let swing = degrees(rng, 8.0, 22.0);
        let spread = side * degrees(rng, 6.0, 6.0).max(-0.03);
        rotations[hip] = mul(&about(X, -swing), &mul(&about(Z, spread), &about(Y, degrees(rng, 0.0, 10.0))));
        let bend = (degrees(rng, 12.0, 22.0) + swing.max(0.0) * 0.8).clamp(0.0, 2.0);
        rotations[knee] = hinge(rest, [hip, knee, ankle], X, bend);
        rotations[ankle] = wobble(rng, [8.0, 5.0, 4.0]);
    }
    for (side, [collar, shoulder, elbow, wrist]) in [(1.0, [13, 16, 18, 20]), (-1.0, [14, 17, 19, 21])] {
        rotations[collar] = wobble(rng, [0.0, 5.0, 5.0]);
        let upper = normalize(sub(rest[elbow], rest[shoulder]));
        let target = arm_direction(rng, side);
        rotations[shoulder] = mul(&smallest_rotation(upper, target), &about(upper, degrees(rng, 0.0, 20.0)));
        let bend = degrees(rng, 25.0, 30.0).abs().min(2.2);
        rotations[elbow] = hinge(rest, [shoulder, elbow, wrist], normalize(cross(upper, Z)), bend);
        rotations[wrist] = wobble(rng, [10.0, 10.0, 12.0]);
    }
    rotations.iter().flat_map(logarithm).collect()
}

/// Where an upper arm points in the trunk's frame: hanging (60 %), out or forward (30 %), or raised (10 %).
fn arm_direction(rng: &mut impl Rng, side: f64) -> Vector3 {
    let (elevation, forward) = match rng.random_range(0.0..1.0) {
        p if p < 0.6 => (rng.random_range(10.0..50.0), degrees(rng, 15.0, 35.0)),
        p if p < 0.9 => (rng.random_range(50.0..100.0), rng.random_range(-0.35..1.2)),
        _ => (rng.random_range(100.0..150.0), rng.random_range(-0.2..0.8)),
    };
    let elevation: f64 = f64::to_radians(elevation);
    let out = elevation.sin();
    [side * out * forward.cos(), -elevation.cos(), out * forward.sin()]
}

/// The rotation at joint b that makes the chain a–b–c bend by `angle` about `axis`, whatever its bend at rest.
fn hinge(rest: &[Vector3], [a, b, c]: [usize; 3], axis: Vector3, angle: f64) -> Matrix3 {
    let upper = normalize(sub(rest[b], rest[a]));
    let lower = normalize(sub(rest[c], rest[b]));
    smallest_rotation(lower, apply(&about(axis, angle), upper))
}

/// The smallest rotation that carries unit vector `from` to unit vector `to`.
fn smallest_rotation(from: Vector3, to: Vector3) -> Matrix3 {
    let axis = cross(from, to);
    let sine = norm(axis);
    if sine < 1e-9 {
        return rodrigues([0.0; 3]);
    }
    rodrigues(scale(axis, sine.atan2(dot(from, to)) / sine))
}

fn about(axis: Vector3, angle: f64) -> Matrix3 {
    rodrigues(scale(axis, angle))
}

/// A normal angle in radians, mean and deviation given in degrees, limited to 2.2 deviations.
fn degrees(rng: &mut impl Rng, mean: f64, deviation: f64) -> f64 {
    (mean + deviation * normal(rng, 2.2)).to_radians()
}

/// Small independent turns about x, y and z, deviations in degrees.
fn wobble(rng: &mut impl Rng, deviations: [f64; 3]) -> Matrix3 {
    let [x, y, z] = deviations.map(|d| degrees(rng, 0.0, d));
    mul(&about(X, x), &mul(&about(Y, y), &about(Z, z)))
}

/// Whether the forearms and hands of posed joints keep `gap` metres from the spine and 0.7 `gap` from the thighs, and
/// the shins 0.4 `gap` from each other.
pub fn limbs_are_apart(joints: &[Vector3], gap: f64) -> bool {
    let spine = [[0, 3], [3, 9], [9, 12], [12, 15]];
    let thighs = [[1, 4], [2, 5]];
    for arm in [[18, 20], [20, 22], [19, 21], [21, 23]] {
        let far =
            |bones: &[[usize; 2]], gap: f64| bones.iter().all(|&bone| bone_distance(joints, arm, bone) > gap);
        if !far(&spine, gap) || !far(&thighs, 0.7 * gap) {
            return false;
        }
    }
    let forearms_apart = bone_distance(joints, [18, 22], [19, 23]) > 0.6 * gap;
    forearms_apart
        && bone_distance(joints, [4, 7], [5, 8]) > 0.5 * gap
        && bone_distance(joints, [7, 10], [8, 11]) > 0.4 * gap
}

/// Smallest distance between two bones, sampled at eleven points of each (metres; bones are short).
fn bone_distance(joints: &[Vector3], [a, b]: [usize; 2], [c, d]: [usize; 2]) -> f64 {
    let at = |p: Vector3, q: Vector3, t: f64| std::array::from_fn::<f64, 3, _>(|k| p[k] + t * (q[k] - p[k]));
    let mut least = f64::INFINITY;
    for i in 0..=10 {
        let p = at(joints[a], joints[b], f64::from(i) / 10.0);
        for j in 0..=10 {
            least = least.min(norm(sub(p, at(joints[c], joints[d], f64::from(j) / 10.0))));
        }
    }
    least
}

//! A pose from points in space, bone by bone: the analytic start of a fit.
//!
//! From the root outwards every joint is turned so that its bones point at their targets: a joint with several bones
//! (pelvis, upper spine) by the rotation that fits them together, one with a single bone by the smallest rotation that aims
//! it. The turn *about* a bone moves no joint below while the next joint makes up for it; for shoulders and hips it is
//! chosen so that elbow and knee bend about their own axes.

use crate::body::{Hinge, Skeleton};
use crate::linalg::cholesky::Cholesky;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{self, IDENTITY, Matrix3, apply, apply_transposed, mul, outer};
use crate::linalg::svd::nearest_rotation;
use crate::linalg::vector::{Vector3, add, centroid, cross, distance, dot, norm, scale, sub};
use crate::metric::procrustes::Similarity;
use crate::rotation::{logarithm, rodrigues};

/// The joints of SMPL's tree that hardly move against each other.
pub const TORSO: [usize; 11] = [0, 1, 2, 3, 6, 9, 12, 13, 14, 16, 17];

/// A pose with the root's place.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// θ, 3J numbers.
    pub pose: Vec<f64>,
    /// Such that the root joint lies where the torso has it.
    pub trans: Vector3,
}

/// The pose and place in which a skeleton of shape `betas` comes near its `targets` (J, `None` where unknown); `None` if fewer
/// than three joints of the torso are known, or they lie on a line.
///
/// # Panics
/// If there are not J targets or the tree is not SMPL's.
pub fn inverse_kinematics(
    skeleton: &Skeleton,
    betas: &[f64],
    targets: &[Option<Vector3>],
    hinges: &[Hinge],
) -> Option<Placed> {
    let j = skeleton.joint_count();
    assert!(targets.len() == j, "inverse_kinematics: {} targets, {j} joints", targets.len());
    let rest = skeleton.rest_joints(betas);
    let (root, root_position) = place_torso(&rest, targets)?;
    let mut children = vec![Vec::new(); j];
    for (child, parent) in skeleton.parents.iter().enumerate() {
        if let Some(p) = *parent {
            children[p].push(child);
        }
    }

    let mut pose = vec![0.0; 3 * j];
    // World rotation and position of every joint so far.
    let mut turned: Vec<Matrix3> = Vec::with_capacity(j);
    let mut position: Vec<Vector3> = Vec::with_capacity(j);
    for k in 0..j {
        let (inherited, at) = match skeleton.parents[k] {
            None => (IDENTITY, root_position),
            Some(p) => (turned[p], add(position[p], apply(&turned[p], sub(rest[k], rest[p])))),
        };
        position.push(at);
        let aims: Vec<(Vector3, Vector3)> = children[k]
            .iter()
            .filter_map(|&c| {
                Some((sub(rest[c], rest[k]), apply_transposed(&inherited, sub(targets[c]?, at))))
            })
            .filter(|(bone, aim)| norm(*bone) > 1e-6 && norm(*aim) > 1e-6)
            .collect();
        let local = if k == 0 {
            root
        } else {
            match aims[..] {
                [] => IDENTITY,
                [(bone, aim)] => {
                    let swing = smallest_rotation(bone, aim);
                    let twist =
                        bend_twist(k, &rest, targets, &children, hinges, &mul(&inherited, &swing), at);
                    mul(&swing, &rodrigues(twist))
                }
                _ => fitting_rotation(&aims),
            }
        };
        turned.push(mul(&inherited, &local));
        pose[3 * k..3 * k + 3].copy_from_slice(&logarithm(&local));
    }
    // The root turns about its own rest joint.
    Some(Placed { pose, trans: sub(root_position, rest[0]) })
}

/// Rotation of the root and place of its joint, from what is known of the torso.
fn place_torso(rest: &[Vector3], targets: &[Option<Vector3>]) -> Option<(Matrix3, Vector3)> {
    let (from, to): (Vec<Vector3>, Vec<Vector3>) =
        TORSO.iter().filter_map(|&j| Some((rest[j], targets[j]?))).unzip();
    if from.len() < 3 || !spans_a_plane(&from) || !spans_a_plane(&to) {
        return None;
    }
    let torso = Similarity::aligning(&from, &to);
    // The torso's scale is that of other bones: only its rotation and centre are taken.
    let root = apply(&torso.rotation, sub(rest[0], centroid(&from)));
    let at = targets[0].unwrap_or(add(centroid(&to), root));
    // Where hips and the lower spine are seen the pelvis itself turns as they say.
    let pelvis: Vec<(Vector3, Vector3)> =
        [1, 2, 3].iter().filter_map(|&c| Some((sub(rest[c], rest[0]), sub(targets[c]?, at)))).collect();
    let rotation =
        if pelvis.len() == 3 && targets[0].is_some() { fitting_rotation(&pelvis) } else { torso.rotation };
    Some((rotation, at))
}

/// Whether points are farther apart than a line: the second singular value of their spread counts.
fn spans_a_plane(points: &[Vector3]) -> bool {
    let mean = centroid(points);
    let spread =
        points.iter().fold([[0.0; 3]; 3], |sum, &p| matrix::add(&sum, &outer(sub(p, mean), sub(p, mean))));
    if !spread.iter().flatten().all(|x| x.is_finite()) {
        return false;
    }
    let [first, second, _] = crate::linalg::svd::svd3(&spread).singular_values;
    second > 1e-4 * first && first > 0.0
}

/// The rotation R that minimises Σ ‖R bone − aim‖² over unit directions.
fn fitting_rotation(aims: &[(Vector3, Vector3)]) -> Matrix3 {
    let sum = aims.iter().fold([[0.0; 3]; 3], |sum, &(bone, aim)| {
        matrix::add(&sum, &outer(aim, scale(bone, 1.0 / norm(aim))))
    });
    nearest_rotation(&sum)
}

/// The smallest rotation that carries the direction of `from` to that of `to`.
fn smallest_rotation(from: Vector3, to: Vector3) -> Matrix3 {
    let axis = cross(from, to);
    let (sine, cosine) = (norm(axis), dot(from, to));
    if sine > 1e-9 * norm(from) * norm(to) {
        rodrigues(scale(axis, sine.atan2(cosine) / sine))
    } else if cosine >= 0.0 {
        IDENTITY
    } else {
        // Opposite: half a turn about any axis across.
        let across =
            cross(from, if from[0].abs() < 0.5 * norm(from) { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] });
        rodrigues(scale(across, std::f64::consts::PI / norm(across)))
    }
}

/// The turn of joint k about its bone, in its rest frame, that lets the hinge below bend about its own axis to reach its
/// target; zero if k carries no hinge or the target is unknown.
fn bend_twist(
    k: usize,
    rest: &[Vector3],
    targets: &[Option<Vector3>],
    children: &[Vec<usize>],
    hinges: &[Hinge],
    turned: &Matrix3,
    at: Vector3,
) -> Vector3 {
    let [hinge_joint] = children[k][..] else { return [0.0; 3] };
    let Some(hinge) = hinges.iter().find(|h| h.joint == hinge_joint) else { return [0.0; 3] };
    let Some(tip) = children[hinge_joint].first().and_then(|&c| targets[c]) else { return [0.0; 3] };
    let bone = sub(rest[hinge_joint], rest[k]);
    let unit = scale(bone, 1.0 / norm(bone));
    let elbow = add(at, apply(turned, bone));
    // The lower limb as it should be, in the frame of the upper one; its plane's normal is the axis of the bend.
    let lower = apply_transposed(turned, sub(tip, elbow));
    let normal = cross(unit, lower);
    let wanted = norm(normal);
    // A nearly straight limb says nothing about its twist.
    if wanted < 0.2 * norm(lower) {
        return [0.0; 3];
    }
    let across = sub(hinge.axis, scale(unit, dot(hinge.axis, unit)));
    let angle = dot(cross(across, normal), unit).atan2(dot(across, normal));
    scale(unit, angle)
}

/// The shape whose bones are as long as those between the targets, at the targets' scale times s; and s.
///
/// Ridge regression of the lengths that are known, linear at β = 0: ‖b + D β‖ ≈ ‖b‖ + b·Dβ/‖b‖, each length trusted to
/// `deviation_m`, each β to one standard deviation. With `free_scale` the targets' unit is unknown and the scale of least
/// squares is taken before β.
pub fn bone_lengths(
    skeleton: &Skeleton,
    targets: &[Option<Vector3>],
    deviation_m: f64,
    free_scale: bool,
) -> (Vec<f64>, f64) {
    let rest = &skeleton.template;
    let b = skeleton.beta_count();
    let bones: Vec<(usize, usize, f64)> = skeleton
        .parents
        .iter()
        .enumerate()
        .filter_map(|(c, parent)| {
            let p = (*parent)?;
            Some((p, c, distance(targets[p]?, targets[c]?)))
        })
        .collect();
    let lengths = || bones.iter().map(|&(p, c, found)| (distance(rest[p], rest[c]), found));
    let found_squared: f64 = lengths().map(|(_, found)| found * found).sum();
    let scale_factor = if free_scale && found_squared > 0.0 {
        lengths().map(|(own, found)| own * found).sum::<f64>() / found_squared
    } else {
        1.0
    };
    let mut gram = Dense::zeros(b, b);
    let mut right = vec![0.0; b];
    for i in 0..b {
        gram[(i, i)] = deviation_m * deviation_m;
    }
    for &(p, c, found) in &bones {
        let bone = sub(rest[c], rest[p]);
        let own = norm(bone);
        if own < 1e-6 {
            continue;
        }
        let slope: Vec<f64> = (0..b)
            .map(|l| {
                let moved = |axis: usize| {
                    skeleton.shapedirs[(3 * c + axis) * b + l] - skeleton.shapedirs[(3 * p + axis) * b + l]
                };
                (0..3).map(|axis| bone[axis] * moved(axis)).sum::<f64>() / own
            })
            .collect();
        let missing = scale_factor * found - own;
        for i in 0..b {
            right[i] += slope[i] * missing;
            for j in 0..=i {
                gram[(i, j)] += slope[i] * slope[j];
            }
        }
    }
    let betas = match Cholesky::factor(&gram) {
        Some(cholesky) => cholesky.solve(&right).into_iter().map(|x| x.clamp(-3.0, 3.0)).collect(),
        None => vec![0.0; b],
    };
    (betas, scale_factor)
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{fitter, joints, person};
    use super::*;

    fn hinges() -> Vec<Hinge> {
        fitter().skeleton().hinges().into_iter().flatten().collect()
    }

    #[test]
    fn a_planted_pose_is_reached_joint_by_joint() {
        for seed in 0..5 {
            let person = person(seed);
            let targets: Vec<Option<Vector3>> = joints(&person).into_iter().map(Some).collect();
            let skeleton = fitter().skeleton();
            let placed = inverse_kinematics(skeleton, &person.betas, &targets, &hinges()).expect("a torso");
            let reached = skeleton.posed_joints(&placed.pose, &person.betas);
            for (joint, (reached, target)) in reached.iter().zip(&targets).enumerate() {
                let error = distance(add(*reached, placed.trans), target.expect("all are known"));
                assert!(error < 1e-9, "person {seed}, joint {joint}: {error} m");
            }
        }
    }

    #[test]
    fn elbows_and_knees_bend_about_their_axes() {
        let mut planted = person(0);
        planted.pose[3..].fill(0.0);
        // Left elbow and right knee, with their upper limbs twisted.
        for (n, angle) in [(48, 0.7), (50, -0.5), (55, -1.2), (7, 0.6), (15, 1.0)] {
            planted.pose[n] = angle;
        }
        let targets: Vec<Option<Vector3>> = joints(&planted).into_iter().map(Some).collect();
        let placed =
            inverse_kinematics(fitter().skeleton(), &planted.betas, &targets, &hinges()).expect("a torso");
        for hinge in hinges() {
            let theta = &placed.pose[3 * hinge.joint..3 * hinge.joint + 3];
            let flexion = dot(hinge.axis, [theta[0], theta[1], theta[2]]);
            let length = norm([theta[0], theta[1], theta[2]]);
            // The mannequin's limbs rest bent by a few degrees.
            assert!(length < 0.2 || flexion > 0.95 * length, "joint {}: {theta:?}", hinge.joint);
        }
    }

    #[test]
    fn unknown_joints_stay_at_rest_and_an_unknown_torso_has_no_pose() {
        let person = person(1);
        let mut targets: Vec<Option<Vector3>> = joints(&person).into_iter().map(Some).collect();
        for joint in [18, 20, 22] {
            targets[joint] = None;
        }
        let skeleton = fitter().skeleton();
        let placed = inverse_kinematics(skeleton, &person.betas, &targets, &hinges()).expect("a torso");
        assert!(placed.pose[3 * 18..3 * 19].iter().all(|x| *x == 0.0));
        for joint in TORSO {
            targets[joint] = None;
        }
        assert_eq!(inverse_kinematics(skeleton, &person.betas, &targets, &hinges()), None);
        let line: Vec<Option<Vector3>> = (0..24).map(|j| Some([0.0, f64::from(j), 0.0])).collect();
        assert_eq!(inverse_kinematics(skeleton, &person.betas, &line, &hinges()), None);
    }

    #[test]
    fn bone_lengths_give_back_the_shape_and_the_unit() {
        let person = person(2);
        let truth = joints(&person);
        let of_unit = |unit: f64| -> Vec<Option<Vector3>> {
            truth.iter().map(|p| Some(scale(*p, 1.0 / unit))).collect()
        };
        let skeleton = fitter().skeleton();
        let lengths = |betas: &[f64]| -> Vec<f64> {
            let rest = skeleton.rest_joints(betas);
            (1..24).map(|c| distance(rest[c], rest[skeleton.parents[c].expect("a bone")])).collect()
        };
        let (betas, unit) = bone_lengths(skeleton, &of_unit(1.0), 1e-4, false);
        assert_eq!(unit, 1.0);
        for (a, b) in lengths(&betas).iter().zip(lengths(&person.betas)) {
            assert!((a - b).abs() < 5e-3, "{a} m for {b} m");
        }
        let (_, unit) = bone_lengths(skeleton, &of_unit(3.0), 0.02, true);
        assert!((unit / 3.0 - 1.0).abs() < 0.15, "{unit}");
    }

    #[test]
    fn half_turns_have_a_smallest_rotation() {
        for v in [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.3, -0.2, 0.9]] {
            let turned = apply(&smallest_rotation(v, scale(v, -3.0)), v);
            assert!(distance(turned, scale(v, -1.0)) < 1e-12, "{turned:?}");
            assert_eq!(smallest_rotation(v, v), IDENTITY);
        }
    }
}

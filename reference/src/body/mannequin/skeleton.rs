//! The mannequin's joints and bones at rest: a T-pose, metres, pelvis at the origin.

use crate::linalg::vector::{Vector3, add_scaled, dot, norm, sub};

/// J, as in SMPL.
pub(super) const JOINT_COUNT: usize = 24;

/// The names of the joints in SMPL's order.
pub const JOINT_NAMES: [&str; JOINT_COUNT] = [
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
];

/// SMPL's tree.
pub const PARENTS: [Option<usize>; JOINT_COUNT] = [
    None,
    Some(0),
    Some(0),
    Some(0),
    Some(1),
    Some(2),
    Some(3),
    Some(4),
    Some(5),
    Some(6),
    Some(7),
    Some(8),
    Some(9),
    Some(9),
    Some(9),
    Some(12),
    Some(13),
    Some(14),
    Some(16),
    Some(17),
    Some(18),
    Some(19),
    Some(20),
    Some(21),
];

/// The same joint on the other side of the body; joints of the spine are their own.
pub const MIRRORED_JOINT: [usize; JOINT_COUNT] =
    [0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20, 23, 22];

/// Joints of the spine and of the left side; the right side mirrors the left exactly.
const LEFT: [(usize, Vector3); 15] = [
    (0, [0.0, 0.0, 0.0]),
    (1, [0.092, -0.070, -0.004]),
    (3, [0.0, 0.100, -0.022]),
    (4, [0.118, -0.470, 0.004]),
    (6, [0.0, 0.210, -0.018]),
    (7, [0.140, -0.860, -0.032]),
    (9, [0.0, 0.285, -0.008]),
    (10, [0.152, -0.908, 0.085]),
    (12, [0.0, 0.500, -0.018]),
    (13, [0.070, 0.430, -0.016]),
    (15, [0.0, 0.590, 0.010]),
    (16, [0.178, 0.445, -0.020]),
    (18, [0.440, 0.445, -0.026]),
    (20, [0.685, 0.445, -0.020]),
    (22, [0.768, 0.441, -0.014]),
];

/// x ↦ −x: the reflection in the body's plane of symmetry.
pub(super) fn mirrored(p: Vector3) -> Vector3 {
    [-p[0], p[1], p[2]]
}

/// The rest joints, 24×3 metres.
pub(super) fn rest_joints() -> [Vector3; JOINT_COUNT] {
    let mut joints = [[0.0; 3]; JOINT_COUNT];
    for (j, position) in LEFT {
        joints[j] = position;
        if MIRRORED_JOINT[j] != j {
            joints[MIRRORED_JOINT[j]] = mirrored(position);
        }
    }
    joints
}

/// The segments along which a joint carries flesh: (joint, from, to), spine and left side.
///
/// Most are the bones; some stand for the width of a part that its bone does not show (ribs, pelvis, skull, heel), so
/// that "the nearest bone" is the one that an anatomist would name.
pub(super) const BONES: [(usize, Vector3, Vector3); 24] = [
    (0, [0.0, 0.020, 0.0], [0.0, -0.090, 0.0]),
    (0, [0.0, 0.020, 0.0], [0.125, 0.015, 0.0]),
    (0, [0.0, -0.040, -0.050], [0.060, -0.040, -0.060]),
    (1, [0.098, -0.110, 0.0], [0.118, -0.470, 0.004]),
    (3, [0.0, 0.105, -0.02], [0.0, 0.190, -0.02]),
    (3, [0.0, 0.145, 0.0], [0.110, 0.145, 0.0]),
    (4, [0.118, -0.470, 0.004], [0.140, -0.860, -0.032]),
    (6, [0.0, 0.210, -0.018], [0.0, 0.285, -0.008]),
    (6, [0.0, 0.250, 0.010], [0.120, 0.250, 0.010]),
    (7, [0.140, -0.860, -0.032], [0.152, -0.908, 0.085]),
    (7, [0.140, -0.870, -0.040], [0.144, -0.905, -0.070]),
    (9, [0.0, 0.330, -0.010], [0.0, 0.480, -0.018]),
    (9, [0.0, 0.350, 0.020], [0.110, 0.350, 0.020]),
    (9, [0.090, 0.330, -0.050], [0.100, 0.380, -0.050]),
    (10, [0.152, -0.908, 0.085], [0.156, -0.912, 0.165]),
    (12, [0.0, 0.500, -0.018], [0.0, 0.575, 0.004]),
    (13, [0.070, 0.440, -0.016], [0.178, 0.450, -0.020]),
    (15, [0.0, 0.610, 0.015], [0.0, 0.740, 0.010]),
    (15, [0.0, 0.600, 0.030], [0.0, 0.590, 0.090]),
    (16, [0.195, 0.445, -0.020], [0.440, 0.445, -0.026]),
    (18, [0.440, 0.445, -0.026], [0.685, 0.445, -0.020]),
    (20, [0.685, 0.445, -0.020], [0.768, 0.441, -0.014]),
    (20, [0.715, 0.440, 0.0], [0.748, 0.432, 0.065]),
    (22, [0.768, 0.441, -0.014], [0.860, 0.438, -0.012]),
];

/// The distance from `p` to the segment ab.
pub(super) fn distance_to_segment(p: Vector3, a: Vector3, b: Vector3) -> f64 {
    let (ap, ab) = (sub(p, a), sub(b, a));
    let t = (dot(ap, ab) / dot(ab, ab)).clamp(0.0, 1.0);
    norm(add_scaled(ap, ab, -t))
}

//! The keypoints that detectors find, as points of the body.
//!
//! A detector's "left shoulder" is a point in a picture; on the body it is a joint of the skeleton, a vertex of the skin
//! (nose, ears, toes), or a point between joints. Vertices are numbered in SMPL's own mesh (V = 6890), so on a body with
//! another mesh such keypoints have no point and are left out.

use crate::body::mannequin::{JOINT_NAMES, PARENTS};
use crate::body::{BodyModel, Skeleton};

/// The number of vertices of SMPL's mesh, in which the vertices below are numbered.
pub const SMPL_VERTEX_COUNT: usize = 6890;

/// The joints that SMPL, SMPL-H and SMPL-X share, with the same parents; the hands differ.
pub const SHARED_JOINT_COUNT: usize = 22;

/// Which keypoints a detector gives, and in which order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeypointSet {
    /// The 24 joints of SMPL's tree.
    Smpl24,
    /// OpenPose's BODY_25.
    Body25,
    /// OpenPose's COCO model, with a neck: 18.
    Coco18,
    /// COCO's own 17.
    Coco17,
    /// Leeds Sports Pose: 14.
    Lsp14,
}

/// Where a keypoint lies on a body.
#[derive(Clone, Debug, PartialEq)]
pub enum BodyPoint {
    /// Σ w_j p_j over posed joints, Σ w_j = 1; one joint of weight 1 for most.
    Joints(Vec<(usize, f64)>),
    /// A posed vertex.
    Vertex(usize),
}

/// A keypoint on a given body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyKeypoint {
    /// Where it lies.
    pub point: BodyPoint,
    /// The factor on its residual before the detector's confidence: 0 for points that detectors and skeletons place
    /// differently (hips), which then serve for the start alone.
    pub base_weight: f64,
}

/// A keypoint of a table below.
struct Entry {
    name: &'static str,
    point: Where,
    base_weight: f64,
}

#[derive(Clone, Copy)]
enum Where {
    Joint(usize),
    Vertex(usize),
    /// Regressed from the joints of SMPL's skeleton; on other bodies this joint, with weight 0 if the flag says so.
    Regressed(&'static [(usize, f64)], usize, bool),
}
use Where::{Joint, Regressed, Vertex};

const fn entry(name: &'static str, point: Where, base_weight: f64) -> Entry {
    Entry { name, point, base_weight }
}

/// Hips (and the neck) lie elsewhere for detectors than for SMPL: weight 0, as in SMPLify and SMPLify-X.
const BODY_25: [Entry; 25] = [
    entry("nose", Vertex(332), 1.0),
    entry("neck", Joint(12), 0.0),
    entry("right_shoulder", Joint(17), 1.0),
    entry("right_elbow", Joint(19), 1.0),
    entry("right_wrist", Joint(21), 1.0),
    entry("left_shoulder", Joint(16), 1.0),
    entry("left_elbow", Joint(18), 1.0),
    entry("left_wrist", Joint(20), 1.0),
    entry("mid_hip", Joint(0), 1.0),
    entry("right_hip", Joint(2), 0.0),
    entry("right_knee", Joint(5), 1.0),
    entry("right_ankle", Joint(8), 1.0),
    entry("left_hip", Joint(1), 0.0),
    entry("left_knee", Joint(4), 1.0),
    entry("left_ankle", Joint(7), 1.0),
    entry("right_eye", Vertex(6260), 1.0),
    entry("left_eye", Vertex(2800), 1.0),
    entry("right_ear", Vertex(4071), 1.0),
    entry("left_ear", Vertex(583), 1.0),
    entry("left_big_toe", Vertex(3216), 1.0),
    entry("left_small_toe", Vertex(3226), 1.0),
    entry("left_heel", Vertex(3387), 1.0),
    entry("right_big_toe", Vertex(6617), 1.0),
    entry("right_small_toe", Vertex(6624), 1.0),
    entry("right_heel", Vertex(6787), 1.0),
];

/// With S = (J₁₃ + J₁₄)/2: neck = J₁₂ − 0.55 (J₁₂ − S), shoulders = neck + 2.1 (J₁₃,₁₄ − S), hips = J + 0.38 (J − J′).
const COCO_18: [Entry; 18] = [
    entry("nose", Vertex(331), 1.0),
    entry("neck", Regressed(&[(12, 0.45), (13, 0.275), (14, 0.275)], 12, true), 1.0),
    entry("right_shoulder", Regressed(&[(12, 0.45), (13, -0.775), (14, 1.325)], 17, false), 1.0),
    entry("right_elbow", Joint(19), 1.0),
    entry("right_wrist", Joint(21), 1.0),
    entry("left_shoulder", Regressed(&[(12, 0.45), (13, 1.325), (14, -0.775)], 16, false), 1.0),
    entry("left_elbow", Joint(18), 1.0),
    entry("left_wrist", Joint(20), 1.0),
    entry("right_hip", Regressed(&[(2, 1.38), (1, -0.38)], 2, true), 1.0),
    entry("right_knee", Joint(5), 1.0),
    entry("right_ankle", Joint(8), 1.0),
    entry("left_hip", Regressed(&[(1, 1.38), (2, -0.38)], 1, true), 1.0),
    entry("left_knee", Joint(4), 1.0),
    entry("left_ankle", Joint(7), 1.0),
    entry("right_eye", Vertex(6262), 1.0),
    entry("left_eye", Vertex(2802), 1.0),
    entry("right_ear", Vertex(6880), 1.0),
    entry("left_ear", Vertex(3485), 1.0),
];

const COCO_17: [Entry; 17] = [
    entry("nose", Vertex(332), 1.0),
    entry("left_eye", Vertex(2800), 1.0),
    entry("right_eye", Vertex(6260), 1.0),
    entry("left_ear", Vertex(583), 1.0),
    entry("right_ear", Vertex(4071), 1.0),
    entry("left_shoulder", Joint(16), 1.0),
    entry("right_shoulder", Joint(17), 1.0),
    entry("left_elbow", Joint(18), 1.0),
    entry("right_elbow", Joint(19), 1.0),
    entry("left_wrist", Joint(20), 1.0),
    entry("right_wrist", Joint(21), 1.0),
    entry("left_hip", Joint(1), 0.0),
    entry("right_hip", Joint(2), 0.0),
    entry("left_knee", Joint(4), 1.0),
    entry("right_knee", Joint(5), 1.0),
    entry("left_ankle", Joint(7), 1.0),
    entry("right_ankle", Joint(8), 1.0),
];

const LSP_14: [Entry; 14] = [
    entry("right_ankle", Joint(8), 1.0),
    entry("right_knee", Joint(5), 1.0),
    entry("right_hip", Joint(2), 0.0),
    entry("left_hip", Joint(1), 0.0),
    entry("left_knee", Joint(4), 1.0),
    entry("left_ankle", Joint(7), 1.0),
    entry("right_wrist", Joint(21), 1.0),
    entry("right_elbow", Joint(19), 1.0),
    entry("right_shoulder", Joint(17), 1.0),
    entry("left_shoulder", Joint(16), 1.0),
    entry("left_elbow", Joint(18), 1.0),
    entry("left_wrist", Joint(20), 1.0),
    entry("neck", Joint(12), 0.0),
    entry("head_top", Vertex(411), 1.0),
];

impl KeypointSet {
    /// All sets.
    pub const ALL: [KeypointSet; 5] = [
        KeypointSet::Smpl24,
        KeypointSet::Body25,
        KeypointSet::Coco18,
        KeypointSet::Coco17,
        KeypointSet::Lsp14,
    ];

    fn table(self) -> Option<&'static [Entry]> {
        match self {
            KeypointSet::Smpl24 => None,
            KeypointSet::Body25 => Some(&BODY_25),
            KeypointSet::Coco18 => Some(&COCO_18),
            KeypointSet::Coco17 => Some(&COCO_17),
            KeypointSet::Lsp14 => Some(&LSP_14),
        }
    }

    /// The number of keypoints.
    pub fn count(self) -> usize {
        self.table().map_or(JOINT_NAMES.len(), <[Entry]>::len)
    }

    /// The name of keypoint `k`, as in "left_wrist".
    ///
    /// # Panics
    /// If the set has no keypoint `k`.
    pub fn name(self, k: usize) -> &'static str {
        assert!(k < self.count(), "KeypointSet::name: keypoint {k} of {}", self.count());
        match self.table() {
            None => JOINT_NAMES[k],
            Some(table) => table[k].name,
        }
    }

    /// The same keypoint on the other side of the body; itself for one of the middle.
    ///
    /// # Panics
    /// If the set has no keypoint `k`.
    pub fn mirrored(self, k: usize) -> usize {
        let name = self.name(k);
        let other = match (name.strip_prefix("left_"), name.strip_prefix("right_")) {
            (Some(part), _) => ["right_", part].concat(),
            (_, Some(part)) => ["left_", part].concat(),
            _ => return k,
        };
        (0..self.count()).find(|&m| self.name(m) == other).unwrap_or(k)
    }

    /// The keypoints' points on `body`, `None` for one that this body does not have.
    ///
    /// Vertices and the regressed points of COCO-18 belong to SMPL's mesh and skeleton. On a body with another mesh the
    /// vertices are left out and the regressed points become the nearest joints, neck and hips with weight 0. SMPL's hands
    /// (22, 23) exist on bodies of 24 joints alone: SMPL-H and SMPL-X have fingers in their place.
    pub fn on_body(self, body: &BodyModel) -> Vec<Option<BodyKeypoint>> {
        self.on(body.vertex_count() == SMPL_VERTEX_COUNT, body.joint_count())
    }

    /// The keypoints' points on a body of which only the skeleton is there: those of [`KeypointSet::on_body`] for a body with
    /// another mesh than SMPL's.
    pub fn on_skeleton(self, skeleton: &Skeleton) -> Vec<Option<BodyKeypoint>> {
        self.on(false, skeleton.joint_count())
    }

    fn on(self, own_mesh: bool, joint_count: usize) -> Vec<Option<BodyKeypoint>> {
        let joint = |j: usize| BodyPoint::Joints(vec![(j, 1.0)]);
        let Some(table) = self.table() else {
            let there = |j: usize| j < SHARED_JOINT_COUNT || joint_count == JOINT_NAMES.len();
            return (0..JOINT_NAMES.len())
                .map(|j| there(j).then(|| BodyKeypoint { point: joint(j), base_weight: 1.0 }))
                .collect();
        };
        let resolve = |entry: &Entry| {
            let (point, base_weight) = match entry.point {
                Joint(j) => (joint(j), entry.base_weight),
                Vertex(v) if own_mesh => (BodyPoint::Vertex(v), entry.base_weight),
                Vertex(_) => return None,
                Regressed(from, _, _) if own_mesh => (BodyPoint::Joints(from.to_vec()), entry.base_weight),
                Regressed(_, j, elsewhere) => (joint(j), if elsewhere { 0.0 } else { entry.base_weight }),
            };
            Some(BodyKeypoint { point, base_weight })
        };
        table.iter().map(resolve).collect()
    }

    /// The keypoints of the torso: left shoulder, right shoulder, left hip, right hip.
    pub fn torso(self) -> [usize; 4] {
        match self {
            KeypointSet::Smpl24 => [16, 17, 1, 2],
            KeypointSet::Body25 => [5, 2, 12, 9],
            KeypointSet::Coco18 => [5, 2, 11, 8],
            KeypointSet::Coco17 => [5, 6, 11, 12],
            KeypointSet::Lsp14 => [9, 8, 3, 2],
        }
    }
}

/// Whether the first joints of a tree are SMPL's: the names above mean nothing on another.
pub fn has_smpl_tree(parents: &[Option<usize>]) -> bool {
    parents.len() >= SHARED_JOINT_COUNT && parents[..SHARED_JOINT_COUNT] == PARENTS[..SHARED_JOINT_COUNT]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;
    use crate::body::mannequin::MIRRORED_JOINT;

    fn index(set: KeypointSet, name: &str) -> usize {
        (0..set.count()).find(|&k| set.name(k) == name).expect(name)
    }

    #[test]
    fn names_say_the_joint() {
        let body = mannequin();
        for set in KeypointSet::ALL {
            for (k, keypoint) in set.on_body(&body).iter().enumerate() {
                let Some(BodyKeypoint { point: BodyPoint::Joints(joints), .. }) = keypoint else { continue };
                let expected = if set.name(k) == "mid_hip" { "pelvis" } else { set.name(k) };
                assert_eq!(JOINT_NAMES[joints[0].0], expected, "{set:?} {k}");
            }
        }
    }

    #[test]
    fn mirroring_twice_changes_nothing() {
        for set in KeypointSet::ALL {
            assert!((0..set.count()).all(|k| set.mirrored(set.mirrored(k)) == k), "{set:?}");
            assert_ne!(set.mirrored(set.torso()[0]), set.torso()[0]);
        }
        assert_eq!((0..24).map(|k| KeypointSet::Smpl24.mirrored(k)).collect::<Vec<_>>(), MIRRORED_JOINT);
    }

    #[test]
    fn torso_is_shoulders_and_hips() {
        for set in KeypointSet::ALL {
            assert_eq!(
                set.torso().map(|k| set.name(k)),
                ["left_shoulder", "right_shoulder", "left_hip", "right_hip"],
                "{set:?}"
            );
        }
    }

    #[test]
    fn vertices_and_regressed_points_belong_to_smpl_s_mesh() {
        let mut body = mannequin();
        let nose = index(KeypointSet::Coco18, "nose");
        assert_eq!(KeypointSet::Coco18.on_body(&body)[nose], None);
        body.v_template = vec![[0.0; 3]; SMPL_VERTEX_COUNT];
        let found = KeypointSet::Coco18.on_body(&body);
        assert_eq!(found[nose].as_ref().expect("SMPL has a nose").point, BodyPoint::Vertex(331));
        for keypoint in found.iter().flatten() {
            if let BodyPoint::Joints(joints) = &keypoint.point {
                assert!((joints.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12, "{keypoint:?}");
            }
        }
    }

    #[test]
    fn detectors_hips_do_not_pull_and_smpl_s_do() {
        let body = mannequin();
        for set in [KeypointSet::Body25, KeypointSet::Coco17, KeypointSet::Lsp14, KeypointSet::Coco18] {
            let hip = &set.on_body(&body)[index(set, "left_hip")];
            assert_eq!(hip.as_ref().expect("a joint").base_weight, 0.0, "{set:?}");
        }
        assert!(KeypointSet::Smpl24.on_body(&body).iter().flatten().all(|k| k.base_weight == 1.0));
    }

    #[test]
    fn a_tree_with_other_parents_is_not_smpl_s() {
        let mut parents = PARENTS.to_vec();
        assert!(has_smpl_tree(&parents));
        parents[20] = Some(16);
        assert!(!has_smpl_tree(&parents));
        assert!(!has_smpl_tree(&PARENTS[..20]));
    }
}

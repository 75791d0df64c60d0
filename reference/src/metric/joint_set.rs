//! The orders in which evaluations name their joints, and which joints two of them share.
//!
//! Every set is a list of names; the index maps that evaluation codes carry as tables of numbers follow from the names
//! (the tests compare them with the published ones).
//!
//! # Conventions
//! A name is one point of the body in all sets but SMPL's. SMPL's pelvis, hips, spine, neck and head are joints of a
//! skeleton made for skinning: centimetres away from the points that motion capture and annotators call so. Between SMPL's
//! sets and the others only ankles, knees, wrists, elbows and shoulders are therefore the same point, as in SPIN's table of
//! joints and in SMPLify, which gives the hips no weight.
//!
//! What is on top of H36M's spine is `neck`, then `jaw` (nose or chin), then `head`. SPIN puts MPI-INF-3DHP's "head" at
//! `jaw` and its "head top" at `head`; so does this.
//!
//! # References
//! Kolotouros et al. 2019, "Learning to Reconstruct 3D Human Pose and Shape via Model-fitting in the Loop" (SPIN), whose
//! evaluation Li 2021, ch. 4, follows; Bogo et al. 2016 (SMPLify); Ionescu et al. 2014 (Human3.6M); Mehta et al. 2017
//! (MPI-INF-3DHP); Johnson and Everingham 2010 (LSP).

use crate::body::mannequin::JOINT_NAMES;
use crate::linalg::vector::{Vector3, add, scale, sub};

/// A named order of joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum JointSet {
    /// SMPL's 24 joints.
    Smpl24,
    /// The first 22 of them, which SMPL-H and SMPL-X share.
    Smpl22,
    /// Human3.6M's 17, left leg first: what `J_regressor_h36m` gives, in its order.
    H36m17,
    /// The same 17 in LSP's order with pelvis, spine and jaw behind: SPIN's J17.
    J17,
    /// LSP's 14, right ankle first; the last is H36M's head: SPIN's J14, of H36M and 3DPW.
    Lsp14,
    /// The 17 of the test set of MPI-INF-3DHP, in its order.
    Mpi17,
    /// The 24 of SPIN's files of truth, a superset of what data sets annotate: rows of `S`.
    J24,
    /// SPIN's 49: OpenPose's BODY_25, then [`JointSet::J24`].
    Spin49,
}

/// The point that the others are seen from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Root {
    /// A joint, the pelvis.
    Joint(usize),
    /// The middle of two, the hips.
    Middle(usize, usize),
    /// The origin of the frame that the joints are given in.
    Origin,
}

impl Root {
    /// Where it is among `joints`.
    ///
    /// # Panics
    ///
    /// If there is no such joint.
    pub fn of(self, joints: &[Vector3]) -> Vector3 {
        match self {
            Root::Joint(j) => joints[j],
            Root::Middle(a, b) => scale(add(joints[a], joints[b]), 0.5),
            Root::Origin => [0.0; 3],
        }
    }

    /// The `chosen` joints seen from it.
    ///
    /// # Panics
    ///
    /// If there is no such joint.
    pub fn relative(self, joints: &[Vector3], chosen: &[usize]) -> Vec<Vector3> {
        let origin = self.of(joints);
        chosen.iter().map(|&j| sub(joints[j], origin)).collect()
    }
}

/// The points that SMPL's skeleton and annotators mean alike.
const LIMBS: [&str; 10] = [
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
];

#[rustfmt::skip]
const H36M_17: [&str; 17] = [
    "pelvis", "left_hip", "left_knee", "left_ankle", "right_hip", "right_knee", "right_ankle", "spine", "neck", "jaw",
    "head", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist",
];

#[rustfmt::skip]
const J_17: [&str; 17] = [
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist", "right_elbow",
    "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head", "pelvis", "spine", "jaw",
];

#[rustfmt::skip]
const MPI_17: [&str; 17] = [
    "head", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "pelvis", "spine", "jaw",
];

/// BODY_25, then J24. OpenPose's points are a detector's and have names of their own.
#[rustfmt::skip]
const SPIN_49: [&str; 49] = [
    "openpose_nose", "openpose_neck", "openpose_right_shoulder", "openpose_right_elbow", "openpose_right_wrist",
    "openpose_left_shoulder", "openpose_left_elbow", "openpose_left_wrist", "openpose_mid_hip", "openpose_right_hip",
    "openpose_right_knee", "openpose_right_ankle", "openpose_left_hip", "openpose_left_knee", "openpose_left_ankle",
    "openpose_right_eye", "openpose_left_eye", "openpose_right_ear", "openpose_left_ear", "openpose_left_big_toe",
    "openpose_left_small_toe", "openpose_left_heel", "openpose_right_big_toe", "openpose_right_small_toe",
    "openpose_right_heel",
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist", "right_elbow",
    "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head_top", "pelvis", "thorax", "spine", "jaw",
    "head", "nose", "left_eye", "right_eye", "left_ear", "right_ear",
];

impl JointSet {
    /// All sets.
    pub const ALL: [JointSet; 8] = [
        JointSet::Smpl24,
        JointSet::Smpl22,
        JointSet::H36m17,
        JointSet::J17,
        JointSet::Lsp14,
        JointSet::Mpi17,
        JointSet::J24,
        JointSet::Spin49,
    ];

    /// The names of its joints, as "left_wrist", in its order.
    pub fn joint_names(self) -> &'static [&'static str] {
        match self {
            JointSet::Smpl24 => &JOINT_NAMES,
            JointSet::Smpl22 => &JOINT_NAMES[..22],
            JointSet::H36m17 => &H36M_17,
            JointSet::J17 => &J_17,
            JointSet::Lsp14 => &J_17[..14],
            JointSet::Mpi17 => &MPI_17,
            JointSet::J24 => &SPIN_49[25..],
            JointSet::Spin49 => &SPIN_49,
        }
    }

    /// The number of its joints.
    pub fn count(self) -> usize {
        self.joint_names().len()
    }

    /// Where the joint that `other` calls `name` is in this set.
    fn position(self, name: &str, other: JointSet) -> Option<usize> {
        let is_smpl = |set| matches!(set, JointSet::Smpl24 | JointSet::Smpl22);
        if is_smpl(self) != is_smpl(other) && !LIMBS.contains(&name) {
            return None;
        }
        self.joint_names().iter().position(|&own| own == name)
    }

    /// The joints that both sets have, as indices into this and into `other`, in the order of this.
    pub fn shared(self, other: JointSet) -> Vec<(usize, usize)> {
        let names = self.joint_names().iter().enumerate();
        names.filter_map(|(own, name)| Some((own, other.position(name, self)?))).collect()
    }

    /// Where each joint of `wanted` is in this set; `None` unless it has them all.
    ///
    /// ```
    /// use vitruvian_reference::metric::joint_set::JointSet;
    /// let j14 = JointSet::H36m17.indices_of(JointSet::Lsp14);
    /// assert_eq!(j14, Some(vec![6, 5, 4, 1, 2, 3, 16, 15, 14, 11, 12, 13, 8, 10]));
    /// assert_eq!(JointSet::Lsp14.indices_of(JointSet::H36m17), None);
    /// ```
    pub fn indices_of(self, wanted: JointSet) -> Option<Vec<usize>> {
        wanted.joint_names().iter().map(|name| self.position(name, wanted)).collect()
    }

    /// The pelvis, where the set has one.
    pub fn pelvis(self) -> Option<Root> {
        self.joint_names().iter().position(|&name| name == "pelvis").map(Root::Joint)
    }

    /// The middle of the hips, which every set has.
    pub fn mid_hip(self) -> Root {
        let hip = |wanted: &str| {
            self.joint_names().iter().position(|&name| name == wanted).expect("every set has hips")
        };
        Root::Middle(hip("left_hip"), hip("right_hip"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use JointSet::{H36m17, J17, J24, Lsp14, Mpi17, Smpl22, Smpl24, Spin49};

    #[test]
    fn names_give_the_published_index_maps() {
        // Source: SPIN's constants.py, H36M_TO_J17, J24_TO_J17 and their first 14.
        let h36m_to_j17 = [6, 5, 4, 1, 2, 3, 16, 15, 14, 11, 12, 13, 8, 10, 0, 7, 9];
        let j24_to_j17 = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 18, 14, 16, 17];
        assert_eq!(H36m17.indices_of(J17).as_deref(), Some(&h36m_to_j17[..]));
        assert_eq!(J24.indices_of(J17).as_deref(), Some(&j24_to_j17[..]));
        assert_eq!(H36m17.indices_of(Lsp14).as_deref(), Some(&h36m_to_j17[..14]));
        assert_eq!(J24.indices_of(Lsp14).as_deref(), Some(&j24_to_j17[..14]));
        // Source: datasets/preprocess/h36m.py, global_idx: where the 17 of Human3.6M stand in J24.
        let global = [14, 3, 4, 5, 2, 1, 0, 16, 12, 17, 18, 9, 10, 11, 8, 7, 6];
        assert_eq!(J24.indices_of(H36m17).as_deref(), Some(&global[..]));
        // Source: datasets/preprocess/mpi_inf_3dhp.py, test_data, joints17_idx: H36M's order in the test set's.
        let mpi = [14, 11, 12, 13, 8, 9, 10, 15, 1, 16, 0, 5, 6, 7, 2, 3, 4];
        assert_eq!(Mpi17.indices_of(H36m17).as_deref(), Some(&mpi[..]));
        let behind_openpose: Vec<usize> = (25..49).collect();
        assert_eq!(Spin49.indices_of(J24), Some(behind_openpose));
    }

    #[test]
    fn every_set_is_itself_and_has_no_joint_twice() {
        for set in JointSet::ALL {
            assert_eq!(set.indices_of(set), Some((0..set.count()).collect()), "{set:?}");
            let own: Vec<(usize, usize)> = (0..set.count()).map(|j| (j, j)).collect();
            assert_eq!(set.shared(set), own);
        }
    }

    #[test]
    fn sharing_is_mutual_and_joins_joints_of_one_name() {
        for a in JointSet::ALL {
            for b in JointSet::ALL {
                let mut there: Vec<_> = a.shared(b).into_iter().map(|(i, j)| (j, i)).collect();
                there.sort_unstable();
                assert_eq!(there, b.shared(a), "{a:?} {b:?}");
                assert!(there.iter().all(|&(i, j)| b.joint_names()[i] == a.joint_names()[j]));
                assert!(there.len() >= LIMBS.len(), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn smpl_s_skeleton_and_annotators_agree_on_the_limbs_alone() {
        let names: Vec<_> =
            Lsp14.shared(Smpl24).into_iter().map(|(i, j)| (Lsp14.joint_names()[i], j)).collect();
        // The indices are those of SMPLify's table from LSP to SMPL.
        let expected = [
            ("right_ankle", 8),
            ("right_knee", 5),
            ("left_knee", 4),
            ("left_ankle", 7),
            ("right_wrist", 21),
            ("right_elbow", 19),
            ("right_shoulder", 17),
            ("left_shoulder", 16),
            ("left_elbow", 18),
            ("left_wrist", 20),
        ];
        assert_eq!(names, expected);
        assert_eq!(Smpl24.shared(Smpl22).len(), 22);
    }

    #[test]
    fn roots_are_the_pelvis_or_between_the_hips() {
        assert_eq!(Smpl24.pelvis(), Some(Root::Joint(0)));
        assert_eq!((J24.pelvis(), Mpi17.pelvis()), (Some(Root::Joint(14)), Some(Root::Joint(14))));
        assert_eq!((Lsp14.pelvis(), Lsp14.mid_hip()), (None, Root::Middle(3, 2)));
        let joints = [[1.0, 2.0, 3.0], [3.0, 2.0, 1.0]];
        assert_eq!(Root::Middle(0, 1).of(&joints), [2.0; 3]);
        assert_eq!(Root::Joint(1).relative(&joints, &[0]), [[-2.0, 0.0, 2.0]]);
        assert_eq!(Root::Origin.relative(&joints, &[1]), [joints[1]]);
    }
}

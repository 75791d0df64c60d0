//! The joints of a body without its mesh.
//!
//! Rest joints are regressed from a mesh that is linear in β, so they are linear in β themselves:
//!
//! J(β) = J_regressor · (v_template + shapedirs · β) = J(0) + (J_regressor · shapedirs) · β.
//!
//! Regressed once, J·3·(1 + B) numbers replace the mesh wherever only joints are asked for. The pose correctives do not
//! enter: SMPL regresses the joints before they act.

use super::BodyModel;
use super::blend_shapes::{regress_joints, shape_blend};
use super::kinematic_tree::{Rigid, global_transforms};
use crate::linalg::vector::Vector3;
use crate::rotation::rodrigues;

/// The joints of a body model as functions of shape and pose; any tree, J joints, B betas.
///
/// # Conventions
/// Those of [`BodyModel`]: metres, parents before their children, the first joint alone without a parent.
///
/// ```
/// use vitruvian_reference::{body::mannequin, linalg::vector::distance};
///
/// let body = mannequin();
/// let mut pose = [0.0; 72];
/// pose[3 * 16 + 2] = -1.2; // lower the left arm
/// let betas = [0.5, -1.0];
/// let skin = body.pose(&pose, &betas, [0.0; 3]);
/// for (joint, with_mesh) in body.skeleton().posed_joints(&pose, &betas).iter().zip(skin.joints) {
///     assert!(distance(*joint, with_mesh) < 1e-12);
/// }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// Rest joints at β = 0, J×3 metres.
    pub template: Vec<Vector3>,
    /// Shape directions of the joints, J×3×B row-major: `shapedirs[(3·j + axis)·B + l]`, metres per standard deviation.
    pub shapedirs: Vec<f64>,
    /// The parent of every joint, J.
    pub parents: Vec<Option<usize>>,
}

impl Skeleton {
    /// J, the number of joints.
    pub fn joint_count(&self) -> usize {
        self.template.len()
    }

    /// B, the number of betas.
    pub fn beta_count(&self) -> usize {
        self.shapedirs.len() / (3 * self.template.len())
    }

    /// The rest joints J(β), J×3 metres; `betas` may be shorter than B, the rest is zero.
    ///
    /// # Panics
    /// If there are more than B betas.
    pub fn rest_joints(&self, betas: &[f64]) -> Vec<Vector3> {
        shape_blend(&self.template, &self.shapedirs, betas)
    }

    /// The global transform G_j of every joint in the pose `pose` (J axis–angle vectors, radians) at the shape `betas`.
    ///
    /// The translation of G_j is the posed joint; the body's `trans` is not in it.
    ///
    /// # Panics
    /// If `pose` does not have 3J numbers, there are more than B betas, or a parent does not come before its child.
    pub fn pose(&self, pose: &[f64], betas: &[f64]) -> Vec<Rigid> {
        self.assert_pose(pose);
        let rotations: Vec<_> = pose.chunks_exact(3).map(|v| rodrigues([v[0], v[1], v[2]])).collect();
        global_transforms(&rotations, &self.rest_joints(betas), &self.parents)
    }

    /// The posed joints, J×3 metres: the translations of [`Skeleton::pose`].
    ///
    /// # Panics
    /// As [`Skeleton::pose`].
    pub fn posed_joints(&self, pose: &[f64], betas: &[f64]) -> Vec<Vector3> {
        self.pose(pose, betas).iter().map(|g| g.translation).collect()
    }

    pub(super) fn assert_pose(&self, pose: &[f64]) {
        let j = self.joint_count();
        assert!(pose.len() == 3 * j, "Skeleton: pose has {} numbers, 3J = {}", pose.len(), 3 * j);
    }
}

impl From<&BodyModel> for Skeleton {
    /// Regresses template and shape directions.
    ///
    /// # Panics
    /// If the model is not consistent.
    fn from(body: &BodyModel) -> Skeleton {
        body.assert_consistent();
        let (v, width) = (body.vertex_count(), 3 * body.beta_count());
        let mut shapedirs = vec![0.0; body.joint_count() * width];
        if width > 0 {
            for (joint, row) in shapedirs.chunks_exact_mut(width).zip(body.j_regressor.chunks_exact(v)) {
                // Regressors are sparse: most of the V numbers of a row are zero.
                let chosen = row.iter().zip(body.shapedirs.chunks_exact(width)).filter(|(w, _)| **w != 0.0);
                for (w, vertex) in chosen {
                    for (sum, direction) in joint.iter_mut().zip(vertex) {
                        *sum += w * direction;
                    }
                }
            }
        }
        let template = regress_joints(&body.j_regressor, &body.v_template);
        Skeleton { template, shapedirs, parents: body.parents.clone() }
    }
}

impl BodyModel {
    /// The joints of this body without its mesh.
    ///
    /// # Panics
    /// If the model is not consistent.
    pub fn skeleton(&self) -> Skeleton {
        Skeleton::from(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;
    use crate::linalg::vector::distance;

    #[test]
    fn regressed_directions_by_hand() {
        // One joint half-way between two vertices, two betas.
        let body = BodyModel {
            v_template: vec![[0.0; 3], [2.0, 4.0, 6.0]],
            faces: Vec::new(),
            shapedirs: vec![1.0, 10.0, 2.0, 20.0, 3.0, 30.0, 3.0, 0.0, 2.0, 0.0, 1.0, 0.0],
            posedirs: Vec::new(),
            j_regressor: vec![0.5, 0.5],
            lbs_weights: vec![1.0, 1.0],
            parents: vec![None],
        };
        let skeleton = body.skeleton();
        assert_eq!(skeleton.template, [[1.0, 2.0, 3.0]]);
        assert_eq!(skeleton.shapedirs, [2.0, 5.0, 2.0, 10.0, 2.0, 15.0]);
        assert_eq!(skeleton.rest_joints(&[1.0, 0.1]), [[3.5, 5.0, 6.5]]);
    }

    #[test]
    fn joints_are_those_of_the_mesh() {
        let body = mannequin();
        let skeleton = body.skeleton();
        let pose: Vec<f64> = (0..72).map(|n| (1.7 * f64::from(n)).sin()).collect();
        let betas = [1.0, -2.0, 0.5];
        for (a, b) in
            skeleton.posed_joints(&pose, &betas).iter().zip(body.pose(&pose, &betas, [0.0; 3]).joints)
        {
            assert!(distance(*a, b) < 1e-13, "{a:?} {b:?}");
        }
    }

    #[test]
    #[should_panic(expected = "pose has 6 numbers, 3J = 3")]
    fn wrong_pose_length_is_refused() {
        Skeleton { template: vec![[0.0; 3]], shapedirs: Vec::new(), parents: vec![None] }
            .pose(&[0.0; 6], &[]);
    }
}

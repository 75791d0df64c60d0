//! The arrays of a body model, and the forward pass from parameters to a posed mesh.

use super::blend_shapes::{pose_blend, pose_feature, regress_joints, shape_blend};
use super::kinematic_tree::{global_transforms, relative_transforms};
use super::skinning::linear_blend_skinning;
use crate::linalg::vector::{Vector3, add};
use crate::rotation::rodrigues;

/// A body model in SMPL's arrays, for any number of vertices V, faces F, joints J and betas B; P = 9(J−1).
///
/// # Conventions
/// Metres. Rest frame: +Y up, the body faces +Z, its left is +X. Faces counter-clockwise seen from outside.
/// Joints are ordered so that a parent comes before its children; exactly one, the first, has no parent.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyModel {
    /// Rest vertices at β = 0, V×3.
    pub v_template: Vec<Vector3>,
    /// Triangles, F×3, indices into the vertices.
    pub faces: Vec<[u32; 3]>,
    /// Shape directions, V×3×B row-major: `shapedirs[(3·i + axis)·B + l]`, metres per standard deviation.
    pub shapedirs: Vec<f64>,
    /// Pose directions, V×3×P row-major: `posedirs[(3·i + axis)·P + 9(j−1) + 3·row + column]`, metres.
    pub posedirs: Vec<f64>,
    /// Joint regressor, J×V row-major; rows sum to 1.
    pub j_regressor: Vec<f64>,
    /// Skinning weights, V×J row-major; rows sum to 1.
    pub lbs_weights: Vec<f64>,
    /// The parent of every joint, J.
    pub parents: Vec<Option<usize>>,
}

/// A body in a pose: V vertices and J joints, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Posed {
    /// The skin, V×3.
    pub vertices: Vec<Vector3>,
    /// The posed joints, J×3.
    pub joints: Vec<Vector3>,
}

impl BodyModel {
    /// V, the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.v_template.len()
    }

    /// J, the number of joints.
    pub fn joint_count(&self) -> usize {
        self.parents.len()
    }

    /// P = 9(J − 1), the length of the pose feature.
    pub fn pose_feature_count(&self) -> usize {
        9 * (self.joint_count() - 1)
    }

    /// B, the number of betas.
    pub fn beta_count(&self) -> usize {
        self.shapedirs.len() / (3 * self.vertex_count())
    }

    /// Panics unless the arrays fit each other; [`BodyModel::pose`] relies on this.
    ///
    /// # Panics
    /// With the array's name, its length and the length wanted; if a face names a vertex that is not there; if the
    /// first joint has a parent, or another joint has none or one that does not come before it.
    pub fn assert_consistent(&self) {
        let (v, j) = (self.vertex_count(), self.joint_count());
        assert!(v > 0 && j > 0, "BodyModel: {v} vertices and {j} joints");
        let expect = |name: &str, found: usize, wanted: usize| {
            assert!(
                found == wanted,
                "BodyModel: {name} has {found} numbers, V = {v} and J = {j} ask for {wanted}"
            );
        };
        assert!(
            self.shapedirs.len().is_multiple_of(3 * v),
            "BodyModel: shapedirs has {} numbers, not a multiple of 3V = {}",
            self.shapedirs.len(),
            3 * v
        );
        expect("posedirs", self.posedirs.len(), 3 * v * self.pose_feature_count());
        expect("j_regressor", self.j_regressor.len(), j * v);
        expect("lbs_weights", self.lbs_weights.len(), v * j);
        for (f, face) in self.faces.iter().enumerate() {
            assert!(face.iter().all(|&i| (i as usize) < v), "BodyModel: face {f} is {face:?}, V = {v}");
        }
        for (child, parent) in self.parents.iter().enumerate() {
            let fits = if child == 0 { parent.is_none() } else { parent.is_some_and(|p| p < child) };
            assert!(
                fits,
                "BodyModel: joint {child} has parent {parent:?}; parents come before their children"
            );
        }
    }

    /// The body of shape `betas` in the pose `pose`: vertices and joints in metres.
    ///
    /// v_i = Σ_j w_ij A_j(θ, J(β)) \[t̄_i + B_S(β)_i + B_P(θ)_i\] + trans.
    ///
    /// `pose` holds J axis–angle vectors (3J numbers, radians), each relative to the joint's *parent* (erratum E14h;
    /// the root's turns the whole body about the pelvis, not about the origin). `betas` may be shorter than B: the
    /// rest is zero.
    ///
    /// # Panics
    /// If the model is not consistent, `pose` does not have 3J numbers, or there are more than B betas.
    ///
    /// # References
    /// Loper et al. 2015, eq. 1–9; Li 2021, ch. 2 §2.
    ///
    /// ```
    /// let body = vitruvian_reference::body::mannequin();
    /// let posed = body.pose(&[0.0; 72], &[], [0.0; 3]);
    /// assert_eq!(posed.vertices.len(), body.v_template.len());
    /// ```
    pub fn pose(&self, pose: &[f64], betas: &[f64], trans: Vector3) -> Posed {
        self.pose_with_offsets(pose, betas, &[], trans)
    }

    /// The same with every rest vertex displaced by its offset D_i: clothes, hair, whatever no beta describes.
    ///
    /// v_i = Σ_j w_ij A_j(θ, J(β)) \[t̄_i + B_S(β)_i + D_i + B_P(θ)_i\] + trans.
    ///
    /// `offsets` V×3 metres in the frame of the rest pose, or empty for none. The joints come from β alone: cloth does
    /// not move the skeleton.
    ///
    /// # Panics
    /// As [`BodyModel::pose`], or if there are offsets but not V of them.
    ///
    /// # References
    /// Li 2021, ch. 3 §3.3 (erratum E11); Alldieck, Magnor, Xu, Theobalt, Pons-Moll 2018, "Video Based Reconstruction of 3D
    /// People Models".
    pub fn pose_with_offsets(
        &self,
        pose: &[f64],
        betas: &[f64],
        offsets: &[Vector3],
        trans: Vector3,
    ) -> Posed {
        self.assert_consistent();
        let j = self.joint_count();
        assert!(pose.len() == 3 * j, "BodyModel::pose: pose has {} numbers, 3J = {}", pose.len(), 3 * j);
        self.assert_offsets(offsets);

        let mut v_shaped = shape_blend(&self.v_template, &self.shapedirs, betas);
        let rest_joints = regress_joints(&self.j_regressor, &v_shaped);
        for (v, offset) in v_shaped.iter_mut().zip(offsets) {
            *v = add(*v, *offset);
        }

        let rotations: Vec<_> = pose.chunks_exact(3).map(|v| rodrigues([v[0], v[1], v[2]])).collect();
        let rest_pose = pose_blend(v_shaped, &self.posedirs, &pose_feature(&rotations));

        let global = global_transforms(&rotations, &rest_joints, &self.parents);
        let relative = relative_transforms(&global, &rest_joints);
        let skinned = linear_blend_skinning(&rest_pose, &self.lbs_weights, &relative);

        Posed {
            vertices: skinned.into_iter().map(|v| add(v, trans)).collect(),
            joints: global.iter().map(|g| add(g.translation, trans)).collect(),
        }
    }

    /// Panics unless there is one offset for every vertex, or none at all.
    pub(super) fn assert_offsets(&self, offsets: &[Vector3]) {
        assert!(
            offsets.is_empty() || offsets.len() == self.vertex_count(),
            "BodyModel: {} offsets, V = {}",
            offsets.len(),
            self.vertex_count()
        );
    }

    /// The rest joints of shape `betas`, J×3 metres: J_regressor · (v_template + B_S(β)).
    ///
    /// # Panics
    /// If there are more than B betas.
    pub fn rest_joints(&self, betas: &[f64]) -> Vec<Vector3> {
        regress_joints(&self.j_regressor, &shape_blend(&self.v_template, &self.shapedirs, betas))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::distance;
    use std::f64::consts::FRAC_PI_2;

    /// Three points on two bones: joint 0 at the first, joint 1 at the second; one beta lengthens the second bone.
    fn two_bones() -> BodyModel {
        let mut shapedirs = vec![0.0; 9];
        shapedirs[6] = 1.0;
        BodyModel {
            v_template: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
            faces: vec![[0, 1, 2]],
            shapedirs,
            posedirs: vec![0.0; 81],
            j_regressor: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            lbs_weights: vec![1.0, 0.0, 0.5, 0.5, 0.0, 1.0],
            parents: vec![None, Some(0)],
        }
    }

    #[test]
    fn forward_kinematics_by_hand() {
        let posed = two_bones().pose(&[0.0, 0.0, FRAC_PI_2, 0.0, 0.0, FRAC_PI_2], &[0.5], [0.0, 0.0, 3.0]);
        let expected = [[0.0, 0.0, 3.0], [0.0, 1.0, 3.0], [-1.5, 1.0, 3.0]];
        for (v, e) in posed.vertices.iter().zip(expected) {
            assert!(distance(*v, e) < 1e-15, "{:?}", posed.vertices);
        }
        assert!(distance(posed.joints[1], [0.0, 1.0, 3.0]) < 1e-15);
    }

    #[test]
    fn pose_correctives_act_before_skinning() {
        let mut body = two_bones();
        // (R − I)₀₀ = −1 at a quarter turn about z: lift the last vertex by 1 along its rest y.
        body.posedirs[(3 * 2 + 1) * 9] = -1.0;
        let posed = body.pose(&[0.0, 0.0, 0.0, 0.0, 0.0, FRAC_PI_2], &[], [0.0; 3]);
        assert!(distance(posed.vertices[2], [0.0, 1.0, 0.0]) < 1e-15, "{:?}", posed.vertices);
    }

    #[test]
    fn offsets_act_in_the_rest_frame_and_leave_the_joints() {
        let (body, pose) = (two_bones(), [0.0, 0.0, FRAC_PI_2, 0.0, 0.0, FRAC_PI_2]);
        let (bare, offset) = (body.pose(&pose, &[0.5], [0.0; 3]), [0.1, 0.02, 0.3]);
        let clothed = body.pose_with_offsets(&pose, &[0.5], &[[0.0; 3], [0.0; 3], offset], [0.0; 3]);
        assert_eq!(clothed.joints, bare.joints);
        assert_eq!(clothed.vertices[..2], bare.vertices[..2]);
        // The last vertex belongs to the second bone, which two quarter turns about z have turned round.
        assert!(distance(clothed.vertices[2], add(bare.vertices[2], [-0.1, -0.02, 0.3])) < 1e-15);
    }

    #[test]
    #[should_panic(expected = "2 offsets, V = 3")]
    fn wrong_number_of_offsets_is_refused() {
        two_bones().pose_with_offsets(&[0.0; 6], &[], &[[0.0; 3]; 2], [0.0; 3]);
    }

    #[test]
    #[should_panic(expected = "pose has 5 numbers, 3J = 6")]
    fn wrong_pose_length_is_refused() {
        two_bones().pose(&[0.0; 5], &[], [0.0; 3]);
    }

    #[test]
    #[should_panic(expected = "lbs_weights has 5 numbers, V = 3 and J = 2 ask for 6")]
    fn wrong_weights_are_refused() {
        let mut body = two_bones();
        body.lbs_weights.pop();
        body.pose(&[0.0; 6], &[], [0.0; 3]);
    }

    #[test]
    #[should_panic(expected = "joint 1 has parent Some(1)")]
    fn parents_that_do_not_come_first_are_refused() {
        let mut body = two_bones();
        body.parents[1] = Some(1);
        body.pose(&[0.0; 6], &[], [0.0; 3]);
    }
}

//! A body held in one pose and asked vertex by vertex.
//!
//! [`BodyModel::pose`] moves all vertices at once. A fit to silhouettes asks for a few thousand of them, again and again,
//! and for more than their positions; what depends on the pose alone is computed once here.

use super::BodyModel;
use super::blend_shapes::{moving_features, pose_displacement, pose_feature};
use super::joint_derivative::Turning;
use super::kinematic_tree::{Rigid, relative_transforms};
use super::skeleton::Skeleton;
use super::skinning::{Affine, blended_transform};
use crate::linalg::matrix::apply;
use crate::linalg::vector::{Vector3, ZERO, add};
use crate::rotation::rodrigues_derivative;
use std::ops::Range;

/// A body model at a pose, a shape, offsets and a translation.
///
/// ```
/// use vitruvian_reference::{body::mannequin, linalg::vector::distance};
///
/// let body = mannequin();
/// let skeleton = body.skeleton();
/// let (pose, betas, trans) = ([0.1; 72], [1.0, -0.5], [0.0, 1.0, 3.0]);
/// let held = body.at_pose(&skeleton, &pose, &betas, &[], trans);
/// let all = body.pose(&pose, &betas, trans);
/// assert!(distance(held.position(1234), all.vertices[1234]) < 1e-12);
///
/// let moving = held.vertex_derivatives(&[1234, 17]);
/// assert_eq!((moving.by_pose.rows(), moving.by_pose.columns()), (6, 72));
/// ```
#[derive(Clone, Debug)]
pub struct PosedBody<'a> {
    pub(super) body: &'a BodyModel,
    pub(super) betas: Vec<f64>,
    pub(super) offsets: &'a [Vector3],
    pub(super) trans: Vector3,
    pub(super) turning: Turning<'a>,
    /// A_j.
    pub(super) relative: Vec<Rigid>,
    /// vec(R_j − I), and the parts of it that are not zero.
    pub(super) feature: Vec<f64>,
    pub(super) moving: Vec<Range<usize>>,
    /// vec(∂R_k/∂θ_{k,i}) of the joints 1…J−1.
    pub(super) feature_by_pose: Vec<[[f64; 9]; 3]>,
    /// ∂t(A_j)/∂β, J×3×(number of betas) row-major.
    pub(super) translations_by_betas: Vec<f64>,
}

impl BodyModel {
    /// This body, whose skeleton is `skeleton`, at a pose (3J numbers), betas, offsets (V or none) and a translation.
    ///
    /// Derivatives by shape have one column for each beta given.
    ///
    /// # Panics
    /// As [`BodyModel::pose_with_offsets`], or if the skeleton has another number of joints or betas.
    pub fn at_pose<'a>(
        &'a self,
        skeleton: &'a Skeleton,
        pose: &[f64],
        betas: &[f64],
        offsets: &'a [Vector3],
        trans: Vector3,
    ) -> PosedBody<'a> {
        self.assert_consistent();
        self.assert_offsets(offsets);
        let (found, wanted) =
            ((skeleton.joint_count(), skeleton.beta_count()), (self.joint_count(), self.beta_count()));
        assert!(
            found == wanted,
            "BodyModel::at_pose: the skeleton's (J, B) = {found:?}, the body's {wanted:?}"
        );
        let turning = skeleton.turning(pose, betas);
        let feature = pose_feature(&turning.rotations);
        let derivative = |v: &[f64]| {
            rodrigues_derivative([v[0], v[1], v[2]]).map(|m| std::array::from_fn(|n| m[n / 3][n % 3]))
        };
        PosedBody {
            body: self,
            betas: betas.to_vec(),
            offsets,
            trans,
            relative: relative_transforms(&turning.global, &turning.rest_joints),
            moving: moving_features(&feature),
            feature,
            feature_by_pose: pose.chunks_exact(3).skip(1).map(derivative).collect(),
            translations_by_betas: translations_by_betas(&turning, betas.len()),
            turning,
        }
    }
}

/// ∂t(A_j)/∂β = ∂p_j/∂β − R(G_j) ∂J_j/∂β, since t(A_j) = p_j − R(G_j) J_j.
fn translations_by_betas(turning: &Turning, b: usize) -> Vec<f64> {
    let mut derivative = turning.joints_by_betas(b);
    for (j, transform) in turning.global.iter().enumerate() {
        for l in 0..b {
            let turned = apply(&transform.rotation, turning.rest_joint_by_beta(j, l));
            for axis in 0..3 {
                derivative[(3 * j + axis) * b + l] -= turned[axis];
            }
        }
    }
    derivative
}

impl PosedBody<'_> {
    /// The blended transform V_i = Σ_j w_ij A_j of vertex `i`, followed by `trans`.
    ///
    /// It takes the rest pose (template, shape, offset and pose correctives) to the world. Its linear part Σ_j w_ij R(G_j)
    /// is no rotation where joints share the vertex.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn blended_transform(&self, i: usize) -> Affine {
        let mut blended = blended_transform(self.weights(i), &self.relative);
        blended.translation = add(blended.translation, self.trans);
        blended
    }

    /// The vertex before pose acts on it: t̄_i + B_S(β)_i + D_i, metres in the frame of the rest pose.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn shaped(&self, i: usize) -> Vector3 {
        let b = self.body.beta_count();
        let displaced = add(self.body.v_template[i], self.offsets.get(i).copied().unwrap_or(ZERO));
        std::array::from_fn(|axis| {
            let row = &self.body.shapedirs[(3 * i + axis) * b..];
            displaced[axis] + self.betas.iter().zip(row).map(|(beta, d)| beta * d).sum::<f64>()
        })
    }

    /// The pose corrective B_P(θ)_i, metres in the frame of the rest pose.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn pose_corrective(&self, i: usize) -> Vector3 {
        pose_displacement(self.pose_directions(i), &self.feature, &self.moving)
    }

    /// The vertex in the world, metres: V_i (t̄_i + B_S(β)_i + D_i + B_P(θ)_i).
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn position(&self, i: usize) -> Vector3 {
        self.blended_transform(i).apply(add(self.shaped(i), self.pose_corrective(i)))
    }

    pub(super) fn weights(&self, i: usize) -> &[f64] {
        let j = self.body.joint_count();
        &self.body.lbs_weights[i * j..(i + 1) * j]
    }

    /// The vertex' 3×P block of `posedirs`.
    pub(super) fn pose_directions(&self, i: usize) -> &[f64] {
        let rows = 3 * self.body.pose_feature_count();
        &self.body.posedirs[i * rows..(i + 1) * rows]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;
    use crate::linalg::vector::distance;

    #[test]
    fn vertices_one_by_one_are_those_of_the_whole_pass() {
        let body = mannequin();
        let skeleton = body.skeleton();
        let pose: Vec<f64> = (0..72).map(|n| (2.1 * f64::from(n)).sin()).collect();
        let offsets: Vec<Vector3> =
            (0..body.vertex_count()).map(|i| [0.01 * (i as f64).sin(), 0.0, -0.005]).collect();
        let (betas, trans) = ([1.0, 0.0, -2.0], [0.2, -1.0, 4.0]);
        let all = body.pose_with_offsets(&pose, &betas, &offsets, trans);
        let held = body.at_pose(&skeleton, &pose, &betas, &offsets, trans);
        for (i, vertex) in all.vertices.iter().enumerate() {
            assert!(distance(held.position(i), *vertex) < 1e-13, "vertex {i}");
        }
    }

    #[test]
    #[should_panic(expected = "the skeleton's (J, B) = (24, 0), the body's (24, 10)")]
    fn skeleton_of_another_body_is_refused() {
        let body = mannequin();
        let skeleton = Skeleton { shapedirs: Vec::new(), ..body.skeleton() };
        body.at_pose(&skeleton, &[0.0; 72], &[], &[], ZERO);
    }
}

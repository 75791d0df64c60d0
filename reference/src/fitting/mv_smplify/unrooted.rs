//! The body with its root's turn taken out, and derivatives against the stream.
//!
//! Every view has its own root rotation R_i and translation t_i, and all share the rest of the pose. So a keypoint in the
//! camera's frame is
//!
//! ```text
//!     X_ik = R_i q_k(θ̃, β) + J_0(β) + t_i,
//! ```
//!
//! with q_k relative to the pelvis J_0 in the pose θ̃ whose root is not turned: the tree is walked once for all views.
//!
//! Given f_k = ∂E/∂q_k, the derivatives by pose and shape follow in one walk from the leaves to the root, as forces and
//! torques do. What joint j carries is F_j = f_j + Σ_children F_c, and about its own place T_j = Σ_children T_c + (q_c − q_j) × F_c. Then
//!
//! ```text
//!     ∂E/∂θ_j = J_l(θ_j)ᵀ R(G_parent)ᵀ T_j,        ∂E/∂(J_j − J_parent) = R(G_parent)ᵀ F_j,
//! ```
//!
//! which costs as much as the walk outwards, whatever the number of unknowns.

use crate::body::{BodyModel, Skeleton, VertexDerivatives};
use crate::fitting::keypoint_set::{BodyKeypoint, BodyPoint};
use crate::linalg::matrix::{IDENTITY, Matrix3, apply, apply_transposed, mul};
use crate::linalg::vector::{Vector3, ZERO, add, add_scaled, cross, sub};
use crate::rotation::{left_jacobian, rodrigues};

/// The keypoints of a set as functions of pose (without root) and shape.
#[derive(Clone, Debug)]
pub(super) struct Unrooted<'a> {
    skeleton: &'a Skeleton,
    keypoint_count: usize,
    /// (keypoint, joint, weight) of the keypoints that are sums over joints.
    joint_terms: Vec<(usize, usize, f64)>,
    /// (keypoint, vertex).
    vertices: Vec<(usize, usize)>,
    /// Where the vertices are.
    body: Option<&'a BodyModel>,
}

/// The body in one pose; its room is kept from one pose to the next.
#[derive(Clone, Debug)]
pub(super) struct UnrootedPose {
    /// q_k, K points relative to the pelvis, metres; zero for keypoints that the body lacks.
    pub points: Vec<Vector3>,
    /// J_0(β).
    pub pelvis: Vector3,
    /// The pose with a zero root, 3J.
    pose: Vec<f64>,
    rest: Vec<Vector3>,
    /// R(G_j).
    turns: Vec<Matrix3>,
    /// q of the joints.
    joints: Vec<Vector3>,
    vertices: Option<VertexDerivatives>,
    forces: Vec<Vector3>,
    torques: Vec<Vector3>,
    by_rest: Vec<Vector3>,
}

impl<'a> Unrooted<'a> {
    pub(super) fn new(
        skeleton: &'a Skeleton,
        body: Option<&'a BodyModel>,
        keypoints: &[Option<BodyKeypoint>],
    ) -> Unrooted<'a> {
        let (mut joint_terms, mut vertices) = (Vec::new(), Vec::new());
        for (k, keypoint) in keypoints.iter().enumerate() {
            match keypoint.as_ref().map(|keypoint| &keypoint.point) {
                Some(BodyPoint::Joints(joints)) => joint_terms.extend(joints.iter().map(|&(j, w)| (k, j, w))),
                Some(BodyPoint::Vertex(vertex)) => vertices.push((k, *vertex)),
                None => {}
            }
        }
        Unrooted { skeleton, keypoint_count: keypoints.len(), joint_terms, vertices, body }
    }

    /// 3(J − 1), the length of θ̃.
    pub(super) fn pose_len(&self) -> usize {
        3 * (self.skeleton.joint_count() - 1)
    }

    /// B.
    pub(super) fn beta_count(&self) -> usize {
        self.skeleton.beta_count()
    }

    /// K.
    pub(super) fn keypoint_count(&self) -> usize {
        self.keypoint_count
    }

    /// Room for a pose.
    pub(super) fn room(&self) -> UnrootedPose {
        let (k, j) = (self.keypoint_count, self.skeleton.joint_count());
        UnrootedPose {
            points: vec![ZERO; k],
            pelvis: ZERO,
            pose: vec![0.0; 3 * j],
            rest: vec![ZERO; j],
            turns: vec![IDENTITY; j],
            joints: vec![ZERO; j],
            vertices: None,
            forces: vec![ZERO; j],
            torques: vec![ZERO; j],
            by_rest: vec![ZERO; j],
        }
    }

    /// Walks outwards: θ̃ (3(J − 1) numbers) and β (B numbers) into `at`.
    pub(super) fn pose(&self, body_pose: &[f64], betas: &[f64], at: &mut UnrootedPose) {
        let b = betas.len();
        at.pose[3..].copy_from_slice(body_pose);
        for (j, (rest, template)) in at.rest.iter_mut().zip(&self.skeleton.template).enumerate() {
            *rest = std::array::from_fn(|axis| {
                let row = &self.skeleton.shapedirs[(3 * j + axis) * b..(3 * j + axis + 1) * b];
                template[axis] + row.iter().zip(betas).map(|(d, beta)| d * beta).sum::<f64>()
            });
        }
        at.pelvis = at.rest[0];
        for (j, parent) in self.skeleton.parents.iter().enumerate().skip(1) {
            let p = parent.expect("only the first joint has no parent");
            at.turns[j] = mul(&at.turns[p], &rodrigues(three(&at.pose, j)));
            at.joints[j] = add(at.joints[p], apply(&at.turns[p], sub(at.rest[j], at.rest[p])));
        }
        at.points.fill(ZERO);
        for &(k, j, weight) in &self.joint_terms {
            at.points[k] = add_scaled(at.points[k], at.joints[j], weight);
        }
        if let (Some(body), false) = (self.body, self.vertices.is_empty()) {
            let chosen: Vec<usize> = self.vertices.iter().map(|&(_, vertex)| vertex).collect();
            let moving = body.at_pose(self.skeleton, &at.pose, betas, &[], ZERO).vertex_derivatives(&chosen);
            for (&(k, _), position) in self.vertices.iter().zip(&moving.positions) {
                at.points[k] = sub(*position, at.pelvis);
            }
            at.vertices = Some(moving);
        }
    }

    /// Walks inwards: adds ∂E/∂θ̃ and ∂E/∂β, given ∂E/∂q_k for all K keypoints and ∂E/∂J_0.
    pub(super) fn pull_back(
        &self,
        by_points: &[Vector3],
        by_pelvis: Vector3,
        at: &mut UnrootedPose,
        by_pose: &mut [f64],
        by_betas: &mut [f64],
    ) {
        at.forces.fill(ZERO);
        at.torques.fill(ZERO);
        at.by_rest.fill(ZERO);
        at.by_rest[0] = by_pelvis;
        for &(k, j, weight) in &self.joint_terms {
            at.forces[j] = add_scaled(at.forces[j], by_points[k], weight);
        }
        for j in (1..at.joints.len()).rev() {
            let p = self.skeleton.parents[j].expect("only the first joint has no parent");
            let (force, torque) = (at.forces[j], at.torques[j]);
            let before = apply_transposed(&at.turns[p], torque);
            let slope = apply_transposed(&left_jacobian(three(&at.pose, j)), before);
            for (sum, slope) in by_pose[3 * (j - 1)..3 * j].iter_mut().zip(slope) {
                *sum += slope;
            }
            let by_bone = apply_transposed(&at.turns[p], force);
            at.by_rest[j] = add(at.by_rest[j], by_bone);
            at.by_rest[p] = sub(at.by_rest[p], by_bone);
            let lever = cross(sub(at.joints[j], at.joints[p]), force);
            at.torques[p] = add(at.torques[p], add(torque, lever));
            at.forces[p] = add(at.forces[p], force);
        }
        if let Some(moving) = &at.vertices {
            for (n, &(k, _)) in self.vertices.iter().enumerate() {
                // q = v − J_0.
                at.by_rest[0] = sub(at.by_rest[0], by_points[k]);
                for axis in 0..3 {
                    accumulate(by_pose, &moving.by_pose.row(3 * n + axis)[3..], by_points[k][axis]);
                    accumulate(by_betas, moving.by_betas.row(3 * n + axis), by_points[k][axis]);
                }
            }
        }
        let b = by_betas.len();
        for (j, by_rest) in at.by_rest.iter().enumerate() {
            for axis in 0..3 {
                let row = &self.skeleton.shapedirs[(3 * j + axis) * b..(3 * j + axis + 1) * b];
                accumulate(by_betas, row, by_rest[axis]);
            }
        }
    }
}

/// The axis–angle vector of joint `j`.
fn three(pose: &[f64], j: usize) -> Vector3 {
    [pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]]
}

/// sum += s · terms.
fn accumulate(sum: &mut [f64], terms: &[f64], s: f64) {
    for (sum, term) in sum.iter_mut().zip(terms) {
        *sum += s * term;
    }
}

//! The unknowns of a silhouette fit, and the body they make.

use super::unfold::{Damping, Surface};
use crate::body::blend_shapes::shape_blend;
use crate::body::{BodyModel, PosedBody, Skeleton};
use crate::linalg::matrix::Matrix3;
use crate::linalg::vector::{Vector3, add};

/// θ, β, t and D of a body.
pub struct State<'a> {
    /// The model.
    pub body: &'a BodyModel,
    /// Its joints without the mesh.
    pub skeleton: Skeleton,
    /// θ, 3J.
    pub pose: Vec<f64>,
    /// β, as many as the model has.
    pub betas: Vec<f64>,
    /// t.
    pub trans: Vector3,
    /// D, V×3.
    pub offsets: Vec<Vector3>,
}

impl State<'_> {
    /// The body at these parameters, with other offsets.
    pub fn posed<'s>(&'s self, offsets: &'s [Vector3]) -> PosedBody<'s> {
        self.body.at_pose(&self.skeleton, &self.pose, &self.betas, offsets, self.trans)
    }

    /// The posed skin in the world.
    pub fn vertices(&self) -> Vec<Vector3> {
        self.body.pose_with_offsets(&self.pose, &self.betas, &self.offsets, self.trans).vertices
    }

    /// t̄ + B_S(β): the zero pose without offsets.
    pub fn shaped(&self) -> Vec<Vector3> {
        shape_blend(&self.body.v_template, &self.body.shapedirs, &self.betas)
    }

    /// The posed joints in the world.
    pub fn joints(&self) -> Vec<Vector3> {
        let joints = self.skeleton.posed_joints(&self.pose, &self.betas);
        joints.into_iter().map(|joint| add(joint, self.trans)).collect()
    }

    /// Damps the offsets until they keep the surface.
    pub fn unfold(&mut self) -> Damping {
        let bare = self.posed(&[]);
        let (posed, linear): (Vec<Vector3>, Vec<Matrix3>) =
            (0..self.offsets.len()).map(|i| (bare.position(i), bare.by_offset(i))).unzip();
        let unposed = self.shaped();
        let surface = Surface { faces: &self.body.faces, unposed: &unposed, posed: &posed, linear: &linear };
        let (offsets, damping) = surface.unfold(&self.offsets);
        self.offsets = offsets;
        damping
    }
}

//! The body as keypoints see it: a few posed points and how they move with pose and shape.

use super::keypoint_set::{BodyKeypoint, BodyPoint, KeypointSet};
use crate::body::{BodyModel, Skeleton};
use crate::linalg::dense::Dense;
use crate::linalg::vector::{Vector3, ZERO, add_scaled};

/// The keypoints of a set on a body.
#[derive(Clone, Debug)]
pub struct Figure<'a> {
    body: &'a BodyModel,
    skeleton: &'a Skeleton,
    keypoints: Vec<Option<BodyKeypoint>>,
    /// (keypoint, vertex) of those that are vertices.
    vertices: Vec<(usize, usize)>,
}

/// The K points of a figure in a pose, and their derivatives; zero for keypoints that the body lacks.
#[derive(Clone, Debug, PartialEq)]
pub struct MovingPoints {
    /// K points without `trans`, metres.
    pub points: Vec<Vector3>,
    /// ∂/∂θ, 3K×3J.
    pub by_pose: Dense,
    /// ∂/∂β, 3K×(number of betas given).
    pub by_betas: Dense,
}

impl<'a> Figure<'a> {
    /// The keypoints of `set` on a body whose skeleton is `skeleton`.
    pub fn new(body: &'a BodyModel, skeleton: &'a Skeleton, set: KeypointSet) -> Figure<'a> {
        let keypoints = set.on_body(body);
        let vertex = |(k, keypoint): (usize, &Option<BodyKeypoint>)| match keypoint.as_ref()?.point {
            BodyPoint::Vertex(v) => Some((k, v)),
            BodyPoint::Joints(_) => None,
        };
        let vertices = keypoints.iter().enumerate().filter_map(vertex).collect();
        Figure { body, skeleton, keypoints, vertices }
    }

    /// The skeleton.
    pub fn skeleton(&self) -> &'a Skeleton {
        self.skeleton
    }

    /// The keypoints of the set, `None` for those that the body lacks.
    pub fn keypoints(&self) -> &[Option<BodyKeypoint>] {
        &self.keypoints
    }

    /// The terms of every keypoint that is a sum over joints: (keypoint, joint, weight).
    fn joint_terms(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let joints = |keypoint: &'_ Option<BodyKeypoint>| match keypoint.as_ref().map(|k| &k.point) {
            Some(BodyPoint::Joints(joints)) => joints.clone(),
            _ => Vec::new(),
        };
        self.keypoints
            .iter()
            .enumerate()
            .flat_map(move |(k, p)| joints(p).into_iter().map(move |(j, w)| (k, j, w)))
    }

    /// The K points at a pose and a shape, without `trans`; zero for keypoints that the body lacks.
    ///
    /// # Panics
    /// If `pose` does not have 3J numbers or there are more than B betas.
    pub fn points(&self, pose: &[f64], betas: &[f64]) -> Vec<Vector3> {
        let joints = self.skeleton.posed_joints(pose, betas);
        let mut points = vec![ZERO; self.keypoints.len()];
        for (k, j, weight) in self.joint_terms() {
            points[k] = add_scaled(points[k], joints[j], weight);
        }
        if !self.vertices.is_empty() {
            let held = self.body.at_pose(self.skeleton, pose, betas, &[], ZERO);
            for &(k, vertex) in &self.vertices {
                points[k] = held.position(vertex);
            }
        }
        points
    }

    /// [`Figure::points`] with their derivatives by pose and by the betas given.
    ///
    /// # Panics
    /// As [`Figure::points`].
    pub fn moving_points(&self, pose: &[f64], betas: &[f64]) -> MovingPoints {
        let joints = self.skeleton.joint_derivatives(pose, betas);
        let count = self.keypoints.len();
        let mut moving = MovingPoints {
            points: vec![ZERO; count],
            by_pose: Dense::zeros(3 * count, pose.len()),
            by_betas: Dense::zeros(3 * count, betas.len()),
        };
        for (k, j, weight) in self.joint_terms() {
            moving.points[k] = add_scaled(moving.points[k], joints.joints[j], weight);
            for axis in 0..3 {
                let (row, source) = (3 * k + axis, 3 * j + axis);
                accumulate(moving.by_pose.row_mut(row), joints.by_pose.row(source), weight);
                accumulate(moving.by_betas.row_mut(row), joints.by_betas.row(source), weight);
            }
        }
        if !self.vertices.is_empty() {
            let chosen: Vec<usize> = self.vertices.iter().map(|&(_, vertex)| vertex).collect();
            let vertices =
                self.body.at_pose(self.skeleton, pose, betas, &[], ZERO).vertex_derivatives(&chosen);
            for (n, &(k, _)) in self.vertices.iter().enumerate() {
                moving.points[k] = vertices.positions[n];
                for axis in 0..3 {
                    let (row, source) = (3 * k + axis, 3 * n + axis);
                    moving.by_pose.row_mut(row).copy_from_slice(vertices.by_pose.row(source));
                    moving.by_betas.row_mut(row).copy_from_slice(vertices.by_betas.row(source));
                }
            }
        }
        moving
    }
}

/// sum += weight · terms.
fn accumulate(sum: &mut [f64], terms: &[f64], weight: f64) {
    for (sum, term) in sum.iter_mut().zip(terms) {
        *sum += weight * term;
    }
}

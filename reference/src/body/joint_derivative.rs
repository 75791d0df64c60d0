//! How the posed joints move with pose and shape.
//!
//! A change of θ_k turns everything below joint k about the posed joint p_k. With the left Jacobian J_l of the exponential
//! map, component i of θ_k turns about the world axis
//!
//! ω_{k,i} = R(G_parent(k)) · J_l(θ_k) e_i,  so  ∂p_j/∂θ_{k,i} = ω_{k,i} × (p_j − p_k)
//!
//! for every joint j below k; all others, and k itself, stay. A change of β lengthens the bones:
//!
//! ∂p_0/∂β = ∂J_0/∂β,  ∂p_j/∂β = ∂p_parent/∂β + R(G_parent) · (∂J_j/∂β − ∂J_parent/∂β).

use super::kinematic_tree::{Rigid, global_transforms};
use super::skeleton::Skeleton;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, apply, column, mul};
use crate::linalg::vector::{Vector3, cross, sub};
use crate::rotation::{left_jacobian, rodrigues};

/// The posed joints at a pose and a shape, and their derivatives.
///
/// Row 3·n + axis belongs to the n-th joint asked for; column 3·k + i to component i of θ_k. Metres per radian, metres per
/// standard deviation. The derivative by `trans` is the identity for every joint.
#[derive(Clone, Debug, PartialEq)]
pub struct JointDerivatives {
    /// The posed joints, without `trans`.
    pub joints: Vec<Vector3>,
    /// ∂p/∂θ, 3n×3J; zero except for ancestors.
    pub by_pose: Dense,
    /// ∂p/∂β, 3n×(number of betas given).
    pub by_betas: Dense,
}

impl Skeleton {
    /// All J posed joints and their derivatives by pose and by the betas given.
    ///
    /// `betas` may be shorter than B: there is one column for each number given, so give zeros for betas that are free.
    ///
    /// # Panics
    /// As [`Skeleton::pose`].
    ///
    /// ```
    /// let skeleton = vitruvian_reference::body::mannequin().skeleton();
    /// let at_rest = skeleton.joint_derivatives(&[0.0; 72], &[0.0; 10]);
    /// // Turning the left shoulder (16) about +Z lifts the left wrist (20) by the length of the arm.
    /// let arm = skeleton.template[20][0] - skeleton.template[16][0];
    /// assert!((at_rest.by_pose[(3 * 20 + 1, 3 * 16 + 2)] - arm).abs() < 1e-15);
    /// assert_eq!((at_rest.by_betas.rows(), at_rest.by_betas.columns()), (72, 10));
    /// ```
    pub fn joint_derivatives(&self, pose: &[f64], betas: &[f64]) -> JointDerivatives {
        let all: Vec<usize> = (0..self.joint_count()).collect();
        self.joint_derivatives_of(&all, pose, betas)
    }

    /// The same for the joints `chosen` alone, in that order.
    ///
    /// # Panics
    /// As [`Skeleton::pose`], or if a joint is not there.
    pub fn joint_derivatives_of(&self, chosen: &[usize], pose: &[f64], betas: &[f64]) -> JointDerivatives {
        let posed = self.turning(pose, betas);
        let joints: Vec<Vector3> = chosen.iter().map(|&j| posed.joint(j)).collect();

        let width = pose.len();
        let mut by_pose = vec![0.0; 3 * chosen.len() * width];
        for (rows, &j) in by_pose.chunks_exact_mut(3 * width).zip(chosen) {
            let mut ancestor = self.parents[j];
            while let Some(k) = ancestor {
                posed.add_turns(k, sub(posed.joint(j), posed.joint(k)), rows);
                ancestor = self.parents[k];
            }
        }

        let all_by_betas = posed.joints_by_betas(betas.len());
        let rows = 3 * betas.len();
        let by_betas =
            chosen.iter().flat_map(|&j| &all_by_betas[j * rows..(j + 1) * rows]).copied().collect();
        JointDerivatives {
            joints,
            by_pose: Dense::new(3 * chosen.len(), width, by_pose),
            by_betas: Dense::new(3 * chosen.len(), betas.len(), by_betas),
        }
    }

    /// The skeleton in a pose, with the world axes about which its joints turn.
    pub(super) fn turning(&self, pose: &[f64], betas: &[f64]) -> Turning<'_> {
        self.assert_pose(pose);
        let vectors = || pose.chunks_exact(3).map(|v| [v[0], v[1], v[2]]);
        let rotations: Vec<Matrix3> = vectors().map(rodrigues).collect();
        let rest_joints = self.rest_joints(betas);
        let global = global_transforms(&rotations, &rest_joints, &self.parents);
        let axes = vectors()
            .zip(&self.parents)
            .map(|(v, parent)| match parent {
                None => left_jacobian(v),
                Some(p) => mul(&global[*p].rotation, &left_jacobian(v)),
            })
            .collect();
        Turning { skeleton: self, rest_joints, rotations, global, axes }
    }
}

/// A skeleton in a pose: what all derivatives there share.
#[derive(Clone, Debug)]
pub(super) struct Turning<'a> {
    pub skeleton: &'a Skeleton,
    /// J(β).
    pub rest_joints: Vec<Vector3>,
    /// exp(θ_k).
    pub rotations: Vec<Matrix3>,
    /// G_k.
    pub global: Vec<Rigid>,
    /// \[ω_{k,0} ω_{k,1} ω_{k,2}\], in columns.
    pub axes: Vec<Matrix3>,
}

impl Turning<'_> {
    /// p_j.
    pub fn joint(&self, j: usize) -> Vector3 {
        self.global[j].translation
    }

    /// Adds ω_{k,i} × arm to the columns 3k + i of three rows of 3J numbers.
    pub fn add_turns(&self, k: usize, arm: Vector3, rows: &mut [f64]) {
        let width = rows.len() / 3;
        for i in 0..3 {
            let moved = cross(column(&self.axes[k], i), arm);
            for axis in 0..3 {
                rows[axis * width + 3 * k + i] += moved[axis];
            }
        }
    }

    /// ∂J_j/∂β_l of the rest joint.
    pub fn rest_joint_by_beta(&self, j: usize, l: usize) -> Vector3 {
        let b = self.skeleton.beta_count();
        std::array::from_fn(|axis| self.skeleton.shapedirs[(3 * j + axis) * b + l])
    }

    /// ∂p_j/∂β for the first `b` betas, J×3×b row-major.
    pub fn joints_by_betas(&self, b: usize) -> Vec<f64> {
        let mut derivative = vec![0.0; 3 * b * self.global.len()];
        for (j, parent) in self.skeleton.parents.iter().enumerate() {
            for l in 0..b {
                let own = self.rest_joint_by_beta(j, l);
                let moved = match *parent {
                    None => own,
                    Some(p) => {
                        let bone = sub(own, self.rest_joint_by_beta(p, l));
                        let turned = apply(&self.global[p].rotation, bone);
                        std::array::from_fn(|axis| derivative[(3 * p + axis) * b + l] + turned[axis])
                    }
                };
                for axis in 0..3 {
                    derivative[(3 * j + axis) * b + l] = moved[axis];
                }
            }
        }
        derivative
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;

    /// Truncation h²/6 times third derivatives of at most a few metres, and rounding ε/h: both below 10⁻⁹.
    const STEP: f64 = 1e-5;
    const BOUND: f64 = 1e-9;

    /// The largest difference between columns of `analytic` and central differences of `f` about `x`.
    fn worst(analytic: &Dense, x: &[f64], f: impl Fn(&[f64]) -> Vec<Vector3>) -> f64 {
        let mut worst: f64 = 0.0;
        for n in 0..x.len() {
            let moved = |step: f64| {
                let mut y = x.to_vec();
                y[n] += step;
                f(&y).concat()
            };
            for (row, (above, below)) in moved(STEP).iter().zip(moved(-STEP)).enumerate() {
                worst = worst.max((analytic[(row, n)] - (above - below) / (2.0 * STEP)).abs());
            }
        }
        worst
    }

    #[test]
    fn derivatives_are_central_differences() {
        let skeleton = mannequin().skeleton();
        let betas = [0.3, -1.0, 0.2, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0];
        for size in [0.0, 1e-4, 0.7, 3.0, 7.0] {
            let pose: Vec<f64> = (0..72).map(|n| size * (1.3 * f64::from(n)).sin()).collect();
            let d = skeleton.joint_derivatives(&pose, &betas);
            assert_eq!(d.joints, skeleton.posed_joints(&pose, &betas));
            let by_pose = worst(&d.by_pose, &pose, |pose| skeleton.posed_joints(pose, &betas));
            let by_betas = worst(&d.by_betas, &betas, |betas| skeleton.posed_joints(&pose, betas));
            assert!(by_pose < BOUND && by_betas < BOUND, "size {size}: {by_pose:e} {by_betas:e}");
        }
    }

    #[test]
    fn leaves_move_no_joint() {
        let skeleton = mannequin().skeleton();
        let d = skeleton.joint_derivatives(&[0.2; 72], &[]);
        for leaf in [10, 11, 15, 22, 23] {
            assert!((0..72).all(|row| (0..3).all(|i| d.by_pose[(row, 3 * leaf + i)] == 0.0)), "joint {leaf}");
        }
        assert_eq!((d.by_betas.rows(), d.by_betas.columns()), (72, 0));
    }

    #[test]
    fn chosen_joints_have_the_rows_of_all() {
        let skeleton = mannequin().skeleton();
        let (pose, betas) = ([0.4; 72], [1.0, 2.0]);
        let (all, some) = (
            skeleton.joint_derivatives(&pose, &betas),
            skeleton.joint_derivatives_of(&[20, 0], &pose, &betas),
        );
        for (n, j) in [20, 0].into_iter().enumerate() {
            assert_eq!(some.joints[n], all.joints[j]);
            for axis in 0..3 {
                assert_eq!(some.by_pose.row(3 * n + axis), all.by_pose.row(3 * j + axis));
                assert_eq!(some.by_betas.row(3 * n + axis), all.by_betas.row(3 * j + axis));
            }
        }
    }
}

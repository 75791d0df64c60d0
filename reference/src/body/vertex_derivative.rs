//! How chosen vertices move with pose, shape and offsets.
//!
//! With x_i the vertex in the rest pose, q_ij = A_j x_i where joint j alone would take it, and L_i = Σ_j w_ij R(G_j):
//!
//! ```text
//!     ∂v_i/∂θ_{k,c} = Σ_{j = k or below k} w_ij ω_{k,c} × (q_ij − p_k)  +  L_i posedirs_i vec(∂R_k/∂θ_{k,c})
//!     ∂v_i/∂β       = L_i shapedirs_i + Σ_j w_ij ∂t(A_j)/∂β
//!     ∂v_i/∂D_i     = L_i
//! ```
//!
//! The axes ω are those of [`super::joint_derivative`]. The second term of the first line is missing for the root, whose
//! turn asks for no corrective; the second of the second says that shape moves the joints about which a vertex turns.

use super::posed_body::PosedBody;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, apply};
use crate::linalg::vector::{Vector3, add, sub};

/// Chosen vertices and their derivatives; the derivative by `trans` is the identity.
///
/// Row 3·n + axis belongs to the n-th vertex asked for; column 3·k + i to component i of θ_k.
#[derive(Clone, Debug, PartialEq)]
pub struct VertexDerivatives {
    /// The vertices in the world, n×3 metres.
    pub positions: Vec<Vector3>,
    /// ∂v/∂θ, 3n×3J.
    pub by_pose: Dense,
    /// ∂v/∂β, 3n×(number of betas given).
    pub by_betas: Dense,
    /// L_i = ∂v_i/∂D_i; offsets of other vertices do not move a vertex.
    pub by_offset: Vec<Matrix3>,
}

impl PosedBody<'_> {
    /// The vertices `chosen`, in that order, and all their derivatives.
    ///
    /// # Panics
    /// If a vertex is not there.
    pub fn vertex_derivatives(&self, chosen: &[usize]) -> VertexDerivatives {
        let (width, b) = (3 * self.body.joint_count(), self.betas.len());
        let mut by_pose = vec![0.0; 3 * chosen.len() * width];
        let mut by_betas = vec![0.0; 3 * chosen.len() * b];
        for (n, &i) in chosen.iter().enumerate() {
            self.add_by_pose(i, &mut by_pose[3 * n * width..3 * (n + 1) * width]);
            self.write_by_betas(i, &mut by_betas[3 * n * b..3 * (n + 1) * b]);
        }
        VertexDerivatives {
            positions: chosen.iter().map(|&i| self.position(i)).collect(),
            by_pose: Dense::new(3 * chosen.len(), width, by_pose),
            by_betas: Dense::new(3 * chosen.len(), b, by_betas),
            by_offset: chosen.iter().map(|&i| self.by_offset(i)).collect(),
        }
    }

    /// ∂v_i/∂D_i = L_i = Σ_j w_ij R(G_j), the linear part of the [blended transform](PosedBody::blended_transform).
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn by_offset(&self, i: usize) -> Matrix3 {
        self.blended_transform(i).linear
    }

    /// ∂v_i/∂θ, 3×3J row-major, into `rows`.
    ///
    /// # Panics
    /// If there is no such vertex, or there are not 3·3J numbers in `rows`.
    pub fn by_pose(&self, i: usize, rows: &mut [f64]) {
        let width = 3 * self.body.joint_count();
        assert!(
            rows.len() == 3 * width,
            "PosedBody::by_pose: room for {} numbers, 3·3J = 3·{width}",
            rows.len()
        );
        rows.fill(0.0);
        self.add_by_pose(i, rows);
    }

    /// ∂v_i/∂β, 3×(number of betas given) row-major, into `rows`.
    ///
    /// # Panics
    /// If there is no such vertex, or `rows` has another length.
    pub fn by_betas(&self, i: usize, rows: &mut [f64]) {
        let b = self.betas.len();
        assert!(rows.len() == 3 * b, "PosedBody::by_betas: room for {} numbers, 3·{b} betas", rows.len());
        self.write_by_betas(i, rows);
    }

    /// Adds ∂v_i/∂θ to `rows`.
    fn add_by_pose(&self, i: usize, rows: &mut [f64]) {
        let parents = &self.turning.skeleton.parents;
        let x = add(self.shaped(i), self.pose_corrective(i));
        for (j, w) in self.weights(i).iter().enumerate().filter(|(_, w)| **w != 0.0) {
            let q = self.relative[j].apply(x);
            let mut turned = Some(j);
            while let Some(k) = turned {
                let arm = sub(q, self.turning.joint(k)).map(|x| w * x);
                self.turning.add_turns(k, arm, rows);
                turned = parents[k];
            }
        }
        self.add_correctives_by_pose(i, rows);
    }

    /// Adds L_i posedirs_i vec(∂R_k/∂θ_{k,c}) to `rows`, for all joints but the root.
    fn add_correctives_by_pose(&self, i: usize, rows: &mut [f64]) {
        let (width, p) = (3 * self.body.joint_count(), self.feature.len());
        let directions = self.pose_directions(i);
        let linear = self.by_offset(i);
        for (n, feature_by_pose) in self.feature_by_pose.iter().enumerate() {
            let nine = |axis: usize| &directions[axis * p + 9 * n..axis * p + 9 * n + 9];
            // Most joints are too far away to ask for a corrective in models that are made sparse.
            if (0..3).all(|axis| nine(axis).iter().all(|d| *d == 0.0)) {
                continue;
            }
            for (c, turned) in feature_by_pose.iter().enumerate() {
                let corrective: Vector3 =
                    std::array::from_fn(|axis| nine(axis).iter().zip(turned).map(|(d, f)| d * f).sum());
                let moved = apply(&linear, corrective);
                for axis in 0..3 {
                    rows[axis * width + 3 * (n + 1) + c] += moved[axis];
                }
            }
        }
    }

    fn write_by_betas(&self, i: usize, rows: &mut [f64]) {
        let (b, all) = (self.betas.len(), self.body.beta_count());
        let linear = self.by_offset(i);
        let direction = |axis: usize, l: usize| self.body.shapedirs[(3 * i + axis) * all + l];
        for l in 0..b {
            let moved = apply(&linear, [direction(0, l), direction(1, l), direction(2, l)]);
            for axis in 0..3 {
                rows[axis * b + l] = moved[axis];
            }
        }
        for (j, w) in self.weights(i).iter().enumerate().filter(|(_, w)| **w != 0.0) {
            let shift = &self.translations_by_betas[3 * j * b..3 * (j + 1) * b];
            for (sum, shift) in rows.iter_mut().zip(shift) {
                *sum += w * shift;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::body::{BodyModel, Skeleton, mannequin};
    use crate::linalg::vector::{Vector3, add_scaled};

    const STEP: f64 = 1e-5;
    /// Truncation h²/6 times third derivatives of a few metres at most, and rounding ε/h: both below 10⁻⁹.
    const BOUND: f64 = 1e-9;
    const CHOSEN: [usize; 5] = [0, 1200, 3456, 5001, 8000];

    /// The mannequin with correctives at every vertex and joint, small but dense: its own are sparse.
    fn dense_body() -> (BodyModel, Skeleton) {
        let mut body = mannequin();
        for (n, d) in body.posedirs.iter_mut().enumerate() {
            *d += 1e-3 * (n as f64).sin();
        }
        let skeleton = body.skeleton();
        (body, skeleton)
    }

    fn positions(body: &BodyModel, skeleton: &Skeleton, pose: &[f64], betas: &[f64]) -> Vec<f64> {
        let held = body.at_pose(skeleton, pose, betas, &[], [0.5, 1.0, 3.0]);
        CHOSEN.iter().flat_map(|&i| held.position(i)).collect()
    }

    fn moved(x: &[f64], n: usize, step: f64) -> Vec<f64> {
        let mut y = x.to_vec();
        y[n] += step;
        y
    }

    #[test]
    fn derivatives_are_central_differences() {
        let (body, skeleton) = dense_body();
        let betas = [0.3, -1.0, 0.2, 0.0, 0.5];
        for size in [0.0, 1e-4, 0.7, 3.0] {
            let pose: Vec<f64> = (0..72).map(|n| size * (1.3 * f64::from(n)).sin()).collect();
            let d = body.at_pose(&skeleton, &pose, &betas, &[], [0.5, 1.0, 3.0]).vertex_derivatives(&CHOSEN);
            let compare = |name: &str, analytic: &dyn Fn(usize) -> f64, above: &[f64], below: &[f64]| {
                for row in 0..3 * CHOSEN.len() {
                    let error = (analytic(row) - (above[row] - below[row]) / (2.0 * STEP)).abs();
                    assert!(error < BOUND, "size {size}, {name}, row {row}: {error:e}");
                }
            };
            for n in 0..72 {
                let at = |step| positions(&body, &skeleton, &moved(&pose, n, step), &betas);
                compare("pose", &|row| d.by_pose[(row, n)], &at(STEP), &at(-STEP));
            }
            for n in 0..betas.len() {
                let at = |step| positions(&body, &skeleton, &pose, &moved(&betas, n, step));
                compare("betas", &|row| d.by_betas[(row, n)], &at(STEP), &at(-STEP));
            }
        }
    }

    #[test]
    fn offsets_move_their_own_vertex_by_the_blended_rotation() {
        let (body, skeleton) = dense_body();
        let pose: Vec<f64> = (0..72).map(|n| (0.7 * f64::from(n)).cos()).collect();
        let bare = body.at_pose(&skeleton, &pose, &[], &[], [0.0; 3]);
        for axis in 0..3 {
            let mut offset = [0.0; 3];
            offset[axis] = 0.25;
            let offsets: Vec<Vector3> = vec![offset; body.vertex_count()];
            let clothed = body.at_pose(&skeleton, &pose, &[], &offsets, [0.0; 3]);
            for i in CHOSEN {
                let difference = add_scaled(clothed.position(i), bare.position(i), -1.0);
                for row in 0..3 {
                    // Linear in D: the difference is exact whatever its size.
                    assert!((difference[row] - 0.25 * bare.by_offset(i)[row][axis]).abs() < 1e-15);
                }
            }
        }
    }

    #[test]
    fn offsets_lengthen_the_arm_by_which_pose_moves_a_vertex() {
        let (body, skeleton) = dense_body();
        let pose: Vec<f64> = (0..72).map(|n| (0.7 * f64::from(n)).cos()).collect();
        let offsets: Vec<Vector3> = vec![[0.1, -0.2, 0.3]; body.vertex_count()];
        let (i, mut rows) = (3456, vec![7.0; 216]);
        body.at_pose(&skeleton, &pose, &[], &offsets, [0.0; 3]).by_pose(i, &mut rows);
        for n in 0..72 {
            let at =
                |step| body.at_pose(&skeleton, &moved(&pose, n, step), &[], &offsets, [0.0; 3]).position(i);
            let (above, below) = (at(STEP), at(-STEP));
            for axis in 0..3 {
                let numeric = (above[axis] - below[axis]) / (2.0 * STEP);
                assert!((rows[72 * axis + n] - numeric).abs() < BOUND, "θ_{n}, axis {axis}");
            }
        }
    }

    #[test]
    fn single_rows_are_those_of_the_jacobian() {
        let (body, skeleton) = dense_body();
        let held = body.at_pose(&skeleton, &[0.3; 72], &[1.0, 2.0], &[], [0.0; 3]);
        let all = held.vertex_derivatives(&CHOSEN);
        let (mut by_pose, mut by_betas) = (vec![7.0; 216], vec![7.0; 6]);
        held.by_pose(CHOSEN[2], &mut by_pose);
        held.by_betas(CHOSEN[2], &mut by_betas);
        for axis in 0..3 {
            assert_eq!(&by_pose[72 * axis..72 * (axis + 1)], all.by_pose.row(6 + axis));
            assert_eq!(&by_betas[2 * axis..2 * (axis + 1)], all.by_betas.row(6 + axis));
        }
        assert_eq!(all.by_offset[2], held.by_offset(CHOSEN[2]));
        assert_eq!(all.positions[2], held.position(CHOSEN[2]));
    }

    #[test]
    #[should_panic(expected = "room for 72 numbers, 3·3J = 3·72")]
    fn rows_of_the_wrong_size_are_refused() {
        let (body, skeleton) = dense_body();
        body.at_pose(&skeleton, &[0.0; 72], &[], &[], [0.0; 3]).by_pose(0, &mut [0.0; 72]);
    }
}

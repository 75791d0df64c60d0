//! Linear blend skinning.

use super::kinematic_tree::Rigid;
use crate::linalg::matrix::{Matrix3, apply, determinant, inverse};
use crate::linalg::vector::{Vector3, ZERO, add, add_scaled, negate};

/// v_i = Σ_j w_ij (R_j x_i + t_j): every point moved by the weighted mean of its joints' transforms.
///
/// `rest_pose` V×3 metres, `lbs_weights` V×J row-major, `transforms` the J [relative
/// transforms](super::kinematic_tree::relative_transforms). Weights that sum to 1 make this commute with rigid
/// motions of the whole body.
///
/// # Panics
/// If there are not V·J weights.
///
/// # References
/// Loper et al. 2015, eq. 2–3.
pub fn linear_blend_skinning(
    rest_pose: &[Vector3],
    lbs_weights: &[f64],
    transforms: &[Rigid],
) -> Vec<Vector3> {
    let j = transforms.len();
    assert!(
        lbs_weights.len() == rest_pose.len() * j,
        "linear_blend_skinning: {} weights, V·J = {}·{j}",
        lbs_weights.len(),
        rest_pose.len()
    );
    let blend = |(x, weights): (&Vector3, &[f64])| {
        weights
            .iter()
            .zip(transforms)
            .filter(|(w, _)| **w != 0.0)
            .fold(ZERO, |sum, (w, transform)| add_scaled(sum, transform.apply(*x), *w))
    };
    rest_pose.iter().zip(lbs_weights.chunks_exact(j)).map(blend).collect()
}

/// An affine map x ↦ A x + t: what blending makes of several rigid transforms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// A.
    pub linear: Matrix3,
    /// t, metres.
    pub translation: Vector3,
}

impl Affine {
    /// A x + t.
    pub fn apply(&self, x: Vector3) -> Vector3 {
        add(apply(&self.linear, x), self.translation)
    }

    /// The inverse x ↦ A⁻¹ (x − t), or `None` where |det A| < 10⁻⁶.
    ///
    /// Equal weights on two joints turned by an angle φ against each other give det A = cos²(φ/2): the bound is reached
    /// a tenth of a degree before a half turn, where an error of a millimetre would become a metre.
    pub fn inverse(&self) -> Option<Affine> {
        if determinant(&self.linear).abs() < 1e-6 {
            return None;
        }
        let linear = inverse(&self.linear)?;
        Some(Affine { linear, translation: negate(apply(&linear, self.translation)) })
    }
}

/// V = Σ_j w_j A_j for one vertex: its row of `weights` (J), the J [relative
/// transforms](super::kinematic_tree::relative_transforms).
///
/// # Panics
/// If there are not J weights.
pub fn blended_transform(weights: &[f64], transforms: &[Rigid]) -> Affine {
    assert!(
        weights.len() == transforms.len(),
        "blended_transform: {} weights, {} transforms",
        weights.len(),
        transforms.len()
    );
    let mut blended = Affine { linear: [[0.0; 3]; 3], translation: ZERO };
    for (w, transform) in weights.iter().zip(transforms).filter(|(w, _)| **w != 0.0) {
        for row in 0..3 {
            blended.linear[row] = add_scaled(blended.linear[row], transform.rotation[row], *w);
        }
        blended.translation = add_scaled(blended.translation, transform.translation, *w);
    }
    blended
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::IDENTITY;
    use crate::linalg::vector::{distance, norm};
    use crate::rotation::rodrigues;
    use std::f64::consts::PI;

    const STILL: Rigid = Rigid { rotation: IDENTITY, translation: [0.0; 3] };

    #[test]
    fn one_joint_moves_rigidly() {
        let lift = Rigid { rotation: IDENTITY, translation: [0.0, 2.0, 0.0] };
        assert_eq!(linear_blend_skinning(&[[1.0, 2.0, 3.0]], &[0.0, 1.0], &[STILL, lift]), [[1.0, 4.0, 3.0]]);
    }

    #[test]
    fn half_turn_shared_equally_collapses_to_the_axis() {
        // The known defect of linear blending, and the reason for pose correctives.
        let turn = Rigid { rotation: rodrigues([PI, 0.0, 0.0]), translation: [0.0; 3] };
        let collapsed = linear_blend_skinning(&[[0.0, 1.0, 0.0]], &[0.5, 0.5], &[STILL, turn]);
        assert!(norm(collapsed[0]) < 1e-15, "{collapsed:?}");
    }

    #[test]
    fn blended_transform_is_skinning_and_its_inverse_undoes_it() {
        let turn = Rigid { rotation: rodrigues([0.0, 1.2, -0.4]), translation: [0.3, -1.0, 0.2] };
        let (x, weights, transforms) = ([0.5, 2.0, -1.0], [0.3, 0.7], [STILL, turn]);
        let blended = blended_transform(&weights, &transforms);
        let moved = blended.apply(x);
        assert!(distance(moved, linear_blend_skinning(&[x], &weights, &transforms)[0]) < 1e-15);
        assert!(distance(blended.inverse().expect("well conditioned").apply(moved), x) < 1e-15);
    }

    #[test]
    fn collapsed_blend_has_no_inverse() {
        let turn = Rigid { rotation: rodrigues([PI, 0.0, 0.0]), translation: [0.0; 3] };
        assert_eq!(blended_transform(&[0.5, 0.5], &[STILL, turn]).inverse(), None);
    }
}

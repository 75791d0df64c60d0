//! Linear blend skinning.

use super::kinematic_tree::Rigid;
use crate::linalg::vector::{Vector3, ZERO, add_scaled};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::IDENTITY;
    use crate::linalg::vector::norm;
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
}

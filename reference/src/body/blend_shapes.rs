//! What moves the rest mesh linearly: shape, and the correctives that pose asks for.

use crate::linalg::matrix::{IDENTITY, Matrix3};
use crate::linalg::vector::{Vector3, ZERO, add, add_scaled};
use std::ops::Range;

/// v_shaped = v_template + Σ_l β_l · shapedirs\[:, :, l\].
///
/// `v_template` V×3, `shapedirs` V×3×B row-major, `betas` at most B numbers in standard deviations. Metres.
///
/// # Panics
/// If there are more than B betas.
pub fn shape_blend(v_template: &[Vector3], shapedirs: &[f64], betas: &[f64]) -> Vec<Vector3> {
    let b = shapedirs.len() / (3 * v_template.len());
    assert!(betas.len() <= b, "shape_blend: {} betas, the model has B = {b}", betas.len());
    let mut shaped = v_template.to_vec();
    if betas.is_empty() {
        return shaped;
    }
    for (vertex, directions) in shaped.iter_mut().zip(shapedirs.chunks_exact(3 * b)) {
        for axis in 0..3 {
            let row = &directions[axis * b..];
            vertex[axis] += betas.iter().zip(row).map(|(beta, d)| beta * d).sum::<f64>();
        }
    }
    shaped
}

/// J = J_regressor · v: the joints (J×3) of an unposed mesh (V×3), from a J×V row-major regressor.
///
/// # Panics
/// If the regressor's length is not a multiple of V.
pub fn regress_joints(j_regressor: &[f64], vertices: &[Vector3]) -> Vec<Vector3> {
    let v = vertices.len();
    assert!(
        v > 0 && j_regressor.len().is_multiple_of(v),
        "regress_joints: {} numbers in the regressor, V = {v}",
        j_regressor.len()
    );
    let regress = |row: &[f64]| {
        // Regressors are sparse: most of the V numbers of a row are zero.
        row.iter().zip(vertices).filter(|(w, _)| **w != 0.0).fold(ZERO, |sum, (w, x)| add_scaled(sum, *x, *w))
    };
    j_regressor.chunks_exact(v).map(regress).collect()
}

/// The pose feature vec(R_1 − I, …, R_{J−1} − I): 9(J − 1) numbers, joint by joint, each matrix row by row.
///
/// The root (joint 0) is left out: turning the whole body does not change its shape.
pub fn pose_feature(rotations: &[Matrix3]) -> Vec<f64> {
    let entries = |r: &Matrix3| {
        let r = *r;
        (0..9).map(move |n| r[n / 3][n % 3] - IDENTITY[n / 3][n % 3])
    };
    rotations.iter().skip(1).flat_map(entries).collect()
}

/// v_posed = v_shaped + posedirs · feature.
///
/// `v_shaped` V×3, `posedirs` V×3×P row-major, `feature` P numbers.
///
/// # Panics
/// If `posedirs` does not have 3·V·P numbers.
pub fn pose_blend(v_shaped: Vec<Vector3>, posedirs: &[f64], feature: &[f64]) -> Vec<Vector3> {
    let p = feature.len();
    assert!(
        posedirs.len() == 3 * v_shaped.len() * p,
        "pose_blend: posedirs has {} numbers, 3·V·P = 3·{}·{p}",
        posedirs.len(),
        v_shaped.len()
    );
    let moving = moving_features(feature);
    if moving.is_empty() {
        return v_shaped;
    }
    let mut rest_pose = v_shaped;
    for (vertex, directions) in rest_pose.iter_mut().zip(posedirs.chunks_exact(3 * p)) {
        let displacement = pose_displacement(directions, feature, &moving);
        *vertex = add(*vertex, displacement);
    }
    rest_pose
}

/// Runs of joints that turn, as ranges of the feature.
///
/// Joints at rest have nine zeros in the feature; leaving them out changes no sum.
pub(super) fn moving_features(feature: &[f64]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for start in (0..feature.len()).step_by(9).filter(|&n| feature[n..n + 9].iter().any(|x| *x != 0.0)) {
        match runs.last_mut() {
            Some(run) if run.end == start => run.end += 9,
            _ => runs.push(start..start + 9),
        }
    }
    runs
}

/// B_P of one vertex: its 3×P pose directions times the feature, over the ranges that are not zero.
pub(super) fn pose_displacement(directions: &[f64], feature: &[f64], moving: &[Range<usize>]) -> Vector3 {
    let p = feature.len();
    std::array::from_fn(|axis| {
        let row = &directions[axis * p..(axis + 1) * p];
        moving.iter().map(|run| dot(&row[run.clone()], &feature[run.clone()])).sum()
    })
}

/// Σ a_k b_k in eight partial sums: independent, so that the processor need not wait for one addition to begin the next.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a_head, a_tail) = a.as_chunks::<8>();
    let (b_head, b_tail) = b.as_chunks::<8>();
    let mut partial = [0.0; 8];
    for (a, b) in a_head.iter().zip(b_head) {
        for k in 0..8 {
            partial[k] += a[k] * b[k];
        }
    }
    let tail: f64 = a_tail.iter().zip(b_tail).map(|(a, b)| a * b).sum();
    partial.iter().sum::<f64>() + tail
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::rodrigues;

    #[test]
    fn betas_weigh_their_directions() {
        let shapedirs = [1.0, 10.0, 2.0, 20.0, 3.0, 30.0];
        assert_eq!(shape_blend(&[[0.5, 0.0, 0.0]], &shapedirs, &[1.0, 0.1]), [[2.5, 4.0, 6.0]]);
        assert_eq!(shape_blend(&[[0.5, 0.0, 0.0]], &shapedirs, &[1.0]), [[1.5, 2.0, 3.0]]);
    }

    #[test]
    #[should_panic(expected = "3 betas, the model has B = 2")]
    fn too_many_betas_are_refused() {
        shape_blend(&[[0.0; 3]], &[0.0; 6], &[0.0; 3]);
    }

    #[test]
    fn regressed_joint_is_the_weighted_mean() {
        let joints = regress_joints(&[0.25, 0.75, 1.0, 0.0], &[[4.0, 0.0, 0.0], [0.0, 4.0, 8.0]]);
        assert_eq!(joints, [[1.0, 3.0, 6.0], [4.0, 0.0, 0.0]]);
    }

    #[test]
    fn pose_feature_is_row_major_and_leaves_the_root_out() {
        let r = rodrigues([0.3, -0.2, 0.5]);
        let feature = pose_feature(&[rodrigues([1.0, 0.0, 0.0]), r]);
        assert_eq!(feature.len(), 9);
        assert_eq!(feature[1], r[0][1]);
        assert_eq!(feature[8], r[2][2] - 1.0);
    }

    #[test]
    fn resting_joints_are_left_out_of_the_runs() {
        let mut feature = [0.0; 54];
        assert!(moving_features(&feature).is_empty());
        for n in [8, 9, 35, 53] {
            feature[n] = 0.1;
        }
        assert_eq!(moving_features(&feature), [0..18, 27..36, 45..54]);
    }

    #[test]
    fn pose_blend_is_the_plain_product() {
        let feature: Vec<f64> = (0..18).map(|n| if n < 9 { 0.0 } else { f64::from(n) }).collect();
        let posedirs: Vec<f64> = (0..54).map(|n| f64::from(n % 7) - 3.0).collect();
        let blended = pose_blend(vec![[1.0, 2.0, 3.0]], &posedirs, &feature);
        for axis in 0..3 {
            let sum: f64 = (0..18).map(|n| posedirs[18 * axis + n] * feature[n]).sum();
            assert_eq!(blended[0][axis], [1.0, 2.0, 3.0][axis] + sum);
        }
    }
}

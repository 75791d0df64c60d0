//! Errors of joint positions, metres (the field prints them in mm: times 1000). One pose; for many see
//! [`joint_errors`](super::joint_errors).

use super::procrustes::Similarity;
use crate::linalg::vector::{Vector3, distance, sub};

/// Distance of each estimated joint from the true one, metres. `J`
///
/// # Panics
///
/// If the two sets differ in size.
pub fn joint_errors(estimate: &[Vector3], truth: &[Vector3]) -> Vec<f64> {
    assert_eq!(
        estimate.len(),
        truth.len(),
        "joint errors: {} estimated joints against {} true ones",
        estimate.len(),
        truth.len()
    );
    estimate.iter().zip(truth).map(|(&estimate, &truth)| distance(estimate, truth)).collect()
}

/// Error = (1/J) Σ ‖J_gt − J_est‖, metres, without any alignment (Li 2021, eq. 2.7).
///
/// # Panics
///
/// If the two sets differ in size or are empty.
///
/// ```
/// use vitruvian_reference::metric::joints::mean_joint_error;
/// assert_eq!(mean_joint_error(&[[0.0; 3], [0.0, 3.0, 4.0]], &[[0.0; 3]; 2]), 2.5);
/// ```
pub fn mean_joint_error(estimate: &[Vector3], truth: &[Vector3]) -> f64 {
    mean(&joint_errors(estimate, truth))
}

/// Joints seen from one of them, the root. `J`
///
/// # Panics
///
/// If there is no joint `root`.
pub fn root_relative(joints: &[Vector3], root: usize) -> Vec<Vector3> {
    assert!(root < joints.len(), "root-relative joints: root {root} of {} joints", joints.len());
    joints.iter().map(|&joint| sub(joint, joints[root])).collect()
}

/// Mean per-joint position error, metres: eq. 2.7 after both sets are moved so that their roots coincide.
///
/// # Panics
///
/// If the two sets differ in size, or there is no joint `root`.
pub fn mpjpe(estimate: &[Vector3], truth: &[Vector3], root: usize) -> f64 {
    mean_joint_error(&root_relative(estimate, root), &root_relative(truth, root))
}

/// The estimate brought as close to the truth as rotation, translation and scale can. `J`
///
/// # Panics
///
/// If the two sets differ in size or are empty.
pub fn procrustes_aligned(estimate: &[Vector3], truth: &[Vector3]) -> Vec<Vector3> {
    let similarity = Similarity::aligning(estimate, truth);
    estimate.iter().map(|&joint| similarity.apply(joint)).collect()
}

/// MPJPE after Procrustes alignment ("reconstruction error"), metres: eq. 2.7 of [`procrustes_aligned`].
///
/// The alignment minimises the *sum of squares*, so for a single pose this mean may exceed [`mpjpe`], rarely.
///
/// # Panics
///
/// If the two sets differ in size or are empty.
pub fn pa_mpjpe(estimate: &[Vector3], truth: &[Vector3]) -> f64 {
    mean_joint_error(&procrustes_aligned(estimate, truth), truth)
}

fn mean(errors: &[f64]) -> f64 {
    assert!(!errors.is_empty(), "mean error of no joints");
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: [Vector3; 4] = [[0.0, 1.0, 0.0], [0.2, 0.5, 0.1], [-0.2, 0.5, 0.0], [0.0, 1.6, -0.1]];

    #[test]
    fn a_common_shift_is_an_error_only_without_alignment() {
        let moved = TRUTH.map(|[x, y, z]| [x + 0.3, y, z + 0.4]);
        assert!((mean_joint_error(&moved, &TRUTH) - 0.5).abs() < 1e-15);
        assert!(mpjpe(&moved, &TRUTH, 0) < 1e-15);
    }

    #[test]
    fn one_wrong_joint_of_four_counts_a_quarter() {
        let mut estimate = TRUTH;
        estimate[3][2] += 0.1;
        assert!((mpjpe(&estimate, &TRUTH, 0) - 0.025).abs() < 1e-15);
        // Relative to the wrong joint itself the three others are wrong.
        assert!((mpjpe(&estimate, &TRUTH, 3) - 0.075).abs() < 1e-15);
    }

    #[test]
    fn a_similar_pose_has_no_error_after_procrustes() {
        // Turned a quarter about y, halved, moved.
        let estimate = TRUTH.map(|[x, y, z]| [0.5 * z + 1.0, 0.5 * y, -0.5 * x + 2.0]);
        assert!(pa_mpjpe(&estimate, &TRUTH) < 1e-15);
    }

    #[test]
    fn a_mirrored_pose_keeps_an_error_after_procrustes() {
        let mirrored = TRUTH.map(|[x, y, z]| [-x, y, z]);
        assert!(pa_mpjpe(&mirrored, &TRUTH) > 0.01);
    }

    #[test]
    #[should_panic(expected = "3 estimated joints against 4 true ones")]
    fn sets_of_different_size_are_refused() {
        mean_joint_error(&TRUTH[..3], &TRUTH);
    }
}

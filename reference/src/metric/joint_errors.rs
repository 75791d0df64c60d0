//! The errors of J joints over F frames, and what tables say of them.

use super::joints::{joint_errors, procrustes_aligned};
use super::pck;
use crate::linalg::vector::Vector3;

/// The distance of every estimated joint from the true one, F×J, metres.
///
/// The same numbers serve every table: MPJPE is their [`mean`](JointErrors::mean), PCK and AUC count them. Which of the
/// variants they are — as they stand (Li 2021, eq. 2.7), relative to a root, or after Procrustes — is decided by what they
/// were made from.
///
/// ```
/// use vitruvian_reference::metric::joint_errors::JointErrors;
/// let truth = [vec![[0.0; 3], [0.0, 1.0, 0.0]]];
/// let estimate = [vec![[0.0; 3], [0.3, 1.0, 0.0]]];
/// let errors = JointErrors::between(&estimate, &truth);
/// assert_eq!((errors.mean(), errors.per_joint()), (0.15, vec![0.0, 0.3]));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointErrors {
    /// Frame by frame.
    errors: Vec<f64>,
    joint_count: usize,
}

impl JointErrors {
    /// e_fj = ‖estimate_fj − truth_fj‖.
    ///
    /// Root-relative errors are those between joints that were made relative to their roots before, with
    /// [`Root`](super::joint_set::Root).
    ///
    /// # Panics
    ///
    /// If there are no frames or joints, the two differ in the number of frames, or any two poses in that of joints.
    pub fn between(estimate: &[Vec<Vector3>], truth: &[Vec<Vector3>]) -> JointErrors {
        JointErrors::of_frames(estimate, truth, joint_errors)
    }

    /// The errors that remain after each frame's estimate is brought to the truth by the similarity of its own
    /// ([`procrustes_aligned`]); their mean is PA-MPJPE, the "reconstruction error".
    ///
    /// # Panics
    ///
    /// As [`JointErrors::between`].
    pub fn aligned(estimate: &[Vec<Vector3>], truth: &[Vec<Vector3>]) -> JointErrors {
        JointErrors::of_frames(estimate, truth, |estimate, truth| {
            joint_errors(&procrustes_aligned(estimate, truth), truth)
        })
    }

    fn of_frames(
        estimate: &[Vec<Vector3>],
        truth: &[Vec<Vector3>],
        errors: impl Fn(&[Vector3], &[Vector3]) -> Vec<f64>,
    ) -> JointErrors {
        let (frames, true_frames) = (estimate.len(), truth.len());
        assert_eq!(
            frames, true_frames,
            "joint errors: {frames} estimated frames against {true_frames} true ones"
        );
        let joint_count = truth.first().map_or(0, Vec::len);
        assert!(joint_count > 0, "joint errors: {frames} frames of {joint_count} joints");
        let of_frame = |(estimate, truth): (&Vec<Vector3>, &Vec<Vector3>)| {
            assert_eq!(truth.len(), joint_count, "joint errors: frames of different numbers of joints");
            errors(estimate, truth)
        };
        JointErrors { errors: estimate.iter().zip(truth).flat_map(of_frame).collect(), joint_count }
    }

    /// The errors of several evaluations together, their frames one after the other.
    ///
    /// # Panics
    ///
    /// If there are none, or they differ in the number of joints.
    pub fn concatenated(all: &[JointErrors]) -> JointErrors {
        assert!(!all.is_empty(), "joint errors: nothing to put together");
        let joint_count = all[0].joint_count;
        for one in all {
            let other = one.joint_count;
            assert_eq!(joint_count, other, "joint errors: {joint_count} joints cannot go with {other}");
        }
        JointErrors { errors: all.iter().flat_map(|one| &one.errors).copied().collect(), joint_count }
    }

    /// All errors, F·J, frame by frame.
    pub fn all(&self) -> &[f64] {
        &self.errors
    }

    /// F.
    pub fn frame_count(&self) -> usize {
        self.errors.len() / self.joint_count
    }

    /// J.
    pub fn joint_count(&self) -> usize {
        self.joint_count
    }

    /// The mean over joints and frames, metres.
    pub fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len() as f64
    }

    /// The mean over joints of each frame, metres. `F`
    pub fn per_frame(&self) -> Vec<f64> {
        let mean = |frame: &[f64]| frame.iter().sum::<f64>() / self.joint_count as f64;
        self.errors.chunks_exact(self.joint_count).map(mean).collect()
    }

    /// The mean over frames of each joint, metres. `J`
    pub fn per_joint(&self) -> Vec<f64> {
        (0..self.joint_count)
            .map(|j| self.of_joint(j).iter().sum::<f64>() / self.frame_count() as f64)
            .collect()
    }

    /// The errors of one joint over the frames, metres. `F`
    ///
    /// # Panics
    ///
    /// If there is no joint `j`.
    pub fn of_joint(&self, j: usize) -> Vec<f64> {
        assert!(j < self.joint_count, "joint errors: joint {j} of {}", self.joint_count);
        self.errors.iter().skip(j).step_by(self.joint_count).copied().collect()
    }

    /// [`pck`](pck::pck) of all errors at `threshold_m`, in 0 … 100.
    pub fn pck(&self, threshold_m: f64) -> f64 {
        pck::pck(&self.errors, threshold_m)
    }

    /// [`pck_curve`](pck::pck_curve) of all errors.
    pub fn pck_curve(&self) -> [f64; pck::THRESHOLD_COUNT] {
        pck::pck_curve(&self.errors)
    }

    /// [`auc`](pck::auc) of all errors, in 0 … 100.
    pub fn auc(&self) -> f64 {
        pck::auc(&self.errors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::joints::{mean_joint_error, pa_mpjpe};

    fn frames() -> (Vec<Vec<Vector3>>, Vec<Vec<Vector3>>) {
        let truth: Vec<Vec<Vector3>> = vec![
            vec![[0.0, 1.0, 0.0], [0.2, 0.5, 0.1], [-0.2, 0.5, 0.0]],
            vec![[0.0; 3], [1.0; 3], [0.0, 2.0, 1.0]],
        ];
        let mut estimate = truth.clone();
        estimate[0][1][0] += 0.3;
        estimate[1][1][2] -= 0.1;
        estimate[1][2][1] += 0.2;
        (estimate, truth)
    }

    #[test]
    fn means_are_over_frames_and_over_joints() {
        let (estimate, truth) = frames();
        let errors = JointErrors::between(&estimate, &truth);
        assert_eq!((errors.frame_count(), errors.joint_count()), (2, 3));
        let near = |found: &[f64], expected: &[f64]| {
            found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15)
        };
        assert!(near(errors.all(), &[0.0, 0.3, 0.0, 0.0, 0.1, 0.2]));
        assert!(near(&errors.per_joint(), &[0.0, 0.2, 0.1]));
        assert!(near(&errors.per_frame(), &[0.1, 0.1]));
        assert!(near(&errors.of_joint(1), &[0.3, 0.1]));
        assert!((errors.mean() - 0.1).abs() < 1e-15);
        assert_eq!(errors.pck(0.15), 100.0 * 4.0 / 6.0);
    }

    #[test]
    fn each_frame_is_aligned_by_itself() {
        let (estimate, truth) = frames();
        let errors = JointErrors::aligned(&estimate, &truth);
        for frame in 0..2 {
            let alone = pa_mpjpe(&estimate[frame], &truth[frame]);
            assert!((errors.per_frame()[frame] - alone).abs() < 1e-15);
        }
    }

    #[test]
    fn errors_put_together_are_those_of_all_frames() {
        let (estimate, truth) = frames();
        let each: Vec<JointErrors> =
            (0..2).map(|f| JointErrors::between(&estimate[f..=f], &truth[f..=f])).collect();
        assert_eq!(each[1].mean(), mean_joint_error(&estimate[1], &truth[1]));
        assert_eq!(JointErrors::concatenated(&each), JointErrors::between(&estimate, &truth));
    }

    #[test]
    #[should_panic(expected = "1 estimated frames against 2 true ones")]
    fn sequences_of_different_length_are_refused() {
        let (estimate, truth) = frames();
        JointErrors::between(&estimate[..1], &truth);
    }

    #[test]
    #[should_panic(expected = "2 estimated joints against 3 true ones")]
    fn poses_of_different_size_are_refused() {
        let (mut estimate, truth) = frames();
        estimate[1].pop();
        JointErrors::between(&estimate, &truth);
    }
}

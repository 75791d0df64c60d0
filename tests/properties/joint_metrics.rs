//! Laws of the errors of joints: what alignment takes away and what it leaves, and how the figures of a table hang together.

use proptest::prelude::*;
use vitruvian_reference::linalg::matrix::apply;
use vitruvian_reference::linalg::vector::{Vector3, add, scale, sub};
use vitruvian_reference::metric::joint_errors::JointErrors;
use vitruvian_reference::metric::joint_set::{JointSet, Root};
use vitruvian_reference::metric::pck::{PCK_THRESHOLD_M, THRESHOLD_COUNT};
use vitruvian_reference::rotation::rodrigues;

fn point() -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-1.0..1.0f64)
}

/// True poses and estimates some decimetres away: 2 to 6 frames of 8 joints.
fn sequences() -> impl Strategy<Value = (Vec<Vec<Vector3>>, Vec<Vec<Vector3>>)> {
    let pose = || prop::collection::vec((point(), prop::array::uniform3(-0.2..0.2f64)), 8);
    prop::collection::vec(pose(), 2..6).prop_map(|frames| {
        let estimate = |&(truth, away): &(Vector3, Vector3)| add(truth, away);
        let of = |each: &dyn Fn(&(Vector3, Vector3)) -> Vector3| -> Vec<Vec<Vector3>> {
            frames.iter().map(|pose| pose.iter().map(each).collect()).collect()
        };
        (of(&estimate), of(&|pair| pair.0))
    })
}

fn map(frames: &[Vec<Vector3>], each: impl Fn(Vector3) -> Vector3) -> Vec<Vec<Vector3>> {
    frames.iter().map(|pose| pose.iter().map(|&joint| each(joint)).collect()).collect()
}

fn sum_of_squares(errors: &JointErrors) -> f64 {
    errors.all().iter().map(|e| e * e).sum()
}

proptest! {
    #[test]
    fn a_similarity_of_the_estimate_changes_no_aligned_error(
        (estimate, truth) in sequences(), turn in prop::array::uniform3(-2.0..2.0f64), size in 0.2..5.0f64, shift in point(),
    ) {
        let rotation = rodrigues(turn);
        let moved = map(&estimate, |joint| add(scale(apply(&rotation, joint), size), shift));
        let (a, b) = (JointErrors::aligned(&estimate, &truth), JointErrors::aligned(&moved, &truth));
        for (a, b) in a.all().iter().zip(b.all()) {
            prop_assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn a_mirror_image_is_not_aligned_away((_, truth) in sequences()) {
        let mirrored = map(&truth, |[x, y, z]| [-x, y, z]);
        prop_assert!(JointErrors::aligned(&truth, &truth).mean() < 1e-14);
        // Eight random points are far from flat, where alone a mirror image is a rotation.
        prop_assert!(JointErrors::aligned(&mirrored, &truth).per_frame().iter().all(|&error| error > 1e-3));
    }

    #[test]
    fn alignment_never_adds_to_the_sum_of_squares((estimate, truth) in sequences()) {
        let raw = JointErrors::between(&estimate, &truth);
        prop_assert!(sum_of_squares(&JointErrors::aligned(&estimate, &truth)) <= sum_of_squares(&raw) + 1e-12);
    }

    #[test]
    fn root_relative_errors_do_not_know_where_a_body_stands((estimate, truth) in sequences(), shift in point()) {
        let all: Vec<usize> = (0..8).collect();
        for root in [Root::Joint(3), Root::Middle(1, 2)] {
            let relative = |frames: &[Vec<Vector3>]| -> Vec<Vec<Vector3>> {
                frames.iter().map(|pose| root.relative(pose, &all)).collect()
            };
            let moved = map(&estimate, |joint| sub(joint, shift));
            let here = JointErrors::between(&relative(&estimate), &relative(&truth));
            let there = JointErrors::between(&relative(&moved), &relative(&truth));
            prop_assert!((here.mean() - there.mean()).abs() < 1e-14);
        }
    }

    #[test]
    fn means_per_joint_and_per_frame_average_to_the_total((estimate, truth) in sequences()) {
        let errors = JointErrors::between(&estimate, &truth);
        for parts in [errors.per_joint(), errors.per_frame()] {
            let mean = parts.iter().sum::<f64>() / parts.len() as f64;
            prop_assert!((mean - errors.mean()).abs() < 1e-15);
        }
    }

    #[test]
    fn the_pck_curve_never_falls_and_its_area_is_bounded((estimate, truth) in sequences(), more in 0.0..0.5f64) {
        let errors = JointErrors::between(&estimate, &truth);
        let curve = errors.pck_curve();
        prop_assert_eq!(curve[0], 0.0);
        prop_assert_eq!(curve[THRESHOLD_COUNT - 1], errors.pck(PCK_THRESHOLD_M));
        prop_assert!(curve.windows(2).all(|pair| pair[0] <= pair[1]));
        prop_assert!(errors.auc() <= 100.0 * 30.0 / 31.0 * errors.pck(PCK_THRESHOLD_M) / 100.0 + 1e-12);
        prop_assert!(errors.pck(more) <= errors.pck(more + 0.1));
    }

    #[test]
    fn the_order_of_frames_does_not_matter((mut estimate, mut truth) in sequences()) {
        let figures = |errors: &JointErrors| {
            [errors.mean(), errors.pck(0.1), errors.auc(), errors.per_joint()[5]]
        };
        let before = [JointErrors::between(&estimate, &truth), JointErrors::aligned(&estimate, &truth)];
        estimate.rotate_left(1);
        truth.rotate_left(1);
        estimate.swap(0, 1);
        truth.swap(0, 1);
        let after = [JointErrors::between(&estimate, &truth), JointErrors::aligned(&estimate, &truth)];
        for (before, after) in before.iter().zip(&after) {
            for (a, b) in figures(before).iter().zip(figures(after)) {
                prop_assert!((a - b).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    #[test]
    fn a_joint_keeps_its_error_in_whatever_order_a_file_has_it(
        estimate in prop::collection::vec(point(), 24), truth in prop::collection::vec(point(), 24),
    ) {
        let in_order = |set: JointSet, pose: &[Vector3]| -> Vec<Vector3> {
            let chosen = JointSet::J24.indices_of(set).expect("J24 has them all");
            chosen.iter().map(|&j| pose[j]).collect()
        };
        let by_name = |a: JointSet, b: JointSet| {
            let (estimate, truth) = (in_order(a, &estimate), in_order(b, &truth));
            let mut named: Vec<(&str, f64)> = a
                .shared(b)
                .into_iter()
                .map(|(i, j)| {
                    let error = JointErrors::between(&[vec![estimate[i]]], &[vec![truth[j]]]);
                    (a.joint_names()[i], error.mean())
                })
                .collect();
            named.sort_by_key(|&(name, _)| name);
            named
        };
        let expected = by_name(JointSet::J17, JointSet::J17);
        for a in [JointSet::H36m17, JointSet::Mpi17, JointSet::J17] {
            for b in [JointSet::H36m17, JointSet::Mpi17, JointSet::J17] {
                prop_assert_eq!(&by_name(a, b), &expected);
            }
        }
    }
}

//! Bodies of other sizes than SMPL's: from a file, through the reader, to a pose.

use crate::bodies::turn;
use crate::plain_body::plain_pose;
use proptest::prelude::*;
use vitruvian_conformance::convert::body_to_reference;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::linalg::vector::{Vector3, distance};
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{Named, write};

/// Pelvis to wrists, as in SMPL.
const BODY: [i64; 22] = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19];

/// Five fingers of three joints at each wrist, the first of them numbered `next`.
fn hands(next: i64) -> impl Iterator<Item = i64> {
    [20, 21].into_iter().enumerate().flat_map(move |(hand, wrist)| {
        (0..15).map(move |n| if n % 3 == 0 { wrist } else { next + 15 * hand as i64 + n - 1 })
    })
}

/// (name, parents, betas): SMPL with a hand joint at each wrist, SMPL-H, and SMPL-X with jaw and eyes.
fn layouts() -> [(&'static str, Vec<i64>, usize); 3] {
    let body = || BODY.into_iter();
    [
        ("SMPL", body().chain([20, 21]).collect(), 300),
        ("SMPL-H", body().chain(hands(22)).collect(), 16),
        ("SMPL-X", body().chain([15, 15, 15]).chain(hands(25)).collect(), 400),
    ]
}

/// Numbers without a pattern, between −1 and 1.
fn noise(count: usize, seed: f64) -> Vec<f64> {
    (0..count).map(|n| (1e4 * (seed + n as f64).sin()).fract()).collect()
}

/// Rows of non-negative numbers that sum to 1.
fn shares(rows: usize, columns: usize, seed: f64) -> Vec<f64> {
    let mut all: Vec<f64> = noise(rows * columns, seed).iter().map(|x| (x - 0.6).max(0.0)).collect();
    for (r, row) in all.chunks_exact_mut(columns).enumerate() {
        row[r % columns] += 0.1;
        let sum: f64 = row.iter().sum();
        row.iter_mut().for_each(|x| *x /= sum);
    }
    all
}

/// A body of 90 vertices in one of the layouts, written as the official files are and read back.
fn body(parents: &[i64], betas: usize, unsigned_root: bool) -> BodyModel {
    let (v, j) = (90, parents.len());
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("body.npz");
    let root = if unsigned_root { i64::from(u32::MAX) } else { -1 };
    let tree: Vec<i64> = parents.iter().map(|&p| if p < 0 { root } else { p }).chain(0..j as i64).collect();
    let faces: Vec<u32> = (0..v as u32).collect();
    let (face_shape, tree_shape) = ([v / 3, 3], [2, j]);
    let scaled = |x: Vec<f64>, s: f64| -> Vec<f64> { x.iter().map(|x| s * x).collect() };
    let numbers = [
        ("v_template", vec![v, 3], noise(3 * v, 1.0)),
        ("shapedirs", vec![v, 3, betas], scaled(noise(3 * v * betas, 2.0), 0.02)),
        ("posedirs", vec![v, 3, 9 * (j - 1)], scaled(noise(27 * v * (j - 1), 3.0), 0.01)),
        ("J_regressor", vec![j, v], shares(j, v, 4.0)),
        ("weights", vec![v, j], shares(v, j, 5.0)),
        // More than a body needs: left alone.
        ("hands_meanl", vec![45], noise(45, 6.0)),
    ];
    let mut arrays: Vec<Named<'_>> = numbers
        .iter()
        .map(|(name, shape, values)| Named { name, shape, values: Values::F64(values) })
        .collect();
    arrays.push(Named { name: "f", shape: &face_shape, values: Values::U32(&faces) });
    arrays.push(Named { name: "kintree_table", shape: &tree_shape, values: Values::I64(&tree) });
    write(&path, &arrays).expect("written");
    body_to_reference(vitruvian_runtime::file::body::read(&path).expect("a body model"))
}

#[test]
fn trees_of_hands_and_faces_have_their_parents_before_them() {
    let [_, (_, smplh, _), (_, smplx, _)] = layouts();
    assert_eq!((smplh.len(), smplx.len()), (52, 55));
    // SMPL-H's last joint is the tip of the right thumb, SMPL-X's too; both hang on two more and a wrist.
    assert_eq!((smplh[51], smplh[50], smplh[49]), (50, 49, 21));
    assert_eq!((smplx[54], smplx[53], smplx[52]), (53, 52, 21));
    assert_eq!((smplh[22], smplh[37], smplx[25], smplx[40]), (20, 21, 20, 21));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn bodies_of_every_layout_are_read_and_posed(
        turns in prop::collection::vec(turn(), 55),
        betas in prop::collection::vec(-2.0..2.0f64, 400),
        trans in prop::array::uniform3(-3.0..3.0f64),
        unsigned_root: bool,
    ) {
        for (name, parents, beta_count) in layouts() {
            let body = body(&parents, beta_count, unsigned_root);
            prop_assert_eq!((body.joint_count(), body.beta_count()), (parents.len(), beta_count));
            let (pose, betas) = (turns[..parents.len()].concat(), &betas[..beta_count]);
            let (posed, plain) = (body.pose(&pose, betas, trans), plain_pose(&body, &pose, betas, trans));
            let furthest = |a: &[Vector3], b: &[Vector3]| {
                a.iter().zip(b).map(|(a, b)| distance(*a, *b)).fold(0.0, f64::max)
            };
            prop_assert!(furthest(&posed.vertices, &plain.vertices) < 1e-13, "{name}");
            prop_assert!(furthest(&posed.joints, &plain.joints) < 1e-13, "{name}");
            let joints = body.skeleton().posed_joints(&pose, betas);
            let world: Vec<Vector3> = joints.iter().map(|p| std::array::from_fn(|a| p[a] + trans[a])).collect();
            prop_assert!(furthest(&posed.joints, &world) < 1e-13, "{name}");
            // The first ten betas alone, as fits take them: derivatives have ten columns.
            let d = body.skeleton().joint_derivatives(&pose, &betas[..10]);
            prop_assert_eq!((d.by_pose.rows(), d.by_pose.columns()), (pose.len(), pose.len()));
            prop_assert_eq!(d.by_betas.columns(), 10);
        }
    }
}

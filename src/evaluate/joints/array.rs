//! Joints as arrays of numbers, under the names and in the shapes that others write them.

use std::path::{Path, PathBuf};

use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_reference::metric::joint_set::JointSet;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npy::{self, Array};
use vitruvian_runtime::file::npz::Npz;

use super::arguments::word;
use crate::failure::Result;

/// Which of the two a file is; one file may hold both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// What is judged.
    Predicted,
    /// What it is judged by.
    Truth,
}

/// Names of predicted joints, of true ones, and of either.
const PREDICTED: [&str; 3] = ["pred_joints", "pred_keypoints_3d", "pred_joints3d"];
const TRUTH: [&str; 4] = ["gt_joints", "gt_keypoints_3d", "gt_joints3d", "S"];
const EITHER: [&str; 6] = ["joints", "joints3d", "joints_3d", "keypoints_3d", "pose_3d", "jointPositions"];

/// No body spans so much: the numbers are millimetres.
const WIDEST_BODY_M: f64 = 20.0;

/// The joints of F ≥ 1 frames, metres.
pub struct Sequence {
    /// The file.
    pub path: PathBuf,
    /// F frames of J joints.
    pub frames: Vec<Vec<Vector3>>,
    /// Their order, if it is a known one.
    pub set: Option<JointSet>,
    /// Whether each joint is there in every frame.
    pub is_there: Vec<bool>,
}

impl Sequence {
    /// A sequence without gaps, in the order that its number of joints suggests.
    pub fn new(path: &Path, frames: Vec<Vec<Vector3>>) -> Sequence {
        let joints = frames.first().map_or(0, Vec::len);
        Sequence { path: path.to_owned(), frames, set: usual_set(joints), is_there: vec![true; joints] }
    }

    /// J.
    pub fn joint_count(&self) -> usize {
        self.is_there.len()
    }

    /// The same, in the order that the user says it has.
    pub fn named(mut self, given: Option<JointSet>) -> Result<Sequence> {
        let Some(set) = given else { return Ok(self) };
        if set.count() != self.joint_count() {
            let message = format!("holds {} joints; {} has {}", self.joint_count(), word(set), set.count());
            return Err(Error::file(&self.path, message).into());
        }
        self.set = Some(set);
        Ok(self)
    }
}

/// The order that most files of so many joints have.
fn usual_set(joints: usize) -> Option<JointSet> {
    [JointSet::Smpl24, JointSet::Smpl22, JointSet::H36m17, JointSet::Lsp14, JointSet::Spin49]
        .into_iter()
        .find(|set| set.count() == joints)
}

/// Whether a file's name is one that joints or parameters may have.
pub fn is_readable(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz") || e.eq_ignore_ascii_case("npy"))
}

/// The joints of a .npy or .npz; `None` if the .npz has no array of joints.
pub fn read(path: &Path, side: Side) -> Result<Option<Sequence>> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        return Ok(Some(sequence(path, "the array", &npy::read(path)?)?));
    }
    let mut npz = Npz::open(path)?;
    let (own, other): (&[&str], &[&str]) = match side {
        Side::Predicted => (&PREDICTED, &TRUTH),
        Side::Truth => (&TRUTH, &PREDICTED),
    };
    let Some(name) = own.iter().chain(&EITHER).chain(other).find(|name| npz.contains(name)) else {
        return Ok(None);
    };
    Ok(Some(sequence(path, &format!("array \"{name}\""), &npz.array(name)?)?))
}

/// The joints of an array \[J,3\], \[F,J,3\], \[F,3J\] or \[1,F,3J\]; with a fourth column, the confidence, SPIN's J24 if they
/// are 24.
fn sequence(path: &Path, name: &str, array: &Array<f64>) -> Result<Sequence> {
    let fail = |message: String| Error::file(path, format!("{name} {message}"));
    let (joints, columns) = match array.shape[..] {
        [j, c @ (3 | 4)] | [_, j, c @ (3 | 4)] => (j, c),
        [n] | [_, n] | [1, _, n] if n % 3 == 0 => (n / 3, 3),
        _ => {
            let message = format!(
                "has the shape {:?}, expected [F, J, 3], [J, 3] or [F, 3J], or [F, J, 4] with confidences",
                array.shape
            );
            return Err(fail(message).into());
        }
    };
    if array.values.is_empty() {
        return Err(fail(format!("holds no joints (its shape is {:?})", array.shape)).into());
    }
    let rows: Vec<&[f64]> = array.values.chunks_exact(columns).collect();
    let is_seen = |row: &[f64]| columns == 3 || row[3] > 0.0;
    for (i, row) in rows.iter().enumerate() {
        let fault = if is_seen(row) { row.iter().find(|x| !x.is_finite()) } else { None };
        if let Some(x) = fault {
            let message =
                format!("holds {x} (frame {}, joint {}); expected finite numbers", i / joints, i % joints);
            return Err(fail(message).into());
        }
    }
    let is_there = (0..joints).map(|j| rows.iter().skip(j).step_by(joints).all(|row| is_seen(row))).collect();
    let span = |frame: &[&[f64]]| {
        let range = |axis: usize| {
            let values = frame.iter().filter(|row| is_seen(row)).map(|row| row[axis]);
            let (low, high) =
                values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            high - low
        };
        range(0).max(range(1)).max(range(2))
    };
    let narrowest = rows.chunks_exact(joints).map(span).fold(f64::INFINITY, f64::min);
    if narrowest > WIDEST_BODY_M {
        let message =
            format!("holds joints that span {narrowest:.0}; expected metres: divide millimetres by 1000");
        return Err(fail(message).into());
    }
    let frames =
        rows.chunks_exact(joints).map(|frame| frame.iter().map(|r| [r[0], r[1], r[2]]).collect()).collect();
    let is_j24 = columns == 4 && joints == JointSet::J24.count();
    let set = if is_j24 { Some(JointSet::J24) } else { usual_set(joints) };
    Ok(Sequence { path: path.to_owned(), frames, set, is_there })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(shape: &[usize]) -> Array<f64> {
        let values = (0..shape.iter().product()).map(|i| 0.01 * i as f64).collect();
        Array { shape: shape.to_vec(), values }
    }

    fn read(array: &Array<f64>) -> std::result::Result<Sequence, String> {
        sequence(Path::new("a.npz"), "array \"S\"", array).map_err(|failure| failure.to_string())
    }

    #[test]
    fn every_accepted_shape_has_its_frames_and_joints() {
        let cases: [(&[usize], usize, Option<JointSet>); 7] = [
            (&[24, 3], 1, Some(JointSet::Smpl24)),
            (&[2, 17, 3], 2, Some(JointSet::H36m17)),
            (&[5, 72], 5, Some(JointSet::Smpl24)),
            (&[72], 1, Some(JointSet::Smpl24)),
            (&[1, 3, 72], 3, Some(JointSet::Smpl24)),
            (&[2, 14, 3], 2, Some(JointSet::Lsp14)),
            (&[2, 7, 3], 2, None),
        ];
        for (shape, frames, set) in cases {
            let found = read(&array(shape)).unwrap_or_else(|why| panic!("{shape:?}: {why}"));
            assert_eq!((found.frames.len(), found.set), (frames, set), "{shape:?}");
            assert_eq!(found.frames[0][1], [0.03, 0.04, 0.05]);
        }
        for shape in [&[2][..], &[], &[2, 72, 3, 1], &[2, 5, 72], &[0, 24, 3], &[2, 0, 3]] {
            assert!(read(&array(shape)).is_err(), "{shape:?}");
        }
    }

    #[test]
    fn joints_without_confidence_are_not_there_and_may_be_anything() {
        let mut given = array(&[2, 24, 4]);
        for (i, row) in given.values.chunks_exact_mut(4).enumerate() {
            row[3] = if i % 24 == 13 { 0.0 } else { 1.0 };
        }
        given.values[4 * 13] = f64::NAN;
        let found = read(&given).unwrap_or_else(|why| panic!("{why}"));
        assert_eq!(found.set, Some(JointSet::J24));
        assert_eq!(found.is_there.iter().position(|there| !there), Some(13));
        given.values[4 * 24] = f64::NAN;
        assert!(read(&given).err().is_some_and(|why| why.contains("NaN (frame 1, joint 0)")));
    }

    #[test]
    fn millimetres_are_refused() {
        let mut given = array(&[2, 24, 3]);
        given.values.iter_mut().for_each(|x| *x *= 1000.0);
        let refusal = read(&given).err().unwrap_or_default();
        assert!(
            refusal.contains("array \"S\" holds joints that span 690") && refusal.contains("1000"),
            "{refusal}"
        );
    }

    #[test]
    fn an_order_of_another_number_of_joints_is_refused() {
        let sequence = || Sequence::new(Path::new("a.npz"), vec![vec![[0.0; 3]; 17]]);
        assert_eq!(sequence().named(Some(JointSet::Mpi17)).ok().and_then(|s| s.set), Some(JointSet::Mpi17));
        let refusal = sequence().named(Some(JointSet::Lsp14)).err().map(|failure| failure.to_string());
        assert_eq!(refusal.as_deref(), Some("a.npz: holds 17 joints; lsp14 has 14"));
    }
}

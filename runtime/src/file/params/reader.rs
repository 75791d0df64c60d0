//! The arrays of a body's parameters under their many names and shapes, each checked before it is believed.

use std::path::Path;

use super::{Counts, View};
use crate::capture::Extrinsics;
use crate::error::{Error, Result};
use crate::file::npy::Array;
use crate::file::npz::Npz;

/// What a pose in parts is joined from: in this order, the first name of a group that is there.
const PARTS: [&[&str]; 8] = [
    &["global_orient", "root_orient"],
    &["body_pose", "pose_body"],
    &["jaw_pose", "pose_jaw"],
    &["leye_pose"],
    &["reye_pose", "pose_eye"],
    &["left_hand_pose"],
    &["right_hand_pose"],
    &["pose_hand"],
];

/// What a pose array may be called.
const POSES: [&str; 4] = ["poses", "pose", "fullpose", "pred_pose"];

/// What an array of betas may be called.
pub(super) const BETAS: [&str; 4] = ["betas", "shape", "pred_betas", "pred_shape"];

/// HMR's camera, pose and betas in one row.
pub(super) const THETA: [usize; 3] = [3, 72, 10];

/// The numbers of the 22 joints that SMPL, SMPL-H and SMPL-X share.
const SHARED_WIDTH: usize = 66;

/// Says whether an array has a shape that can be used, or what was expected.
type ShapeCheck<'a> = &'a dyn Fn(&Array<f64>) -> std::result::Result<(), String>;

pub(super) struct Reader {
    npz: Npz,
    /// Whether what does not move a joint may be left away.
    for_joints: bool,
    /// What was, a sentence each.
    left_away: Vec<String>,
}

impl Reader {
    /// Opens a file; `for_joints` says whether what does not move a joint may be left away.
    pub fn open(path: &Path, for_joints: bool) -> Result<Self> {
        Ok(Self { npz: Npz::open(path)?, for_joints, left_away: Vec::new() })
    }

    /// What was left away, a sentence each.
    pub fn left_away(self) -> Vec<String> {
        self.left_away
    }

    pub fn first_of(&self, names: &[&'static str]) -> Option<&'static str> {
        names.iter().copied().find(|name| self.npz.contains(name))
    }

    fn fail(&self, name: &str, message: &str) -> Error {
        Error::file(self.npz.path(), format!("array \"{name}\" {message}"))
    }

    /// An array of the right shape whose numbers are all finite.
    pub fn finite(&mut self, name: &str, check: ShapeCheck<'_>) -> Result<Array<f64>> {
        let array = self.npz.array::<f64>(name)?;
        check(&array).map_err(|message| self.fail(name, &message))?;
        if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
            let message = format!("holds {} (element {i}); every number must be finite", array.values[i]);
            return Err(self.fail(name, &message));
        }
        Ok(array)
    }

    pub fn poses(&mut self, counts: &Counts) -> Result<Vec<Vec<f64>>> {
        let (joints, width) = (counts.joints, 3 * counts.joints);
        if let Some(name) = self.first_of(&POSES) {
            let for_joints = self.for_joints;
            let array = self.finite(name, &|array| match array.shape[..] {
                [n] | [_, n] if for_joints && is_shared(n, joints) => Ok(()),
                _ => pose_shape(&array.shape, joints),
            })?;
            if array.values.is_empty() {
                return Err(self.fail(name, "holds no frames"));
            }
            if let [n] | [_, n] = array.shape[..]
                && for_joints
                && is_shared(n, joints)
            {
                return Ok(self.shared(name, array.values.chunks_exact(n), n));
            }
            return Ok(array.values.chunks_exact(width).map(<[f64]>::to_vec).collect());
        }
        if self.has_theta() {
            if joints != SMPL_JOINTS {
                let message =
                    format!("holds poses of SMPL's 24 joints; the body has {joints}: give a 24-joint body");
                return Err(self.fail("theta", &message));
            }
            let pose = |row: Vec<f64>| row[THETA[0]..THETA[0] + THETA[1]].to_vec();
            return Ok(self.theta()?.into_iter().map(pose).collect());
        }
        let mut parts = Vec::new();
        for names in PARTS {
            if let Some(name) = self.first_of(names) {
                parts.push((name, self.finite(name, &|array| part_shape(&array.shape))?));
            }
        }
        let Some((first, root)) = parts.first().filter(|(name, _)| PARTS[0].contains(name)) else {
            let message = format!(
                "array \"poses\" is missing (as are pose, fullpose, global_orient and root_orient); the file holds {}",
                self.npz.names().join(", ")
            );
            return Err(Error::file(self.npz.path(), message));
        };
        let frames_of = |part: &Array<f64>| if part.shape.len() == 1 { 1 } else { part.shape[0] };
        let frames = frames_of(root);
        let mut poses = vec![Vec::with_capacity(width); frames];
        for (name, part) in &parts {
            if part.values.is_empty() || frames_of(part) != frames {
                let message = format!("has the shape {:?}, but \"{first}\" has {:?}", part.shape, root.shape);
                return Err(self.fail(name, &message));
            }
            let rows = part.values.chunks_exact(part.values.len() / frames);
            poses.iter_mut().zip(rows).for_each(|(pose, row)| pose.extend(row));
        }
        if self.for_joints && is_shared(poses[0].len(), joints) {
            let wide = poses[0].len();
            return Ok(self.shared(first, poses.iter().map(Vec::as_slice), wide));
        }
        if poses[0].len() != width {
            let names: Vec<String> =
                parts.iter().map(|(name, part)| format!("{name} {:?}", part.shape)).collect();
            let message = format!(
                "its parts of the pose ({}) make {} numbers a frame; the body has {joints} joints and takes {width}{}",
                names.join(", "),
                poses[0].len(),
                hint(poses[0].len(), joints)
            );
            return Err(Error::file(self.npz.path(), message));
        }
        Ok(poses)
    }

    /// SMPL's 24 joints from a pose of which the first 22 are the same, hands at rest.
    fn shared<'a>(
        &mut self,
        name: &str,
        rows: impl Iterator<Item = &'a [f64]>,
        width: usize,
    ) -> Vec<Vec<f64>> {
        if width > 3 * SMPL_JOINTS {
            let path = self.npz.path().display();
            self.left_away.push(format!(
                "{path}: array \"{name}\" has {} joints; of them the 22 that the body shares are used",
                width / 3
            ));
        }
        rows.map(|row| [&row[..SHARED_WIDTH], &[0.0; 3 * SMPL_JOINTS - SHARED_WIDTH]].concat()).collect()
    }

    pub fn has_theta(&self) -> bool {
        self.npz.contains("theta") && self.first_of(&POSES).is_none()
    }

    /// The rows of theta: camera, pose, betas.
    pub fn theta(&mut self) -> Result<Vec<Vec<f64>>> {
        let width = THETA.iter().sum();
        let array = self.finite("theta", &|array| match array.shape[..] {
            [n] | [_, n] if n == width => Ok(()),
            _ => Err(format!(
                "has the shape {:?}, expected [F, {width}]: camera (3), pose (72), betas (10)",
                array.shape
            )),
        })?;
        if array.values.is_empty() {
            return Err(self.fail("theta", "holds no frames"));
        }
        Ok(array.values.chunks_exact(width).map(<[f64]>::to_vec).collect())
    }

    pub fn betas(&mut self, name: &'static str, frames: usize, most: usize) -> Result<Vec<Vec<f64>>> {
        let array = self.finite(name, &|array| match array.shape[..] {
            [_] | [1, _] => Ok(()),
            [f, _] if f == frames => Ok(()),
            _ => Err(format!(
                "has the shape {:?}, expected [B] or [{frames}, B] with B at most {most}",
                array.shape
            )),
        })?;
        let columns = array.shape.last().copied().unwrap_or(0);
        if columns == 0 {
            return Ok(vec![Vec::new()]);
        }
        self.fitting(name, array.values.chunks_exact(columns).map(<[f64]>::to_vec).collect(), most)
    }

    /// The rows of betas, at most `most` in each; more are left away where joints are all that is wanted.
    pub fn fitting(&mut self, name: &str, mut rows: Vec<Vec<f64>>, most: usize) -> Result<Vec<Vec<f64>>> {
        let columns = rows.first().map_or(0, Vec::len);
        if columns > most && !self.for_joints {
            let message =
                format!("has {columns} numbers; the body has {most} betas: keep {name}[..., :{most}]");
            return Err(self.fail(name, &message));
        }
        if rows.iter().any(|row| row.iter().skip(most).any(|&beta| beta != 0.0)) {
            self.left_away.push(format!(
                "{}: array \"{name}\" has {columns} numbers; of them the {most} that the body has are used",
                self.npz.path().display()
            ));
        }
        rows.iter_mut().for_each(|row| row.truncate(most));
        Ok(rows)
    }

    pub fn trans(&mut self, name: &'static str, frames: usize) -> Result<Vec<[f64; 3]>> {
        let array = self.finite(name, &|array| match array.shape[..] {
            [3] | [1, 3] => Ok(()),
            [f, 3] | [1, f, 3] if f == frames => Ok(()),
            _ => Err(format!("has the shape {:?}, expected [3] or [{frames}, 3]", array.shape)),
        })?;
        let rows = triples(&array.values);
        Ok(if rows.len() == 1 { vec![rows[0]; frames] } else { rows })
    }

    pub fn views(&mut self) -> Result<Vec<View>> {
        if !["R", "t", "K"].iter().all(|name| self.npz.contains(name)) {
            return Ok(Vec::new());
        }
        let rotations = self.finite("R", &|array| array.check_shape(&[None, Some(3), Some(3)]))?;
        let n = rotations.shape[0];
        let translations = self.finite("t", &|array| array.check_shape(&[Some(n), Some(3)]))?;
        let intrinsics = self.finite("K", &|array| array.check_shape(&[Some(n), Some(3), Some(3)]))?;
        let names = match self.first_of(&["camera_names"]) {
            None => (0..n).map(|i| i.to_string()).collect(),
            Some(name) => self.npz.texts(name)?,
        };
        if names.len() != n {
            let message = format!("holds {} names for {n} cameras", names.len());
            return Err(self.fail("camera_names", &message));
        }
        let matrices = |array: &Array<f64>| -> Vec<[[f64; 3]; 3]> {
            triples(&array.values).chunks_exact(3).map(|rows| [rows[0], rows[1], rows[2]]).collect()
        };
        let places = matrices(&rotations).into_iter().zip(triples(&translations.values));
        Ok(names
            .into_iter()
            .zip(matrices(&intrinsics))
            .zip(places)
            .map(|((name, k), (r, t))| View { name, k, extrinsics: Extrinsics { r, t } })
            .collect())
    }
}

pub(super) fn triples(values: &[f64]) -> Vec<[f64; 3]> {
    values.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect()
}

fn pose_shape(shape: &[usize], joints: usize) -> std::result::Result<(), String> {
    let width = 3 * joints;
    match *shape {
        [n] | [_, n] | [1, _, n] if n == width => Ok(()),
        [j, 3] | [_, j, 3] if j == joints => Ok(()),
        [actors, _, n] if n == width => Err(format!(
            "has the shape {shape:?}: {actors} people; give each a file of its own, with poses[0], betas[0] and trans[0] and so on"
        )),
        [n] | [_, n] => Err(format!(
            "has the shape {shape:?}; the body has {joints} joints and takes [{width}] or [F, {width}]{}",
            hint(n, joints)
        )),
        [.., 3, 3] => Err(format!(
            "has the shape {shape:?}, which looks like rotation matrices; expected axis–angle vectors [F, {width}]"
        )),
        _ => Err(format!("has the shape {shape:?}, expected [F, {width}] or [F, {joints}, 3]")),
    }
}

fn part_shape(shape: &[usize]) -> std::result::Result<(), String> {
    match *shape {
        [n] | [_, n] if n % 3 == 0 => Ok(()),
        [.., 3, 3] => Err(format!(
            "has the shape {shape:?}, which looks like rotation matrices; expected axis–angle vectors"
        )),
        [_, _, 3] => Ok(()),
        _ => Err(format!("has the shape {shape:?}, expected axis–angle vectors [F, 3 × joints]")),
    }
}

/// SMPL's joints.
const SMPL_JOINTS: usize = 24;

/// Whether a pose of `width` numbers is one whose first 22 joints are those of a body of 24: the 22 alone, SMPL-H or SMPL-X.
fn is_shared(width: usize, joints: usize) -> bool {
    joints == SMPL_JOINTS && [SHARED_WIDTH, 156, 165].contains(&width)
}

/// What to do about a pose of `width` numbers that is known to belong to another family of bodies.
fn hint(width: usize, joints: usize) -> String {
    let family = match width {
        72 => "SMPL's 24 joints",
        156 => "SMPL-H's 52 joints, as AMASS writes them",
        165 => "SMPL-X's 55 joints",
        _ => return String::new(),
    };
    if joints == 24 {
        return format!(
            "; {width} is {family}: give such a body, or keep the 22 joints that they share, with hands at rest: \
             numpy.pad(poses[:, :66], ((0, 0), (0, 6)))"
        );
    }
    format!("; {width} is {family}: give such a body")
}

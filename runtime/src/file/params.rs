//! Parameters of a body over F frames: an `.npz` under the names of AMASS, 3DPW, smplx, SPIN and HMR.
//!
//! | key | also read as | shape | where missing |
//! |---|---|---|---|
//! | poses | pose, fullpose, pred_pose, its [parts](#a-pose-in-parts), or in theta | \[F,3J\], \[3J\], \[F,J,3\], \[J,3\] or \[1,F,3J\] | an error |
//! | betas | shape, pred_betas, pred_shape, or in theta | \[B\], \[1,B\] or \[F,B\]; fewer than the body's are padded with zeros | zeros |
//! | trans | transl | \[3\], \[1,3\], \[F,3\] or \[1,F,3\], metres | zeros |
//! | theta | | \[F,85\] or \[85\]: camera (3, left alone), pose (72), betas (10), as HMR and VIBE write them | – |
//! | offsets | | \[V,3\], metres, added to the shaped rest mesh | none |
//! | R, t, K | | \[N,3,3\], \[N,3\], \[N,3,3\]: X_c = R X + t, pixels | no cameras, unless all three are there |
//! | camera_names | | \[N\] texts | 0, 1, 2, … |
//!
//! Poses are axis–angle vectors in radians, joint by joint, each relative to the joint's parent. Every other array (gender,
//! mocap_framerate, dmpls, joints, …) is left alone.
//!
//! # A pose in parts
//! AMASS and smplx also write the joints in groups; they are joined in the order that smplx gives them: global_orient or
//! root_orient, body_pose or pose_body, jaw_pose or pose_jaw, leye_pose and reye_pose or pose_eye, left_hand_pose and
//! right_hand_pose or pose_hand.
//!
//! # Why is a pose of another body refused?
//! AMASS writes SMPL-H's 52 joints. Its first 22 are SMPL's too, but its fingers have no place in SMPL's hands (joints 22
//! and 23), so that what to leave out is the user's decision; the message says how to carry it out. [`read_for_joints`]
//! takes it, for those who only look at joints: SMPL's hands are the last of their branches, so that their rotation moves
//! none of them.
//!
//! # Several people in a file
//! 3DPW has a list of actors. Saved as one array it is \[actors, F, 3J\]; with more than one actor, or as a pickled list, it
//! is refused with what to do.

use std::path::Path;

use super::npy::{Array, Values};
use super::npz::{self, Named, Npz};
use crate::capture::Extrinsics;
use crate::error::{Error, Result};

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
const BETAS: [&str; 4] = ["betas", "shape", "pred_betas", "pred_shape"];

/// HMR's camera, pose and betas in one row.
const THETA: [usize; 3] = [3, 72, 10];

/// The numbers of the 22 joints that SMPL, SMPL-H and SMPL-X share.
const SHARED_WIDTH: usize = 66;

/// How many of everything a body has, which its parameters must fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// V.
    pub vertices: usize,
    /// J.
    pub joints: usize,
    /// B.
    pub betas: usize,
}

/// A camera that the parameters were fitted to, or are to be seen from.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera's name, or its number where the file has no names.
    pub name: String,
    /// The intrinsic matrix in pixels, as in [`Camera`](crate::capture::Camera).
    pub k: [[f64; 3]; 3],
    /// World to camera, metres.
    pub extrinsics: Extrinsics,
}

/// The parameters of F ≥ 1 frames of one body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters {
    /// F poses of 3J numbers: axis–angle vectors relative to the parent joint, radians.
    pub poses: Vec<Vec<f64>>,
    /// One row for every frame, or F rows; at most B numbers each, the rest being zero.
    pub betas: Vec<Vec<f64>>,
    /// F translations in metres.
    pub trans: Vec<[f64; 3]>,
    /// Displacements of the shaped rest mesh: V, or none.
    pub offsets: Vec<[f64; 3]>,
    /// Cameras; none in most files.
    pub views: Vec<View>,
}

impl Parameters {
    /// F.
    pub fn frame_count(&self) -> usize {
        self.poses.len()
    }

    /// The betas of a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn betas_of(&self, frame: usize) -> &[f64] {
        if self.betas.len() == 1 { &self.betas[0] } else { &self.betas[frame] }
    }
}

/// Reads the parameters of `path` for a body with these `counts`; numbers of any width become f64.
///
/// # Errors
/// The file cannot be read or holds no pose; an array has another shape, another number of frames, joints that the body
/// does not have, more betas than it has, or a number that is not finite. The array is named, with what was expected.
pub fn read(path: &Path, counts: &Counts) -> Result<Parameters> {
    Ok(read_with(path, counts, false)?.0)
}

/// As [`read`], for the sake of the joints alone, with a word about everything that was left away: fingers and face of
/// SMPL-H and SMPL-X where the body has SMPL's 24 joints (hands keep their place, at rest), and betas that the body lacks.
///
/// # Errors
/// As [`read`], but for those poses and betas.
pub fn read_for_joints(path: &Path, counts: &Counts) -> Result<(Parameters, Vec<String>)> {
    read_with(path, counts, true)
}

fn read_with(path: &Path, counts: &Counts, for_joints: bool) -> Result<(Parameters, Vec<String>)> {
    let mut file = Reader { npz: Npz::open(path)?, for_joints, left_away: Vec::new() };
    let poses = file.poses(counts)?;
    let frames = poses.len();
    let betas = match file.first_of(&BETAS) {
        None if file.has_theta() => {
            let rows = file.theta()?;
            let betas = rows.into_iter().map(|row| row[THETA[0] + THETA[1]..].to_vec()).collect();
            file.fitting("theta", betas, counts.betas)?
        }
        None => vec![Vec::new()],
        Some(name) => file.betas(name, frames, counts.betas)?,
    };
    let trans = match file.first_of(&["trans", "transl"]) {
        None => vec![[0.0; 3]; frames],
        Some(name) => file.trans(name, frames)?,
    };
    let offsets = match file.first_of(&["offsets"]) {
        None => Vec::new(),
        Some(name) => {
            triples(&file.finite(name, &|array| array.check_shape(&[Some(counts.vertices), Some(3)]))?.values)
        }
    };
    let views = file.views()?;
    Ok((Parameters { poses, betas, trans, offsets, views }, file.left_away))
}

/// Writes the parameters atomically: poses \[F,3J\], betas \[B\] or \[F,B\], trans \[F,3\], and offsets and cameras where there
/// are some; f64.
///
/// # Errors
/// As [`atomic::write`](super::atomic::write()).
///
/// # Panics
/// If there is no frame, the frames' poses or betas differ in length, or there are not as many translations as frames.
pub fn write(path: &Path, parameters: &Parameters) -> Result<()> {
    let Parameters { poses, betas, trans, offsets, views } = parameters;
    let frames = poses.len();
    assert!(frames > 0, "params::write: no frames");
    assert!(trans.len() == frames, "params::write: {} translations, {frames} frames", trans.len());
    assert!(
        betas.len() == 1 || betas.len() == frames,
        "params::write: {} rows of betas, {frames} frames",
        betas.len()
    );
    let (flat_poses, flat_betas) = (poses.concat(), betas.concat());
    let width = betas[0].len();
    let flat = |rows: Vec<[[f64; 3]; 3]>| -> Vec<f64> { rows.as_flattened().as_flattened().to_vec() };
    let rotations = flat(views.iter().map(|view| view.extrinsics.r).collect());
    let translations: Vec<f64> = views.iter().flat_map(|view| view.extrinsics.t).collect();
    let intrinsics = flat(views.iter().map(|view| view.k).collect());
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();

    let f64s = |name, shape, values| Named { name, shape, values: Values::F64(values) };
    let (pose_shape, trans_shape) = ([frames, flat_poses.len() / frames], [frames, 3]);
    let (one_shape, many_shape) = ([width], [frames, width]);
    let betas_shape = if betas.len() == 1 { &one_shape[..] } else { &many_shape };
    let offsets_shape = [offsets.len(), 3];
    let (n_shape, n3_shape, n33_shape) = ([views.len()], [views.len(), 3], [views.len(), 3, 3]);
    let mut arrays = vec![
        f64s("poses", &pose_shape, &flat_poses),
        f64s("betas", betas_shape, &flat_betas),
        f64s("trans", &trans_shape, trans.as_flattened()),
    ];
    if !offsets.is_empty() {
        arrays.push(f64s("offsets", &offsets_shape, offsets.as_flattened()));
    }
    if !views.is_empty() {
        arrays.push(f64s("R", &n33_shape, &rotations));
        arrays.push(f64s("t", &n3_shape, &translations));
        arrays.push(f64s("K", &n33_shape, &intrinsics));
        arrays.push(Named { name: "camera_names", shape: &n_shape, values: Values::Text(&names) });
    }
    npz::write(path, &arrays)
}

/// Says whether an array has a shape that can be used, or what was expected.
type ShapeCheck<'a> = &'a dyn Fn(&Array<f64>) -> std::result::Result<(), String>;

struct Reader {
    npz: Npz,
    /// Whether what does not move a joint may be left away.
    for_joints: bool,
    /// What was, a sentence each.
    left_away: Vec<String>,
}

impl Reader {
    fn first_of(&self, names: &[&'static str]) -> Option<&'static str> {
        names.iter().copied().find(|name| self.npz.contains(name))
    }

    fn fail(&self, name: &str, message: &str) -> Error {
        Error::file(self.npz.path(), format!("array \"{name}\" {message}"))
    }

    /// An array of the right shape whose numbers are all finite.
    fn finite(&mut self, name: &str, check: ShapeCheck<'_>) -> Result<Array<f64>> {
        let array = self.npz.array::<f64>(name)?;
        check(&array).map_err(|message| self.fail(name, &message))?;
        if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
            let message = format!("holds {} (element {i}); every number must be finite", array.values[i]);
            return Err(self.fail(name, &message));
        }
        Ok(array)
    }

    fn poses(&mut self, counts: &Counts) -> Result<Vec<Vec<f64>>> {
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

    fn has_theta(&self) -> bool {
        self.npz.contains("theta") && self.first_of(&POSES).is_none()
    }

    /// The rows of theta: camera, pose, betas.
    fn theta(&mut self) -> Result<Vec<Vec<f64>>> {
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

    fn betas(&mut self, name: &'static str, frames: usize, most: usize) -> Result<Vec<Vec<f64>>> {
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
    fn fitting(&mut self, name: &str, mut rows: Vec<Vec<f64>>, most: usize) -> Result<Vec<Vec<f64>>> {
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

    fn trans(&mut self, name: &'static str, frames: usize) -> Result<Vec<[f64; 3]>> {
        let array = self.finite(name, &|array| match array.shape[..] {
            [3] | [1, 3] => Ok(()),
            [f, 3] | [1, f, 3] if f == frames => Ok(()),
            _ => Err(format!("has the shape {:?}, expected [3] or [{frames}, 3]", array.shape)),
        })?;
        let rows = triples(&array.values);
        Ok(if rows.len() == 1 { vec![rows[0]; frames] } else { rows })
    }

    fn views(&mut self) -> Result<Vec<View>> {
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

fn triples(values: &[f64]) -> Vec<[f64; 3]> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::PathBuf;
    use tempfile::TempDir;

    const BODY: Counts = Counts { vertices: 2, joints: 3, betas: 2 };
    const SMPL: Counts = Counts { vertices: 6890, joints: 24, betas: 10 };

    fn file(arrays: &[(&str, &[usize], Values<'_>)]) -> (TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("params.npz");
        let named: Vec<Named<'_>> =
            arrays.iter().map(|&(name, shape, values)| Named { name, shape, values }).collect();
        npz::write(&path, &named).unwrap();
        (folder, path)
    }

    fn read_arrays(arrays: &[(&str, &[usize], Values<'_>)]) -> std::result::Result<Parameters, String> {
        let (_folder, path) = file(arrays);
        read(&path, &BODY).map_err(|error| error.to_string())
    }

    fn count(n: usize) -> Vec<f64> {
        (0..n).map(|i| i as f64).collect()
    }

    #[test]
    fn what_is_written_is_read_back() {
        let view = |name: &str, x: f64| View {
            name: name.into(),
            k: [[400.0 + x, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]],
            extrinsics: Extrinsics {
                r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                t: [x, 2.0, 3.0],
            },
        };
        let mut parameters = Parameters {
            poses: vec![count(9), vec![0.1; 9]],
            betas: vec![vec![0.5, -1.0]],
            trans: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            offsets: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]],
            views: vec![view("front", 0.25), view("left side", 0.5)],
        };
        let (_folder, path) = file(&[]);
        write(&path, &parameters).unwrap();
        assert_eq!(read(&path, &BODY).unwrap(), parameters);
        assert_eq!(parameters.betas_of(1), [0.5, -1.0]);

        parameters.betas = vec![vec![1.0], vec![2.0]];
        parameters.offsets.clear();
        parameters.views.clear();
        write(&path, &parameters).unwrap();
        assert_eq!(Npz::open(&path).unwrap().names(), ["poses", "betas", "trans"]);
        let back = read(&path, &BODY).unwrap();
        assert_eq!((back.betas_of(1), back.frame_count()), (&[2.0][..], 2));
    }

    #[test]
    fn every_accepted_shape_of_a_pose_is_the_same_pose() {
        let values = count(9);
        for shape in [&[9][..], &[1, 9], &[3, 3], &[1, 3, 3]] {
            for name in ["poses", "pose", "fullpose"] {
                let found = read_arrays(&[(name, shape, Values::F64(&values))]).unwrap();
                assert_eq!(found.poses, std::slice::from_ref(&values), "{name} {shape:?}");
                assert_eq!((found.betas, found.trans), (vec![vec![]], vec![[0.0; 3]]));
            }
        }
        let two = count(18);
        let found = read_arrays(&[
            ("poses", &[2, 3, 3], Values::F64(&two)),
            ("transl", &[3], Values::F32(&[0.5; 3])),
        ]);
        let found = found.unwrap();
        assert_eq!(found.poses[1], two[9..]);
        assert_eq!(found.trans, [[0.5; 3]; 2], "one translation serves every frame");
    }

    #[test]
    fn a_pose_in_parts_is_joined_in_the_order_of_the_joints() {
        let (root, rest) = ([1.0, 2.0, 3.0, 11.0, 12.0, 13.0], count(12));
        let arrays: [(&str, &[usize], _); 3] = [
            ("pose_body", &[2, 6], Values::F64(&rest)),
            ("gender", &[1], Values::U8(&[0])),
            ("root_orient", &[2, 3], Values::F64(&root)),
        ];
        let expected = [[&root[..3], &rest[..6]].concat(), [&root[3..], &rest[6..]].concat()];
        assert_eq!(read_arrays(&arrays).unwrap().poses, expected);
        let flat: [(&str, &[usize], _); 2] =
            [("global_orient", &[3], Values::F64(&root[..3])), ("body_pose", &[6], Values::F64(&rest[..6]))];
        assert_eq!(read_arrays(&flat).unwrap().poses, expected[..1]);

        let uneven = read_arrays(&[arrays[2], ("body_pose", &[1, 6], Values::F64(&rest[..6]))]).unwrap_err();
        assert!(
            uneven.contains("\"body_pose\" has the shape [1, 6], but \"root_orient\" has [2, 3]"),
            "{uneven}"
        );
        let short = read_arrays(&[arrays[2], ("body_pose", &[2, 3], Values::F64(&rest[..6]))]).unwrap_err();
        assert!(short.contains("make 6 numbers a frame; the body has 3 joints and takes 9"), "{short}");
    }

    #[test]
    fn refusals_name_the_array_and_both_shapes() {
        let poses: (&str, &[usize], _) = ("poses", &[2, 9], Values::F64(&[0.0; 18]));
        let refusal = |extra: (&str, &[usize], Values<'_>)| read_arrays(&[poses, extra]).unwrap_err();
        let cases = [
            (
                ("betas", &[3][..], Values::F64(&[0.5; 3])),
                "\"betas\" has 3 numbers; the body has 2 betas: keep betas[..., :2]",
            ),
            (
                ("betas", &[3, 1], Values::F64(&[0.0; 3])),
                "\"betas\" has the shape [3, 1], expected [B] or [2, B]",
            ),
            (
                ("trans", &[3, 3], Values::F64(&[0.0; 9])),
                "\"trans\" has the shape [3, 3], expected [3] or [2, 3]",
            ),
            (("trans", &[3], Values::F64(&[0.0, f64::NAN, 0.0])), "\"trans\" holds NaN (element 1)"),
            (("betas", &[1], Values::F32(&[f32::INFINITY])), "\"betas\" holds inf (element 0)"),
            (
                ("offsets", &[3, 3], Values::F64(&[0.0; 9])),
                "\"offsets\" has the shape [3, 3], expected [2, 3]",
            ),
        ];
        for (array, words) in cases {
            let message = refusal(array);
            assert!(message.contains("params.npz") && message.contains(words), "{message}");
        }
        for (shape, words) in [
            (
                &[2, 72][..],
                "has the shape [2, 72]; the body has 3 joints and takes [9] or [F, 9]; 72 is SMPL's 24 joints",
            ),
            (&[2, 3, 3, 3], "rotation matrices"),
            (&[2, 4, 9], "has the shape [2, 4, 9]: 2 people; give each a file of its own"),
            (&[0, 9], "holds no frames"),
            (&[], "has the shape []"),
        ] {
            let zeros = vec![0.0; shape.iter().product()];
            let message = read_arrays(&[("poses", shape, Values::F64(&zeros))]).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
        let none = read_arrays(&[("joints", &[3, 3], Values::F64(&[0.0; 9]))]).unwrap_err();
        assert!(none.contains("\"poses\" is missing") && none.ends_with("the file holds joints"), "{none}");
    }

    #[test]
    fn an_amass_pose_for_a_body_of_24_joints_is_refused_with_the_way_out() {
        let (_folder, path) = file(&[("poses", &[1, 156], Values::F64(&[0.0; 156]))]);
        let message = read(&path, &SMPL).unwrap_err().to_string();
        assert!(message.contains("SMPL-H's 52 joints") && message.contains("poses[:, :66]"), "{message}");
        assert_eq!(read(&path, &Counts { joints: 52, ..SMPL }).unwrap().poses[0].len(), 156);
    }

    #[test]
    fn for_joints_alone_an_amass_file_is_read_with_a_word_about_what_was_left_away() {
        let poses = count(2 * 156);
        let betas: Vec<f64> = (0..16).map(|i| 0.1 * f64::from(i)).collect();
        let gender = ["female".to_string()];
        let (_folder, path) = file(&[
            ("trans", &[2, 3], Values::F64(&[0.5; 6])),
            ("gender", &[1], Values::Text(&gender)),
            ("mocap_framerate", &[], Values::F64(&[120.0])),
            ("betas", &[16], Values::F64(&betas)),
            ("dmpls", &[2, 8], Values::F64(&[0.0; 16])),
            ("poses", &[2, 156], Values::F64(&poses)),
        ]);
        let (found, words) = read_for_joints(&path, &SMPL).unwrap();
        assert_eq!(found.poses[1], [&poses[156..156 + 66], &[0.0; 6]].concat());
        assert_eq!((found.betas_of(1), found.trans[0]), (&betas[..10], [0.5; 3]));
        assert!(words[0].contains("has 52 joints; of them the 22"), "{words:?}");
        assert!(words[1].contains("has 16 numbers; of them the 10"), "{words:?}");
        assert_eq!(read_for_joints(&path, &BODY).unwrap_err().to_string().matches("52 joints").count(), 1);

        let (body, hands) = (count(63), [0.0; 90]);
        let (_folder, path) = file(&[
            ("root_orient", &[1, 3], Values::F64(&[9.0; 3])),
            ("pose_body", &[1, 63], Values::F64(&body)),
            ("pose_hand", &[1, 90], Values::F64(&hands)),
        ]);
        let (found, words) = read_for_joints(&path, &SMPL).unwrap();
        assert_eq!(found.poses[0], [&[9.0; 3][..], &body, &[0.0; 6]].concat());
        assert_eq!(words.len(), 1);
    }

    #[test]
    fn betas_that_the_body_lacks_are_refused_even_if_they_are_zero() {
        let found = read_arrays(&[
            ("poses", &[9], Values::F64(&[0.0; 9])),
            ("shape", &[1, 4], Values::F64(&[1.0, 2.0, 0.0, 0.0])),
        ]);
        assert!(found.unwrap_err().to_string().contains("has 4 numbers; the body has 2 betas"));
    }

    #[test]
    fn spin_s_results_and_hmr_s_theta_are_parameters() {
        let (pose, betas, theta) = (count(2 * 72), count(2 * 10), count(2 * 85));
        let (_folder, path) = file(&[
            ("pred_joints", &[2, 17, 3], Values::F64(&[0.0; 102])),
            ("pose", &[2, 72], Values::F64(&pose)),
            ("betas", &[2, 10], Values::F64(&betas)),
            ("camera", &[2, 3], Values::F64(&[0.0; 6])),
        ]);
        let found = read(&path, &SMPL).unwrap();
        assert_eq!((&found.poses[1][..], found.betas_of(1)), (&pose[72..], &betas[10..]));

        let (_folder, path) = file(&[("theta", &[2, 85], Values::F64(&theta))]);
        let found = read(&path, &SMPL).unwrap();
        assert_eq!((found.poses[1][0], found.poses[1][71], found.betas_of(1)[0]), (88.0, 159.0, 160.0));
        assert!(read(&path, &BODY).unwrap_err().to_string().contains("SMPL's 24 joints; the body has 3"));
        let (_folder, path) = file(&[("theta", &[82], Values::F64(&theta[..82]))]);
        assert!(read(&path, &SMPL).unwrap_err().to_string().contains("[82], expected [F, 85]"));
    }

    #[test]
    fn one_actor_of_3dpw_is_read() {
        let (poses, trans) = (count(18), count(6));
        let found = read_arrays(&[
            ("poses", &[1, 2, 9], Values::F64(&poses)),
            ("betas", &[1, 2], Values::F64(&[0.5, 0.25])),
            ("trans", &[1, 2, 3], Values::F64(&trans)),
            ("genders", &[1], Values::Text(&["m".to_string()])),
        ]);
        let found = found.unwrap();
        assert_eq!((&found.poses[1][..], found.trans[1]), (&poses[9..], [3.0, 4.0, 5.0]));
        assert_eq!(found.betas_of(1), [0.5, 0.25]);
    }

    #[test]
    fn cameras_need_all_three_arrays_and_may_lack_names() {
        let eye = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let arrays: [(&str, &[usize], _); 4] = [
            ("poses", &[9], Values::F64(&eye)),
            ("R", &[1, 3, 3], Values::F64(&eye)),
            ("K", &[1, 3, 3], Values::F64(&eye)),
            ("t", &[1, 3], Values::F64(&eye[..3])),
        ];
        let views = read_arrays(&arrays).unwrap().views;
        assert_eq!((views.len(), views[0].name.as_str(), views[0].extrinsics.t), (1, "0", [1.0, 0.0, 0.0]));
        assert!(read_arrays(&arrays[..3]).unwrap().views.is_empty());
        let names = ["a".to_string(), "b".to_string()];
        let mut named = arrays.to_vec();
        named.push(("camera_names", &[2], Values::Text(&names)));
        assert!(read_arrays(&named).unwrap_err().contains("\"camera_names\" holds 2 names for 1 cameras"));
    }

    proptest! {
        #[test]
        fn arrays_of_any_shape_never_panic(
            name in prop::sample::select(vec!["poses", "global_orient", "betas", "trans", "R", "t", "K", "offsets"]),
            shape in prop::collection::vec(0usize..4, 0..4), whole in any::<bool>(),
        ) {
            let values = vec![1.0; shape.iter().product()];
            let ones = [1.0; 9];
            let mut arrays: Vec<(&str, &[usize], Values<'_>)> = vec![
                ("body_pose", &[1, 6], Values::F64(&ones[..6])),
                ("R", &[1, 3, 3], Values::F64(&ones)),
                ("K", &[1, 3, 3], Values::F64(&ones)),
                ("t", &[1, 3], Values::F64(&ones[..3])),
            ];
            if whole && name != "poses" {
                arrays.push(("poses", &[1, 9], Values::F64(&ones)));
            }
            arrays.retain(|array| array.0 != name);
            arrays.push((name, &shape, Values::F64(&values)));
            let _ = read_arrays(&arrays);
        }
    }
}

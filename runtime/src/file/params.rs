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

use super::npy::Values;
use super::npz::{self, Named};
use crate::capture::Extrinsics;
use crate::error::Result;

mod reader;
#[cfg(test)]
mod tests;

use reader::{BETAS, Reader, THETA, triples};

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
    let mut file = Reader::open(path, for_joints)?;
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
    Ok((Parameters { poses, betas, trans, offsets, views }, file.left_away()))
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

//! `vitruvian synthesize`: captures of random people, with the truth beside them.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use vitruvian_conformance::convert;
use vitruvian_runtime::capture::{self, BodyTruth, View};
use vitruvian_runtime::file::keypoints::{JointSet, Keypoints};

use crate::failure::Result;
use crate::synthesis::surroundings::Wanted;
use crate::synthesis::{Scene, Settings, Shot, Surroundings};
use crate::{body, progress};

/// Make captures of random people: images, masks, keypoints, cameras, and the true body
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the captures, one folder each
    #[arg(short, long)]
    out: PathBuf,
    /// Number of captures
    #[arg(long, default_value_t = 1)]
    count: u64,
    /// Seed of the run; capture k of a seed is always the same
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Body model (.npz in SMPL's arrays); the built-in mannequin without it
    #[arg(long)]
    body: Option<PathBuf>,
    /// Cameras on the ring
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=64))]
    views: u16,
    /// Side of the square images in pixels
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(64..=4096))]
    size: u32,
    /// Put pictures behind the people, and vary the light and the cameras' exposure, tint and noise
    #[arg(long)]
    backgrounds: bool,
    /// Probability, for each view, that a piece of furniture stands before the person
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    occlusion: f64,
}

fn probability(text: &str) -> std::result::Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err("give a probability from 0 to 1".to_owned()) }
}

/// Writes the captures, in parallel.
pub fn run(arguments: &Arguments) -> Result<()> {
    let body = body::load_to_pose(arguments.body.as_deref())?;
    let settings =
        Settings { seed: arguments.seed, views: usize::from(arguments.views), size_px: arguments.size };
    let wanted =
        Wanted { backgrounds: if arguments.backgrounds { 1.0 } else { 0.0 }, occlusion: arguments.occlusion };
    let bar = progress::bar("captures", arguments.count);
    (0..arguments.count).into_par_iter().try_for_each(|index| {
        let scene = Scene::random(&body, &settings, index);
        let shots = Surroundings::random(&scene, &settings, &wanted, index).photograph(&scene);
        write(&arguments.out.join(format!("{index:04}")), &scene, shots)?;
        bar.inc(1);
        Ok(())
    })
}

/// Writes a scene and its pictures, one for each of its cameras, as a capture into the folder `path`.
///
/// Keypoints of joints behind furniture have confidence 0, all others 1.
pub fn write(path: &Path, scene: &Scene, shots: Vec<Shot>) -> Result<()> {
    let views: Vec<View> = scene
        .cameras
        .iter()
        .zip(shots)
        .map(|(camera, shot)| {
            let seen = scene.joints.iter().zip(&shot.joint_hidden).map(|(&joint, &hidden)| {
                let confidence = if hidden { 0.0 } else { 1.0 };
                camera.project(joint).map_or([0.0; 3], |([u, v], _)| [u, v, confidence])
            });
            View {
                camera: camera.clone(),
                image: Some(shot.image),
                mask: Some(shot.mask),
                keypoints: Some(Keypoints { joint_set: JointSet::Smpl24, points: seen.collect() }),
            }
        })
        .collect();
    let truth =
        BodyTruth { poses: &scene.pose, betas: &scene.betas, trans: scene.trans, joints: &scene.joints };
    capture::write(path, &views, Some(&convert::mesh_to_runtime(&scene.surface)), Some(truth))?;
    Ok(())
}

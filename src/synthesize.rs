//! `vitruvian synthesize`: captures of random people, with the truth beside them.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use vitruvian_conformance::convert;
use vitruvian_runtime::capture::{self, BodyTruth, View};
use vitruvian_runtime::file::keypoints::{JointSet, Keypoints};

use crate::failure::Result;
use crate::synthesis::{Scene, Settings};
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
}

/// Writes the captures, in parallel.
pub fn run(arguments: &Arguments) -> Result<()> {
    let body = body::load_to_pose(arguments.body.as_deref())?;
    let settings =
        Settings { seed: arguments.seed, views: usize::from(arguments.views), size_px: arguments.size };
    let bar = progress::bar("captures", arguments.count);
    (0..arguments.count).into_par_iter().try_for_each(|index| {
        let scene = Scene::random(&body, &settings, index);
        write(&arguments.out.join(format!("{index:04}")), &scene)?;
        bar.inc(1);
        Ok(())
    })
}

/// Photographs a scene and writes it as a capture into the folder `path`.
pub fn write(path: &Path, scene: &Scene) -> Result<()> {
    let views: Vec<View> = scene
        .cameras
        .iter()
        .zip(scene.photograph())
        .map(|(camera, picture)| {
            let seen = scene.joints.iter().map(|&joint| match camera.project(joint) {
                Some(([u, v], _)) => [u, v, 1.0],
                None => [0.0; 3],
            });
            View {
                camera: camera.clone(),
                image: Some(picture.image),
                mask: Some(picture.mask),
                keypoints: Some(Keypoints { joint_set: JointSet::Smpl24, points: seen.collect() }),
            }
        })
        .collect();
    let truth =
        BodyTruth { poses: &scene.pose, betas: &scene.betas, trans: scene.trans, joints: &scene.joints };
    capture::write(path, &views, Some(&convert::mesh_to_runtime(&scene.surface)), Some(truth))?;
    Ok(())
}

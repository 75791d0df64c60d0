//! `vitruvian dataset`: labelled scenes for training, exactly as the runtime prepares them for the networks.
//!
//! For MF-PIFu: crops, projections, and points inside or outside. For VSR (`--coarse`): the voxels of the surface that
//! MF-PIFu reconstructs from the crops, and points around both surfaces. For the regressor: crops with surroundings,
//! and what the body in them is.

mod regressor;

use std::path::{Path, PathBuf};

use rand::Rng;
use rayon::prelude::*;
use vitruvian_conformance::convert;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_reference::surface::sampling::{SplitMix64, sample_surface};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named};
use vitruvian_runtime::image_input::{BodyRegion, NetworkView, Normalization};
use vitruvian_runtime::implicit_field::Mode;
use vitruvian_runtime::inside::Inside;
use vitruvian_runtime::reconstruct::{CUBE_FILL, Options, Reconstructor};
use vitruvian_runtime::session;
use vitruvian_runtime::voxelize::{Cube, voxelize};

use crate::failure::{Failure, Result};
use crate::synthesis::{Scene, Settings, normal, scene_rng};
use crate::{body, progress};

/// The network that scenes are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Network {
    /// Crops, projections, and points inside or outside; with --coarse, voxels and points for VSR.
    Implicit,
    /// Crops with surroundings, keypoints, and the body's parameters.
    Regressor,
}

/// Make labelled training scenes (for models/train_*.py)
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the scenes, one .npz each; scenes that are there already are kept
    #[arg(short, long)]
    out: PathBuf,
    /// The network that the scenes are for
    #[arg(long = "for", value_enum, default_value_t = Network::Implicit)]
    network: Network,
    /// Number of scenes
    #[arg(long)]
    count: u64,
    /// Seed of the run; scene k of a seed is always the same
    #[arg(long)]
    seed: u64,
    /// Number of the first scene
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Body model (.npz in SMPL's arrays); the built-in mannequin without it
    #[arg(long)]
    body: Option<PathBuf>,
    /// Cameras on the ring
    #[arg(long, default_value_t = 4)]
    views: usize,
    /// Make scenes for VSR, with the coarse surfaces of the MF-PIFu graphs in this folder
    #[arg(long)]
    coarse: Option<PathBuf>,
}

/// Side of MF-PIFu's images in pixels.
const IMAGE_SIZE: usize = 256;

/// Cells along each side of the lattice on which coarse surfaces are found, and of the voxels made from them.
const RESOLUTION: usize = 128;

/// Points of a VSR scene: around the coarse surface with σ_max and σ_min, and around the true one with σ_min (E23, E35).
const AROUND_COARSE: [(usize, f64); 2] = [(6_000, 0.15), (8_000, 0.015)];
const AROUND_TRUTH: (usize, f64) = (8_000, 0.015);

/// Points around the true surface: (how many, standard deviation in metres); then points anywhere in the query cube.
const NEAR: [(usize, f64); 2] = [(10_000, 0.05), (8_000, 0.015)];
const ANYWHERE: usize = 6_000;

/// Makes the scenes that are not there yet: in parallel, or one after another where networks run.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.network == Network::Regressor && arguments.coarse.is_some() {
        return Err(Failure::Usage(
            "--coarse makes scenes for VSR: leave it out with --for regressor".to_owned(),
        ));
    }
    let body = body::load_to_pose(arguments.body.as_deref())?;
    let settings = Settings { seed: arguments.seed, views: arguments.views, size_px: 512 };
    std::fs::create_dir_all(&arguments.out).map_err(|e| Error::io(&arguments.out, e))?;
    let bar = progress::bar("scenes", arguments.count);
    let missing: Vec<(u64, PathBuf)> = (arguments.first..arguments.first + arguments.count)
        .map(|index| (index, arguments.out.join(format!("scene_{}_{index:06}.npz", arguments.seed))))
        .filter(|(_, path)| !path.exists())
        .collect();
    bar.inc(arguments.count - missing.len() as u64);
    if let Some(models) = &arguments.coarse {
        let mut reconstructor = Reconstructor::load(models, false, &session::Settings::default())?;
        return missing.iter().try_for_each(|(index, path)| {
            let scene = Scene::random(&body, &settings, *index);
            let mut rng = scene_rng(settings.seed ^ POINTS, *index);
            write_vsr(path, &scene, &mut reconstructor, &mut rng)?;
            bar.inc(1);
            Ok(())
        });
    }
    if arguments.network == Network::Regressor {
        let settings = Settings { size_px: regressor::PICTURE_PX, ..settings };
        let skeleton = regressor::Skeleton::of(&body);
        return missing.par_iter().try_for_each(|(index, path)| {
            regressor::write(path, &regressor::Example::random(&body, &settings, *index)?, &skeleton)?;
            bar.inc(1);
            Ok(())
        });
    }
    missing.par_iter().try_for_each(|(index, path)| {
        let scene = Scene::random(&body, &settings, *index);
        let mut rng = scene_rng(settings.seed ^ POINTS, *index);
        write_mf_pifu(path, &scene, &mut rng)?;
        bar.inc(1);
        Ok(())
    })
}

/// Sets the points' random numbers apart from the scene's.
const POINTS: u64 = 0x706f_696e_7473;

/// The crops of a scene, made from its pictures and masks alone.
fn network_views(name: &Path, scene: &Scene) -> Result<Vec<NetworkView>> {
    let pictures = scene.photograph();
    let views = scene.cameras.iter().zip(&pictures).map(|(camera, picture)| {
        NetworkView::new(name, camera, &picture.image, &picture.mask, IMAGE_SIZE, &Normalization::default())
    });
    Ok(views.collect::<std::result::Result<_, _>>()?)
}

fn write_mf_pifu(path: &Path, scene: &Scene, rng: &mut impl Rng) -> Result<()> {
    let views = network_views(path, scene)?;
    let region = BodyRegion::find(path, &views)?;
    let mut points: Vec<[f32; 3]> = NEAR.iter().flat_map(|&near| around(rng, &scene.surface, near)).collect();
    points
        .extend((0..ANYWHERE).map(|_| region.origin.map(|o| (o + region.side * rng.random::<f64>()) as f32)));
    let occupancy = labels(&scene.surface, &points);

    let images: Vec<u8> = views
        .iter()
        .flat_map(|v| v.pixels.iter().map(|x| (x * 127.0).round() as i32 + 128))
        .map(|q| q.clamp(1, 255) as u8)
        .collect();
    let projection: Vec<f32> =
        views.iter().flat_map(|v| v.projection().into_iter().flatten()).map(|x| x as f32).collect();
    let mut depth_center = Vec::new();
    let mut depth_scale = Vec::new();
    for view in &views {
        let depth = view.camera.project(region.centre).map_or(0.0, |(_, depth)| depth);
        depth_center.push(depth as f32);
        depth_scale.push(view.crop_half_width(depth) as f32);
    }
    let (n, p) = (views.len(), points.len());
    let flat: Vec<f32> = points.into_iter().flatten().collect();
    npz::write(
        path,
        &[
            Named { name: "images", shape: &[n, 3, IMAGE_SIZE, IMAGE_SIZE], values: Values::U8(&images) },
            Named { name: "projection", shape: &[n, 3, 4], values: Values::F32(&projection) },
            Named { name: "depth_center", shape: &[n], values: Values::F32(&depth_center) },
            Named { name: "depth_scale", shape: &[n], values: Values::F32(&depth_scale) },
            Named { name: "points", shape: &[p, 3], values: Values::F32(&flat) },
            Named { name: "occupancy", shape: &[p], values: Values::U8(&occupancy) },
        ],
    )?;
    Ok(())
}

fn write_vsr(
    path: &Path,
    scene: &Scene,
    reconstructor: &mut Reconstructor,
    rng: &mut impl Rng,
) -> Result<()> {
    let views = network_views(path, scene)?;
    let region = BodyRegion::find(path, &views)?;
    let options = Options { resolution: RESOLUTION, mode: Mode::CoarseToFine };
    let coarse = reconstructor.reconstruct(&views, &region, &options, &mut |_, _, _| {})?.coarse.mesh;
    let cube = Cube::around(&coarse, CUBE_FILL)?;
    let voxels = voxelize(&coarse, &cube, RESOLUTION)?;
    let packed: Vec<u8> = voxels.values.iter().copied().collect::<Vec<u8>>().chunks(8).map(pack).collect();

    let coarse = convert::mesh_to_reference(&coarse);
    let mut points: Vec<[f32; 3]> =
        AROUND_COARSE.iter().flat_map(|&near| around(rng, &coarse, near)).collect();
    points.extend(around(rng, &scene.surface, AROUND_TRUTH));
    points.retain(|p| cube.normalize(p.map(f64::from)).iter().all(|c| c.abs() <= 1.0));
    let occupancy = labels(&scene.surface, &points);
    let flat: Vec<f32> =
        points.iter().flat_map(|p| cube.normalize(p.map(f64::from))).map(|c| c as f32).collect();
    npz::write(
        path,
        &[
            Named { name: "voxels", shape: &[packed.len()], values: Values::U8(&packed) },
            Named { name: "points", shape: &[points.len(), 3], values: Values::F32(&flat) },
            Named { name: "occupancy", shape: &[points.len()], values: Values::U8(&occupancy) },
        ],
    )?;
    Ok(())
}

/// Eight voxels in a byte, the first in its highest bit, as NumPy's `packbits`.
fn pack(voxels: &[u8]) -> u8 {
    voxels.iter().enumerate().map(|(bit, &voxel)| voxel << (7 - bit)).sum()
}

/// `count` points spread evenly over a surface, moved by a normal step of `sigma_m` along each axis.
fn around(rng: &mut impl Rng, surface: &Mesh, (count, sigma_m): (usize, f64)) -> Vec<[f32; 3]> {
    let mut random = SplitMix64::new(rng.random());
    let samples = sample_surface(surface, count, &mut random).unwrap_or_default();
    samples.iter().map(|s| s.point.map(|x| (x + sigma_m * normal(rng, 6.0)) as f32)).collect()
}

/// 1 for each point inside the surface, else 0.
fn labels(surface: &Mesh, points: &[[f32; 3]]) -> Vec<u8> {
    let inside = Inside::new(&convert::mesh_to_runtime(surface));
    inside.contains_all(points).into_iter().map(u8::from).collect()
}

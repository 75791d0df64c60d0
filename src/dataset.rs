//! `vitruvian dataset`: labelled scenes for training, exactly as the runtime prepares them for the networks.

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
use vitruvian_runtime::inside::Inside;

use crate::failure::Result;
use crate::synthesis::{Scene, Settings, normal, scene_rng};
use crate::{body, progress};

/// Make labelled training scenes: crops, projections and points inside or outside (for models/train_*.py)
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the scenes, one .npz each; scenes that are there already are kept
    #[arg(short, long)]
    out: PathBuf,
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
    /// Side of a network's image in pixels
    #[arg(long, default_value_t = 256)]
    image_size: usize,
}

/// Points around the true surface: (how many, standard deviation in metres); then points anywhere in the query cube.
const NEAR: [(usize, f64); 2] = [(10_000, 0.05), (8_000, 0.015)];
const ANYWHERE: usize = 6_000;

/// Makes the scenes that are not there yet, in parallel.
pub fn run(arguments: &Arguments) -> Result<()> {
    let body = body::load(arguments.body.as_deref())?;
    let settings = Settings { seed: arguments.seed, views: arguments.views, size_px: 512 };
    std::fs::create_dir_all(&arguments.out).map_err(|e| Error::io(&arguments.out, e))?;
    let bar = progress::bar("scenes", arguments.count);
    (arguments.first..arguments.first + arguments.count).into_par_iter().try_for_each(|index| {
        let path = arguments.out.join(format!("scene_{}_{index:06}.npz", arguments.seed));
        if !path.exists() {
            let scene = Scene::random(&body, &settings, index);
            write_mf_pifu(&path, &scene, arguments.image_size, &settings, index)?;
        }
        bar.inc(1);
        Ok(())
    })
}

/// The crops of a scene, made from its pictures and masks alone.
pub fn network_views(name: &Path, scene: &Scene, size: usize) -> Result<Vec<NetworkView>> {
    let pictures = scene.photograph();
    let views = scene.cameras.iter().zip(&pictures).map(|(camera, picture)| {
        NetworkView::new(name, camera, &picture.image, &picture.mask, size, &Normalization::default())
    });
    Ok(views.collect::<std::result::Result<_, _>>()?)
}

fn write_mf_pifu(path: &Path, scene: &Scene, size: usize, settings: &Settings, index: u64) -> Result<()> {
    let views = network_views(path, scene, size)?;
    let region = BodyRegion::find(path, &views)?;
    let mut rng = scene_rng(settings.seed ^ 0x706f_696e_7473, index);
    let mut points: Vec<[f32; 3]> =
        NEAR.iter().flat_map(|&(count, sigma_m)| around(&mut rng, &scene.surface, count, sigma_m)).collect();
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
            Named { name: "images", shape: &[n, 3, size, size], values: Values::U8(&images) },
            Named { name: "projection", shape: &[n, 3, 4], values: Values::F32(&projection) },
            Named { name: "depth_center", shape: &[n], values: Values::F32(&depth_center) },
            Named { name: "depth_scale", shape: &[n], values: Values::F32(&depth_scale) },
            Named { name: "points", shape: &[p, 3], values: Values::F32(&flat) },
            Named { name: "occupancy", shape: &[p], values: Values::U8(&occupancy) },
        ],
    )?;
    Ok(())
}

/// `count` points spread evenly over a surface, moved by a normal step of `sigma_m` along each axis.
fn around(rng: &mut impl Rng, surface: &Mesh, count: usize, sigma_m: f64) -> Vec<[f32; 3]> {
    let mut random = SplitMix64::new(rng.random());
    let samples = sample_surface(surface, count, &mut random).unwrap_or_default();
    samples.iter().map(|s| s.point.map(|x| (x + sigma_m * normal(rng, 6.0)) as f32)).collect()
}

/// 1 for each point inside the surface, else 0.
fn labels(surface: &Mesh, points: &[[f32; 3]]) -> Vec<u8> {
    let inside = Inside::new(&convert::mesh_to_runtime(surface));
    inside.contains_all(points).into_iter().map(u8::from).collect()
}

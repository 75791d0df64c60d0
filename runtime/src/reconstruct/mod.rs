//! From the views of a capture to a body's surface: MF-PIFu, then voxel super-resolution.
//!
//! ```text
//! views ─ encoder ─ features ─┐                             ┌─ voxels ─ encoder ─ features ─┐
//!        query points ────────┴ occupancy ─ coarse surface ─┤          query points ────────┴ occupancy ─ refined
//!                                                           └─ cube                                      surface
//! ```
//!
//! Both surfaces keep every component that their field has; nothing is dropped in between.
//!
//! # References
//! Li 2021, chapter 5 (MF-PIFu) and chapter 6 (voxel super-resolution).

mod mf_pifu;
mod vsr;

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use crate::contract::{Graph, Kind};
use crate::error::{Error, Result};
use crate::image_input::{BodyRegion, NetworkView};
use crate::implicit_field::{self, ImplicitField, Lattice, Mode};
use crate::mesh::Mesh;
use crate::session::Settings;
use crate::voxelize::{Cube, voxelize};

pub use mf_pifu::MfPifu;
pub use vsr::Vsr;

/// The share of VSR's cube that the coarse surface's longest side takes.
pub const CUBE_FILL: f64 = 0.9;

/// Cells of both fields' coarse lattices: silhouettes and coarse voxels tell most of their points without asking.
const COARSE_CELLS: usize = 128;

/// A step of the work, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Images to features.
    EncodeViews,
    /// The coarse field to its surface.
    CoarseSurface,
    /// The coarse surface to voxels.
    Voxelize,
    /// Voxels to features.
    EncodeVoxels,
    /// The refined field to its surface.
    RefinedSurface,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// R, the cells along each side of the lattice of both fields.
    pub resolution: usize,
    /// Whether every lattice point is asked.
    pub mode: Mode,
}

impl Default for Options {
    fn default() -> Options {
        Options { resolution: 256, mode: Mode::CoarseToFine }
    }
}

/// One surface and what it cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Vertices in world metres.
    pub mesh: Mesh,
    /// The cube its field was looked at in.
    pub cube: Cube,
    /// How many points were asked.
    pub field: implicit_field::Report,
}

/// A reconstructed body.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// MF-PIFu's surface.
    pub coarse: Surface,
    /// VSR's surface, if VSR was loaded.
    pub refined: Option<Surface>,
    /// Voxel columns of the coarse surface that were open (0: its mesh is closed).
    pub open_columns: usize,
    /// Seconds of each stage, in order.
    pub seconds: Vec<(Stage, f64)>,
}

/// The loaded networks.
#[derive(Debug)]
pub struct Reconstructor {
    /// Images to the coarse surface.
    pub mf_pifu: MfPifu,
    /// The coarse surface to the refined one.
    pub vsr: Option<Vsr>,
}

impl Reconstructor {
    /// Loads `mf_pifu_encoder.onnx`, `mf_pifu_query.onnx` and, to refine, `vsr_encoder.onnx` and `vsr_query.onnx`
    /// from a folder, and checks that they keep their contracts and fit together.
    ///
    /// # Errors
    /// [`Error::Missing`] without ONNX Runtime or when a graph is not in the folder; else as [`Graph::load`], and
    /// [`Error::Graph`] when a query does not take what its encoder gives.
    pub fn load(models: impl AsRef<Path>, refine: bool, settings: &Settings) -> Result<Reconstructor> {
        let models = models.as_ref();
        let mf_pifu = MfPifu::load(models, settings)?;
        let vsr = if refine { Some(Vsr::load(models, settings)?) } else { None };
        Ok(Reconstructor { mf_pifu, vsr })
    }

    /// The surface of the body that the views show.
    ///
    /// The views must have been made with [`MfPifu::image`]; `region` is where the body is. `progress` is told the
    /// stage, and how many of its points are done and known to come; (0, 1) and (1, 1) where nothing is counted.
    ///
    /// # Errors
    /// [`Error::Unanswerable`] when there is no view, a view has another size, or a field never reaches its level; and
    /// whatever the graphs give.
    pub fn reconstruct(
        &mut self,
        views: &[NetworkView],
        region: &BodyRegion,
        options: &Options,
        progress: &mut dyn FnMut(Stage, u64, u64),
    ) -> Result<Reconstruction> {
        let mut seconds = Vec::new();
        let mut clock = Instant::now();
        let mut lap = |stage| {
            seconds.push((stage, clock.elapsed().as_secs_f64()));
            clock = Instant::now();
        };

        // The features live in this block alone: VSR needs their memory.
        let coarse = {
            progress(Stage::EncodeViews, 0, 1);
            let features = self.mf_pifu.encode(views)?;
            progress(Stage::EncodeViews, 1, 1);
            lap(Stage::EncodeViews);
            let cube = Cube { origin: region.origin, side: region.side };
            let level = self.mf_pifu.level();
            let mut field = self.mf_pifu.field(&features, views, region.centre)?;
            let stage = Stage::CoarseSurface;
            let surface =
                surface(&mut field, cube, level, options, &mut |done, all| progress(stage, done, all));
            lap(stage);
            surface.map_err(|error| about("the coarse field (MF-PIFu)", error))?
        };
        let Some(vsr) = &mut self.vsr else {
            return Ok(Reconstruction { coarse, refined: None, open_columns: 0, seconds });
        };

        progress(Stage::Voxelize, 0, 1);
        let cube = Cube::around(&coarse.mesh, CUBE_FILL)?;
        let voxels = voxelize(&coarse.mesh, &cube, vsr.resolution())?;
        progress(Stage::Voxelize, 1, 1);
        lap(Stage::Voxelize);

        progress(Stage::EncodeVoxels, 0, 1);
        let features = vsr.encode(&voxels)?;
        progress(Stage::EncodeVoxels, 1, 1);
        lap(Stage::EncodeVoxels);

        let level = vsr.level();
        let mut field = vsr.field(&features, &voxels, cube);
        let stage = Stage::RefinedSurface;
        let refined = surface(&mut field, cube, level, options, &mut |done, all| progress(stage, done, all))
            .map_err(|error| about("the refined field (VSR)", error))?;
        lap(stage);
        Ok(Reconstruction { coarse, refined: Some(refined), open_columns: voxels.open_columns, seconds })
    }
}

fn surface(
    field: &mut impl ImplicitField,
    cube: Cube,
    level: f32,
    options: &Options,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Surface> {
    let lattice = Lattice { cube, resolution: options.resolution };
    let (mesh, report) = implicit_field::surface(field, &lattice, level, options.mode, progress)?;
    Ok(Surface { mesh, cube, field: report })
}

/// Says which field has no answer.
fn about(what: &str, error: Error) -> Error {
    match error {
        Error::Unanswerable(message) => Error::Unanswerable(format!("{what}: {message}")),
        other => other,
    }
}

/// Loads a graph of the models folder.
fn load_graph(models: &Path, file: &str, kind: Kind, settings: &Settings) -> Result<Graph> {
    let path = models.join(file);
    if !path.exists() {
        return Err(Error::Missing {
            component: "a graph",
            message: format!("{} does not exist; name the folder of the exported graphs", path.display()),
        });
    }
    Graph::load(path, kind, settings)
}

/// Refuses a query that takes other features than its encoder gives.
fn check_channels(encoder: &Graph, given: &[usize], query: &Graph, taken: &[usize]) -> Result<()> {
    if given == taken {
        return Ok(());
    }
    Err(Error::Graph {
        path: query.session.path().to_path_buf(),
        item: "inputs \"features_1\", …".to_string(),
        message: format!(
            "they have {taken:?} channels, but {} gives {given:?}: take both graphs from one export",
            encoder.session.path().display()
        ),
    })
}

/// The largest number of points whose activations stay near 256 MB: a power of two from 256 to 16 384.
///
/// A query holds, for each view, a point's feature, the widest hidden layer and their concatenation at a time, in
/// input and output of the layer: about six numbers for each feature channel. The number depends on nothing else,
/// so that the same points are always asked in the same portions.
fn points_at_once(views: usize, channels: &[usize]) -> usize {
    let bytes_per_point = views * (channels.iter().sum::<usize>() + 1) * 6 * size_of::<f32>();
    let points = ((256 << 20) / bytes_per_point.max(1)).clamp(256, 16_384);
    1 << points.ilog2()
}

#[cfg(test)]
mod tests;

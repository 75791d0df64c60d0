//! `vitruvian voxelize`: the solid voxels of a closed mesh.

use std::path::PathBuf;

use serde_json::json;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::{self, npy};
use vitruvian_runtime::voxelize::{Cube, voxelize};

use crate::failure::{Result, about};
use crate::table;

/// The share of the cube's side that the mesh's longest side takes: the cube of VSR.
const FILL: f64 = 0.9;

/// Cut a closed mesh into solid voxels (.npy, u8 [x, y, z]: 1 inside, 0 outside)
///
/// The cube has the mesh's bounding box at its centre and 1/0.9 of its longest side: the cube that the refining network sees.
#[derive(clap::Args)]
pub struct Arguments {
    /// Closed mesh: .obj or .ply
    mesh: PathBuf,
    /// Voxels along each side of the cube
    #[arg(long, default_value_t = 128)]
    resolution: usize,
    /// File for the voxels
    #[arg(short, long)]
    out: PathBuf,
    /// Write the cube to standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Reads the mesh, cuts it and writes the voxels.
pub fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.mesh;
    let mesh = file::mesh::read(path)?;
    let cube = Cube::around(&mesh, FILL).map_err(about(path))?;
    let voxels = voxelize(&mesh, &cube, arguments.resolution).map_err(about(path))?;
    let values: Vec<u8> = voxels.values.iter().copied().collect();
    let d = arguments.resolution;
    npy::write(&arguments.out, &[d, d, d], Values::U8(&values))?;

    let inside = values.iter().filter(|&&value| value == 1).count();
    let ([x, y, z], side) = (cube.origin, cube.side);
    eprintln!(
        "origin {x} {y} {z}, side {side}, voxel {}: {inside} of {} inside",
        side / d as f64,
        values.len()
    );
    if voxels.open_columns > 0 {
        eprintln!(
            "warning: {}: the mesh is not closed: {} of {} columns of voxels leave it once less than they enter it",
            path.display(),
            voxels.open_columns,
            d * d
        );
    }
    if arguments.json {
        let result = json!({
            "origin": cube.origin, "side": side, "resolution": d, "inside": inside, "open_columns": voxels.open_columns,
        });
        table::say(&result.to_string());
    }
    Ok(())
}

//! `vitruvian mesh`: the surface on which a volume crosses a level.

use std::path::PathBuf;

use ndarray::Array3;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::{self, npy};
use vitruvian_runtime::marching_cubes::{check_level_is_reached, marching_cubes};

use crate::failure::{Failure, Result, about};
use crate::mesh_format::MeshFormat;

/// Extract the surface of a volume (.npy) by marching cubes
#[derive(clap::Args)]
pub struct Arguments {
    /// Volume [x, y, z] of numbers or truth values; inside where a value is above the level
    volume: PathBuf,
    /// The level
    #[arg(long, default_value_t = 0.5, allow_negative_numbers = true)]
    level: f32,
    /// File for the mesh: .ply, .obj or .glb
    #[arg(short, long)]
    out: PathBuf,
    /// Position of the volume's first value; vertices are in array-index units without it
    #[arg(long, value_name = "X,Y,Z", value_parser = three_numbers, allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
    /// Distance between neighbouring values (default 1)
    #[arg(long, value_parser = positive)]
    spacing: Option<f64>,
    /// Format, where the file's extension does not say it
    #[arg(long, value_enum)]
    format: Option<MeshFormat>,
}

/// Reads the volume, extracts and writes the mesh.
pub fn run(arguments: &Arguments) -> Result<()> {
    let format = MeshFormat::of(&arguments.out, arguments.format)?;
    let path = &arguments.volume;
    let array = npy::read::<f32>(path)?;
    array.check_shape(&[None; 3]).map_err(|message| Error::file(path, message))?;
    let shape = (array.shape[0], array.shape[1], array.shape[2]);
    let volume = Array3::from_shape_vec(shape, array.values)
        .map_err(|e| Error::file(path, format!("cannot be read as a volume: {e}")))?;
    if volume.is_empty() {
        return Err(
            Error::file(path, format!("has the shape {:?}, which holds no values", array.shape)).into()
        );
    }
    let mut mesh = marching_cubes(volume.view(), arguments.level).map_err(about(path))?;
    check_level_is_reached(volume.view(), arguments.level).map_err(about(path))?;
    let (origin, spacing) = (arguments.origin.unwrap_or([0.0; 3]), arguments.spacing.unwrap_or(1.0));
    for vertex in &mut mesh.vertices {
        *vertex = std::array::from_fn(|axis| (origin[axis] + spacing * f64::from(vertex[axis])) as f32);
    }
    mesh.check().map_err(|message| {
        Failure::Usage(format!("--origin and --spacing take vertices out of the range of f32: {message}"))
    })?;
    file::mesh::write(&arguments.out, format, &mesh, None)?;
    eprintln!(
        "{}: {} vertices, {} triangles",
        arguments.out.display(),
        mesh.vertices.len(),
        mesh.faces.len()
    );
    Ok(())
}

fn three_numbers(text: &str) -> std::result::Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "expected three numbers with commas between them, such as 0,-1.5,2".into())
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    number.filter(|&x| x > 0.0 && x.is_finite()).ok_or_else(|| "expected a number above 0".into())
}

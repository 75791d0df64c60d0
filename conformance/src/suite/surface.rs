//! Surfaces: the runtime's marching cubes, voxels and inside test against the reference's.
//!
//! What is discrete must be equal: the same vertices on the same lattice edges, the same triangles in the same order, the
//! same cells inside. Two exceptions follow from rounding and are decided by the reference: a vertex may be as far off as
//! f32 interpolation allows, and a point may be on either side of a surface that is nearer than the coordinates' rounding.

use ndarray::ArrayView3;
use proptest::prelude::*;
use vitruvian_reference::nn::{UNIT_ROUNDOFF_F32, gamma};
use vitruvian_reference::surface::aabb_tree::AabbTree;
use vitruvian_reference::surface::inside::Inside;
use vitruvian_reference::surface::marching_cubes::marching_cubes;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_reference::surface::voxelize::voxelize;
use vitruvian_runtime as runtime;

use crate::array::Array;
use crate::convert;
use crate::problem::values::Values;

/// A field on a lattice and a level, which is often exactly one of the values.
#[derive(Clone, Debug)]
pub struct Volume {
    /// The field; axes x, y, z, the last one fastest.
    pub values: Array,
    /// The level.
    pub level: f32,
}

/// Random volumes of up to 7 points a side: noise, and so all 256 cases and every ambiguous face.
pub fn volume() -> impl Strategy<Value = Volume> {
    let level = prop_oneof![Just(0.0_f32), Just(0.5), -1.0..1.0_f32];
    (prop::collection::vec(1..=7_usize, 3), any::<Values>(), level, any::<Option<prop::sample::Index>>())
        .prop_map(|(shape, values, level, at_a_value)| {
            let values = values.fill(&shape);
            let level = at_a_value.map_or(level, |index| *index.get(&values.values));
            Volume { values, level }
        })
}

/// Compares the two meshes of a volume.
///
/// The runtime interpolates t = (level − a)/(b − a) in f64 and rounds the coordinate i + t once to f32: u·|i + t|, and γ₈ of f64
/// on |i| + 1 for the two subtractions, the quotient and the sum, on both sides.
///
/// # Errors
/// The first difference.
pub fn judge_marching_cubes(volume: &Volume) -> Result<(), String> {
    let [nx, ny, nz] = volume.values.shape[..] else {
        return Err(format!("shape {:?} is no volume", volume.values.shape));
    };
    let exact: Vec<f64> = volume.values.values.iter().map(|&v| f64::from(v)).collect();
    let expected = marching_cubes(&exact, [nx, ny, nz], f64::from(volume.level));
    let view = ArrayView3::from_shape((nx, ny, nz), &volume.values.values).map_err(|why| why.to_string())?;
    let found = runtime::marching_cubes::marching_cubes(view, volume.level).map_err(|why| why.to_string())?;
    if found.faces != expected.faces {
        return Err(format!(
            "{} triangles, expected {}, or other ones",
            found.faces.len(),
            expected.faces.len()
        ));
    }
    if found.vertices.len() != expected.vertices.len() {
        return Err(format!("{} vertices, expected {}", found.vertices.len(), expected.vertices.len()));
    }
    for (i, (found, expected)) in found.vertices.iter().zip(&expected.vertices).enumerate() {
        for axis in 0..3 {
            let error = (f64::from(found[axis]) - expected[axis]).abs();
            let coordinate = expected[axis].abs();
            let bound = UNIT_ROUNDOFF_F32 * coordinate + gamma(8.0, f64::EPSILON / 2.0) * (coordinate + 1.0);
            if error.is_nan() || error > bound {
                return Err(format!("vertex {i} is {found:?}, expected {expected:?} ± {bound:e}"));
            }
        }
    }
    Ok(())
}

/// Random closed meshes in metres, of one or several shells: blobs out of noise, turned and moved; their coordinates are f32.
pub fn closed_mesh() -> impl Strategy<Value = runtime::mesh::Mesh> {
    let place = (prop::array::uniform3(-2.0..2.0_f32), prop::array::uniform3(-3.0..3.0_f64), 0.1..0.6_f32);
    (3..=6_usize, any::<u64>(), place).prop_filter_map(
        "an empty mesh",
        |(side, seed, (centre, turn, spacing))| {
            let noise = Values::ordinary(seed).fill(&[side; 3]);
            let values: Vec<f64> = noise.values.iter().map(|&v| f64::from(v)).collect();
            let mesh = marching_cubes(&values, [side; 3], 0.2);
            let rotation = vitruvian_reference::rotation::rodrigues(turn);
            let translation = centre.map(f64::from);
            let linear = rotation.map(|row| row.map(|x| x * f64::from(spacing)));
            (!mesh.faces.is_empty()).then(|| convert::mesh_to_runtime(&mesh.affine(&linear, translation)))
        },
    )
}

/// Whether rounding may put a point on either side: nearer to the surface than a few roundings of the largest coordinate.
fn is_undecidable(mesh: &Mesh, tree: &AabbTree, point: [f64; 3]) -> bool {
    let largest = mesh.vertices.iter().chain([&point]).flatten().fold(0.0_f64, |a, x| a.max(x.abs()));
    tree.closest(point).distance() <= 8.0 * f64::EPSILON * largest
}

/// What a comparison of solids found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Solids {
    /// Points compared.
    pub points: usize,
    /// Points inside, by the reference.
    pub inside: usize,
    /// Points that differ, all of them within rounding of the surface.
    pub undecidable: usize,
}

impl Solids {
    fn add(
        &mut self,
        mesh: &Mesh,
        tree: &AabbTree,
        point: [f64; 3],
        found: bool,
        expected: bool,
    ) -> Result<(), String> {
        self.points += 1;
        self.inside += usize::from(expected);
        if found != expected {
            if !is_undecidable(mesh, tree, point) {
                let distance = tree.closest(point).distance();
                return Err(format!(
                    "{point:?} is {found}, expected {expected}, {distance:e} m from the surface"
                ));
            }
            self.undecidable += 1;
        }
        Ok(())
    }
}

/// Compares the voxels of a mesh in the cube that it fills to nine tenths.
///
/// # Errors
/// The first cell that differs and whose centre is not within rounding of the surface.
pub fn judge_voxels(mesh: &runtime::mesh::Mesh, resolution: usize) -> Result<Solids, String> {
    let cube = runtime::voxelize::Cube::around(mesh, 0.9).map_err(|why| why.to_string())?;
    let found = runtime::voxelize::voxelize(mesh, &cube, resolution).map_err(|why| why.to_string())?;
    let (mesh, cube) = (convert::mesh_to_reference(mesh), convert::cube_to_reference(&cube));
    let expected = voxelize(&mesh, &cube, resolution);
    let tree = AabbTree::new(&mesh).ok_or("a mesh without faces")?;
    let mut solids = Solids::default();
    for (place, (found, expected)) in found.values.iter().zip(expected).enumerate() {
        let cell = [place / resolution / resolution, place / resolution % resolution, place % resolution];
        solids.add(&mesh, &tree, cube.cell_center(cell, resolution), *found == 1, expected == 1.0)?;
    }
    Ok(solids)
}

/// Compares the inside test of a mesh at points in and around its bounding box.
///
/// # Errors
/// The first point that differs and is not within rounding of the surface.
pub fn judge_inside(mesh: &runtime::mesh::Mesh, seed: u64, count: usize) -> Result<Solids, String> {
    let prepared = runtime::inside::Inside::new(mesh);
    let mesh = convert::mesh_to_reference(mesh);
    let (inside, tree) = (Inside::new(&mesh), AabbTree::new(&mesh).ok_or("a mesh without faces")?);
    let bounds = mesh.bounding_box().ok_or("a mesh without vertices")?.padded(0.1);
    let (low, extent) = (bounds.min, bounds.extent());
    let mut solids = Solids::default();
    for unit in Values::ordinary(seed).fill(&[count, 3]).values.chunks_exact(3) {
        let point: [f64; 3] = std::array::from_fn(|a| low[a] + extent[a] * (0.5 + 0.5 * f64::from(unit[a])));
        solids.add(&mesh, &tree, point, prepared.contains(point), inside.contains(point))?;
    }
    Ok(solids)
}

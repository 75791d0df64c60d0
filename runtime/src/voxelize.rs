//! Solid voxels of a mesh: 1 where a cell's centre is inside, 0 where it is outside.
//!
//! A cube is cut into D³ cells; cell (i, j, k) has its centre at origin + side·((i, j, k) + ½)/D. Its column along z
//! crosses the surface a number of times below the centre: +1 where the surface faces down, so that the column enters, and
//! −1 where it faces up. The sum is the winding number, and the centre is inside when it is not zero: as parity says of
//! a simple surface, and right as well where an arm sinks into the trunk.
//!
//! # What makes the count safe?
//! A triangle holds a column when exactly one of the two sides that span the column's y lies beyond its x. Whether a
//! side spans y is an exact comparison, and where it meets y is computed from its ends in one fixed order, so the
//! two triangles at a side always agree: no column can slip between them or be counted by both, whatever the
//! rounding. They walk the side in opposite directions, so a column of a closed mesh is left as often as it is entered. All
//! ties fall the same way: a centre exactly on the surface is inside at a lower (−x, −y, −z) face and outside at an upper one.

use ndarray::{Array3, Array5};
use serde::Serialize;

use crate::error::{Error, Result};
use crate::mesh::Mesh;

/// The finest grid: 1024³ cells are 1 GiB.
pub const MAX_RESOLUTION: usize = 1024;

/// An axis-aligned cube in the world frame, in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cube {
    /// The corner with the lowest coordinates.
    pub origin: [f64; 3],
    /// The length of an edge.
    pub side: f64,
}

impl Cube {
    /// The cube about the centre of the mesh's bounding box in which the box's longest side takes the share `fill`.
    ///
    /// VSR's cube has `fill` = 0.9: side = longest side / 0.9 (Li 2021 chapter 6 leaves it open).
    ///
    /// # Errors
    /// [`Error::Unanswerable`] when the mesh has no vertices, one of them is not finite, or all lie on one point.
    pub fn around(mesh: &Mesh, fill: f64) -> Result<Cube> {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for (index, vertex) in mesh.vertices.iter().enumerate() {
            if vertex.iter().any(|x| !x.is_finite()) {
                return Err(Error::Unanswerable(format!(
                    "vertex {index} of the mesh is {vertex:?}: not finite"
                )));
            }
            for axis in 0..3 {
                low[axis] = low[axis].min(f64::from(vertex[axis]));
                high[axis] = high[axis].max(f64::from(vertex[axis]));
            }
        }
        let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        if longest.is_nan() || longest <= 0.0 {
            return Err(Error::Unanswerable("the mesh has no extent, so no cube fits around it".to_string()));
        }
        let side = longest / fill;
        Ok(Cube { origin: std::array::from_fn(|axis| (low[axis] + high[axis] - side) / 2.0), side })
    }

    /// The normalised coordinates 2(x − origin)/side − 1 of a world point: −1..1 within the cube.
    pub fn normalize(&self, point: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| 2.0 * (point[axis] - self.origin[axis]) / self.side - 1.0)
    }
}

/// Solid voxels, and how far they can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct Voxels {
    /// 1 inside, 0 outside, indexed `[x][y][z]`, shape D × D × D.
    pub values: Array3<u8>,
    /// Columns not left as often as entered, 0 for a closed mesh; they count as outside from their last crossing on.
    pub open_columns: usize,
}

impl Voxels {
    /// The tensor a VSR encoder takes: f32, shape `[1, 1, D, H, W]` = `[1, 1, z, y, x]`.
    ///
    /// The axes turn round because `GridSample`'s first coordinate, which is x, runs along the last axis.
    pub fn to_tensor(&self) -> Array5<f32> {
        let (nx, ny, nz) = self.values.dim();
        Array5::from_shape_fn((1, 1, nz, ny, nx), |(_, _, k, j, i)| f32::from(self.values[[i, j, k]]))
    }
}

/// The solid voxels of a mesh, D = `resolution` cells along each side of the cube.
///
/// The mesh should be closed; parts beyond the cube are cut off. Where shells overlap, their common part is inside.
///
/// # Errors
/// [`Error::Unanswerable`] when the resolution is 0 or above [`MAX_RESOLUTION`], the cube has no finite positive
/// side, a vertex is not finite, or a face names a vertex that does not exist.
///
/// ```
/// use vitruvian_runtime::{mesh::Mesh, voxelize::{Cube, voxelize}};
/// let mesh = Mesh {
///     vertices: vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]],
///     faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
/// };
/// let voxels = voxelize(&mesh, &Cube { origin: [0.; 3], side: 1. }, 2)?;
/// assert_eq!(voxels.values[[0, 0, 0]], 1); // (¼, ¼, ¼) is in the tetrahedron
/// assert_eq!(voxels.values[[1, 0, 0]], 0); // (¾, ¼, ¼) is not
/// # Ok::<(), vitruvian_runtime::error::Error>(())
/// ```
pub fn voxelize(mesh: &Mesh, cube: &Cube, resolution: usize) -> Result<Voxels> {
    if !(1..=MAX_RESOLUTION).contains(&resolution) {
        return Err(Error::Unanswerable(format!(
            "voxel resolution {resolution} is out of range: choose 1 to {MAX_RESOLUTION}"
        )));
    }
    if !(cube.side.is_finite() && cube.side > 0.0 && cube.origin.iter().all(|x| x.is_finite())) {
        return Err(Error::Unanswerable(format!("the voxel cube {cube:?} has no finite positive side")));
    }
    let points = in_cell_units(mesh, cube, resolution)?;

    // crossings[(i·D + j)·(D + 1) + k] is how far the winding number rises between the column's centres k − 1 and k,
    // modulo 256: one byte tells 255 shells that coincide from none.
    let d = resolution;
    let mut crossings = vec![0_u8; d * d * (d + 1)];
    for (index, face) in mesh.faces.iter().enumerate() {
        if face.iter().any(|&v| v as usize >= points.len()) {
            return Err(Error::Unanswerable(format!(
                "face {index} of the mesh is {face:?}, but there are {} vertices",
                points.len()
            )));
        }
        mark_crossings(face.map(|v| points[v as usize]), d, &mut crossings);
    }
    Ok(fill_columns(&crossings, d))
}

/// Vertices in units in which cell centres are the integers 0..D.
fn in_cell_units(mesh: &Mesh, cube: &Cube, resolution: usize) -> Result<Vec<[f64; 3]>> {
    let scale = resolution as f64 / cube.side;
    let convert = |(index, vertex): (usize, &[f32; 3])| {
        if vertex.iter().any(|x| !x.is_finite()) {
            return Err(Error::Unanswerable(format!("vertex {index} of the mesh is {vertex:?}: not finite")));
        }
        Ok(std::array::from_fn(|axis| (f64::from(vertex[axis]) - cube.origin[axis]) * scale - 0.5))
    };
    mesh.vertices.iter().enumerate().map(convert).collect()
}

/// The first integer in 0..=limit that is ≥ x.
fn first_at_or_above(x: f64, limit: usize) -> usize {
    // The cast saturates, so anything below 0 is 0.
    (x.ceil() as usize).min(limit)
}

/// Where a side meets the plane y: its (x, z). Both triangles at the side get the same numbers, because the ends
/// are put in one order first.
fn meet(a: [f64; 3], b: [f64; 3], y: f64) -> [f64; 2] {
    let (a, b) = if a <= b { (a, b) } else { (b, a) };
    let t = (y - a[1]) / (b[1] - a[1]);
    [a[0] + t * (b[0] - a[0]), a[2] + t * (b[2] - a[2])]
}

/// Counts, in every column that the triangle holds, the crossing just below the first centre at or above it.
fn mark_crossings(triangle: [[f64; 3]; 3], d: usize, crossings: &mut [u8]) {
    let range = |axis: usize| {
        let values = triangle.map(|point| point[axis]);
        (
            values.iter().copied().fold(f64::INFINITY, f64::min),
            values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        )
    };
    let ((y_low, y_high), (z_low, z_high)) = (range(1), range(2));
    for j in first_at_or_above(y_low, d)..first_at_or_above(y_high, d) {
        let y = j as f64;
        // Going round a triangle, y is passed upwards as often as downwards: by no side, or by one side each.
        let passing = |upwards: bool| {
            let sides = (0..3).map(|at| (triangle[at], triangle[(at + 1) % 3]));
            let mut ends =
                sides.filter(|(a, b)| if upwards { a[1] <= y && b[1] > y } else { a[1] > y && b[1] <= y });
            ends.next().map(|(a, b)| meet(a, b, y))
        };
        let (Some(up), Some(down)) = (passing(true), passing(false)) else { continue };
        // Counter-clockwise from above, the side towards +y is the one at the greater x: the surface faces up.
        let (low, high, step) = if up[0] > down[0] { (down, up, u8::MAX) } else { (up, down, 1) };
        for i in first_at_or_above(low[0], d)..first_at_or_above(high[0], d) {
            let t = (i as f64 - low[0]) / (high[0] - low[0]);
            let z = (low[1] + t * (high[1] - low[1])).clamp(z_low, z_high);
            let crossing = &mut crossings[(i * d + j) * (d + 1) + first_at_or_above(z, d)];
            *crossing = crossing.wrapping_add(step);
        }
    }
}

/// Turns crossings into solid columns by adding them up from below.
fn fill_columns(crossings: &[u8], d: usize) -> Voxels {
    let mut values = Array3::zeros((d, d, d));
    let mut open_columns = 0;
    for (mut column, rises) in values.rows_mut().into_iter().zip(crossings.chunks_exact(d + 1)) {
        let open = rises.iter().fold(0_u8, |sum, &rise| sum.wrapping_add(rise)) != 0;
        open_columns += usize::from(open);
        let last = if open { rises.iter().rposition(|&rise| rise != 0) } else { None };
        let mut winding = 0_u8;
        for (k, value) in column.iter_mut().enumerate() {
            winding = if last.is_some_and(|last| k >= last) { 0 } else { winding.wrapping_add(rises[k]) };
            *value = u8::from(winding != 0);
        }
    }
    Voxels { values, open_columns }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::marching_cubes::marching_cubes;
    use ndarray::Array3;
    use proptest::prelude::*;

    const UNIT: Cube = Cube { origin: [0.0; 3], side: 1.0 };

    fn cuboid(low: [f32; 3], high: [f32; 3]) -> Mesh {
        let corner =
            |c: usize| std::array::from_fn(|axis| if c >> axis & 1 == 1 { high[axis] } else { low[axis] });
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        Mesh {
            vertices: (0..8).map(corner).collect(),
            faces: quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        }
    }

    #[test]
    fn a_box_fills_exactly_the_cells_whose_centres_it_holds() {
        let voxels = voxelize(&cuboid([0.2, 0.3, 0.4], [0.7, 0.8, 0.6]), &UNIT, 10).expect("a box");
        let expected = Array3::from_shape_fn((10, 10, 10), |(i, j, k)| {
            u8::from((2..7).contains(&i) && (3..8).contains(&j) && (4..6).contains(&k))
        });
        assert_eq!(voxels, Voxels { values: expected, open_columns: 0 });
    }

    #[test]
    fn centres_exactly_on_the_surface_are_inside_below_and_outside_above() {
        // With 8 cells, centres lie at (i + ½)/8: exact in binary.
        let (low, high) = (2.5 / 8.0, 5.5 / 8.0);
        let voxels = voxelize(&cuboid([low; 3], [high; 3]), &UNIT, 8).expect("a box");
        let expected = Array3::from_shape_fn((8, 8, 8), |(i, j, k)| {
            u8::from([i, j, k].iter().all(|x| (2..5).contains(x)))
        });
        assert_eq!(voxels, Voxels { values: expected, open_columns: 0 });
    }

    #[test]
    fn the_tensor_has_x_along_its_last_axis() {
        let voxels = voxelize(&cuboid([0.0, 0.0, 0.0], [1.0, 0.5, 0.25]), &UNIT, 4).expect("a box");
        let tensor = voxels.to_tensor();
        assert_eq!(tensor.shape(), [1, 1, 4, 4, 4]);
        assert_eq!(tensor[[0, 0, 0, 1, 3]], 1.0, "x = 3, y = 1, z = 0 is inside");
        assert_eq!(tensor[[0, 0, 3, 1, 0]], 0.0, "x = 0, y = 1, z = 3 is outside");
    }

    #[test]
    fn a_surface_beyond_the_cube_is_cut_off() {
        let voxels = voxelize(&cuboid([-3.0, 0.25, -5.0], [4.0, 2.0, 0.5]), &UNIT, 4).expect("a box");
        let expected = Array3::from_shape_fn((4, 4, 4), |(_, j, k)| u8::from(j >= 1 && k < 2));
        assert_eq!(voxels, Voxels { values: expected, open_columns: 0 });
    }

    #[test]
    fn the_overlap_of_two_shells_is_inside() {
        let (mut mesh, other) = (cuboid([0.0; 3], [0.75; 3]), cuboid([0.25; 3], [1.0; 3]));
        mesh.faces.extend(other.faces.iter().map(|face| face.map(|v| v + 8)));
        mesh.vertices.extend(other.vertices);
        let voxels = voxelize(&mesh, &UNIT, 4).expect("two boxes");
        let expected = Array3::from_shape_fn((4, 4, 4), |(i, j, k)| {
            let all = |range: std::ops::Range<usize>| [i, j, k].iter().all(|x| range.contains(x));
            u8::from(all(0..3) || all(1..4))
        });
        assert_eq!(voxels, Voxels { values: expected, open_columns: 0 });
    }

    #[test]
    fn an_open_mesh_reports_its_columns_and_fills_nothing_to_the_end() {
        let mut mesh = cuboid([0.0; 3], [1.0, 1.0, 0.5]);
        mesh.faces.truncate(10); // the lid at z = ½ is gone
        let voxels = voxelize(&mesh, &UNIT, 4).expect("an open box");
        assert_eq!(voxels.open_columns, 16);
        assert_eq!(voxels.values.sum(), 0);
    }

    #[test]
    fn the_cube_around_a_mesh_is_centred_and_filled_to_the_share() {
        let cube = Cube::around(&cuboid([1.0, 0.0, -1.0], [2.0, 1.8, 0.0]), 0.9).expect("a box");
        assert!((cube.side - 2.0).abs() < 1e-6, "longest side 1.8 / 0.9, got {}", cube.side);
        let centre = cube.origin.map(|x| x + cube.side / 2.0);
        for (found, expected) in centre.into_iter().zip([1.5, 0.9, -0.5]) {
            assert!((found - expected).abs() < 1e-6, "centre {centre:?}");
        }
        assert!(Cube::around(&Mesh::default(), 0.9).is_err(), "no vertices, no cube");
    }

    #[test]
    fn broken_meshes_and_sizes_are_refused() {
        let mut mesh = cuboid([0.2; 3], [0.7; 3]);
        assert!(voxelize(&mesh, &UNIT, 0).is_err(), "no cells");
        assert!(voxelize(&mesh, &UNIT, MAX_RESOLUTION + 1).is_err(), "too many cells");
        assert!(voxelize(&mesh, &Cube { side: 0.0, ..UNIT }, 4).is_err(), "no side");
        mesh.faces[0][1] = 8;
        assert!(voxelize(&mesh, &UNIT, 4).is_err(), "vertex 8 does not exist");
        mesh.faces[0][1] = 1;
        mesh.vertices[3][2] = f32::NAN;
        assert!(voxelize(&mesh, &UNIT, 4).is_err(), "NaN vertex");
    }

    proptest! {
        #[test]
        fn any_closed_surface_has_only_paired_crossings(
            values in proptest::collection::vec(-1.0_f32..1.0, 64),
            shift in proptest::array::uniform3(-0.5_f64..0.5),
            side in 2.0_f64..9.0,
        ) {
            let field = Array3::from_shape_vec((4, 4, 4), values).expect("64 values");
            let mesh = marching_cubes(field.view(), 0.0).expect("finite values");
            let voxels = voxelize(&mesh, &Cube { origin: shift, side }, 13).expect("a closed mesh");
            prop_assert_eq!(voxels.open_columns, 0);
        }

        #[test]
        fn cells_centred_on_lattice_points_give_the_field_back(
            values in proptest::collection::vec(prop_oneof![-1.0_f32..-0.01, 0.01_f32..1.0], 125),
        ) {
            let inner = |x: usize| (1..6).contains(&x);
            let field = Array3::from_shape_fn((7, 7, 7), |(i, j, k)| {
                if inner(i) && inner(j) && inner(k) { values[(i - 1) * 25 + (j - 1) * 5 + k - 1] } else { -1.0 }
            });
            let mesh = marching_cubes(field.view(), 0.0).expect("finite values");
            let voxels = voxelize(&mesh, &Cube { origin: [-0.5; 3], side: 7.0 }, 7).expect("a closed mesh");
            prop_assert_eq!(voxels.values, field.mapv(|value| u8::from(value > 0.0)));
        }
    }
}

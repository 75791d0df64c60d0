//! Marching cubes: the closed triangle mesh on which a sampled field crosses a level.
//!
//! A lattice point is *inside* when its value is > `level` (a value exactly at the level is outside). A cell is the
//! cube of eight neighbouring points; its eight inside bits choose the triangles (`cases`). Each lattice edge whose
//! ends differ carries one vertex, at t = (level − a)/(b − a) of the way from its lower end a to its upper end b;
//! cells that share the edge share the vertex.
//!
//! # What happens at the border?
//! Everything beyond the lattice is outside, with value −∞: a field that is inside at the border is cut off flat at
//! the outermost points (the vertices of the cut lie exactly on them), so the mesh is always closed.
//!
//! # Why one extractor for dense and sparse lattices?
//! [`marching_cubes`] only lists the active cells of an array and hands them to [`extract`]. A sparse evaluation that
//! lists the same cells therefore gives the same mesh, vertex for vertex and face for face.
//!
//! # References
//! Lorensen and Cline 1987, *Marching Cubes*; the case table is our own, see the private module `cases`.

mod cases;

use std::collections::HashMap;

use ndarray::ArrayView3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use cases::{CASES, EDGE_CORNERS};

/// A lattice whose values can be looked up point by point.
pub trait Lattice {
    /// The value at a lattice point, or `None` beyond the lattice (which counts as outside every level).
    fn value(&self, point: [i32; 3]) -> Option<f32>;
}

impl Lattice for ArrayView3<'_, f32> {
    fn value(&self, point: [i32; 3]) -> Option<f32> {
        let [i, j, k] = point.map(|index| usize::try_from(index).ok());
        self.get((i?, j?, k?)).copied()
    }
}

/// The closed mesh of {value > level} of an array `[x][y][z]`, in array-index units.
///
/// Vertices are ordered by the lower end (i, j, k) of their lattice edge, then by its axis; triangles by the lowest
/// corner of their cell, then as in the case table; both start with the surrounding layer at −1. An array with no inside point gives an empty mesh, one with no
/// outside point its bounding box; [`check_level_is_reached`] refuses both.
///
/// # Errors
/// [`Error::Unanswerable`] when a value, or the level, is not finite, or the mesh has more vertices than u32 counts.
///
/// ```
/// use ndarray::Array3;
/// use vitruvian_runtime::marching_cubes::marching_cubes;
/// let mut volume = Array3::zeros((3, 3, 3));
/// volume[[1, 1, 1]] = 1.0;
/// let mesh = marching_cubes(volume.view(), 0.5)?;
/// assert_eq!((mesh.vertices.len(), mesh.faces.len()), (6, 8)); // an octahedron
/// # Ok::<(), vitruvian_runtime::error::Error>(())
/// ```
pub fn marching_cubes(volume: ArrayView3<f32>, level: f32) -> Result<Mesh> {
    if let Some(((i, j, k), value)) = volume.indexed_iter().find(|(_, value)| !value.is_finite()) {
        return Err(Error::Unanswerable(format!(
            "the volume holds {value} at [{i}, {j}, {k}]: every value must be finite"
        )));
    }
    extract(&volume, &active_cells(volume, level), level)
}

/// Refuses a volume that lies wholly on one side of the level.
///
/// # Errors
/// [`Error::Unanswerable`] with the smallest and the largest value found.
pub fn check_level_is_reached(volume: ArrayView3<f32>, level: f32) -> Result<()> {
    let low = volume.iter().copied().fold(f32::INFINITY, f32::min);
    let high = volume.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if high > level && low <= level { Ok(()) } else { Err(level_never_reached(level, low, high)) }
}

/// The error for a field that lies wholly on one side of the level.
pub(crate) fn level_never_reached(level: f32, low: f32, high: f32) -> Error {
    let side = if high > level { "above" } else { "below" };
    Error::Unanswerable(format!(
        "level {level} is never reached: the values run from {low} to {high}, all {side} it; choose a level in between"
    ))
}

/// The cells of an array that the level crosses, scanned x-major, the layer around the array included.
///
/// Cell (i, j, k) has the corners (i..i+2, j..j+2, k..k+2); with the surrounding layer, i runs from −1 to n_x − 1.
pub(crate) fn active_cells(volume: ArrayView3<f32>, level: f32) -> Vec<[i32; 3]> {
    let (nx, ny, nz) = volume.dim();
    let beyond = vec![false; nz];
    let row = |i: i32, j: i32| -> Vec<bool> {
        if i < 0 || j < 0 || i as usize >= nx || j as usize >= ny {
            return beyond.clone();
        }
        (0..nz).map(|k| volume[[i as usize, j as usize, k]] > level).collect()
    };
    let slab = |i: i32| -> Vec<[i32; 3]> {
        let mut active = Vec::new();
        let mut low = [row(i, -1), row(i + 1, -1)];
        for j in -1..ny as i32 {
            let high = [row(i, j + 1), row(i + 1, j + 1)];
            let rows = [&low[0], &low[1], &high[0], &high[1]];
            let count = |k: usize| rows.iter().filter(|row| row[k]).count();
            let mut before = 0;
            for k in -1..nz as i32 {
                let after = if ((k + 1) as usize) < nz { count((k + 1) as usize) } else { 0 };
                if !matches!(before + after, 0 | 8) {
                    active.push([i, j, k]);
                }
                before = after;
            }
            low = high;
        }
        active
    };
    (-1..nx as i32).into_par_iter().flat_map_iter(slab).collect()
}

/// The mesh over a list of cells, in lattice-index units.
///
/// `cells` must be sorted x-major (as `[i32; 3]` sorts) and hold each cell once; cells that the level does not cross
/// cost a look-up and give nothing. The mesh is closed when every cell that the level crosses on the
/// components at hand is listed.
///
/// # Errors
/// [`Error::Unanswerable`] when the level is not finite or the mesh has more vertices than u32 counts.
pub fn extract(lattice: &impl Lattice, cells: &[[i32; 3]], level: f32) -> Result<Mesh> {
    if !level.is_finite() {
        return Err(Error::Unanswerable(format!("the level is {level}: it must be finite")));
    }
    let mut crossed: Vec<(LatticeEdge, [f32; 3])> = Vec::new();
    let mut number_of_edge: HashMap<LatticeEdge, u32> = HashMap::new();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for cell in cells {
        let corner =
            |c: u8| -> [i32; 3] { std::array::from_fn(|axis| cell[axis] + i32::from(c >> axis & 1)) };
        let values: [Option<f32>; 8] = std::array::from_fn(|c| lattice.value(corner(c as u8)));
        let is_inside = |c: u8| values[c as usize].is_some_and(|value| value > level);
        let case = (0..8).filter(|&c| is_inside(c)).fold(0, |case, c| case | 1 << c);

        let mut numbers = [0; 12];
        for (edge, [low, high]) in EDGE_CORNERS.into_iter().enumerate() {
            if is_inside(low) == is_inside(high) {
                continue;
            }
            let lattice_edge = (corner(low), edge / 4);
            let next = u32::try_from(crossed.len())
                .map_err(|_| Error::Unanswerable("the surface has more than 2³² vertices".to_string()))?;
            numbers[edge] = *number_of_edge.entry(lattice_edge).or_insert_with(|| {
                let (point, axis) = lattice_edge;
                let mut position = point.map(|index| index as f32);
                let t = crossing(values[low as usize], values[high as usize], level);
                position[axis] = (f64::from(point[axis]) + t) as f32;
                crossed.push((lattice_edge, position));
                next
            });
        }
        faces.extend(CASES[case].iter().map(|triangle| triangle.map(|edge| numbers[edge as usize])));
    }
    Ok(in_lattice_order(&crossed, faces))
}

/// A lattice edge: its lower end and its axis.
type LatticeEdge = ([i32; 3], usize);

/// Renumbers vertices by their lattice edges, so that the order in which cells met them does not show.
fn in_lattice_order(crossed: &[(LatticeEdge, [f32; 3])], mut faces: Vec<[u32; 3]>) -> Mesh {
    let mut order: Vec<u32> = (0..crossed.len() as u32).collect();
    order.sort_unstable_by_key(|&number| crossed[number as usize].0);
    let mut new_number = vec![0; crossed.len()];
    for (new, &old) in order.iter().enumerate() {
        new_number[old as usize] = new as u32;
    }
    for number in faces.iter_mut().flatten() {
        *number = new_number[*number as usize];
    }
    Mesh { vertices: order.iter().map(|&old| crossed[old as usize].1).collect(), faces }
}

/// Where the level crosses an edge, as a share of the way from its lower to its upper end; an end beyond the
/// lattice (−∞) puts the crossing on the other end.
fn crossing(low: Option<f32>, high: Option<f32>, level: f32) -> f64 {
    match (low, high) {
        (Some(low), Some(high)) => {
            let (low, high, level) = (f64::from(low), f64::from(high), f64::from(level));
            (level - low) / (high - low)
        }
        (Some(_), None) => 0.0,
        (None, _) => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;
    use proptest::prelude::*;

    /// Sides that are not matched by exactly one opposite side, and V − E + F.
    fn open_sides_and_euler_characteristic(mesh: &Mesh) -> (usize, i64) {
        let mut sides: HashMap<[u32; 2], usize> = HashMap::new();
        for [a, b, c] in mesh.faces.iter().copied() {
            for side in [[a, b], [b, c], [c, a]] {
                *sides.entry(side).or_default() += 1;
            }
        }
        let open =
            sides.iter().filter(|([a, b], count)| **count != 1 || !sides.contains_key(&[*b, *a])).count();
        (open, mesh.vertices.len() as i64 - sides.len() as i64 / 2 + mesh.faces.len() as i64)
    }

    fn signed_volume(mesh: &Mesh) -> f64 {
        let at = |index: u32| mesh.vertices[index as usize].map(f64::from);
        let six = mesh.faces.iter().map(|&[a, b, c]| {
            let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (at(a), at(b), at(c));
            ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        });
        six.sum::<f64>() / 6.0
    }

    fn ball(n: usize, radius: f32) -> Array3<f32> {
        let centre = (n - 1) as f32 / 2.0;
        Array3::from_shape_fn((n, n, n), |(i, j, k)| {
            radius - [i, j, k].iter().map(|&x| (x as f32 - centre).powi(2)).sum::<f32>().sqrt()
        })
    }

    #[test]
    fn sphere_is_closed_outward_and_has_its_volume() {
        let mesh = marching_cubes(ball(33, 12.0).view(), 0.0).expect("finite values");
        assert_eq!(open_sides_and_euler_characteristic(&mesh), (0, 2));
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 12.0_f64.powi(3);
        let volume = signed_volume(&mesh);
        // The inscribed polyhedron is smaller by about (h/r)²/4 ≈ 0.2 %.
        assert!(volume < exact && volume > 0.99 * exact, "volume {volume}, sphere {exact}");
    }

    #[test]
    fn a_full_array_gives_its_closed_box() {
        let mesh = marching_cubes(Array3::from_elem((3, 4, 5), 1.0).view(), 0.5).expect("finite values");
        assert_eq!(open_sides_and_euler_characteristic(&mesh), (0, 2));
        assert!((signed_volume(&mesh) - 24.0).abs() < 1e-9, "box 2 × 3 × 4, got {}", signed_volume(&mesh));
    }

    #[test]
    fn a_vertex_lies_where_the_line_between_the_values_meets_the_level() {
        let mut volume = Array3::zeros((3, 3, 3));
        volume[[1, 1, 1]] = 1.0;
        let mesh = marching_cubes(volume.view(), 0.25).expect("finite values");
        assert_eq!(mesh.vertices[0], [0.25, 1.0, 1.0], "a quarter of the way from 0 to 1");
    }

    #[test]
    fn a_value_at_the_level_is_outside() {
        let mesh = marching_cubes(Array3::from_elem((3, 3, 3), 0.5).view(), 0.5).expect("finite values");
        assert_eq!(mesh, Mesh::default());
        assert!(check_level_is_reached(Array3::from_elem((3, 3, 3), 0.5).view(), 0.5).is_err());
    }

    #[test]
    fn values_and_levels_that_are_not_finite_are_refused() {
        let mut volume = ball(5, 1.5);
        assert!(marching_cubes(volume.view(), f32::NAN).is_err(), "level NaN");
        volume[[0, 1, 2]] = f32::NAN;
        let message = marching_cubes(volume.view(), 0.0).expect_err("NaN inside").to_string();
        assert!(message.contains("[0, 1, 2]"), "{message}");
    }

    proptest! {
        #[test]
        fn noise_gives_a_closed_mesh_whose_edges_have_two_triangles(
            values in proptest::collection::vec(-1.0_f32..1.0, 5 * 4 * 6),
        ) {
            let volume = Array3::from_shape_vec((5, 4, 6), values).expect("120 values");
            let mesh = marching_cubes(volume.view(), 0.0).expect("finite values");
            prop_assert_eq!(open_sides_and_euler_characteristic(&mesh).0, 0);
            prop_assert!(signed_volume(&mesh) >= 0.0);
        }

        #[test]
        fn swapping_inside_and_outside_keeps_the_vertices_off_the_border(
            values in proptest::collection::vec(prop_oneof![-1.0_f32..-0.1, 0.1_f32..1.0], 27),
        ) {
            let volume = Array3::from_shape_fn((5, 5, 5), |(i, j, k)| {
                let inner = |x: usize| (1..4).contains(&x);
                if inner(i) && inner(j) && inner(k) { values[(i - 1) * 9 + (j - 1) * 3 + k - 1] } else { -1.0 }
            });
            let on_inner_edges = |sign: f32| {
                let mesh = marching_cubes((sign * &volume).view(), 0.0).expect("finite values");
                let mut inner = mesh.vertices;
                inner.retain(|v| v.iter().all(|x| *x > 0.0 && *x < 4.0));
                inner.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
                inner
            };
            prop_assert_eq!(on_inner_edges(1.0), on_inner_edges(-1.0));
        }
    }
}

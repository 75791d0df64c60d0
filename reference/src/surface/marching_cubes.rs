//! Marching cubes: the level set of a sampled field as a closed triangle mesh.
//!
//! The field is known at the points (i, j, k) of a lattice. A point is *inside* where its value is greater than
//! the level (equal counts as outside). On every lattice edge with one end inside and one outside lies one
//! vertex, where the linear interpolation of the two values meets the level:
//!
//! ```text
//! t = (level − a) / (b − a),   a at the lower end, b one step further along the axis,   vertex = lower + t·axis
//! ```
//!
//! and within each cell the vertices are joined by the triangles of [`CaseTable`].
//!
//! # Closed, always
//!
//! Beyond its border the field is taken as −∞, which is outside at every level. The vertex between a border
//! point that is inside and the nothing beyond it is the limit b → −∞ of the formula, the border point itself.
//! So a body that is cut by the border gets a flat lid in the border plane, and the mesh never leaves the box
//! of the lattice. Together with the face rule this makes every result a closed, oriented 2-manifold: each edge
//! has two triangles that run along it in opposite directions, and the triangles round each vertex form one
//! fan. Where a value equals the level, or at a lid's rim, several vertices may share one *position*; triangles
//! may have no area then, the connectivity is unaffected.
//!
//! # Order
//!
//! Another implementation can be compared vertex for vertex and triangle for triangle:
//!
//! * vertices by their edge's lower lattice point, i slowest and k fastest, then by axis x, y, z;
//! * triangles by their cell's lower corner in the same order, then as in [`CaseTable::triangles`].
//!
//! Both scans include the surrounding layer of −∞, so i, j and k start at −1.

use super::marching_cubes_tables::{CaseTable, EDGE_CORNERS};
use super::mesh::Mesh;

/// The closed surface {field = level} of a field on a lattice of `shape` = [nx, ny, nz] points, in index units.
///
/// `values[(i·ny + j)·nz + k]` is the field at point (i, j, k), and a vertex at (i, j, k) means that point; use
/// [`Mesh::affine`] for origin and spacing. Triangles are counter-clockwise seen from outside (value ≤ level).
/// Infinite values are allowed and pull the vertex to the other end of the edge (to its middle if both are
/// infinite).
///
/// # Panics
///
/// If the number of values is not nx·ny·nz, if the level is not finite, if a value is NaN, or if the lattice
/// has more edges than a `u32` can number (about 1120 points an axis).
///
/// # References
///
/// Lorensen and Cline 1987; Li 2021, chapters 5 and 6, extracts both its surfaces so.
///
/// ```
/// use vitruvian_reference::surface::{marching_cubes::marching_cubes, topology::Topology};
/// let mut values = vec![0.0; 27];
/// values[13] = 1.0; // the middle point of a 3 × 3 × 3 lattice
/// let octahedron = marching_cubes(&values, [3, 3, 3], 0.5);
/// assert_eq!((octahedron.vertices.len(), octahedron.faces.len()), (6, 8));
/// assert!(Topology::of(&octahedron).is_closed_surface());
/// ```
pub fn marching_cubes(values: &[f64], shape: [usize; 3], level: f64) -> Mesh {
    assert_eq!(
        values.len(),
        shape.iter().product::<usize>(),
        "marching cubes: {} values, but the shape is {shape:?}",
        values.len()
    );
    assert!(level.is_finite(), "marching cubes: level {level} is not finite");
    if let Some(position) = values.iter().position(|value| value.is_nan()) {
        panic!("marching cubes: value {position} of shape {shape:?} is NaN");
    }
    let lattice = Lattice { values, shape };
    assert!(
        3 * lattice.extent().iter().product::<usize>() < NO_VERTEX as usize,
        "marching cubes: a lattice of {shape:?} points has too many edges to number"
    );
    let edges = crossed_edges(&lattice, level);
    let faces = cell_triangles(&lattice, level, &edges.vertex_of);
    Mesh { vertices: edges.vertices, faces }
}

/// The field with one layer of −∞ around it; point (i, j, k) here is (i−1, j−1, k−1) of the caller's.
struct Lattice<'a> {
    values: &'a [f64],
    shape: [usize; 3],
}

impl Lattice<'_> {
    /// Points along each axis, the surrounding layer included.
    fn extent(&self) -> [usize; 3] {
        self.shape.map(|n| n + 2)
    }

    /// Number of a point in scanning order, k fastest.
    fn index(&self, point: [usize; 3]) -> usize {
        let [_, ny, nz] = self.extent();
        (point[0] * ny + point[1]) * nz + point[2]
    }

    fn value(&self, point: [usize; 3]) -> f64 {
        let [i, j, k] = point;
        let within = (0..3).all(|axis| (1..=self.shape[axis]).contains(&point[axis]));
        if within {
            self.values[((i - 1) * self.shape[1] + (j - 1)) * self.shape[2] + (k - 1)]
        } else {
            f64::NEG_INFINITY
        }
    }
}

/// One vertex for each lattice edge that crosses the level, and where to find it.
struct CrossedEdges {
    vertices: Vec<[f64; 3]>,
    /// Vertex on the edge from point p along axis a, at 3·p + a; `NO_VERTEX` where the edge is not crossed.
    vertex_of: Vec<u32>,
}

const NO_VERTEX: u32 = u32::MAX;

fn crossed_edges(lattice: &Lattice, level: f64) -> CrossedEdges {
    let [nx, ny, nz] = lattice.extent();
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    let mut vertex_of = vec![NO_VERTEX; 3 * nx * ny * nz];
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                let lower = [i, j, k];
                for axis in 0..3 {
                    let mut upper = lower;
                    upper[axis] += 1;
                    if upper[axis] == lattice.extent()[axis] {
                        continue;
                    }
                    let (a, b) = (lattice.value(lower), lattice.value(upper));
                    if (a > level) == (b > level) {
                        continue;
                    }
                    let mut vertex = lower.map(|index| index as f64 - 1.0);
                    vertex[axis] += crossing(a, b, level);
                    vertex_of[3 * lattice.index(lower) + axis] = vertices.len() as u32;
                    vertices.push(vertex);
                }
            }
        }
    }
    CrossedEdges { vertices, vertex_of }
}

/// t ∈ [0, 1] where the line from a (t = 0) to b (t = 1) meets the level that lies between them.
fn crossing(a: f64, b: f64, level: f64) -> f64 {
    match (a.is_infinite(), b.is_infinite()) {
        (true, true) => 0.5,
        (true, false) => 1.0,
        (false, true) => 0.0,
        // Halved before subtracting: b − a of two huge finite values would overflow. Exact otherwise.
        (false, false) if (b - a).is_infinite() => (level / 2.0 - a / 2.0) / (b / 2.0 - a / 2.0),
        (false, false) => (level - a) / (b - a),
    }
}

fn cell_triangles(lattice: &Lattice, level: f64, vertex_of: &[u32]) -> Vec<[u32; 3]> {
    let table = CaseTable::derive();
    let [nx, ny, nz] = lattice.extent();
    let mut faces = Vec::new();
    for i in 0..nx - 1 {
        for j in 0..ny - 1 {
            for k in 0..nz - 1 {
                let corner = |c: usize| [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)];
                let case: usize = (0..8).map(|c| usize::from(lattice.value(corner(c)) > level) << c).sum();
                for triangle in table.triangles(case) {
                    faces.push(triangle.map(|edge| {
                        let lower = corner(EDGE_CORNERS[edge][0]);
                        vertex_of[3 * lattice.index(lower) + edge / 4]
                    }));
                }
            }
        }
    }
    faces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::topology::Topology;

    /// Values of `field` at the points of a lattice.
    fn sample(shape: [usize; 3], field: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
        let [nx, ny, nz] = shape;
        (0..nx * ny * nz).map(|p| field([p / (ny * nz), p / nz % ny, p % nz].map(|i| i as f64))).collect()
    }

    #[test]
    fn a_field_below_the_level_has_no_surface() {
        assert_eq!(marching_cubes(&[0.5; 8], [2, 2, 2], 0.5), Mesh::default());
        assert_eq!(marching_cubes(&[], [0, 3, 3], 0.5), Mesh::default());
    }

    #[test]
    fn one_point_gives_an_octahedron_in_documented_order() {
        let mesh =
            marching_cubes(&sample([3, 3, 3], |p| f64::from(u8::from(p == [1.0; 3]))), [3, 3, 3], 0.25);
        // The lower ends of its edges in scanning order: (0,1,1) x, (1,0,1) y, (1,1,0) z, then (1,1,1) x, y, z.
        let near = [[0.25, 1.0, 1.0], [1.0, 0.25, 1.0], [1.0, 1.0, 0.25]];
        let far = [[1.75, 1.0, 1.0], [1.0, 1.75, 1.0], [1.0, 1.0, 1.75]];
        assert_eq!(mesh.vertices, [near, far].concat());
        assert!((mesh.signed_volume() - 4.0 / 3.0 * 0.75_f64.powi(3)).abs() < 1e-15);
    }

    #[test]
    fn a_field_inside_to_its_border_is_closed_by_flat_lids() {
        let mesh = marching_cubes(&[1.0; 24], [2, 3, 4], 0.5);
        let topology = Topology::of(&mesh);
        assert!(topology.is_closed_surface());
        assert_eq!(topology.euler_characteristic(), 2);
        assert!((mesh.signed_volume() - 6.0).abs() < 1e-14, "the box [0,1] × [0,2] × [0,3]");
        assert!((mesh.area() - 22.0).abs() < 1e-14);
    }

    #[test]
    fn the_vertex_lies_at_the_border_point_itself() {
        let mesh = marching_cubes(&[7.0], [1, 1, 1], 0.5);
        assert_eq!((mesh.vertices.len(), mesh.faces.len()), (6, 8));
        assert!(mesh.vertices.iter().all(|vertex| *vertex == [0.0; 3]));
    }

    #[test]
    fn a_linear_field_is_met_exactly_at_the_level() {
        let field = |p: [f64; 3]| 3.0 - 0.5 * p[0] - 0.7 * p[1] + 0.2 * p[2];
        let mesh = marching_cubes(&sample([6, 7, 5], field), [6, 7, 5], 0.9);
        let within = |p: [f64; 3]| p[0] < 5.0 && p[1] < 6.0 && p[2] < 4.0 && p.iter().all(|x| *x > 0.0);
        let inner: Vec<_> = mesh.vertices.iter().filter(|vertex| within(**vertex)).collect();
        assert!(inner.len() > 20);
        assert!(inner.iter().all(|vertex| (field(**vertex) - 0.9).abs() < 1e-14));
    }

    #[test]
    fn infinite_values_move_the_vertex_to_the_finite_end() {
        assert_eq!(crossing(f64::NEG_INFINITY, 2.0, 0.0), 1.0);
        assert_eq!(crossing(2.0, f64::NEG_INFINITY, 0.0), 0.0);
        assert_eq!(crossing(f64::INFINITY, f64::NEG_INFINITY, 0.0), 0.5);
        assert_eq!(crossing(-f64::MAX, f64::MAX, 0.0), 0.5);
    }

    #[test]
    #[should_panic(expected = "value 3 of shape [1, 2, 2] is NaN")]
    fn nan_is_refused() {
        marching_cubes(&[0.0, 0.0, 0.0, f64::NAN], [1, 2, 2], 0.5);
    }

    #[test]
    #[should_panic(expected = "7 values, but the shape is [2, 2, 2]")]
    fn a_wrong_shape_is_refused() {
        marching_cubes(&[0.0; 7], [2, 2, 2], 0.5);
    }
}

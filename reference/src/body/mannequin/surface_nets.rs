//! A closed mesh of an implicit surface by surface nets, mirror-symmetric in x to the last bit.
//!
//! Every lattice cell that the surface crosses gets one vertex, the mean of the crossings of its edges; every lattice
//! edge with a change of sign gets one quadrilateral, between the four cells around it. Where two sheets of the
//! surface never share a cell the result is a closed 2-manifold with well-shaped triangles: which is why the mannequin,
//! whose gaps are wider than two cells, is meshed this way. For fields of any kind see the marching cubes of
//! [`crate::surface`].
//!
//! # References
//! Gibson 1998, "Constrained Elastic Surface Nets".

use super::flesh::Flesh;
use super::skeleton::mirrored;
use crate::linalg::vector::{Vector3, add, distance, scale};

/// A symmetric triangle mesh.
pub(super) struct SymmetricMesh {
    pub(super) vertices: Vec<Vector3>,
    pub(super) faces: Vec<[u32; 3]>,
    /// For every vertex the one at its mirror image; its own on the plane x = 0.
    pub(super) mirror: Vec<usize>,
}

/// The zero level of `flesh` on a lattice of `spacing` metres.
pub(super) fn mesh(flesh: &Flesh, spacing: f64) -> SymmetricMesh {
    let [low, high] = flesh.bounds();
    // An even number of points in x puts the plane of symmetry through the middle of a layer of cells. One empty
    // layer all around closes the mesh.
    let half = (high[0] / spacing).ceil() as usize + 1;
    let count = |axis: usize| ((high[axis] - low[axis]) / spacing).ceil() as usize + 2;
    let n = [2 * half, count(1), count(2)];
    let origin = [-(half as f64 - 0.5) * spacing, low[1] - 0.5 * spacing, low[2] - 0.5 * spacing];
    let point =
        |i: [usize; 3]| -> Vector3 { std::array::from_fn(|axis| origin[axis] + spacing * i[axis] as f64) };
    let index = |i: [usize; 3]| (i[0] * n[1] + i[1]) * n[2] + i[2];

    let mut values = vec![0.0; n[0] * n[1] * n[2]];
    for i in half..n[0] {
        for j in 0..n[1] {
            for k in 0..n[2] {
                let value = flesh.distance(point([i, j, k]));
                values[index([i, j, k])] = value;
                values[index([n[0] - 1 - i, j, k])] = value;
            }
        }
    }

    let mut net = SymmetricMesh { vertices: Vec::new(), faces: Vec::new(), mirror: Vec::new() };
    let mut cells = Vec::new();
    let mut vertex_of_cell = vec![u32::MAX; values.len()];
    for i in 0..n[0] - 1 {
        for j in 0..n[1] - 1 {
            for k in 0..n[2] - 1 {
                let cell = [i, j, k];
                let corner = |bits: usize| {
                    let at = [i + (bits & 1), j + (bits >> 1 & 1), k + (bits >> 2)];
                    (point(at), values[index(at)])
                };
                if let Some(vertex) = cell_vertex(&std::array::from_fn(corner)) {
                    vertex_of_cell[index(cell)] = net.vertices.len() as u32;
                    net.vertices.push(vertex);
                    cells.push(cell);
                }
            }
        }
    }
    net.mirror =
        cells.iter().map(|&[i, j, k]| vertex_of_cell[index([n[0] - 2 - i, j, k])] as usize).collect();
    net.symmetrise();

    for i in 1..n[0] - 1 {
        for j in 1..n[1] - 1 {
            for k in 1..n[2] - 1 {
                let at = [i, j, k];
                for axis in 0..3 {
                    let mut next = at;
                    next[axis] += 1;
                    let (here, there) = (values[index(at)] < 0.0, values[index(next)] < 0.0);
                    if here == there {
                        continue;
                    }
                    let (u, w) = ((axis + 1) % 3, (axis + 2) % 3);
                    // Around the edge, counter-clockwise seen from its far end.
                    let quad = [[1, 1], [0, 1], [0, 0], [1, 0]].map(|[du, dw]: [usize; 2]| {
                        let mut cell = at;
                        cell[u] -= du;
                        cell[w] -= dw;
                        vertex_of_cell[index(cell)]
                    });
                    // Counter-clockwise from outside: the far end is outside where this end is inside.
                    let [a, b, c, d] = if here { quad } else { [quad[3], quad[2], quad[1], quad[0]] };
                    net.split([a, b, c, d].map(|v| v as usize));
                }
            }
        }
    }
    net
}

/// The mean of the sign changes along a cell's twelve edges; corners are numbered by the bits x, y, z.
fn cell_vertex(corners: &[(Vector3, f64); 8]) -> Option<Vector3> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for a in 0..8 {
        for b in [a | 1, a | 2, a | 4] {
            let ((pa, fa), (pb, fb)) = (corners[a], corners[b]);
            if a != b && (fa < 0.0) != (fb < 0.0) {
                let t = fa / (fa - fb);
                sum = add(sum, crate::linalg::vector::lerp(pa, pb, t));
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| scale(sum, 1.0 / count))
}

impl SymmetricMesh {
    /// Makes the right side the exact mirror image of the left, and puts the seam on x = 0.
    pub(super) fn symmetrise(&mut self) {
        for v in 0..self.vertices.len() {
            let m = self.mirror[v];
            if m == v {
                self.vertices[v][0] = 0.0;
            } else if self.vertices[v][0] > 0.0 {
                self.vertices[m] = mirrored(self.vertices[v]);
            }
        }
    }

    /// Adds a quadrilateral as two triangles, cut along the shorter diagonal.
    fn split(&mut self, [a, b, c, d]: [usize; 4]) {
        let length = |v: usize, w: usize| distance(self.vertices[v], self.vertices[w]);
        let triangles =
            if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        self.faces.extend(triangles.map(|t| t.map(|v| v as u32)));
    }

    /// The neighbours of every vertex, each once.
    pub(super) fn neighbours(&self) -> Vec<Vec<usize>> {
        let mut neighbours = vec![Vec::new(); self.vertices.len()];
        // On a closed oriented surface every edge is walked once in each direction.
        for face in &self.faces {
            for corner in 0..3 {
                neighbours[face[corner] as usize].push(face[(corner + 1) % 3] as usize);
            }
        }
        neighbours
    }
}

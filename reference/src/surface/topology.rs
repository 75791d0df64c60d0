//! What a mesh is, apart from its shape: closed or not, one piece or several, how many handles.
//!
//! Everything here reads the faces only. Two vertices at one position are two vertices.

use super::mesh::Mesh;

/// The counts from which closedness, orientation and the Euler characteristic follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topology {
    /// Vertices that belong to a face.
    pub vertices: usize,
    /// Edges: unordered pairs of vertices that are consecutive in a face.
    pub edges: usize,
    /// Faces.
    pub faces: usize,
    /// Edges with one face only: the border of an open mesh.
    pub boundary_edges: usize,
    /// Edges with three faces or more.
    pub non_manifold_edges: usize,
    /// Edges with two faces that both run along them in the same direction: one of the two is inside out.
    pub inconsistent_edges: usize,
    /// Vertices whose faces form more than one fan: pieces that touch in a point, like the bulbs of an hourglass.
    pub non_manifold_vertices: usize,
    /// Faces that name a vertex twice.
    pub collapsed_faces: usize,
    /// Pieces; faces belong to one piece if a chain of faces that share vertices joins them.
    pub components: usize,
}

impl Topology {
    /// Counts the parts of a mesh.
    pub fn of(mesh: &Mesh) -> Topology {
        let vertex_count = mesh.faces.iter().flatten().map(|&vertex| vertex as usize + 1).max().unwrap_or(0);
        let mut pieces = Partition::new(vertex_count);
        // Corner 3f + c is corner c of face f. Corners of one vertex that are neighbours across an edge form a
        // fan.
        let mut fans = Partition::new(3 * mesh.faces.len());
        let mut used = vec![false; vertex_count];
        let mut half_edges = Vec::with_capacity(3 * mesh.faces.len());
        for (number, face) in mesh.faces.iter().enumerate() {
            for start in 0..3 {
                let end = (start + 1) % 3;
                half_edges.push(HalfEdge::new(face, number, start, end));
                pieces.join(face[start] as usize, face[end] as usize);
                used[face[start] as usize] = true;
            }
        }
        half_edges.sort_unstable();

        let mut found = Topology {
            vertices: used.iter().filter(|&&used| used).count(),
            edges: 0,
            faces: mesh.faces.len(),
            boundary_edges: 0,
            non_manifold_edges: 0,
            inconsistent_edges: 0,
            non_manifold_vertices: 0,
            collapsed_faces: mesh.faces.iter().filter(|[a, b, c]| a == b || b == c || c == a).count(),
            components: (0..vertex_count)
                .filter(|&vertex| used[vertex] && pieces.root(vertex) == vertex)
                .count(),
        };
        for edge in half_edges.chunk_by(|a, b| a.vertices == b.vertices) {
            found.edges += 1;
            match edge {
                [_] => found.boundary_edges += 1,
                [a, b] => found.inconsistent_edges += usize::from(a.forward == b.forward),
                _ => found.non_manifold_edges += 1,
            }
            for pair in edge.windows(2) {
                for end in 0..2 {
                    fans.join(pair[0].corners[end], pair[1].corners[end]);
                }
            }
        }
        let mut fans_at = vec![0; vertex_count];
        for corner in (0..3 * mesh.faces.len()).filter(|&corner| fans.root(corner) == corner) {
            fans_at[mesh.faces[corner / 3][corner % 3] as usize] += 1;
        }
        found.non_manifold_vertices = fans_at.iter().filter(|&&fans| fans > 1).count();
        found
    }

    /// χ = V − E + F: 2 for each sphere, 0 for a torus, 2 − 2g for a closed surface with g handles.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.faces as i64
    }

    /// Whether no edge has a single face.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges == 0
    }

    /// Whether every edge has at most two faces and the faces round every vertex form one fan.
    pub fn is_manifold(&self) -> bool {
        self.non_manifold_edges == 0 && self.non_manifold_vertices == 0 && self.collapsed_faces == 0
    }

    /// Whether the two faces of every edge run along it in opposite directions.
    pub fn is_oriented(&self) -> bool {
        self.inconsistent_edges == 0
    }

    /// Whether the mesh is a closed, oriented 2-manifold; then it has a well-defined inside and volume.
    pub fn is_closed_surface(&self) -> bool {
        self.is_closed() && self.is_manifold() && self.is_oriented()
    }
}

/// One side of a face. Sorting brings the sides along one edge together.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    /// Lower vertex, higher vertex.
    vertices: [u32; 2],
    /// Whether the face runs from the lower to the higher.
    forward: bool,
    /// The face's corner at the lower vertex and at the higher.
    corners: [usize; 2],
}

impl HalfEdge {
    fn new(face: &[u32; 3], number: usize, start: usize, end: usize) -> HalfEdge {
        let forward = face[start] <= face[end];
        let (low, high) = if forward { (start, end) } else { (end, start) };
        HalfEdge {
            vertices: [face[low], face[high]],
            forward,
            corners: [3 * number + low, 3 * number + high],
        }
    }
}

/// Disjoint sets with path halving (Tarjan and van Leeuwen 1984).
struct Partition {
    parent: Vec<usize>,
}

impl Partition {
    fn new(count: usize) -> Partition {
        Partition { parent: (0..count).collect() }
    }

    fn root(&mut self, mut item: usize) -> usize {
        while self.parent[item] != item {
            self.parent[item] = self.parent[self.parent[item]];
            item = self.parent[item];
        }
        item
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        // The lower number becomes the root, so the result does not depend on the order of joining.
        self.parent[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    fn of(faces: &[[u32; 3]]) -> Topology {
        let vertex_count = faces.iter().flatten().max().map_or(0, |vertex| *vertex as usize + 1);
        Topology::of(&Mesh::new(vec![[0.0; 3]; vertex_count], faces.to_vec()))
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn a_box_is_a_sphere() {
        let topology = Topology::of(&cuboid([1.0, 2.0, 3.0]));
        assert!(topology.is_closed_surface());
        assert_eq!((topology.vertices, topology.edges, topology.faces), (8, 18, 12));
        assert_eq!((topology.euler_characteristic(), topology.components), (2, 1));
    }

    #[test]
    fn seven_vertices_make_a_torus() {
        // Möbius' torus: the complete graph on seven vertices, faces {i, i+1, i+3} and {i, i+3, i+2} modulo 7.
        let faces: Vec<[u32; 3]> =
            (0..7).flat_map(|i| [[i, (i + 1) % 7, (i + 3) % 7], [i, (i + 3) % 7, (i + 2) % 7]]).collect();
        let topology = of(&faces);
        assert!(topology.is_closed_surface());
        assert_eq!((topology.edges, topology.euler_characteristic()), (21, 0));
    }

    #[test]
    fn a_missing_face_leaves_a_border() {
        let topology = of(&TETRAHEDRON[1..]);
        assert_eq!((topology.boundary_edges, topology.is_closed(), topology.is_manifold()), (3, false, true));
    }

    #[test]
    fn a_reversed_face_is_seen() {
        let mut faces = TETRAHEDRON;
        faces[0].swap(0, 1);
        let topology = of(&faces);
        assert_eq!((topology.inconsistent_edges, topology.is_oriented()), (3, false));
    }

    #[test]
    fn a_third_face_on_an_edge_is_seen() {
        let topology = of(&[TETRAHEDRON.as_slice(), &[[0, 1, 4]]].concat());
        assert_eq!((topology.non_manifold_edges, topology.boundary_edges), (1, 2));
        assert!(!topology.is_manifold());
    }

    #[test]
    fn two_pieces_that_touch_in_a_vertex_are_seen() {
        let other = TETRAHEDRON.map(|face| face.map(|vertex| if vertex == 0 { 0 } else { vertex + 3 }));
        let topology = of(&[TETRAHEDRON, other].concat());
        assert_eq!((topology.non_manifold_vertices, topology.components), (1, 1));
        assert!(topology.is_closed() && topology.is_oriented() && !topology.is_manifold());
    }

    #[test]
    fn separate_pieces_are_counted() {
        let other = TETRAHEDRON.map(|face| face.map(|vertex| vertex + 5));
        let topology = of(&[TETRAHEDRON, other].concat());
        assert_eq!((topology.components, topology.euler_characteristic(), topology.vertices), (2, 4, 8));
    }

    #[test]
    fn a_face_that_names_a_vertex_twice_is_seen() {
        assert_eq!(of(&[[0, 1, 1]]).collapsed_faces, 1);
        assert_eq!(of(&[]).euler_characteristic(), 0);
    }
}

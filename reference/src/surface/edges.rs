//! The edges of a mesh, each with the two faces that it joins.

/// An edge between two faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Its ends, in the order in which the first face runs along it.
    pub vertices: [u32; 2],
    /// The two faces; on an oriented surface the second runs along the edge the other way.
    pub faces: [u32; 2],
}

/// All edges that belong to exactly two faces, ordered by their vertices.
///
/// A closed surface has no others: E = 3F/2. Edges at the border of an open mesh, or where three faces meet, join no pair
/// and are left out.
pub fn edges(faces: &[[u32; 3]]) -> Vec<Edge> {
    // (lower vertex, higher vertex, face, whether the face runs from the lower to the higher)
    let mut sides: Vec<(u32, u32, u32, bool)> = Vec::with_capacity(3 * faces.len());
    for (number, &[a, b, c]) in faces.iter().enumerate() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            sides.push((from.min(to), from.max(to), number as u32, from < to));
        }
    }
    sides.sort_unstable();
    let mut edges = Vec::with_capacity(sides.len() / 2);
    for group in sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if let [(low, high, first, forward), (.., second, _)] = *group {
            edges.push(Edge {
                vertices: if forward { [low, high] } else { [high, low] },
                faces: [first, second],
            });
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn a_closed_surface_has_three_edges_for_two_faces() {
        let faces = cuboid([1.0, 2.0, 3.0]).faces;
        let found = edges(&faces);
        assert_eq!(found.len(), 18);
        for edge in found {
            let [a, b] = edge.vertices;
            let runs = |face: u32, from: u32, to: u32| {
                let f = faces[face as usize];
                (0..3).any(|n| f[n] == from && f[(n + 1) % 3] == to)
            };
            assert!(runs(edge.faces[0], a, b) && runs(edge.faces[1], b, a), "{edge:?}");
        }
    }

    #[test]
    fn borders_join_no_pair() {
        assert_eq!(edges(&[[0, 1, 2], [2, 1, 3]]), [Edge { vertices: [1, 2], faces: [0, 1] }]);
        assert!(edges(&[[0, 1, 2], [2, 1, 3], [1, 2, 4]]).is_empty());
    }
}

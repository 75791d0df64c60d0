//! The 256 cases of marching cubes, derived from one rule about the faces of a cube.
//!
//! A cell of the lattice is a cube whose eight corners are inside or outside. The polygons that separate them are
//! not listed here by hand; they follow from what happens on each of the six square faces:
//!
//! > Walk round the face. Every run of consecutive inside corners is cut off by a segment of its own, from the
//! > edge by which the run is entered to the edge by which it is left.
//!
//! ```text
//!   one run, one segment        two runs, two segments: the ambiguous face
//!
//!      ○─────────○                 ○──────╲──●
//!      │         │                 │       ╲ │         ● inside   ○ outside
//!      ├─────────┤                 │         ╲
//!      │         │                 ╲         │         the inside corners stay apart,
//!      │         │                 │ ╲       │         the outside is joined between them
//!      ●─────────●                 ●──╲──────○
//! ```
//!
//! The rule reads nothing but the four corners of the face, so the two cells that share a face draw the same
//! segments on it, walked in opposite directions: the surface has no hole, whatever the field (Lorensen and
//! Cline's own table of 1987 does not have this property).
//!
//! A crossed edge belongs to two faces and is entered in one of them and left in the other. Hence "entered here ↦
//! left there" is a permutation of the crossed edges, and its cycles are the polygons.
//!
//! # Numbering
//!
//! * Corner c = x + 2y + 4z of the unit cube: bit 0 is x, bit 1 is y, bit 2 is z. Case = Σ 2ᶜ over the inside
//!   corners.
//! * Edges 0–3 run along x at (y, z) = (0,0), (1,0), (0,1), (1,1); edges 4–7 along y at (x, z) in that order;
//!   edges 8–11 along z at (x, y) in that order.
//! * Faces are walked counter-clockwise as seen from outside the cube; then the polygons are counter-clockwise
//!   as seen from the outside of the *body*, which is what [`Mesh`](super::mesh::Mesh) asks for.
//!
//! # Triangles
//!
//! The polygons of a cell come in the order of their lowest edge. Each is cut into a fan, whose apex is the
//! lowest-numbered edge of the polygon such that no diagonal of the fan joins two edges of one cube face. A
//! diagonal inside a face could coincide with one of the neighbouring cell, and four triangles would meet in
//! it; with this choice every mesh edge belongs to exactly two triangles. Such an apex exists for every polygon
//! (18 of the 358 do not accept their lowest edge), and no case needs more than five triangles.
//!
//! # References
//!
//! Lorensen and Cline 1987, "Marching cubes: a high resolution 3D surface construction algorithm"; Nielson and
//! Hamann 1991, "The asymptotic decider", for the ambiguous face (we take one of its two answers always).

/// The two corners of each edge, lower coordinate first.
pub const EDGE_CORNERS: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// The four corners of each face, counter-clockwise as seen from outside: −x, +x, −y, +y, −z, +z.
pub const FACE_CORNERS: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The triangles of each case, as edge numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaseTable {
    triangles: Vec<Vec<[usize; 3]>>,
}

impl CaseTable {
    /// Derives all 256 cases from the face rule.
    pub fn derive() -> CaseTable {
        let triangles =
            (0..256).map(|case| polygons(case).iter().flat_map(|polygon| fan(polygon)).collect()).collect();
        CaseTable { triangles }
    }

    /// Triangles of `case` as triples of edge numbers, counter-clockwise seen from outside the body.
    ///
    /// # Panics
    ///
    /// If `case` is not below 256.
    pub fn triangles(&self, case: usize) -> &[[usize; 3]] {
        assert!(case < 256, "marching cubes: case {case}, but eight corners make 256 cases");
        &self.triangles[case]
    }
}

/// The number of the edge between two corners.
fn edge_between(a: usize, b: usize) -> usize {
    let corners = [a.min(b), a.max(b)];
    EDGE_CORNERS
        .iter()
        .position(|edge| *edge == corners)
        .expect("consecutive corners of a face share an edge")
}

/// For every crossed edge, the edge that follows it round its polygon.
fn successors(case: usize) -> [Option<usize>; 12] {
    let inside = |corner: usize| case >> corner & 1 == 1;
    let mut successor = [None; 12];
    for face in FACE_CORNERS {
        for start in 0..4 {
            let (before, first) = (face[start], face[(start + 1) % 4]);
            if inside(before) || !inside(first) {
                continue;
            }
            // `first` opens a run of inside corners; follow it to the corner after its last.
            let mut end = (start + 2) % 4;
            while inside(face[end]) {
                end = (end + 1) % 4;
            }
            let last = face[(end + 3) % 4];
            successor[edge_between(before, first)] = Some(edge_between(last, face[end]));
        }
    }
    successor
}

/// The closed polygons of a case, each as edge numbers in order, starting at its lowest edge.
pub fn polygons(case: usize) -> Vec<Vec<usize>> {
    let mut successor = successors(case);
    let mut polygons = Vec::new();
    for start in 0..12 {
        let mut polygon = Vec::new();
        let mut edge = start;
        while let Some(next) = successor[edge].take() {
            polygon.push(edge);
            edge = next;
        }
        if !polygon.is_empty() {
            polygons.push(polygon);
        }
    }
    polygons
}

/// Whether two edges lie in one face of the cube.
fn share_a_face(a: usize, b: usize) -> bool {
    let lies_in =
        |edge: usize, face: &[usize; 4]| EDGE_CORNERS[edge].iter().all(|corner| face.contains(corner));
    FACE_CORNERS.iter().any(|face| lies_in(a, face) && lies_in(b, face))
}

/// Cuts a polygon into a fan whose diagonals run through the inside of the cube.
fn fan(polygon: &[usize]) -> Vec<[usize; 3]> {
    let n = polygon.len();
    let at = |apex: usize, step: usize| polygon[(apex + step) % n];
    let apex = (0..n)
        .filter(|&apex| (2..n - 1).all(|step| !share_a_face(polygon[apex], at(apex, step))))
        .min_by_key(|&apex| polygon[apex])
        .expect("every polygon of the face rule has a fan that avoids the faces");
    (1..n - 1).map(|step| [polygon[apex], at(apex, step), at(apex, step + 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_join_corners_that_differ_in_one_coordinate() {
        for (edge, [a, b]) in EDGE_CORNERS.into_iter().enumerate() {
            assert_eq!(a ^ b, 1 << (edge / 4), "edge {edge} runs along axis {}", edge / 4);
            assert_eq!(a & b, a, "edge {edge} starts at its lower corner");
        }
    }

    #[test]
    fn one_inside_corner_is_cut_off_by_one_outward_triangle() {
        // Corner 0 inside: from x to y to z is counter-clockwise seen from (1, 1, 1).
        assert_eq!(CaseTable::derive().triangles(1), [[0, 4, 8]]);
    }

    #[test]
    fn the_lower_half_inside_gives_one_square_facing_up() {
        // Corners 0–3 (z = 0) inside: the four z edges, counter-clockwise seen from above.
        assert_eq!(polygons(0b0000_1111), vec![vec![8, 9, 11, 10]]);
    }

    #[test]
    fn two_inside_corners_on_a_face_diagonal_stay_apart() {
        assert_eq!(polygons(0b0000_1001).len(), 2);
        // Seen from the other side the same face joins the outside: one tunnel instead of two caps.
        let tunnel = polygons(0b1111_0110);
        assert_eq!(tunnel.len(), 1);
        assert_eq!(tunnel[0].len(), 6);
    }

    #[test]
    fn polygons_use_exactly_the_crossed_edges_once() {
        for case in 0..256_usize {
            let mut used = polygons(case).concat();
            used.sort_unstable();
            let crossed: Vec<usize> = (0..12)
                .filter(|&edge| {
                    let [a, b] = EDGE_CORNERS[edge];
                    (case >> a & 1) != (case >> b & 1)
                })
                .collect();
            assert_eq!(used, crossed, "case {case}");
        }
    }

    #[test]
    fn no_diagonal_lies_in_a_cube_face() {
        let table = CaseTable::derive();
        let (mut polygon_count, mut not_lowest, mut most) = (0, 0, 0);
        for case in 0..256 {
            most = most.max(table.triangles(case).len());
            for polygon in polygons(case) {
                polygon_count += 1;
                let triangles = fan(&polygon);
                not_lowest += usize::from(triangles[0][0] != polygon[0]);
                for diagonal in triangles.windows(2).map(|pair| [pair[1][0], pair[1][1]]) {
                    assert!(!share_a_face(diagonal[0], diagonal[1]), "case {case}: diagonal {diagonal:?}");
                }
            }
        }
        assert_eq!((polygon_count, not_lowest, most), (358, 18, 5));
    }
}

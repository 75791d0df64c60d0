//! Which points lie inside a closed mesh: the winding number along one axis, for many points fast.

use rayon::prelude::*;

use crate::mesh::Mesh;

/// A closed mesh prepared for inside tests.
///
/// The vertical line through a point crosses the surface upwards of it; a crossing counts +1 where the surface faces up
/// and −1 where it faces down, so the sum is the winding number. A point is inside where it is not zero: as
/// parity would say of a simple surface, and right as well where limbs run into each other.
///
/// # Conventions
/// "Up" is +z. The test of a line against a triangle's outline uses each edge from its lower to its higher vertex
/// number, so that two triangles sharing the edge decide alike and no line slips between them.
pub struct Inside {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    origin: [f64; 2],
    cell: [f64; 2],
    /// Cell c holds faces `members[starts[c]..starts[c + 1]]`; cells are numbered x + SIDE·y.
    starts: Vec<u32>,
    members: Vec<u32>,
}

/// Cells along each side of the grid that sorts triangles: about as many as there are columns of triangles.
const SIDE: usize = 128;

impl Inside {
    /// Sorts the triangles of `mesh` by the columns that they cover.
    pub fn new(mesh: &Mesh) -> Inside {
        let vertices: Vec<[f64; 3]> = mesh.vertices.iter().map(|v| v.map(f64::from)).collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for v in &vertices {
            for axis in 0..2 {
                low[axis] = low[axis].min(v[axis]);
                high[axis] = high[axis].max(v[axis]);
            }
        }
        let cell = [0, 1].map(|a| ((high[a] - low[a]) / SIDE as f64).max(f64::MIN_POSITIVE));
        let mut inside = Inside {
            vertices,
            faces: mesh.faces.clone(),
            origin: low,
            cell,
            starts: vec![0; SIDE * SIDE + 1],
            members: Vec::new(),
        };
        let covered: Vec<[usize; 4]> = inside.faces.iter().map(|face| inside.cells_of(face)).collect();
        let each =
            |[x0, x1, y0, y1]: [usize; 4]| (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| x + SIDE * y));
        for &range in &covered {
            each(range).for_each(|c| inside.starts[c + 1] += 1);
        }
        for c in 0..SIDE * SIDE {
            inside.starts[c + 1] += inside.starts[c];
        }
        let mut next = inside.starts.clone();
        inside.members = vec![0; inside.starts[SIDE * SIDE] as usize];
        for (f, &range) in covered.iter().enumerate() {
            for c in each(range) {
                inside.members[next[c] as usize] = f as u32;
                next[c] += 1;
            }
        }
        inside
    }

    /// Whether `point` lies inside.
    pub fn contains(&self, point: [f64; 3]) -> bool {
        let Some(cell) = self.cell_of(point) else { return false };
        let members = &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        members.iter().map(|&f| self.crossing(self.faces[f as usize], point)).sum::<i32>() != 0
    }

    /// [`Inside::contains`] for many points, on every core.
    pub fn contains_all(&self, points: &[[f32; 3]]) -> Vec<bool> {
        points.par_iter().map(|p| self.contains(p.map(f64::from))).collect()
    }

    fn cell_of(&self, point: [f64; 3]) -> Option<usize> {
        let index = |a: usize| {
            let t = (point[a] - self.origin[a]) / self.cell[a];
            (t >= 0.0 && t <= SIDE as f64).then(|| (t as usize).min(SIDE - 1))
        };
        Some(index(0)? + SIDE * index(1)?)
    }

    /// First and last cell in x and in y that a face's outline covers, one more each side against rounding.
    fn cells_of(&self, face: &[u32; 3]) -> [usize; 4] {
        let range = |a: usize| {
            let values = face.map(|i| (self.vertices[i as usize][a] - self.origin[a]) / self.cell[a]);
            let low = values.into_iter().fold(f64::INFINITY, f64::min);
            let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            [((low - 1e-6).max(0.0) as usize).min(SIDE - 1), ((high + 1e-6).max(0.0) as usize).min(SIDE - 1)]
        };
        let ([x0, x1], [y0, y1]) = (range(0), range(1));
        [x0, x1, y0, y1]
    }

    /// +1 or −1 if the vertical line through `p` crosses the face above p, else 0.
    fn crossing(&self, face: [u32; 3], p: [f64; 3]) -> i32 {
        let edges = [[0, 1], [1, 2], [2, 0]].map(|[a, b]| self.side(face[a], face[b], p));
        let up = edges.iter().all(|&(positive, _)| positive);
        let down = edges.iter().all(|&(positive, _)| !positive);
        if !up && !down {
            return 0;
        }
        // The twice-areas of the three sub-triangles are the barycentric weights of the opposite corners.
        let total: f64 = edges.iter().map(|&(_, area)| area).sum();
        if total == 0.0 {
            return 0;
        }
        let z = |i: usize| self.vertices[face[i] as usize][2];
        let height = (edges[1].1 * z(0) + edges[2].1 * z(1) + edges[0].1 * z(2)) / total;
        if height <= p[2] {
            return 0;
        }
        if up { 1 } else { -1 }
    }

    /// On which side of the edge a→b, seen from above, the point lies (left is `true`), and twice the signed area.
    fn side(&self, a: u32, b: u32, p: [f64; 3]) -> (bool, f64) {
        let (low, high) = (a.min(b), a.max(b));
        let (u, v) = (self.vertices[low as usize], self.vertices[high as usize]);
        let area = (v[0] - u[0]) * (p[1] - u[1]) - (v[1] - u[1]) * (p[0] - u[0]);
        let left = area > 0.0 || (area == 0.0 && tie(u, v));
        if a < b { (left, area) } else { (!left, -area) }
    }
}

/// A point on an edge's line counts as moved by an infinitesimal step to +x, then (if the edge runs along x) to +y.
fn tie(u: [f64; 3], v: [f64; 3]) -> bool {
    let (dx, dy) = (v[0] - u[0], v[1] - u[1]);
    if dy == 0.0 { dx > 0.0 } else { dy < 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An octahedron with vertices at distance 1: inside is |x| + |y| + |z| < 1.
    fn octahedron(centre: [f32; 3]) -> Mesh {
        let corners = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        let vertices =
            corners.map(|c: [i8; 3]| std::array::from_fn(|k| f32::from(c[k]) + centre[k])).to_vec();
        let faces =
            vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        Mesh { vertices, faces }
    }

    fn merged(a: &Mesh, b: &Mesh) -> Mesh {
        let first = a.vertices.len() as u32;
        Mesh {
            vertices: [a.vertices.clone(), b.vertices.clone()].concat(),
            faces: a.faces.iter().copied().chain(b.faces.iter().map(|f| f.map(|i| i + first))).collect(),
        }
    }

    fn lattice() -> impl Iterator<Item = [f64; 3]> {
        // Multiples of 1/8 meet vertices, edges and faces of the octahedron exactly.
        (0..29 * 29 * 29).map(|i| [i % 29, i / 29 % 29, i / 841].map(|k| (f64::from(k) - 14.0) / 8.0))
    }

    #[test]
    fn octahedron_contains_what_its_equation_says_even_through_vertices_and_edges() {
        let inside = Inside::new(&octahedron([0.0; 3]));
        for p in lattice() {
            let sum: f64 = p.iter().map(|c| c.abs()).sum();
            if (sum - 1.0).abs() > 1e-9 {
                assert_eq!(inside.contains(p), sum < 1.0, "{p:?}");
            }
        }
    }

    #[test]
    fn overlap_of_two_bodies_is_inside() {
        let (a, b) = (octahedron([0.0; 3]), octahedron([0.5, 0.0, 0.0]));
        let (one, two, both) = (Inside::new(&a), Inside::new(&b), Inside::new(&merged(&a, &b)));
        for p in lattice().map(|p| p.map(|c| c + 0.013)) {
            assert_eq!(both.contains(p), one.contains(p) || two.contains(p), "{p:?}");
        }
    }

    #[test]
    fn many_points_agree_with_one() {
        let inside = Inside::new(&octahedron([0.0; 3]));
        let points: Vec<[f32; 3]> = lattice().map(|p| p.map(|c| c as f32)).collect();
        let all = inside.contains_all(&points);
        for (p, &found) in points.iter().zip(&all) {
            assert_eq!(found, inside.contains(p.map(f64::from)));
        }
    }

    /// Σ_f Ω_f / 4π with the solid angle of van Oosterom and Strackee (1983): an independent winding number.
    fn solid_angle_winding(mesh: &Mesh, p: [f64; 3]) -> f64 {
        let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let angle = |face: &[u32; 3]| {
            let corner = |i: u32| -> [f64; 3] {
                std::array::from_fn(|k| f64::from(mesh.vertices[i as usize][k]) - p[k])
            };
            let [a, b, c] = face.map(corner);
            let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
            let (la, lb, lc) = (dot(&a, &a).sqrt(), dot(&b, &b).sqrt(), dot(&c, &c).sqrt());
            let below = la * lb * lc + dot(&a, &b) * lc + dot(&b, &c) * la + dot(&c, &a) * lb;
            2.0 * dot(&a, &cross).atan2(below)
        };
        mesh.faces.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
    }

    /// A torus whose tube is hollow where a ball with inward faces sits in it.
    fn hollow_torus() -> Mesh {
        let (n, m) = (16u32, 10u32);
        let mut mesh = Mesh::default();
        for i in 0..n {
            for j in 0..m {
                let (s, c) = (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
                let (t, d) = (std::f32::consts::TAU * j as f32 / m as f32).sin_cos();
                mesh.vertices.push([(1.0 + 0.4 * d) * c, (1.0 + 0.4 * d) * s, 0.4 * t]);
                let at = |i: u32, j: u32| (i % n) * m + j % m;
                mesh.faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        let ball = crate::mesh::tests::sphere(0.2, [1.0, 0.0, 0.0], 5);
        let reversed = Mesh { faces: ball.faces.iter().map(|f| [f[0], f[2], f[1]]).collect(), ..ball };
        merged(&mesh, &reversed)
    }

    #[test]
    fn a_hollow_torus_agrees_with_solid_angles_on_a_hundred_thousand_points() {
        let mesh = hollow_torus();
        // Roberts' low-discrepancy sequence: powers of the root of g⁴ = g + 1.
        let g = 1.220_744_084_605_759_5_f64;
        let point = |i: u32| [1, 2, 3].map(|k| (3.0 * (0.5 + f64::from(i) / g.powi(k)).fract() - 1.5) as f32);
        let points: Vec<[f32; 3]> = (0..100_000).map(point).collect();
        let found = Inside::new(&mesh).contains_all(&points);
        let truth: Vec<bool> =
            points.par_iter().map(|p| solid_angle_winding(&mesh, p.map(f64::from)) > 0.5).collect();
        let wrong = found.iter().zip(&truth).filter(|(a, b)| a != b).count();
        assert_eq!(wrong, 0);
        assert!(truth.iter().filter(|&&inside| inside).count() > 5_000);
    }

    #[test]
    fn no_mesh_and_no_number_contain_nothing() {
        assert!(!Inside::new(&Mesh::default()).contains([0.0; 3]));
        let inside = Inside::new(&octahedron([0.0; 3]));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
            assert!(!inside.contains([bad, 0.0, 0.0]) && !inside.contains([0.0, bad, 0.0]));
        }
    }
}

//! What a marched surface is, apart from its shape: pieces, handles, enclosed volumes.

use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_reference::surface::topology::Topology;

use super::report::TopologyReport;

impl TopologyReport {
    /// The counts of a closed surface, as marching cubes makes them; its Betti numbers over ℤ/2.
    ///
    /// Each piece is connected and closed, so that b₀ = b₂ is the number of pieces, and χ = b₀ − b₁ + b₂ leaves
    /// b₁ = 2b₀ − χ = 2g.
    ///
    /// # Panics
    /// When the mesh is not closed.
    pub fn of(mesh: &Mesh) -> Self {
        let topology = Topology::of(mesh);
        assert!(topology.is_closed(), "a surface with {} open edges", topology.boundary_edges);
        let (components, euler) = (topology.components, topology.euler_characteristic());
        Self {
            vertices: topology.vertices,
            faces: topology.faces,
            components,
            euler,
            betti_1: 2 * components as i64 - euler,
            betti_2: components,
        }
    }

    /// Whether the two are the same surface but for their shape: equal Betti numbers.
    pub fn same_surface(&self, other: &Self) -> bool {
        (self.components, self.betti_1, self.betti_2) == (other.components, other.betti_1, other.betti_2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::surface::marching_cubes::marching_cubes;

    /// The surface of the lattice points that `solid` says are inside.
    fn surface(solid: impl Fn(i32, i32, i32) -> bool) -> TopologyReport {
        let places = (0..7 * 7 * 7).map(|place| [place / 49, place / 7 % 7, place % 7]);
        let values: Vec<f64> = places.map(|[i, j, k]| f64::from(u8::from(solid(i, j, k)))).collect();
        TopologyReport::of(&marching_cubes(&values, [7; 3], 0.5))
    }

    #[test]
    fn a_ball_a_ring_two_balls_and_a_shell() {
        let numbers = |t: TopologyReport| (t.components, t.betti_1, t.betti_2, t.euler);
        let ball = surface(|i, j, k| (2..5).contains(&i) && (2..5).contains(&j) && (2..5).contains(&k));
        assert_eq!(numbers(ball), (1, 0, 1, 2));
        let ring =
            surface(|i, j, k| k == 3 && (1..6).contains(&i) && (1..6).contains(&j) && !(i == 3 && j == 3));
        assert_eq!(numbers(ring), (1, 2, 1, 0));
        let two = surface(|i, j, k| (i == 1 || i == 5) && j == 3 && k == 3);
        assert_eq!(numbers(two), (2, 0, 2, 4));
        let hollow =
            surface(|i, j, k| [i, j, k].iter().all(|x| (1..6).contains(x)) && [i, j, k] != [3, 3, 3]);
        assert_eq!(numbers(hollow), (2, 0, 2, 4), "an outer and an inner sphere");
        assert!(ball.same_surface(&ball) && !ball.same_surface(&ring) && two.same_surface(&hollow));
    }

    #[test]
    fn nothing_is_no_piece() {
        let nothing = surface(|_, _, _| false);
        assert_eq!((nothing.components, nothing.betti_1, nothing.euler), (0, 0, 0));
    }
}

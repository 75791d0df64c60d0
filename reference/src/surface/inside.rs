//! Which points are inside a closed mesh.

use super::mesh::Mesh;
use super::ray_crossings::RayCrossings;
use crate::linalg::vector::Vector3;
use std::sync::OnceLock;

/// How many directions are tried before a point is said to lie on the surface.
const DIRECTIONS: usize = 4;

/// A closed mesh prepared for containment queries.
///
/// The winding number of the surface round a point is counted along a ray: every triangle that the ray leaves
/// the body by counts +1, every one by which it enters −1. Where the ray passes a triangle's edge, or the point
/// a triangle's plane, more closely than rounding can decide, the count is given up and taken along another
/// direction; a count that is not given up is exact (see the module `ray_crossings`). The slopes of the
/// directions are fractional parts of square roots of primes, so that rays from lattice points do not run along
/// the edges of meshes made on lattices.
///
/// # Conventions
///
/// * Inside is where the winding number is *not zero*. So the overlap of two pieces (an arm that sinks into the
///   trunk) is inside, as it is for a body, where the even–odd rule would call it outside; and a mesh that is
///   inside out has the same inside. A cavity needs a wall that faces it, as every oriented mesh has.
/// * A point for which every direction is too close to call lies on the surface, to rounding. It counts as
///   outside, as a value equal to the level does in marching cubes.
/// * For a mesh with holes the answer depends on where the rays happen to leave it; use
///   [`winding_number`](super::winding_number::winding_number) > ½ there.
///
/// ```
/// use vitruvian_reference::surface::{inside::Inside, mesh::Mesh};
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let tetrahedron = Mesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
/// let inside = Inside::new(&tetrahedron);
/// assert!(inside.contains([0.2, 0.2, 0.2]));
/// assert!(!inside.contains([0.4, 0.4, 0.4]));
/// ```
pub struct Inside<'a> {
    mesh: &'a Mesh,
    /// Prepared when first needed: most meshes never need the second.
    rays: [OnceLock<RayCrossings>; DIRECTIONS],
}

impl<'a> Inside<'a> {
    /// Prepares a mesh; takes time proportional to its faces.
    pub fn new(mesh: &'a Mesh) -> Inside<'a> {
        Inside { mesh, rays: [const { OnceLock::new() }; DIRECTIONS] }
    }

    /// Whether a point is inside.
    pub fn contains(&self, point: Vector3) -> bool {
        self.winding(point) != 0
    }

    /// How often the surface winds round a point; 0 on the surface.
    pub fn winding(&self, point: Vector3) -> i32 {
        (0..DIRECTIONS)
            .find_map(|direction| {
                let rays =
                    self.rays[direction].get_or_init(|| RayCrossings::new(self.mesh, slopes(direction)));
                let sheared = rays.shear(point);
                rays.winding(&rays.crossings(sheared)?, sheared)
            })
            .unwrap_or(0)
    }
}

/// Slopes of a direction against the z axis.
fn slopes(direction: usize) -> [f64; 2] {
    const PRIMES: [[f64; 2]; DIRECTIONS] = [[2.0, 3.0], [5.0, 7.0], [11.0, 13.0], [17.0, 19.0]];
    const QUADRANTS: [[f64; 2]; DIRECTIONS] = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
    [0, 1].map(|axis| QUADRANTS[direction][axis] * PRIMES[direction][axis].sqrt().fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn a_box_contains_what_lies_between_its_sides() {
        let mesh = cuboid([1.0, 2.0, 3.0]);
        let inside = Inside::new(&mesh);
        for (point, expected) in [
            ([0.5, 1.0, 1.5], 1),
            ([1e-9, 1e-9, 1e-9], 1),
            ([1.0 - 1e-9, 2.0 - 1e-9, 3.0 - 1e-9], 1),
            ([-1e-9, 1.0, 1.5], 0),
            ([0.5, 1.0, 3.0 + 1e-9], 0),
            ([0.5, 1.0, -50.0], 0),
        ] {
            assert_eq!(inside.winding(point), expected, "{point:?}");
        }
    }

    #[test]
    fn a_ray_through_an_edge_is_cast_again() {
        // Chosen so that the first direction from the point passes exactly through a corner of the box.
        let mesh = cuboid([1.0, 1.0, 1.0]);
        let [s, t] = slopes(0);
        let point = [1.0 - 0.5 * s, 1.0 - 0.5 * t, 0.5];
        let rays = RayCrossings::new(&mesh, slopes(0));
        assert!(rays.crossings(rays.shear(point)).is_none());
        assert!(Inside::new(&mesh).contains(point));
    }

    #[test]
    fn the_surface_itself_is_outside() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        let inside = Inside::new(&mesh);
        for point in [[0.0; 3], [1.0, 0.5, 0.0], [0.25, 0.5, 1.0], [0.5, 0.5, 0.0]] {
            assert!(!inside.contains(point), "{point:?}");
        }
    }

    #[test]
    fn an_overlap_is_inside_and_a_cavity_is_outside() {
        let outer = cuboid([3.0, 3.0, 3.0]);
        let join = |a: &Mesh, b: &Mesh| {
            let shift = a.vertices.len() as u32;
            let moved = b.faces.iter().map(|face| face.map(|vertex| vertex + shift));
            Mesh::new(
                [a.vertices.clone(), b.vertices.clone()].concat(),
                a.faces.iter().copied().chain(moved).collect(),
            )
        };
        let other = cuboid([1.0, 1.0, 1.0]).affine(&matrix::IDENTITY, [1.0, 1.0, 1.0]);
        assert_eq!(Inside::new(&join(&outer, &other)).winding([1.3, 1.4, 1.5]), 2);
        let cavity = Mesh { faces: other.faces.iter().map(|&[a, b, c]| [a, c, b]).collect(), ..other };
        let hollow = join(&outer, &cavity);
        assert_eq!([1.3, 0.5].map(|x| Inside::new(&hollow).contains([x, 1.4, 1.5])), [false, true]);
    }

    #[test]
    fn nothing_is_inside_an_empty_mesh() {
        assert!(!Inside::new(&Mesh::default()).contains([0.0; 3]));
    }
}

//! Which triangles a ray crosses, decided without rounding error or not at all.
//!
//! All rays run along one direction d = (s, t, 1). The mesh is sheared along it,
//!
//! ```text
//! (x, y, z) ↦ (u, v, w) = (x − s·z, y − t·z, z),
//! ```
//!
//! which turns the rays into parallels of the w axis and changes nothing about what is inside what. A ray is
//! then a point (u, v) of a plane, and the triangles whose shadow on that plane may cover it are found in a
//! grid of bins.
//!
//! Two determinants decide everything: on which side of a shadow's edge the ray passes ([`orient2d`]) and
//! whether the triangle lies above or below the point ([`orient3d`]). Each is computed with a bound on its
//! rounding error; if its sign is not certain, the answer is "too close to call" and the caller takes another
//! direction. A certain answer is the exact one for the sheared vertices, which all triangles around them
//! share, so no ray can slip through an edge.
//!
//! # References
//!
//! Shewchuk 1997, "Adaptive precision floating-point arithmetic and fast robust geometric predicates", the
//! first stage of both predicates.

use super::bounding_box::BoundingBox;
use super::mesh::Mesh;
use crate::linalg::vector::{Vector3, cross, dot, sub};

/// Half an ulp of 1: the unit roundoff of f64.
const U: f64 = f64::EPSILON / 2.0;
/// Error of [`orient2d`] relative to the sum of its two products' magnitudes (Shewchuk's A-bound).
const ORIENT_2D_BOUND: f64 = (3.0 + 16.0 * U) * U;
/// Error of [`orient3d`] relative to the sum of its six products' magnitudes (Shewchuk's A-bound).
const ORIENT_3D_BOUND: f64 = (7.0 + 56.0 * U) * U;

/// A mesh prepared for rays along one direction.
pub(super) struct RayCrossings {
    slopes: [f64; 2],
    /// Sheared corners.
    triangles: Vec<[Vector3; 3]>,
    bins: Bins,
}

/// A triangle that the ray's line crosses.
pub(super) struct Crossing {
    triangle: usize,
    /// +1 if its shadow is counter-clockwise seen against the ray: there the ray leaves the body. −1 where it
    /// enters.
    sign: i32,
}

impl RayCrossings {
    /// Prepares rays along (s, t, 1), s and t being the two slopes.
    pub(super) fn new(mesh: &Mesh, slopes: [f64; 2]) -> RayCrossings {
        let triangles: Vec<_> = mesh.triangles().map(|corners| corners.map(|p| shear(slopes, p))).collect();
        let bins = Bins::new(&triangles);
        RayCrossings { slopes, triangles, bins }
    }

    /// Image of a point under the shear; its first two coordinates name the ray through it.
    pub(super) fn shear(&self, point: Vector3) -> Vector3 {
        shear(self.slopes, point)
    }

    /// Triangles crossed by the whole line through a sheared point; none if it grazes one too closely to call.
    pub(super) fn crossings(&self, point: Vector3) -> Option<Vec<Crossing>> {
        let mut found = Vec::new();
        for &triangle in self.bins.at(point) {
            let [a, b, c] = self.triangles[triangle];
            if !shadow(&[a, b, c]).contains([point[0], point[1], 0.0]) {
                continue;
            }
            let sides = [orient2d(a, b, point), orient2d(b, c, point), orient2d(c, a, point)];
            if sides.contains(&Some(1)) && sides.contains(&Some(-1)) {
                continue;
            }
            let sign = sides[0]?;
            sides[1]?;
            sides[2]?;
            found.push(Crossing { triangle, sign });
        }
        Some(found)
    }

    /// Winding number at a sheared point, from the crossings of its line: the sum of the signs above it.
    ///
    /// Every turn of the surface round the point must be left once more than it is entered on the way to
    /// infinity. None if the point is too close to a triangle to call.
    pub(super) fn winding(&self, crossings: &[Crossing], point: Vector3) -> Option<i32> {
        let mut winding = 0;
        for crossing in crossings {
            let [a, b, c] = self.triangles[crossing.triangle];
            let below = orient3d(a, b, c, point)? * crossing.sign > 0;
            winding += if below { crossing.sign } else { 0 };
        }
        Some(winding)
    }
}

fn shear([s, t]: [f64; 2], [x, y, z]: Vector3) -> Vector3 {
    [x - s * z, y - t * z, z]
}

/// Smallest rectangle around a sheared triangle seen along w; its third coordinate is 0.
fn shadow(triangle: &[Vector3; 3]) -> BoundingBox {
    let flat = triangle.map(|[u, v, _]| [u, v, 0.0]);
    BoundingBox::around(flat).expect("a triangle has corners")
}

/// The sign of a value known up to `bound`; none if it could be either.
fn certain_sign(value: f64, bound: f64) -> Option<i32> {
    if value > bound {
        Some(1)
    } else if value < -bound {
        Some(-1)
    } else {
        None
    }
}

/// Sign of (a − p) × (b − p) in the (u, v) plane: +1 if p lies to the left of the line from a to b.
fn orient2d(a: Vector3, b: Vector3, p: Vector3) -> Option<i32> {
    let left = (a[0] - p[0]) * (b[1] - p[1]);
    let right = (a[1] - p[1]) * (b[0] - p[0]);
    certain_sign(left - right, ORIENT_2D_BOUND * (left.abs() + right.abs()))
}

/// Sign of (a − p)·((b − p) × (c − p)): +1 if a, b, c are counter-clockwise seen from the far side of their
/// plane from p.
fn orient3d(a: Vector3, b: Vector3, c: Vector3, p: Vector3) -> Option<i32> {
    let [a, b, c] = [sub(a, p), sub(b, p), sub(c, p)];
    let magnitude = |v: Vector3| v.map(f64::abs);
    // The six products of the determinant with all signs positive.
    let [b_abs, c_abs] = [magnitude(b), magnitude(c)];
    let permanent_minors = [0, 1, 2].map(|axis| {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        b_abs[next] * c_abs[last] + b_abs[last] * c_abs[next]
    });
    certain_sign(dot(a, cross(b, c)), ORIENT_3D_BOUND * dot(magnitude(a), permanent_minors))
}

/// Triangles sorted into the squares of a grid across the rays.
struct Bins {
    /// Around all shadows; none without triangles.
    bounds: Option<BoundingBox>,
    /// Squares per axis.
    count: usize,
    /// Triangles of square n are `members[starts[n]..starts[n + 1]]`.
    starts: Vec<usize>,
    members: Vec<usize>,
}

impl Bins {
    fn new(triangles: &[[Vector3; 3]]) -> Bins {
        let shadows: Vec<BoundingBox> = triangles.iter().map(shadow).collect();
        let bounds = shadows.iter().copied().reduce(|all, next| all.union(&next));
        // About one square a triangle, so that a ray meets a handful.
        let count = (triangles.len() as f64).sqrt().ceil() as usize;
        let mut bins = Bins { bounds, count, starts: vec![0; count * count + 1], members: Vec::new() };
        // Count, add up, fill.
        for shadow in &shadows {
            bins.for_each_square(shadow, |bins, square| bins.starts[square + 1] += 1);
        }
        for square in 0..count * count {
            bins.starts[square + 1] += bins.starts[square];
        }
        bins.members = vec![0; bins.starts[count * count]];
        let mut next = bins.starts.clone();
        for (triangle, shadow) in shadows.iter().enumerate() {
            bins.for_each_square(shadow, |bins, square| {
                bins.members[next[square]] = triangle;
                next[square] += 1;
            });
        }
        bins
    }

    /// Column or row of a coordinate. It never decreases with the coordinate, so a point covered by a shadow
    /// falls into one of the shadow's squares whatever the rounding.
    fn square(&self, axis: usize, coordinate: f64) -> usize {
        let Some(bounds) = self.bounds else { return 0 };
        let fraction = (coordinate - bounds.min[axis]) / bounds.extent()[axis];
        // 0/0, where everything has one coordinate, becomes square 0.
        ((fraction * self.count as f64) as usize).min(self.count - 1)
    }

    fn for_each_square(&mut self, shadow: &BoundingBox, mut visit: impl FnMut(&mut Bins, usize)) {
        for column in self.square(0, shadow.min[0])..=self.square(0, shadow.max[0]) {
            for row in self.square(1, shadow.min[1])..=self.square(1, shadow.max[1]) {
                visit(self, column * self.count + row);
            }
        }
    }

    /// Triangles whose shadow may cover a point.
    fn at(&self, point: Vector3) -> &[usize] {
        if !self.bounds.is_some_and(|bounds| bounds.contains([point[0], point[1], 0.0])) {
            return &[];
        }
        let square = self.square(0, point[0]) * self.count + self.square(1, point[1]);
        &self.members[self.starts[square]..self.starts[square + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn a_point_left_of_a_line_has_positive_orientation() {
        let [a, b] = [[0.0, 0.0, 9.0], [1.0, 0.0, -9.0]];
        assert_eq!(orient2d(a, b, [0.5, 1.0, 0.0]), Some(1));
        assert_eq!(orient2d(a, b, [0.5, -1e-300, 0.0]), Some(-1));
        assert_eq!(orient2d(a, b, [0.5, 0.0, 0.0]), None);
    }

    #[test]
    fn a_point_below_a_counter_clockwise_triangle_has_positive_orientation() {
        let [a, b, c] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(orient3d(a, b, c, [0.2, 0.2, -1.0]), Some(1));
        assert_eq!(orient3d(a, b, c, [0.2, 0.2, 1.0]), Some(-1));
        assert_eq!(orient3d(a, b, c, [0.2, 0.2, 0.0]), None);
    }

    #[test]
    fn an_uncertain_sign_is_not_called() {
        // (0.1, 0.1), (0.3, 0.3), (0.7, 0.7): collinear on paper, not in binary.
        assert_eq!(orient2d([0.1, 0.1, 0.0], [0.7, 0.7, 0.0], [0.3, 0.3, 0.0]), None);
    }

    #[test]
    fn winding_along_a_line_is_one_between_entry_and_exit() {
        let rays = RayCrossings::new(&cuboid([1.0, 1.0, 1.0]), [0.0, 0.0]);
        let crossings = rays.crossings([0.3, 0.4, 0.0]).unwrap();
        assert_eq!(crossings.len(), 2);
        let winding = |z| rays.winding(&crossings, [0.3, 0.4, z]);
        assert_eq!(
            [winding(-0.1), winding(0.1), winding(0.9), winding(1.1)].map(Option::unwrap),
            [0, 1, 1, 0]
        );
        assert_eq!(winding(1.0), None);
    }

    #[test]
    fn a_ray_along_an_edge_is_not_called() {
        let rays = RayCrossings::new(&cuboid([1.0, 1.0, 1.0]), [0.0, 0.0]);
        assert!(rays.crossings([0.5, 0.5, 0.0]).is_none(), "the diagonal of the top");
        assert!(rays.crossings([0.0, 0.5, 0.0]).is_none(), "inside the plane of a side");
        assert!(rays.crossings([1.5, 0.5, 0.0]).unwrap().is_empty());
    }
}

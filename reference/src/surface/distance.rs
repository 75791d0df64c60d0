//! The point of a triangle nearest to a given point.

use crate::linalg::vector::{Vector3, add_scaled, cross, dot, norm_squared, sub};

/// The part of a triangle on which a point lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// Corner 0, 1 or 2.
    Vertex(usize),
    /// The inner part of the edge from corner n to corner (n + 1) mod 3.
    Edge(usize),
    /// The inner part of the triangle.
    Face,
}

/// The point of a triangle nearest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// Where it is.
    pub point: Vector3,
    /// On which part of the triangle.
    pub region: Region,
    /// Its squared distance from the query.
    pub distance_squared: f64,
}

impl ClosestPoint {
    fn new(query: Vector3, point: Vector3, region: Region) -> ClosestPoint {
        ClosestPoint { point, region, distance_squared: norm_squared(sub(query, point)) }
    }

    /// Distance from the query.
    pub fn distance(&self) -> f64 {
        self.distance_squared.sqrt()
    }
}

/// The point of triangle abc nearest to p.
///
/// If p's projection onto the plane has three positive barycentric coordinates
///
/// ```text
/// n = (b − a) × (c − a),   α ∝ n·((b − p) × (c − p)),   β ∝ n·((c − p) × (a − p)),   γ ∝ n·((a − p) × (b − p)),
/// ```
///
/// it is the projection αa + βb + γc; else it lies on an edge. The nearest points of the three edges compete in
/// either case. For a well-shaped triangle this changes nothing; for a needle, whose plane rounding has left
/// uncertain, the edges are certain, and every competitor is a point of the triangle, so that the distance is
/// never too small and too large by no more than rounding allows. A triangle without area is its longest edge.
///
/// # References
///
/// Ericson 2005, "Real-Time Collision Detection", section 5.1.5.
pub fn closest_point_on_triangle(p: Vector3, [a, b, c]: [Vector3; 3]) -> ClosestPoint {
    let on_edges = [closest_on_edge(p, a, b, 0), closest_on_edge(p, b, c, 1), closest_on_edge(p, c, a, 2)];
    let nearer =
        |x: ClosestPoint, y: ClosestPoint| if y.distance_squared < x.distance_squared { y } else { x };
    let nearest = on_edges.into_iter().reduce(nearer).expect("a triangle has three edges");

    let normal = cross(sub(b, a), sub(c, a));
    let [pa, pb, pc] = [sub(a, p), sub(b, p), sub(c, p)];
    let [alpha, beta, gamma] =
        [dot(normal, cross(pb, pc)), dot(normal, cross(pc, pa)), dot(normal, cross(pa, pb))];
    if !(alpha > 0.0 && beta > 0.0 && gamma > 0.0) {
        return nearest;
    }
    let total = alpha + beta + gamma;
    let projection = add_scaled(add_scaled(a, sub(b, a), beta / total), sub(c, a), gamma / total);
    nearer(nearest, ClosestPoint::new(p, projection, Region::Face))
}

/// The point of edge `number`, from `start` to `end`, nearest to p.
fn closest_on_edge(p: Vector3, start: Vector3, end: Vector3, number: usize) -> ClosestPoint {
    let along = sub(end, start);
    let t = dot(sub(p, start), along);
    let length_squared = norm_squared(along);
    if t <= 0.0 {
        ClosestPoint::new(p, start, Region::Vertex(number))
    } else if t >= length_squared {
        ClosestPoint::new(p, end, Region::Vertex((number + 1) % 3))
    } else {
        ClosestPoint::new(p, add_scaled(start, along, t / length_squared), Region::Edge(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIGHT: [Vector3; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

    #[test]
    fn each_region_has_its_own_nearest_point() {
        for (query, point, region) in [
            ([1.0, 1.0, 2.0], [1.0, 1.0, 0.0], Region::Face),
            ([1.0, 2.0, -3.0], [1.0, 2.0, 0.0], Region::Face),
            ([-1.0, -1.0, 5.0], [0.0, 0.0, 0.0], Region::Vertex(0)),
            ([6.0, 1.0, 1.0], [4.0, 0.0, 0.0], Region::Vertex(1)),
            ([-1.0, 7.0, 0.0], [0.0, 4.0, 0.0], Region::Vertex(2)),
            ([1.0, -2.0, 0.0], [1.0, 0.0, 0.0], Region::Edge(0)),
            ([4.0, 4.0, 1.0], [2.0, 2.0, 0.0], Region::Edge(1)),
            ([-3.0, 1.0, 1.0], [0.0, 1.0, 0.0], Region::Edge(2)),
        ] {
            let found = closest_point_on_triangle(query, RIGHT);
            assert_eq!((found.point, found.region), (point, region), "{query:?}");
            assert_eq!(found.distance_squared, norm_squared(sub(query, point)));
        }
    }

    #[test]
    fn a_point_of_the_triangle_is_its_own_nearest() {
        assert_eq!(closest_point_on_triangle([1.0, 1.0, 0.0], RIGHT).distance(), 0.0);
        assert_eq!(closest_point_on_triangle([2.0, 0.0, 0.0], RIGHT).distance(), 0.0);
        assert_eq!(closest_point_on_triangle([4.0, 0.0, 0.0], RIGHT).distance(), 0.0);
    }

    #[test]
    fn a_triangle_without_area_is_its_longest_edge() {
        let needle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
        assert_eq!(closest_point_on_triangle([2.0, 1.0, 0.0], needle).point, [2.0, 0.0, 0.0]);
        let dot = [[1.0, 2.0, 3.0]; 3];
        assert_eq!(closest_point_on_triangle([1.0, 2.0, 5.0], dot).distance(), 2.0);
    }

    #[test]
    fn a_needle_too_thin_for_its_plane_keeps_its_distance() {
        // Area far below rounding: the projection cannot be trusted, the long edges can.
        let needle = [[0.1, 0.1, 0.1], [0.7, 0.7, 0.7], [0.3, 0.3, 0.3 + 1e-16]];
        let found = closest_point_on_triangle([0.5, 0.5, 0.5], needle);
        assert!(found.distance() < 1e-15);
        assert!(
            (closest_point_on_triangle([0.0, 1.0, 0.5], needle).distance() - 0.5_f64.sqrt()).abs() < 1e-15
        );
    }
}

//! Which ray belongs to which vertex.
//!
//! Both directions, as in the code that Li 2021 follows (erratum E14d): every ray takes its nearest vertex of the outline if
//! it is near enough, and every vertex of the outline its nearest ray. The first pulls the body out to the mask, the second
//! pulls in what sticks out of it. A pair may be found twice and then counts twice.
//!
//! Partners must face the same way: the two sides of an arm are nearer to each other than a wrong arm to its mask. The
//! thesis does not say so; without it rays take vertices of the wrong limb.

use super::rays::Ray;
use crate::linalg::vector::{Vector3, cross, norm_squared, sub};
use crate::silhouette::outline::OutlineEdge;

/// A vertex of the outline that the camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundaryVertex {
    /// Its index.
    pub vertex: u32,
    /// Where it is in the world.
    pub position: Vector3,
    /// The surface's normal in the image.
    pub normal: [f64; 2],
}

/// A pair: indices into the lists of boundary vertices and of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// Into the boundary vertices.
    pub vertex: usize,
    /// Into the rays.
    pub ray: usize,
}

/// The least cosine between the image normals of partners: within 60°.
const LEAST_COSINE: f64 = 0.5;

/// The vertices at the ends of outline edges, each once, by index.
pub fn boundary_vertices(outline: &[OutlineEdge], vertices: &[Vector3]) -> Vec<BoundaryVertex> {
    let mut found: Vec<BoundaryVertex> = outline
        .iter()
        .flat_map(|edge| {
            [0, 1].map(|end| BoundaryVertex {
                vertex: edge.vertices[end],
                position: vertices[edge.vertices[end] as usize],
                normal: edge.normal[end],
            })
        })
        .collect();
    found.sort_unstable_by_key(|vertex| vertex.vertex);
    found.dedup_by_key(|vertex| vertex.vertex);
    found
}

/// The pairs of one view: rays nearer than `ray_reach_m` to their nearest vertex, then vertices nearer than `vertex_reach_m`
/// to their nearest ray. Distances are those of points from lines, in the posed world. `eye` is the camera's centre.
pub fn matches(
    boundary: &[BoundaryVertex],
    rays: &[Ray],
    eye: Vector3,
    ray_reach_m: f64,
    vertex_reach_m: f64,
) -> Vec<Match> {
    let from_eye: Vec<Vector3> = boundary.iter().map(|vertex| sub(vertex.position, eye)).collect();
    // Squared distance and partner.
    let mut of_ray = vec![(f64::INFINITY, 0); rays.len()];
    let mut of_vertex = vec![(f64::INFINITY, 0); boundary.len()];
    for (r, ray) in rays.iter().enumerate() {
        for (v, vertex) in boundary.iter().enumerate() {
            let cosine = ray.contour.normal[0] * vertex.normal[0] + ray.contour.normal[1] * vertex.normal[1];
            if cosine < LEAST_COSINE {
                continue;
            }
            // All rays of a view meet in the eye, so the moment about it vanishes.
            let squared = norm_squared(cross(from_eye[v], ray.line.direction));
            if squared < of_ray[r].0 {
                of_ray[r] = (squared, v);
            }
            if squared < of_vertex[v].0 {
                of_vertex[v] = (squared, r);
            }
        }
    }
    let near_rays = of_ray
        .into_iter()
        .enumerate()
        .filter(|(_, (squared, _))| *squared < ray_reach_m * ray_reach_m)
        .map(|(ray, (_, vertex))| Match { vertex, ray });
    let near_vertices = of_vertex
        .into_iter()
        .enumerate()
        .filter(|(_, (squared, _))| *squared < vertex_reach_m * vertex_reach_m)
        .map(|(vertex, (_, ray))| Match { vertex, ray });
    near_rays.chain(near_vertices).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plucker::Line;
    use crate::silhouette::boundary::ContourPoint;

    /// A ray from the origin that passes (x, 0, 1), with a normal to the left or right.
    fn ray(x: f64, side: f64) -> Ray {
        let contour = ContourPoint { position_px: [x, 0.0], normal: [side, 0.0] };
        Ray { contour, line: Line::through([0.0; 3], [x, 0.0, 1.0]).expect("two points") }
    }

    fn vertex(number: u32, x: f64, side: f64) -> BoundaryVertex {
        BoundaryVertex { vertex: number, position: [x, 0.0, 1.0], normal: [side, 0.0] }
    }

    #[test]
    fn both_directions_within_their_reach() {
        let rays = [ray(0.0, 1.0), ray(0.5, 1.0)];
        let boundary = [vertex(7, 0.02, 1.0), vertex(8, 0.06, 1.0), vertex(9, 0.95, 1.0)];
        let found = matches(&boundary, &rays, [0.0; 3], 0.12, 0.03);
        assert_eq!(found, [Match { vertex: 0, ray: 0 }, Match { vertex: 0, ray: 0 }]);
        let wide = matches(&boundary, &rays, [0.0; 3], 9.0, 0.07);
        assert_eq!(wide.len(), 4);
        assert!(wide.contains(&Match { vertex: 1, ray: 1 }) && wide.contains(&Match { vertex: 1, ray: 0 }));
    }

    #[test]
    fn partners_face_the_same_way() {
        let found = matches(&[vertex(0, 0.0, -1.0)], &[ray(0.0, 1.0)], [0.0; 3], 0.12, 0.03);
        assert!(found.is_empty());
    }

    #[test]
    fn an_end_of_two_edges_is_one_vertex() {
        let edge = |a: u32, b: u32| OutlineEdge {
            vertices: [a, b],
            position_px: [[0.0; 2]; 2],
            normal: [[1.0, 0.0]; 2],
        };
        let found = boundary_vertices(&[edge(2, 1), edge(1, 0)], &[[0.0; 3]; 3]);
        assert_eq!(found.iter().map(|v| v.vertex).collect::<Vec<_>>(), [0, 1, 2]);
    }
}

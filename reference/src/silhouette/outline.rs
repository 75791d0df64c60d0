//! The edges of a mesh that make the outline a camera sees.
//!
//! Where a surface turns away from the camera an edge has one face in front and one behind; the chains of such edges are
//! the *contour generator*. Those of them that project onto the rim of the rendered silhouette, and are not hidden, bound
//! the picture of the body: their projections are the outline of the mask, exactly. An arm in front of the chest has a
//! contour generator too, but no outline.

use super::boundary;
use super::raster::Raster;
use crate::camera::Pinhole;
use crate::linalg::matrix::apply;
use crate::linalg::vector::Vector3;
use crate::surface::edges::Edge;

/// An edge of the outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlineEdge {
    /// The ends: indices of vertices.
    pub vertices: [u32; 2],
    /// Their projections (u, v).
    pub position_px: [[f64; 2]; 2],
    /// The unit normal of the surface in the image at either end, out of the body.
    pub normal: [[f64; 2]; 2],
}

/// How far from the rim of the rendered mask an edge may project, in pixels; the rim runs between pixel centres, so an edge
/// that makes it lies within half a diagonal, and a zigzag of the mesh adds a little.
const RIM_PX: f64 = 1.25;
/// How much deeper than everything rendered around it an edge may lie and still count as seen, in metres. Towards the rim
/// the surface turns away: x inside it, a ball of radius r is already √(2 r x) nearer, 6 cm for a trunk and a pixel of 1 cm.
const HIDDEN_M: f64 = 0.1;

/// The outline edges of a mesh whose `raster` the same camera has made of the same vertices.
///
/// `normals` are the V unit [vertex normals](crate::surface::mesh::Mesh::vertex_normals), `edges` those of
/// [`crate::surface::edges::edges`].
///
/// # Panics
/// If there are not as many normals as vertices.
pub fn outline(
    vertices: &[Vector3],
    normals: &[Vector3],
    edges: &[Edge],
    faces: &[[u32; 3]],
    camera: &Pinhole,
    raster: &Raster,
) -> Vec<OutlineEdge> {
    assert!(
        normals.len() == vertices.len(),
        "outline: {} normals for {} vertices",
        normals.len(),
        vertices.len()
    );
    let pixels: Vec<Option<[f64; 2]>> = vertices.iter().map(|&v| camera.project(v)).collect();
    // +1: the corners run clockwise on the screen (v down), that is, the face is seen from behind; −1: from the front.
    let turn: Vec<Option<bool>> = faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.map(|vertex| pixels[vertex as usize]);
            let ([au, av], [bu, bv], [cu, cv]) = (a?, b?, c?);
            Some((bu - au) * (cv - av) - (bv - av) * (cu - au) < 0.0)
        })
        .collect();
    let rim = Rim::of(raster);
    let image_normal = |vertex: u32| {
        let [x, y, _] = apply(&camera.rotation, normals[vertex as usize]);
        let length = x.hypot(y);
        if length > 0.0 { [x / length, y / length] } else { [0.0; 2] }
    };
    edges
        .iter()
        .filter_map(|edge| {
            let [first, second] = edge.faces.map(|face| turn[face as usize]);
            if first? == second? {
                return None;
            }
            let [a, b] = edge.vertices.map(|vertex| pixels[vertex as usize]);
            let (a, b) = (a?, b?);
            let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
            let depth = edge.vertices.map(|vertex| camera.to_camera(vertices[vertex as usize])[2]);
            rim.shows(middle, 0.5 * (depth[0] + depth[1])).then(|| OutlineEdge {
                vertices: edge.vertices,
                position_px: [a, b],
                normal: edge.vertices.map(image_normal),
            })
        })
        .collect()
}

/// The rim of a rendered mask: its contour points, found by pixel, and how deep the body reaches around them.
struct Rim<'a> {
    raster: &'a Raster,
    /// The contour points that touch each pixel, as a list per pixel.
    points: Vec<[f64; 2]>,
    first: Vec<u32>,
}

impl<'a> Rim<'a> {
    fn of(raster: &'a Raster) -> Rim<'a> {
        let mask = &raster.mask;
        let mut points: Vec<[f64; 2]> =
            boundary::contour(mask).into_iter().map(|point| point.position_px).collect();
        let pixel = |[u, v]: [f64; 2]| v.floor() as usize * mask.width + u.floor() as usize;
        points.sort_by_key(|&point| pixel(point));
        let mut first = vec![0u32; mask.width * mask.height + 1];
        for point in &points {
            first[pixel(*point) + 1] += 1;
        }
        for p in 0..mask.width * mask.height {
            first[p + 1] += first[p];
        }
        Rim { raster, points, first }
    }

    /// Whether an edge at this position and depth is seen at the rim.
    fn shows(&self, [u, v]: [f64; 2], depth_m: f64) -> bool {
        let mask = &self.raster.mask;
        let reach = RIM_PX.ceil() as isize;
        let (row, column) = (v.floor() as isize, u.floor() as isize);
        let (mut near, mut deepest) = (false, f64::NEG_INFINITY);
        for i in (row - reach).max(0)..=(row + reach).min(mask.height as isize - 1) {
            for j in (column - reach).max(0)..=(column + reach).min(mask.width as isize - 1) {
                let pixel = i as usize * mask.width + j as usize;
                if mask.inside[pixel] {
                    deepest = deepest.max(self.raster.depth_m[pixel]);
                }
                near |= self.points[self.first[pixel] as usize..self.first[pixel + 1] as usize]
                    .iter()
                    .any(|p| (p[0] - u).hypot(p[1] - v) <= RIM_PX);
            }
        }
        near && depth_m <= deepest + HIDDEN_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::edges::edges;
    use crate::surface::mesh::Mesh;

    /// A ball of latitudes and longitudes around `center`.
    fn ball(center: Vector3, radius: f64) -> Mesh {
        let (rings, sectors) = (24u32, 48u32);
        let mut vertices = vec![[center[0], center[1] + radius, center[2]]];
        for ring in 1..rings {
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            for sector in 0..sectors {
                let turn = std::f64::consts::TAU * f64::from(sector) / f64::from(sectors);
                let around = radius * polar.sin();
                vertices.push([
                    center[0] + around * turn.sin(),
                    center[1] + radius * polar.cos(),
                    center[2] + around * turn.cos(),
                ]);
            }
        }
        vertices.push([center[0], center[1] - radius, center[2]]);
        let south = vertices.len() as u32 - 1;
        let at = |ring: u32, sector: u32| 1 + (ring - 1) * sectors + sector % sectors;
        let mut faces = Vec::new();
        for sector in 0..sectors {
            faces.push([0, at(1, sector), at(1, sector + 1)]);
            faces.push([south, at(rings - 1, sector + 1), at(rings - 1, sector)]);
            for ring in 1..rings - 1 {
                let [a, b, c, d] =
                    [at(ring, sector), at(ring + 1, sector), at(ring + 1, sector + 1), at(ring, sector + 1)];
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        Mesh::new(vertices, faces)
    }

    fn camera() -> Pinhole {
        Pinhole { translation: [0.0, 0.0, 4.0], ..Pinhole::ideal(400.0, [80.0, 60.0]) }
    }

    fn outline_of(mesh: &Mesh) -> Vec<OutlineEdge> {
        let raster = Raster::of(&mesh.vertices, &mesh.faces, &camera(), 160, 120);
        outline(&mesh.vertices, &mesh.vertex_normals(), &edges(&mesh.faces), &mesh.faces, &camera(), &raster)
    }

    #[test]
    fn a_ball_is_bounded_by_its_horizon() {
        let mesh = ball([0.0; 3], 0.4);
        assert!(mesh.signed_volume() > 0.0);
        let found = outline_of(&mesh);
        // The horizon of a ball at distance 4: a cone of half-angle asin(0.1).
        let radius_px = 400.0 * (0.1f64).asin().tan();
        assert!((46..200).contains(&found.len()), "{} edges", found.len());
        for edge in &found {
            for (end, normal) in edge.position_px.iter().zip(edge.normal) {
                let (x, y) = (end[0] - 80.0, end[1] - 60.0);
                assert!((x.hypot(y) - radius_px).abs() < 0.02 * radius_px, "{edge:?}");
                assert!((x * normal[0] + y * normal[1]) / x.hypot(y) > 0.98, "{edge:?}");
            }
        }
    }

    #[test]
    fn what_stands_before_or_behind_another_body_makes_no_outline() {
        let (big, small) = (ball([0.0; 3], 0.4), ball([0.05, 0.0, -0.6], 0.1));
        let hidden = ball([0.05, 0.0, 0.6], 0.1);
        for other in [small, hidden] {
            let mut both = big.clone();
            let shift = both.vertices.len() as u32;
            both.vertices.extend(&other.vertices);
            both.faces.extend(other.faces.iter().map(|face| face.map(|v| v + shift)));
            let found = outline_of(&both);
            assert_eq!(found.len(), outline_of(&big).len());
            assert!(found.iter().all(|edge| edge.vertices.iter().all(|v| *v < shift)));
        }
    }
}

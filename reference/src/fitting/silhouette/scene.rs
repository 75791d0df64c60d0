//! The masks with their rays, and the body as the cameras see it.

use super::correspondence::{boundary_vertices, matches};
use super::options::SilhouetteOptions;
use super::outline_problem::OutlinePair;
use super::rays::{Ray, line_of_sight, rays};
use super::shape_problem::Pair;
use crate::body::BodyModel;
use crate::camera::Pinhole;
use crate::linalg::vector::Vector3;
use crate::metric::silhouette::mask_iou;
use crate::silhouette::Mask;
use crate::silhouette::dilation::{StructuringElement, dilate, erode};
use crate::silhouette::outline::{OutlineEdge, outline};
use crate::silhouette::raster::Raster;
use crate::surface::edges::{Edge, edges};
use crate::surface::mesh::Mesh;

/// How many contour points a pixel's length of the body's outline counts for when it seeks its contour point. Less than one:
/// edges of a zigzag lie a little inside the outline (0.1 px on a body of 13 000 vertices), while contour points that seek the
/// body have no bias. The search in this direction is for what sticks out of the mask.
const EDGE_COUNT: f64 = 0.1;

/// What stays the same during a fit.
pub struct Scene<'a> {
    /// The triangles of the body.
    pub faces: &'a [[u32; 3]],
    /// Its edges.
    edges: Vec<Edge>,
    /// The cameras of the views.
    cameras: Vec<Pinhole>,
    /// Their masks.
    pub masks: &'a [Mask],
    /// The rays of each mask's outline.
    pub rays: Vec<Vec<Ray>>,
}

/// The body as every view sees it.
pub struct Seen {
    /// The overlap with the mask in every view.
    pub iou: Vec<f64>,
    /// The body's outline in every view.
    pub outlines: Vec<Vec<OutlineEdge>>,
}

/// The least cosine between the normal of a contour point and that of the body's outline where they are to be partners.
const LEAST_COSINE: f64 = 0.6;

impl<'a> Scene<'a> {
    /// Finds edges and rays.
    pub fn new(body: &'a BodyModel, cameras: &[Pinhole], masks: &'a [Mask]) -> Scene<'a> {
        Scene {
            faces: &body.faces,
            edges: edges(&body.faces),
            cameras: cameras.to_vec(),
            masks,
            rays: cameras.iter().zip(masks).map(|(camera, mask)| rays(camera, mask)).collect(),
        }
    }

    /// The cameras of the views.
    pub fn cameras(&self) -> &[Pinhole] {
        &self.cameras
    }

    /// Turns and moves the cameras, and the rays with them.
    pub fn set_cameras(&mut self, cameras: Vec<Pinhole>) {
        for (camera, rays) in cameras.iter().zip(&mut self.rays) {
            for ray in rays {
                // R and t do not enter the lens, so what had a line still has one.
                if let Some(line) = line_of_sight(camera, ray.contour.position_px) {
                    ray.line = line;
                }
            }
        }
        self.cameras = cameras;
    }

    fn rasters<'s>(&'s self, vertices: &'s [Vector3]) -> impl Iterator<Item = Raster> + 's {
        self.cameras
            .iter()
            .zip(self.masks)
            .map(|(camera, mask)| Raster::of(vertices, self.faces, camera, mask.width, mask.height))
    }

    /// The overlap of the rendered body and the mask in every view; 0 where neither shows anything.
    pub fn iou(&self, vertices: &[Vector3]) -> Vec<f64> {
        let pairs = self.rasters(vertices).zip(self.masks);
        pairs.map(|(raster, mask)| mask_iou(&raster.mask.inside, &mask.inside).unwrap_or(0.0)).collect()
    }

    /// The sum over the views of the overlap of the rendered body and its mask without the `bias_px` pixels, to whole ones, that
    /// the mask is too large all round.
    pub fn unbiased_overlap(&self, vertices: &[Vector3], bias_px: f64) -> f64 {
        let square = StructuringElement::Square { size: 2 * bias_px.abs().round() as usize + 1 };
        let corrected = |mask: &Mask| if bias_px > 0.0 { erode(mask, square) } else { dilate(mask, square) };
        let pairs = self.rasters(vertices).zip(self.masks);
        pairs
            .map(|(raster, mask)| mask_iou(&raster.mask.inside, &corrected(mask).inside).unwrap_or(0.0))
            .sum()
    }

    /// Overlaps and outlines of the body.
    pub fn see(&self, vertices: &[Vector3]) -> Seen {
        let mesh = Mesh { vertices: vertices.to_vec(), faces: self.faces.to_vec() };
        let normals = mesh.vertex_normals();
        let mut seen = Seen { iou: Vec::new(), outlines: Vec::new() };
        for ((raster, mask), camera) in self.rasters(vertices).zip(self.masks).zip(&self.cameras) {
            seen.iou.push(mask_iou(&raster.mask.inside, &mask.inside).unwrap_or(0.0));
            seen.outlines.push(outline(vertices, &normals, &self.edges, self.faces, camera, &raster));
        }
        seen
    }

    /// The pairs of vertices and rays in all views, for a shape stage.
    pub fn ray_pairs(&self, vertices: &[Vector3], seen: &Seen, options: &SilhouetteOptions) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (view, (rays, outline)) in self.rays.iter().zip(&seen.outlines).enumerate() {
            let boundary = boundary_vertices(outline, vertices);
            let eye = self.cameras[view].center();
            for found in matches(&boundary, rays, eye, options.ray_reach_m, options.vertex_reach_m) {
                let ray = &rays[found.ray];
                pairs.push(Pair {
                    vertex: boundary[found.vertex].vertex,
                    view,
                    line: ray.line,
                    pixel_px: ray.contour.position_px,
                });
            }
        }
        pairs
    }

    /// The pairs of outline points in all views, for a pose round: for every contour point the nearest point of the body's
    /// outline, and for the middle of every edge of the body's outline the nearest contour point; within the view's `reach_px`,
    /// and facing the same way.
    pub fn outline_pairs(&self, seen: &Seen, reach_px: &[f64]) -> Vec<OutlinePair> {
        let mut pairs = Vec::new();
        for (view, (rays, outline)) in self.rays.iter().zip(&seen.outlines).enumerate() {
            let (reach_px, robust_px) = (reach_px[view], 0.5 * reach_px[view]);
            // Squared distance, and the partner.
            let mut of_edge = vec![(reach_px * reach_px, None); outline.len()];
            let middles: Vec<[f64; 2]> = outline
                .iter()
                .map(|edge| {
                    let [a, b] = edge.position_px;
                    [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
                })
                .collect();
            for ray in rays {
                let (c, n) = (ray.contour.position_px, ray.contour.normal);
                let mut best = (reach_px * reach_px, None);
                for (e, edge) in outline.iter().enumerate() {
                    let near = (middles[e][0] - c[0]).abs().max((middles[e][1] - c[1]).abs());
                    let [p, q] = edge.normal;
                    // The sum of the two unit normals stands for that of the edge.
                    if near > reach_px + 8.0
                        || n[0] * (p[0] + q[0]) + n[1] * (p[1] + q[1]) < 2.0 * LEAST_COSINE
                    {
                        continue;
                    }
                    let (squared, fraction) = nearest_on_segment(edge.position_px, c);
                    if squared < best.0 {
                        best = (squared, Some((edge.vertices, fraction)));
                    }
                    let to_middle = (middles[e][0] - c[0]).powi(2) + (middles[e][1] - c[1]).powi(2);
                    if to_middle < of_edge[e].0 {
                        of_edge[e] = (to_middle, Some((c, n)));
                    }
                }
                if let (_, Some((vertices, fraction))) = best {
                    pairs.push(OutlinePair {
                        view,
                        vertices,
                        fraction,
                        pixel_px: c,
                        normal: n,
                        count: 1.0,
                        robust_px,
                    });
                }
            }
            for (edge, (_, partner)) in outline.iter().zip(of_edge) {
                if let Some((pixel_px, normal)) = partner {
                    let [a, b] = edge.position_px;
                    let count = EDGE_COUNT * (a[0] - b[0]).hypot(a[1] - b[1]);
                    pairs.push(OutlinePair {
                        view,
                        vertices: edge.vertices,
                        fraction: 0.5,
                        pixel_px,
                        normal,
                        count,
                        robust_px,
                    });
                }
            }
        }
        pairs
    }
}

/// The squared distance of a point from a segment, and the nearest point's place between the ends, 0…1.
fn nearest_on_segment([a, b]: [[f64; 2]; 2], c: [f64; 2]) -> (f64, f64) {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let squared = along[0] * along[0] + along[1] * along[1];
    let fraction =
        if squared > 0.0 { ((along[0] * to[0] + along[1] * to[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    let gap = [to[0] - fraction * along[0], to[1] - fraction * along[1]];
    (gap[0] * gap[0] + gap[1] * gap[1], fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_point_of_a_segment() {
        let segment = [[0.0, 0.0], [4.0, 0.0]];
        assert_eq!(nearest_on_segment(segment, [1.0, 2.0]), (4.0, 0.25));
        assert_eq!(nearest_on_segment(segment, [7.0, 4.0]), (25.0, 1.0));
        assert_eq!(nearest_on_segment([[1.0, 1.0]; 2], [1.0, 3.0]), (4.0, 0.0));
    }
}

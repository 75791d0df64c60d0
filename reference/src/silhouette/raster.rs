//! Rasterising a mesh: which pixels it covers, by which triangle, at which depth.
//!
//! A pixel belongs to a triangle if its *centre* (j + ½, i + ½) lies inside the projected triangle. Where a centre lies
//! exactly on an edge the top-left rule decides, so that two triangles with a common edge neither overlap nor leave a gap;
//! the edge function is evaluated for both from the same end, so that rounding cannot break this.
//!
//! Lens distortion is applied to the vertices, and the edges between them are drawn straight: exact as far as the triangles
//! are small against the curvature of the lens. A triangle with a corner that is not in front of the camera (Z ≤ 0) is left
//! out whole; bodies stand in front of cameras, and a clipped part could only lie at the image's border.

use super::Mask;
use crate::camera::Pinhole;
use crate::linalg::vector::Vector3;

/// What a camera sees of a mesh, H×W row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// The pixels that the mesh covers.
    pub mask: Mask,
    /// The number of the nearest triangle of every pixel, or [`Raster::NO_FACE`].
    pub face: Vec<u32>,
    /// Its depth Z in metres, infinite where there is none.
    pub depth_m: Vec<f64>,
}

/// The projection of a vertex: u, v in pixels and 1/Z.
#[derive(Clone, Copy)]
struct Corner {
    u: f64,
    v: f64,
    inverse_depth: f64,
}

impl Raster {
    /// In [`Raster::face`]: nothing is seen here.
    pub const NO_FACE: u32 = u32::MAX;

    /// Rasterises triangles (F×3 indices into V×3 world points, either orientation) into an image of `width` × `height`.
    ///
    /// # Panics
    /// If a face names a vertex that is not there.
    pub fn of(
        vertices: &[Vector3],
        faces: &[[u32; 3]],
        camera: &Pinhole,
        width: usize,
        height: usize,
    ) -> Raster {
        let corners: Vec<Option<Corner>> = vertices
            .iter()
            .map(|&vertex| {
                let [u, v] = camera.project(vertex)?;
                Some(Corner { u, v, inverse_depth: 1.0 / camera.to_camera(vertex)[2] })
            })
            .collect();
        let mut face = vec![Raster::NO_FACE; width * height];
        // The nearest triangle has the largest 1/Z, which is linear in the image plane.
        let mut nearest = vec![0.0f64; width * height];
        for (number, triangle) in faces.iter().enumerate() {
            let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| corners[vertex as usize]) else {
                continue;
            };
            cover(a, b, c, width, height, |pixel, inverse_depth| {
                if inverse_depth > nearest[pixel] {
                    nearest[pixel] = inverse_depth;
                    face[pixel] = number as u32;
                }
            });
        }
        let inside = face.iter().map(|face| *face != Raster::NO_FACE).collect();
        Raster {
            mask: Mask { width, height, inside },
            face,
            depth_m: nearest.into_iter().map(|inverse| 1.0 / inverse).collect(),
        }
    }
}

/// Calls `paint` with the index and 1/Z of every pixel whose centre lies inside the triangle.
fn cover(a: Corner, b: Corner, c: Corner, width: usize, height: usize, mut paint: impl FnMut(usize, f64)) {
    // Rows and columns whose centres j + ½ lie within the triangle's box: most triangles of a body are smaller than a pixel.
    let span = |x: f64, y: f64, z: f64, size: usize| {
        let low = (x.min(y).min(z) - 0.5).ceil().max(0.0) as usize;
        let past = ((x.max(y).max(z) - 0.5).floor() + 1.0).max(0.0) as usize;
        low..past.min(size)
    };
    let rows = span(a.v, b.v, c.v, height);
    let columns = span(a.u, b.u, c.u, width);
    if rows.is_empty() || columns.is_empty() {
        return;
    }
    let area = edge(a, b, c.u, c.v);
    // Turned away: the same pixels with the corners in the other order.
    let (b, c, area) = if area < 0.0 { (c, b, -area) } else { (b, c, area) };
    if area.is_nan() || area == 0.0 {
        return;
    }
    let sides = [(b, c), (c, a), (a, b)];
    let owns = sides.map(|(from, to)| owns_its_points(from, to));
    for i in rows {
        for j in columns.clone() {
            let (u, v) = (j as f64 + 0.5, i as f64 + 0.5);
            let [wa, wb, wc] = sides.map(|(from, to)| edge(from, to, u, v));
            let within = |w: f64, owns: bool| w > 0.0 || (w == 0.0 && owns);
            if within(wa, owns[0]) && within(wb, owns[1]) && within(wc, owns[2]) {
                let sum = wa * a.inverse_depth + wb * b.inverse_depth + wc * c.inverse_depth;
                paint(i * width + j, sum / (wa + wb + wc));
            }
        }
    }
}

/// Twice the signed area of (from, to, point), positive if the point lies to the right of the way on the screen (v runs
/// down); swapping the ends changes the sign and not one bit else.
fn edge(from: Corner, to: Corner, u: f64, v: f64) -> f64 {
    let forward = (from.u, from.v) <= (to.u, to.v);
    let (low, high) = if forward { (from, to) } else { (to, from) };
    let area = (high.u - low.u) * (v - low.v) - (high.v - low.v) * (u - low.u);
    if forward { area } else { -area }
}

/// The top-left rule: with the inside to the right of the way, a top edge runs to larger u at equal v, a left edge to
/// smaller v.
fn owns_its_points(from: Corner, to: Corner) -> bool {
    to.v < from.v || (to.v == from.v && to.u > from.u)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At depth 1 with focal length 1 and principal point 0: world x, y are pixels.
    fn flat() -> Pinhole {
        Pinhole::ideal(1.0, [0.0, 0.0])
    }

    fn covered(raster: &Raster) -> Vec<usize> {
        (0..raster.face.len()).filter(|&pixel| raster.mask.inside[pixel]).collect()
    }

    #[test]
    fn a_pixel_belongs_by_its_centre() {
        let triangle = |right: f64| [[0.0, 0.0, 1.0], [right, 0.0, 1.0], [0.0, 9.0, 1.0]];
        // At v = ½ the hypotenuse stands at right·(1 − ½/9).
        let seen = |right| covered(&Raster::of(&triangle(right), &[[0, 1, 2]], &flat(), 3, 1));
        assert_eq!(seen(1.5 * 9.0 / 8.5 - 1e-12), [0]);
        assert_eq!(seen(1.5 * 9.0 / 8.5 + 1e-12), [0, 1]);
    }

    #[test]
    fn squares_whose_sides_run_through_centres_share_no_pixel_and_leave_no_gap() {
        // Four squares that meet at the centre of the middle pixel, each cut along a diagonal that runs through centres.
        let mut counts = [0; 25];
        for (x, y) in [(0.5, 0.5), (2.5, 0.5), (0.5, 2.5), (2.5, 2.5)] {
            let square = [[x, y, 1.0], [x + 2.0, y, 1.0], [x + 2.0, y + 2.0, 1.0], [x, y + 2.0, 1.0]];
            for face in [[0, 1, 2], [0, 3, 2]] {
                for pixel in covered(&Raster::of(&square, &[face], &flat(), 5, 5)) {
                    counts[pixel] += 1;
                }
            }
        }
        let expected: Vec<i32> = (0..25).map(|p| i32::from(p / 5 < 4 && p % 5 < 4)).collect();
        assert_eq!(counts.as_slice(), expected);
    }

    #[test]
    fn the_nearer_triangle_is_seen_whatever_the_order() {
        let vertices = [
            [0.0, 0.0, 1.0],
            [9.0, 0.0, 1.0],
            [0.0, 9.0, 1.0],
            [0.0, 0.0, 2.0],
            [18.0, 0.0, 2.0],
            [0.0, 18.0, 2.0],
        ];
        for faces in [[[0, 1, 2], [3, 4, 5]], [[3, 5, 4], [0, 2, 1]]] {
            let raster = Raster::of(&vertices, &faces, &flat(), 2, 2);
            assert!(raster.face.iter().all(|&face| faces[face as usize].contains(&0)));
            assert!(raster.depth_m.iter().all(|depth| (depth - 1.0).abs() < 1e-15));
        }
    }

    #[test]
    fn depth_of_a_slanted_triangle_is_that_of_its_plane() {
        // The plane Z = 2 + x/2 through three points; the pixel's ray (u, v, 1)·Z meets it at Z = 2/(1 − u/2).
        let plane = |x: f64, y: f64| [x, y, 2.0 + 0.5 * x];
        let vertices = [plane(-1.0, -1.0), plane(3.0, -1.0), plane(-1.0, 9.0)];
        let mut camera = flat();
        camera.focal_px = [4.0; 2];
        let raster = Raster::of(&vertices, &[[0, 1, 2]], &camera, 3, 2);
        for (pixel, depth) in raster.depth_m.iter().enumerate() {
            let u = ((pixel % 3) as f64 + 0.5) / 4.0;
            assert!((depth - 2.0 / (1.0 - 0.5 * u)).abs() < 1e-14, "{pixel}: {depth}");
        }
    }

    #[test]
    fn triangles_that_reach_behind_the_camera_or_beside_the_image_are_left_out() {
        let vertices =
            [[0.0, 0.0, 1.0], [9.0, 0.0, 1.0], [0.0, 9.0, -1.0], [-5.0, -5.0, 1.0], [-4.0, 90.0, 1.0]];
        let raster = Raster::of(&vertices, &[[0, 1, 2], [3, 4, 3], [0, 0, 0]], &flat(), 4, 4);
        assert_eq!(raster.mask.area_px(), 0);
        assert!(raster.depth_m.iter().all(|depth| depth.is_infinite()));
    }
}

//! From the outline of a mask to rays of space, and from there into the zero pose.

use crate::body::posed_body::PosedBody;
use crate::camera::Pinhole;
use crate::linalg::vector::add;
use crate::plucker::Line;
use crate::silhouette::Mask;
use crate::silhouette::boundary::{ContourPoint, contour};

/// A point of the outline and the ray on which the body must touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The point of the outline, and its normal.
    pub contour: ContourPoint,
    /// The ray from the camera's centre through it, in the world.
    pub line: Line,
}

/// More rays of one view than this say little more of the body and cost as much again: a person of 300 pixels has so many.
const MOST_RAYS: usize = 1500;
/// Multiples of it, modulo 1, fall everywhere alike: what is left of a long outline is spread over all of it.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_8;

/// The rays of the outline points of a mask: all, or 1500 of them where there are more.
///
/// Points that no ray can meet (the lens model has no inverse there) are left out.
pub fn rays(camera: &Pinhole, mask: &Mask) -> Vec<Ray> {
    let ray =
        |contour: ContourPoint| Some(Ray { contour, line: line_of_sight(camera, contour.position_px)? });
    let outline = contour(mask);
    let share = MOST_RAYS as f64 / outline.len() as f64;
    let kept = outline.into_iter().enumerate().filter(|(n, _)| (*n as f64 * GOLDEN_RATIO).fract() < share);
    kept.filter_map(|(_, contour)| ray(contour)).collect()
}

/// The line from the camera's centre through a pixel; `None` where the lens model has no inverse.
pub fn line_of_sight(camera: &Pinhole, pixel_px: [f64; 2]) -> Option<Line> {
    Line::through(camera.center(), camera.unproject(pixel_px, 1.0)?)
}

/// The ray in the zero pose of the matched vertex: two of its points taken back by the vertex' [un-posing
/// map](PosedBody::unposing) and joined again; `None` if the vertex has none.
///
/// # Conventions
/// Eq. 3.6 applies the inverse to the direction of the ray and subtracts a displacement from it, which has no meaning; two
/// points are mapped instead, as in the code that the thesis follows (errata E9 and E10).
pub fn unposed(ray: &Line, body: &PosedBody, vertex: usize) -> Option<Line> {
    let back = body.unposing(vertex)?;
    // Any two points do; the nearest to the vertex and one a metre on lose no digits.
    let near = ray.nearest_point(body.position(vertex));
    Line::through(back.apply(near), back.apply(add(near, ray.direction)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mannequin;
    use crate::linalg::vector::{add_scaled, distance};

    #[test]
    fn a_vertex_on_a_ray_stays_on_it_in_the_zero_pose() {
        let body = mannequin();
        let skeleton = body.skeleton();
        let pose: Vec<f64> = (0..72).map(|n| 0.4 * (0.9 * f64::from(n)).sin()).collect();
        let mut offsets = vec![[0.01, 0.0, -0.01]; body.vertex_count()];
        for vertex in [3, 777, 5000] {
            let posed = body.at_pose(&skeleton, &pose, &[0.5, -1.0], &offsets, [0.2, 0.1, 0.0]);
            let ray = Line::through([0.5, 1.0, 4.0], posed.position(vertex)).expect("two points");
            let back = unposed(&ray, &posed, vertex).expect("invertible");
            assert!(back.distance(posed.shaped(vertex)) < 1e-12);
            // Posing a point of the line, as an offset of the vertex, puts it on the ray again.
            offsets[vertex] = add_scaled(offsets[vertex], back.direction, 0.3);
            let moved = body.at_pose(&skeleton, &pose, &[0.5, -1.0], &offsets, [0.2, 0.1, 0.0]);
            assert!(ray.distance(moved.position(vertex)) < 1e-12);
        }
    }

    #[test]
    fn rays_project_onto_their_outline_points() {
        let camera = Pinhole {
            distortion: [-0.1, 0.02, 0.001, -0.002, 0.0],
            translation: [0.1, -0.2, 3.0],
            rotation: crate::rotation::rodrigues([0.2, 2.0, 0.1]),
            ..Pinhole::ideal(60.0, [20.0, 15.0])
        };
        let mut mask = Mask::empty(40, 30);
        mask.inside[10 * 40 + 12..10 * 40 + 20].fill(true);
        let found = rays(&camera, &mask);
        assert_eq!(found.len(), 18);
        for ray in found {
            let point = add_scaled(camera.center(), ray.line.direction, 2.0);
            let [u, v] = camera.project(point).expect("in front");
            let [x, y] = ray.contour.position_px;
            assert!((u - x).hypot(v - y) < 1e-9);
            assert!(ray.line.distance(camera.center()) < 1e-12 && distance(point, camera.center()) > 1.9);
        }
    }
}

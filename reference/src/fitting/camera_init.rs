//! Where the camera stands, from the torso: similar triangles, and the step that refines them.
//!
//! Shoulders and hips move little against each other. With H the mean length of the body's two sides (shoulder to hip) and h
//! that of their pictures, a camera of focal length f stands at the distance t_z = f H/h. Only the distance is in the thesis;
//! x and y come from the middle of the torso (erratum E14c). Then the camera is turned and moved until the four marks fit:
//!
//! ```text
//! min Σ_torso ‖Π(R p_k + t) − y_k‖² + 100² (t_z − t_z0)²
//! ```
//!
//! without robust loss or confidences.
//!
//! # References
//! Li 2021, ch. 2 §3.2; SMPLify's `guess_init` and `initialize_camera`.

use crate::camera::Pinhole;
use crate::least_squares::{Dogleg, Problem};
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, apply};
use crate::linalg::vector::{Vector3, add, centroid, distance, scale};
use crate::rotation::{left_jacobian, logarithm, rodrigues};

/// The weight of the depth against pixels, per metre.
const DEPTH_WEIGHT: f64 = 100.0;

/// The torso of one view: points in the frame that the camera is sought in, and their marks, both in the order left shoulder,
/// right shoulder, left hip, right hip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Torso {
    /// Metres.
    pub points: [Vector3; 4],
    /// Pixels.
    pub pixels_px: [[f64; 2]; 4],
}

impl Torso {
    /// t by similar triangles for a camera turned by `rotation`; `None` if the torso's picture is a point.
    ///
    /// t_z = f H/h − (the depth of the torso's middle), t_xy such that the middle is seen in the middle of the marks.
    pub fn translation(&self, camera: &Pinhole, rotation: &Matrix3) -> Option<Vector3> {
        let (p, q) = (&self.points, &self.pixels_px);
        let in_space = 0.5 * (distance(p[0], p[2]) + distance(p[1], p[3]));
        let length = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let in_picture = 0.5 * (length(q[0], q[2]) + length(q[1], q[3]));
        let focal = 0.5 * (camera.focal_px[0] + camera.focal_px[1]);
        let depth = focal * in_space / in_picture;
        if !depth.is_finite() || depth <= 0.0 {
            return None;
        }
        let middle = apply(rotation, centroid(p));
        let seen =
            camera.normalized(std::array::from_fn(|i| q.iter().map(|pixel| pixel[i]).sum::<f64>() / 4.0))?;
        Some(add(scale([seen[0], seen[1], 1.0], depth), scale(middle, -1.0)))
    }

    /// The camera step: `camera` with rotation and translation refined from `rotation` and similar triangles; `None` if the
    /// torso's picture is a point or the torso does not come to lie in front.
    pub fn camera(&self, camera: &Pinhole, rotation: &Matrix3) -> Option<Pinhole> {
        let translation = self.translation(camera, rotation)?;
        let step = CameraStep { torso: self, camera, depth: translation[2] };
        let mut x = logarithm(rotation).to_vec();
        x.extend(translation);
        let dogleg = Dogleg { max_iterations: 100, improvement_tolerance: 1e-4, ..Dogleg::default() };
        let solution = dogleg.minimize(&step, &x);
        solution.energy.is_finite().then(|| step.camera_at(&solution.x))
    }
}

/// x = (r, t).
struct CameraStep<'a> {
    torso: &'a Torso,
    camera: &'a Pinhole,
    depth: f64,
}

impl CameraStep<'_> {
    fn camera_at(&self, x: &[f64]) -> Pinhole {
        Pinhole { rotation: rodrigues([x[0], x[1], x[2]]), translation: [x[3], x[4], x[5]], ..*self.camera }
    }
}

impl Problem for CameraStep<'_> {
    type Jacobian = Dense;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        let camera = self.camera_at(x);
        let mut r = Vec::with_capacity(9);
        for (point, pixel) in self.torso.points.iter().zip(&self.torso.pixels_px) {
            let [u, v] = camera.project(*point)?;
            r.extend([u - pixel[0], v - pixel[1]]);
        }
        r.push(DEPTH_WEIGHT * (x[5] - self.depth));
        Some(r)
    }

    fn jacobian(&self, x: &[f64]) -> Dense {
        let camera = self.camera_at(x);
        let turn = left_jacobian([x[0], x[1], x[2]]);
        let mut jacobian = Dense::zeros(9, 6);
        for (n, point) in self.torso.points.iter().enumerate() {
            let Some(slope) = camera.project_derivative(*point) else { continue };
            for axis in 0..2 {
                for c in 0..3 {
                    jacobian[(2 * n + axis, c)] = (0..3).map(|m| slope.rotation[axis][m] * turn[m][c]).sum();
                    jacobian[(2 * n + axis, 3 + c)] = slope.translation[axis][c];
                }
            }
        }
        jacobian[(8, 5)] = DEPTH_WEIGHT;
        jacobian
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::{max_abs, sub};

    const POINTS: [Vector3; 4] =
        [[0.18, 0.45, 0.0], [-0.18, 0.45, 0.02], [0.09, -0.07, 0.0], [-0.09, -0.07, 0.01]];

    fn planted(rotation: Vector3, translation: Vector3) -> (Pinhole, Torso) {
        let camera =
            Pinhole { rotation: rodrigues(rotation), translation, ..Pinhole::ideal(500.0, [160.0, 120.0]) };
        let pixels_px = POINTS.map(|p| camera.project(p).expect("in front"));
        (camera, Torso { points: POINTS, pixels_px })
    }

    #[test]
    fn similar_triangles_by_hand() {
        // Upright and parallel to the image: 0.52 m high, seen at 500·0.52/4 = 65 px.
        let upright = rodrigues([std::f64::consts::PI, 0.0, 0.0]);
        let points = POINTS.map(|[x, y, _]| [x, y, 0.0]);
        let camera = Pinhole {
            rotation: upright,
            translation: [0.2, 0.1, 4.0],
            ..Pinhole::ideal(500.0, [160.0, 120.0])
        };
        let torso = Torso { points, pixels_px: points.map(|p| camera.project(p).expect("in front")) };
        let t = torso.translation(&camera, &upright).expect("a torso");
        // The sides lean, so that their pictures are the same multiple of their lengths.
        assert!(distance(t, [0.2, 0.1, 4.0]) < 1e-9, "{t:?}");
    }

    #[test]
    fn camera_step_finds_a_tilted_camera_that_the_depth_allows() {
        let (truth, torso) = planted([3.0, 0.1, -0.05], [0.1, -0.2, 4.0]);
        let upright = rodrigues([std::f64::consts::PI, 0.0, 0.0]);
        let found = torso.camera(&truth, &upright).expect("a torso");
        for p in POINTS {
            let (a, b) = (found.project(p).expect("in front"), truth.project(p).expect("in front"));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.5, "{a:?} {b:?}");
        }
        assert!(max_abs(&sub(&found.rotation, &truth.rotation)) < 0.3, "{:?}", found.rotation);
    }

    #[test]
    fn jacobian_is_its_central_difference() {
        let (camera, mut torso) = planted([2.9, 0.3, -0.2], [0.1, -0.2, 3.0]);
        torso.pixels_px[1][0] += 4.0;
        let step = CameraStep { torso: &torso, camera: &camera, depth: 2.8 };
        let x = [2.7, 0.2, -0.1, 0.2, -0.1, 3.1];
        let jacobian = step.jacobian(&x);
        for c in 0..6 {
            let moved = |h: f64| {
                let mut x = x;
                x[c] += h;
                step.residuals(&x).expect("in front")
            };
            for (i, (above, below)) in moved(1e-5).iter().zip(moved(-1e-5)).enumerate() {
                assert!((jacobian[(i, c)] - (above - below) / 2e-5).abs() < 1e-6, "{i} {c}");
            }
        }
    }

    #[test]
    fn a_torso_seen_as_a_point_has_no_distance() {
        let (camera, mut torso) = planted([3.0, 0.0, 0.0], [0.0, 0.0, 3.0]);
        torso.pixels_px = [[100.0, 100.0]; 4];
        assert_eq!(torso.camera(&camera, &camera.rotation), None);
    }
}

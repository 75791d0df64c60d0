//! Rings of cameras around the origin.

use rand::Rng;
use vitruvian_reference::linalg::vector::{Vector3, cross, normalize, scale};
use vitruvian_runtime::capture::{Camera, Extrinsics};

/// Draws `views` pinhole cameras on a jittered ring: 360°/N apart ± 8°, raised 0–14°, 3.8–4.4 m from `target`, named by
/// where they stand: `yaw_000` at +Z, `yaw_090` at +X. The person faces anywhere.
///
/// The focal length makes 2.2 m fill the picture at that distance, and a camera is moved back until every one of
/// `points` (world frame, metres) lies inside its picture by a margin of 2 %.
pub fn random_rig(
    rng: &mut impl Rng,
    views: usize,
    size_px: u32,
    target: Vector3,
    points: &[Vector3],
) -> Vec<Camera> {
    (0..views)
        .map(|k| {
            let yaw =
                std::f64::consts::TAU * k as f64 / views as f64 + rng.random_range(-8f64..8.0).to_radians();
            let raised = rng.random_range(0f64..14.0).to_radians();
            let mut distance = rng.random_range(3.8..4.4);
            let aim: Vector3 = std::array::from_fn(|a| target[a] + rng.random_range(-0.03..0.03));
            let name = format!("yaw_{:03}", (360.0 * k as f64 / views as f64).round());
            let focal_px = f64::from(size_px) * 4.1 / 2.2;
            loop {
                let camera = look_at(&name, size_px, focal_px, aim, [yaw, raised, distance]);
                if points.iter().all(|&p| is_inside(&camera, p)) || distance > 40.0 {
                    return camera;
                }
                distance *= 1.04;
            }
        })
        .collect()
}

/// A camera `distance` metres from `aim` towards heading `yaw` (0 = +Z, π/2 = +X) and `raised` above the horizon.
fn look_at(
    name: &str,
    size_px: u32,
    focal_px: f64,
    aim: Vector3,
    [yaw, raised, distance]: [f64; 3],
) -> Camera {
    let towards = [yaw.sin() * raised.cos(), raised.sin(), yaw.cos() * raised.cos()];
    let centre: Vector3 = std::array::from_fn(|a| aim[a] + distance * towards[a]);
    let forward = scale(towards, -1.0);
    let right = normalize(cross(forward, [0.0, 1.0, 0.0]));
    let down = cross(forward, right);
    let r = [right, down, forward];
    let t = std::array::from_fn(|i| -(0..3).map(|j| r[i][j] * centre[j]).sum::<f64>());
    let c = f64::from(size_px) / 2.0;
    Camera {
        name: name.to_owned(),
        width: size_px,
        height: size_px,
        k: [[focal_px, 0.0, c], [0.0, focal_px, c], [0.0, 0.0, 1.0]],
        extrinsics: Some(Extrinsics { r, t }),
        distortion: [0.0; 5],
    }
}

fn is_inside(camera: &Camera, point: Vector3) -> bool {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    camera
        .project(point)
        .is_some_and(|([u, v], _)| u > 0.02 * w && u < 0.98 * w && v > 0.02 * h && v < 0.98 * h)
}

//! Points in space from their pixels in several known cameras.

use crate::camera::Pinhole;
use crate::linalg::matrix::{self, IDENTITY, Matrix3, apply_transposed, inverse, outer};
use crate::linalg::vector::{Vector3, add, norm, scale, sub};
use crate::robust_loss::{rho, weight};

/// A pixel of the point that is sought.
#[derive(Clone, Copy, Debug)]
pub struct Sighting<'a> {
    /// The camera that saw it.
    pub camera: &'a Pinhole,
    /// Where.
    pub pixel_px: [f64; 2],
    /// How much it counts.
    pub weight: f64,
}

/// A misplaced detection is one this far from the others' point, as a fraction of the focal length: 8 px at f = 400 px.
const OUTLIER: f64 = 0.02;

/// Steps of the refinement; each gains digits, and a start needs few.
const REFINEMENTS: usize = 4;

/// The point that sightings from at least two centres agree on, or `None` if the rays are parallel or it is behind a camera.
///
/// First the point nearest to the rays: Σ w (I − d dᵀ)(X − c) = 0 is a linear 3×3 system. If some sighting is far from it,
/// every pair of views proposes a point and the one of least robust error over all views is taken, so that one wrong
/// detection among three or more views does no harm. Then Gauss–Newton on the reprojection errors under Geman–McClure.
///
/// # References
/// Hartley, Zisserman, "Multiple View Geometry in Computer Vision", ch. 12.
pub fn triangulate(sightings: &[Sighting]) -> Option<Vector3> {
    let rays: Vec<(Vector3, Vector3)> = sightings.iter().map(ray).collect::<Option<_>>()?;
    let all: Vec<usize> = (0..sightings.len()).collect();
    let start = nearest_to_rays(sightings, &rays, &all);
    let mut best = start.map(|x| (robust_error(sightings, x), x));
    let consistent =
        best.is_some_and(|(_, x)| sightings.iter().all(|s| error(s, x).is_some_and(|e| e < OUTLIER)));
    if !consistent && sightings.len() > 2 {
        for b in 1..sightings.len() {
            for a in 0..b {
                let Some(x) = nearest_to_rays(sightings, &rays, &[a, b]) else { continue };
                let error = robust_error(sightings, x);
                if best.is_none_or(|(least, _)| error < least) {
                    best = Some((error, x));
                }
            }
        }
    }
    let (_, x) = best.filter(|(error, _)| error.is_finite())?;
    Some(refine(sightings, x))
}

/// Centre and unit direction of the ray of a sighting, in the world.
fn ray(s: &Sighting) -> Option<(Vector3, Vector3)> {
    let [x, y] = s.camera.normalized(s.pixel_px)?;
    let direction = apply_transposed(&s.camera.rotation, [x, y, 1.0]);
    Some((s.camera.center(), scale(direction, 1.0 / norm(direction))))
}

fn nearest_to_rays(sightings: &[Sighting], rays: &[(Vector3, Vector3)], chosen: &[usize]) -> Option<Vector3> {
    let mut a: Matrix3 = [[0.0; 3]; 3];
    let mut b = [0.0; 3];
    let mut total = 0.0;
    for &i in chosen {
        let (center, direction) = rays[i];
        let across =
            matrix::scaled(&matrix::sub(&IDENTITY, &outer(direction, direction)), sightings[i].weight);
        a = matrix::add(&a, &across);
        b = add(b, matrix::apply(&across, center));
        total += sightings[i].weight;
    }
    // Parallel rays leave their direction open; det ≈ sin² of the angle between the rays.
    (matrix::determinant(&a) > 1e-6 * total * total * total)
        .then(|| inverse(&a))?
        .map(|a| matrix::apply(&a, b))
}

/// The error in units of the focal length; `None` behind the camera.
fn error(s: &Sighting, x: Vector3) -> Option<f64> {
    let [u, v] = s.camera.project(x)?;
    Some(((u - s.pixel_px[0]) / s.camera.focal_px[0]).hypot((v - s.pixel_px[1]) / s.camera.focal_px[1]))
}

/// Σ w ρ(error); infinite if the point is behind a camera that saw it.
fn robust_error(sightings: &[Sighting], x: Vector3) -> f64 {
    sightings.iter().map(|s| error(s, x).map_or(f64::INFINITY, |e| s.weight * rho(e, OUTLIER))).sum()
}

fn refine(sightings: &[Sighting], mut x: Vector3) -> Vector3 {
    let mut least = robust_error(sightings, x);
    for _ in 0..REFINEMENTS {
        let mut gram = [[0.0; 3]; 3];
        let mut gradient = [0.0; 3];
        for s in sightings {
            let (Some([u, v]), Some(slope)) = (s.camera.project(x), s.camera.project_derivative(x)) else {
                return x;
            };
            let [f, g] = s.camera.focal_px;
            let e = [(u - s.pixel_px[0]) / f, (v - s.pixel_px[1]) / g];
            let w = s.weight * weight(e[0].hypot(e[1]), OUTLIER);
            for (i, focal) in [f, g].into_iter().enumerate() {
                let row = scale(slope.point[i], 1.0 / focal);
                gram = matrix::add(&gram, &matrix::scaled(&outer(row, row), w));
                gradient = add(gradient, scale(row, w * e[i]));
            }
        }
        let Some(inverse) = inverse(&gram) else { return x };
        let candidate = sub(x, matrix::apply(&inverse, gradient));
        let error = robust_error(sightings, candidate);
        if error.is_nan() || error >= least {
            return x;
        }
        (x, least) = (candidate, error);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::distance;
    use crate::rotation::rodrigues;

    /// Cameras on a ring of 4 m about the origin, image y down.
    fn ring(count: usize) -> Vec<Pinhole> {
        (0..count)
            .map(|i| {
                let yaw = rodrigues([0.0, 1.2 * i as f64, 0.0]);
                let upright = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
                Pinhole {
                    rotation: matrix::mul(&upright, &yaw),
                    translation: [0.0, 0.0, 4.0],
                    distortion: [-0.05, 0.01, 0.001, 0.0, 0.0],
                    ..Pinhole::ideal(400.0, [160.0, 120.0])
                }
            })
            .collect()
    }

    fn sightings<'a>(cameras: &'a [Pinhole], x: Vector3) -> Vec<Sighting<'a>> {
        let see = |camera: &'a Pinhole| Sighting {
            camera,
            pixel_px: camera.project(x).expect("in front"),
            weight: 1.0,
        };
        cameras.iter().map(see).collect()
    }

    const POINT: Vector3 = [0.4, -0.7, 0.2];

    #[test]
    fn exact_pixels_give_the_point() {
        for count in 2..5 {
            let cameras = ring(count);
            let found = triangulate(&sightings(&cameras, POINT)).expect("a point");
            assert!(distance(found, POINT) < 1e-9, "{count} views: {found:?}");
        }
    }

    #[test]
    fn one_wrong_detection_of_four_does_no_harm() {
        let cameras = ring(4);
        for wrong in 0..4 {
            let mut sightings = sightings(&cameras, POINT);
            sightings[wrong].pixel_px[0] += 90.0;
            let found = triangulate(&sightings).expect("a point");
            assert!(distance(found, POINT) < 1e-2, "view {wrong}: {}", distance(found, POINT));
        }
    }

    #[test]
    fn one_view_and_parallel_rays_have_no_point() {
        let cameras = ring(1);
        assert_eq!(triangulate(&sightings(&cameras, POINT)), None);
        let twice = [cameras[0], cameras[0]];
        assert_eq!(triangulate(&sightings(&twice, POINT)), None);
    }
}

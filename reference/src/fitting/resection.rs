//! A camera from points in space and where it saw them.

use crate::linalg::cholesky::Cholesky;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, apply, mul};
use crate::linalg::vector::{Vector3, add, centroid, cross, distance, scale, sub};
use crate::robust_loss::{rho, weight};
use crate::rotation::{angle_between, rodrigues};
use std::f64::consts::TAU;

/// A point and where it was seen.
#[derive(Clone, Copy, Debug)]
pub struct Landmark {
    /// X, in any frame and unit.
    pub point: Vector3,
    /// (X_c/Z_c, Y_c/Z_c) as seen.
    pub seen: [f64; 2],
    /// How much it counts.
    pub weight: f64,
}

/// X_c = R X + t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resected {
    /// R.
    pub rotation: Matrix3,
    /// t, in the unit of the points.
    pub translation: Vector3,
    /// Σ w ρ(error), in units of the focal length squared.
    pub error: f64,
}

/// The least number of landmarks: three leave up to four cameras.
pub const LEAST_LANDMARKS: usize = 4;

const YAWS: usize = 8;
const MAX_ITERATIONS: usize = 15;
const SAME_RAD: f64 = 0.15;

/// The cameras that see the landmarks where they were seen, best first and at most `limit`, by descent from a search over yaw
/// about the frame's y axis after `upright`; errors beyond `sigma` (in units of the focal length) count as outliers.
///
/// `upright` turns the landmarks' frame so that its y axis points down in the picture: the half-turn about x for a body's
/// frame, the identity for another camera's.
pub fn resect(landmarks: &[Landmark], upright: &Matrix3, sigma: f64, limit: usize) -> Vec<Resected> {
    if landmarks.len() < LEAST_LANDMARKS {
        return Vec::new();
    }
    let points: Vec<Vector3> = landmarks.iter().map(|l| l.point).collect();
    let middle = centroid(&points);
    let total: f64 = landmarks.iter().map(|l| l.weight).sum();
    let seen: [f64; 2] =
        std::array::from_fn(|i| landmarks.iter().map(|l| l.weight * l.seen[i]).sum::<f64>() / total);
    // Points spread by this much across are seen spread by that much.
    let size = points.iter().map(|&p| distance(p, middle)).sum::<f64>() / points.len() as f64;
    let apparent = landmarks.iter().map(|l| (l.seen[0] - seen[0]).hypot(l.seen[1] - seen[1])).sum::<f64>()
        / landmarks.len() as f64;
    if size.is_nan() || apparent.is_nan() || size <= 0.0 || apparent <= 0.0 {
        return Vec::new();
    }
    let depth = size / apparent;
    let mut found: Vec<Resected> = Vec::new();
    for n in 0..YAWS {
        let rotation = mul(upright, &rodrigues([0.0, TAU * n as f64 / YAWS as f64, 0.0]));
        let translation = sub(scale([seen[0], seen[1], 1.0], depth), apply(&rotation, middle));
        let Some(camera) = descend(landmarks, middle, rotation, translation, sigma) else { continue };
        match found.iter_mut().find(|f| angle_between(&f.rotation, &camera.rotation) < SAME_RAD) {
            Some(other) if other.error <= camera.error => {}
            Some(other) => *other = camera,
            None => found.push(camera),
        }
    }
    found.sort_by(|a, b| a.error.total_cmp(&b.error));
    found.truncate(limit);
    found
}

/// Σ w ρ(error); `None` if a point is not in front.
fn total_error(landmarks: &[Landmark], rotation: &Matrix3, translation: Vector3, sigma: f64) -> Option<f64> {
    landmarks
        .iter()
        .map(|l| {
            let [x, y, z] = add(apply(rotation, l.point), translation);
            (z > 0.0).then(|| l.weight * rho((x / z - l.seen[0]).hypot(y / z - l.seen[1]), sigma))
        })
        .sum()
}

/// Levenberg–Marquardt over exp(ω) about the points' middle and t.
fn descend(
    landmarks: &[Landmark],
    middle: Vector3,
    mut rotation: Matrix3,
    mut translation: Vector3,
    sigma: f64,
) -> Option<Resected> {
    let mut least = total_error(landmarks, &rotation, translation, sigma)?;
    let mut damping = 1e-3;
    for _ in 0..MAX_ITERATIONS {
        let mut gram = Dense::zeros(6, 6);
        let mut gradient = [0.0; 6];
        for l in landmarks {
            let arm = apply(&rotation, sub(l.point, middle));
            let [x, y, z] = add(apply(&rotation, l.point), translation);
            let e = [x / z - l.seen[0], y / z - l.seen[1]];
            let w = l.weight * weight(e[0].hypot(e[1]), sigma);
            for (by_point, e) in
                [[1.0 / z, 0.0, -x / (z * z)], [0.0, 1.0 / z, -y / (z * z)]].into_iter().zip(e)
            {
                // ω turns about the middle: d X_c = ω × arm.
                let by_turn = cross(arm, by_point);
                let row = [by_turn[0], by_turn[1], by_turn[2], by_point[0], by_point[1], by_point[2]];
                for i in 0..6 {
                    gradient[i] += w * e * row[i];
                    for j in 0..=i {
                        gram[(i, j)] += w * row[i] * row[j];
                    }
                }
            }
        }
        for i in 0..6 {
            gram[(i, i)] *= 1.0 + damping;
            gram[(i, i)] += 1e-12;
        }
        let step = Cholesky::factor(&gram)?.solve(&gradient);
        let new_rotation = mul(&rodrigues([-step[0], -step[1], -step[2]]), &rotation);
        // The middle moves by the step's translation alone.
        let at = sub(add(apply(&rotation, middle), translation), [step[3], step[4], step[5]]);
        let new_translation = sub(at, apply(&new_rotation, middle));
        match total_error(landmarks, &new_rotation, new_translation, sigma) {
            Some(error) if error < least => {
                let settled = least - error < 1e-6 * least;
                (rotation, translation, least) = (new_rotation, new_translation, error);
                damping *= 0.2;
                if settled {
                    break;
                }
            }
            _ => damping *= 10.0,
        }
    }
    Some(Resected { rotation, translation, error: least })
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{joints, person, ring};
    use super::*;
    use std::f64::consts::PI;

    fn landmarks(seed: u32, camera: usize) -> Vec<Landmark> {
        let camera = ring(4)[camera];
        let landmark = |point: Vector3| {
            let [x, y, z] = camera.to_camera(point);
            Landmark { point, seen: [x / z, y / z], weight: 1.0 }
        };
        joints(&person(seed)).into_iter().map(landmark).collect()
    }

    #[test]
    fn exact_landmarks_give_the_camera() {
        let upright = rodrigues([PI, 0.0, 0.0]);
        for (seed, camera) in [(0, 0), (1, 1), (2, 2), (3, 3)] {
            let truth = ring(4)[camera];
            let found = resect(&landmarks(seed, camera), &upright, 0.1, 1)[0];
            assert!(angle_between(&found.rotation, &truth.rotation) < 1e-5, "camera {camera}");
            assert!(distance(found.translation, truth.translation) < 1e-4, "camera {camera}");
        }
    }

    #[test]
    fn a_wrong_landmark_does_not_decide() {
        let mut landmarks = landmarks(1, 2);
        landmarks[3].seen[0] += 0.2;
        let found = resect(&landmarks, &rodrigues([PI, 0.0, 0.0]), 0.02, 1)[0];
        assert!(angle_between(&found.rotation, &ring(4)[2].rotation) < 0.02);
    }

    #[test]
    fn too_few_or_coincident_landmarks_have_no_camera() {
        let upright = rodrigues([PI, 0.0, 0.0]);
        assert!(resect(&landmarks(0, 0)[..3], &upright, 0.1, 4).is_empty());
        let spot = [Landmark { point: [0.0; 3], seen: [0.1, 0.1], weight: 1.0 }; 6];
        assert!(resect(&spot, &upright, 0.1, 4).is_empty());
    }
}

//! Where a camera stands when its rotation is known, by linear least squares.
//!
//! A point X (camera axes, relative to the body) is seen along the ray (x, y, 1). X + t lies on that ray if
//!
//! ```text
//!     t_x − x t_z = x Z − X,        t_y − y t_z = y Z − Y:
//! ```
//!
//! two equations in the three unknowns of t for each point, linear, so that there is neither start nor iteration. In pixels
//! they are the equations f t_x + (c_x − u) t_z = (u − c_x) Z − f X of the systems that Li 2021, ch. 4 builds on.
//!
//! For given t_z the best t_x and t_y are weighted means; put in, one equation for t_z is left. With a = x Z − X, b = y Z − Y
//! and means over the weights w f²:
//!
//! ```text
//!     t_z = −Σ w [f_x² (x − x̄)(a − ā) + f_y² (y − ȳ)(b − b̄)] / Σ w [f_x² (x − x̄)² + f_y² (y − ȳ)²],
//!     t_x = ā + x̄ t_z,   t_y = b̄ + ȳ t_z.
//! ```

use super::observation::Keypoint;
use crate::camera::Pinhole;
use crate::linalg::vector::Vector3;

/// The two equations of a point.
struct Row {
    /// (x, y).
    ray: [f64; 2],
    /// (a, b).
    side: [f64; 2],
    weight: f64,
}

/// The translation t, metres, under which the points X, seen as X + t, come nearest to where the `keypoints` were seen; each
/// weighs by its confidence. `None` if fewer than two keypoints count, they are seen at one place, or t_z ≤ 0.
///
/// Of the camera focal length, principal point and lens are read. The error that is minimised is that on the plane of each
/// point's own depth, times f/t_z in pixels: far points count for more than in pixels, by (Z + t_z)²/t_z².
///
/// # Panics
/// If there is not one keypoint for each point.
///
/// # References
/// Kolotouros, Pavlakos, Black, Daniilidis 2019 (SPIN), whose fits start there; Li 2021, ch. 4.
///
/// ```
/// use vitruvian_reference::camera::Pinhole;
/// use vitruvian_reference::fitting::{Keypoint, camera_translation::least_squares_translation};
///
/// let camera = Pinhole { translation: [0.1, -0.2, 4.0], ..Pinhole::ideal(500.0, [112.0, 112.0]) };
/// let points = [[0.0, 0.5, 0.1], [0.2, 0.0, 0.0], [-0.3, -0.4, -0.2]];
/// let seen = points.map(|p| Keypoint { pixel_px: camera.project(p).unwrap(), confidence: 1.0 });
/// let t = least_squares_translation(&camera, &points, &seen).unwrap();
/// assert!(t.iter().zip(camera.translation).all(|(found, planted)| (found - planted).abs() < 1e-12));
/// ```
pub fn least_squares_translation(
    camera: &Pinhole,
    points: &[Vector3],
    keypoints: &[Keypoint],
) -> Option<Vector3> {
    assert!(
        points.len() == keypoints.len(),
        "least_squares_translation: {} points, {} keypoints",
        points.len(),
        keypoints.len()
    );
    let rows: Vec<Row> = points
        .iter()
        .zip(keypoints)
        .filter(|(_, keypoint)| keypoint.confidence > 0.0)
        .filter_map(|(point, keypoint)| {
            let ray = camera.normalized(keypoint.pixel_px)?;
            let side = std::array::from_fn(|i| ray[i] * point[2] - point[i]);
            Some(Row { ray, side, weight: keypoint.confidence })
        })
        .collect();
    let total: f64 = rows.iter().map(|row| row.weight).sum();
    let mean_ray: [f64; 2] =
        std::array::from_fn(|i| rows.iter().map(|row| row.weight * row.ray[i]).sum::<f64>() / total);
    let mean_side: [f64; 2] =
        std::array::from_fn(|i| rows.iter().map(|row| row.weight * row.side[i]).sum::<f64>() / total);
    let (mut spread, mut product) = (0.0, 0.0);
    for row in &rows {
        for i in 0..2 {
            let (off, gain) =
                (row.ray[i] - mean_ray[i], row.weight * camera.focal_px[i] * camera.focal_px[i]);
            spread += gain * off * off;
            product += gain * off * (row.side[i] - mean_side[i]);
        }
    }
    let t_z = -product / spread;
    let t = [mean_side[0] + mean_ray[0] * t_z, mean_side[1] + mean_ray[1] * t_z, t_z];
    (t_z > 0.0 && t.iter().all(|x| x.is_finite())).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::distance;

    const POINTS: [Vector3; 5] =
        [[0.0, 0.5, 0.1], [0.2, 0.0, 0.0], [-0.3, -0.4, -0.2], [0.1, 0.3, 0.3], [-0.2, 0.2, 0.0]];

    fn camera() -> Pinhole {
        Pinhole {
            focal_px: [900.0, 940.0],
            distortion: [-0.15, 0.03, 0.002, -0.001, 0.01],
            translation: [0.3, -0.2, 3.5],
            ..Pinhole::ideal(1.0, [256.0, 250.0])
        }
    }

    fn seen() -> Vec<Keypoint> {
        let see =
            |p: &Vector3| Keypoint { pixel_px: camera().project(*p).expect("in front"), confidence: 0.5 };
        POINTS.iter().map(see).collect()
    }

    #[test]
    fn a_planted_translation_is_found_through_a_lens() {
        let t = least_squares_translation(&camera(), &POINTS, &seen()).expect("an answer");
        assert!(distance(t, camera().translation) < 1e-12, "{t:?}");
    }

    #[test]
    fn keypoints_without_confidence_do_not_count() {
        let mut keypoints = seen();
        keypoints[1] = Keypoint { pixel_px: [-500.0, 900.0], confidence: 0.0 };
        let t = least_squares_translation(&camera(), &POINTS, &keypoints).expect("an answer");
        assert!(distance(t, camera().translation) < 1e-12, "{t:?}");
    }

    #[test]
    fn the_answer_is_the_minimum_of_the_weighted_squares() {
        let camera = camera();
        let mut keypoints = seen();
        for (k, keypoint) in keypoints.iter_mut().enumerate() {
            keypoint.pixel_px[k % 2] += 3.0 - k as f64;
            keypoint.confidence = 0.2 + 0.3 * k as f64;
        }
        let squares = |t: Vector3| -> f64 {
            POINTS
                .iter()
                .zip(&keypoints)
                .map(|(p, keypoint)| {
                    let ray = camera.normalized(keypoint.pixel_px).expect("a ray");
                    let off = |i: usize| camera.focal_px[i] * (p[i] + t[i] - ray[i] * (p[2] + t[2]));
                    keypoint.confidence * (off(0).powi(2) + off(1).powi(2))
                })
                .sum()
        };
        let t = least_squares_translation(&camera, &POINTS, &keypoints).expect("an answer");
        for axis in 0..3 {
            for step in [-1e-3, 1e-3] {
                let mut moved = t;
                moved[axis] += step;
                assert!(squares(moved) > squares(t), "axis {axis}");
            }
        }
    }

    #[test]
    fn one_place_or_one_point_has_no_depth() {
        let mut keypoints = seen();
        for keypoint in &mut keypoints {
            keypoint.pixel_px = [100.0, 100.0];
        }
        assert_eq!(least_squares_translation(&camera(), &POINTS, &keypoints), None, "one place");
        assert_eq!(least_squares_translation(&camera(), &POINTS[..1], &seen()[..1]), None, "one point");
        assert_eq!(least_squares_translation(&camera(), &[], &[]), None, "no point");
        // A body seen mirrored would have to stand behind the camera.
        let mirrored = POINTS.map(|[x, y, z]| [-x, -y, z]);
        assert_eq!(least_squares_translation(&camera(), &mirrored, &seen()), None, "behind");
    }
}

//! Cameras: from world points to pixels, with derivatives.
//!
//! World points are metres, +Y up. A camera looks along its +z with x to the right and y *down*: X_c = R X + t. Pixels are
//! continuous with the origin at the image's top-left *corner*, so the centre of pixel (row i, column j) is
//! (j + ½, i + ½); calibrations that put integers at pixel centres have ½ to add to their principal point.

use crate::linalg::matrix::{Matrix3, apply, apply_transposed, mul};
use crate::linalg::vector::{Vector3, add, negate, sub};
use crate::rotation::skew;

/// A 2×3 matrix: the derivative of two coordinates with respect to three.
pub type Matrix2x3 = [[f64; 3]; 2];

/// A pinhole camera with OpenCV's five distortion coefficients.
///
/// # Conventions
/// Li 2021 writes the projection of eq. 2.3 as R J + t, without a division by depth; the pinhole below is meant
/// (erratum E7).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// f_x, f_y in pixels.
    pub focal_px: [f64; 2],
    /// c_x, c_y in pixels from the top-left corner of the image.
    pub principal_px: [f64; 2],
    /// k₁, k₂, p₁, p₂, k₃: radial, radial, tangential, tangential, radial. Zeros for an ideal lens.
    pub distortion: [f64; 5],
    /// R, world to camera.
    pub rotation: Matrix3,
    /// t, metres: the world's origin in camera coordinates.
    pub translation: Vector3,
}

/// The derivatives of a pixel (u, v), each 2×3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelDerivative {
    /// With respect to the world point.
    pub point: Matrix2x3,
    /// With respect to δ in exp(δ)·R at δ = 0: an angular velocity in camera axes. For an axis–angle parameter r multiply
    /// by the [left Jacobian](crate::rotation::left_jacobian) J_l(r) from the right.
    pub rotation: Matrix2x3,
    /// With respect to t; the same as with respect to the point in camera coordinates.
    pub translation: Matrix2x3,
}

impl Pinhole {
    /// The ideal pinhole of one focal length (pixels) at the world's origin, looking along +z.
    pub fn ideal(focal_px: f64, principal_px: [f64; 2]) -> Pinhole {
        Pinhole {
            focal_px: [focal_px; 2],
            principal_px,
            distortion: [0.0; 5],
            rotation: crate::linalg::matrix::IDENTITY,
            translation: [0.0; 3],
        }
    }

    /// X_c = R X + t, metres.
    pub fn to_camera(&self, point: Vector3) -> Vector3 {
        add(apply(&self.rotation, point), self.translation)
    }

    /// The centre of projection in the world: −Rᵀ t.
    pub fn center(&self) -> Vector3 {
        negate(apply_transposed(&self.rotation, self.translation))
    }

    /// The pixel (u, v) of a world point, or `None` where it is not in front of the camera (Z ≤ 0).
    ///
    /// (x, y) = (X/Z, Y/Z), distorted to (x′, y′) by [`distort`]; u = f_x x′ + c_x, v = f_y y′ + c_y.
    ///
    /// ```
    /// let camera = vitruvian_reference::camera::Pinhole::ideal(500.0, [320.0, 240.0]);
    /// assert_eq!(camera.project([0.1, -0.2, 2.0]), Some([345.0, 190.0]));
    /// ```
    pub fn project(&self, point: Vector3) -> Option<[f64; 2]> {
        let [x, y, z] = self.to_camera(point);
        (z > 0.0).then(|| {
            let ideal = distort(&self.distortion, [x / z, y / z]);
            std::array::from_fn(|i| self.focal_px[i] * ideal[i] + self.principal_px[i])
        })
    }

    /// The world point at depth Z that projects onto a pixel: the inverse of [`Pinhole::project`]; `None` where the lens model has
    /// no inverse that Newton's method finds (far outside of a strongly distorted image).
    ///
    /// X = Rᵀ (Z·(x, y, 1) − t), where (x, y) is the ideal ray that the lens bends to ((u − c_x)/f_x, (v − c_y)/f_y).
    ///
    /// ```
    /// let camera = vitruvian_reference::camera::Pinhole::ideal(500.0, [320.0, 240.0]);
    /// assert_eq!(camera.unproject([345.0, 190.0], 2.0), Some([0.1, -0.2, 2.0]));
    /// ```
    pub fn unproject(&self, pixel_px: [f64; 2], depth_m: f64) -> Option<Vector3> {
        let [x, y] = self.normalized(pixel_px)?;
        let in_camera = [x * depth_m, y * depth_m, depth_m];
        Some(apply_transposed(&self.rotation, sub(in_camera, self.translation)))
    }

    /// The point (X_c/Z_c, Y_c/Z_c) at depth 1 that [`Pinhole::project`] takes to a pixel; `None` as for
    /// [`Pinhole::unproject`].
    ///
    /// ```
    /// let camera = vitruvian_reference::camera::Pinhole::ideal(500.0, [320.0, 240.0]);
    /// assert_eq!(camera.normalized([345.0, 190.0]), Some([0.05, -0.1]));
    /// ```
    pub fn normalized(&self, pixel_px: [f64; 2]) -> Option<[f64; 2]> {
        let bent = std::array::from_fn(|i| (pixel_px[i] - self.principal_px[i]) / self.focal_px[i]);
        undistort(&self.distortion, bent)
    }

    /// [`Pinhole::project`] and its derivative with respect to the point in camera coordinates (which is that with respect to
    /// t), in one pass; `None` where the point is not in front of the camera.
    ///
    /// ```
    /// let camera = vitruvian_reference::camera::Pinhole::ideal(500.0, [320.0, 240.0]);
    /// let (pixel, by_point) = camera.project_with_derivative([0.1, -0.2, 2.0]).expect("in front");
    /// assert_eq!((pixel, by_point), ([345.0, 190.0], [[250.0, 0.0, -12.5], [0.0, 250.0, 25.0]]));
    /// ```
    pub fn project_with_derivative(&self, point: Vector3) -> Option<([f64; 2], Matrix2x3)> {
        let [x, y, z] = self.to_camera(point);
        if z <= 0.0 || z.is_nan() {
            return None;
        }
        let ray = [x / z, y / z];
        let ideal = distort(&self.distortion, ray);
        let lens = distort_derivative(&self.distortion, ray);
        let by_point = |i: usize| -> Vector3 {
            let [by_x, by_y] = lens[i].map(|d| self.focal_px[i] * d / z);
            [by_x, by_y, -(by_x * ray[0] + by_y * ray[1])]
        };
        let pixel = std::array::from_fn(|i| self.focal_px[i] * ideal[i] + self.principal_px[i]);
        Some((pixel, [by_point(0), by_point(1)]))
    }

    /// The derivatives of [`Pinhole::project`], or `None` where the point is not in front of the camera.
    ///
    /// With D the 2×2 derivative of the distortion and ∂(x, y)/∂X_c = \[1/Z, 0, −X/Z²; 0, 1/Z, −Y/Z²\]:
    /// ∂u/∂X_c = diag(f) D ∂(x, y)/∂X_c, ∂X_c/∂X = R, ∂X_c/∂t = I, ∂X_c/∂δ = −\[R X\]×.
    pub fn project_derivative(&self, point: Vector3) -> Option<PixelDerivative> {
        let rotated = apply(&self.rotation, point);
        let [x, y, z] = add(rotated, self.translation);
        if z <= 0.0 || z.is_nan() {
            return None;
        }
        let perspective: Matrix2x3 = [[1.0 / z, 0.0, -x / (z * z)], [0.0, 1.0 / z, -y / (z * z)]];
        let lens = distort_derivative(&self.distortion, [x / z, y / z]);
        let translation: Matrix2x3 = std::array::from_fn(|i| {
            std::array::from_fn(|c| {
                self.focal_px[i] * (lens[i][0] * perspective[0][c] + lens[i][1] * perspective[1][c])
            })
        });
        Some(PixelDerivative {
            point: times(&translation, &self.rotation),
            rotation: times(&translation, &skew(negate(rotated))),
            translation,
        })
    }
}

/// A 2×3 times a 3×3 matrix.
fn times(a: &Matrix2x3, b: &Matrix3) -> Matrix2x3 {
    let product = mul(&[a[0], a[1], [0.0; 3]], b);
    [product[0], product[1]]
}

/// OpenCV's lens: where the ideal ray (x, y) at depth 1 ends up, for coefficients k₁, k₂, p₁, p₂, k₃.
///
/// With r² = x² + y² and L = 1 + k₁r² + k₂r⁴ + k₃r⁶:
/// x′ = x L + 2 p₁ x y + p₂ (r² + 2x²), y′ = y L + p₁ (r² + 2y²) + 2 p₂ x y.
pub fn distort(coefficients: &[f64; 5], [x, y]: [f64; 2]) -> [f64; 2] {
    let [k1, k2, p1, p2, k3] = *coefficients;
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    [
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    ]
}

/// The ideal ray (x, y) that [`distort`] takes to (x′, y′), by Newton's method from (x′, y′); `None` if it does not settle,
/// or settles where the lens model has folded the image over.
pub fn undistort(coefficients: &[f64; 5], bent: [f64; 2]) -> Option<[f64; 2]> {
    let mut ideal = bent;
    // A lens is nearly the identity: three or four steps, twice as many near the rim of a wide angle.
    for _ in 0..20 {
        let at = distort(coefficients, ideal);
        let miss = [bent[0] - at[0], bent[1] - at[1]];
        let [[a, b], [c, d]] = distort_derivative(coefficients, ideal);
        let det = a * d - b * c;
        if miss[0].abs().max(miss[1].abs()) <= 1e-15 * (1.0 + bent[0].abs().max(bent[1].abs())) {
            // Before the fold the lens keeps orientation and side.
            let unfolded = det > 0.0 && ideal[0] * bent[0] + ideal[1] * bent[1] >= 0.0;
            return unfolded.then_some(ideal);
        }
        ideal[0] += (d * miss[0] - b * miss[1]) / det;
        ideal[1] += (a * miss[1] - c * miss[0]) / det;
    }
    None
}

/// The 2×2 derivative of [`distort`] with respect to (x, y), row-major; symmetric.
fn distort_derivative(coefficients: &[f64; 5], [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
    let [k1, k2, p1, p2, k3] = *coefficients;
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    // dL/d(r²)
    let slope = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
    let mixed = 2.0 * (x * y * slope + p1 * x + p2 * y);
    [
        [radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed],
        [mixed, radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x],
    ]
}

/// The weak-perspective camera (s, t_x, t_y) that regressors predict for a square crop.
///
/// It is a pinhole of a long, fixed focal length whose distance carries the scale: translation (t_x, t_y, t_z) with
/// t_z = 2f/(S s + 10⁻⁹), no rotation. Keypoints are in −1…1 over the crop.
///
/// # References
/// Li 2021, ch. 4; Kolotouros et al. 2019 (SPIN), whose f = 5000 and S = 224 are [`WeakPerspective::SPIN_FOCAL_PX`] and
/// [`WeakPerspective::SPIN_SIDE_PX`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeakPerspective {
    /// s: a body of 1 m covers the fraction s/2 of the crop.
    pub scale: f64,
    /// t_x, t_y, metres.
    pub translation: [f64; 2],
    /// f, pixels of the crop.
    pub focal_px: f64,
    /// S, the side of the crop in pixels.
    pub side_px: f64,
}

impl WeakPerspective {
    /// f of SPIN, pixels.
    pub const SPIN_FOCAL_PX: f64 = 5000.0;
    /// S of SPIN, pixels.
    pub const SPIN_SIDE_PX: f64 = 224.0;
    /// Keeps t_z finite for a scale of zero.
    const SCALE_GUARD: f64 = 1e-9;

    /// The camera (s, t_x, t_y) with SPIN's focal length and crop.
    pub fn spin([scale, t_x, t_y]: [f64; 3]) -> WeakPerspective {
        WeakPerspective {
            scale,
            translation: [t_x, t_y],
            focal_px: Self::SPIN_FOCAL_PX,
            side_px: Self::SPIN_SIDE_PX,
        }
    }

    /// t_z = 2f/(S s + 10⁻⁹), metres.
    pub fn depth_m(&self) -> f64 {
        2.0 * self.focal_px / (self.side_px * self.scale + Self::SCALE_GUARD)
    }

    /// The same camera as a pinhole in pixels of the crop.
    ///
    /// # Conventions
    /// Image y points down. Regressors are trained on bodies that are turned upright in *camera* axes, so the root rotation
    /// they predict already contains the half-turn about x; no sign is changed here.
    pub fn to_pinhole(&self) -> Pinhole {
        let [t_x, t_y] = self.translation;
        Pinhole {
            translation: [t_x, t_y, self.depth_m()],
            ..Pinhole::ideal(self.focal_px, [0.5 * self.side_px; 2])
        }
    }

    /// The normalised keypoint, −1…1 over the crop, of a point in camera axes relative to the body (metres); `None` where it
    /// is not in front of the camera.
    ///
    /// (2f/S)·(X + t)_xy / (X + t)_z, close to s (X + t)_xy while the body is flat against t_z.
    pub fn project(&self, point: Vector3) -> Option<[f64; 2]> {
        let z = point[2] + self.depth_m();
        let gain = 2.0 * self.focal_px / self.side_px;
        (z > 0.0).then(|| std::array::from_fn(|i| gain * (point[i] + self.translation[i]) / z))
    }

    /// The derivative of [`WeakPerspective::project`] with respect to (s, t_x, t_y), 2×3, and with respect to the point, 2×3.
    ///
    /// ∂t_z/∂s = −t_z·S/(S s + 10⁻⁹).
    pub fn project_derivative(&self, point: Vector3) -> Option<[Matrix2x3; 2]> {
        let z = point[2] + self.depth_m();
        if z <= 0.0 || z.is_nan() {
            return None;
        }
        let gain = 2.0 * self.focal_px / self.side_px;
        let depth_slope = -self.depth_m() * self.side_px / (self.side_px * self.scale + Self::SCALE_GUARD);
        let by_depth: [f64; 2] = std::array::from_fn(|i| -gain * (point[i] + self.translation[i]) / (z * z));
        let lateral = gain / z;
        Some([
            [[by_depth[0] * depth_slope, lateral, 0.0], [by_depth[1] * depth_slope, 0.0, lateral]],
            [[lateral, 0.0, by_depth[0]], [0.0, lateral, by_depth[1]]],
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::{distance, norm};
    use crate::rotation::rodrigues;

    const POINT: Vector3 = [0.3, -0.4, 0.2];

    fn camera() -> Pinhole {
        Pinhole {
            focal_px: [900.0, 920.0],
            principal_px: [321.5, 238.0],
            distortion: [-0.21, 0.08, 0.003, -0.002, 0.01],
            rotation: rodrigues([3.0, 0.2, -0.1]),
            translation: [0.1, 0.05, 2.4],
        }
    }

    #[test]
    fn ideal_lens_changes_nothing() {
        assert_eq!(distort(&[0.0; 5], [0.3, -0.7]), [0.3, -0.7]);
    }

    #[test]
    fn distortion_by_hand() {
        // r² = 0.25; L = 1 + 0.1·0.25 + 0.2·0.0625 + 0.4·0.015625 = 1.04375.
        let [x, y] = distort(&[0.1, 0.2, 0.01, 0.02, 0.4], [0.3, 0.4]);
        assert!((x - (0.313125 + 0.0024 + 0.0086)).abs() < 1e-15, "{x}");
        assert!((y - (0.4175 + 0.0057 + 0.0048)).abs() < 1e-15, "{y}");
    }

    #[test]
    fn unprojecting_inverts_projecting() {
        let pixel = camera().project(POINT).expect("in front");
        let depth = camera().to_camera(POINT)[2];
        let back = camera().unproject(pixel, depth).expect("an inverse");
        assert!(distance(back, POINT) < 1e-14, "{back:?}");
        // 1 − 0.21 r² + … folds back before r = 5: no ray ends there.
        assert_eq!(undistort(&[-0.21, 0.0, 0.0, 0.0, 0.0], [5.0, 0.0]), None);
    }

    #[test]
    fn center_is_the_point_that_maps_to_the_origin() {
        assert!(norm(camera().to_camera(camera().center())) < 1e-14);
    }

    #[test]
    fn points_behind_have_no_pixel() {
        let camera = Pinhole::ideal(500.0, [0.0; 2]);
        assert_eq!(camera.project([0.0, 0.0, -1.0]), None);
        assert_eq!(camera.project([0.0, 0.0, 0.0]), None);
        assert_eq!(camera.project_derivative([0.0, 0.0, f64::NAN]), None);
    }

    /// The central difference of a pixel along each of three parameters.
    fn differences(pixel: impl Fn(Vector3) -> [f64; 2]) -> Matrix2x3 {
        const STEP: f64 = 1e-6;
        let mut derivative = [[0.0; 3]; 2];
        for c in 0..3 {
            let mut e = [0.0; 3];
            e[c] = STEP;
            let (plus, minus) = (pixel(e), pixel(negate(e)));
            for i in 0..2 {
                derivative[i][c] = (plus[i] - minus[i]) / (2.0 * STEP);
            }
        }
        derivative
    }

    fn assert_close(analytic: &Matrix2x3, numeric: &Matrix2x3, bound: f64) {
        for i in 0..2 {
            assert!(distance(analytic[i], numeric[i]) < bound, "{analytic:?} against {numeric:?}");
        }
    }

    #[test]
    fn pinhole_derivatives_are_those_of_the_pixel() {
        let camera = camera();
        let analytic = camera.project_derivative(POINT).expect("in front");
        // Pixels of size 10³ leave about 10³·ε/10⁻⁶ ≈ 10⁻⁷ of rounding in a difference quotient.
        let bound = 2e-6;
        assert_close(
            &analytic.point,
            &differences(|e| camera.project(add(POINT, e)).expect("in front")),
            bound,
        );
        let moved = |e| Pinhole { translation: add(camera.translation, e), ..camera };
        assert_close(
            &analytic.translation,
            &differences(|e| moved(e).project(POINT).expect("in front")),
            bound,
        );
        let turned = |e| Pinhole { rotation: mul(&rodrigues(e), &camera.rotation), ..camera };
        assert_close(
            &analytic.rotation,
            &differences(|e| turned(e).project(POINT).expect("in front")),
            bound,
        );
    }

    #[test]
    fn weak_perspective_golden() {
        // Computed once with f = 5000, S = 224 in plain double precision by an independent script.
        let camera = WeakPerspective::spin([0.9, 0.05, -0.02]);
        assert!((camera.depth_m() - 49.60317460292856).abs() < 1e-13);
        let [x, y] = camera.project([0.2, -0.1, 0.3]).expect("in front");
        assert!((x - 0.2236473806).abs() < 1e-10 && (y + 0.1073507427).abs() < 1e-10, "{x} {y}");
    }

    #[test]
    fn weak_perspective_is_its_pinhole_in_crop_units() {
        let camera = WeakPerspective::spin([0.8, -0.1, 0.2]);
        let normalised = camera.project(POINT).expect("in front");
        let pixel = camera.to_pinhole().project(POINT).expect("in front");
        for i in 0..2 {
            assert!((112.0 * (normalised[i] + 1.0) - pixel[i]).abs() < 1e-11);
        }
    }

    #[test]
    fn weak_perspective_derivatives_are_those_of_the_keypoint() {
        let parameters = [0.8, -0.1, 0.2];
        let [by_camera, by_point] =
            WeakPerspective::spin(parameters).project_derivative(POINT).expect("in front");
        let moved = |e| WeakPerspective::spin(add(parameters, e)).project(POINT).expect("in front");
        assert_close(&by_camera, &differences(moved), 1e-8);
        let shifted = |e| WeakPerspective::spin(parameters).project(add(POINT, e)).expect("in front");
        assert_close(&by_point, &differences(shifted), 1e-8);
    }
}

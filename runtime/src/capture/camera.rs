//! The pinhole camera with OpenCV's distortion: projection, back-projection, and what makes one unusable.

use super::geometry::{
    IDENTITY, Matrix3, Vector3, add, apply, apply_transposed, determinant, normalize, orthonormality_defect,
    scale,
};

/// The largest |R Rᵀ − I| entry that still passes for a rotation: files often carry four to six decimals, and
/// 1e-3 displaces a point at four metres by millimetres only.
const ORTHONORMALITY_TOLERANCE: f64 = 1e-3;

/// Images larger than this (8192 × 8192) are refused before any memory is reserved for them.
pub const MAX_PIXELS: u64 = 1 << 26;

/// Where a camera stands: X_c = R X + t, world to camera, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extrinsics {
    /// The rotation R, `r[row][column]`; its rows are the camera's axes in world coordinates.
    pub r: [[f64; 3]; 3],
    /// The translation t in metres: the world's origin in camera coordinates.
    pub t: [f64; 3],
}

impl Extrinsics {
    /// R X + t.
    pub fn to_camera(&self, world: [f64; 3]) -> [f64; 3] {
        add(apply(&self.r, world), self.t)
    }

    /// Rᵀ (X_c − t).
    pub fn to_world(&self, camera: [f64; 3]) -> [f64; 3] {
        apply_transposed(&self.r, super::geometry::subtract(camera, self.t))
    }

    /// The optical centre −Rᵀ t in world coordinates.
    pub fn centre(&self) -> [f64; 3] {
        scale(apply_transposed(&self.r, self.t), -1.0)
    }
}

/// A half-line in world coordinates: origin + s · direction, s ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The optical centre in metres.
    pub origin: [f64; 3],
    /// Unit length.
    pub direction: [f64; 3],
}

/// One camera of a rig.
///
/// With (x, y) = (X_c/Z_c, Y_c/Z_c), r² = x² + y² and the distortion (k1, k2, p1, p2, k3):
///
/// x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²),
/// y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y,
/// (u, v, 1) = K (x', y', 1).
///
/// # Conventions
/// Camera axes: x right, y down, z forward. Pixels are continuous with the origin at the image's top-left
/// *corner*: pixel (row i, column j) covers [j, j+1) × [i, i+1) and its centre is (j+½, i+½). OpenCV counts
/// from the centre of the first pixel instead; its files are converted on reading (`c += ½`).
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Names the view's files; unique within a capture.
    pub name: String,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// The intrinsic matrix K = [[f_x, s, c_x], [0, f_y, c_y], [0, 0, 1]] in pixels.
    pub k: [[f64; 3]; 3],
    /// Where the camera stands, or `None` where that is unknown.
    pub extrinsics: Option<Extrinsics>,
    /// k1, k2, p1, p2, k3 as OpenCV orders them; all zero for a pinhole.
    pub distortion: [f64; 5],
}

impl Camera {
    /// The world point X in pixels, and its depth Z_c in metres.
    ///
    /// `None` if the point is not in front of the camera (Z_c ≤ 0) or the extrinsics are unknown.
    ///
    /// ```
    /// use vitruvian_runtime::capture::{Camera, Extrinsics};
    /// let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let camera = Camera {
    ///     name: "front".into(),
    ///     width: 320,
    ///     height: 240,
    ///     k: [[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]],
    ///     extrinsics: Some(Extrinsics { r: identity, t: [0.0, 0.0, 3.0] }),
    ///     distortion: [0.0; 5],
    /// };
    /// assert_eq!(camera.project([0.1, 0.0, 0.0]), Some(([170.0, 120.0], 3.0)));
    /// ```
    pub fn project(&self, world: [f64; 3]) -> Option<([f64; 2], f64)> {
        let point = self.extrinsics?.to_camera(world);
        Some((self.project_from_camera(point)?, point[2]))
    }

    /// A point in camera coordinates in pixels; `None` unless Z_c > 0.
    pub fn project_from_camera(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        if point[2].is_nan() || point[2] <= 0.0 {
            return None;
        }
        let (x, y) = (point[0] / point[2], point[1] / point[2]);
        let [x, y] = if self.is_pinhole() { [x, y] } else { distort([x, y], &self.distortion) };
        Some(self.to_pixel([x, y]))
    }

    /// The half-line of world points that project to the pixel position `uv`.
    ///
    /// `None` if the extrinsics are unknown or the distortion has no inverse there.
    pub fn ray(&self, uv: [f64; 2]) -> Option<Ray> {
        let extrinsics = self.extrinsics?;
        let [x, y] = self.normalized(uv)?;
        let direction = normalize(apply_transposed(&extrinsics.r, [x, y, 1.0]))?;
        Some(Ray { origin: extrinsics.centre(), direction })
    }

    /// The world point at depth Z_c = `depth` (metres, along the optical axis) seen at `uv`.
    pub fn back_project(&self, uv: [f64; 2], depth: f64) -> Option<[f64; 3]> {
        let [x, y] = self.normalized(uv)?;
        Some(self.extrinsics?.to_world([x * depth, y * depth, depth]))
    }

    /// Whether all distortion coefficients are zero.
    pub fn is_pinhole(&self) -> bool {
        self.distortion == [0.0; 5]
    }

    /// The same camera without distortion: what an undistorted image was taken by.
    pub fn pinhole(&self) -> Camera {
        Camera { distortion: [0.0; 5], ..self.clone() }
    }

    /// Where the pixel position `uv` of the distorted image lies in the image of [`Camera::pinhole`].
    ///
    /// `None` where the distortion has no inverse (beyond the radius at which it folds over).
    pub fn undistort(&self, uv: [f64; 2]) -> Option<[f64; 2]> {
        Some(self.to_pixel(self.normalized(uv)?))
    }

    /// √(f_x f_y), the focal length in pixels.
    pub fn focal_length_px(&self) -> f64 {
        (self.k[0][0] * self.k[1][1]).sqrt()
    }

    /// K (x, y, 1) for undistorted or already distorted normalised coordinates.
    pub(crate) fn to_pixel(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.k[0][0] * x + self.k[0][1] * y + self.k[0][2], self.k[1][1] * y + self.k[1][2]]
    }

    /// The undistorted normalised coordinates (X_c/Z_c, Y_c/Z_c) behind a pixel position.
    pub fn normalized(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let y = (v - self.k[1][2]) / self.k[1][1];
        let x = (u - self.k[0][2] - self.k[0][1] * y) / self.k[0][0];
        if self.is_pinhole() { Some([x, y]) } else { undistort_normalized([x, y], &self.distortion) }
    }

    /// Says why the camera cannot be used, and how to mend it.
    ///
    /// # Errors
    /// One sentence: an unusable name, size, K, R, t or distortion, with what was found and expected.
    pub fn check(&self) -> Result<(), String> {
        check_name(&self.name)?;
        if self.width == 0 || self.height == 0 {
            return Err(format!(
                "its image is {} × {} pixels; both must be at least 1",
                self.width, self.height
            ));
        }
        if u64::from(self.width) * u64::from(self.height) > MAX_PIXELS {
            return Err(format!(
                "its image is {} × {} pixels; at most {MAX_PIXELS} pixels are read: scale the images and K down",
                self.width, self.height
            ));
        }
        check_intrinsics(&self.k)?;
        if let Some(e) = &self.extrinsics {
            check_rotation(&e.r)?;
            if e.t.iter().any(|x| !x.is_finite()) {
                return Err(format!("t is {}; expected three finite numbers (metres)", Show(&e.t)));
            }
        }
        if self.distortion.iter().any(|x| !x.is_finite()) {
            return Err(format!(
                "distortion is {}; expected five finite numbers k1, k2, p1, p2, k3",
                Show(&self.distortion)
            ));
        }
        Ok(())
    }
}

/// A name becomes part of file names, so it may not lead out of the capture.
pub(crate) fn check_name(name: &str) -> Result<(), String> {
    let plain = !name.is_empty()
        && name.len() <= 200
        && !name.starts_with('.')
        && !name.contains(|c: char| c == '/' || c == '\\' || c == ':' || c.is_control());
    if plain {
        return Ok(());
    }
    Err("its name must be a plain file name: not empty, no leading dot, no slashes, colons or control characters"
        .into())
}

fn check_intrinsics(k: &Matrix3) -> Result<(), String> {
    for (i, row) in k.iter().enumerate() {
        if let Some(j) = row.iter().position(|x| !x.is_finite()) {
            return Err(format!(
                "K[{i}][{j}] is {}; every entry of K must be a finite number: calibrate again or write it by hand",
                row[j]
            ));
        }
    }
    if k[0][0] <= 0.0 || k[1][1] <= 0.0 {
        return Err(format!(
            "K has focal lengths f_x = {}, f_y = {}; both must be positive (pixels)",
            k[0][0], k[1][1]
        ));
    }
    // The bottom row is compared up to rounding: calibration tools write 1.0 and 0.0 exactly or nearly so.
    let bottom_right = [(k[1][0], 0.0), (k[2][0], 0.0), (k[2][1], 0.0), (k[2][2], 1.0)];
    if bottom_right.iter().any(|(found, expected)| (found - expected).abs() > 1e-9) {
        return Err(format!(
            "K is [{}, {}, {}]; expected [[f_x, s, c_x], [0, f_y, c_y], [0, 0, 1]] (is it transposed?)",
            Show(&k[0]),
            Show(&k[1]),
            Show(&k[2])
        ));
    }
    Ok(())
}

fn check_rotation(r: &Matrix3) -> Result<(), String> {
    if r.iter().flatten().any(|x| !x.is_finite()) {
        return Err("R holds a number that is not finite; expected a rotation matrix".into());
    }
    let defect = orthonormality_defect(r);
    if defect > ORTHONORMALITY_TOLERANCE {
        return Err(format!(
            "R is not a rotation: the largest entry of |R Rᵀ − I| is {defect:.3e}, at most \
             {ORTHONORMALITY_TOLERANCE:.0e} is accepted: write R (world to camera) with more digits"
        ));
    }
    if determinant(r) < 0.0 {
        return Err("R is a reflection (determinant −1), expected a rotation (+1): \
                    the camera's axes are x right, y down, z forward"
            .into());
    }
    Ok(())
}

/// Prints numbers as `[1, 2.5, NaN]`.
struct Show<'a>(&'a [f64]);

impl std::fmt::Display for Show<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("[")?;
        for (i, x) in self.0.iter().enumerate() {
            write!(f, "{}{x}", if i > 0 { ", " } else { "" })?;
        }
        f.write_str("]")
    }
}

/// The distorted normalised coordinates (x', y') of [`Camera`]'s formula.
pub(crate) fn distort([x, y]: [f64; 2], d: &[f64; 5]) -> [f64; 2] {
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
    [
        x * radial + 2.0 * d[2] * x * y + d[3] * (r2 + 2.0 * x * x),
        y * radial + d[2] * (r2 + 2.0 * y * y) + 2.0 * d[3] * x * y,
    ]
}

/// The inverse of [`distort`] by Newton's iteration from the distorted point; `None` if it does not settle.
///
/// The start lies within the fold for every lens that a calibration returns; a result beyond the fold is
/// refused by [`fold_radius_squared`].
fn undistort_normalized(target: [f64; 2], d: &[f64; 5]) -> Option<[f64; 2]> {
    let mut p = target;
    for _ in 0..50 {
        let [x, y] = p;
        let image = distort(p, d);
        let miss = [image[0] - target[0], image[1] - target[1]];
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
        let slope = 2.0 * (d[0] + r2 * (2.0 * d[1] + 3.0 * r2 * d[4]));
        let jxx = radial + x * x * slope + 2.0 * d[2] * y + 6.0 * d[3] * x;
        let jxy = x * y * slope + 2.0 * d[2] * x + 2.0 * d[3] * y;
        let jyy = radial + y * y * slope + 6.0 * d[2] * y + 2.0 * d[3] * x;
        let determinant = jxx * jyy - jxy * jxy;
        let step =
            [(jyy * miss[0] - jxy * miss[1]) / determinant, (jxx * miss[1] - jxy * miss[0]) / determinant];
        p = [x - step[0], y - step[1]];
        if !(p[0].is_finite() && p[1].is_finite()) {
            return None;
        }
        // Newton's error after this step is about the step squared: 1e-9 here is far below a pixel of any K.
        if step[0].abs() + step[1].abs() < 1e-9 {
            let settled = p[0] * p[0] + p[1] * p[1] <= fold_radius_squared(d);
            return settled.then_some(p);
        }
    }
    None
}

/// The squared radius at which the radial distortion r (1 + k1 r² + k2 r⁴ + k3 r⁶) stops growing.
///
/// Beyond it two rays share one pixel, and the polynomial says nothing about a lens. Found by walking the
/// derivative 1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶ up to r = 10 (a half-angle of 84°); infinite if it stays positive.
pub(crate) fn fold_radius_squared(d: &[f64; 5]) -> f64 {
    for step in 0..=1000 {
        let r2 = (step as f64 * 0.01).powi(2);
        if 1.0 + r2 * (3.0 * d[0] + r2 * (5.0 * d[1] + r2 * 7.0 * d[4])) <= 0.0 {
            return r2;
        }
    }
    f64::INFINITY
}

/// A camera at `eye` that looks at `target` with the world's +Y upward in the image.
///
/// `None` if the two coincide or the view is straight up or down.
pub fn look_at(eye: [f64; 3], target: [f64; 3]) -> Option<Extrinsics> {
    let forward: Vector3 = normalize(super::geometry::subtract(target, eye))?;
    let right = normalize(super::geometry::cross(forward, IDENTITY[1]))?;
    let down = super::geometry::cross(forward, right);
    let r = [right, down, forward];
    Some(Extrinsics { r, t: scale(apply(&r, eye), -1.0) })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::capture::geometry::{norm, subtract};
    use proptest::prelude::*;

    pub(crate) fn camera(eye: [f64; 3]) -> Camera {
        Camera {
            name: "front".into(),
            width: 320,
            height: 240,
            k: [[310.0, 0.5, 161.0], [0.0, 305.0, 118.0], [0.0, 0.0, 1.0]],
            extrinsics: look_at(eye, [0.0, 0.9, 0.0]),
            distortion: [0.0; 5],
        }
    }

    #[test]
    fn looking_at_a_point_projects_it_to_the_principal_point_with_up_upward() {
        let c = camera([1.0, 1.2, 3.0]);
        let (uv, depth) = c.project([0.0, 0.9, 0.0]).unwrap();
        assert!((uv[0] - 161.0).abs() < 1e-10 && (uv[1] - 118.0).abs() < 1e-10);
        assert!((depth - norm([1.0, 0.3, 3.0])).abs() < 1e-12);
        assert!(c.project([0.0, 1.0, 0.0]).unwrap().0[1] < uv[1], "up is a smaller row");
        let e = c.extrinsics.unwrap();
        assert!(orthonormality_defect(&e.r) < 1e-15 && determinant(&e.r) > 0.0);
        // Seen from the front, the body's left (+X) is at the image's right.
        assert!(camera([0.0, 0.9, 3.0]).project([0.5, 0.9, 0.0]).unwrap().0[0] > 161.0);
    }

    #[test]
    fn points_behind_the_camera_or_without_extrinsics_have_no_pixel() {
        let mut c = camera([0.0, 0.9, 3.0]);
        assert_eq!(c.project([0.0, 0.9, 4.0]), None);
        assert_eq!(c.project([0.0, 0.9, 3.0]), None);
        c.extrinsics = None;
        assert_eq!(c.project([0.0, 0.9, 0.0]), None);
        assert_eq!(c.ray([10.0, 10.0]), None);
    }

    #[test]
    fn every_unusable_camera_is_named_with_its_fault() {
        let good = camera([0.0, 1.0, 3.0]);
        assert_eq!(good.check(), Ok(()));
        let fault = |change: &dyn Fn(&mut Camera)| {
            let mut c = good.clone();
            change(&mut c);
            c.check().expect_err("a fault was planted")
        };
        assert!(fault(&|c| c.k[0][2] = f64::NAN).contains("K[0][2] is NaN"));
        assert!(fault(&|c| c.k[1][1] = -3.0).contains("f_y = -3"));
        assert!(fault(&|c| c.k[2] = [160.0, 120.0, 1.0]).contains("transposed"));
        assert!(fault(&|c| c.width = 0).contains("0 × 240"));
        assert!(fault(&|c| c.width = u32::MAX).contains("at most"));
        assert!(fault(&|c| c.name = "../front".into()).contains("plain file name"));
        assert!(fault(&|c| c.distortion[1] = f64::INFINITY).contains("distortion"));
        assert!(fault(&|c| c.extrinsics.as_mut().unwrap().r[0][0] += 0.01).contains("not a rotation"));
        assert!(
            fault(&|c| c.extrinsics.as_mut().unwrap().r[0] = c.extrinsics.unwrap().r[0].map(|x| -x))
                .contains("reflection")
        );
        assert!(fault(&|c| c.extrinsics.as_mut().unwrap().t[1] = f64::NAN).contains("t is"));
    }

    proptest! {
        #[test]
        fn a_projected_point_lies_on_the_ray_through_its_pixel(
            x in -0.8f64..0.8, y in 0.2f64..1.6, z in -0.8f64..0.8,
            k1 in -0.1f64..0.1, k2 in -0.05f64..0.05, p in -0.005f64..0.005, k3 in -0.01f64..0.01,
        ) {
            let c = Camera { distortion: [k1, k2, p, -p, k3], ..camera([1.0, 1.2, 3.0]) };
            let (uv, depth) = c.project([x, y, z]).unwrap();
            let back = c.back_project(uv, depth).unwrap();
            prop_assert!(norm(subtract(back, [x, y, z])) < 1e-8, "{back:?}");
            let ray = c.ray(uv).unwrap();
            let along = subtract([x, y, z], ray.origin);
            prop_assert!(norm(super::super::geometry::cross(along, ray.direction)) < 1e-8);
            let flat = c.pinhole().project([x, y, z]).unwrap().0;
            let undistorted = c.undistort(uv).unwrap();
            prop_assert!((flat[0] - undistorted[0]).abs() + (flat[1] - undistorted[1]).abs() < 1e-5);
        }
    }
}

//! From the weak-perspective camera of a crop to a perspective camera of the whole photograph.
//!
//! # What does (s, t_x, t_y) mean?
//! Half the crop's side is the unit: a point (x, y, z) of the body, in metres and camera axes, is at s·(x + t_x), s·(y + t_y)
//! from the crop's middle. In pixels of the photograph, where the crop is a square of side b around c_b, that is
//!
//! p = c_b + k·((x, y) + (t_x, t_y)), k = s·b/2 pixels a metre,
//!
//! whatever z is. Training draws it as a pinhole of f pixels of the crop (5000 at 224) at t = (t_x, t_y, 2f/(S s)): from that
//! far away a body is all but flat.
//!
//! # How is it put under the photograph's own K?
//! With focal length f and principal point c (pixels of the photograph), two things are asked of the translation T:
//!
//! 1. one metre at the body's origin is k pixels long: f/T_z = k, so T_z = 2f/(s·b);
//! 2. the body's origin is where the crop's camera has it: c + f·(T_x, T_y)/T_z = c_b + k·(t_x, t_y), so
//!    (T_x, T_y) = (t_x, t_y) + (c_b − c)·T_z/f.
//!
//! Where f_x ≠ f_y, f = √(f_x f_y) in 1, and 2 is solved with K itself (skew included).
//!
//! # How far apart are the two pictures?
//! A pinhole sees the point at depth z behind the origin at p − w·(p − c), with w = z/(T_z + z). Both cameras do, each
//! towards its own principal point, so that for f_x = f_y
//!
//! u_photograph − u_crop = w_crop·(p − c_b) − w_photograph·(p − c).
//!
//! They agree exactly where K is the crop's own pinhole ([`crop_intrinsics`]), to first order in z/T_z otherwise: half a metre
//! of limb, four metres away, 100 pixels from the middle, moves by 11 pixels. That is the perspective which the crop's camera
//! lacks, not an error of the translation. The root's rotation is taken as it is: networks learn it in the axes of
//! the camera that took the photograph.
//!
//! # References
//! Kolotouros et al. 2019, SPIN (the pinhole of the crop); Li 2021, section 4.3.2.

use crate::person_crop::Crop;
use crate::rotation::Matrix3;

/// The convention of [`full_image_translation`] in one line, for those who read its numbers.
pub const CONVENTION: &str = "X_c = body + trans, metres, camera axes x right, y down, z forward; u = K X_c / z, pixels from the \
     photograph's top-left corner; trans_z = 2 f / (s b), trans_xy = (t_x, t_y) + (c_b - c) trans_z / f \
     for the crop's camera (s, t_x, t_y), its side b and middle c_b in the photograph, and K's focal length f and principal point c";

/// T, the body's translation in metres under the photograph's intrinsic matrix `k`: X_c = body + T.
///
/// `camera` is (s, t_x, t_y) with s > 0, in the crop's terms. The [module](self) derives it.
///
/// ```
/// use image::RgbImage;
/// use vitruvian_runtime::person_crop::Crop;
/// use vitruvian_runtime::regress::full_image_translation;
///
/// let crop = Crop { image: RgbImage::new(128, 128), origin_px: [100, 0], side_px: 400 };
/// let k = [[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]];
/// // 200 pixels a metre: 4 m away. The crop's middle is 20 pixels left of the principal point: 10 cm.
/// let t = full_image_translation([1.0, 0.0, 0.25], &crop, &k);
/// assert!((t[0] + 0.1).abs() < 1e-12 && (t[1] - 0.05).abs() < 1e-12 && t[2] == 4.0);
/// ```
pub fn full_image_translation(camera: [f64; 3], crop: &Crop, k: &Matrix3) -> [f64; 3] {
    let [s, t_x, t_y] = camera;
    let scale = 0.5 * s * f64::from(crop.side_px);
    let depth = (k[0][0] * k[1][1]).sqrt() / scale;
    let middle = middle_px(crop);
    let origin_px = [middle[0] + scale * t_x, middle[1] + scale * t_y];
    let y = (origin_px[1] - k[1][2]) / k[1][1];
    let x = (origin_px[0] - k[0][2] - k[0][1] * y) / k[0][0];
    [x * depth, y * depth, depth]
}

/// The translation under the crop's own pinhole, (t_x, t_y, 2f/(S s)), metres: `focal_px` in pixels of the S-pixel crop.
pub fn crop_translation(camera: [f64; 3], focal_px: f64, size: u32) -> [f64; 3] {
    [camera[1], camera[2], 2.0 * focal_px / (f64::from(size) * camera[0])]
}

/// The crop's own pinhole in pixels of the photograph: f·b/S around c_b.
pub fn crop_intrinsics(crop: &Crop, focal_px: f64, size: u32) -> Matrix3 {
    let [u, v] = middle_px(crop);
    let focal = focal_px * f64::from(crop.side_px) / f64::from(size);
    [[focal, 0.0, u], [0.0, focal, v], [0.0, 0.0, 1.0]]
}

/// The intrinsic matrix of a photograph that nobody calibrated: the principal point in its middle and `focal_px`, or its
/// diagonal.
///
/// # Why the diagonal?
/// It is the angle of a 43 mm lens before a 35 mm film, between those of telephones and of portraits, so that bodies come out
/// at distances at which people are photographed. The crop's own pinhole (5000 pixels at 224) would put them tens of metres
/// away, and every crop of one photograph under another lens.
pub fn assumed_intrinsics(width: u32, height: u32, focal_px: Option<f64>) -> Matrix3 {
    let [w, h] = [width, height].map(f64::from);
    let focal = focal_px.unwrap_or_else(|| w.hypot(h));
    [[focal, 0.0, 0.5 * w], [0.0, focal, 0.5 * h], [0.0, 0.0, 1.0]]
}

/// c_b.
fn middle_px(crop: &Crop) -> [f64; 2] {
    crop.origin_px.map(|corner| corner as f64 + 0.5 * f64::from(crop.side_px))
}

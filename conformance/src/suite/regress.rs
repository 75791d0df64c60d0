//! What stands around a regressor: from its numbers to rotations, axis–angle vectors and a camera of the whole photograph.
//!
//! Both sides compute in f64 from the same numbers by different algorithms: Gram–Schmidt as in the reference; Newton's
//! iteration against a singular value decomposition; quaternions against the antisymmetric part. So the difference is rounding,
//! u = 2⁻⁵³, times how strongly the answer turns with its input:
//!
//! | step | the answer turns with its input by | bound |
//! |---|---|---|
//! | six numbers → R | 1/sin φ, φ the angle between the columns | γ₃₂(1 + 1/sin φ) |
//! | matrix → nearest R | 1/(σ₂ + σ₃) ≈ ½; a decomposition has up to 10 sweeps of 3 plane rotations | γ₅₁₂ |
//! | v → R | ‖v‖: the angle's own rounding | γ₃₂ + γ₈‖v‖ |
//! | R → v | π at a half turn, relative to ‖v‖ otherwise; ±v is one rotation within 10⁻¹⁴ of π | γ₆₄(1 + π) |
//! | R → v → R | | 10⁻¹² everywhere: the contract |
//!
//! The translation under the photograph's K is judged by what it is for. Seen through the reference's pinhole, the body's origin
//! is where the weak-perspective camera puts it and one metre there is s·b/2 pixels long; at b = S = 224 with the focal length
//! of SPIN it is the translation of the reference's own [`WeakPerspective`].

pub mod faults;

use image::RgbImage;
use proptest::prelude::*;
use vitruvian_reference::camera::{Pinhole, WeakPerspective};
use vitruvian_reference::linalg::matrix::{Matrix3, add, max_abs, sub};
use vitruvian_reference::linalg::svd::nearest_rotation;
use vitruvian_reference::linalg::vector::{Vector3, distance, dot, norm, scale};
use vitruvian_reference::nn::gamma;
use vitruvian_reference::rotation;
use vitruvian_runtime::person_crop::Crop;
use vitruvian_runtime::regress::camera::crop_translation;
use vitruvian_runtime::regress::full_image_translation;

const UNIT_ROUNDOFF_F64: f64 = f64::EPSILON / 2.0;

/// R → v → R must close to this, half turns included.
pub const CLOSES_WITHIN: f64 = 1e-12;

/// The functions that are judged.
#[derive(Clone, Copy)]
pub struct Subject {
    /// Six numbers to a rotation.
    pub from_six_d: fn([f64; 6]) -> Option<Matrix3>,
    /// A matrix to the nearest rotation.
    pub nearest: fn(&Matrix3) -> Option<Matrix3>,
    /// An axis–angle vector to a rotation.
    pub rodrigues: fn([f64; 3]) -> Matrix3,
    /// A rotation to an axis–angle vector.
    pub logarithm: fn(&Matrix3) -> [f64; 3],
    /// The camera of a crop to a translation under K.
    pub full_image_translation: fn([f64; 3], &Crop, &Matrix3) -> [f64; 3],
}

/// The runtime.
pub const RUNTIME: Subject = Subject {
    from_six_d: vitruvian_runtime::rotation::from_six_d,
    nearest: vitruvian_runtime::rotation::nearest,
    rodrigues: vitruvian_runtime::rotation::rodrigues,
    logarithm: vitruvian_runtime::rotation::logarithm,
    full_image_translation,
};

/// One joint's numbers in every form, and one person's camera.
#[derive(Clone, Debug)]
pub struct Problem {
    /// A rotation vector, up to half a turn, also just before it and next to none.
    pub axis_angle: Vector3,
    /// What a head may have written instead of the first two columns: stretched and sheared.
    pub six_d: [f64; 6],
    /// What is added to the entries of the matrix.
    pub noise: Matrix3,
    /// (s, t_x, t_y).
    pub camera: [f64; 3],
    /// Corner and side of the square in the photograph.
    pub crop: ([i64; 2], u32),
    /// K: one focal length, or two, without skew.
    pub k: Matrix3,
}

/// Random problems.
pub fn problems() -> impl Strategy<Value = Problem> {
    use std::f64::consts::PI;
    let angle = prop_oneof![
        3 => 0.0f64..PI,
        1 => (0.0..16.0).prop_map(|k: f64| PI - 10f64.powf(-k)),
        1 => (0.0..200.0).prop_map(|k: f64| 10f64.powf(-k)),
    ];
    let axis = prop::array::uniform3(-1.0f64..1.0).prop_filter("a direction", |v| norm(*v) > 1e-3);
    let rotation = (axis, angle).prop_map(|(axis, angle)| scale(axis, angle / norm(axis)));
    let columns = (prop::array::uniform6(-3.0f64..3.0), -12.0f64..12.0, -12.0f64..12.0)
        .prop_map(|(x, a, b)| std::array::from_fn(|i| x[i] * 10f64.powf(if i % 2 == 0 { a } else { b })));
    let columns = columns.prop_filter("two directions", |x| sine(x) > 1e-5);
    let noise = (prop::array::uniform9(-1.0f64..1.0), -16.0f64..-1.8)
        .prop_map(|(x, k)| std::array::from_fn(|r| std::array::from_fn(|c| x[3 * r + c] * 10f64.powf(k))));
    let camera = (0.05f64..3.0, -2.0f64..2.0, -2.0f64..2.0).prop_map(|(s, x, y)| [s, x, y]);
    let crop = (prop::array::uniform2(-500i64..2000), 8u32..3000);
    let k = (200.0f64..5000.0, 0.8f64..1.25, 0.0f64..2000.0, 0.0f64..2000.0)
        .prop_map(|(f, aspect, x, y)| [[f, 0.0, x], [0.0, f * aspect, y], [0.0, 0.0, 1.0]]);
    (rotation, columns, noise, camera, crop, k).prop_map(|(axis_angle, six_d, noise, camera, crop, k)| {
        Problem { axis_angle, six_d, noise, camera, crop, k }
    })
}

/// The sine of the angle between the two columns of six numbers.
fn sine(x: &[f64; 6]) -> f64 {
    let unit = |v: Vector3| scale(v, 1.0 / norm(v));
    let (a, b) = (unit([x[0], x[2], x[4]]), unit([x[1], x[3], x[5]]));
    (1.0 - dot(a, b).powi(2)).max(0.0).sqrt()
}

impl Problem {
    /// Compares every step of `subject` with the reference.
    ///
    /// # Errors
    /// The first difference that cannot be rounding.
    pub fn judge(&self, subject: &Subject) -> Result<(), String> {
        let gamma = |n: f64| gamma(n, UNIT_ROUNDOFF_F64);
        let v = self.axis_angle;

        let r = rotation::rodrigues(v);
        near("rodrigues", &(subject.rodrigues)(v), &r, gamma(32.0) + gamma(8.0) * norm(v))?;

        let log = (subject.logarithm)(&r);
        let closed = rotation::rodrigues(log);
        near("R, logarithm, R", &closed, &r, CLOSES_WITHIN)?;
        near("R, logarithm, R by the subject alone", &(subject.rodrigues)(log), &r, CLOSES_WITHIN)?;
        let expected = rotation::logarithm(&r);
        let bound = gamma(64.0) * (norm(expected).min(1.0) + norm(expected));
        let is_half_turn = std::f64::consts::PI - norm(expected) < 1e-14;
        let off = distance(log, expected).min(if is_half_turn {
            distance(log, scale(expected, -1.0))
        } else {
            f64::INFINITY
        });
        if off.is_nan() || off > bound {
            return Err(format!("logarithm: {log:?}, expected {expected:?} ± {bound:e}"));
        }

        let expected = rotation::from_six_d(&self.six_d).ok_or("six numbers without a rotation")?;
        let found = (subject.from_six_d)(self.six_d).ok_or("from_six_d: refused")?;
        near("from_six_d", &found, &expected, gamma(32.0) * (1.0 + 1.0 / sine(&self.six_d)))?;

        let spoiled = add(&r, &self.noise);
        let found = (subject.nearest)(&spoiled).ok_or("nearest: refused")?;
        near("nearest", &found, &nearest_rotation(&spoiled), gamma(512.0))?;
        self.judge_translation(subject)
    }

    fn judge_translation(&self, subject: &Subject) -> Result<(), String> {
        let ([u, v], side) = self.crop;
        let side_px = f64::from(side);
        let crop = |origin_px, side_px| Crop { image: RgbImage::new(1, 1), origin_px, side_px };
        let found = (subject.full_image_translation)(self.camera, &crop([u, v], side), &self.k);

        // Where the origin is, and how long a metre is there along x and y: √(f_x f_y)/T_z = s·b/2.
        let [s, t_x, t_y] = self.camera;
        let pixels_per_metre = 0.5 * s * side_px;
        let [[fx, _, cx], [_, fy, cy], _] = self.k;
        let pinhole = Pinhole {
            focal_px: [fx, fy],
            principal_px: [cx, cy],
            translation: found,
            ..Pinhole::ideal(fx, [cx, cy])
        };
        let behind = "full_image_translation: behind the camera";
        let seen = pinhole.project([0.0; 3]).ok_or(behind)?;
        let by_point = pinhole.project_derivative([0.0; 3]).ok_or(behind)?.point;
        let middle = [u as f64 + 0.5 * side_px, v as f64 + 0.5 * side_px];
        let expected = [middle[0] + pixels_per_metre * t_x, middle[1] + pixels_per_metre * t_y];
        let size =
            middle[0].abs() + middle[1].abs() + pixels_per_metre * (1.0 + t_x.abs() + t_y.abs()) + cx + cy;
        let bound = gamma(32.0, UNIT_ROUNDOFF_F64) * size;
        for axis in 0..2 {
            let off = (seen[axis] - expected[axis]).abs();
            if off.is_nan() || off > bound {
                return Err(format!(
                    "full_image_translation: the origin is seen at {seen:?} px, expected {expected:?} ± {bound:e}"
                ));
            }
        }
        let found_scale = (by_point[0][0] * by_point[1][1]).sqrt();
        if (found_scale - pixels_per_metre).abs() > bound {
            return Err(format!(
                "full_image_translation: a metre is {found_scale} px, expected {pixels_per_metre} ± {bound:e}"
            ));
        }

        // SPIN's camera: the crop itself is the photograph.
        let spin = WeakPerspective::spin(self.camera).to_pinhole();
        let k = [[5000.0, 0.0, 112.0], [0.0, 5000.0, 112.0], [0.0, 0.0, 1.0]];
        let whole = (subject.full_image_translation)(self.camera, &crop([0, 0], 224), &k);
        let own = crop_translation(self.camera, 5000.0, 224);
        // The released code adds 10⁻⁹ to 224·s.
        let bound = spin.translation[2] * (1e-9 / (224.0 * s) + gamma(32.0, UNIT_ROUNDOFF_F64));
        for translation in [whole, own] {
            let off = distance(translation, spin.translation);
            if off.is_nan() || off > 2.0 * bound {
                return Err(format!(
                    "SPIN's camera: {translation:?}, expected {:?} ± {bound:e}",
                    spin.translation
                ));
            }
        }
        Ok(())
    }
}

fn near(step: &str, found: &Matrix3, expected: &Matrix3, bound: f64) -> Result<(), String> {
    let off = max_abs(&sub(found, expected));
    if off <= bound {
        return Ok(());
    }
    Err(format!("{step}: {found:?}, expected {expected:?} ± {bound:e}"))
}

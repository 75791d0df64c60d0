//! The mannequin's ten shape directions: deformation fields of the T-pose, evaluated at the vertices.
//!
//! Every field is continuous and mirror-symmetric, and β = 0 is the template. One unit is one standard deviation; the
//! rates are chosen so that ±2.5 units stay within what adult bodies do (stature: ±15 cm).

use super::skeleton::rest_joints;
use crate::linalg::vector::{Vector3, add_scaled, scale, sub};

/// B.
pub const BETA_COUNT: usize = 10;

/// What the betas mean, in order; positive is more.
pub const BETA_NAMES: [&str; BETA_COUNT] = [
    "stature",
    "girth",
    "leg length",
    "shoulder width",
    "hip width",
    "arm length",
    "chest depth",
    "belly",
    "head size",
    "limb thickness",
];

/// Cubic step: 0 below `from`, 1 above `to`, C¹ in between.
fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The bell exp(−((x − centre)/width)²).
fn bell(centre: f64, width: f64, x: f64) -> f64 {
    let t = (x - centre) / width;
    (-t * t).exp()
}

/// How far `x` is along `from`…`to`, 0…1.
fn ramp(from: f64, to: f64, x: f64) -> f64 {
    ((x - from) / (to - from)).clamp(0.0, 1.0)
}

/// The derivative of a rest vertex of the left side (x ≥ 0) with respect to each beta, metres per standard deviation.
pub(super) fn directions(p: Vector3) -> [Vector3; BETA_COUNT] {
    let [x, y, z] = p;
    let joints = rest_joints();
    let (hip, knee, ankle) = (joints[1], joints[4], joints[7]);
    let (shoulder, wrist, head) = (joints[16], joints[20], joints[15]);

    // Where the point is: arm beyond the shoulder, leg below the hip, head above the neck; the rest is trunk.
    let arm = smoothstep(0.13, 0.22, x) * smoothstep(0.30, 0.38, y);
    let leg = 1.0 - smoothstep(-0.20, -0.06, y);
    let above_neck = smoothstep(0.52, 0.60, y);
    let trunk = (1.0 - arm) * (1.0 - leg) * (1.0 - smoothstep(0.46, 0.54, y));
    // Hands and feet keep their thickness.
    let limb = arm * (1.0 - smoothstep(0.64, 0.70, x)) + leg * smoothstep(-0.87, -0.78, y);

    // Offsets from the axis of the part.
    let leg_axis = if y > knee[1] {
        add_scaled(hip, sub(knee, hip), ramp(hip[1], knee[1], y))
    } else {
        add_scaled(knee, sub(ankle, knee), ramp(knee[1], ankle[1], y))
    };
    // Thighs do not thicken through the plane between them.
    let from_leg = [(x - leg_axis[0]) * smoothstep(0.0, 0.05, x), 0.0, z - leg_axis[2]];
    let from_arm = [0.0, y - shoulder[1], z - shoulder[2]];
    let thicken = |rate: f64| -> Vector3 {
        std::array::from_fn(|axis| rate * limb * if arm > leg { from_arm[axis] } else { from_leg[axis] })
    };

    let stature = [0.035 * x, 0.035 * y, 0.035 * z];
    let girth = {
        // From the waist down the trunk's widening passes over into that of the thighs.
        let torso = smoothstep(-0.40, 0.08, y) * (1.0 - arm) * (1.0 - smoothstep(0.46, 0.54, y));
        let limbs = scale(thicken(0.06), 1.0 - torso);
        [0.075 * torso * x + limbs[0], limbs[1], 0.085 * torso * z + limbs[2]]
    };
    let leg_length = [0.0, -0.020 * smoothstep(hip[1] + 0.04, ankle[1] - 0.04, y), 0.0];
    let shoulder_width =
        [0.010 * smoothstep(0.02, 0.20, x) * smoothstep(0.16, 0.40, y) * (1.0 - above_neck), 0.0, 0.0];
    let hip_width = [0.008 * smoothstep(0.0, 0.10, x) * (1.0 - smoothstep(-0.02, 0.16, y)), 0.0, 0.0];
    let arm_length = [0.016 * smoothstep(shoulder[0], wrist[0], x), 0.0, 0.0];
    let chest = {
        let bulge = trunk * bell(0.35, 0.10, y);
        [0.030 * bulge * x, 0.0, 0.080 * bulge * z]
    };
    let belly = {
        let bulge = trunk * bell(0.10, 0.10, y);
        [0.050 * bulge * x, 0.0, bulge * (0.014 * smoothstep(-0.06, 0.08, z) + 0.03 * z)]
    };
    let head_size: Vector3 = std::array::from_fn(|axis| 0.030 * above_neck * (p[axis] - head[axis]));

    [
        stature,
        girth,
        leg_length,
        shoulder_width,
        hip_width,
        arm_length,
        chest,
        belly,
        head_size,
        thicken(0.06),
    ]
}

/// V×3×10 row-major.
pub(super) fn shapedirs(vertices: &[Vector3]) -> Vec<f64> {
    let mut shapedirs = Vec::with_capacity(vertices.len() * 3 * BETA_COUNT);
    for &p in vertices {
        let side = if p[0] < 0.0 { -1.0 } else { 1.0 };
        let fields = directions([p[0].abs(), p[1], p[2]]);
        shapedirs.extend(fields.iter().map(|d| side * d[0]));
        shapedirs.extend(fields.iter().map(|d| d[1]));
        shapedirs.extend(fields.iter().map(|d| d[2]));
    }
    shapedirs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn longer_legs_move_the_feet_down_and_leave_the_head() {
        let feet = directions([0.14, -0.92, 0.1])[2];
        assert!((feet[1] + 0.020).abs() < 1e-12 && feet[0] == 0.0 && feet[2] == 0.0, "{feet:?}");
        assert_eq!(directions([0.0, 0.75, 0.05])[2], [0.0; 3]);
    }

    #[test]
    fn seam_stays_on_the_plane_of_symmetry() {
        for y in -20..18 {
            for direction in directions([0.0, 0.045 * f64::from(y), 0.08]) {
                assert_eq!(direction[0], 0.0);
            }
        }
    }
}

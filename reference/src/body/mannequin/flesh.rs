//! The mannequin's shape as an implicit surface: a smooth union of lofted parts.
//!
//! A *loft* is a row of elliptic cross-sections along one coordinate axis with an ellipsoidal cap at both ends: the way a
//! tailor measures a body. Sections are interpolated by Catmull–Rom curves, and parts are joined by a smooth minimum,
//! which fills the groove between them and leaves everything farther than its width exactly as it was.
//! Only the left half is described; the field looks at |x|.

use crate::linalg::vector::Vector3;

/// Position along the axis, centre of the ellipse (first, second transverse axis), its two radii. Metres.
type Section = [f64; 5];

/// One part of the body.
struct Loft {
    /// The axis along which the sections follow each other: 0 = x, 1 = y, 2 = z. The transverse axes are the other
    /// two in the order x, y, z.
    axis: usize,
    sections: &'static [Section],
    /// The lengths of the caps before the first and after the last section.
    caps: [f64; 2],
    /// The width of the smooth union with what comes before it in the list.
    blend: f64,
}

/// No part reaches farther than this beyond its box: it bounds the width of every smooth union.
const REACH: f64 = 0.06;

/// The height of the ground under the soles.
const SOLE: f64 = -0.925;

const LOFTS: [Loft; 15] = [
    // Trunk, from the crotch to the root of the neck.
    Loft {
        axis: 1,
        sections: &[
            [-0.085, 0.0, -0.010, 0.140, 0.100],
            [-0.030, 0.0, -0.012, 0.166, 0.110],
            [0.030, 0.0, -0.006, 0.158, 0.108],
            [0.095, 0.0, 0.000, 0.137, 0.098],
            [0.160, 0.0, 0.000, 0.127, 0.091],
            [0.230, 0.0, 0.000, 0.139, 0.099],
            [0.300, 0.0, 0.000, 0.155, 0.110],
            [0.370, 0.0, -0.002, 0.164, 0.112],
            [0.430, 0.0, -0.012, 0.150, 0.094],
            [0.475, 0.0, -0.020, 0.096, 0.070],
            [0.505, 0.0, -0.020, 0.062, 0.058],
        ],
        caps: [0.045, 0.03],
        blend: 0.0,
    },
    // Seat.
    Loft {
        axis: 1,
        sections: &[[-0.085, 0.078, -0.066, 0.074, 0.060], [-0.020, 0.078, -0.062, 0.070, 0.056]],
        caps: [0.055, 0.07],
        blend: 0.03,
    },
    // Chest.
    Loft {
        axis: 0,
        sections: &[[0.02, 0.365, 0.070, 0.055, 0.036], [0.105, 0.365, 0.062, 0.050, 0.034]],
        caps: [0.03, 0.045],
        blend: 0.05,
    },
    // Shoulder blades.
    Loft {
        axis: 1,
        sections: &[[0.33, 0.085, -0.075, 0.060, 0.036], [0.40, 0.080, -0.070, 0.060, 0.034]],
        caps: [0.05, 0.05],
        blend: 0.05,
    },
    // Neck.
    Loft {
        axis: 1,
        sections: &[
            [0.450, 0.0, -0.022, 0.066, 0.060],
            [0.500, 0.0, -0.018, 0.056, 0.055],
            [0.550, 0.0, -0.008, 0.052, 0.054],
            [0.610, 0.0, 0.004, 0.053, 0.056],
        ],
        caps: [0.03, 0.03],
        blend: 0.04,
    },
    // Skull: from the level of the mouth to the crown, longer than wide.
    Loft {
        axis: 1,
        sections: &[
            [0.625, 0.0, 0.010, 0.064, 0.078],
            [0.660, 0.0, 0.008, 0.072, 0.092],
            [0.700, 0.0, 0.004, 0.076, 0.096],
        ],
        caps: [0.050, 0.098],
        blend: 0.02,
    },
    // Jaw and chin.
    Loft {
        axis: 1,
        sections: &[
            [0.578, 0.0, 0.062, 0.030, 0.026],
            [0.605, 0.0, 0.050, 0.046, 0.044],
            [0.645, 0.0, 0.040, 0.058, 0.060],
        ],
        caps: [0.014, 0.040],
        blend: 0.025,
    },
    // Nose.
    Loft {
        axis: 1,
        sections: &[[0.641, 0.0, 0.110, 0.014, 0.018], [0.680, 0.0, 0.098, 0.009, 0.010]],
        caps: [0.010, 0.014],
        blend: 0.012,
    },
    // Ear.
    Loft {
        axis: 1,
        sections: &[[0.640, 0.074, -0.004, 0.011, 0.014], [0.672, 0.078, -0.010, 0.013, 0.020]],
        caps: [0.014, 0.016],
        blend: 0.010,
    },
    // Arm: shoulder cap, upper arm, elbow, forearm, wrist.
    Loft {
        axis: 0,
        sections: &[
            [0.120, 0.420, -0.018, 0.062, 0.060],
            [0.175, 0.437, -0.020, 0.060, 0.060],
            [0.225, 0.441, -0.021, 0.055, 0.056],
            [0.300, 0.443, -0.022, 0.049, 0.050],
            [0.375, 0.444, -0.024, 0.043, 0.044],
            [0.440, 0.445, -0.026, 0.039, 0.040],
            [0.500, 0.445, -0.025, 0.042, 0.042],
            [0.570, 0.445, -0.023, 0.038, 0.039],
            [0.640, 0.445, -0.021, 0.029, 0.032],
            [0.690, 0.445, -0.020, 0.024, 0.029],
        ],
        caps: [0.04, 0.02],
        blend: 0.05,
    },
    // Hand, palm down, fingers together.
    Loft {
        axis: 0,
        sections: &[
            [0.690, 0.445, -0.020, 0.023, 0.028],
            [0.730, 0.443, -0.016, 0.020, 0.040],
            [0.775, 0.441, -0.014, 0.019, 0.044],
            [0.820, 0.439, -0.013, 0.016, 0.040],
            [0.850, 0.438, -0.013, 0.013, 0.031],
        ],
        caps: [0.02, 0.026],
        blend: 0.02,
    },
    // Thumb, forward and a little down. Transverse axes x and y.
    Loft {
        axis: 2,
        sections: &[
            [0.010, 0.712, 0.438, 0.020, 0.016],
            [0.040, 0.733, 0.435, 0.018, 0.016],
            [0.062, 0.746, 0.433, 0.016, 0.015],
        ],
        caps: [0.02, 0.018],
        blend: 0.018,
    },
    // Leg: thigh, knee, calf, ankle.
    Loft {
        axis: 1,
        sections: &[
            [-0.890, 0.141, -0.034, 0.032, 0.038],
            [-0.840, 0.139, -0.032, 0.033, 0.038],
            [-0.780, 0.136, -0.030, 0.036, 0.041],
            [-0.700, 0.132, -0.027, 0.045, 0.050],
            [-0.610, 0.127, -0.022, 0.054, 0.060],
            [-0.540, 0.122, -0.010, 0.052, 0.058],
            [-0.470, 0.118, 0.002, 0.050, 0.057],
            [-0.390, 0.114, 0.004, 0.059, 0.066],
            [-0.290, 0.108, 0.004, 0.072, 0.078],
            [-0.190, 0.101, 0.000, 0.081, 0.087],
            [-0.090, 0.093, -0.004, 0.084, 0.092],
        ],
        caps: [0.03, 0.06],
        blend: 0.03,
    },
    // Foot: heel, instep, ball, toes. Transverse axes x and y.
    Loft {
        axis: 2,
        sections: &[
            [-0.050, 0.142, -0.893, 0.032, 0.036],
            [0.000, 0.145, -0.886, 0.034, 0.042],
            [0.050, 0.149, -0.897, 0.040, 0.034],
            [0.100, 0.153, -0.906, 0.046, 0.026],
            [0.145, 0.156, -0.910, 0.041, 0.021],
        ],
        caps: [0.034, 0.036],
        blend: 0.03,
    },
    // Kneecap.
    Loft {
        axis: 1,
        sections: &[[-0.490, 0.119, 0.036, 0.026, 0.024], [-0.455, 0.118, 0.038, 0.026, 0.024]],
        caps: [0.02, 0.02],
        blend: 0.04,
    },
];

/// Cubic Hermite interpolation: the curve from p1 (t = 0) to p2 (t = 1) with tangents m1 and m2 per unit of t.
fn hermite(p1: f64, m1: f64, p2: f64, m2: f64, t: f64) -> f64 {
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * p1 + (t3 - 2.0 * t2 + t) * m1 + (3.0 * t2 - 2.0 * t3) * p2 + (t3 - t2) * m2
}

impl Loft {
    /// The centre and radii of the section at `s`, clamped to the ends: \[c_u, c_w, r_u, r_w\].
    fn section(&self, s: f64) -> [f64; 4] {
        let sections = self.sections;
        let last = sections.len() - 1;
        let n = sections[1..last].iter().take_while(|section| section[0] < s).count();
        let (a, b) = (&sections[n], &sections[n + 1]);
        let t = ((s - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
        // Tangents from the neighbours' difference quotient; one-sided at the ends.
        let (before, after) = (&sections[n.saturating_sub(1)], &sections[(n + 2).min(last)]);
        let length = b[0] - a[0];
        std::array::from_fn(|k| {
            let m1 = (b[k + 1] - before[k + 1]) / (b[0] - before[0]) * length;
            let m2 = (after[k + 1] - a[k + 1]) / (after[0] - a[0]) * length;
            hermite(a[k + 1], m1, b[k + 1], m2, t)
        })
    }

    /// About the signed distance of `p`: exact sign, right to first order at the surface.
    ///
    /// With q the point in units of the radii and k₀ = ‖q‖, k₁ = ‖q/r‖ this is k₀(k₀ − 1)/k₁.
    fn distance(&self, p: Vector3) -> f64 {
        let (s, u, w) = match self.axis {
            0 => (p[0], p[1], p[2]),
            1 => (p[1], p[0], p[2]),
            _ => (p[2], p[0], p[1]),
        };
        let (first, last) = (self.sections[0][0], self.sections[self.sections.len() - 1][0]);
        let [cu, cw, ru, rw] = self.section(s);
        let (beyond, cap) =
            if s < first { (s - first, self.caps[0]) } else { ((s - last).max(0.0), self.caps[1]) };
        let q = [(u - cu) / ru, (w - cw) / rw, beyond / cap];
        let k0 = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt();
        let g = [q[0] / ru, q[1] / rw, q[2] / cap];
        let k1 = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]).sqrt();
        if k1 < 1e-9 { -ru.min(rw) } else { k0 * (k0 - 1.0) / k1 }
    }

    /// An axis-aligned box that holds the part, as \[low, high\].
    fn bounds(&self) -> [Vector3; 2] {
        // Catmull–Rom curves leave the hull of their points by less than a quarter of the largest step.
        const SLACK: f64 = 0.02;
        let order = [[0, 1, 2], [1, 0, 2], [2, 0, 1]][self.axis];
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for section in self.sections {
            let centre = [section[0], section[1], section[2]];
            let reach = [[self.caps[0], self.caps[1]], [section[3]; 2], [section[4]; 2]];
            for (k, &axis) in order.iter().enumerate() {
                low[axis] = low[axis].min(centre[k] - reach[k][0] - SLACK);
                high[axis] = high[axis].max(centre[k] + reach[k][1] + SLACK);
            }
        }
        [low, high]
    }
}

/// The polynomial smooth minimum: min(a, b) where |a − b| ≥ k, up to k/4 lower where they meet.
fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let overlap = (k - (a - b).abs()).max(0.0);
    if k > 0.0 { a.min(b) - overlap * overlap / (4.0 * k) } else { a.min(b) }
}

/// The implicit body.
pub(super) struct Flesh {
    boxes: Vec<[Vector3; 2]>,
}

impl Flesh {
    pub(super) fn new() -> Flesh {
        Flesh { boxes: LOFTS.iter().map(Loft::bounds).collect() }
    }

    /// The box that holds the whole body (both sides), as \[low, high\].
    pub(super) fn bounds(&self) -> [Vector3; 2] {
        let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
        for [l, h] in &self.boxes {
            low = std::array::from_fn(|axis| l[axis].min(low[axis]));
            high = std::array::from_fn(|axis| h[axis].max(high[axis]));
        }
        low[0] = -high[0];
        [low, high]
    }

    /// The field at `p`: negative inside, about the distance in metres near the surface, at most `REACH` away from it.
    pub(super) fn distance(&self, p: Vector3) -> f64 {
        let p = [p[0].abs(), p[1], p[2]];
        let mut d = REACH;
        for (loft, [low, high]) in LOFTS.iter().zip(&self.boxes) {
            if (0..3).all(|axis| p[axis] > low[axis] - REACH && p[axis] < high[axis] + REACH) {
                d = smooth_min(d, loft.distance(p), loft.blend);
            }
        }
        // The ground cuts the soles flat.
        -smooth_min(-d, p[1] - SOLE, 0.012)
    }

    /// Value and gradient at `p` from four samples at the corners of a tetrahedron: exact on linear fields.
    pub(super) fn value_and_gradient(&self, p: Vector3) -> (f64, Vector3) {
        const STEP: f64 = 1e-4;
        const CORNERS: [Vector3; 4] =
            [[1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]];
        let (mut value, mut gradient) = (0.0, [0.0; 3]);
        for corner in CORNERS {
            let f = self.distance(std::array::from_fn(|axis| p[axis] + STEP * corner[axis]));
            value += 0.25 * f;
            for axis in 0..3 {
                gradient[axis] += 0.25 * f * corner[axis] / STEP;
            }
        }
        (value, gradient)
    }
}

//! Clothing-like variation: the skin pushed out along its normals where a garment would lie, with soft wrinkles.

use rand::Rng;
use vitruvian_reference::linalg::vector::{Vector3, dot};

use super::normal;

/// Joints whose skin a shirt covers, and trousers, and shoes (SMPL's joint numbers).
const SHIRT: &[usize] = &[3, 6, 9, 13, 14, 16, 17];
const SLEEVES: &[usize] = &[18, 19];
const TROUSERS: &[usize] = &[0, 1, 2];
const LEGS: &[usize] = &[4, 5];
const SHOES: &[usize] = &[7, 8, 10, 11];

/// One garment: how strongly it covers each vertex (0 to 1), its thickness in metres and its wrinkles.
pub struct Garment {
    /// V weights, 0 bare to 1 covered.
    pub cover: Vec<f64>,
    thickness_m: f64,
    wrinkles: Vec<Wave>,
}

struct Wave {
    direction: Vector3,
    phase: f64,
    height_m: f64,
}

impl Garment {
    /// The outward offset of vertex `i`, which rests at `v`, in metres; never inward.
    pub fn offset(&self, i: usize, v: Vector3) -> f64 {
        let wrinkle: f64 =
            self.wrinkles.iter().map(|w| w.height_m * (dot(w.direction, v) + w.phase).sin()).sum();
        self.cover[i] * (self.thickness_m + wrinkle).max(0.0)
    }
}

/// Draws what a person wears: nothing (30 %), or a shirt and trousers with or without long sleeves, legs and shoes.
///
/// `lbs_weights` [V·J] say which skin belongs to which joint.
pub fn random_wardrobe(rng: &mut impl Rng, lbs_weights: &[f64], joints: usize) -> Vec<Garment> {
    if rng.random_bool(0.3) {
        return Vec::new();
    }
    let with = |extra: &[usize], base: &[usize], worn: bool| {
        let mut all = base.to_vec();
        if worn {
            all.extend_from_slice(extra);
        }
        all
    };
    let long_sleeves = rng.random_bool(0.5);
    let long_legs = rng.random_bool(0.7);
    let loose: f64 = if rng.random_bool(0.5) { 1.0 } else { 0.4 };
    let parts = [
        (with(SLEEVES, SHIRT, long_sleeves), loose * rng.random_range(0.006..0.018)),
        (with(LEGS, TROUSERS, long_legs), loose * rng.random_range(0.006..0.018)),
        (SHOES.to_vec(), rng.random_range(0.003..0.010)),
    ];
    parts.map(|(covered, thickness_m)| garment(rng, lbs_weights, joints, &covered, thickness_m)).into()
}

fn garment(
    rng: &mut impl Rng,
    lbs_weights: &[f64],
    joints: usize,
    covered: &[usize],
    thickness_m: f64,
) -> Garment {
    let cover = lbs_weights
        .chunks_exact(joints)
        .map(|row| {
            let share: f64 = covered.iter().map(|&j| row[j]).sum();
            // A hem: from bare to covered over the middle of the blend between two joints.
            let t = ((share - 0.35) / 0.3).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        })
        .collect();
    let wrinkles = (0..6)
        .map(|_| Wave {
            direction: std::array::from_fn(|_| 28.0 * normal(rng, 2.5)),
            phase: rng.random_range(0.0..std::f64::consts::TAU),
            height_m: 0.16 * thickness_m,
        })
        .collect();
    Garment { cover, thickness_m, wrinkles }
}

//! Bodies and frames to judge the skinning on.

use proptest::prelude::*;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::linalg::vector::{Vector3, add};

use super::{Parameters, Skinning};

/// Random bodies of up to 40 vertices, 12 joints in a random tree and 4 betas, in up to 20 frames.
pub fn skinning() -> impl Strategy<Value = Skinning> {
    let sizes = (1..=40_usize, 1..=12_usize, 0..=4_usize, 1..=20_usize);
    (sizes, any::<u64>()).prop_map(|((v, j, b, frames), seed)| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let body = random_body(v, j, b, &mut rng);
        let frames = (0..frames).map(|_| random_frame(&body, &mut rng)).collect();
        Skinning { body, frames }
    })
}

fn random_body(v: usize, j: usize, b: usize, rng: &mut ChaCha8Rng) -> BodyModel {
    let size = 10_f64.powi(rng.random_range(-1..=1));
    let center: Vector3 = std::array::from_fn(|_| rng.random_range(-3.0..3.0) * size);
    let mut numbers = |n: usize, scale: f64, kept: f64| -> Vec<f64> {
        let number = |rng: &mut ChaCha8Rng| {
            scale * rng.random_range(-1.0..1.0) * f64::from(u8::from(rng.random_bool(kept)))
        };
        (0..n).map(|_| number(rng)).collect()
    };
    let template = numbers(3 * v, size, 1.0);
    let shapedirs = numbers(3 * v * b, 0.1 * size, 1.0);
    let mut posedirs = numbers(3 * v * 9 * (j - 1), 0.1 * size, 0.9);
    // Whole joints without any effect on a vertex, as in bodies whose correctives are local.
    for block in posedirs.chunks_exact_mut(9) {
        if rng.random_bool(0.3) {
            block.fill(0.0);
        }
    }
    // Weights as in files: few of them, summing to 1 but for their rounding to f32.
    let rows = |count: usize, columns: usize, rounded: bool, rng: &mut ChaCha8Rng| -> Vec<f64> {
        let mut table = vec![0.0; count * columns];
        for row in table.chunks_exact_mut(columns) {
            for _ in 0..4 {
                row[rng.random_range(0..columns)] += rng.random_range(0.05..1.0);
            }
            let sum: f64 = row.iter().sum();
            let round = |x: f64| if rounded { f64::from(x as f32) } else { x };
            row.iter_mut().for_each(|w| *w = round(*w / sum));
        }
        table
    };
    BodyModel {
        v_template: template.chunks_exact(3).map(|x| add([x[0], x[1], x[2]], center)).collect(),
        faces: Vec::new(),
        shapedirs,
        posedirs,
        j_regressor: rows(j, v, false, rng),
        lbs_weights: rows(v, j, true, rng),
        parents: (0..j).map(|k| (k > 0).then(|| rng.random_range(0..k))).collect(),
    }
}

/// Rest, turns of 10⁻⁴, ordinary ones, a root near π, and many turns about; near and far; with offsets and without.
fn random_frame(body: &BodyModel, rng: &mut ChaCha8Rng) -> Parameters {
    let kind = rng.random_range(0..5);
    let size = [0.0, 1e-4, 1.0, 1.0, 1000.0][kind];
    let mut pose: Vec<f64> =
        (0..3 * body.joint_count()).map(|_| size * rng.random_range(-1.0..1.0)).collect();
    if kind == 3 {
        pose[..3].copy_from_slice(&[0.0, std::f64::consts::PI + rng.random_range(-1e-9..1e-9), 0.0]);
    }
    let far = [0.0, 1.0, 1e4][rng.random_range(0..3)];
    let betas = rng.random_range(0..=body.beta_count());
    let offsets = if rng.random_bool(0.3) { body.vertex_count() } else { 0 };
    Parameters {
        pose,
        betas: (0..betas).map(|_| rng.random_range(-3.0..3.0)).collect(),
        trans: std::array::from_fn(|_| far * rng.random_range(-1.0..1.0)),
        offsets: (0..offsets).map(|_| std::array::from_fn(|_| rng.random_range(-0.1..0.1))).collect(),
    }
}

/// The mannequin, or another body of human size, in frames that SMPL's users meet and in some that they should not.
pub fn human_frames(body: &BodyModel, count: usize) -> Vec<Parameters> {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    (0..count)
        .map(|_| random_frame(body, &mut rng))
        .map(|frame| Parameters { offsets: Vec::new(), ..frame })
        .collect()
}

/// Problems in which every part of the model matters, so that none of the [`FAULTS`](super::faults::FAULTS) can hide: bodies of about a metre with 6
/// joints and 3 betas; a root turned by 10⁻³, the joints by 1000 rad; ten kilometres away; with offsets.
pub fn ordinary() -> impl Strategy<Value = Skinning> {
    any::<u64>().prop_map(|seed| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut body = random_body(30, 6, 3, &mut rng);
        while body.v_template.as_flattened().iter().fold(0.0_f64, |a, x| a.max(x.abs())) > 6.0 {
            body = random_body(30, 6, 3, &mut rng);
        }
        let frames = (0..3).map(|_| {
            let mut pose: Vec<f64> = (0..18).map(|_| rng.random_range(0.3..1.5)).collect();
            pose[..3].copy_from_slice(&[1e-3, -1e-3, 1e-3]);
            pose[3..].iter_mut().skip(2).step_by(3).for_each(|z| *z += 1000.0);
            Parameters {
                pose,
                betas: (0..3).map(|l| f64::from(l) + rng.random_range(0.2..0.9)).collect(),
                trans: std::array::from_fn(|_| 1e4 * rng.random_range(0.5..1.0)),
                offsets: (0..30).map(|_| std::array::from_fn(|_| rng.random_range(0.01..0.1))).collect(),
            }
        });
        let frames = frames.collect();
        Skinning { body, frames }
    })
}

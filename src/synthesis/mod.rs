//! Synthetic captures: random people, posed, dressed, lit and photographed, with the truth beside the pictures.
//!
//! One seed makes one scene, whatever else is made in the same run: scene k of a run with seed S uses the generator
//! ChaCha8 with seed S on stream k, so scenes can be made in any order and on any number of threads.

pub mod appearance;
pub mod backdrop;
pub mod clothing;
pub mod furniture;
pub mod pose;
pub mod rig;
pub mod scene;
pub mod sensor;
pub mod subject;
pub mod surroundings;

pub use scene::{Scene, Settings};
pub use subject::{Stance, Subject};
pub use surroundings::{Shot, Surroundings};

use rand_chacha::ChaCha8Rng;

/// The generator of scene `index` in a run seeded with `seed`.
pub fn scene_rng(seed: u64, index: u64) -> ChaCha8Rng {
    use rand::SeedableRng;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    rng
}

/// A standard normal number (Box–Muller), limited to ±`limit`.
pub fn normal(rng: &mut impl rand::Rng, limit: f64) -> f64 {
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    ((-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()).clamp(-limit, limit)
}

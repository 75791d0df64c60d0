//! Numbers to feed operators with: over many decades, and in the patterns that rounding dislikes.

use proptest::prelude::*;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::array::Array;

/// A pattern of numbers of size about one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// −1..1, evenly.
    Even,
    /// 0..1, evenly: sums grow and never cancel.
    Positive,
    /// Either sign, evenly over the decades 10⁻³..10³: a few terms outweigh the rest.
    Decades,
    /// v, −v(1 + 10⁻⁶·r), w, −w(1 + 10⁻⁶·r) …: sums of neighbours all but vanish.
    Cancelling,
    /// Mostly zeros.
    Sparse,
    /// Zeros and ones, as voxels.
    Binary,
    /// A large number plus a small deviation: the mean outweighs the scatter.
    Offset,
    /// All zeros.
    Zero,
}

/// All patterns.
const PATTERNS: [Pattern; 8] = [
    Pattern::Even,
    Pattern::Positive,
    Pattern::Decades,
    Pattern::Cancelling,
    Pattern::Sparse,
    Pattern::Binary,
    Pattern::Offset,
    Pattern::Zero,
];

/// How to fill an array: the pattern, its scale and a seed.
///
/// # Why no denormals?
/// Below 2⁻¹²⁶ an f32 loses digits and its rounding is no longer relative, so that u·m does not bound it, and processors
/// may be set to flush such numbers to zero. The smallest numbers here are about 10⁻¹¹ (1e-6 of scale, 1e-3 of pattern
/// and rarely smaller), so products of two stay far above; exact zeros occur.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Values {
    /// The pattern.
    pub pattern: Pattern,
    /// Everything is multiplied by 10 to this power, −3..=3.
    pub decade: i32,
    /// Where the random numbers start.
    pub seed: u64,
}

impl Values {
    /// Ordinary numbers, −1..1: the ground on which faults are planted.
    pub fn ordinary(seed: u64) -> Self {
        Self { pattern: Pattern::Even, decade: 0, seed }
    }

    /// An array of this shape.
    pub fn fill(&self, shape: &[usize]) -> Array {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let scale = 10_f32.powi(self.decade);
        let mut previous = 0.0;
        let values = (0..shape.iter().product::<usize>())
            .map(|i| {
                let even = random.random_range(-1.0_f32..1.0);
                let value = match self.pattern {
                    Pattern::Even => even,
                    Pattern::Positive => even.abs(),
                    Pattern::Decades => 10_f32.powf(random.random_range(-3.0..3.0)).copysign(even),
                    Pattern::Cancelling if i % 2 == 1 => -previous * (1.0 + 1e-6 * even),
                    Pattern::Cancelling => even,
                    Pattern::Sparse => {
                        if random.random_bool(0.9) {
                            0.0
                        } else {
                            even
                        }
                    }
                    Pattern::Binary => f32::from(u8::from(even > 0.0)),
                    Pattern::Offset => 1.0 + 1e-3 * even,
                    Pattern::Zero => 0.0,
                };
                previous = value;
                value * scale
            })
            .collect();
        Array::new(shape, values)
    }
}

impl Arbitrary for Values {
    type Parameters = ();
    type Strategy = BoxedStrategy<Self>;

    fn arbitrary_with((): ()) -> Self::Strategy {
        // Ordinary numbers are the most frequent, and what shrinking leads to.
        let pattern = prop_oneof![3 => Just(Pattern::Even), 5 => prop::sample::select(&PATTERNS[1..])];
        let decade = prop_oneof![2 => Just(0), 3 => -3..=3];
        (pattern, decade, any::<u64>())
            .prop_map(|(pattern, decade, seed)| Self { pattern, decade, seed })
            .boxed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_numbers() {
        for pattern in PATTERNS {
            let values = Values { pattern, decade: -2, seed: 7 };
            assert_eq!(values.fill(&[3, 50]), values.fill(&[3, 50]), "{pattern:?}");
        }
    }

    #[test]
    fn products_of_two_numbers_are_zero_or_normal() {
        for pattern in PATTERNS {
            let smallest = Values { pattern, decade: -3, seed: 3 }
                .fill(&[100_000])
                .values
                .into_iter()
                .filter(|&v| v != 0.0)
                .fold(1.0, |a: f32, v| a.min(v.abs()));
            assert!(smallest * smallest > f32::MIN_POSITIVE, "{pattern:?}: {smallest}");
        }
    }
}

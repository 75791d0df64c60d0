//! What can be added and multiplied, and nothing more: numbers, and integers modulo 2⁶⁴.
//!
//! Sums and products of integers of k bits wrap around at 2ᵏ. Taking the remainder modulo 2ᵏ commutes with + − ×, so it
//! is enough to compute modulo 2⁶⁴, as [`Wrapping<i64>`] does, and to cut the answer to its k bits at the end.

use super::Scalar;
use std::fmt::Debug;
use std::num::Wrapping;
use std::ops::{Add, Mul, Neg, Sub};

/// A number type with + − ×. Sums of many go through [`plus`](Ring::plus) and [`plus_product`](Ring::plus_product).
pub trait Ring:
    Copy + Debug + PartialEq + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// Zero, the empty sum.
    const ZERO: Self;

    /// One, the empty product.
    fn one() -> Self;

    /// One more term of a sum that may be taken in any order.
    fn plus(self, term: Self) -> Self;

    /// One more product of a dot product that may be taken in any order: self + a·b.
    fn plus_product(self, a: Self, b: Self) -> Self;
}

impl<T: Scalar> Ring for T {
    const ZERO: T = T::ZERO;

    fn one() -> T {
        T::exact(1.0)
    }

    fn plus(self, term: T) -> T {
        Scalar::plus(self, term)
    }

    fn plus_product(self, a: T, b: T) -> T {
        Scalar::plus_product(self, a, b)
    }
}

impl Ring for Wrapping<i64> {
    const ZERO: Wrapping<i64> = Wrapping(0);

    fn one() -> Wrapping<i64> {
        Wrapping(1)
    }

    fn plus(self, term: Wrapping<i64>) -> Wrapping<i64> {
        self + term
    }

    fn plus_product(self, a: Wrapping<i64>, b: Wrapping<i64>) -> Wrapping<i64> {
        self + a * b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cutting_to_eight_bits_at_the_end_is_cutting_after_every_step() {
        let (a, b, c) = (-77_i8, 113_i8, 45_i8);
        let stepwise = a.wrapping_mul(b).wrapping_sub(c).wrapping_mul(a);
        let wide = [a, b, c].map(|x| Wrapping(i64::from(x)));
        assert_eq!(((wide[0] * wide[1] - wide[2]) * wide[0]).0 as i8, stepwise);
    }
}

//! The arithmetic that the operators use, so that one text serves `f64` and [`Rounded`](super::Rounded).

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number that an operator can compute with: a value, and what lower precision may do to it.
///
/// `+ − × ÷` are single operations on two numbers. Sums of many numbers go through [`plus`](Scalar::plus) and
/// [`plus_product`](Scalar::plus_product), whose rounding does not depend on the order of summation.
pub trait Scalar:
    Copy
    + Debug
    + PartialEq
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Zero, the empty sum.
    const ZERO: Self;

    /// Whether magnitudes and terms are kept; where they are not, an operator need not derive them.
    const TRACKS_ROUNDING: bool;

    /// A number known without error: an input, a constant.
    fn exact(value: f64) -> Self;

    /// A number whose rounding the operator has derived by itself: known to within γ_terms·magnitude.
    fn within(value: f64, magnitude: f64, terms: f64) -> Self;

    /// The value itself.
    fn value(self) -> f64;

    /// The m of the bound γ_n·m; at least |value|.
    fn magnitude(self) -> f64;

    /// The n of the bound γ_n·m; zero for an exact number.
    fn terms(self) -> f64;

    /// One more term of a sum that may be taken in any order.
    fn plus(self, term: Self) -> Self;

    /// One more product of a dot product that may be taken in any order: self + a·b.
    fn plus_product(self, a: Self, b: Self) -> Self;

    /// f(self) for a smooth f with value `f` and derivative `slope` there, computed to within `roundings` units.
    ///
    /// With x̂ = x + e, |e| ≤ γ_n·m: |f(x̂) − f(x)| ≤ |f′|·γ_n·m to first order, and the evaluation adds its own
    /// roundings·u·|f|; both are covered by γ_{n + roundings}·max(|f|, |f′|·m). An exact argument has no error to enlarge.
    fn function(self, f: f64, slope: f64, roundings: f64) -> Self {
        let passed_on = if self.terms() == 0.0 { 0.0 } else { slope.abs() * self.magnitude() };
        Self::within(f, f.abs().max(passed_on), self.terms() + roundings)
    }

    /// √self, which IEEE arithmetic rounds once.
    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        self.function(root, 0.5 / root, 1.0)
    }

    /// The larger of two numbers; a NaN wins. Choosing rounds nothing: |max(â, b̂) − max(a, b)| ≤ max of the errors.
    fn maximum(self, other: Self) -> Self {
        let others = other.value() > self.value() || other.value().is_nan();
        let (winner, loser) = if others { (other, self) } else { (self, other) };
        let exact = self.terms() == 0.0 && other.terms() == 0.0;
        // Rounding never brings −∞ back: a number that is masked with it is out of the contest.
        if !Self::TRACKS_ROUNDING || exact || loser.value() == f64::NEG_INFINITY {
            return winner;
        }
        let magnitude = self.magnitude().max(other.magnitude());
        Self::within(winner.value(), magnitude, self.terms().max(other.terms()))
    }
}

impl Scalar for f64 {
    const ZERO: f64 = 0.0;
    const TRACKS_ROUNDING: bool = false;

    fn exact(value: f64) -> f64 {
        value
    }

    fn within(value: f64, _magnitude: f64, _terms: f64) -> f64 {
        value
    }

    fn value(self) -> f64 {
        self
    }

    fn magnitude(self) -> f64 {
        self.abs()
    }

    fn terms(self) -> f64 {
        0.0
    }

    fn plus(self, term: f64) -> f64 {
        self + term
    }

    fn plus_product(self, a: f64, b: f64) -> f64 {
        self + a * b
    }
}

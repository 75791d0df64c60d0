//! The certificate in every precision: what the numbers of a float type can be off by, and the grade of one of them.
//!
//! The reference states (y, m, n) for each element, see [`Rounded`]. In a type with unit roundoff u and smallest positive
//! number η an implementation of the same products and sums is off by at most
//!
//! |ŷ − y| ≤ γ_n(u)·m + n·η + γ_n(2⁻⁵³)·m,
//!
//! the second term for underflow (each of n results is off by at most η/2, and a factor of at most 2 covers what follows),
//! the third for the reference's own f64, which matters where the type is f64 itself.
//!
//! # What if n·u is not small?
//! γ_n = nu/(1 − nu) promises nothing from nu = 1 on: 256 products in bf16. For sums and dot products, where long chains
//! come from, nu itself is a bound for every n (Jeannerod and Rump 2013); γ is used up to nu = ½ and 2nu, which meets it
//! there, beyond.
//!
//! # What does overflow do?
//! A result that the type cannot hold must be the infinity that rounding gives. Where only the magnitude is beyond the type
//! an intermediate result may overflow although the result does not: unusual, not impossible.
//!
//! # And a bound that is infinite?
//! It accuses nobody and acquits nobody: the element is unusual, and whoever judges the tensor has to say so.
//!
//! # And flushing to zero?
//! Processors may be told to replace subnormal results by zero. That is accepted, and counted: it is no rounding.
//!
//! # References
//! C.-P. Jeannerod and S. M. Rump, Improved error bounds for inner products in floating-point arithmetic, SIAM J. Matrix
//! Anal. Appl. 34 (2013).

use vitruvian_reference::nn::{Rounded, gamma};

use crate::certificate::{LAMBDA, Verdict};
use crate::onnx::element::ElementType;

/// Unit roundoff of f64, in which the reference computes.
const UNIT_ROUNDOFF_F64: f64 = 1.0 / 9_007_199_254_740_992.0;

/// A float type's arithmetic.
#[derive(Clone, Copy, Debug)]
pub struct Precision {
    /// The type.
    pub element: ElementType,
    /// u.
    pub unit: f64,
    /// η, the smallest positive number.
    pub subnormal: f64,
    /// The smallest number with all its digits.
    pub normal: f64,
    /// The largest finite number.
    pub largest: f64,
}

/// One element, judged.
#[derive(Clone, Copy, Debug)]
pub struct Graded {
    /// The grade.
    pub verdict: Verdict,
    /// ŷ − y; 0 where both are the same number that is not finite, infinite where only one is.
    pub error: f64,
    /// |ŷ − y| over the bound; 0/0 is 0.
    pub share: f64,
    /// Whether zero was found for a number too small to be normal, and accepted.
    pub flushed: bool,
}

impl Precision {
    /// The arithmetic of a float type; `None` for the others.
    pub fn of(element: ElementType) -> Option<Self> {
        Some(Self {
            element,
            unit: element.unit_roundoff()?,
            subnormal: element.smallest_subnormal()?,
            normal: element.smallest_normal()?,
            largest: element.largest()?,
        })
    }

    /// What rounding can do at most to this element; 0 where nothing is rounded.
    pub fn bound(&self, expected: &Rounded) -> f64 {
        if expected.terms == 0.0 {
            return 0.0;
        }
        let roundings = expected.terms * self.unit;
        let share = if roundings <= 0.5 { gamma(expected.terms, self.unit) } else { 2.0 * roundings };
        let own = expected.terms * UNIT_ROUNDOFF_F64;
        (share + own) * expected.magnitude + expected.terms * self.subnormal
    }

    /// u·m, and never less than η: the unit in which differences are stated; infinite where m is unknown.
    pub fn csu(&self, expected: &Rounded) -> f64 {
        let unit = self.unit * expected.magnitude;
        if unit.is_nan() { f64::INFINITY } else { unit.max(self.subnormal) }
    }

    /// Judges one element.
    pub fn grade(&self, found: f64, expected: &Rounded) -> Graded {
        let value = expected.value;
        let graded = |verdict, error: f64, share| Graded { verdict, error, share, flushed: false };
        // Zeros of either sign are equal: the order of additions decides the sign.
        if found == self.element.round(value) || (found.is_nan() && value.is_nan()) {
            let error = if found.is_finite() { found - value } else { 0.0 };
            let bound = self.bound(expected);
            return graded(Verdict::Exact, error, if bound > 0.0 { error.abs() / bound } else { 0.0 });
        }
        let bound = self.bound(expected);
        if !(found.is_finite() && value.is_finite()) {
            let beyond = |reach: f64| reach >= self.largest * (1.0 - self.unit);
            let same_end = found.is_infinite() && (found > 0.0) == (value > 0.0);
            let verdict = if value.is_finite() && same_end && beyond(value.abs() + bound) {
                Verdict::Rounding
            } else if value.is_finite() && expected.terms > 1.0 && beyond(expected.magnitude + bound) {
                Verdict::Unusual
            } else {
                Verdict::Different
            };
            return graded(verdict, f64::INFINITY, f64::INFINITY);
        }
        let error = found - value;
        let size = error.abs();
        let share = if bound > 0.0 { size / bound } else { f64::INFINITY };
        if !bound.is_finite() {
            return graded(Verdict::Unusual, error, 0.0);
        }
        if size > bound {
            if found == 0.0 && value.abs() < self.normal + bound {
                return Graded { verdict: Verdict::Rounding, error, share: 1.0, flushed: true };
            }
            return graded(Verdict::Different, error, share);
        }
        let usual = (LAMBDA * expected.terms.sqrt()).min(expected.terms) * self.csu(expected);
        // The first-order part of a proven bound is never unusual where few roundings make it up.
        let usual = if expected.terms <= LAMBDA * LAMBDA { bound } else { usual.min(bound) };
        graded(if size <= usual { Verdict::Rounding } else { Verdict::Unusual }, error, share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::nn::Scalar as _;

    fn f32_arithmetic() -> Precision {
        Precision::of(ElementType::F32).expect("a float type")
    }

    #[test]
    fn the_grades_are_ordered_by_distance_in_every_precision() {
        for element in [ElementType::F16, ElementType::Bf16, ElementType::F32, ElementType::F64] {
            let precision = Precision::of(element).expect("a float type");
            let expected = Rounded { value: 1.0, magnitude: 1.0, terms: 100.0 };
            let at = |csu: f64| precision.grade(1.0 + csu * precision.unit, &expected).verdict;
            assert_eq!(at(0.0), Verdict::Exact, "{element}: the value itself");
            assert_eq!(at(38.0), Verdict::Rounding, "{element}: below 4·√100");
            assert_eq!(at(90.0), Verdict::Unusual, "{element}: below 100");
            assert_eq!(at(260.0), Verdict::Different, "{element}: beyond the bound");
        }
        assert!(Precision::of(ElementType::I32).is_none(), "integers do not round");
    }

    #[test]
    fn exact_numbers_must_be_met() {
        let precision = f32_arithmetic();
        assert_eq!(precision.grade(-0.0, &Rounded::exact(0.0)).verdict, Verdict::Exact, "−0 equals 0");
        for (found, value) in [(1e-30, 0.0), (1.0 + 1e-7, 1.0), (f64::NAN, 1.0), (1.0, f64::NAN)] {
            let graded = precision.grade(found, &Rounded::exact(value));
            assert_eq!(graded.verdict, Verdict::Different, "{found} for {value}");
        }
        assert_eq!(precision.grade(f64::NAN, &Rounded::exact(f64::NAN)).verdict, Verdict::Exact, "NaN");
    }

    #[test]
    fn an_infinity_is_right_only_where_the_type_ends() {
        let half = Precision::of(ElementType::F16).expect("a float type");
        let one = |value: f64| Rounded { value, magnitude: value.abs(), terms: 1.0 };
        assert_eq!(half.grade(f64::INFINITY, &one(70_000.0)).verdict, Verdict::Exact, "beyond the type");
        assert_eq!(half.grade(f64::INFINITY, &one(65_510.0)).verdict, Verdict::Rounding, "at its end");
        assert_eq!(half.grade(f64::INFINITY, &one(60_000.0)).verdict, Verdict::Different, "within it");
        assert_eq!(
            half.grade(f64::NEG_INFINITY, &one(70_000.0)).verdict,
            Verdict::Different,
            "the wrong end"
        );
        let cancelled = Rounded { value: 1.0, magnitude: 1e6, terms: 4.0 };
        assert_eq!(half.grade(f64::NAN, &cancelled).verdict, Verdict::Unusual, "∞ − ∞ on the way");
    }

    #[test]
    fn underflow_is_rounding_and_flushing_is_counted() {
        let precision = f32_arithmetic();
        let product = Rounded::exact(3e-23) * Rounded::exact(1e-20);
        let gradual = f64::from(3e-43_f32);
        assert!(precision.grade(gradual, &product).verdict <= Verdict::Rounding, "gradual underflow");
        let flushed = precision.grade(0.0, &Rounded { value: 1e-39, magnitude: 1e-39, terms: 1.0 });
        assert!(flushed.flushed && flushed.verdict == Verdict::Rounding, "{flushed:?}");
        let lost = precision.grade(0.0, &Rounded { value: 1e-37, magnitude: 1e-37, terms: 1.0 });
        assert_eq!(lost.verdict, Verdict::Different, "a normal number is not flushed");
    }
}

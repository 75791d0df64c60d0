//! Rounding analysis as a number type: the value in f64 beside what f32 (or less) may make of it.
//!
//! Let u be the unit roundoff and every operation be correctly rounded: fl(a ∘ b) = (a ∘ b)(1 + δ), |δ| ≤ u. A product of
//! n factors (1 + δ)^{±1} is 1 + θ_n with |θ_n| ≤ γ_n = nu/(1 − nu) (Higham, lemma 3.1). A [`Rounded`] number
//! (y, m, n) states, about the ŷ that a lower precision computes,
//!
//! |ŷ − y| ≤ γ_n·m,  m ≥ |y|.
//!
//! The rules follow from (1 + θ_i)(1 + θ_j) = 1 + θ_{i+j}:
//!
//! | operation | value | magnitude m | terms n | because |
//! |---|---|---|---|---|
//! | input | x | \|x\| | 0 | exact |
//! | a × b | ab | m_a·m_b | n_a + n_b + 1 | both errors and one rounding |
//! | a ÷ b | a/b | (m_a/\|b\|)(m_b/\|b\|) | n_a + n_b + 1 | first order in the error of b; exact when b is |
//! | a ± b, exact | a ± b | \|a ± b\| | 1 | one correctly rounded operation |
//! | a ± b | a ± b | m_a + m_b | max(n_a, n_b) + 1 | an error does not cancel when the values do |
//! | Σ, any order | Σ | Σ m | max + number of additions | a term passes through at most every addition |
//! | f(a) | f | max(\|f\|, \|f′\|·m_a) | n_a + k | [`Scalar::function`] |
//!
//! So a dot product Σ a_k b_k + c of exact inputs has m = Σ|a_k||b_k| + |c|, the same operator on absolute values, and
//! n = the number of products plus one for the bias: Higham's γ_{n+1} bound, whatever the order, blocking or
//! width of the sum, with or without fused multiply-add (a fused operation only omits roundings).
//! A product with an exact zero, and an addition of one, round nothing and count nothing; a tap in the padding is such a
//! zero.
//!
//! # What is not covered
//! Algorithms that compute other products than the definition's (Winograd, FFT, TF32 inputs), and underflow: with gradual
//! underflow add n times the smallest subnormal, with flush to zero n times the smallest normal number.
//! A sum of unequally rounded terms is bounded in the order written; operators fed exact tensors have no such sum.
//! The f64 value itself is off by at most γ_n(2⁻⁵³)·m, 2⁻²⁹ of the f32 bound.
//!
//! # References
//! N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., SIAM 2002, §3.1 and lemma 3.3.

use super::{Scalar, Tensor};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// u of IEEE binary32: 2⁻²⁴.
pub const UNIT_ROUNDOFF_F32: f64 = 1.0 / 16_777_216.0;

/// γ_n = nu/(1 − nu): the most that n roundings can do; infinite from nu = 1 on, where nothing can be promised.
pub fn gamma(terms: f64, unit_roundoff: f64) -> f64 {
    let nu = terms * unit_roundoff;
    if nu < 1.0 { nu / (1.0 - nu) } else { f64::INFINITY }
}

/// A number together with its rounding: computed in a precision with unit roundoff u it stays within γ_terms(u)·magnitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rounded {
    /// y, computed in f64.
    pub value: f64,
    /// m: for a dot product the same dot product of absolute values.
    pub magnitude: f64,
    /// n: the roundings on the longest path to this number. A count, kept as f64 because γ_n uses it so.
    pub terms: f64,
}

impl Rounded {
    /// The proved bound γ_n·m on |ŷ − y|.
    pub fn bound(self, unit_roundoff: f64) -> f64 {
        if self.terms == 0.0 { 0.0 } else { gamma(self.terms, unit_roundoff) * self.magnitude }
    }

    fn is_exact(self) -> bool {
        self.terms == 0.0
    }

    /// A number that is zero with certainty: its magnitude is.
    fn is_zero(self) -> bool {
        self.magnitude == 0.0
    }
}

impl Scalar for Rounded {
    const ZERO: Rounded = Rounded { value: 0.0, magnitude: 0.0, terms: 0.0 };
    const TRACKS_ROUNDING: bool = true;

    fn exact(value: f64) -> Rounded {
        Rounded { value, magnitude: value.abs(), terms: 0.0 }
    }

    fn within(value: f64, magnitude: f64, terms: f64) -> Rounded {
        Rounded { value, magnitude, terms }
    }

    fn value(self) -> f64 {
        self.value
    }

    fn magnitude(self) -> f64 {
        self.magnitude
    }

    fn terms(self) -> f64 {
        self.terms
    }

    fn plus(self, term: Rounded) -> Rounded {
        if term.is_zero() {
            return self;
        }
        if self.is_zero() {
            return term;
        }
        Rounded {
            value: self.value + term.value,
            magnitude: self.magnitude + term.magnitude,
            terms: self.terms.max(term.terms) + 1.0,
        }
    }

    fn plus_product(self, a: Rounded, b: Rounded) -> Rounded {
        self.plus(a * b)
    }
}

impl Add for Rounded {
    type Output = Rounded;
    fn add(self, b: Rounded) -> Rounded {
        if self.is_exact() && b.is_exact() && !self.is_zero() && !b.is_zero() {
            let sum = self.value + b.value;
            return Rounded { value: sum, magnitude: sum.abs(), terms: 1.0 };
        }
        self.plus(b)
    }
}

impl Sub for Rounded {
    type Output = Rounded;
    fn sub(self, b: Rounded) -> Rounded {
        self + -b
    }
}

impl Mul for Rounded {
    type Output = Rounded;
    fn mul(self, b: Rounded) -> Rounded {
        Rounded {
            value: self.value * b.value,
            magnitude: self.magnitude * b.magnitude,
            terms: self.terms + b.terms + 1.0,
        }
    }
}

impl Div for Rounded {
    type Output = Rounded;
    fn div(self, b: Rounded) -> Rounded {
        let divisor = b.value.abs();
        Rounded {
            value: self.value / b.value,
            magnitude: (self.magnitude / divisor) * (b.magnitude / divisor),
            terms: self.terms + b.terms + 1.0,
        }
    }
}

impl Neg for Rounded {
    type Output = Rounded;
    fn neg(self) -> Rounded {
        Rounded { value: -self.value, ..self }
    }
}

impl Tensor<f64> {
    /// The same tensor as exact inputs of a rounding analysis.
    pub fn rounded(&self) -> Tensor<Rounded> {
        self.map(Rounded::exact)
    }
}

impl Tensor<Rounded> {
    /// y: what the operator gives.
    pub fn values(&self) -> Tensor {
        self.map(|r| r.value)
    }

    /// m: the operator on absolute values.
    pub fn magnitudes(&self) -> Tensor {
        self.map(|r| r.magnitude)
    }

    /// n: the roundings behind each element.
    pub fn terms(&self) -> Tensor {
        self.map(|r| r.terms)
    }

    /// γ_n(u)·m: the proved bound of each element in a precision with this unit roundoff.
    pub fn bounds(&self, unit_roundoff: f64) -> Tensor {
        self.map(|r| r.bound(unit_roundoff))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(value: f64) -> Rounded {
        Rounded::exact(value)
    }

    #[test]
    fn a_dot_product_counts_its_products_and_its_bias() {
        let y = exact(10.0).plus_product(exact(2.0), exact(3.0)).plus_product(exact(-1.0), exact(4.0));
        assert_eq!(y, Rounded { value: 12.0, magnitude: 20.0, terms: 3.0 });
    }

    #[test]
    fn an_exact_zero_rounds_nothing() {
        let y = Rounded::ZERO.plus_product(exact(0.0), exact(5.0)).plus_product(exact(7.0), exact(0.0));
        assert_eq!(y, Rounded::ZERO);
        assert_eq!(exact(3.0).plus(Rounded::ZERO), exact(3.0));
    }

    #[test]
    fn one_addition_is_correctly_rounded_but_a_sum_remembers_what_cancelled() {
        assert_eq!((exact(1.0) - exact(0.75)).magnitude, 0.25);
        assert_eq!(exact(1.0).plus(exact(-0.75)).magnitude, 1.75);
        let product = exact(1.0) * exact(3.0);
        assert_eq!((product - exact(3.0)).magnitude, 6.0, "an inexact operand keeps its error");
    }

    #[test]
    fn f32_arithmetic_stays_within_the_bound_in_every_order() {
        // 300 products over six decades with heavy cancellation, summed forwards, backwards, in pairs and fused.
        let a: Vec<f32> = (0..300).map(|i| (i as f32 * 12.9898).sin() * 10f32.powi(i % 7 - 3)).collect();
        let b: Vec<f32> = (0..300).map(|i| (i as f32 * 78.233).cos()).collect();
        let y = a
            .iter()
            .zip(&b)
            .fold(Rounded::ZERO, |sum, (&a, &b)| sum.plus_product(exact(f64::from(a)), exact(f64::from(b))));
        let products: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a * b).collect();
        let forwards: f32 = products.iter().sum();
        let backwards: f32 = products.iter().rev().sum();
        let fused = a.iter().zip(&b).fold(0f32, |sum, (a, b)| a.mul_add(*b, sum));
        let mut pairs = products;
        while pairs.len() > 1 {
            pairs = pairs.chunks(2).map(|pair| pair.iter().sum()).collect();
        }
        let bound = y.bound(UNIT_ROUNDOFF_F32);
        for (order, sum) in
            [("forwards", forwards), ("backwards", backwards), ("fused", fused), ("pairs", pairs[0])]
        {
            let error = (f64::from(sum) - y.value).abs();
            assert!(error <= bound, "{order}: error {error:e} exceeds the bound {bound:e}");
        }
        assert!(bound < 1e-4 * y.magnitude, "the bound says something: {bound:e} against {:e}", y.magnitude);
    }

    #[test]
    fn gamma_promises_nothing_when_the_terms_exhaust_the_significand() {
        assert_eq!(gamma(16_777_216.0, UNIT_ROUNDOFF_F32), f64::INFINITY);
        assert!((gamma(1.0, UNIT_ROUNDOFF_F32) / UNIT_ROUNDOFF_F32 - 1.0).abs() < 1e-7);
    }

    #[test]
    fn quotients_and_roots_carry_the_error_of_their_arguments() {
        let three = exact(1.0) + exact(2.0);
        let q = exact(6.0) / three;
        assert_eq!(q, Rounded { value: 2.0, magnitude: 2.0, terms: 2.0 });
        let r = (exact(5.0).plus(exact(-1.0))).sqrt();
        assert_eq!((r.value, r.terms), (2.0, 2.0));
        assert_eq!(
            r.magnitude, 2.0,
            "half the slope of 1/2 at 4, times the magnitude 6, is less than the root"
        );
    }

    #[test]
    fn choosing_the_larger_rounds_nothing() {
        assert_eq!(exact(2.0).maximum(exact(5.0)), exact(5.0));
        assert!(exact(2.0).maximum(exact(f64::NAN)).value.is_nan());
        let inexact = exact(1.0) * exact(1.0);
        assert_eq!(inexact.maximum(exact(-9.0)), Rounded { value: 1.0, magnitude: 9.0, terms: 1.0 });
    }
}

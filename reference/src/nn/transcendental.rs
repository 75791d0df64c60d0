//! The elementary transcendental functions, and powers.
//!
//! # Rounding
//! No standard says how well these are rounded; the GNU C Library promises "a few units in the last place". What is allowed
//! here is two such units at least, and at least a sixth more than ONNX Runtime 1.32 was measured to use against f64 (its
//! CPU kernels: MLAS, Eigen, the C library), over every 61st or 997th f32 of the whole range and every one around the largest
//! errors found. What is composed of other functions has a unit or two more. Measured errors are in u·|y|; one unit in the last
//! place (ulp) is between u·|y| and 2u·|y|, so that n ulp are 2n roundings.
//!
//! | function | allowed, ulp | measured, u·\|y\| |
//! |---|---|---|
//! | exp | 2 | 1.2 |
//! | ln | 3 | 4.2 |
//! | sin, cos | 2 | 2.9 |
//! | tan | 4 | 1.4 |
//! | asin | 5 | 8.5 |
//! | acos | 4 | 4.8 |
//! | atan | 3 | 4.9 |
//! | sinh | 3 | 2.9 |
//! | cosh | 3 | 2.9 |
//! | tanh | 4 | 5.5 |
//! | asinh | 3 | 2.1 |
//! | acosh | 4 | 1.9 |
//! | atanh | 3 | 2.1 |
//! | erf | 2 | 1.4 |
//! | softplus | 4 | 5.6 |
//! | sigmoid | 4, of max(y, ½) | 4.6 |
//! | xʸ | 4 | 1.0 |
//!
//! Sigmoid may spend them on its range instead of its value: kernels compute it as a clamped rational function or as
//! ½ + ½·tanh(x/2), which far out in the left tail keep few digits of a very small number. The slope adds what an inexact argument
//! makes of the value ([`Scalar::function`]). An angle of many turns is not excused: the measured kernels reduce every f32.

use super::elementwise::broadcast;
use super::{Scalar, Tensor};

/// Roundings in n units in the last place: 1 ulp ≤ 2u·|y|.
pub(super) const fn ulps(n: u32) -> f64 {
    2.0 * n as f64
}

/// Elementary functions of a number with its rounding; angles in radians.
pub trait Elementary: Scalar {
    /// eˣ.
    fn exp(self) -> Self {
        let y = self.value().exp();
        self.function(y, y, ulps(2))
    }

    /// The natural logarithm; −∞ at 0, NaN below.
    fn ln(self) -> Self {
        self.function(self.value().ln(), self.value().recip(), ulps(3))
    }

    /// The sine.
    fn sin(self) -> Self {
        self.function(self.value().sin(), self.value().cos(), ulps(2))
    }

    /// The cosine.
    fn cos(self) -> Self {
        self.function(self.value().cos(), self.value().sin(), ulps(2))
    }

    /// The tangent.
    fn tan(self) -> Self {
        let y = self.value().tan();
        self.function(y, 1.0 + y * y, ulps(4))
    }

    /// The angle −π/2…π/2 with this sine; NaN outside −1…1.
    fn asin(self) -> Self {
        self.function(self.value().asin(), (1.0 - self.value() * self.value()).sqrt().recip(), ulps(5))
    }

    /// The angle 0…π with this cosine; NaN outside −1…1.
    fn acos(self) -> Self {
        self.function(self.value().acos(), (1.0 - self.value() * self.value()).sqrt().recip(), ulps(4))
    }

    /// The angle −π/2…π/2 with this tangent.
    fn atan(self) -> Self {
        self.function(self.value().atan(), (1.0 + self.value() * self.value()).recip(), ulps(3))
    }

    /// The hyperbolic sine.
    fn sinh(self) -> Self {
        self.function(self.value().sinh(), self.value().cosh(), ulps(3))
    }

    /// The hyperbolic cosine.
    fn cosh(self) -> Self {
        self.function(self.value().cosh(), self.value().sinh(), ulps(3))
    }

    /// The hyperbolic tangent.
    fn tanh(self) -> Self {
        let y = self.value().tanh();
        self.function(y, 1.0 - y * y, ulps(4))
    }

    /// The inverse of the hyperbolic sine.
    fn asinh(self) -> Self {
        self.function(self.value().asinh(), (1.0 + self.value() * self.value()).sqrt().recip(), ulps(3))
    }

    /// The inverse of the hyperbolic cosine, at least 0; NaN below 1.
    fn acosh(self) -> Self {
        // With t = x − 1, which is exact near 1: x + √(x² − 1) = 1 + t + √(t(t + 2)).
        let t = self.value() - 1.0;
        let root = t.sqrt() * (t + 2.0).sqrt();
        self.function((t + root).ln_1p(), root.recip(), ulps(4))
    }

    /// The inverse of the hyperbolic tangent; NaN outside −1…1.
    fn atanh(self) -> Self {
        self.function(self.value().atanh(), (1.0 - self.value() * self.value()).recip(), ulps(3))
    }

    /// The error function 2/√π ∫₀ˣ e^{−t²} dt.
    fn erf(self) -> Self {
        let slope = std::f64::consts::FRAC_2_SQRT_PI * (-self.value() * self.value()).exp();
        self.function(erf_value(self.value()), slope, ulps(2))
    }

    /// ln(1 + eˣ) = max(x, 0) + ln(1 + e^{−|x|}), which overflows nowhere.
    fn softplus(self) -> Self {
        self.function(softplus_value(self.value()), sigmoid_value(self.value()), ulps(4))
    }

    /// 1/(1 + e⁻ˣ), evaluated with e^{−|x|} so that nothing overflows.
    fn sigmoid(self) -> Self {
        let y = sigmoid_value(self.value());
        let y = self.function(y, y * (1.0 - y), ulps(4));
        Self::within(y.value(), y.magnitude().max(0.5), y.terms())
    }

    /// selfʸ; NaN for a negative base and an exponent that is no integer, 1 for the exponent 0.
    fn pow(self, exponent: Self) -> Self {
        let (x, y) = (self.value(), exponent.value());
        let power = x.powf(y);
        // An exact argument has no error for its slope to enlarge.
        let error = |slope: f64, of: Self| if of.terms() == 0.0 { 0.0 } else { slope.abs() * of.magnitude() };
        let by_base = if y == 0.0 { 0.0 } else { error(y * x.powf(y - 1.0), self) };
        let magnitude = power.abs().max(by_base + error(power * x.abs().ln(), exponent));
        Self::within(power, magnitude, self.terms().max(exponent.terms()) + ulps(4))
    }
}

impl<T: Scalar> Elementary for T {}

/// The logistic function of one number.
pub(crate) fn sigmoid_value(x: f64) -> f64 {
    let e = (-x.abs()).exp();
    if x >= 0.0 { 1.0 / (1.0 + e) } else { e / (1.0 + e) }
}

/// ln(1 + eˣ) of one number; the exponential carries a NaN, which the maximum drops.
pub(crate) fn softplus_value(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// The error function of one number, to a few units in the last place.
///
/// Up to 2 by the series erf x = 2/√π·e^{−x²}·Σ 2ᵏx^{2k+1}/(1·3·…·(2k + 1)), whose terms are all of one sign. Beyond by
/// 1 − erfc x with the continued fraction erfc x = e^{−x²}/√π · 1/(x + (1/2)/(x + (2/2)/(x + (3/2)/(x + …)))).
fn erf_value(x: f64) -> f64 {
    let a = x.abs();
    if a.is_nan() || a == 0.0 {
        return x;
    }
    let density = std::f64::consts::FRAC_2_SQRT_PI * (-a * a).exp();
    let y = if a <= 2.0 {
        let (mut sum, mut term, mut k) = (0.0, a, 1.0);
        while term > sum * 1e-17 {
            sum += term;
            term *= 2.0 * a * a / (2.0 * k + 1.0);
            k += 1.0;
        }
        density * sum
    } else {
        let fraction = (1..=60).rev().fold(a, |tail, k| a + 0.5 * f64::from(k) / tail);
        1.0 - 0.5 * density / fraction
    };
    y.copysign(x)
}

/// eˣ.
pub fn exp<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::exp)
}

/// The natural logarithm.
pub fn log<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::ln)
}

/// The sine of angles in radians.
pub fn sin<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::sin)
}

/// The cosine of angles in radians.
pub fn cos<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::cos)
}

/// The angle 0…π (radians) with this cosine; a NaN outside −1…1.
pub fn acos<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::acos)
}

/// The angle −π/2…π/2 (radians) with this tangent.
pub fn atan<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::atan)
}

/// xʸ, with broadcasting.
///
/// # Panics
/// If the shapes do not broadcast.
///
/// # References
/// ONNX operator Pow (version 15); the answer has the base's type, and an integer one is cut off towards zero.
pub fn pow<T: Scalar>(x: &Tensor<T>, exponent: &Tensor<T>) -> Tensor<T> {
    broadcast("pow", x, exponent, Elementary::pow)
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    fn scalar(value: f64) -> Tensor {
        Tensor::new(&[], vec![value])
    }

    #[test]
    fn agree_with_pytorch() {
        let x = pattern(&[12], 1);
        let positive = x.map(f64::abs);
        let power = pow(&positive, &scalar(1.5));
        let found = [exp(&x), log(&positive), sin(&x), cos(&x), acos(&x), atan(&x), power];
        for (found, golden) in found.iter().zip(&goldens::TRANSCENDENTAL) {
            check(found, golden);
        }
    }

    type Function<T> = fn(T) -> T;

    fn functions<T: Scalar>() -> [(&'static str, Function<T>); 17] {
        [
            ("exp", Elementary::exp),
            ("ln", Elementary::ln),
            ("sin", Elementary::sin),
            ("cos", Elementary::cos),
            ("tan", Elementary::tan),
            ("asin", Elementary::asin),
            ("acos", Elementary::acos),
            ("atan", Elementary::atan),
            ("sinh", Elementary::sinh),
            ("cosh", Elementary::cosh),
            ("tanh", Elementary::tanh),
            ("asinh", Elementary::asinh),
            ("atanh", Elementary::atanh),
            ("erf", Elementary::erf),
            ("softplus", Elementary::softplus),
            ("sigmoid", Elementary::sigmoid),
            ("pow", |x| Elementary::pow(x, T::exact(3.0))),
        ]
    }

    #[test]
    fn slopes_are_central_differences() {
        // An argument known to within u·|x| makes the value uncertain by |f′|·u·|x|: read the slope off the magnitude.
        let inexact = |value: f64| Rounded { value, magnitude: 1e9, terms: 1.0 };
        let slope_is_right = |name: &str, f: Function<Rounded>, x: f64| {
            let slope = (f(inexact(x + 1e-6)).value - f(inexact(x - 1e-6)).value) / 2e-6;
            let magnitude = f(inexact(x)).magnitude / 1e9;
            assert!(
                (slope.abs() - magnitude).abs() < 1e-8,
                "{name} at {x}: slope {slope}, magnitude {magnitude}"
            );
        };
        for x in [0.3, 0.55, 0.9] {
            for (name, f) in functions() {
                slope_is_right(name, f, x);
            }
            slope_is_right("acosh", Elementary::acosh, 1.0 + x);
            slope_is_right("xʸ by y", |y| Elementary::pow(Rounded::exact(0.7), y), x);
        }
    }

    #[test]
    fn an_exact_argument_has_no_error_to_enlarge() {
        let y = Elementary::exp(Rounded::exact(50.0));
        assert_eq!((y.magnitude, y.terms), (y.value, 4.0));
        let y = Elementary::pow(Rounded::exact(2.0), Rounded::exact(60.0));
        assert_eq!((y.magnitude, y.terms), (2f64.powi(60), 8.0));
    }

    #[test]
    fn inverse_functions_undo_one_another() {
        for x in [1e-9, 0.1, 0.5, 1.3] {
            for (what, back) in [
                ("sinh", Elementary::asinh(x.sinh())),
                ("cosh", Elementary::acosh(x.cosh())),
                ("tanh", Elementary::atanh(x.tanh())),
                ("tan", Elementary::atan(x.tan())),
                ("sin", Elementary::asin(x.sin())),
            ] {
                // cosh is flat at 0: half of the digits of a small x are not in it.
                let lost = if what == "cosh" { 1e-16 / x } else { 0.0 };
                assert!((back - x).abs() < 1e-14 * x + lost, "{what} at {x}: {back}");
            }
        }
    }

    #[test]
    fn the_error_function_meets_its_table_and_joins_its_two_forms() {
        // Abramowitz and Stegun, table 7.1, and the limits.
        for (x, erf) in [(0.5, 0.520_499_877_8), (1.0, 0.842_700_792_9), (2.0, 0.995_322_265_0)] {
            assert!((erf_value(x) - erf).abs() < 5.1e-11, "erf({x}) = {}", erf_value(x));
            assert_eq!(erf_value(-x), -erf_value(x), "odd");
        }
        assert!((erf_value(2.0_f64.next_up()) - erf_value(2.0)).abs() < 2e-15, "the forms meet at 2");
        assert_eq!((erf_value(7.0), erf_value(f64::NEG_INFINITY)), (1.0, -1.0));
        assert!(erf_value(f64::NAN).is_nan() && erf_value(-0.0).is_sign_negative());
        // The integral itself, by Simpson's rule.
        for x in [0.8, 1.9, 2.1, 3.0] {
            let f = |t: f64| (-t * t).exp();
            let (n, h) = (2000, x / 2000.0);
            let sum: f64 = (0..n / 2)
                .map(|k| 2.0 * f64::from(k) * h)
                .map(|t| f(t) + 4.0 * f(t + h) + f(t + 2.0 * h))
                .sum();
            let integral = std::f64::consts::FRAC_2_SQRT_PI * sum * h / 3.0;
            assert!((erf_value(x) - integral).abs() < 1e-12, "erf({x})");
        }
    }

    #[test]
    fn softplus_has_the_slope_of_sigmoid_and_overflows_nowhere() {
        let [zero, far, tail] = [0.0, 1000.0, -1000.0].map(Elementary::softplus);
        assert_eq!((zero, far, tail), (2f64.ln(), 1000.0, 0.0));
        assert!(Elementary::softplus(f64::NAN).is_nan());
    }

    #[test]
    fn sigmoid_of_minus_x_is_its_complement_and_tails_stay_finite() {
        for x in [0.0, 0.1, 1.0, 5.0, 30.0] {
            assert!((sigmoid_value(x) + sigmoid_value(-x) - 1.0).abs() < 1e-15, "at {x}");
        }
        assert_eq!((sigmoid_value(0.0), sigmoid_value(800.0), sigmoid_value(-800.0)), (0.5, 1.0, 0.0));
        assert!((sigmoid_value(-30.0) / (-30f64).exp() - 1.0).abs() < 1e-12, "a tail is exponential");
    }

    #[test]
    fn powers_of_negative_numbers_and_of_nothing() {
        let power = |x: f64, y: f64| pow(&scalar(x), &scalar(y)).data[0];
        assert_eq!((power(-2.0, 3.0), power(0.0, 0.0), power(4.0, -0.5)), (-8.0, 1.0, 0.5));
        assert!(power(-2.0, 0.5).is_nan());
        let y = pow(&Tensor::new(&[2, 1], vec![2.0, 3.0]), &Tensor::new(&[2], vec![1.0, 2.0]));
        assert_eq!(y, Tensor::new(&[2, 2], vec![2.0, 4.0, 3.0, 9.0]));
    }

    #[test]
    fn bounds_of_the_f32_functions_of_the_standard_library_hold() {
        let single: [(&str, fn(f32) -> f32); 11] = [
            ("exp", f32::exp),
            ("ln", f32::ln),
            ("sin", f32::sin),
            ("cos", f32::cos),
            ("tan", f32::tan),
            ("asin", f32::asin),
            ("acos", f32::acos),
            ("atan", f32::atan),
            ("sinh", f32::sinh),
            ("cosh", f32::cosh),
            ("tanh", f32::tanh),
        ];
        for (name, f) in single {
            let (_, rounded) = functions::<Rounded>().into_iter().find(|(n, _)| *n == name).expect("one");
            for k in 1..200 {
                let x = (k as f32 - 100.5) / 101.0;
                let x = if name == "ln" { x.abs() } else { x };
                let y = rounded(Rounded::exact(x.into()));
                let error = (f64::from(f(x)) - y.value).abs();
                assert!(error <= y.bound(UNIT_ROUNDOFF_F32), "{name} at {x}: {error:e}");
            }
        }
    }
}

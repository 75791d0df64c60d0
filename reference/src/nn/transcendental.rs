//! Powers, exponentials and the trigonometric functions, element by element.
//!
//! Rounding: two units in the last place of the value each, four for the arc cosine (4.4u is what ONNX Runtime 1.32 was seen
//! to use), and what the slope makes of an inexact argument. The angles of a body are a few turns at most: a kernel that
//! reduces a large argument badly is not covered.

use super::activation::ulps;
use super::{Scalar, Tensor};

/// eˣ.
pub fn exp<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(x.value().exp(), x.value().exp(), ulps(2)))
}

/// The natural logarithm.
pub fn log<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(x.value().ln(), x.value().recip(), ulps(2)))
}

/// The sine of angles in radians.
pub fn sin<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(x.value().sin(), x.value().cos(), ulps(2)))
}

/// The cosine of angles in radians.
pub fn cos<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(x.value().cos(), x.value().sin(), ulps(2)))
}

/// The angle 0…π (radians) with this cosine; a NaN outside −1…1.
pub fn acos<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(x.value().acos(), (1.0 - x.value() * x.value()).sqrt().recip(), ulps(4)))
}

/// The angle −π/2…π/2 (radians) with this tangent.
pub fn atan<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(x.value().atan(), (1.0 + x.value() * x.value()).recip(), ulps(2)))
}

/// xⁿ for one exponent n.
pub fn pow<T: Scalar>(x: &Tensor<T>, exponent: f64) -> Tensor<T> {
    x.map(|x| {
        let slope = if exponent == 0.0 { 0.0 } else { exponent * x.value().powf(exponent - 1.0) };
        x.function(x.value().powf(exponent), slope, ulps(2))
    })
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    #[test]
    fn agree_with_pytorch() {
        let x = pattern(&[12], 1);
        let positive = x.map(f64::abs);
        let found = [exp(&x), log(&positive), sin(&x), cos(&x), acos(&x), atan(&x), pow(&positive, 1.5)];
        for (found, golden) in found.iter().zip(&goldens::TRANSCENDENTAL) {
            check(found, golden);
        }
    }

    #[test]
    fn slopes_are_central_differences() {
        // An argument known to within u·|x| makes the value uncertain by |f′|·u·|x|: read the slope off the magnitude.
        type Function = fn(&Tensor<Rounded>) -> Tensor<Rounded>;
        let functions: [(&str, Function); 7] = [
            ("exp", exp),
            ("log", log),
            ("sin", sin),
            ("cos", cos),
            ("acos", acos),
            ("atan", atan),
            ("pow", |x| pow(x, 3.0)),
        ];
        for (name, f) in functions {
            for x in [0.3, 0.55, 0.9] {
                let inexact =
                    |value: f64| Tensor::new(&[1], vec![Rounded { value, magnitude: 1e9, terms: 1.0 }]);
                let at = |x: f64| f(&inexact(x)).data[0].value;
                let slope = (at(x + 1e-6) - at(x - 1e-6)) / 2e-6;
                let magnitude = f(&inexact(x)).data[0].magnitude / 1e9;
                assert!(
                    (slope.abs() - magnitude).abs() < 1e-8,
                    "{name} at {x}: {slope}, magnitude {magnitude}"
                );
            }
        }
    }

    #[test]
    fn bounds_of_the_f32_functions_of_the_standard_library_hold() {
        let x = Tensor::from_fn(&[201], |i| f64::from((i[0] as f32 - 100.0) / 101.0));
        let single: [fn(f32) -> f32; 5] = [f32::exp, f32::sin, f32::cos, f32::acos, f32::atan];
        let x_rounded = x.rounded();
        let bounded = [exp(&x_rounded), sin(&x_rounded), cos(&x_rounded), acos(&x_rounded), atan(&x_rounded)];
        for (f, y) in single.iter().zip(&bounded) {
            for (x, y) in x.data.iter().zip(&y.data) {
                let error = (f64::from(f(*x as f32)) - y.value).abs();
                assert!(error <= y.bound(UNIT_ROUNDOFF_F32), "at {x}: {error:e}");
            }
        }
    }
}

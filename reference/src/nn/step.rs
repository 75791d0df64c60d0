//! Functions with steps: they choose among numbers that every precision holds, and round nothing.
//!
//! An exact argument gives an exact value. An inexact one is taken to lie on its value's side of a step; who chains
//! operators must ask how near the step is.

use super::elementwise::broadcast;
use super::{Scalar, Tensor};

/// A value on a plateau: as inexact as an inexact argument makes it, exact otherwise.
fn plateau<T: Scalar>(x: T, value: f64) -> T {
    T::within(value, value.abs(), x.terms())
}

/// ⌊x⌋, the largest integer not above x.
pub fn floor<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| plateau(x, x.value().floor()))
}

/// ⌈x⌉, the smallest integer not below x.
pub fn ceil<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| plateau(x, x.value().ceil()))
}

/// The nearest integer, the even one of two: 0.5 → 0, 1.5 → 2, −2.5 → −2.
///
/// # Conventions
/// IEEE 754's roundTiesToEven. C's `round` and the schoolbook round ties away from zero.
///
/// # References
/// ONNX operator Round (version 22).
pub fn round<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| plateau(x, x.value().round_ties_even()))
}

/// −1, 0 or 1; 0 for both zeros and NaN for NaN.
pub fn sign<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    let value = |x: f64| if x == 0.0 || x.is_nan() { x.abs() } else { x.signum() };
    x.map(|x| plateau(x, value(x.value())))
}

/// a − ⌊a/b⌋·b, with the sign of the divisor (a zero's as well), as Python's `%`; or with `truncated` C's `fmod`, with the sign of
/// the dividend.
///
/// Rounding: `fmod` is exact. Python's answer is `fmod`'s or, where the signs differ, that plus b, which rounds once.
///
/// # Panics
/// If the shapes do not broadcast.
///
/// # References
/// ONNX operator Mod (version 28), fmod = 0 and 1.
pub fn modulo<T: Scalar>(a: &Tensor<T>, b: &Tensor<T>, truncated: bool) -> Tensor<T> {
    broadcast("modulo", a, b, |a, b| {
        let remainder = a.value() % b.value();
        // a − k·b for a whole k: the error of b counts k times.
        let quotient = ((a.value() - remainder) / b.value()).abs();
        let passed_on = |x: T, times: f64| if x.terms() == 0.0 { 0.0 } else { times * x.magnitude() };
        let magnitude = remainder.abs().max(passed_on(a, 1.0) + passed_on(b, quotient));
        let remainder = T::within(remainder, magnitude, a.terms().max(b.terms()));
        let other_side = remainder.value() != 0.0 && (remainder.value() < 0.0) != (b.value() < 0.0);
        match truncated {
            false if other_side => remainder + b,
            // A zero has a sign as well.
            false
                if remainder.value() == 0.0
                    && remainder.value().is_sign_negative() != b.value().is_sign_negative() =>
            {
                -remainder
            }
            _ => remainder,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(f: impl Fn(&Tensor) -> Tensor, x: &[f64]) -> Vec<f64> {
        f(&Tensor::new(&[x.len()], x.to_vec())).data
    }

    #[test]
    fn a_remainder_of_zero_has_the_sign_of_the_divisor_or_of_the_dividend() {
        let (a, b) =
            (Tensor::new(&[4], vec![0.0, -0.0, 4.0, -4.0]), Tensor::new(&[4], vec![-2.0, 2.0, -2.0, 2.0]));
        let negative = |truncated| {
            modulo(&a, &b, truncated).data.iter().map(|y| y.is_sign_negative()).collect::<Vec<_>>()
        };
        assert_eq!(negative(false), [true, false, true, false]);
        assert_eq!(negative(true), [false, true, false, true]);
    }

    #[test]
    fn steps_by_hand() {
        let x = [-2.5, -0.5, 0.5, 1.5, 2.5, 3.0];
        assert_eq!(all(floor, &x), [-3.0, -1.0, 0.0, 1.0, 2.0, 3.0]);
        assert_eq!(all(ceil, &x), [-2.0, 0.0, 1.0, 2.0, 3.0, 3.0]);
        assert_eq!(all(round, &x), [-2.0, 0.0, 0.0, 2.0, 2.0, 3.0], "ties go to the even integer");
        assert_eq!(all(sign, &[-0.1, -0.0, 0.0, 7.0]), [-1.0, 0.0, 0.0, 1.0]);
        assert!(all(sign, &[f64::NAN])[0].is_nan());
        let rounded = round(&Tensor::new(&[1], vec![2.4]).rounded()).data[0];
        assert_eq!((rounded.value, rounded.terms), (2.0, 0.0));
    }

    #[test]
    fn a_remainder_has_the_sign_of_the_divisor_or_of_the_dividend() {
        let a = Tensor::new(&[6], vec![-4.25, 7.0, 5.0, 4.25, -7.0, 8.0]);
        let b = Tensor::new(&[6], vec![2.0, -3.0, 8.0, -2.0, 3.0, 5.0]);
        assert_eq!(modulo(&a, &b, false).data, [1.75, -2.0, 5.0, -1.75, 2.0, 3.0], "Python");
        assert_eq!(modulo(&a, &b, true).data, [-0.25, 1.0, 5.0, 0.25, -1.0, 3.0], "C");
        let rounded = modulo(&a.rounded(), &b.rounded(), false);
        assert_eq!(rounded.terms().data, [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
        assert!(modulo(&a, &Tensor::new(&[], vec![0.0]), true).data[0].is_nan(), "nothing divides by 0");
    }

    #[test]
    fn an_infinite_divisor_leaves_the_dividend() {
        let one = |a: f64, b: f64, truncated| {
            modulo(&Tensor::new(&[], vec![a]), &Tensor::new(&[], vec![b]), truncated).data[0]
        };
        assert_eq!((one(3.0, f64::INFINITY, true), one(3.0, f64::INFINITY, false)), (3.0, 3.0));
        assert_eq!(one(-3.0, f64::INFINITY, false), f64::INFINITY, "of the other sign: the divisor");
        assert!(one(4.0, -2.0, false).is_sign_negative(), "zero has the divisor's sign");
    }
}

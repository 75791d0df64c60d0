//! Smooth activations, element by element, in forms that neither overflow nor cancel.
//!
//! | operator | f(x) |
//! |---|---|
//! | [`sigmoid`], [`tanh`], [`softplus`] | 1/(1 + e⁻ˣ), tanh x, ln(1 + eˣ) |
//! | [`hard_sigmoid`] | max(0, min(1, αx + β)) |
//! | [`softsign`] | x/(1 + \|x\|) |
//! | [`swish`] (SiLU) | x·sigmoid(αx) |
//! | [`hard_swish`] | x·max(0, min(1, x/6 + ½)) |
//! | [`mish`] | x·tanh(softplus x) |
//! | [`gelu`] | x·Φ(x) = ½x(1 + erf(x/√2)) |
//! | [`gelu_tanh`] | ½x(1 + tanh(√(2/π)(x + 0.044715x³))) |
//!
//! Rounding: that of the formula, with [`Elementary`]'s share of each function. The sum 1 + erf cancels in the left tail:
//! there m = ½|x|(1 + |erf|), far above |y|.

use super::transcendental::Elementary;
use super::{Scalar, Tensor};

/// 1/(1 + e⁻ˣ).
pub fn sigmoid<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::sigmoid)
}

/// The hyperbolic tangent.
pub fn tanh<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::tanh)
}

/// ln(1 + eˣ).
pub fn softplus<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(Elementary::softplus)
}

/// max(0, min(1, αx + β)).
///
/// # Conventions
/// ONNX's defaults are α = 0.2, β = ½; PyTorch's `hardsigmoid` is α = 1/6, β = ½.
///
/// # References
/// ONNX operator HardSigmoid (version 22).
pub fn hard_sigmoid<T: Scalar>(x: &Tensor<T>, alpha: T, beta: T) -> Tensor<T> {
    x.map(|x| between_zero_and_one((alpha * x).plus(beta)))
}

fn between_zero_and_one<T: Scalar>(x: T) -> T {
    -T::maximum(-x.maximum(T::ZERO), T::exact(-1.0))
}

/// x·max(0, min(1, x/6 + ½)).
///
/// # References
/// ONNX operator HardSwish (version 22); Howard and others, Searching for MobileNetV3, ICCV 2019.
pub fn hard_swish<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    // The product with a rounded 1/6, or the quotient by 6: two roundings at most.
    x.map(|x| x * between_zero_and_one((x * irrational(1.0 / 6.0)).plus(T::exact(0.5))))
}

/// x/(1 + |x|).
///
/// Rounding: the sum, and the quotient or the product with a rounded reciprocal, as ONNX Runtime has it.
pub fn softsign<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x * (T::exact(1.0) / (T::exact(1.0) + x.maximum(-x))))
}

/// x·sigmoid(αx): SiLU for α = 1.
///
/// # References
/// ONNX operator Swish (version 24).
pub fn swish<T: Scalar>(x: &Tensor<T>, alpha: T) -> Tensor<T> {
    x.map(|x| x * Elementary::sigmoid(if alpha == T::exact(1.0) { x } else { alpha * x }))
}

/// x·tanh(ln(1 + eˣ)).
///
/// # References
/// ONNX operator Mish (version 22); Misra, Mish, BMVC 2020.
pub fn mish<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x * Elementary::tanh(Elementary::softplus(x)))
}

/// ½x(1 + erf(x/√2)), x times the standard normal distribution function.
///
/// # References
/// ONNX operator Gelu (version 20, approximate "none"); Hendrycks and Gimpel, Gaussian Error Linear Units, 2016.
pub fn gelu<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| {
        let erf = Elementary::erf(x * irrational(std::f64::consts::FRAC_1_SQRT_2));
        T::exact(0.5) * x * T::exact(1.0).plus(erf)
    })
}

/// ½x(1 + tanh(√(2/π)(x + 0.044715x³))), which is within 5·10⁻⁴ of [`gelu`].
///
/// # References
/// ONNX operator Gelu (version 20, approximate "tanh").
pub fn gelu_tanh<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| {
        let cubic = x.plus(irrational::<T>(0.044715) * (x * x * x));
        let tanh = Elementary::tanh(irrational::<T>((2.0 / std::f64::consts::PI).sqrt()) * cubic);
        T::exact(0.5) * x * T::exact(1.0).plus(tanh)
    })
}

/// A constant of a formula that no binary precision holds: it comes with a rounding.
fn irrational<T: Scalar>(value: f64) -> T {
    T::within(value, value.abs(), 1.0)
}

#[cfg(test)]
mod tests {
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    fn one(f: impl Fn(&Tensor) -> Tensor, x: f64) -> f64 {
        f(&Tensor::new(&[1], vec![x])).data[0]
    }

    #[test]
    fn tanh_is_a_scaled_sigmoid_and_softplus_its_integral() {
        for x in [-2.0, 0.3, 7.0] {
            assert!((one(tanh, x) - (2.0 * one(sigmoid, 2.0 * x) - 1.0)).abs() < 1e-15, "at {x}");
            let slope = (one(softplus, x + 1e-5) - one(softplus, x - 1e-5)) / 2e-5;
            assert!((slope - one(sigmoid, x)).abs() < 1e-9, "at {x}");
        }
    }

    #[test]
    fn gates_pass_large_numbers_and_stop_small_ones() {
        let gates: [(&str, fn(&Tensor) -> Tensor); 5] = [
            ("swish", |x| swish(x, 1.0)),
            ("hard_swish", hard_swish),
            ("mish", mish),
            ("gelu", gelu),
            ("gelu_tanh", gelu_tanh),
        ];
        for (name, gate) in gates {
            assert_eq!(one(gate, 0.0), 0.0, "{name}");
            assert!((one(gate, 50.0) - 50.0).abs() < 1e-12, "{name}");
            assert!(one(gate, -50.0).abs() < 1e-12, "{name}");
            assert!(one(gate, f64::NAN).is_nan(), "{name}");
        }
    }

    #[test]
    fn values_known_in_closed_form() {
        assert_eq!((one(softsign, -3.0), one(softsign, 1.0)), (-0.75, 0.5));
        let hard = |x| one(|x| hard_sigmoid(x, 0.5, 0.6), x);
        assert_eq!((hard(-2.0), hard(0.0), hard(2.0)), (0.0, 0.6, 1.0));
        assert_eq!(
            (one(hard_swish, -3.0), one(hard_swish, 3.0), one(hard_swish, 1.0)),
            (0.0, 3.0, 2.0 / 3.0)
        );
        // x = ln(√(1+e)−…): tanh(softplus 0) = tanh(ln 2) = 3/5.
        let near_zero = 1e-8;
        assert!((one(mish, near_zero) / near_zero - 0.6).abs() < 1e-7, "the slope of mish at 0");
        assert!((one(gelu, 1.0) - 0.841_344_746_068_543).abs() < 1e-14, "Φ(1)");
        for k in -60..60 {
            let x = f64::from(k) / 10.0;
            assert!((one(gelu, x) - one(gelu_tanh, x)).abs() < 5e-4, "the approximation at {x}");
        }
    }

    #[test]
    fn gelu_in_f32_stays_within_the_bound_in_its_tail() {
        // 1 + erf cancels all but a few bits beyond −3.
        for k in 0..600 {
            let x = -0.01_f32 * k as f32;
            let y = gelu(&Tensor::new(&[1], vec![f64::from(x)]).rounded()).data[0];
            let erf = super::super::transcendental::Elementary::erf(f64::from(x * 0.707_106_77_f32)) as f32;
            let error = (f64::from(0.5 * x * (1.0 + erf)) - y.value).abs();
            assert!(error <= y.bound(UNIT_ROUNDOFF_F32), "at {x}: {error:e}");
        }
    }

    #[test]
    fn bounds_of_f32_formulas_hold() {
        let x = Tensor::from_fn(&[401], |i| (i[0] as f64 - 200.0) / 8.0);
        let activations: [(fn(&Tensor<Rounded>) -> Tensor<Rounded>, fn(f32) -> f32); 4] = [
            (sigmoid, |x| 1.0 / (1.0 + (-x).exp())),
            (tanh, f32::tanh),
            (softsign, |x| x / (1.0 + x.abs())),
            (|x| swish(x, Rounded::exact(1.0)), |x| x / (1.0 + (-x).exp())),
        ];
        for (k, (bounded, f32)) in activations.iter().enumerate() {
            for (x, y) in x.data.iter().zip(bounded(&x.rounded()).data) {
                let error = (f64::from(f32(*x as f32)) - y.value).abs();
                assert!(error <= y.bound(UNIT_ROUNDOFF_F32), "activation {k} at {x}: {error:e}");
            }
        }
    }
}

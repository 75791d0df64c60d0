//! Activations, element by element, in forms that neither overflow nor cancel.
//!
//! Rounding: ReLU only chooses. The transcendental ones are allowed a few units in the last place (one such unit is at most
//! two roundings), more than the vectorised kernels of ONNX Runtime 1.32 use over −40…40: 4.3u absolute for tanh, 4.3u of
//! max(σ, ½) for sigmoid, 3.8u of the value for softplus. Sigmoid and tanh, which kernels compute as clamped rational functions, may
//! spend them on their range instead of the value: far out in a tail such a kernel keeps few digits of a very small number.

use super::{Scalar, Tensor};

/// Roundings in n units in the last place: 1 ulp ≤ 2u·|y|.
pub(super) const fn ulps(n: u32) -> f64 {
    2.0 * n as f64
}

/// max(x, 0).
pub fn relu<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.maximum(T::ZERO))
}

/// x where x ≥ 0, slope·x elsewhere.
///
/// # Panics
/// If the slope is not in [0, 1].
pub fn leaky_relu<T: Scalar>(x: &Tensor<T>, slope: f64) -> Tensor<T> {
    assert!((0.0..=1.0).contains(&slope), "leaky_relu: the slope {slope} must lie in [0, 1]");
    x.map(|x| {
        let leaked = x * T::exact(slope);
        match x.terms() == 0.0 {
            true if x.value() < 0.0 => leaked,
            true => x,
            // An inexact number near zero may stand on either side; for a slope in [0, 1] the larger one is the function.
            false => x.maximum(leaked),
        }
    })
}

/// 1/(1 + e⁻ˣ), evaluated with e^{−|x|} so that nothing overflows.
pub fn sigmoid<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| {
        let y = sigmoid_value(x.value());
        // Four units in the last place, or 4u absolute: the magnitude is at least ½.
        let magnitude = y.abs().max(0.5).max(y * (1.0 - y) * x.magnitude());
        T::within(y, magnitude, x.terms() + ulps(4))
    })
}

/// The logistic function of one number.
pub(crate) fn sigmoid_value(x: f64) -> f64 {
    let e = (-x.abs()).exp();
    if x >= 0.0 { 1.0 / (1.0 + e) } else { e / (1.0 + e) }
}

/// The hyperbolic tangent.
pub fn tanh<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| {
        let y = x.value().tanh();
        // Three units in the last place, or 6u absolute: the magnitude is at least 1.
        T::within(y, f64::max(1.0, (1.0 - y * y) * x.magnitude()), x.terms() + ulps(3))
    })
}

/// ln(1 + eˣ) = max(x, 0) + ln(1 + e^{−|x|}), which overflows nowhere.
pub fn softplus<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.function(softplus_value(x.value()), sigmoid_value(x.value()), ulps(3)))
}

/// ln(1 + eˣ) of one number.
pub(crate) fn softplus_value(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(f: impl Fn(&Tensor) -> Tensor, x: f64) -> f64 {
        f(&Tensor::new(&[1], vec![x])).data[0]
    }

    #[test]
    fn relu_and_leaky_relu_keep_the_positive_half() {
        assert_eq!((one(relu, 2.0), one(relu, -2.0)), (2.0, 0.0));
        assert_eq!((one(|x| leaky_relu(x, 0.01), 2.0), one(|x| leaky_relu(x, 0.01), -2.0)), (2.0, -0.02));
        assert!(one(relu, f64::NAN).is_nan());
        let terms = |x| leaky_relu(&Tensor::new(&[1], vec![x]).rounded(), 0.01).data[0].terms;
        assert_eq!((terms(2.0), terms(-2.0)), (0.0, 1.0), "only the negative half is multiplied");
    }

    #[test]
    fn sigmoid_of_minus_x_is_its_complement_and_tails_stay_finite() {
        for x in [0.0, 0.1, 1.0, 5.0, 30.0] {
            assert!((one(sigmoid, x) + one(sigmoid, -x) - 1.0).abs() < 1e-15, "at {x}");
        }
        assert_eq!((one(sigmoid, 0.0), one(sigmoid, 800.0), one(sigmoid, -800.0)), (0.5, 1.0, 0.0));
        assert!((one(sigmoid, -30.0) / (-30f64).exp() - 1.0).abs() < 1e-12, "a tail is exponential");
    }

    #[test]
    fn softplus_has_the_slope_of_sigmoid_and_overflows_nowhere() {
        assert_eq!(
            (one(softplus, 0.0), one(softplus, 1000.0), one(softplus, -1000.0)),
            (2f64.ln(), 1000.0, 0.0)
        );
        for x in [-3.0, 0.5, 4.0] {
            let slope = (one(softplus, x + 1e-5) - one(softplus, x - 1e-5)) / 2e-5;
            assert!((slope - one(sigmoid, x)).abs() < 1e-9, "at {x}");
        }
    }

    #[test]
    fn tanh_is_a_scaled_sigmoid() {
        for x in [-2.0, 0.3, 7.0] {
            assert!((one(tanh, x) - (2.0 * one(sigmoid, 2.0 * x) - 1.0)).abs() < 1e-15, "at {x}");
        }
    }

    #[test]
    fn bounds_of_the_f32_functions_of_the_standard_library_hold() {
        let x = Tensor::from_fn(&[401], |i| (i[0] as f64 - 200.0) / 8.0);
        let bounds = |y: Tensor<super::super::Rounded>| y.bounds(super::super::UNIT_ROUNDOFF_F32).data;
        for (k, bound) in bounds(sigmoid(&x.rounded())).iter().enumerate() {
            let f32 = 1.0 / (1.0 + (-x.data[k] as f32).exp());
            assert!((f64::from(f32) - sigmoid_value(x.data[k])).abs() <= *bound, "sigmoid({})", x.data[k]);
        }
        for (k, bound) in bounds(tanh(&x.rounded())).iter().enumerate() {
            let f32 = (x.data[k] as f32).tanh();
            assert!((f64::from(f32) - x.data[k].tanh()).abs() <= *bound, "tanh({})", x.data[k]);
        }
    }
}

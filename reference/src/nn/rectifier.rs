//! Rectifiers: activations that treat negative numbers in one way and positive ones in another.
//!
//! | operator | x < 0 | x > 0 |
//! |---|---|---|
//! | [`relu`] | 0 | x |
//! | [`leaky_relu`], [`prelu`] | s·x | x |
//! | [`elu`] | α(eˣ − 1) | x |
//! | [`selu`] | γα(eˣ − 1) | γx |
//! | [`celu`] | α(e^{x/α} − 1) | x |
//! | [`thresholded_relu`] | 0 up to α > 0 | x beyond α |
//! | [`shrink`] | x + b below −λ, 0 between −λ and λ | x − b beyond λ |
//!
//! Rounding: an exact x stands on one side and costs what is computed there. eˣ − 1 is a difference whose terms are
//! rounded, m = eˣ + 1, not |eˣ − 1|: near zero a kernel may subtract, as ONNX Runtime does, or be better.

use super::elementwise::broadcast;
use super::transcendental::Elementary;
use super::{Scalar, Tensor};

/// f(x) = negative(x) below zero and positive(x) elsewhere (so at NaN), for functions that meet at f(0) = 0.
///
/// An inexact x may stand on either side: f(x) = positive(max(x, 0)) + negative(min(x, 0)) there, errors and all.
fn rectified<T: Scalar>(x: T, negative: impl Fn(T) -> T, positive: impl Fn(T) -> T) -> T {
    if x.terms() == 0.0 {
        return if x.value() < 0.0 { negative(x) } else { positive(x) };
    }
    positive(x.maximum(T::ZERO)).plus(negative(-(-x).maximum(T::ZERO)))
}

/// max(x, 0).
pub fn relu<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    x.map(|x| x.maximum(T::ZERO))
}

/// x where x ≥ 0, slope·x elsewhere.
///
/// # References
/// ONNX operator LeakyRelu (version 16).
pub fn leaky_relu<T: Scalar>(x: &Tensor<T>, slope: T) -> Tensor<T> {
    x.map(|x| rectified(x, |x| x * slope, |x| x))
}

/// x where x ≥ 0, s·x elsewhere, with a slope s for each element, channel or tensor: s broadcasts to x, never x to s.
///
/// # Conventions
/// A slope per channel of x [N,C,…] has shape [C,1,…]; PyTorch's `weight` of shape \[C\] lacks the trailing axes.
///
/// # Panics
/// If the slopes do not broadcast to the shape of x.
///
/// # References
/// ONNX operator PRelu (version 16); He and others, Delving Deep into Rectifiers, ICCV 2015.
pub fn prelu<T: Scalar>(x: &Tensor<T>, slope: &Tensor<T>) -> Tensor<T> {
    let y = broadcast("prelu", x, slope, |x, slope| rectified(x, |x| x * slope, |x| x));
    assert!(y.shape == x.shape, "prelu: slopes {:?} do not broadcast to x {:?}", slope.shape, x.shape);
    y
}

/// x where x ≥ 0, α(eˣ − 1) elsewhere.
///
/// # References
/// ONNX operator Elu (version 22).
pub fn elu<T: Scalar>(x: &Tensor<T>, alpha: T) -> Tensor<T> {
    x.map(|x| rectified(x, |x| alpha * exponential_minus_one(x), |x| x))
}

/// γx where x ≥ 0, γα(eˣ − 1) elsewhere.
///
/// # Conventions
/// ONNX's defaults α = 1.67326319… and γ = 1.05070102… are the f32 nearest to the constants that keep mean 0 and variance 1.
///
/// # References
/// ONNX operator Selu (version 22); Klambauer and others, Self-Normalizing Neural Networks, NeurIPS 2017.
pub fn selu<T: Scalar>(x: &Tensor<T>, alpha: T, gamma: T) -> Tensor<T> {
    x.map(|x| rectified(x, |x| gamma * (alpha * exponential_minus_one(x)), |x| gamma * x))
}

/// x where x ≥ 0, α(e^{x/α} − 1) elsewhere: [`elu`] made smooth at zero for every α.
///
/// # References
/// ONNX operator Celu (version 12).
pub fn celu<T: Scalar>(x: &Tensor<T>, alpha: T) -> Tensor<T> {
    x.map(|x| rectified(x, |x| alpha * exponential_minus_one(x / alpha), |x| x))
}

/// eˣ − 1 as a difference, in which the rounding of eˣ stays.
fn exponential_minus_one<T: Scalar>(x: T) -> T {
    let difference = Elementary::exp(x).plus(T::exact(-1.0));
    T::within(x.value().exp_m1(), difference.magnitude(), difference.terms())
}

/// x where x > α, 0 elsewhere: a step of height α.
///
/// # References
/// ONNX operator ThresholdedRelu (version 22).
pub fn thresholded_relu<T: Scalar>(x: &Tensor<T>, alpha: T) -> Tensor<T> {
    x.map(|x| if x.value() > alpha.value() { x } else { T::ZERO })
}

/// x − b beyond λ, x + b below −λ, 0 between: soft shrinkage for b = λ, hard for b = 0.
///
/// # References
/// ONNX operator Shrink (version 9).
pub fn shrink<T: Scalar>(x: &Tensor<T>, lambda: T, bias: T) -> Tensor<T> {
    x.map(|x| match x.value() {
        v if v < -lambda.value() => x + bias,
        v if v > lambda.value() => x - bias,
        _ => T::ZERO,
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    fn one(f: impl Fn(&Tensor) -> Tensor, x: f64) -> f64 {
        f(&Tensor::new(&[1], vec![x])).data[0]
    }

    #[test]
    fn the_positive_half_is_kept() {
        assert_eq!((one(relu, 2.0), one(relu, -2.0)), (2.0, 0.0));
        assert_eq!((one(|x| leaky_relu(x, 0.01), 2.0), one(|x| leaky_relu(x, 0.01), -2.0)), (2.0, -0.02));
        assert_eq!(one(|x| leaky_relu(x, -3.0), -2.0), 6.0, "a slope may be any number");
        assert_eq!((one(|x| elu(x, 2.0), 2.0), one(|x| elu(x, 2.0), -800.0)), (2.0, -2.0));
        assert_eq!((one(|x| celu(x, 2.0), 2.0), one(|x| celu(x, 2.0), -2.0)), (2.0, 2.0 * (-1f64).exp_m1()));
        assert_eq!(one(|x| selu(x, 2.0, 3.0), 2.0), 6.0);
        assert_eq!(one(|x| selu(x, 2.0, 3.0), -1.0), 6.0 * (-1f64).exp_m1());
        for f in [relu, |x: &Tensor| leaky_relu(x, 0.1), |x: &Tensor| elu(x, 1.0)] {
            assert!(one(f, f64::NAN).is_nan());
        }
        let terms = |x| leaky_relu(&Tensor::new(&[1], vec![x]).rounded(), Rounded::exact(0.01)).data[0].terms;
        assert_eq!((terms(2.0), terms(-2.0)), (0.0, 1.0), "only the negative half is multiplied");
    }

    #[test]
    fn what_lies_between_the_thresholds_vanishes() {
        let x = Tensor::new(&[5], vec![-2.0, -1.0, 0.5, 1.0, 2.0]);
        assert_eq!(thresholded_relu(&x, 1.0).data, [0.0, 0.0, 0.0, 0.0, 2.0], "1 is not beyond 1");
        assert_eq!(shrink(&x, 1.0, 0.0).data, [-2.0, 0.0, 0.0, 0.0, 2.0], "hard");
        assert_eq!(shrink(&x, 1.0, 1.0).data, [-1.0, 0.0, 0.0, 0.0, 1.0], "soft");
    }

    #[test]
    fn slopes_repeat_over_pixels() {
        let x = Tensor::new(&[1, 2, 2], vec![-1.0, 2.0, -3.0, 4.0]);
        let y = prelu(&x, &Tensor::new(&[2, 1], vec![0.5, 0.1]));
        assert_eq!(y.data, [-0.5, 2.0, -3.0 * 0.1, 4.0]);
    }

    #[test]
    #[should_panic(expected = "slopes [2, 3] do not broadcast to x [3]")]
    fn x_does_not_broadcast_to_the_slopes() {
        prelu(&Tensor::<f64>::zeros(&[3]), &Tensor::zeros(&[2, 3]));
    }

    #[test]
    fn subtracting_in_f32_stays_within_the_bound_near_zero() {
        for k in 1..200 {
            let x = -1e-4_f32 * k as f32;
            let y = elu(&Tensor::new(&[1], vec![f64::from(x)]).rounded(), Rounded::exact(1.0)).data[0];
            let error = |found: f32| (f64::from(found) - y.value).abs();
            assert!(error(x.exp() - 1.0) <= y.bound(UNIT_ROUNDOFF_F32), "subtracted at {x}");
            assert!(error(x.exp_m1()) <= y.bound(UNIT_ROUNDOFF_F32), "at {x}");
        }
    }

    #[test]
    fn an_inexact_number_near_zero_may_stand_on_either_side() {
        let nearly = Rounded { value: -1e-9, magnitude: 1.0, terms: 1.0 };
        let y = leaky_relu(&Tensor::new(&[1], vec![nearly]), Rounded::exact(0.01)).data[0];
        assert_eq!(y.value, -1e-9 * 0.01);
        assert!(y.magnitude >= 1.0 && y.terms >= 1.0, "{y:?}: the positive side keeps the whole error");
    }
}

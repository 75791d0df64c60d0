//! Softmax, its logarithm and its limit, over one axis.
//!
//! softmax(x)ᵢ = e^{xᵢ}/Σⱼ e^{xⱼ} = e^{xᵢ − M}/Σⱼ e^{xⱼ − M}, M = max x, which does not overflow.
//!
//! # Conventions
//! From version 13 of ONNX's operators the sum runs over `axis` alone (default −1). Before, the tensor was flattened to two
//! axes at `axis` (default 1) and the sum ran over all axes from there on: reshape for that meaning.
//!
//! Rounding: the differences, exponentials, their sum in any order and a quotient. The rounding of xᵢ − M is u·|xᵢ − M|, which the exponential
//! passes on as a relative error. An infinite x makes NaN, as the formula does: [`attention`](mod@crate::nn::attention) treats rows that are masked
//! entirely by itself.

use super::movement::transpose;
use super::transcendental::Elementary;
use super::{Scalar, Tensor};

/// Changes each line along an axis.
///
/// # Panics
/// If the axis is not one of x.
pub(super) fn map_lines<T: Copy, U: Copy>(
    operator: &str,
    x: &Tensor<T>,
    axis: usize,
    f: impl Fn(&[T]) -> Vec<U>,
) -> Tensor<U> {
    assert!(axis < x.rank(), "{operator}: axis {axis} does not lie in shape {:?}", x.shape);
    let mut to_last: Vec<usize> = (0..x.rank()).filter(|&a| a != axis).collect();
    to_last.push(axis);
    let turned = transpose(x, &to_last);
    let lines = turned.data.chunks_exact(x.shape[axis].max(1));
    let y = Tensor { data: lines.flat_map(f).collect(), shape: turned.shape };
    let back: Vec<usize> =
        (0..x.rank()).map(|a| to_last.iter().position(|&b| a == b).expect("an order of the axes")).collect();
    transpose(&y, &back)
}

/// e^{xᵢ − M} of a line, its sum, and M.
fn exponentials<T: Scalar>(x: &[T]) -> (Vec<T>, T, T) {
    let maximum = x.iter().copied().reduce(T::maximum).unwrap_or(T::ZERO);
    let powers: Vec<T> = x.iter().map(|&x| Elementary::exp(x - maximum)).collect();
    let sum = powers.iter().copied().fold(T::ZERO, T::plus);
    (powers, sum, maximum)
}

/// The softmax of one line.
pub(super) fn softmax_line<T: Scalar>(x: &[T]) -> Vec<T> {
    let (powers, sum, _) = exponentials(x);
    powers.into_iter().map(|power| power / sum).collect()
}

/// ln Σ eˣ = M + ln Σ e^{x − M}; −∞ for an empty sum and for one of nothing but e^{−∞}.
pub(super) fn log_sum_exp<T: Scalar>(x: &[T]) -> T {
    let maximum = x.iter().copied().reduce(T::maximum).unwrap_or(T::exact(f64::NEG_INFINITY));
    if maximum.value().is_infinite() {
        return maximum;
    }
    let (_, sum, _) = exponentials(x);
    maximum.plus(Elementary::ln(sum))
}

/// e^{xᵢ}/Σⱼ e^{xⱼ} over one axis.
///
/// # Panics
/// If the axis is not one of x.
///
/// # References
/// ONNX operator Softmax (version 13).
pub fn softmax<T: Scalar>(x: &Tensor<T>, axis: usize) -> Tensor<T> {
    map_lines("softmax", x, axis, softmax_line)
}

/// xᵢ − ln Σⱼ e^{xⱼ} over one axis.
///
/// Rounding: M and ln Σ e^{x − M} may be subtracted one after the other or together.
///
/// # Panics
/// If the axis is not one of x.
///
/// # References
/// ONNX operator LogSoftmax (version 13).
pub fn log_softmax<T: Scalar>(x: &Tensor<T>, axis: usize) -> Tensor<T> {
    map_lines("log_softmax", x, axis, |x| {
        let (_, sum, maximum) = exponentials(x);
        let logarithm = Elementary::ln(sum);
        x.iter().map(|x| x.plus(-maximum).plus(-logarithm)).collect()
    })
}

/// 1 at the first of the largest numbers over one axis, 0 elsewhere.
///
/// # Panics
/// If the axis is not one of x.
///
/// # References
/// ONNX operator Hardmax (version 13).
pub fn hardmax<T: Scalar>(x: &Tensor<T>, axis: usize) -> Tensor<T> {
    map_lines("hardmax", x, axis, |x| {
        let first = (0..x.len()).fold(0, |best, i| if x[i].value() > x[best].value() { i } else { best });
        (0..x.len()).map(|i| T::exact(f64::from(u8::from(i == first)))).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    #[test]
    fn shares_add_up_to_one_and_a_common_offset_changes_nothing() {
        let x = pattern(&[2, 3, 4], 1).map(|x| 5.0 * x);
        for axis in 0..3 {
            let y = softmax(&x, axis);
            let sums = super::super::reduce_sum(&y, &[axis], false);
            assert!(sums.data.iter().all(|s| (s - 1.0).abs() < 1e-15), "axis {axis}: {sums:?}");
            let shifted = softmax(&x.map(|x| x + 1000.0), axis);
            assert!(y.data.iter().zip(&shifted.data).all(|(a, b)| (a - b).abs() < 1e-13), "axis {axis}");
            let logarithms = log_softmax(&x, axis);
            assert!(logarithms.data.iter().zip(&y.data).all(|(l, y)| (l.exp() - y).abs() < 1e-15));
        }
    }

    #[test]
    fn a_line_by_hand() {
        let x = Tensor::new(&[3], vec![0.0, 2f64.ln(), 0.0]);
        let y = softmax(&x, 0);
        assert!(y.data.iter().zip([0.25, 0.5, 0.25]).all(|(y, e)| (y - e).abs() < 1e-15), "{y:?}");
        assert_eq!(
            hardmax(&Tensor::new(&[2, 3], vec![1.0, 3.0, 3.0, 2.0, 0.0, 1.0]), 1).data,
            [0.0, 1.0, 0.0, 1.0, 0.0, 0.0]
        );
        assert_eq!(log_sum_exp(&[1000.0, 1000.0]), 1000.0 + 2f64.ln());
        assert_eq!(log_sum_exp::<f64>(&[]), f64::NEG_INFINITY);
        assert_eq!(log_sum_exp(&[f64::INFINITY, 1.0]), f64::INFINITY);
    }

    #[test]
    fn f32_stays_within_the_bound_however_far_the_numbers_lie_apart() {
        for scale in [0.1, 5.0, 40.0] {
            let x: Vec<f32> = pattern(&[30], 2).data.iter().map(|&x| (scale * x) as f32).collect();
            let exact = Tensor::new(&[30], x.iter().map(|&x| f64::from(x)).collect()).rounded();
            let maximum = x.iter().copied().fold(f32::MIN, f32::max);
            let powers: Vec<f32> = x.iter().map(|x| (x - maximum).exp()).collect();
            let sum: f32 = powers.iter().sum();
            let check = |y: &Tensor<Rounded>, found: &dyn Fn(usize) -> f32| {
                for (k, y) in y.data.iter().enumerate() {
                    let error = (f64::from(found(k)) - y.value).abs();
                    assert!(error <= y.bound(UNIT_ROUNDOFF_F32), "scale {scale}: {error:e} for {y:?}");
                }
            };
            check(&softmax(&exact, 0), &|k| powers[k] / sum);
            check(&softmax(&exact, 0), &|k| powers[k] * (1.0 / sum));
            check(&log_softmax(&exact, 0), &|k| x[k] - maximum - sum.ln());
            check(&log_softmax(&exact, 0), &|k| x[k] - (maximum + sum.ln()));
        }
    }

    #[test]
    #[should_panic(expected = "softmax: axis 1 does not lie in shape [3]")]
    fn an_axis_must_exist() {
        softmax(&Tensor::<f64>::zeros(&[3]), 1);
    }
}

//! Normalisation to unit length, without a mean: RMS and Lp.

use super::reduction::{mean, reduce, total_of_squares};
use super::softmax::map_lines;
use super::{Scalar, Tensor, elementwise::broadcast};

/// s·x/√(E\[x²\] + ε) over the last axes, those from `axis` on; the scale broadcasts to x.
///
/// Rounding: as for [`layer_norm`](super::layer_norm) without the mean; nothing cancels.
///
/// # Panics
/// If the axis is not one of x, or the scale does not broadcast to x.
///
/// # References
/// Zhang and Sennrich, Root Mean Square Layer Normalization, NeurIPS 2019; ONNX operator RMSNormalization (version 23).
pub fn rms_norm<T: Scalar>(x: &Tensor<T>, axis: usize, scale: &Tensor<T>, epsilon: T) -> Tensor<T> {
    assert!(axis < x.rank(), "rms_norm: axis {axis} does not lie in shape {:?}", x.shape);
    let axes: Vec<usize> = (axis..x.rank()).collect();
    let squares = x.map(|x| x * x);
    let deviations = reduce(&squares, &axes, true, |squares| (mean(squares) + epsilon).sqrt());
    let y = broadcast("rms_norm", &broadcast("rms_norm", x, &deviations, T::div), scale, T::mul);
    assert!(y.shape == x.shape, "rms_norm: scale {:?} does not broadcast to x {:?}", scale.shape, x.shape);
    y
}

/// Which length a vector is divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// p = 1: Σ|x|.
    Absolute,
    /// p = 2: √Σx².
    Euclidean,
}

/// x divided by the length of its line along an axis; zero where that length is zero.
///
/// # Panics
/// If the axis is not one of x.
///
/// # References
/// ONNX operator LpNormalization (version 22). ONNX's own evaluator sums x without its absolute value for p = 1.
pub fn lp_norm<T: Scalar>(x: &Tensor<T>, axis: usize, length: Length) -> Tensor<T> {
    map_lines("lp_norm", x, axis, |x| {
        let length = match length {
            Length::Absolute => x.iter().fold(T::ZERO, |sum, &x| sum.plus(x.maximum(-x))),
            Length::Euclidean => total_of_squares(x).sqrt(),
        };
        x.iter().map(|&x| if length.value() == 0.0 { T::ZERO } else { x / length }).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_mean_square_becomes_one() {
        let x = Tensor::new(&[2, 2], vec![3.0, -4.0, 0.0, 0.0]);
        let y = rms_norm(&x, 1, &Tensor::new(&[2], vec![1.0, 2.0]), 0.5);
        let deviation = 13f64.sqrt();
        assert_eq!(y.data, [3.0 / deviation, -8.0 / deviation, 0.0, 0.0]);
        let rounded = rms_norm(&x.rounded(), 1, &Tensor::new(&[2], vec![1.0, 2.0]).rounded(), T0);
        assert!(rounded.data[0].terms >= 6.0 && rounded.data[0].magnitude < 1.01 * y.data[0]);
    }

    const T0: super::super::Rounded = super::super::Rounded { value: 0.5, magnitude: 0.5, terms: 0.0 };

    #[test]
    fn a_line_is_divided_by_its_length() {
        let x = Tensor::new(&[2, 2], vec![3.0, -4.0, 0.0, 0.0]);
        assert_eq!(lp_norm(&x, 1, Length::Euclidean).data, [0.6, -0.8, 0.0, 0.0]);
        assert_eq!(lp_norm(&x, 1, Length::Absolute).data, [3.0 / 7.0, -4.0 / 7.0, 0.0, 0.0]);
    }
}

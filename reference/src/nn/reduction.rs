//! Sums, means and lengths over whole axes.

use super::pooling::mean_of;
use super::{Scalar, Tensor};

/// Σ over the given axes, which keep length one (`keepdims`) or vanish.
///
/// Rounding: the additions of the sum, in any order.
///
/// # Panics
/// If an axis is not one of x.
///
/// # References
/// ONNX operator ReduceSum (version 13) with non-negative axes.
pub fn reduce_sum<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    let rank = x.rank();
    assert!(axes.iter().all(|&axis| axis < rank), "reduce: axes {axes:?} do not lie in shape {:?}", x.shape);
    let kept: Vec<usize> =
        (0..rank).map(|axis| if axes.contains(&axis) { 1 } else { x.shape[axis] }).collect();
    let mut y: Tensor<T> = Tensor::zeros(&kept);
    let mut index = vec![0; rank];
    for &value in &x.data {
        let place: Vec<usize> = (0..rank).map(|axis| index[axis] % kept[axis]).collect();
        let place = y.offset(&place);
        y.data[place] = y.data[place].plus(value);
        super::tensor::advance(&mut index, &x.shape);
    }
    if !keepdims {
        y.shape = (0..rank).filter(|axis| !axes.contains(axis)).map(|axis| x.shape[axis]).collect();
    }
    y
}

/// The mean over the given axes, which keep length one (`keepdims`) or vanish.
///
/// Rounding: the additions of the sum, and the division or the product with a rounded reciprocal.
///
/// # Panics
/// If an axis is not one of x.
///
/// # References
/// ONNX operator ReduceMean (version 18) with non-negative axes.
pub fn reduce_mean<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    let sum = reduce_sum(x, axes, keepdims);
    let count = (0..x.rank()).filter(|axis| axes.contains(axis)).map(|axis| x.shape[axis]).product();
    sum.map(|s| mean_of(s, count))
}

/// The Euclidean length √Σ x² over the given axes, which keep length one (`keepdims`) or vanish.
///
/// Rounding: the squares, the additions of their sum in any order, and the root.
///
/// # Panics
/// If an axis is not one of x.
///
/// # References
/// ONNX operator ReduceL2 (version 18) with non-negative axes.
pub fn reduce_l2<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce_sum(&x.map(|x| x * x), axes, keepdims).map(T::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_vanish_or_stay_with_length_one() {
        let x = Tensor::from_fn(&[2, 3, 2], |i| (100 * i[0] + 10 * i[1] + i[2]) as f64);
        assert_eq!(reduce_sum(&x, &[1], false), Tensor::new(&[2, 2], vec![30.0, 33.0, 330.0, 333.0]));
        let mean = reduce_mean(&x, &[0, 2], true);
        assert_eq!(mean, Tensor::new(&[1, 3, 1], vec![50.5, 60.5, 70.5]));
        assert_eq!(reduce_sum(&x, &[0, 1, 2], false).shape, [0usize; 0]);
    }

    #[test]
    fn a_length_is_the_root_of_the_sum_of_squares() {
        let x = Tensor::new(&[2, 2], vec![3.0, -4.0, 0.0, 0.0]);
        assert_eq!(reduce_l2(&x, &[1], true), Tensor::new(&[2, 1], vec![5.0, 0.0]));
        let y = reduce_l2(&x.rounded(), &[1], false);
        assert_eq!((y.data[0].magnitude, y.data[0].terms), (5.0, 3.0), "two squares, an addition, a root");
        assert_eq!(y.data[1].magnitude, 0.0, "the length of nothing is exact");
    }

    #[test]
    fn magnitude_is_the_sum_of_absolute_values() {
        let x = Tensor::new(&[4], vec![1.0, -1.0, 2.0, -2.0]).rounded();
        let y = reduce_mean(&x, &[0], false);
        assert_eq!((y.data[0].value, y.data[0].magnitude, y.data[0].terms), (0.0, 1.5, 5.0));
    }

    #[test]
    #[should_panic(expected = "axes [2] do not lie in shape [2, 3]")]
    fn an_axis_must_exist() {
        reduce_sum(&Tensor::<f64>::zeros(&[2, 3]), &[2], true);
    }
}

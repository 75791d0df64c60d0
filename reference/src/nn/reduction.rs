//! Sums, means, products, lengths and extrema over whole axes.
//!
//! | operator | of x₁ … x_N | of nothing |
//! |---|---|---|
//! | [`reduce_sum`] | Σ x | 0 |
//! | [`reduce_mean`] | Σ x/N | NaN |
//! | [`reduce_prod`] | Π x | 1 |
//! | [`reduce_max`], [`reduce_min`] | max x, min x; a NaN wins | −∞, ∞ |
//! | [`reduce_l1`], [`reduce_l2`] | Σ\|x\|, √Σx² | 0 |
//! | [`reduce_sum_square`] | Σ x² | 0 |
//! | [`reduce_log_sum`], [`reduce_log_sum_exp`] | ln Σ x, ln Σ eˣ | −∞ |
//!
//! All go through [`reduce`], which hands the elements that fall together to a function of a list; the axes reduced keep length
//! one (`keepdims`) or vanish.
//!
//! Rounding: the additions of a sum in any order, and what each element and the sum go through.
//!
//! # Conventions
//! An empty list of axes means all axes to ONNX, unless `noop_with_empty_axes` asks for none; here it means none.
//! With none, each element is a list of its own: |x|, x², √x² or ln x, not x (so version 18 on).
//!
//! # References
//! ONNX operators ReduceSum (version 13) and ReduceMean, ReduceProd, ReduceMax, ReduceMin, ReduceL1, ReduceL2, ReduceSumSquare,
//! ReduceLogSum and ReduceLogSumExp (version 18; Max and Min 20).

use super::movement::transpose;
use super::pooling::mean_of;
use super::softmax::log_sum_exp;
use super::transcendental::Elementary;
use super::{Ring, Scalar, Tensor};

/// f of the elements that differ in nothing but their place along the given axes.
///
/// # Panics
/// If an axis is not one of x, or given twice.
pub fn reduce<A: Copy, B>(x: &Tensor<A>, axes: &[usize], keepdims: bool, f: impl Fn(&[A]) -> B) -> Tensor<B> {
    let rank = x.rank();
    assert!(axes.iter().all(|&axis| axis < rank), "reduce: axes {axes:?} do not lie in shape {:?}", x.shape);
    let kept: Vec<usize> = (0..rank).filter(|axis| !axes.contains(axis)).collect();
    let order = [&kept, axes].concat();
    assert!(order.len() == rank, "reduce: axes {axes:?} name an axis of shape {:?} twice", x.shape);
    let count: usize = axes.iter().map(|&axis| x.shape[axis]).product();
    let shape: Vec<usize> = kept.iter().map(|&axis| x.shape[axis]).collect();

    let turned = transpose(x, &order);
    let data = match count {
        0 => (0..shape.iter().product()).map(|_| f(&[])).collect(),
        _ => turned.data.chunks_exact(count).map(f).collect(),
    };
    let ones = (0..rank).map(|axis| if axes.contains(&axis) { 1 } else { x.shape[axis] });
    Tensor { shape: if keepdims { ones.collect() } else { shape }, data }
}

/// Σ x over the given axes.
///
/// # Panics
/// As [`reduce`]; so do all the others.
pub fn reduce_sum<T: Ring>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, total)
}

fn total<T: Ring>(x: &[T]) -> T {
    x.iter().copied().fold(T::ZERO, T::plus)
}

/// Σ x/N over the given axes.
///
/// Rounding: the additions of the sum, and the division or the product with a rounded reciprocal.
pub fn reduce_mean<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, mean)
}

/// Σ x/N of a list.
pub(super) fn mean<T: Scalar>(x: &[T]) -> T {
    mean_of(total(x), x.len())
}

/// Π x over the given axes.
pub fn reduce_prod<T: Ring>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    // The first factor starts the product: multiplying it by one rounds nothing.
    reduce(x, axes, keepdims, |x| x.iter().copied().reduce(T::mul).unwrap_or(T::one()))
}

/// The largest x over the given axes; a NaN wins.
pub fn reduce_max<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, |x| x.iter().copied().reduce(T::maximum).unwrap_or(T::exact(f64::NEG_INFINITY)))
}

/// The smallest x over the given axes; a NaN wins.
pub fn reduce_min<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce_max(&x.map(|x| -x), axes, keepdims).map(|y| -y)
}

/// Σ|x| over the given axes.
pub fn reduce_l1<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, |x| x.iter().fold(T::ZERO, |sum, &x| sum.plus(x.maximum(-x))))
}

/// √Σx² over the given axes.
pub fn reduce_l2<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, |x| total_of_squares(x).sqrt())
}

/// Σx² over the given axes.
pub fn reduce_sum_square<T: Ring>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, total_of_squares)
}

/// Σx² of a list.
pub(super) fn total_of_squares<T: Ring>(x: &[T]) -> T {
    x.iter().fold(T::ZERO, |sum, &x| sum.plus_product(x, x))
}

/// ln Σ x over the given axes.
pub fn reduce_log_sum<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, |x| Elementary::ln(total(x)))
}

/// ln Σ eˣ over the given axes, without overflow.
pub fn reduce_log_sum_exp<T: Scalar>(x: &Tensor<T>, axes: &[usize], keepdims: bool) -> Tensor<T> {
    reduce(x, axes, keepdims, log_sum_exp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::num::Wrapping;

    #[test]
    fn axes_vanish_or_stay_with_length_one() {
        let x = Tensor::from_fn(&[2, 3, 2], |i| (100 * i[0] + 10 * i[1] + i[2]) as f64);
        assert_eq!(reduce_sum(&x, &[1], false), Tensor::new(&[2, 2], vec![30.0, 33.0, 330.0, 333.0]));
        let mean = reduce_mean(&x, &[0, 2], true);
        assert_eq!(mean, Tensor::new(&[1, 3, 1], vec![50.5, 60.5, 70.5]));
        assert_eq!(reduce_mean(&x, &[2, 0], true), mean, "in any order");
        assert_eq!(reduce_sum(&x, &[0, 1, 2], false).shape, [0usize; 0]);
        assert_eq!(reduce_sum(&x, &[], true), x, "over nothing");
    }

    #[test]
    fn a_length_is_the_root_of_the_sum_of_squares() {
        let x = Tensor::new(&[2, 2], vec![3.0, -4.0, 0.0, 0.0]);
        assert_eq!(reduce_l2(&x, &[1], true), Tensor::new(&[2, 1], vec![5.0, 0.0]));
        let y = reduce_l2(&x.rounded(), &[1], false);
        assert_eq!((y.data[0].magnitude, y.data[0].terms), (5.0, 3.0), "two squares, an addition, a root");
        assert_eq!(y.data[1].magnitude, 0.0, "the length of nothing is exact");
        assert_eq!(reduce_l1(&x, &[1], false).data, [7.0, 0.0]);
        assert_eq!(reduce_sum_square(&x, &[1], false).data, [25.0, 0.0]);
        assert_eq!(reduce_l2(&x, &[], false).data, [3.0, 4.0, 0.0, 0.0], "each a list of its own");
    }

    #[test]
    fn products_and_extrema() {
        let x = Tensor::new(&[2, 2], vec![3.0, -4.0, 5.0, 0.5]);
        assert_eq!(reduce_prod(&x, &[0], false).data, [15.0, -2.0]);
        assert_eq!(reduce_prod(&x.rounded(), &[0], false).terms().data, [1.0, 1.0]);
        assert_eq!(
            (reduce_max(&x, &[0, 1], false).data[0], reduce_min(&x, &[0, 1], false).data[0]),
            (5.0, -4.0)
        );
        let hole = Tensor::new(&[2], vec![f64::NAN, 1.0]);
        assert!(
            reduce_max(&hole, &[0], false).data[0].is_nan()
                && reduce_min(&hole, &[0], false).data[0].is_nan()
        );
    }

    #[test]
    fn logarithms_of_sums() {
        let x = Tensor::new(&[2], vec![800.0, 800.0]);
        assert_eq!(reduce_log_sum(&x, &[0], false).data[0], 1600f64.ln());
        assert_eq!(reduce_log_sum_exp(&x, &[0], false).data[0], 800.0 + 2f64.ln(), "e⁸⁰⁰ overflows");
    }

    #[test]
    fn every_reduction_of_nothing_is_its_neutral_element() {
        let none = Tensor::<f64>::zeros(&[2, 0]);
        type Reduction = fn(&Tensor, &[usize], bool) -> Tensor;
        let neutral: [(Reduction, f64); 9] = [
            (reduce_sum, 0.0),
            (reduce_prod, 1.0),
            (reduce_max, f64::NEG_INFINITY),
            (reduce_min, f64::INFINITY),
            (reduce_l1, 0.0),
            (reduce_l2, 0.0),
            (reduce_sum_square, 0.0),
            (reduce_log_sum, f64::NEG_INFINITY),
            (reduce_log_sum_exp, f64::NEG_INFINITY),
        ];
        for (k, (reduction, value)) in neutral.iter().enumerate() {
            assert_eq!(reduction(&none, &[1], true), Tensor::filled(&[2, 1], *value), "reduction {k}");
        }
        assert!(reduce_mean(&none, &[1], false).data.iter().all(|y| y.is_nan()));
    }

    #[test]
    fn integers_are_exact_and_wrap() {
        let x = Tensor::new(&[3], vec![Wrapping(i64::MAX), Wrapping(1), Wrapping(5)]);
        assert_eq!(reduce_sum(&x, &[0], false).data, [Wrapping(i64::MIN + 5)]);
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

    #[test]
    #[should_panic(expected = "axes [1, 1] name an axis of shape [2, 3] twice")]
    fn an_axis_is_reduced_once() {
        reduce_sum(&Tensor::<f64>::zeros(&[2, 3]), &[1, 1], true);
    }
}

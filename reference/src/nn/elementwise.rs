//! Arithmetic element by element, with NumPy's broadcasting: an axis of length one, or a missing leading axis, repeats.
//!
//! Rounding: one correctly rounded operation each; choosing the larger or smaller rounds nothing.

use super::{Ring, Scalar, Tensor};

/// a + b.
///
/// # Panics
/// If the shapes do not broadcast. So do [`sub`], [`mul`] and [`div`].
pub fn add<T: Ring>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    broadcast("add", a, b, |a, b| a + b)
}

/// a − b; see [`add`].
pub fn sub<T: Ring>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    broadcast("sub", a, b, |a, b| a - b)
}

/// a × b; see [`add`].
pub fn mul<T: Ring>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    broadcast("mul", a, b, |a, b| a * b)
}

/// a ÷ b; see [`add`].
pub fn div<T: Scalar>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    broadcast("div", a, b, |a, b| a / b)
}

/// max(a, b); a NaN wins. See [`add`].
pub fn maximum<T: Scalar>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    broadcast("maximum", a, b, T::maximum)
}

/// min(a, b) = −max(−a, −b); a NaN wins. See [`add`].
pub fn minimum<T: Scalar>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    broadcast("minimum", a, b, |a, b| -T::maximum(-a, -b))
}

/// x kept within low ≤ x ≤ high, either of which may be absent; high wins where they cross.
///
/// # References
/// ONNX operator Clip (version 13).
pub fn clip<T: Scalar>(x: &Tensor<T>, low: Option<T>, high: Option<T>) -> Tensor<T> {
    x.map(|x| {
        let raised = low.map_or(x, |low| x.maximum(low));
        high.map_or(raised, |high| -T::maximum(-raised, -high))
    })
}

/// The shape that two shapes broadcast to, if they do.
pub(super) fn broadcast_shape(a: &[usize], b: &[usize]) -> Option<Vec<usize>> {
    let rank = a.len().max(b.len());
    let length =
        |shape: &[usize], axis: usize| (axis + shape.len()).checked_sub(rank).map_or(1, |i| shape[i]);
    (0..rank)
        .map(|axis| match (length(a, axis), length(b, axis)) {
            (m, n) if m == n => Some(m),
            (1, n) => Some(n),
            (m, 1) => Some(m),
            _ => None,
        })
        .collect()
}

/// The place in a tensor of this shape of an element of the broadcast shape.
pub(super) fn broadcast_offset(shape: &[usize], index: &[usize]) -> usize {
    let index = &index[index.len() - shape.len()..];
    shape.iter().zip(index).fold(0, |offset, (&n, &i)| offset * n + if n == 1 { 0 } else { i })
}

/// f(a, b) element by element, with broadcasting.
///
/// # Panics
/// If the shapes do not broadcast.
pub fn broadcast<A: Copy, B: Copy, C>(
    operator: &str,
    a: &Tensor<A>,
    b: &Tensor<B>,
    f: impl Fn(A, B) -> C,
) -> Tensor<C> {
    if a.shape == b.shape {
        let data = a.data.iter().zip(&b.data).map(|(&a, &b)| f(a, b)).collect();
        return Tensor { shape: a.shape.clone(), data };
    }
    let shape = broadcast_shape(&a.shape, &b.shape)
        .unwrap_or_else(|| panic!("{operator}: shapes {:?} and {:?} do not broadcast", a.shape, b.shape));
    // Line by line along the last axis, in which an operand either walks or stands still.
    let columns = shape.last().copied().unwrap_or(1);
    let walks = |own: &[usize]| usize::from(own.last().is_some_and(|&n| n > 1));
    let (step_a, step_b) = (walks(&a.shape), walks(&b.shape));
    let count: usize = shape.iter().product();
    let mut data = Vec::with_capacity(count);
    let mut index = vec![0; shape.len()];
    while data.len() < count {
        let (i, j) = (broadcast_offset(&a.shape, &index), broadcast_offset(&b.shape, &index));
        data.extend((0..columns).map(|k| f(a.data[i + k * step_a], b.data[j + k * step_b])));
        let outer = shape.len().saturating_sub(1);
        super::tensor::advance(&mut index[..outer], &shape[..outer]);
    }
    Tensor { shape, data }
}

/// Σ of tensors, with broadcasting, in any order.
///
/// # Panics
/// If there is none, or their shapes do not broadcast.
///
/// # References
/// ONNX operator Sum (version 13).
pub fn sum<T: Ring>(tensors: &[&Tensor<T>]) -> Tensor<T> {
    let (first, rest) = tensors.split_first().expect("sum: at least one tensor");
    rest.iter().fold((*first).clone(), |sum, x| broadcast("sum", &sum, x, T::plus))
}

/// The mean of tensors, with broadcasting.
///
/// # Panics
/// As [`sum`].
///
/// # References
/// ONNX operator Mean (version 13).
pub fn mean<T: Scalar>(tensors: &[&Tensor<T>]) -> Tensor<T> {
    sum(tensors).map(|sum| super::pooling::mean_of(sum, tensors.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_length_one_and_missing_axes_repeat() {
        let a = Tensor::new(&[2, 1, 2], vec![1.0, 2.0, 3.0, 4.0]);
        let b = Tensor::new(&[2, 1], vec![10.0, 20.0]);
        assert_eq!(
            add(&a, &b),
            Tensor::new(&[2, 2, 2], vec![11.0, 12.0, 21.0, 22.0, 13.0, 14.0, 23.0, 24.0])
        );
        assert_eq!(mul(&a, &Tensor::new(&[], vec![2.0])).data, [2.0, 4.0, 6.0, 8.0]);
        assert_eq!(sub(&b, &b).data, [0.0, 0.0]);
        assert_eq!(div(&a, &a).data, [1.0; 4]);
    }

    #[test]
    fn the_larger_the_smaller_and_the_bounded() {
        let (a, b) = (Tensor::new(&[3], vec![-1.0, 2.0, f64::NAN]), Tensor::new(&[1], vec![0.5]));
        assert_eq!(
            (&maximum(&a, &b).data[..2], &minimum(&a, &b).data[..2]),
            (&[0.5, 2.0][..], &[-1.0, 0.5][..])
        );
        assert!(maximum(&a, &b).data[2].is_nan() && minimum(&b, &a).data[2].is_nan());
        assert_eq!(clip(&a, Some(0.0), Some(1.0)).data[..2], [0.0, 1.0]);
        assert_eq!(clip(&a, None, Some(-3.0)).data[..2], [-3.0, -3.0]);
        assert_eq!(clip(&a, Some(3.0), Some(1.0)).data[..2], [1.0, 1.0], "high wins");
        assert!(clip(&a, Some(0.0), Some(1.0)).data[2].is_nan());
        assert_eq!(
            clip(&a.rounded(), Some(super::super::Rounded::exact(0.0)), None).terms().data[..2],
            [0.0; 2]
        );
    }

    #[test]
    fn each_operation_is_correctly_rounded() {
        let a = Tensor::new(&[1], vec![3.0]).rounded();
        let b = Tensor::new(&[1], vec![-2.5]).rounded();
        for (y, value) in [(add(&a, &b), 0.5), (sub(&a, &b), 5.5), (mul(&a, &b), -7.5), (div(&a, &b), -1.2)] {
            assert_eq!(
                (y.data[0].value, y.data[0].magnitude, y.data[0].terms),
                (value, f64::abs(value), 1.0)
            );
        }
    }

    #[test]
    fn sums_and_means_of_several_tensors_broadcast() {
        let (a, b) = (Tensor::new(&[2, 1], vec![1.0, 2.0]), Tensor::new(&[3], vec![10.0, 20.0, 30.0]));
        let y = sum(&[&a, &b, &a]);
        assert_eq!(y, Tensor::new(&[2, 3], vec![12.0, 22.0, 32.0, 14.0, 24.0, 34.0]));
        assert_eq!(mean(&[&a, &a]), a);
        assert_eq!(sum(&[&a]), a);
        let empty = broadcast("add", &Tensor::<f64>::zeros(&[0, 3]), &b, |a, b| a + b);
        assert_eq!((empty.shape, empty.data.len()), (vec![0, 3], 0));
    }

    #[test]
    #[should_panic(expected = "add: shapes [2, 3] and [2] do not broadcast")]
    fn shapes_must_broadcast() {
        add(&Tensor::<f64>::zeros(&[2, 3]), &Tensor::zeros(&[2]));
    }
}

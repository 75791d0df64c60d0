//! Operators that move elements and compute nothing, so that any implementation must agree bit by bit.

use super::Tensor;

/// The tensors one after the other along an axis.
///
/// # Panics
/// If there is none, or their shapes differ in another axis.
pub fn concat<T: Copy>(tensors: &[&Tensor<T>], axis: usize) -> Tensor<T> {
    let first = tensors.first().expect("concat: at least one tensor is needed");
    assert!(axis < first.rank(), "concat: axis {axis} does not lie in shape {:?}", first.shape);
    let mut shape = first.shape.clone();
    shape[axis] = tensors.iter().map(|t| t.shape.get(axis).copied().unwrap_or(0)).sum();
    for t in tensors {
        let fits = t.rank() == shape.len() && (0..shape.len()).all(|a| a == axis || t.shape[a] == shape[a]);
        assert!(fits, "concat: shapes {:?} and {:?} differ beside axis {axis}", first.shape, t.shape);
    }
    let outer: usize = shape[..axis].iter().product();
    let mut data = Vec::with_capacity(shape.iter().product());
    for i in 0..outer {
        for t in tensors {
            let run = t.data.len() / outer;
            data.extend_from_slice(&t.data[i * run..(i + 1) * run]);
        }
    }
    Tensor { shape, data }
}

/// The tensor with its axes in another order: y's axis a is x's axis order\[a\].
///
/// # Panics
/// If `order` is not a permutation of the axes.
pub fn transpose<T: Copy>(x: &Tensor<T>, order: &[usize]) -> Tensor<T> {
    let mut sorted = order.to_vec();
    sorted.sort_unstable();
    let axes: Vec<usize> = (0..x.rank()).collect();
    assert!(sorted == axes, "transpose: {order:?} is not a permutation of the axes of shape {:?}", x.shape);
    let shape: Vec<usize> = order.iter().map(|&axis| x.shape[axis]).collect();
    let strides = x.strides();
    Tensor::from_fn(&shape, |index| {
        x.data[index.iter().zip(order).map(|(i, &axis)| i * strides[axis]).sum::<usize>()]
    })
}

/// The elements start, start + step, … before end along one axis.
///
/// # Panics
/// If the range does not lie in the axis, or the step is zero.
pub fn slice<T: Copy>(x: &Tensor<T>, axis: usize, start: usize, end: usize, step: usize) -> Tensor<T> {
    assert!(
        axis < x.rank() && start <= end && end <= x.shape[axis] && step > 0,
        "slice: {start}..{end} by {step} does not lie in axis {axis} of shape {:?}",
        x.shape
    );
    let mut shape = x.shape.clone();
    shape[axis] = (end - start).div_ceil(step);
    let strides = x.strides();
    Tensor::from_fn(&shape, |index| {
        let offset: usize = index.iter().zip(&strides).map(|(i, s)| i * s).sum();
        x.data[offset + (start + (step - 1) * index[axis]) * strides[axis]]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concatenation_interleaves_the_outer_axes() {
        let a = Tensor::new(&[2, 1], vec![1.0, 2.0]);
        let b = Tensor::new(&[2, 2], vec![3.0, 4.0, 5.0, 6.0]);
        assert_eq!(concat(&[&a, &b], 1), Tensor::new(&[2, 3], vec![1.0, 3.0, 4.0, 2.0, 5.0, 6.0]));
        assert_eq!(concat(&[&a, &a], 0).data, [1.0, 2.0, 1.0, 2.0]);
    }

    #[test]
    fn transposing_there_and_back_is_the_identity() {
        let x = Tensor::from_fn(&[2, 3, 4], |i| (100 * i[0] + 10 * i[1] + i[2]) as f64);
        let y = transpose(&x, &[2, 0, 1]);
        assert_eq!((y.shape.as_slice(), y.at(&[3, 1, 2])), ([4, 2, 3].as_slice(), 123.0));
        assert_eq!(transpose(&y, &[1, 2, 0]), x);
    }

    #[test]
    fn a_slice_takes_every_step_before_the_end() {
        let x = Tensor::from_fn(&[2, 5], |i| (10 * i[0] + i[1]) as f64);
        assert_eq!(slice(&x, 1, 1, 5, 2), Tensor::new(&[2, 2], vec![1.0, 3.0, 11.0, 13.0]));
        assert_eq!(slice(&x, 0, 1, 2, 1).data, [10.0, 11.0, 12.0, 13.0, 14.0]);
    }

    #[test]
    #[should_panic(expected = "shapes [2, 1] and [3, 1] differ beside axis 1")]
    fn other_axes_must_agree() {
        concat(&[&Tensor::<f64>::zeros(&[2, 1]), &Tensor::zeros(&[3, 1])], 1);
    }
}

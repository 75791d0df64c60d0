//! Operators that move elements and compute nothing, so that any implementation must agree bit by bit.

use super::Tensor;
use super::elementwise::{broadcast_offset, broadcast_shape};

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

/// The tensor repeated to a larger shape by broadcasting: axes of length one, and missing leading axes, repeat.
///
/// The result has the shape that x's and the wanted one broadcast *to*, so that an axis of length one in `shape` keeps x's.
///
/// # Panics
/// If the two shapes do not broadcast.
///
/// # References
/// ONNX operator Expand (version 13).
pub fn expand<T: Copy>(x: &Tensor<T>, shape: &[usize]) -> Tensor<T> {
    let to = broadcast_shape(&x.shape, shape)
        .unwrap_or_else(|| panic!("expand: shapes {:?} and {shape:?} do not broadcast", x.shape));
    Tensor::from_fn(&to, |index| x.data[broadcast_offset(&x.shape, index)])
}

/// The tensor laid side by side with itself, `repeats[a]` times along axis a.
///
/// # Panics
/// If there is not one number of repeats for each axis.
///
/// # References
/// ONNX operator Tile (version 13).
pub fn tile<T: Copy>(x: &Tensor<T>, repeats: &[usize]) -> Tensor<T> {
    assert!(repeats.len() == x.rank(), "tile: {repeats:?} for the axes of shape {:?}", x.shape);
    let shape: Vec<usize> = x.shape.iter().zip(repeats).map(|(n, r)| n * r).collect();
    Tensor::from_fn(&shape, |index| {
        x.data[index.iter().zip(&x.shape).fold(0, |offset, (i, n)| offset * n + i % n)]
    })
}

/// The first lengths\[b\] places of the time axis in reverse order, in every batch b; the places behind stay.
///
/// # Panics
/// If the two axes are one, there is not one length for each batch, or a length exceeds the time axis.
///
/// # References
/// ONNX operator ReverseSequence (version 10).
pub fn reverse_sequence<T: Copy>(
    x: &Tensor<T>,
    lengths: &[usize],
    batch_axis: usize,
    time_axis: usize,
) -> Tensor<T> {
    let fits = batch_axis != time_axis
        && x.shape.get(batch_axis) == Some(&lengths.len())
        && lengths.iter().all(|n| x.shape.get(time_axis).is_some_and(|time| n <= time));
    assert!(
        fits,
        "reverse_sequence: lengths {lengths:?} do not fit batch axis {batch_axis} and time axis {time_axis} of \
         shape {:?}",
        x.shape
    );
    Tensor::from_fn(&x.shape, |index| {
        let mut from = index.to_vec();
        let length = lengths[index[batch_axis]];
        if index[time_axis] < length {
            from[time_axis] = length - 1 - index[time_axis];
        }
        x.at(&from)
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

    #[test]
    fn expansion_repeats_axes_of_one_and_keeps_those_of_the_tensor() {
        let x = Tensor::new(&[2, 1], vec![1.0, 2.0]);
        assert_eq!(expand(&x, &[3]), Tensor::new(&[2, 3], vec![1.0, 1.0, 1.0, 2.0, 2.0, 2.0]));
        assert_eq!(expand(&x, &[2, 1, 1]), Tensor::new(&[2, 2, 1], vec![1.0, 2.0, 1.0, 2.0]));
        assert_eq!(expand(&x, &[1, 1]), x, "a wanted length of one asks for nothing");
    }

    #[test]
    fn tiles_lie_side_by_side() {
        let x = Tensor::new(&[2, 2], vec![1.0, 2.0, 3.0, 4.0]);
        assert_eq!(tile(&x, &[1, 2]).data, [1.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 4.0]);
        assert_eq!(tile(&x, &[2, 1]).data, [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn a_sequence_is_reversed_as_far_as_it_reaches() {
        let x = Tensor::from_fn(&[4, 2], |i| 10 * i[0] + i[1]);
        let y = reverse_sequence(&x, &[3, 1], 1, 0);
        assert_eq!(y.data, [20, 1, 10, 11, 0, 21, 30, 31]);
        assert_eq!(reverse_sequence(&y, &[3, 1], 1, 0), x, "twice is not at all");
    }
}

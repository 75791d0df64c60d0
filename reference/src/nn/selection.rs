//! Places chosen by truths, and truths and patterns made from places.

use super::{Scalar, Tensor, gather};

/// The slices along an axis where the condition holds; what lies beyond the condition's end is left out.
///
/// # Panics
/// If the axis does not exist, or the condition is longer than it.
///
/// # References
/// ONNX operator Compress (version 11).
pub fn compress<T: Copy>(x: &Tensor<T>, condition: &[bool], axis: usize) -> Tensor<T> {
    let chosen: Vec<usize> = (0..condition.len()).filter(|&place| condition[place]).collect();
    gather(x, &Tensor::new(&[chosen.len()], chosen), axis)
}

/// The indices of the elements that hold, one a column, in row-major order: shape \[rank, number of them\].
///
/// # References
/// ONNX operator NonZero (version 13).
pub fn non_zero(x: &Tensor<bool>) -> Tensor<usize> {
    let strides = x.strides();
    let found: Vec<usize> = (0..x.data.len()).filter(|&place| x.data[place]).collect();
    let index = |axis: usize| {
        let (stride, length) = (strides[axis], x.shape[axis]);
        found.iter().map(move |place| place / stride % length)
    };
    Tensor::new(&[x.rank(), found.len()], (0..x.rank()).flat_map(index).collect())
}

/// `on` at each place and `off` beside it, along a new axis of length `depth`; a place of `None` is off throughout.
///
/// y\[a…, d, b…\] = on where places\[a…, b…\] = d.
///
/// # Panics
/// If `axis` exceeds the rank of the places.
///
/// # References
/// ONNX operator OneHot (version 11); a place outside of −depth … depth − 1 is `None`.
pub fn one_hot<T: Copy>(
    places: &Tensor<Option<usize>>,
    depth: usize,
    off: T,
    on: T,
    axis: usize,
) -> Tensor<T> {
    assert!(axis <= places.rank(), "one_hot: axis {axis} behind the axes of shape {:?}", places.shape);
    let mut shape = places.shape.clone();
    shape.insert(axis, depth);
    Tensor::from_fn(&shape, |index| {
        let mut beside = index.to_vec();
        let here = beside.remove(axis);
        if places.at(&beside) == Some(here) { on } else { off }
    })
}

/// The part of each matrix on and above (`upper`) or on and below its k-th diagonal; the rest is `zero`.
///
/// The k-th diagonal is j − i = k, above the main one for k > 0.
///
/// # Panics
/// If x is no matrix, nor a batch of matrices.
///
/// # References
/// ONNX operator Trilu (version 14).
pub fn triangle<T: Copy>(x: &Tensor<T>, k: i64, upper: bool, zero: T) -> Tensor<T> {
    assert!(x.rank() >= 2, "triangle: shape {:?} has no matrix", x.shape);
    let mut kept = x.data.iter();
    Tensor::from_fn(&x.shape, |index| {
        let (row, column) = (index[x.rank() - 2] as i128, index[x.rank() - 1] as i128);
        let diagonal = column - row;
        let inside = if upper { diagonal >= k.into() } else { diagonal <= k.into() };
        kept.next().copied().filter(|_| inside).unwrap_or(zero)
    })
}

/// Ones on the k-th diagonal j − i = k of a matrix, zeros elsewhere.
///
/// # References
/// ONNX operator EyeLike (version 22).
pub fn eye<T: Scalar>(rows: usize, columns: usize, k: i64) -> Tensor<T> {
    Tensor::from_fn(&[rows, columns], |index| {
        let on = index[1] as i128 - index[0] as i128 == k.into();
        if on { T::exact(1.0) } else { T::ZERO }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_chooses_slices() {
        let x = Tensor::new(&[3, 2], vec![1, 2, 3, 4, 5, 6]);
        assert_eq!(compress(&x, &[false, true, true], 0).data, [3, 4, 5, 6]);
        assert_eq!(compress(&x, &[false, true], 1).data, [2, 4, 6]);
        assert_eq!(compress(&x, &[true], 1).shape, [3, 1], "a short condition chooses none of the rest");
    }

    #[test]
    #[should_panic(expected = "place 2 does not lie in axis 1")]
    fn a_condition_must_not_choose_what_is_not_there() {
        compress(&Tensor::new(&[1, 2], vec![1, 2]), &[false, false, true], 1);
    }

    #[test]
    fn what_holds_is_found_row_by_row() {
        let x = Tensor::new(&[2, 2], vec![true, false, true, true]);
        assert_eq!(non_zero(&x), Tensor::new(&[2, 3], vec![0, 1, 1, 0, 0, 1]));
        assert_eq!(
            non_zero(&Tensor::new(&[], vec![true])).shape,
            [0, 1],
            "a scalar has an index without axes"
        );
    }

    #[test]
    fn a_place_is_on_along_the_new_axis() {
        let places = Tensor::new(&[2], vec![Some(2), None]);
        assert_eq!(one_hot(&places, 3, 0, 7, 1), Tensor::new(&[2, 3], vec![0, 0, 7, 0, 0, 0]));
        assert_eq!(one_hot(&places, 3, 0, 7, 0), Tensor::new(&[3, 2], vec![0, 0, 0, 0, 7, 0]));
    }

    #[test]
    fn the_triangles_share_their_diagonal() {
        let x = Tensor::new(&[2, 3], vec![1, 2, 3, 4, 5, 6]);
        assert_eq!(triangle(&x, 0, true, 0).data, [1, 2, 3, 0, 5, 6]);
        assert_eq!(triangle(&x, 0, false, 0).data, [1, 0, 0, 4, 5, 0]);
        assert_eq!(triangle(&x, 1, true, 0).data, [0, 2, 3, 0, 0, 6]);
        assert_eq!(triangle(&x, -1, false, 0).data, [0, 0, 0, 4, 0, 0]);
        assert_eq!(triangle(&x, i64::MIN, true, 0), x, "everything is above");
        assert_eq!(eye::<f64>(2, 3, 1).data, [0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    }
}

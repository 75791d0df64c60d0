//! The place of the largest or smallest element along an axis.

use super::Tensor;
use super::reduction::reduce;

/// The place along `axis` of the element that no other one `beats`; of several, the first, or with `last` the last.
///
/// The axis keeps length one (`keepdims`) or vanishes. `beats(a, b)` is a > b for the largest and a < b for the smallest.
///
/// # Conventions
/// With floating-point numbers, the order must say where a NaN stands: ONNX does not, NumPy lets it win.
///
/// # Panics
/// If the axis is not one of x, or is empty: nothing has no place.
///
/// # References
/// ONNX operators ArgMax and ArgMin (version 13).
///
/// ```
/// use vitruvian_reference::nn::{Tensor, place_of_extremum};
/// let x = Tensor::new(&[4], vec![2.0, 7.0, 7.0, 1.0]);
/// assert_eq!(place_of_extremum(&x, 0, true, false, |a, b| a > b).data, [1]);
/// assert_eq!(place_of_extremum(&x, 0, true, true, |a, b| a > b).data, [2]);
/// ```
pub fn place_of_extremum<A: Copy>(
    x: &Tensor<A>,
    axis: usize,
    keepdims: bool,
    last: bool,
    beats: impl Fn(A, A) -> bool,
) -> Tensor<usize> {
    let empty = x.shape.get(axis) == Some(&0);
    assert!(!empty, "place_of_extremum: axis {axis} of shape {:?} is empty", x.shape);
    reduce(x, &[axis], keepdims, |x| {
        let better = |i: usize, best: usize| beats(x[i], x[best]) || (last && !beats(x[best], x[i]));
        (1..x.len()).fold(0, |best, i| if better(i, best) { i } else { best })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_go_to_the_first_or_to_the_last() {
        let x = Tensor::new(&[2, 3], vec![5, 5, 1, 0, 2, 2]);
        assert_eq!(place_of_extremum(&x, 1, false, false, |a, b| a > b), Tensor::new(&[2], vec![0, 1]));
        assert_eq!(place_of_extremum(&x, 1, true, true, |a, b| a > b), Tensor::new(&[2, 1], vec![1, 2]));
        assert_eq!(place_of_extremum(&x, 0, false, true, |a, b| a < b).data, [1, 1, 0]);
        let equal = Tensor::new(&[3], vec![4, 4, 4]);
        assert_eq!(place_of_extremum(&equal, 0, false, true, |a, b| a > b).data, [2]);
    }

    #[test]
    #[should_panic(expected = "axis 0 of shape [0] is empty")]
    fn nothing_has_no_largest_element() {
        place_of_extremum(&Tensor::<f64>::zeros(&[0]), 0, true, false, |a, b| a > b);
    }
}

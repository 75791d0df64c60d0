//! The largest or smallest elements along an axis, and where they were.

use std::cmp::Ordering;

use super::{Tensor, gather_elements};

/// The first `count` elements along `axis` in the order that `before` gives, and their places along that axis.
///
/// `before(a, b)` is `Less` where a comes before b: `b.cmp(&a)` gives the largest. Among equals the lower place comes first.
///
/// # Panics
/// If the axis does not exist, or is shorter than `count`.
///
/// # References
/// ONNX operator TopK (version 24); its `sorted` = 0 leaves the order of the results open, this one stays sorted.
pub fn top_k<T: Copy>(
    x: &Tensor<T>,
    count: usize,
    axis: usize,
    before: impl Fn(&T, &T) -> Ordering,
) -> (Tensor<T>, Tensor<usize>) {
    assert!(
        axis < x.rank() && count <= x.shape[axis],
        "top_k: {count} elements along axis {axis} of shape {:?}",
        x.shape
    );
    let (length, run) = (x.shape[axis], x.strides()[axis]);
    let mut shape = x.shape.clone();
    shape[axis] = count;
    let mut places = Tensor::filled(&shape, 0);
    let lines = x.data.len().checked_div(length).unwrap_or(0);
    for line in 0..lines {
        let (outer, inner) = (line / run, line % run);
        let element = |place: usize| &x.data[(outer * length + place) * run + inner];
        let mut order: Vec<usize> = (0..length).collect();
        // A stable sort keeps the lower place first.
        order.sort_by(|&a, &b| before(element(a), element(b)));
        for (k, place) in order.into_iter().take(count).enumerate() {
            places.data[(outer * count + k) * run + inner] = place;
        }
    }
    (gather_elements(x, &places, axis), places)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_come_in_order_and_equals_by_their_places() {
        let x = Tensor::new(&[2, 4], vec![3, 1, 3, 2, 0, 5, 5, 5]);
        let (values, places) = top_k(&x, 3, 1, |a, b| b.cmp(a));
        assert_eq!((values.data, places.data), (vec![3, 3, 2, 5, 5, 5], vec![0, 2, 3, 1, 2, 3]));
        let (values, places) = top_k(&x, 1, 0, Ord::cmp);
        assert_eq!(
            (values.data, places.data),
            (vec![0, 1, 3, 2], vec![1, 0, 0, 0]),
            "the smallest of columns"
        );
    }

    #[test]
    fn none_of_nothing_is_nothing() {
        let (values, places) = top_k(&Tensor::<i64>::new(&[0, 2], vec![]), 0, 0, Ord::cmp);
        assert_eq!((values.shape, places.shape), (vec![0, 2], vec![0, 2]));
    }

    #[test]
    #[should_panic(expected = "top_k: 3 elements along axis 0 of shape [2]")]
    fn there_must_be_as_many() {
        top_k(&Tensor::new(&[2], vec![1, 2]), 3, 0, Ord::cmp);
    }
}

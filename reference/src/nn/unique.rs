//! Distinct slices of a tensor.

use std::cmp::Ordering;

use super::{Tensor, gather, transpose};

/// The distinct slices of a tensor along one axis, and how they make it up.
#[derive(Clone, Debug, PartialEq)]
pub struct Unique<T> {
    /// The distinct slices, along the axis.
    pub values: Tensor<T>,
    /// For each of them, the place where it first stands in x.
    pub first: Vec<usize>,
    /// For each slice of x, its place among the distinct ones: gathering `values` there gives x again.
    pub inverse: Vec<usize>,
    /// For each distinct slice, how often it stands in x.
    pub counts: Vec<usize>,
}

/// The distinct slices along `axis`: in ascending (lexicographic) order where `sorted`, else in order of appearance.
///
/// # Panics
/// If the axis does not exist.
///
/// # References
/// ONNX operator Unique (version 11).
pub fn unique<T: Copy>(
    x: &Tensor<T>,
    axis: usize,
    sorted: bool,
    order: impl Fn(&T, &T) -> Ordering,
) -> Unique<T> {
    assert!(axis < x.rank(), "unique: axis {axis} does not lie in shape {:?}", x.shape);
    let mut axes: Vec<usize> = (0..x.rank()).filter(|&a| a != axis).collect();
    axes.insert(0, axis);
    let (rows, length) = (transpose(x, &axes), x.shape[axis]);
    let width = rows.data.len().checked_div(length).unwrap_or(0);
    let row = |place: usize| &rows.data[place * width..(place + 1) * width];
    let compare = |a: usize, b: usize| {
        let differing = row(a).iter().zip(row(b)).map(|(a, b)| order(a, b)).find(|o| o.is_ne());
        differing.unwrap_or(Ordering::Equal)
    };
    let mut places: Vec<usize> = (0..length).collect();
    places.sort_by(|&a, &b| compare(a, b));
    // Equal slices stand together, the first one first, since the sort is stable.
    let mut groups: Vec<Vec<usize>> =
        places.chunk_by(|&a, &b| compare(a, b).is_eq()).map(<[usize]>::to_vec).collect();
    if !sorted {
        groups.sort_by_key(|group| group[0]);
    }
    let first: Vec<usize> = groups.iter().map(|group| group[0]).collect();
    let mut inverse = vec![0; length];
    for (k, group) in groups.iter().enumerate() {
        for &place in group {
            inverse[place] = k;
        }
    }
    let values = gather(x, &Tensor::new(&[first.len()], first.clone()), axis);
    Unique { values, first, inverse, counts: groups.iter().map(Vec::len).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distinct_numbers_make_up_the_tensor() {
        let x = Tensor::new(&[6], vec![2, 1, 1, 3, 4, 3]);
        let sorted = unique(&x, 0, true, Ord::cmp);
        assert_eq!((&sorted.values.data[..], &sorted.first[..]), (&[1, 2, 3, 4][..], &[1, 0, 3, 4][..]));
        assert_eq!((&sorted.inverse[..], &sorted.counts[..]), (&[1, 0, 0, 2, 3, 2][..], &[2, 1, 2, 1][..]));
        let seen = unique(&x, 0, false, Ord::cmp);
        assert_eq!(seen.values.data, [2, 1, 3, 4], "in order of appearance");
        for u in [sorted, seen] {
            assert_eq!(gather(&u.values, &Tensor::new(&[6], u.inverse), 0), x, "gathered again");
        }
    }

    #[test]
    fn slices_are_compared_whole() {
        let x = Tensor::new(&[2, 3], vec![1, 0, 1, 5, 9, 5]);
        let u = unique(&x, 1, true, Ord::cmp);
        assert_eq!((u.values, u.first), (Tensor::new(&[2, 2], vec![0, 1, 9, 5]), vec![1, 0]));
        assert_eq!(unique(&Tensor::<i64>::new(&[0], vec![]), 0, true, Ord::cmp).counts, [0_usize; 0]);
    }
}

//! Gathering: elements or slices of a tensor, picked by their places.
//!
//! Nothing is computed, so any implementation must agree bit by bit.

use super::Tensor;

/// The slices of x at these places along an axis: the places' own axes stand where that axis was.
///
/// y\[a…, p…, b…\] = x\[a…, places\[p…\], b…\]; one place of rank 0 removes the axis.
///
/// # Panics
/// If the axis or a place does not exist.
///
/// # References
/// ONNX operator Gather (version 13) with non-negative indices.
pub fn gather<T: Copy>(x: &Tensor<T>, places: &Tensor<usize>, axis: usize) -> Tensor<T> {
    assert!(axis < x.rank(), "gather: axis {axis} does not lie in shape {:?}", x.shape);
    let length = x.shape[axis];
    let (before, after) = (&x.shape[..axis], &x.shape[axis + 1..]);
    let run: usize = after.iter().product();
    let outer: usize = before.iter().product();
    let mut data = Vec::with_capacity(outer * places.data.len() * run);
    for block in 0..outer {
        for &place in &places.data {
            assert!(
                place < length,
                "gather: place {place} does not lie in axis {axis} of shape {:?}",
                x.shape
            );
            let start = (block * length + place) * run;
            data.extend_from_slice(&x.data[start..start + run]);
        }
    }
    Tensor { shape: [before, &places.shape, after].concat(), data }
}

/// The elements of x at these places along an axis, each beside its own: y\[i\] = x\[i₀, …, places\[i\], …\].
///
/// The places have x's rank; along the other axes they may be shorter than x.
///
/// # Panics
/// If the shapes do not fit, or a place lies outside.
///
/// # References
/// ONNX operator GatherElements (version 13) with non-negative indices.
pub fn gather_elements<T: Copy>(x: &Tensor<T>, places: &Tensor<usize>, axis: usize) -> Tensor<T> {
    let fits = axis < x.rank()
        && places.rank() == x.rank()
        && (0..x.rank()).all(|a| a == axis || places.shape[a] <= x.shape[a]);
    assert!(fits, "gather_elements: places {:?} do not fit axis {axis} of shape {:?}", places.shape, x.shape);
    Tensor::from_fn(&places.shape, |index| {
        let mut from = index.to_vec();
        from[axis] = places.at(index);
        x.at(&from)
    })
}

/// The slices of x at places of K indices: places \[B…, P…, K\], x \[B…, n₁…n_K, R…\] give y \[B…, P…, R…\].
///
/// The first `batch_axes` axes B… are shared: y\[b, p\] = x\[b, places\[b, p, 0\], …, places\[b, p, K−1\]\].
///
/// # Panics
/// If the shapes do not fit, or a place lies outside.
///
/// # References
/// ONNX operator GatherND (version 13) with non-negative indices.
pub fn gather_nd<T: Copy>(x: &Tensor<T>, places: &Tensor<usize>, batch_axes: usize) -> Tensor<T> {
    let (&depth, outer) = places.shape.split_last().expect("gather_nd: the places must have an axis");
    let fits = batch_axes <= outer.len()
        && batch_axes + depth <= x.rank()
        && x.shape[..batch_axes] == outer[..batch_axes];
    assert!(
        fits,
        "gather_nd: places {:?} with {batch_axes} batch axes do not fit shape {:?}",
        places.shape, x.shape
    );
    let (head, rest) = x.shape.split_at(batch_axes + depth);
    let run: usize = rest.iter().product();
    let picked: usize = outer.iter().product();
    let batches: usize = outer[..batch_axes].iter().product();
    let mut data = Vec::with_capacity(picked * run);
    for k in 0..picked {
        // picked / batches places belong to one batch.
        let batch = k / (picked / batches);
        let place = &places.data[k * depth..(k + 1) * depth];
        let inside = place.iter().zip(&head[batch_axes..]).all(|(i, n)| i < n);
        assert!(inside, "gather_nd: place {place:?} does not lie in {:?}", &head[batch_axes..]);
        let slice = place.iter().zip(&head[batch_axes..]).fold(batch, |offset, (i, n)| offset * n + i);
        data.extend_from_slice(&x.data[slice * run..(slice + 1) * run]);
    }
    Tensor { shape: [outer, rest].concat(), data }
}

#[cfg(test)]
mod tests {
    use super::super::movement::slice;
    use super::*;

    #[test]
    fn gathered_places_stand_where_their_axis_was() {
        let x = Tensor::from_fn(&[2, 3, 2], |i| (100 * i[0] + 10 * i[1] + i[2]) as f64);
        let y = gather(&x, &Tensor::new(&[2, 2], vec![2, 0, 0, 1]), 1);
        assert_eq!(
            (&y.shape[..], y.at(&[1, 0, 0, 1]), y.at(&[0, 1, 1, 0])),
            (&[2, 2, 2, 2][..], 121.0, 10.0)
        );
        assert_eq!(gather(&x, &Tensor::new(&[], vec![1]), 0), slice(&x, 0, 1, 2, 1).reshape(&[3, 2]));
    }

    #[test]
    #[should_panic(expected = "place 3 does not lie in axis 1 of shape [2, 3]")]
    fn a_gathered_place_must_exist() {
        gather(&Tensor::<f64>::zeros(&[2, 3]), &Tensor::new(&[1], vec![3]), 1);
    }

    #[test]
    fn a_gathered_element_stays_in_its_row() {
        let x = Tensor::new(&[2, 2], vec![1, 2, 3, 4]);
        assert_eq!(gather_elements(&x, &Tensor::new(&[2, 2], vec![0, 0, 1, 0]), 1).data, [1, 1, 4, 3]);
        assert_eq!(gather_elements(&x, &Tensor::new(&[1, 2], vec![1, 0]), 0).data, [3, 2]);
    }

    #[test]
    fn a_place_of_several_indices_names_an_element_or_a_slice() {
        let x = Tensor::from_fn(&[2, 2, 2], |i| 4 * i[0] + 2 * i[1] + i[2]);
        let slices = gather_nd(&x, &Tensor::new(&[2, 2], vec![0, 1, 1, 0]), 0);
        assert_eq!(slices, Tensor::new(&[2, 2], vec![2, 3, 4, 5]));
        let batched = gather_nd(&x, &Tensor::new(&[2, 1], vec![1, 0]), 1);
        assert_eq!(batched, Tensor::new(&[2, 2], vec![2, 3, 4, 5]), "one place in each batch");
        let all = gather_nd(&x, &Tensor::new(&[1, 3], vec![1, 1, 1]), 0);
        assert_eq!(all, Tensor::new(&[1], vec![7]));
        let none = gather_nd(&x, &Tensor::new(&[0, 1], vec![]), 0);
        assert_eq!(none.shape, [0, 2, 2], "no place, no slice");
    }

    #[test]
    #[should_panic(expected = "place [2] does not lie in [2]")]
    fn a_place_in_a_batch_must_exist() {
        let x = Tensor::from_fn(&[2, 2], |i| i[0]);
        gather_nd(&x, &Tensor::new(&[2, 1], vec![0, 2]), 1);
    }
}

//! Scattering: a copy of a tensor with some of its elements replaced, or combined with others.
//!
//! An update u meets the element y in its place and leaves f(y, u): [`replace`] puts u there, a sum, a product or a choice
//! combines. Updates that meet in one place come in their order; with `replace` the last one stands, which the ONNX
//! specification leaves open. Replacing computes nothing, so any implementation must agree bit by bit.

use super::Tensor;

/// f(y, u) = u: the update stands.
pub fn replace<T>(_: T, update: T) -> T {
    update
}

/// x with slices updated by f: places \[…,K\] name, in their last axis, the first K indices of a slice of x each; updates
/// \[…, rest of x\].
///
/// # Panics
/// If the shapes do not fit, or a place lies outside.
///
/// # References
/// ONNX operator ScatterND (version 18) with non-negative indices; its reductions none, add, mul, min and max are f.
pub fn scatter_nd<T: Copy>(
    x: &Tensor<T>,
    places: &Tensor<usize>,
    updates: &Tensor<T>,
    f: impl Fn(T, T) -> T,
) -> Tensor<T> {
    let (&depth, outer) = places.shape.split_last().expect("scatter_nd: the places must have an axis");
    let fits = depth <= x.rank() && updates.shape == [outer, &x.shape[depth.min(x.rank())..]].concat();
    assert!(
        fits,
        "scatter_nd: places {:?} and updates {:?} do not fit x {:?}",
        places.shape, updates.shape, x.shape
    );
    let run: usize = x.shape[depth..].iter().product();
    let head = Tensor::new(&x.shape[..depth], (0..x.shape[..depth].iter().product()).collect::<Vec<usize>>());
    let mut y = x.clone();
    for (k, update) in updates.data.chunks_exact(run.max(1)).enumerate() {
        let start = head.at(&places.data[k * depth..(k + 1) * depth]) * run;
        for (y, &update) in y.data[start..start + run].iter_mut().zip(update) {
            *y = f(*y, update);
        }
    }
    y
}

/// x with elements updated by f: y\[i₀, …, places\[i\], …\] = f(y\[same\], updates\[i\]), the place standing at `axis`.
///
/// # Panics
/// If the shapes do not fit, or a place lies outside.
///
/// # References
/// ONNX operator ScatterElements (version 18) with non-negative indices; its reductions are f, as in [`scatter_nd`].
pub fn scatter_elements<T: Copy>(
    x: &Tensor<T>,
    places: &Tensor<usize>,
    updates: &Tensor<T>,
    axis: usize,
    f: impl Fn(T, T) -> T,
) -> Tensor<T> {
    assert!(
        axis < x.rank() && places.shape == updates.shape && places.rank() == x.rank(),
        "scatter_elements: places {:?} and updates {:?} do not fit axis {axis} of x {:?}",
        places.shape,
        updates.shape,
        x.shape
    );
    let mut y = x.clone();
    let mut index = vec![0; x.rank()];
    for (&place, &update) in places.data.iter().zip(&updates.data) {
        let mut target = index.clone();
        target[axis] = place;
        let offset = x.offset(&target);
        y.data[offset] = f(y.data[offset], update);
        super::tensor::advance(&mut index, &places.shape);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::*;

    #[test]
    fn slices_and_single_elements_are_replaced() {
        let x = Tensor::<f64>::zeros(&[3, 2]);
        let rows =
            scatter_nd(&x, &Tensor::new(&[1, 1], vec![2]), &Tensor::new(&[1, 2], vec![5.0, 6.0]), replace);
        assert_eq!(rows.data, [0.0, 0.0, 0.0, 0.0, 5.0, 6.0]);
        let one = scatter_nd(&x, &Tensor::new(&[1, 2], vec![1, 0]), &Tensor::new(&[1], vec![7.0]), replace);
        assert_eq!(one.data, [0.0, 0.0, 7.0, 0.0, 0.0, 0.0]);
        let nothing = Tensor::new(&[0, 2], vec![]);
        assert_eq!(scatter_nd(&x, &nothing, &Tensor::new(&[0], vec![]), replace), x);
    }

    #[test]
    fn updates_that_meet_are_combined_in_their_order() {
        let x = Tensor::new(&[2], vec![1, 10]);
        let (places, updates) = (Tensor::new(&[3], vec![1, 1, 0]), Tensor::new(&[3], vec![2, 5, 7]));
        let meet = |f: fn(i64, i64) -> i64| scatter_elements(&x, &places, &updates, 0, f).data;
        assert_eq!(meet(replace), [7, 5], "the last stands");
        assert_eq!(meet(|y, u| y + u), [8, 17], "a sum");
        assert_eq!(meet(|y, u| y.max(u)), [7, 10], "a choice");
        let slices = scatter_nd(&x, &places.reshape(&[3, 1]), &updates, |y, u| y * u);
        assert_eq!(slices.data, [7, 100], "a product");
    }

    #[test]
    fn agrees_with_pytorch() {
        let places = Tensor::new(&[2, 2, 3], vec![3, 0, 1, 2, 1, 0, 0, 3, 2, 1, 2, 3]);
        let y = scatter_elements(&pattern(&[2, 4, 3], 1), &places, &pattern(&[2, 2, 3], 2), 1, replace);
        check(&y, &goldens::SCATTER_ELEMENTS);
    }

    #[test]
    #[should_panic(expected = "updates [1, 3] do not fit x [3, 2]")]
    fn an_update_must_fit_its_slice() {
        scatter_nd(
            &Tensor::<f64>::zeros(&[3, 2]),
            &Tensor::new(&[1, 1], vec![0]),
            &Tensor::zeros(&[1, 3]),
            replace,
        );
    }

    #[test]
    #[should_panic(expected = "does not lie in shape [3, 2]")]
    fn a_place_must_exist() {
        let places = Tensor::new(&[1, 2], vec![0, 2]);
        scatter_elements(&Tensor::<f64>::zeros(&[3, 2]), &places, &Tensor::zeros(&[1, 2]), 1, replace);
    }
}

//! Max unpooling: the largest values go back to where max pooling found them; the rest is zero.

use super::{Scalar, Tensor};

/// x [N,C,…] and the places of its elements in a map of shape `pooled` → [N,C,…] of shape `output`.
///
/// The places are those that [`max_pool_indices`](super::max_pool_indices) gives, row-major, for a map [N,C,…] of
/// shape `pooled`: (n − 1)·stride + kernel − padding per axis. Where `output` is larger, that map lies in its first corner.
/// Where two places are the same, the later element stays.
///
/// # Panics
/// If the shapes of x and places differ, a place does not lie in `pooled`, or `pooled` not in `output`.
///
/// # References
/// ONNX operator MaxUnpool (versions 9, 11 and 22).
pub fn max_unpool<T: Scalar>(
    x: &Tensor<T>,
    places: &Tensor<i64>,
    pooled: &[usize],
    output: &[usize],
) -> Tensor<T> {
    assert!(x.shape == places.shape, "max_unpool: x {:?} and indices {:?} differ", x.shape, places.shape);
    assert!(
        pooled.len() == output.len() && pooled.iter().zip(output).all(|(p, o)| p <= o),
        "max_unpool: the map {pooled:?} does not lie in the output {output:?}"
    );
    let count: usize = pooled.iter().product();
    let mut y = Tensor::zeros(output);
    let strides = y.strides();
    for (&value, &place) in x.data.iter().zip(&places.data) {
        let inside = usize::try_from(place).ok().filter(|&place| place < count);
        let mut rest =
            inside.unwrap_or_else(|| panic!("max_unpool: index {place} does not lie in the map {pooled:?}"));
        let mut offset = 0;
        for axis in (0..pooled.len()).rev() {
            offset += rest % pooled[axis] * strides[axis];
            rest /= pooled[axis];
        }
        y.data[offset] = value;
    }
    y
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::super::{Pool, max_pool, max_pool_indices};
    use super::*;

    #[test]
    fn pooling_what_was_unpooled_gives_it_back() {
        let x = pattern(&[2, 2, 4, 6], 1).map(|v| v + 2.0);
        let window = Pool::new(2, 2);
        let (y, places) = (max_pool(&x, &window), max_pool_indices(&x, &window, false));
        let back = max_unpool(&y, &places, &x.shape, &x.shape);
        assert_eq!(max_pool(&back, &window), y);
        assert_eq!(back.data.iter().filter(|&&v| v != 0.0).count(), y.data.len(), "the rest is zero");
    }

    #[test]
    fn a_larger_output_has_the_map_in_its_first_corner() {
        let x = Tensor::new(&[1, 1, 1, 2], vec![5.0, 6.0]);
        let places = Tensor::new(&[1, 1, 1, 2], vec![1, 2]);
        let y = max_unpool(&x, &places, &[1, 1, 2, 2], &[1, 1, 3, 3]);
        assert_eq!(y.data, [0.0, 5.0, 0.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    #[should_panic(expected = "index 4 does not lie in the map [1, 1, 2, 2]")]
    fn a_place_must_lie_in_the_map() {
        let places = Tensor::new(&[1, 1, 1, 1], vec![4]);
        max_unpool(&Tensor::<f64>::zeros(&[1, 1, 1, 1]), &places, &[1, 1, 2, 2], &[1, 1, 2, 2]);
    }
}

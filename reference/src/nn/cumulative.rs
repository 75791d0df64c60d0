//! Running sums and products along an axis.

use super::softmax::map_lines;
use super::{Ring, Tensor};

/// Where a running sum or product starts and what it takes in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cumulative {
    /// yᵢ leaves out xᵢ itself: the first is the empty sum or product.
    pub exclusive: bool,
    /// From the last element to the first.
    pub reverse: bool,
}

/// yᵢ = x₀ + … + xᵢ along an axis.
///
/// Rounding: the additions of each sum, in any order.
///
/// # Panics
/// If the axis is not one of x.
///
/// # References
/// ONNX operator CumSum (version 14).
pub fn cumulative_sum<T: Ring>(x: &Tensor<T>, axis: usize, how: Cumulative) -> Tensor<T> {
    map_lines("cumulative_sum", x, axis, |x| running(x, T::ZERO, T::plus, how))
}

/// yᵢ = x₀ · … · xᵢ along an axis.
///
/// # Panics
/// If the axis is not one of x.
///
/// # References
/// ONNX operator CumProd (version 26).
pub fn cumulative_product<T: Ring>(x: &Tensor<T>, axis: usize, how: Cumulative) -> Tensor<T> {
    map_lines("cumulative_product", x, axis, |x| running(x, T::one(), T::mul, how))
}

fn running<T: Copy>(x: &[T], neutral: T, join: fn(T, T) -> T, how: Cumulative) -> Vec<T> {
    let mut y = vec![neutral; x.len()];
    // The first element is taken as it is: joining it to the neutral one rounds nothing.
    let mut so_far: Option<T> = None;
    for step in 0..x.len() {
        let i = if how.reverse { x.len() - 1 - step } else { step };
        let with_this = so_far.map_or(x[i], |before| join(before, x[i]));
        y[i] = if how.exclusive { so_far.unwrap_or(neutral) } else { with_this };
        so_far = Some(with_this);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_directions_with_and_without_the_element_itself() {
        let x = Tensor::new(&[4], vec![1.0, 2.0, 3.0, 4.0]);
        let how = |exclusive, reverse| Cumulative { exclusive, reverse };
        assert_eq!(cumulative_sum(&x, 0, how(false, false)).data, [1.0, 3.0, 6.0, 10.0]);
        assert_eq!(cumulative_sum(&x, 0, how(true, false)).data, [0.0, 1.0, 3.0, 6.0]);
        assert_eq!(cumulative_sum(&x, 0, how(false, true)).data, [10.0, 9.0, 7.0, 4.0]);
        assert_eq!(cumulative_sum(&x, 0, how(true, true)).data, [9.0, 7.0, 4.0, 0.0]);
        assert_eq!(cumulative_product(&x, 0, how(false, false)).data, [1.0, 2.0, 6.0, 24.0]);
        assert_eq!(cumulative_product(&x, 0, how(true, true)).data, [24.0, 12.0, 4.0, 1.0]);
        let terms = cumulative_product(&x.rounded(), 0, how(false, false)).terms();
        assert_eq!(terms.data, [0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn other_axes_stay_apart() {
        let x = Tensor::new(&[2, 2], vec![1.0, 2.0, 10.0, 20.0]);
        assert_eq!(cumulative_sum(&x, 0, Cumulative::default()).data, [1.0, 2.0, 11.0, 22.0]);
        assert_eq!(cumulative_sum(&x, 1, Cumulative::default()).data, [1.0, 3.0, 10.0, 30.0]);
    }
}

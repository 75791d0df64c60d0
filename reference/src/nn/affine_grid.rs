//! The points at which an affine map reads an image: the grid that [`grid_sample`](super::grid_sample()) takes.
//!
//! grid[n, …, k] = Σ_a θ[n, k, a]·p_a + θ[n, k, spatial], where p_a is the output pixel's coordinate in [−1, 1] along the axis a *from the
//! last*: x, y(, z). Pixel j of m lies at (2j + 1)/m − 1, or with `align_corners` at 2j/(m − 1) − 1 (a single pixel at 0, as in
//! PyTorch).
//!
//! Rounding: the coordinates' own (a division and a subtraction, or a running sum of steps as short as the axis), then a
//! dot product.

use super::{Scalar, Tensor};

/// θ \[N,2,3\] → \[N,H,W,2\], or θ \[N,3,4\] → \[N,D,H,W,3\], for an output of these spatial lengths.
///
/// # Panics
/// If θ does not fit the lengths.
///
/// # References
/// ONNX operator AffineGrid (version 20); PyTorch's affine_grid.
pub fn affine_grid<T: Scalar>(theta: &Tensor<T>, lengths: &[usize], align_corners: bool) -> Tensor<T> {
    let spatial = lengths.len();
    assert!(
        theta.rank() == 3 && theta.shape[1..] == [spatial, spatial + 1],
        "affine_grid: theta {:?} must be [N,{spatial},{}] for {lengths:?}",
        theta.shape,
        spatial + 1
    );
    let samples = theta.shape[0];
    let coordinate = |j: usize, length: usize| {
        let number = |value: usize| T::exact(value as f64);
        match length {
            1 => T::ZERO,
            _ if align_corners => number(2 * j) / number(length - 1) - number(1),
            _ => number(2 * j + 1) / number(length) - number(1),
        }
    };
    let points: Vec<Vec<T>> =
        lengths.iter().map(|&length| (0..length).map(|j| coordinate(j, length)).collect()).collect();
    let shape = [&[samples], lengths, &[spatial]].concat();
    Tensor::from_fn(&shape, |index| {
        let (n, k) = (index[0], index[spatial + 1]);
        let row = &theta.data[(n * spatial + k) * (spatial + 1)..][..spatial + 1];
        (0..spatial).fold(row[spatial], |sum, a| {
            let axis = spatial - 1 - a;
            sum.plus_product(row[a], points[axis][index[1 + axis]])
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::super::{GridSample, PaddingMode, SampleMode, grid_sample};
    use super::*;

    #[test]
    fn the_identity_reads_the_image_itself() {
        let x = pattern(&[1, 2, 3, 4], 1);
        let theta = Tensor::new(&[1, 2, 3], vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        for align_corners in [false, true] {
            let grid = affine_grid(&theta, &[3, 4], align_corners);
            let params = GridSample { mode: SampleMode::Linear, padding: PaddingMode::Zeros, align_corners };
            let y = grid_sample(&x, &grid, params);
            assert!(y.data.iter().zip(&x.data).all(|(y, x)| (y - x).abs() < 1e-13));
        }
    }

    #[test]
    fn the_first_column_of_the_map_belongs_to_the_last_axis() {
        let theta = Tensor::new(&[1, 2, 3], vec![1.0, 10.0, 100.0, 0.0, 0.0, 0.0]);
        let grid = affine_grid(&theta, &[2, 3], true);
        assert_eq!(grid.at(&[0, 0, 2, 0]), 100.0 + 1.0 - 10.0, "x = 1, y = −1");
    }
}

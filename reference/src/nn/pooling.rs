//! Max, average and length pooling in one, two and three dimensions.
//!
//! y[n, c, j] = max or mean over k of x[n, c, j·stride + k·dilation − padding]; padding is never the maximum, and enters
//! the mean as zeros only where asked for.
//!
//! # How many windows?
//! ⌊(n + padding − extent)/stride⌋ + 1; with `ceil_mode` ⌈·⌉ instead, so that a last window may hang over the end, but none
//! that would start in the padding after the image.
//!
//! `auto_pad` is a padding like any other ([`same_padding`](super::same_padding)); with it or VALID, `ceil_mode` changes nothing, since
//! ⌈(n − extent + 1)/stride⌉ is ⌊(n − extent)/stride⌋ + 1.
//!
//! Rounding: the maximum rounds nothing; the mean is a sum of its taps and a division (or a product with the reciprocal,
//! one rounding more).

use super::window::{Axis, axes, lift};
use super::{Scalar, Tensor, reduce_mean};

/// The window of a pooling: ONNX `kernel_shape`, `strides`, `pads` (here before and after, axis by axis), `dilations`, `ceil_mode`.
#[derive(Clone, Debug, PartialEq)]
pub struct Pool {
    /// Taps per spatial axis.
    pub kernel: Vec<usize>,
    /// Pixels between neighbouring outputs.
    pub stride: Vec<usize>,
    /// Pixels added before and after the image.
    pub padding: Vec<[usize; 2]>,
    /// Pixels between neighbouring taps.
    pub dilation: Vec<usize>,
    /// Whether a last window may hang over the end.
    pub ceil_mode: bool,
}

impl Pool {
    /// Cubic windows of this side, next to each other, for this many spatial axes.
    pub fn new(spatial: usize, side: usize) -> Pool {
        Pool {
            kernel: vec![side; spatial],
            stride: vec![side; spatial],
            padding: vec![[0, 0]; spatial],
            dilation: vec![1; spatial],
            ceil_mode: false,
        }
    }

    fn axes(&self, operator: &str, x: &[usize]) -> ([Axis; 3], Vec<usize>) {
        assert!(x.len() > 2, "{operator}: x must be [N,C,spatial…], found shape {x:?}");
        let axes = axes(operator, &x[2..], &self.kernel, &self.stride, &self.dilation, &self.padding);
        let size = axes[5 - x.len()..]
            .iter()
            .map(|axis| {
                assert!(
                    axis.padding[0] < axis.extent() && axis.padding[1] < axis.extent(),
                    "{operator}: padding {:?} leaves windows of extent {} without a pixel",
                    axis.padding,
                    axis.extent()
                );
                self.outputs(axis).unwrap_or_else(|| {
                    panic!("{operator}: the padded x {x:?} is smaller than the window {:?}", self.kernel)
                })
            })
            .collect();
        (axes, size)
    }

    fn outputs(&self, axis: &Axis) -> Option<usize> {
        let whole = axis.outputs()?;
        let hanging =
            !(axis.input + axis.padding[0] + axis.padding[1] - axis.extent()).is_multiple_of(axis.stride);
        let starts_inside = whole * axis.stride < axis.input + axis.padding[0];
        Some(whole + usize::from(self.ceil_mode && hanging && starts_inside))
    }
}

/// The window of an average pooling.
#[derive(Clone, Debug, PartialEq)]
pub struct AveragePool {
    /// Where the window lies.
    pub window: Pool,
    /// Whether taps in the padding count as zeros in the mean; taps beyond the padding (`ceil_mode`) never count.
    pub count_include_pad: bool,
}

/// x [N,C,…] → [N,C,…], the largest value in each window; a NaN wins.
///
/// # Panics
/// If the window does not fit the shape.
///
/// # References
/// ONNX operator MaxPool (versions 8, 10, 11, 12 and 22), its first output.
pub fn max_pool<T: Scalar>(x: &Tensor<T>, window: &Pool) -> Tensor<T> {
    let (axes, size) = window.axes("max_pool", &x.shape);
    pool(x, axes, &size, |image, taps, _| {
        taps.iter().map(|&tap| image[tap]).reduce(T::maximum).unwrap_or(T::exact(f64::NEG_INFINITY))
    })
}

/// Where [`max_pool`] found the largest values: their places in x's elements, of equal ones the first.
///
/// Row-major places count from the first element of x. Column-major ones (ONNX's `storage_order` 1) have the axes of an image in the
/// opposite order, the first spatial axis fastest; samples and channels stay where they are. A NaN is the largest; a
/// window without a pixel has place −1.
///
/// # Panics
/// As [`max_pool`].
///
/// # References
/// ONNX operator MaxPool (version 22), its second output.
pub fn max_pool_indices<T: Scalar>(x: &Tensor<T>, window: &Pool, column_major: bool) -> Tensor<i64> {
    let (axes, size) = window.axes("max_pool", &x.shape);
    let [depth, height, width] = axes.map(|axis| axis.input);
    let mut image_start = 0;
    let images = size.iter().product::<usize>().max(1);
    let mut counted = 0;
    pool(x, axes, &size, |image, taps, _| {
        let largest = taps.iter().copied().reduce(|best, tap| {
            let (old, new) = (image[best].value(), image[tap].value());
            if new > old || (new.is_nan() && !old.is_nan()) { tap } else { best }
        });
        let place = largest.map_or(-1, |tap| {
            let (z, y, x) = (tap / (height * width), tap / width % height, tap % width);
            let within = if column_major { z + depth * (y + height * x) } else { tap };
            (image_start + within) as i64
        });
        counted += 1;
        if counted % images == 0 {
            image_start += image.len();
        }
        place
    })
}

/// x [N,C,…] → [N,C,…], the mean of each window.
///
/// # Panics
/// If the window does not fit the shape.
///
/// # References
/// ONNX operator AveragePool (versions 7, 10, 11, 19 and 22).
pub fn average_pool<T: Scalar>(x: &Tensor<T>, params: &AveragePool) -> Tensor<T> {
    let (axes, size) = params.window.axes("average_pool", &x.shape);
    pool(x, axes, &size, |image, taps, padded| {
        let count = if params.count_include_pad { padded } else { taps.len() };
        mean_of(taps.iter().map(|&tap| image[tap]).fold(T::ZERO, T::plus), count)
    })
}

/// x [N,C,…] → [N,C,…], the length (Σ |x|^p)^{1/p} of each window; padding is zero.
///
/// # Panics
/// If the window does not fit the shape, or p is zero.
///
/// # References
/// ONNX operator LpPool (versions 2, 11, 18 and 22).
pub fn lp_pool<T: Scalar>(x: &Tensor<T>, window: &Pool, p: u32) -> Tensor<T> {
    let (axes, size) = window.axes("lp_pool", &x.shape);
    pool(x, axes, &size, |image, taps, _| length_of(taps.iter().map(|&tap| image[tap]), p))
}

/// x [N,C,…] → [N,C,1,…], the mean of each image over all its pixels.
///
/// # Panics
/// If x is not [N,C,…].
///
/// # References
/// ONNX operator GlobalAveragePool (version 1).
pub fn global_average_pool<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    assert!(x.rank() > 2, "global_average_pool: x must be [N,C,spatial…], found shape {:?}", x.shape);
    reduce_mean(x, &(2..x.rank()).collect::<Vec<_>>(), true)
}

/// x [N,C,…] → [N,C,1,…], the largest value of each image; a NaN wins.
///
/// # Panics
/// If x is not [N,C,…].
///
/// # References
/// ONNX operator GlobalMaxPool (version 1).
pub fn global_max_pool<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    of_images("global_max_pool", x, |image| {
        image.iter().copied().reduce(T::maximum).unwrap_or(T::exact(f64::NEG_INFINITY))
    })
}

/// x [N,C,…] → [N,C,1,…], the length (Σ |x|^p)^{1/p} of each image.
///
/// # Panics
/// If x is not [N,C,…], or p is zero.
///
/// # References
/// ONNX operator GlobalLpPool (version 2).
pub fn global_lp_pool<T: Scalar>(x: &Tensor<T>, p: u32) -> Tensor<T> {
    of_images("global_lp_pool", x, |image| length_of(image.iter().copied(), p))
}

fn of_images<T: Scalar>(operator: &str, x: &Tensor<T>, reduce: impl Fn(&[T]) -> T) -> Tensor<T> {
    assert!(x.rank() > 2, "{operator}: x must be [N,C,spatial…], found shape {:?}", x.shape);
    let pixels: usize = x.shape[2..].iter().product();
    let shape = [&x.shape[..2], &vec![1; x.rank() - 2]].concat();
    let images = x.shape[0] * x.shape[1];
    Tensor::new(&shape, (0..images).map(|i| reduce(&x.data[i * pixels..(i + 1) * pixels])).collect())
}

/// sum/count, however it is divided: fl(sum·fl(1/count)) has two roundings, fl(sum/count) one.
pub(super) fn mean_of<T: Scalar>(sum: T, count: usize) -> T {
    sum * (T::exact(1.0) / T::exact(count as f64))
}

/// (Σ |x|^p)^{1/p}.
///
/// Rounding: a power costs p − 1 products, or two units of a library's pow; so does the root, whose exponent 1/p is itself
/// rounded and moves the answer by |ln Σ|/p units.
fn length_of<T: Scalar>(values: impl Iterator<Item = T>, p: u32) -> T {
    assert!(p > 0, "lp_pool: p must be positive");
    let order = f64::from(p);
    let sum = values
        .map(|x| {
            let size = x.maximum(-x);
            let (power, slope) = (size.value().powi(p as i32), order * size.value().powi(p as i32 - 1));
            if p == 1 { size } else { size.function(power, slope, (order - 1.0).max(2.0)) }
        })
        .fold(T::ZERO, T::plus);
    match p {
        _ if sum.value() == 0.0 && sum.magnitude() == 0.0 => T::ZERO,
        1 => sum,
        2 => sum.sqrt(),
        _ => {
            let root = sum.value().powf(1.0 / order);
            sum.function(root, root / (order * sum.value()), 2.0 + sum.value().ln().abs() / order)
        }
    }
}

/// Apply `reduce` to an image, the places of the pixels under each window, and the number of its taps in the padded image.
fn pool<T: Scalar, U: Copy>(
    x: &Tensor<T>,
    axes: [Axis; 3],
    size: &[usize],
    mut reduce: impl FnMut(&[T], &[usize], usize) -> U,
) -> Tensor<U> {
    let mut y = Vec::with_capacity(x.shape[0] * x.shape[1] * size.iter().product::<usize>());
    let [az, ay, ax] = axes;
    let [depth, height, width] = lift(size, 1);
    let mut taps = Vec::new();
    for image in x.data.chunks_exact((az.input * ay.input * ax.input).max(1)) {
        for oz in 0..depth {
            for oy in 0..height {
                for ox in 0..width {
                    taps.clear();
                    for iz in (0..az.kernel).filter_map(|k| az.tap(oz, k)) {
                        for iy in (0..ay.kernel).filter_map(|k| ay.tap(oy, k)) {
                            let row = (iz * ay.input + iy) * ax.input;
                            taps.extend((0..ax.kernel).filter_map(|k| ax.tap(ox, k)).map(|ix| row + ix));
                        }
                    }
                    y.push(reduce(image, &taps, padded(&az, oz) * padded(&ay, oy) * padded(&ax, ox)));
                }
            }
        }
    }
    Tensor::new(&[&x.shape[..2], size].concat(), y)
}

/// Taps of output o within the image and its padding.
fn padded(axis: &Axis, o: usize) -> usize {
    let end = axis.padding[0] + axis.input + axis.padding[1];
    (0..axis.kernel).filter(|k| o * axis.stride + k * axis.dilation < end).count()
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::*;

    #[test]
    fn the_largest_of_each_block_survives() {
        let x = Tensor::from_fn(&[1, 1, 4, 4], |i| (4 * i[2] + i[3]) as f64);
        assert_eq!(max_pool(&x, &Pool::new(2, 2)).data, [5.0, 7.0, 13.0, 15.0]);
        let negative = x.map(|v| -v);
        let padded = Pool { padding: vec![[1, 1]; 2], ..Pool::new(2, 2) };
        assert_eq!(max_pool(&negative, &padded).data[0], 0.0);
        assert_eq!(max_pool(&negative, &padded).data[8], -15.0, "padding is never the maximum");
    }

    #[test]
    fn padding_enters_the_mean_only_where_asked_for() {
        let x = Tensor::new(&[1, 1, 3], vec![6.0, 6.0, 6.0]);
        let window = Pool { kernel: vec![3], stride: vec![1], padding: vec![[1, 1]], ..Pool::new(1, 1) };
        let with = |count_include_pad| {
            average_pool(&x, &AveragePool { window: window.clone(), count_include_pad }).data
        };
        assert_eq!(with(true), [4.0, 6.0, 4.0]);
        for mean in with(false) {
            assert!((mean - 6.0).abs() < 1e-14, "{mean}");
        }
    }

    #[test]
    fn no_window_starts_in_the_padding_after_the_image() {
        let ceil = |kernel, stride, padding| Pool {
            kernel: vec![kernel],
            stride: vec![stride],
            padding: vec![[padding; 2]],
            dilation: vec![1],
            ceil_mode: true,
        };
        let x = |n| Tensor::from_fn(&[1, 1, n], |i| i[2] as f64);
        assert_eq!(max_pool(&x(5), &ceil(2, 2, 0)).data, [1.0, 3.0, 4.0]);
        // ⌈(2 + 2 − 3)/3⌉ + 1 = 2 windows, but the second would start at pixel 2 of 2.
        assert_eq!(max_pool(&x(2), &ceil(3, 3, 1)).data, [1.0]);
    }

    #[test]
    fn the_place_of_the_maximum_is_the_first_of_equals_in_either_order() {
        let x = Tensor::new(&[1, 2, 2, 3], vec![1.0, 5.0, 5.0, 5.0, 0.0, 2.0, 7.0, 7.0, 9.0, 8.0, 9.0, 9.0]);
        let window = Pool { stride: vec![1, 1], ..Pool::new(2, 2) };
        assert_eq!(max_pool_indices(&x, &window, false).data, [1, 1, 10, 8]);
        assert_eq!(max_pool_indices(&x, &window, true).data, [2, 2, 9, 10], "row + 2·column of each image");
        let places = max_pool_indices(&x, &window, false);
        let values = max_pool(&x, &window);
        for (place, value) in places.data.iter().zip(&values.data) {
            assert_eq!(x.data[*place as usize], *value);
        }
    }

    #[test]
    fn lengths_of_windows_are_sums_roots_and_cubes() {
        let x = Tensor::new(&[1, 1, 4], vec![3.0, -4.0, 0.0, 2.0]);
        let window = Pool { kernel: vec![2], stride: vec![2], ..Pool::new(1, 2) };
        assert_eq!(lp_pool(&x, &window, 1).data, [7.0, 2.0]);
        assert_eq!(lp_pool(&x, &window, 2).data, [5.0, 2.0]);
        let cubes = lp_pool(&x, &window, 3).data;
        assert!((cubes[0] - 91_f64.cbrt()).abs() < 1e-14 && (cubes[1] - 2.0).abs() < 1e-14, "{cubes:?}");
        assert_eq!(global_lp_pool(&x, 2).data, [29_f64.sqrt()]);
        assert_eq!(global_max_pool(&x), Tensor::new(&[1, 1, 1], vec![3.0]));
        let zeros = Tensor::filled(&[1, 1, 4], 0.0).rounded();
        assert_eq!(lp_pool(&zeros, &window, 3).values().data, [0.0, 0.0]);
    }

    #[test]
    fn agrees_with_pytorch_in_two_and_three_dimensions() {
        let x = pattern(&[1, 2, 7, 6], 1);
        let window = Pool {
            kernel: vec![3, 2],
            stride: vec![2, 2],
            padding: vec![[1, 1], [1, 1]],
            dilation: vec![1, 1],
            ceil_mode: true,
        };
        check(&max_pool(&x, &window), &goldens::MAX_POOL_2D);
        for (count_include_pad, golden) in
            [(true, &goldens::AVERAGE_POOL_2D_PADDED), (false, &goldens::AVERAGE_POOL_2D)]
        {
            check(&average_pool(&x, &AveragePool { window: window.clone(), count_include_pad }), golden);
        }
        let x = pattern(&[1, 1, 5, 4, 6], 2);
        let dilated = Pool { dilation: vec![2, 1, 3], ceil_mode: false, ..Pool::new(3, 2) };
        check(&max_pool(&x, &dilated), &goldens::MAX_POOL_3D);
    }

    #[test]
    fn the_global_mean_is_the_mean_of_a_window_over_everything() {
        let x = pattern(&[2, 3, 4, 5], 3);
        let whole = Pool { kernel: vec![4, 5], ..Pool::new(2, 1) };
        let expected = average_pool(&x, &AveragePool { window: whole, count_include_pad: false });
        assert_eq!(global_average_pool(&x), expected);
        check(&global_average_pool(&x), &goldens::GLOBAL_AVERAGE_POOL);
    }

    #[test]
    fn a_mean_counts_its_additions_and_its_division() {
        let x = pattern(&[1, 1, 4, 4], 1).rounded();
        let mean = average_pool(&x, &AveragePool { window: Pool::new(2, 4), count_include_pad: true });
        assert_eq!(mean.terms().data, [15.0 + 2.0]);
        assert_eq!(max_pool(&x, &Pool::new(2, 2)).terms().data, [0.0; 4]);
    }
}

//! Regions of an image as small maps of one size, read at points between the pixels (RoIAlign) or from whole pixels
//! (RoIPool).
//!
//! A region (x₁, y₁, x₂, y₂) times `spatial_scale` is divided into output bins of (y₂ − y₁)/h by (x₂ − x₁)/w pixels. RoIAlign reads each
//! bin at a lattice of points p = start + bin·(j + (i + ½)/points) by linear interpolation and takes their mean, or the largest.
//!
//! # What is contested?
//! * Pixel k lies at k, so an image coordinate of pixel *corners* is half a pixel off: `half_pixel` subtracts ½ from the region's
//!   ends. Without it (the only form before opset 16) regions are at least one pixel wide.
//! * Points in (−1, 0) and (n − 1, n) are moved onto the border pixel; points further out are zero.
//! * The largest is taken over the four weighted pixels of each point, not over the interpolated points: ONNX's evaluator
//!   and ONNX Runtime agree on this.
//!
//! # Rounding
//! As of linear interpolation (see `interpolation`), and of a mean. How many points an adaptive lattice has is
//! ⌈bin⌉, a decision that rounding may turn where a bin is a whole number of pixels.

use super::interpolation::{Kernel, Stencil};
use super::pooling::mean_of;
use super::{Scalar, Tensor};

/// How regions are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoiAlign {
    /// Height and width of the output.
    pub output: [usize; 2],
    /// Points per bin and axis; 0 takes one per pixel of the bin, rounded up.
    pub sampling_ratio: usize,
    /// Pixels of x per unit of a region's coordinates.
    pub spatial_scale: f64,
    /// Whether half a pixel is subtracted from a region's ends.
    pub half_pixel: bool,
    /// Whether the largest is taken instead of the mean.
    pub largest: bool,
}

/// x \[N,C,H,W\], rois \[R,4\], the sample of each region \[R\] → \[R,C,h,w\].
///
/// # Panics
/// If the shapes do not fit, or a region's sample does not exist.
///
/// # References
/// ONNX operator RoiAlign (versions 10, 16 and 22); K. He et al., Mask R-CNN, ICCV 2017, §3.
pub fn roi_align<T: Scalar>(
    x: &Tensor<T>,
    rois: &Tensor<T>,
    samples: &Tensor<i64>,
    params: RoiAlign,
) -> Tensor<T> {
    let [n, channels, height, width] = x.shape[..] else {
        panic!("roi_align: x must be [N,C,H,W], found shape {:?}", x.shape)
    };
    let regions = samples.data.len();
    assert!(
        rois.shape == [regions, 4] && samples.rank() == 1,
        "roi_align: rois {:?} and batch_indices {:?} must be [R,4] and [R]",
        rois.shape,
        samples.shape
    );
    let mut data = Vec::new();
    for (&sample, roi) in samples.data.iter().zip(rois.data.chunks_exact(4)) {
        let sample = usize::try_from(sample).ok().filter(|&s| s < n);
        let sample = sample.unwrap_or_else(|| panic!("roi_align: batch index {sample:?} of x {:?}", x.shape));
        let rows = points([roi[1], roi[3]], height, params.output[0], params);
        let columns = points([roi[0], roi[2]], width, params.output[1], params);
        for c in 0..channels {
            let image = &x.data[(sample * channels + c) * height * width..][..height * width];
            for row in &rows {
                for column in &columns {
                    data.push(bin(image, width, row, column, params.largest));
                }
            }
        }
    }
    Tensor::new(&[&[regions, channels], &params.output[..]].concat(), data)
}

/// The points of each bin along one axis; `None` is a point outside the image.
fn points<T: Scalar>(
    ends: [T; 2],
    size: usize,
    bins: usize,
    params: RoiAlign,
) -> Vec<Vec<Option<(Stencil<T>, Vec<usize>)>>> {
    let number = |value: f64| T::exact(value);
    let [start, end] = ends.map(|end| {
        let scaled = if params.spatial_scale == 1.0 { end } else { end * number(params.spatial_scale) };
        if params.half_pixel { scaled - number(0.5) } else { scaled }
    });
    let length = if params.half_pixel { end - start } else { (end - start).maximum(number(1.0)) };
    let bin = length / number(bins as f64);
    let count = match params.sampling_ratio {
        0 => bin.value().ceil().max(0.0) as usize,
        count => count,
    };
    let point = |j: usize, i: usize| {
        let p = start + bin * (number(j as f64) + number(i as f64 + 0.5) / number(count as f64));
        (-1.0..=size as f64).contains(&p.value()).then(|| {
            let inside = T::within(p.value().clamp(0.0, size as f64 - 1.0), p.magnitude(), p.terms());
            let stencil = Stencil::new(Kernel::Linear, inside);
            let pixels = stencil.pixels(size).collect();
            (stencil, pixels)
        })
    };
    (0..bins).map(|j| (0..count).map(|i| point(j, i)).collect()).collect()
}

/// The mean or the largest over the points of one bin.
fn bin<T: Scalar>(
    image: &[T],
    width: usize,
    rows: &[Option<(Stencil<T>, Vec<usize>)>],
    columns: &[Option<(Stencil<T>, Vec<usize>)>],
    largest: bool,
) -> T {
    let mut readings = Vec::new();
    for row in rows {
        for column in columns {
            let (Some((vertical, ys)), Some((horizontal, xs))) = (row, column) else {
                readings.push(T::ZERO);
                continue;
            };
            if largest {
                let weighted = (1..3)
                    .flat_map(|i| (1..3).map(move |j| (i, j)))
                    .map(|(i, j)| vertical.weights[i] * horizontal.weights[j] * image[ys[i] * width + xs[j]]);
                readings.extend(weighted.reduce(T::maximum));
                continue;
            }
            let lines: Vec<T> = ys
                .iter()
                .map(|y| {
                    let values: Vec<T> = xs.iter().map(|x| image[y * width + x]).collect();
                    horizontal.blend(&values, 1.0)
                })
                .collect();
            readings.push(vertical.blend(&lines, 2.0));
        }
    }
    if largest {
        return readings.into_iter().reduce(T::maximum).unwrap_or(T::ZERO);
    }
    let count = readings.len().max(1);
    mean_of(readings.into_iter().fold(T::ZERO, T::plus), count)
}

/// x \[N,C,H,W\], rois \[R,5\] of (sample, x₁, y₁, x₂, y₂) → \[R,C,h,w\]: the largest pixel of each bin.
///
/// The ends of a region are whole pixels, round(roi·spatial_scale) with halves away from zero, *both included*: it is x₂ − x₁ + 1 wide, at
/// least 1. Bin j reaches from ⌊j·bin⌋ to ⌈(j + 1)·bin⌉, cut to the image; a bin without a pixel is zero.
///
/// # Panics
/// If the shapes do not fit, or a region's sample does not exist.
///
/// # References
/// ONNX operator MaxRoiPool (versions 1 and 22); R. Girshick, Fast R-CNN, ICCV 2015, §2.1, whose implementation has these
/// roundings.
pub fn max_roi_pool<T: Scalar>(
    x: &Tensor<T>,
    rois: &Tensor<T>,
    output: [usize; 2],
    spatial_scale: f64,
) -> Tensor<T> {
    let [n, channels, height, width] = x.shape[..] else {
        panic!("max_roi_pool: x must be [N,C,H,W], found shape {:?}", x.shape)
    };
    assert!(
        rois.rank() == 2 && rois.shape[1] == 5,
        "max_roi_pool: rois must be [R,5], found shape {:?}",
        rois.shape
    );
    let ranges = |start: T, end: T, size: usize, bins: usize| -> Vec<std::ops::Range<usize>> {
        let [start, end] = [start, end].map(|end| (end.value() * spatial_scale).round());
        let bin = (end - start + 1.0).max(1.0) / bins as f64;
        let place = |p: f64| (start + p).clamp(0.0, size as f64) as usize;
        (0..bins).map(|j| place((j as f64 * bin).floor())..place(((j + 1) as f64 * bin).ceil())).collect()
    };
    let mut data = Vec::new();
    for roi in rois.data.chunks_exact(5) {
        let sample = roi[0].value();
        assert!((0.0..n as f64).contains(&sample), "max_roi_pool: sample {sample} of x {:?}", x.shape);
        let rows = ranges(roi[2], roi[4], height, output[0]);
        let columns = ranges(roi[1], roi[3], width, output[1]);
        for c in 0..channels {
            let image = &x.data[(sample as usize * channels + c) * height * width..][..height * width];
            for row in &rows {
                for column in &columns {
                    let pixels = row.clone().flat_map(|y| column.clone().map(move |x| y * width + x));
                    data.push(pixels.map(|at| image[at]).reduce(T::maximum).unwrap_or(T::ZERO));
                }
            }
        }
    }
    Tensor::new(&[&[rois.shape[0], channels], &output[..]].concat(), data)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: RoiAlign =
        RoiAlign { output: [2, 2], sampling_ratio: 1, spatial_scale: 1.0, half_pixel: false, largest: false };

    /// A 4 × 4 image in which pixel (y, x) is 10y + x.
    fn ramp() -> Tensor {
        Tensor::from_fn(&[1, 1, 4, 4], |i| (10 * i[2] + i[3]) as f64)
    }

    #[test]
    fn a_ramp_is_read_at_the_middle_of_each_bin() {
        let roi = Tensor::new(&[1, 4], vec![0.0, 0.0, 2.0, 2.0]);
        let sample = Tensor::new(&[1], vec![0]);
        assert_eq!(roi_align(&ramp(), &roi, &sample, PLAIN).data, [5.5, 6.5, 15.5, 16.5]);
        let shifted = roi_align(&ramp(), &roi, &sample, RoiAlign { half_pixel: true, ..PLAIN });
        assert_eq!(shifted.data, [0.0, 1.0, 10.0, 11.0]);
        let adaptive =
            roi_align(&ramp(), &roi, &sample, RoiAlign { sampling_ratio: 0, spatial_scale: 1.5, ..PLAIN });
        assert_eq!(adaptive.data, [8.25, 9.75, 23.25, 24.75], "two points per bin of one and a half pixels");
    }

    #[test]
    fn outside_is_zero_but_for_a_pixel_around() {
        // Columns at −2½ and −½, rows at ½ and 1½.
        let roi = Tensor::new(&[1, 4], vec![-3.5, 0.0, 0.5, 2.0]);
        let y = roi_align(&ramp(), &roi, &Tensor::new(&[1], vec![0]), PLAIN);
        assert_eq!(y.data, [0.0, 5.0, 0.0, 15.0]);
    }

    #[test]
    fn a_pooled_region_includes_its_last_pixel() {
        let roi = Tensor::new(&[1, 5], vec![0.0, 0.0, 0.0, 1.0, 3.0]);
        assert_eq!(max_roi_pool(&ramp(), &roi, [2, 2], 1.0).data, [10.0, 11.0, 30.0, 31.0]);
        let small = Tensor::new(&[1, 5], vec![0.0, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(max_roi_pool(&ramp(), &small, [2, 2], 1.0).data, [11.0; 4], "bins share pixels");
    }
}

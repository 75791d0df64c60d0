//! Convolution (cross-correlation, as every network means it) in one, two and three dimensions.
//!
//! y[n, o, j] = b\[o\] + Σ_c Σ_k w[o, c, k]·x[n, c, j·stride + k·dilation − padding],  zero outside the image,
//!
//! where j and k have one component per spatial axis and c runs over the channels of o's group. A 1-D or 2-D convolution
//! is the 3-D one with flat leading axes, so one set of loops serves all.
//!
//! Rounding: a dot product of (taps in bounds)·(channels of a group) products and the bias.

use super::window::{Axis, axes, lift};
use super::{Scalar, Tensor};
use std::ops::Range;

/// How the kernel of a convolution moves: ONNX `strides`, `pads` (here before and after, axis by axis), `dilations`, `group`.
#[derive(Clone, Debug, PartialEq)]
pub struct Conv {
    /// Pixels between neighbouring outputs, per spatial axis.
    pub stride: Vec<usize>,
    /// Zeros before and after the image, per spatial axis.
    pub padding: Vec<[usize; 2]>,
    /// Pixels between neighbouring taps, per spatial axis.
    pub dilation: Vec<usize>,
    /// Number of groups; a group's outputs see only that group's inputs.
    pub groups: usize,
}

impl Conv {
    /// Stride 1, no padding, no dilation, one group, for this many spatial axes.
    pub fn new(spatial: usize) -> Conv {
        Conv {
            stride: vec![1; spatial],
            padding: vec![[0, 0]; spatial],
            dilation: vec![1; spatial],
            groups: 1,
        }
    }

    /// The same stride along every axis.
    pub fn stride(mut self, stride: usize) -> Conv {
        self.stride.fill(stride);
        self
    }

    /// The same zero padding on every side.
    pub fn padding(mut self, padding: usize) -> Conv {
        self.padding.fill([padding; 2]);
        self
    }

    /// The same dilation along every axis.
    pub fn dilation(mut self, dilation: usize) -> Conv {
        self.dilation.fill(dilation);
        self
    }

    /// This many groups.
    pub fn groups(mut self, groups: usize) -> Conv {
        self.groups = groups;
        self
    }
}

/// x [N,C,…] * w [O,C/groups,…] + bias \[O\] → [N,O,…] with 1 to 3 spatial axes.
///
/// # Panics
/// If the shapes do not fit each other, or the padded image is smaller than the kernel.
///
/// # References
/// ONNX operator Conv (versions 1, 11 and 22 agree) with explicit pads.
pub fn conv<T: Scalar>(x: &Tensor<T>, w: &Tensor<T>, bias: Option<&Tensor<T>>, conv: &Conv) -> Tensor<T> {
    let (xs, ws) = (&x.shape, &w.shape);
    assert!(xs.len() == ws.len() && xs.len() > 2, "conv: x {xs:?} and w {ws:?} must both be [·,·,spatial…]");
    let (samples, channels, outputs, per_group) = (xs[0], xs[1], ws[0], ws[1]);
    assert!(
        conv.groups > 0 && per_group * conv.groups == channels && outputs % conv.groups == 0,
        "conv: x {xs:?} has {channels} channels, w {ws:?} has {per_group} per group and {outputs} outputs, \
         {} groups do not fit",
        conv.groups
    );
    if let Some(b) = bias {
        assert!(b.shape == [outputs], "conv: bias has shape {:?}, w {ws:?} needs [{outputs}]", b.shape);
    }
    let axes = axes("conv", &xs[2..], &ws[2..], &conv.stride, &conv.dilation, &conv.padding);
    let size: Vec<usize> = axes[5 - xs.len()..]
        .iter()
        .map(|axis| {
            axis.outputs()
                .unwrap_or_else(|| panic!("conv: the padded x {xs:?} is smaller than the kernel of w {ws:?}"))
        })
        .collect();
    let mut y = Tensor::zeros(&[&[samples, outputs], &size[..]].concat());

    let [az, ay, ax] = axes;
    let [depth, height, width] = lift(&size, 1);
    let group_outputs = outputs / conv.groups;
    let reaches = Reach::of_taps(&ax, width);
    for n in 0..samples {
        for oz in 0..depth {
            for oy in 0..height {
                for o in 0..outputs {
                    let start = (((n * outputs + o) * depth + oz) * height + oy) * width;
                    let row = &mut y.data[start..start + width];
                    row.fill(bias.map_or(T::ZERO, |b| b.data[o]));
                    for c in 0..per_group {
                        let image = n * channels + o / group_outputs * per_group + c;
                        for kz in 0..az.kernel {
                            let Some(iz) = az.tap(oz, kz) else { continue };
                            for ky in 0..ay.kernel {
                                let Some(iy) = ay.tap(oy, ky) else { continue };
                                let taps =
                                    (((o * per_group + c) * az.kernel + kz) * ay.kernel + ky) * ax.kernel;
                                let pixels = ((image * az.input + iz) * ay.input + iy) * ax.input;
                                let (taps, pixels) =
                                    (&w.data[taps..taps + ax.kernel], &x.data[pixels..pixels + ax.input]);
                                add_row(row, taps, pixels, &reaches, ax.stride);
                            }
                        }
                    }
                }
            }
        }
    }
    y
}

/// Where tap k meets pixels of a row: outputs `reached`, the first of them at input pixel `first`.
struct Reach {
    reached: Range<usize>,
    first: usize,
}

impl Reach {
    fn of_taps(axis: &Axis, outputs: usize) -> Vec<Reach> {
        (0..axis.kernel)
            .map(|k| {
                let reached = axis.in_bounds(k, outputs);
                let first = (reached.start * axis.stride + k * axis.dilation).saturating_sub(axis.padding[0]);
                Reach { reached, first }
            })
            .collect()
    }
}

/// row[j] += Σ_k taps[k]·pixels[j·stride + k·dilation − padding] over the taps in bounds.
fn add_row<T: Scalar>(row: &mut [T], taps: &[T], pixels: &[T], reaches: &[Reach], stride: usize) {
    for (&tap, Reach { reached, first }) in taps.iter().zip(reaches) {
        let row = &mut row[reached.clone()];
        let pixels = pixels.get(*first..).unwrap_or_default();
        if stride == 1 {
            for (y, &x) in row.iter_mut().zip(pixels) {
                *y = y.plus_product(tap, x);
            }
        } else {
            for (y, &x) in row.iter_mut().zip(pixels.iter().step_by(stride)) {
                *y = y.plus_product(tap, x);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::*;

    #[test]
    fn a_kernel_is_not_flipped_and_padding_is_zero() {
        let x = Tensor::new(&[1, 1, 2, 2], vec![1.0, 2.0, 3.0, 4.0]);
        let w = Tensor::from_fn(&[1, 1, 3, 3], |i| (3 * i[2] + i[3]) as f64);
        // Top left output: taps (1,1) (1,2) (2,1) (2,2) = 4 5 7 8 meet the pixels 1 2 3 4.
        let y = conv(&x, &w, None, &Conv::new(2).padding(1));
        assert_eq!(y.data, [67.0, 57.0, 37.0, 27.0]);
    }

    #[test]
    fn the_centre_tap_is_the_identity() {
        let x = pattern(&[2, 1, 3, 4, 5], 1);
        let w = Tensor::from_fn(&[1, 1, 3, 3, 3], |i| f64::from(i[2..] == [1, 1, 1]));
        assert_eq!(conv(&x, &w, None, &Conv::new(3).padding(1)), x);
    }

    #[test]
    fn agrees_with_pytorch_in_one_two_and_three_dimensions() {
        let (x, w, b) = (pattern(&[2, 3, 7], 1), pattern(&[4, 3, 3], 2), pattern(&[4], 3));
        check(&conv(&x, &w, Some(&b), &Conv::new(1).padding(1).stride(2)), &goldens::CONV_1D);
        let (x, w, b) = (pattern(&[1, 4, 6, 5], 4), pattern(&[6, 2, 3, 2], 5), pattern(&[6], 6));
        let uneven =
            Conv { stride: vec![2, 1], padding: vec![[2, 2], [1, 1]], dilation: vec![2, 1], groups: 2 };
        check(&conv(&x, &w, Some(&b), &uneven), &goldens::CONV_2D);
        let (x, w) = (pattern(&[1, 2, 3, 4, 5], 7), pattern(&[2, 2, 3, 3, 3], 8));
        check(&conv(&x, &w, None, &Conv::new(3).padding(1)), &goldens::CONV_3D);
    }

    #[test]
    fn padding_may_differ_before_and_after() {
        let x = Tensor::new(&[1, 1, 3], vec![1.0, 2.0, 3.0]);
        let w = Tensor::new(&[1, 1, 2], vec![10.0, 1.0]);
        let uneven = Conv { padding: vec![[2, 0]], ..Conv::new(1) };
        assert_eq!(conv(&x, &w, None, &uneven).data, [0.0, 1.0, 12.0, 23.0]);
    }

    #[test]
    fn a_tap_that_meets_no_pixel_of_any_output_adds_nothing() {
        let (x, w) = (Tensor::new(&[1, 1, 1], vec![5.0]), Tensor::new(&[1, 1, 3], vec![100.0, 10.0, 1.0]));
        let params = Conv { padding: vec![[6, 0]], ..Conv::new(1).dilation(3) };
        assert_eq!(conv(&x, &w, None, &params).data, [5.0]);
    }

    #[test]
    fn magnitude_is_the_convolution_of_absolute_values_and_terms_count_the_taps() {
        let (x, w, b) = (pattern(&[1, 2, 4, 4], 1), pattern(&[3, 2, 3, 3], 2), pattern(&[3], 3));
        let params = Conv::new(2).padding(1);
        let rounded = conv(&x.rounded(), &w.rounded(), Some(&b.rounded()), &params);
        assert_eq!(rounded.values(), conv(&x, &w, Some(&b), &params));
        let abs = conv(&x.map(f64::abs), &w.map(f64::abs), Some(&b.map(f64::abs)), &params);
        assert_eq!(rounded.magnitudes(), abs);
        assert_eq!(rounded.terms().at(&[0, 0, 1, 1]), 2.0 * 9.0 + 1.0, "inside: every tap and the bias");
        assert_eq!(rounded.terms().at(&[0, 0, 0, 0]), 2.0 * 4.0 + 1.0, "in a corner: four taps of nine");
    }

    #[test]
    #[should_panic(expected = "x [1, 3, 4] has 3 channels, w [2, 2, 3] has 2 per group")]
    fn channels_must_fit() {
        conv(&pattern(&[1, 3, 4], 1), &pattern(&[2, 2, 3], 2), None, &Conv::new(1));
    }
}

//! Transposed convolution: the adjoint of [`conv`](super::conv()) in its input.
//!
//! A convolution reads input i = j·stride + k·dilation − padding into output j. The transpose sends every input pixel the
//! same way back:
//!
//! y[n, o, i·stride + k·dilation − padding] += w[c, o, k]·x[n, c, i],
//!
//! cut to an output of (n − 1)·stride + extent − padding + output_padding pixels. Read from the output, pixel
//! j gathers the taps for which j + padding − k·dilation is a multiple of the stride. Outputs with the same remainder
//! j mod stride, a *phase*, gather the same taps: along x the operator is `stride` ordinary convolutions, interleaved.
//!
//! Rounding: a dot product of (taps gathered)·(channels of a group) products and the bias.

use super::window::{Axis, axes, lift, shared};
use super::{Conv, Scalar, Tensor};

/// How the kernel of a transposed convolution moves: those of a [`Conv`], and the rows its output size leaves open.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvTranspose {
    /// The convolution of which this is the adjoint; its padding is cut from the output.
    pub conv: Conv,
    /// Extra pixels at the end of each spatial axis, for strides that lose them.
    pub output_padding: Vec<usize>,
}

impl ConvTranspose {
    /// Stride 1, no padding, no dilation, one group, for this many spatial axes.
    pub fn new(spatial: usize) -> ConvTranspose {
        ConvTranspose { conv: Conv::new(spatial), output_padding: vec![0; spatial] }
    }

    /// The same stride along every axis.
    pub fn stride(self, stride: usize) -> ConvTranspose {
        ConvTranspose { conv: self.conv.stride(stride), ..self }
    }

    /// The padding with which the output has this size: ONNX's `output_shape`, and `auto_pad` SAME with the size n·stride.
    ///
    /// (n − 1)·stride + output_padding + extent − size pixels are cut, an odd one at the end where `upper`, else at the
    /// beginning (since opset 11; the text of older ones has it the other way). Where the size is more than there is, pixels are added
    /// at the end.
    ///
    /// # Panics
    /// If an axis has no input, kernel or size.
    #[must_use]
    pub fn sized(mut self, input: &[usize], kernel: &[usize], size: &[usize], upper: bool) -> ConvTranspose {
        let Conv { stride, padding, dilation, .. } = &mut self.conv;
        padding.fill([0, 0]);
        let all = axes("conv_transpose", input, kernel, stride, dilation, padding);
        for (a, axis) in all[3 - input.len()..].iter().enumerate() {
            let full = axis.input.saturating_sub(1) * axis.stride + axis.extent() + self.output_padding[a];
            padding[a] = shared(full.saturating_sub(size[a]), upper);
            self.output_padding[a] += size[a].saturating_sub(full);
        }
        self
    }

    /// The same padding cut from every side of the output.
    pub fn padding(self, padding: usize) -> ConvTranspose {
        ConvTranspose { conv: self.conv.padding(padding), ..self }
    }
}

/// x [N,C,…], w [C,O/groups,…], bias \[O\] → [N,O,…] with 1 to 3 spatial axes.
///
/// # Panics
/// If the shapes do not fit each other, or the padding cuts the whole output away.
///
/// # References
/// ONNX operator ConvTranspose (versions 1, 11 and 22 agree) with explicit pads and output_padding.
pub fn conv_transpose<T: Scalar>(
    x: &Tensor<T>,
    w: &Tensor<T>,
    bias: Option<&Tensor<T>>,
    params: &ConvTranspose,
) -> Tensor<T> {
    let (xs, ws, groups) = (&x.shape, &w.shape, params.conv.groups);
    assert!(
        xs.len() == ws.len() && xs.len() > 2 && xs[1] == ws[0],
        "conv_transpose: x {xs:?} must be [N,C,spatial…] and w {ws:?} [C,O/groups,spatial…]"
    );
    let (samples, channels, per_group) = (xs[0], xs[1], ws[1]);
    assert!(
        groups > 0 && channels % groups == 0,
        "conv_transpose: {groups} groups do not divide the {channels} channels of x {xs:?}"
    );
    let (group_channels, outputs) = (channels / groups, per_group * groups);
    if let Some(b) = bias {
        assert!(
            b.shape == [outputs],
            "conv_transpose: bias has shape {:?}, w {ws:?} needs [{outputs}]",
            b.shape
        );
    }
    let Conv { stride, padding, dilation, .. } = &params.conv;
    assert!(
        params.output_padding.len() == xs.len() - 2,
        "conv_transpose: output_padding {:?} must have one number per spatial axis of x {xs:?}",
        params.output_padding
    );
    let [az, ay, ax] = axes("conv_transpose", &xs[2..], &ws[2..], stride, dilation, padding);
    let [depth, height, width] = {
        let axes = [az, ay, ax];
        let extra = lift(&params.output_padding, 0);
        std::array::from_fn(|a| {
            output_size(&axes[a], extra[a]).unwrap_or_else(|| {
                panic!("conv_transpose: padding {padding:?} cuts all of the output of x {xs:?}")
            })
        })
    };
    let size = &[depth, height, width][5 - xs.len()..];
    let mut y = Tensor::zeros(&[&[samples, outputs], size].concat());
    let phases: Vec<Vec<Shift>> =
        (0..ax.stride.min(width)).map(|phase| Shift::of_phase(&ax, phase)).collect();

    for n in 0..samples {
        for oz in 0..depth {
            for oy in 0..height {
                for o in 0..outputs {
                    let start = (((n * outputs + o) * depth + oz) * height + oy) * width;
                    let row = &mut y.data[start..start + width];
                    let bias = bias.map_or(T::ZERO, |b| b.data[o]);
                    for (phase, shifts) in phases.iter().enumerate() {
                        let mut sums = vec![bias; (width - phase).div_ceil(ax.stride)];
                        for c in o / per_group * group_channels..(o / per_group + 1) * group_channels {
                            for kz in 0..az.kernel {
                                let Some(iz) = source(&az, oz, kz) else { continue };
                                for ky in 0..ay.kernel {
                                    let Some(iy) = source(&ay, oy, ky) else { continue };
                                    let kernel = (c * per_group + o % per_group) * az.kernel + kz;
                                    let taps = (kernel * ay.kernel + ky) * ax.kernel;
                                    let pixels =
                                        (((n * channels + c) * az.input + iz) * ay.input + iy) * ax.input;
                                    let (taps, pixels) =
                                        (&w.data[taps..taps + ax.kernel], &x.data[pixels..pixels + ax.input]);
                                    add_phase(&mut sums, taps, pixels, shifts);
                                }
                            }
                        }
                        for (y, sum) in row[phase..].iter_mut().step_by(ax.stride).zip(sums) {
                            *y = sum;
                        }
                    }
                }
            }
        }
    }
    y
}

/// (n − 1)·stride + extent + output_padding − padding, if that is at least one pixel.
fn output_size(axis: &Axis, output_padding: usize) -> Option<usize> {
    let full = axis.input.checked_sub(1)? * axis.stride + axis.extent() + output_padding;
    full.checked_sub(axis.padding[0] + axis.padding[1]).filter(|&size| size > 0)
}

/// The input pixel i that tap k sends to output j: i·stride = j + padding − k·dilation.
fn source(axis: &Axis, j: usize, k: usize) -> Option<usize> {
    let steps = (j + axis.padding[0]).checked_sub(k * axis.dilation)?;
    (steps % axis.stride == 0).then_some(steps / axis.stride).filter(|&i| i < axis.input)
}

/// A tap of one phase of a row: output phase + q·stride gathers it from pixel q − first_sum + first_pixel.
struct Shift {
    tap: usize,
    first_sum: usize,
    first_pixel: usize,
}

impl Shift {
    /// The taps with i·stride = phase + q·stride + padding − k·dilation for whole i.
    fn of_phase(axis: &Axis, phase: usize) -> Vec<Shift> {
        let forward = phase + axis.padding[0];
        (0..axis.kernel)
            .filter(|k| forward % axis.stride == k * axis.dilation % axis.stride)
            .map(|tap| {
                let back = tap * axis.dilation;
                Shift {
                    tap,
                    first_sum: back.saturating_sub(forward) / axis.stride,
                    first_pixel: forward.saturating_sub(back) / axis.stride,
                }
            })
            .collect()
    }
}

/// sums[q] += Σ_k taps[k]·pixels[i], i = q + const for each tap, for the outputs of one phase of a row.
fn add_phase<T: Scalar>(sums: &mut [T], taps: &[T], pixels: &[T], shifts: &[Shift]) {
    for shift in shifts {
        let tap = taps[shift.tap];
        let sums = sums.get_mut(shift.first_sum..).unwrap_or_default();
        for (sum, &x) in sums.iter_mut().zip(pixels.get(shift.first_pixel..).unwrap_or_default()) {
            *sum = sum.plus_product(tap, x);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::*;

    #[test]
    fn every_pixel_paints_its_kernel() {
        let x = Tensor::new(&[1, 1, 3], vec![1.0, 10.0, 100.0]);
        let w = Tensor::new(&[1, 1, 3], vec![1.0, 2.0, 3.0]);
        let y = conv_transpose(&x, &w, None, &ConvTranspose::new(1).stride(2));
        assert_eq!(y.data, [1.0, 2.0, 13.0, 20.0, 130.0, 200.0, 300.0]);
        let cut = conv_transpose(&x, &w, None, &ConvTranspose::new(1).stride(2).padding(1));
        assert_eq!(cut.data, [2.0, 13.0, 20.0, 130.0, 200.0]);
    }

    #[test]
    fn stride_two_with_kernel_four_doubles_the_side() {
        let y = conv_transpose(
            &pattern(&[1, 2, 3, 5], 1),
            &pattern(&[2, 3, 4, 4], 2),
            None,
            &ConvTranspose::new(2).stride(2).padding(1),
        );
        assert_eq!(y.shape, [1, 3, 6, 10]);
    }

    #[test]
    fn a_size_that_is_asked_for_is_cut_or_filled() {
        let (x, w) =
            (Tensor::new(&[1, 1, 3], vec![1.0, 10.0, 100.0]), Tensor::new(&[1, 1, 3], vec![1.0, 2.0, 3.0]));
        let sized = |size, upper| {
            conv_transpose(&x, &w, None, &ConvTranspose::new(1).stride(2).sized(&[3], &[3], &[size], upper))
                .data
        };
        assert_eq!(sized(6, true), [1.0, 2.0, 13.0, 20.0, 130.0, 200.0]);
        assert_eq!(sized(6, false), [2.0, 13.0, 20.0, 130.0, 200.0, 300.0]);
        assert_eq!(sized(8, false), [1.0, 2.0, 13.0, 20.0, 130.0, 200.0, 300.0, 0.0]);
    }

    #[test]
    fn agrees_with_pytorch_in_two_and_three_dimensions() {
        let (x, w, b) = (pattern(&[1, 4, 3, 4], 1), pattern(&[4, 2, 3, 4], 2), pattern(&[4], 3));
        let uneven = ConvTranspose {
            conv: Conv { stride: vec![2, 3], padding: vec![[1, 1], [2, 2]], dilation: vec![1, 2], groups: 2 },
            output_padding: vec![1, 2],
        };
        check(&conv_transpose(&x, &w, Some(&b), &uneven), &goldens::CONV_TRANSPOSE_2D);
        let (x, w) = (pattern(&[1, 2, 2, 3, 2], 4), pattern(&[2, 1, 4, 4, 4], 5));
        let double = ConvTranspose::new(3).stride(2).padding(1);
        check(&conv_transpose(&x, &w, None, &double), &goldens::CONV_TRANSPOSE_3D);
    }

    #[test]
    fn terms_count_the_taps_gathered() {
        let (x, w) = (pattern(&[1, 2, 4], 1).rounded(), pattern(&[2, 1, 4], 2).rounded());
        let y = conv_transpose(&x, &w, None, &ConvTranspose::new(1).stride(2).padding(1));
        assert_eq!(y.terms().data, [2.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 2.0]);
    }

    #[test]
    #[should_panic(expected = "x [1, 3, 4] must be [N,C,spatial…] and w [2, 3, 3]")]
    fn channels_must_fit() {
        conv_transpose(&pattern(&[1, 3, 4], 1), &pattern(&[2, 3, 3], 2), None, &ConvTranspose::new(1));
    }
}

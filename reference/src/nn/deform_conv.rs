//! Deformable convolution: each tap reads the image beside its place, by an offset that is itself an operand.
//!
//! y[n, o, j] = b\[o\] + Σ_c Σ_k w[o, c, k]·mask[n, g, k, j]·x[n, c](j·stride + k·dilation − padding + offset[n, g, k, ·, j]),
//!
//! x read by linear interpolation, zero outside; g is the offset group of channel c. Offsets come axis by axis, *rows first* (y, x), the
//! opposite of a sampling grid.
//!
//! Rounding: a sum of products of interpolated values; the places' own rounding is one addition.

use super::grid_sample::Reader;
use super::tensor::advance;
use super::window::axes;
use super::{Conv, GridSample, PaddingMode, SampleMode, Scalar, Tensor};

/// x [N,C,…] * w [O,C/groups,…] at offsets [N, offset_groups·Πkernel·spatial, …], with a mask [N, offset_groups·Πkernel, …] of the taps'
/// weights → [N,O,…].
///
/// # Panics
/// If the shapes do not fit each other.
///
/// # References
/// ONNX operator DeformConv (versions 19 and 22); X. Zhu et al., Deformable ConvNets v2, CVPR 2019.
pub fn deform_conv<T: Scalar>(
    x: &Tensor<T>,
    w: &Tensor<T>,
    offset: &Tensor<T>,
    bias: Option<&Tensor<T>>,
    mask: Option<&Tensor<T>>,
    window: &Conv,
    offset_groups: usize,
) -> Tensor<T> {
    let spatial = x.rank().saturating_sub(2);
    assert!(
        spatial > 0 && w.rank() == x.rank() && offset.rank() == x.rank(),
        "deform_conv: x {:?}, w {:?} and offset {:?} must be [·,·,spatial…]",
        x.shape,
        w.shape,
        offset.shape
    );
    let (samples, channels, outputs) = (x.shape[0], x.shape[1], w.shape[0]);
    let (per_group, kernel, size) = (w.shape[1], &w.shape[2..], &x.shape[2..]);
    let taps: usize = kernel.iter().product();
    let all = axes("deform_conv", size, kernel, &window.stride, &window.dilation, &window.padding);
    let windows: Vec<usize> = all[3 - spatial..].iter().map(|axis| axis.outputs().unwrap_or(0)).collect();
    let groups = window.groups;
    assert!(
        groups > 0
            && offset_groups > 0
            && per_group * groups == channels
            && outputs % groups == 0
            && channels % offset_groups == 0
            && offset.shape == [&[samples, offset_groups * taps * spatial], &windows[..]].concat(),
        "deform_conv: x {:?}, w {:?}, offset {:?} do not fit {groups} groups, {offset_groups} offset groups and \
         {windows:?} windows",
        x.shape,
        w.shape,
        offset.shape
    );
    if let Some(mask) = mask {
        let expected = [&[samples, offset_groups * taps], &windows[..]].concat();
        assert!(mask.shape == expected, "deform_conv: mask {:?}, expected {expected:?}", mask.shape);
    }
    if let Some(b) = bias {
        assert!(b.shape == [outputs], "deform_conv: bias has shape {:?}, w needs [{outputs}]", b.shape);
    }
    let (pixels, places) = (size.iter().product::<usize>(), windows.iter().product::<usize>());
    let linear = GridSample { mode: SampleMode::Linear, padding: PaddingMode::Zeros, align_corners: true };
    let mut y = Tensor::<T>::zeros(&[&[samples, outputs], &windows[..]].concat());
    for n in 0..samples {
        let mut j = vec![0; spatial];
        for place in 0..places {
            let mut sums: Vec<T> = (0..outputs).map(|o| bias.map_or(T::ZERO, |b| b.data[o])).collect();
            for g in 0..offset_groups {
                let mut k = vec![0; spatial];
                for tap in 0..taps {
                    let group_tap = (n * offset_groups + g) * taps + tap;
                    let point: Vec<T> = (0..spatial)
                        .map(|a| {
                            let axis = &all[3 - spatial + a];
                            let at =
                                (j[a] * axis.stride + k[a] * axis.dilation) as f64 - axis.padding[0] as f64;
                            T::exact(at) + offset.data[(group_tap * spatial + a) * places + place]
                        })
                        .collect();
                    let reader = Reader::new(&point, size, linear);
                    let per_offset_group = channels / offset_groups;
                    for c in g * per_offset_group..(g + 1) * per_offset_group {
                        let value = reader.read(&x.data[(n * channels + c) * pixels..][..pixels]);
                        let value = mask.map_or(value, |mask| value * mask.data[group_tap * places + place]);
                        let (group, within) = (c / per_group, c % per_group);
                        let per_output_group = outputs / groups;
                        for o in group * per_output_group..(group + 1) * per_output_group {
                            let weight = w.data[(o * per_group + within) * taps + tap];
                            sums[o] = sums[o].plus_product(weight, value);
                        }
                    }
                    advance(&mut k, kernel);
                }
            }
            for (o, sum) in sums.into_iter().enumerate() {
                y.data[(n * outputs + o) * places + place] = sum;
            }
            advance(&mut j, &windows);
        }
    }
    y
}

#[cfg(test)]
mod tests {
    use super::super::conv;
    use super::super::goldens::pattern;
    use super::*;

    #[test]
    fn without_offsets_it_is_a_convolution() {
        let (x, w, b) = (pattern(&[2, 4, 5, 6], 1), pattern(&[6, 2, 3, 2], 2), pattern(&[6], 3));
        let window =
            Conv { stride: vec![2, 1], padding: vec![[1, 1], [0, 1]], dilation: vec![1, 2], groups: 2 };
        let expected = conv(&x, &w, Some(&b), &window);
        let offset = Tensor::zeros(&[2, 2 * 6 * 2, expected.shape[2], expected.shape[3]]);
        let y = deform_conv(&x, &w, &offset, Some(&b), None, &window, 2);
        assert_eq!(y.shape, expected.shape);
        assert!(y.data.iter().zip(&expected.data).all(|(y, e)| (y - e).abs() < 1e-14));
    }

    #[test]
    fn offsets_are_rows_first_and_a_mask_weighs_the_taps() {
        let x = Tensor::from_fn(&[1, 1, 3, 4], |i| (10 * i[2] + i[3]) as f64);
        let w = Tensor::filled(&[1, 1, 1, 1], 1.0);
        let mut offset = Tensor::zeros(&[1, 2, 3, 4]);
        offset.data[0] = 1.0;
        offset.data[12] = 0.5;
        let mut mask = Tensor::filled(&[1, 1, 3, 4], 1.0);
        mask.data[1] = 3.0;
        let y = deform_conv(&x, &w, &offset, None, Some(&mask), &Conv::new(2), 1);
        assert_eq!(
            y.data[..3],
            [10.5, 3.0, 2.0],
            "a row down and half a column on; three times 1; untouched"
        );
    }
}

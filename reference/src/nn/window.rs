//! The geometry of a sliding window along one axis: which input pixel a tap meets.
//!
//! Output o and tap k of a window meet input i = o·stride + k·dilation − padding, if that lies in [0, n).

use std::ops::Range;

/// One spatial axis of a convolution or a pooling.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    pub input: usize,
    pub kernel: usize,
    pub stride: usize,
    pub dilation: usize,
    /// Zeros before the first and after the last pixel.
    pub padding: [usize; 2],
}

/// The axis that 1-D and 2-D operators lack: one pixel under a window of one pixel.
const FLAT: Axis = Axis { input: 1, kernel: 1, stride: 1, dilation: 1, padding: [0, 0] };

impl Axis {
    /// Pixels that the window spans: (kernel − 1)·dilation + 1.
    pub fn extent(&self) -> usize {
        (self.kernel - 1) * self.dilation + 1
    }

    /// The number of whole windows: ⌊(n + padding − extent)/stride⌋ + 1.
    pub fn outputs(&self) -> Option<usize> {
        let room = (self.input + self.padding[0] + self.padding[1]).checked_sub(self.extent())?;
        Some(room / self.stride + 1)
    }

    /// The input pixel that tap k of output o meets, if it is not padding.
    pub fn tap(&self, o: usize, k: usize) -> Option<usize> {
        (o * self.stride + k * self.dilation).checked_sub(self.padding[0]).filter(|&i| i < self.input)
    }

    /// The outputs of `0..outputs` whose tap k meets an input pixel: 0 ≤ o·stride + k·dilation − padding < n.
    pub fn in_bounds(&self, k: usize, outputs: usize) -> Range<usize> {
        let shift = k * self.dilation;
        let first = self.padding[0].saturating_sub(shift).div_ceil(self.stride).min(outputs);
        let end = (self.input + self.padding[0]).saturating_sub(shift).div_ceil(self.stride).min(outputs);
        first..end.max(first)
    }
}

/// The padding by which windows a stride apart give ⌈n/stride⌉ outputs per axis: ONNX's `auto_pad` SAME_UPPER and SAME_LOWER.
///
/// max(0, (⌈n/stride⌉ − 1)·stride + extent − n) zeros, shared evenly between the two ends; an odd one goes to the
/// end where `upper`, else to the beginning.
///
/// # Panics
/// If the parameters do not give every axis a kernel, stride and dilation, or one is zero.
pub fn same_padding(
    input: &[usize],
    kernel: &[usize],
    stride: &[usize],
    dilation: &[usize],
    upper: bool,
) -> Vec<[usize; 2]> {
    let explicit = vec![[0, 0]; input.len()];
    let all = axes("same_padding", input, kernel, stride, dilation, &explicit);
    all[3 - input.len()..]
        .iter()
        .map(|axis| {
            let span = (axis.input.div_ceil(axis.stride)).saturating_sub(1) * axis.stride + axis.extent();
            shared(span.saturating_sub(axis.input), upper)
        })
        .collect()
}

/// A total shared between two ends; an odd one goes to the second where `upper`.
pub(super) fn shared(total: usize, upper: bool) -> [usize; 2] {
    let (less, more) = (total / 2, total - total / 2);
    if upper { [less, more] } else { [more, less] }
}

/// A value per spatial axis seen as three: the axes that a 1-D or 2-D operator lacks are flat and lead.
pub(super) fn lift<A: Copy>(values: &[A], flat: A) -> [A; 3] {
    let mut lifted = [flat; 3];
    lifted[3 - values.len()..].copy_from_slice(values);
    lifted
}

/// The spatial axes of a 1-D, 2-D or 3-D operator as three.
///
/// # Panics
/// If the parameters do not give every axis a kernel, stride, dilation and padding, or a stride is zero.
pub(super) fn axes(
    operator: &str,
    input: &[usize],
    kernel: &[usize],
    stride: &[usize],
    dilation: &[usize],
    padding: &[[usize; 2]],
) -> [Axis; 3] {
    let rank = input.len();
    assert!((1..=3).contains(&rank), "{operator}: 1 to 3 spatial axes are supported, found shape {input:?}");
    let given = [kernel.len(), stride.len(), dilation.len(), padding.len()];
    assert!(
        given.iter().all(|&n| n == rank),
        "{operator}: {rank} spatial axes {input:?} need kernel {kernel:?}, stride {stride:?}, dilation {dilation:?} and \
         padding {padding:?} of the same length"
    );
    assert!(
        [kernel, stride, dilation].iter().all(|values| values.iter().all(|&v| v > 0)),
        "{operator}: kernel {kernel:?}, stride {stride:?} and dilation {dilation:?} must be positive"
    );
    let axes: Vec<Axis> = (0..rank)
        .map(|a| Axis {
            input: input[a],
            kernel: kernel[a],
            stride: stride[a],
            dilation: dilation[a],
            padding: padding[a],
        })
        .collect();
    lift(&axes, FLAT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_padding_gives_an_output_per_stride_and_its_odd_zero_to_one_end() {
        assert_eq!(same_padding(&[5, 5], &[3, 2], &[1, 1], &[1, 1], true), [[1, 1], [0, 1]]);
        assert_eq!(same_padding(&[5, 5], &[3, 2], &[1, 1], &[1, 1], false), [[1, 1], [1, 0]]);
        for (input, kernel, stride, dilation) in [(7, 3, 2, 1), (8, 3, 2, 2), (9, 1, 4, 1), (5, 4, 3, 3)] {
            let [padding] = same_padding(&[input], &[kernel], &[stride], &[dilation], true)[..] else {
                panic!()
            };
            let axis = Axis { input, kernel, stride, dilation, padding };
            assert_eq!(axis.outputs(), Some(input.div_ceil(stride)), "{axis:?}");
        }
    }

    #[test]
    fn the_outputs_in_bounds_are_those_whose_tap_meets_a_pixel() {
        for (input, kernel, stride, dilation, padding) in [
            (5, 3, 1, 1, [1, 1]),
            (7, 3, 2, 2, [0, 3]),
            (4, 4, 3, 1, [2, 2]),
            (2, 5, 1, 3, [9, 9]),
            (6, 2, 2, 1, [0, 0]),
        ] {
            let axis = Axis { input, kernel, stride, dilation, padding };
            let outputs = axis.outputs().expect("the window fits");
            for k in 0..kernel {
                let by_tap: Vec<usize> = (0..outputs).filter(|&o| axis.tap(o, k).is_some()).collect();
                let by_range: Vec<usize> = axis.in_bounds(k, outputs).collect();
                assert_eq!(by_range, by_tap, "{axis:?} tap {k}");
            }
        }
    }
}

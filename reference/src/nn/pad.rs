//! Padding and cropping: a tensor with elements added to or taken from the ends of its axes.
//!
//! Along an axis of n elements, output i stands at k = i − before of the input. Beyond 0 … n − 1 lies
//!
//! ```text
//! constant       reflect         edge           wrap
//! c c|0 1 2|c    2 1|0 1 2|1     0 0|0 1 2|2    1 2|0 1 2|0
//! ```
//!
//! Reflection does not repeat the border (period 2(n − 1)) and goes on as often as needed, as in NumPy; a single element reflects
//! to itself. Negative amounts take elements away; the others at the same axis are unchanged by that.

use super::Tensor;

/// What lies beyond the ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PadMode {
    /// A constant.
    Constant,
    /// The tensor mirrored on its first and last elements.
    Reflect,
    /// The first or last element.
    Edge,
    /// The tensor again, as on a torus.
    Wrap,
}

/// The tensor with `amounts[axis]` = [before, after] elements more at the ends of each axis.
///
/// # Panics
/// If there are not as many amounts as axes, more is taken from an axis than it has, or something other than a constant is
/// added to an axis without elements.
///
/// # References
/// ONNX operator Pad (versions 2, 11, 13, 18, 19 and newer); wrap since 19.
pub fn pad<T: Copy>(x: &Tensor<T>, amounts: &[[i64; 2]], mode: PadMode, constant: T) -> Tensor<T> {
    assert!(amounts.len() == x.rank(), "pad: {} pairs of amounts for shape {:?}", amounts.len(), x.shape);
    let shape: Vec<usize> = x
        .shape
        .iter()
        .zip(amounts)
        .map(|(&n, &[before, after])| {
            let length = n as i64 + before + after;
            assert!(
                length >= 0,
                "pad: [{before}, {after}] takes more than there is from shape {:?}",
                x.shape
            );
            length as usize
        })
        .collect();
    let places: Vec<Vec<Option<usize>>> = shape
        .iter()
        .zip(&x.shape)
        .zip(amounts)
        .map(|((&length, &n), &[before, _])| {
            assert!(
                n > 0 || length == 0 || mode == PadMode::Constant,
                "pad: an axis of shape {:?} has nothing to repeat",
                x.shape
            );
            (0..length as i64).map(|i| source(i - before, n as i64, mode)).collect()
        })
        .collect();
    let strides = x.strides();
    Tensor::from_fn(&shape, |index| {
        let offset =
            (0..index.len()).try_fold(0, |offset, a| Some(offset + places[a][index[a]]? * strides[a]));
        offset.map_or(constant, |offset| x.data[offset])
    })
}

/// The element of an axis of n that stands at k; `None` is the constant.
fn source(k: i64, n: i64, mode: PadMode) -> Option<usize> {
    if (0..n).contains(&k) {
        return Some(k as usize);
    }
    match mode {
        PadMode::Constant => None,
        PadMode::Edge => Some(k.clamp(0, n - 1) as usize),
        PadMode::Wrap => Some(k.rem_euclid(n) as usize),
        PadMode::Reflect => {
            let period = 2 * (n - 1).max(1);
            let folded = k.rem_euclid(period);
            Some(folded.min(period - folded).min(n - 1) as usize)
        }
    }
}

/// The middle of the tensor, or the tensor in the middle of zeros, so that axis a has `lengths[a]` elements.
///
/// Where the difference is odd, a crop begins earlier and a pad has its odd element at the end.
///
/// # Panics
/// If there are not as many lengths as axes.
///
/// # References
/// ONNX operator CenterCropPad (version 18).
pub fn center_crop_pad<T: Copy>(x: &Tensor<T>, lengths: &[usize], zero: T) -> Tensor<T> {
    let amounts: Vec<[i64; 2]> = x
        .shape
        .iter()
        .zip(lengths)
        .map(|(&n, &length)| {
            let more = length as i64 - n as i64;
            // Division towards zero takes and gives the smaller half first.
            [more / 2, more - more / 2]
        })
        .collect();
    pad(x, &amounts, PadMode::Constant, zero)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn padded(mode: PadMode, before: i64, after: i64) -> Vec<i32> {
        pad(&Tensor::new(&[3], vec![0, 1, 2]), &[[before, after]], mode, 9).data
    }

    #[test]
    fn beyond_the_ends_lies_what_the_mode_says() {
        assert_eq!(padded(PadMode::Constant, 2, 1), [9, 9, 0, 1, 2, 9]);
        assert_eq!(padded(PadMode::Reflect, 2, 1), [2, 1, 0, 1, 2, 1]);
        assert_eq!(padded(PadMode::Edge, 2, 1), [0, 0, 0, 1, 2, 2]);
        assert_eq!(padded(PadMode::Wrap, 2, 1), [1, 2, 0, 1, 2, 0]);
    }

    #[test]
    fn reflection_and_wrapping_go_on_as_often_as_needed() {
        assert_eq!(padded(PadMode::Reflect, 5, 3), [1, 0, 1, 2, 1, 0, 1, 2, 1, 0, 1]);
        assert_eq!(padded(PadMode::Wrap, 4, 4), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0]);
        assert_eq!(pad(&Tensor::new(&[1], vec![7]), &[[2, 1]], PadMode::Reflect, 0).data, [7; 4]);
    }

    #[test]
    fn negative_amounts_take_away() {
        assert_eq!(padded(PadMode::Constant, -1, 2), [1, 2, 9, 9]);
        assert_eq!(padded(PadMode::Edge, 1, -2), [0, 0]);
        assert_eq!(padded(PadMode::Constant, -3, 0), [0; 0]);
    }

    #[test]
    fn axes_are_padded_independently() {
        let x = Tensor::new(&[2, 2], vec![1, 2, 3, 4]);
        assert_eq!(pad(&x, &[[1, 0], [0, 1]], PadMode::Reflect, 0).data, [3, 4, 3, 1, 2, 1, 3, 4, 3]);
    }

    #[test]
    fn the_centre_is_cropped_early_and_padded_late() {
        let x = Tensor::new(&[5], vec![1, 2, 3, 4, 5]);
        assert_eq!(center_crop_pad(&x, &[2], 0).data, [2, 3]);
        assert_eq!(center_crop_pad(&x, &[8], 0).data, [0, 1, 2, 3, 4, 5, 0, 0]);
    }

    #[test]
    #[should_panic(expected = "[-2, -2] takes more than there is from shape [3]")]
    fn no_more_is_taken_than_there_is() {
        padded(PadMode::Constant, -2, -2);
    }
}

//! Columns to an image: the adjoint of cutting an image into overlapping blocks.
//!
//! Block l, at window position o of a sliding window, adds its pixel k to the image at o·stride + k·dilation − padding; what falls
//! outside is dropped. Where blocks overlap they add up.
//!
//! Rounding: a sum of as many terms as blocks meet in the pixel.

use super::window::axes;
use super::{Conv, Scalar, Tensor};

/// x [N, C·Πblock, L] → [N,C,…] of the image's lengths, the L blocks in row-major order of their positions.
///
/// # Panics
/// If the channels are no whole blocks, or L is not the number of windows.
///
/// # References
/// ONNX operator Col2Im (version 18); PyTorch's fold.
pub fn col2im<T: Scalar>(x: &Tensor<T>, image: &[usize], block: &[usize], window: &Conv) -> Tensor<T> {
    let [samples, depth, columns] = x.shape[..] else {
        panic!("col2im: x must be [N,C·block,L], found shape {:?}", x.shape)
    };
    let taps: usize = block.iter().product();
    assert!(
        taps > 0 && depth % taps == 0,
        "col2im: {depth} channels of x {:?} are no whole blocks {block:?}",
        x.shape
    );
    let all = axes("col2im", image, block, &window.stride, &window.dilation, &window.padding);
    let positions = all.map(|axis| axis.outputs().unwrap_or(0));
    assert!(
        positions.iter().product::<usize>() == columns,
        "col2im: x {:?} has {columns} blocks, the image {image:?} {positions:?}",
        x.shape
    );
    let channels = depth / taps;
    let [az, ay, ax] = all;
    let pixels = az.input * ay.input * ax.input;
    let mut y = Tensor::<T>::zeros(&[&[samples, channels], image].concat());
    for map in 0..samples * channels {
        let target = &mut y.data[map * pixels..(map + 1) * pixels];
        for tap in 0..taps {
            let row = &x.data[(map * taps + tap) * columns..][..columns];
            let (kz, ky, kx) = (tap / (ay.kernel * ax.kernel), tap / ax.kernel % ay.kernel, tap % ax.kernel);
            for (l, &value) in row.iter().enumerate() {
                let (oz, oy, ox) =
                    (l / (positions[1] * positions[2]), l / positions[2] % positions[1], l % positions[2]);
                let place = (az.tap(oz, kz), ay.tap(oy, ky), ax.tap(ox, kx));
                if let (Some(iz), Some(iy), Some(ix)) = place {
                    let pixel = &mut target[(iz * ay.input + iy) * ax.input + ix];
                    *pixel = pixel.plus(value);
                }
            }
        }
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_that_overlap_add_up_and_padding_is_dropped() {
        // Windows of 2 at positions −1…0, 0…1, 1…2, 2…3 over three pixels; every block pixel is one.
        let x = Tensor::filled(&[1, 2, 4], 1.0);
        let y = col2im(&x, &[3], &[2], &Conv::new(1).padding(1));
        assert_eq!(y.data, [2.0, 2.0, 2.0]);
        let apart =
            col2im(&Tensor::new(&[1, 2, 2], vec![1.0, 2.0, 3.0, 4.0]), &[4], &[2], &Conv::new(1).stride(2));
        assert_eq!(apart.data, [1.0, 3.0, 2.0, 4.0], "channels are places in the block");
    }

    #[test]
    #[should_panic(expected = "x [1, 2, 3] has 3 blocks")]
    fn there_must_be_a_column_per_window() {
        col2im(&Tensor::<f64>::zeros(&[1, 2, 3]), &[3], &[2], &Conv::new(1));
    }
}

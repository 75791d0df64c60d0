//! Blocks of pixels to channels and back: rearrangements that compute nothing.
//!
//! With blocks of side s, channel c of C·s² and pixel (y, x) of the small map are the pixel (s·y + i, s·x + j) of the large
//! one, where
//!
//! | order | channel of the small map |
//! |---|---|
//! | depth–column–row (DCR) | (i·s + j)·C + c: the place in the block is outermost |
//! | column–row–depth (CRD) | c·s² + i·s + j: the place is innermost, PyTorch's pixel_shuffle |

use super::{Tensor, transpose};

/// How the place in a block and the channel make up a channel of the small map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockOrder {
    /// Depth–column–row.
    Dcr,
    /// Column–row–depth.
    Crd,
}

/// x \[N,C·s²,H,W\] → \[N,C,H·s,W·s\].
///
/// # Panics
/// If x is not such a map.
///
/// # References
/// ONNX operator DepthToSpace (versions 1, 11 and 13; version 1 is DCR).
pub fn depth_to_space<T: Copy>(x: &Tensor<T>, side: usize, order: BlockOrder) -> Tensor<T> {
    let [n, depth, h, w] = x.shape[..] else {
        panic!("depth_to_space: x must be [N,C,H,W], found shape {:?}", x.shape)
    };
    let block = side * side;
    assert!(
        block > 0 && depth % block == 0,
        "depth_to_space: {depth} channels of x {:?} are no whole blocks of {side}×{side}",
        x.shape
    );
    let c = depth / block;
    let y = match order {
        BlockOrder::Dcr => transpose(&x.reshape(&[n, side, side, c, h, w]), &[0, 3, 4, 1, 5, 2]),
        BlockOrder::Crd => transpose(&x.reshape(&[n, c, side, side, h, w]), &[0, 1, 4, 2, 5, 3]),
    };
    y.reshape(&[n, c, h * side, w * side])
}

/// x \[N,C,H·s,W·s\] → \[N,C·s²,H,W\].
///
/// # Panics
/// If x is not such a map.
///
/// # References
/// ONNX operator SpaceToDepth (versions 1 and 13, which is DCR; an order can be given since 28).
pub fn space_to_depth<T: Copy>(x: &Tensor<T>, side: usize, order: BlockOrder) -> Tensor<T> {
    let [n, c, height, width] = x.shape[..] else {
        panic!("space_to_depth: x must be [N,C,H,W], found shape {:?}", x.shape)
    };
    assert!(
        side > 0 && height % side == 0 && width % side == 0,
        "space_to_depth: x {:?} is not made of whole blocks of {side}×{side}",
        x.shape
    );
    let (h, w) = (height / side, width / side);
    let axes = match order {
        BlockOrder::Dcr => [0, 3, 5, 1, 2, 4],
        BlockOrder::Crd => [0, 1, 3, 5, 2, 4],
    };
    transpose(&x.reshape(&[n, c, h, side, w, side]), &axes).reshape(&[n, c * side * side, h, w])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_orders_differ_in_what_is_innermost() {
        // Channel k of eight holds the number k; two channels of 2×2 blocks.
        let x = Tensor::new(&[1, 8, 1, 1], (0..8).collect());
        assert_eq!(depth_to_space(&x, 2, BlockOrder::Dcr).data, [0, 2, 4, 6, 1, 3, 5, 7]);
        assert_eq!(depth_to_space(&x, 2, BlockOrder::Crd).data, [0, 1, 2, 3, 4, 5, 6, 7]);
    }

    #[test]
    fn there_and_back_is_the_identity() {
        let x = Tensor::new(&[2, 3, 4, 6], (0..144).collect());
        for order in [BlockOrder::Dcr, BlockOrder::Crd] {
            let there = space_to_depth(&x, 2, order);
            assert_eq!(there.shape, [2, 12, 2, 3]);
            assert_eq!(depth_to_space(&there, 2, order), x, "{order:?}");
        }
    }
}

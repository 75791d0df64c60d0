//! Changes that several families make.

use crate::array::Array;
use crate::onnx::message::NodeProto;

pub(super) fn renamed(mut node: NodeProto, operator: &str) -> NodeProto {
    node.op_type = Some(operator.into());
    node
}

/// Slices along an axis in another order.
pub(super) fn slices(x: &Array, axis: usize, order: &[usize]) -> Array {
    let inner: usize = x.shape[axis + 1..].iter().product();
    let blocks = x.values.chunks_exact(inner * x.shape[axis]);
    let values = blocks
        .flat_map(|block| order.iter().flat_map(|&i| block[i * inner..(i + 1) * inner].iter().copied()));
    let values = values.collect();
    let mut shape = x.shape.clone();
    shape[axis] = order.len();
    Array { shape, values }
}

pub(super) fn flipped(x: &Array, axis: usize) -> Array {
    slices(x, axis, &(0..x.shape[axis]).rev().collect::<Vec<_>>())
}

pub(super) fn as_f16(x: f32) -> f32 {
    half::f16::from_f32(x).to_f32()
}

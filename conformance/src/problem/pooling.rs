//! MaxPool in two and three dimensions, and ReduceMean.

use proptest::prelude::*;
use vitruvian_reference::nn::Tensor;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::{int, ints};

/// Kernel, stride, what the paddings are drawn from, and pixels beyond the kernel.
type Axis = (usize, usize, [usize; 2], usize);

/// x [N,C,…]: the largest of each window, with this many spatial axes.
pub fn max_pool(spatial: usize) -> impl Strategy<Value = Problem> {
    let extra = if spatial == 2 { 0..=12_usize } else { 0..=5 };
    let axis = (1..=3_usize, 1..=3_usize, any::<[usize; 2]>(), extra);
    (1..=2_usize, 1..=6_usize, prop::collection::vec(axis, spatial), any::<Values>()).prop_map(
        |(samples, channels, axes, x)| {
            let all = |of: fn(&Axis) -> usize| axes.iter().map(of).collect::<Vec<_>>();
            // Paddings below the kernel's side, so that every window holds a pixel.
            let before = all(|axis| axis.2[0] % axis.0);
            let after = all(|axis| axis.2[1] % axis.0);
            let size = all(|axis| axis.0 + axis.3);
            Problem {
                operator: "MaxPool",
                attributes: vec![
                    ints("kernel_shape", &all(|axis| axis.0)),
                    ints("strides", &all(|axis| axis.1)),
                    ints("pads", &[before, after].concat()),
                ],
                operands: vec![Operand::Input(x.fill(&[vec![samples, channels], size].concat()))],
            }
        },
    )
}

/// The mean over one or two axes, as over the views of a capture.
pub fn reduce_mean() -> impl Strategy<Value = Problem> {
    let sides = prop::collection::vec(1..=12_usize, 2..=4);
    (sides, any::<[prop::sample::Index; 2]>(), any::<bool>(), any::<Values>()).prop_map(
        |(sides, axes, keepdims, x)| {
            let mut axes: Vec<i64> = axes.iter().map(|axis| axis.index(sides.len()) as i64).collect();
            axes.sort_unstable();
            axes.dedup();
            Problem {
                operator: "ReduceMean",
                attributes: vec![int("keepdims", keepdims.into())],
                operands: vec![
                    Operand::Input(x.fill(&sides)),
                    Operand::Integers(Tensor::new(&[axes.len()], axes)),
                ],
            }
        },
    )
}

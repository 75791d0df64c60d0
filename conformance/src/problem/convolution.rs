//! Conv in one, two and three dimensions and ConvTranspose in two and three.
//!
//! In one dimension with a kernel of one, a Conv is a layer of a point network.

use proptest::prelude::*;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::{int, ints};
use crate::onnx::message::AttributeProto;

/// Stride, dilation and padding of one axis under a kernel.
#[derive(Clone, Copy, Debug)]
struct Axis {
    kernel: usize,
    stride: usize,
    dilation: usize,
    before: usize,
    after: usize,
}

impl Axis {
    fn extent(self) -> usize {
        (self.kernel - 1) * self.dilation + 1
    }
}

fn attributes(axes: &[Axis], groups: usize) -> Vec<AttributeProto> {
    let all = |of: fn(&Axis) -> usize| axes.iter().map(of).collect::<Vec<_>>();
    vec![
        ints("kernel_shape", &all(|axis| axis.kernel)),
        ints("strides", &all(|axis| axis.stride)),
        ints("dilations", &all(|axis| axis.dilation)),
        // ONNX wants all paddings before, then all after.
        ints("pads", &[all(|axis| axis.before), all(|axis| axis.after)].concat()),
        int("group", groups as i64),
    ]
}

fn operands(
    x: (&[usize], Values),
    w: (&[usize], Values),
    bias: Option<Values>,
    outputs: usize,
) -> Vec<Operand> {
    let mut operands = vec![Operand::Input(x.1.fill(x.0)), Operand::Weight(w.1.fill(w.0))];
    operands.extend(bias.map(|bias| Operand::Weight(bias.fill(&[outputs]))));
    operands
}

/// x [N,C,…] * w [O,C/groups,…] + bias \[O\], with this many spatial axes.
pub fn conv(spatial: usize) -> impl Strategy<Value = Problem> {
    // In 1-D kernel 1 is frequent and channels are many (a point network), in 3-D everything is small.
    let (channels, extra, kernel) = match spatial {
        1 => (1..=96_usize, 0..=40_usize, 1..=3_usize),
        2 => (1..=12, 0..=9, 1..=7),
        _ => (1..=10, 0..=5, 1..=3),
    };
    let axis = (kernel, 1..=2_usize, 1..=3_usize, 0..=3_usize, 0..=3_usize, extra);
    let axes = prop::collection::vec(axis, spatial);
    let sizes = (1..=2_usize, channels.clone(), channels, 1..=2_usize);
    (sizes, axes, any::<Values>(), any::<Values>(), prop::option::of(any::<Values>())).prop_map(
        |((samples, inputs, outputs, groups), drawn, x, w, bias)| {
            let axes: Vec<_> = drawn
                .iter()
                .map(|&(kernel, dilation, stride, before, after, _)| Axis {
                    kernel,
                    stride,
                    dilation,
                    before,
                    after,
                })
                .collect();
            // At least one pixel, and at least one window.
            let size = axes
                .iter()
                .zip(&drawn)
                .map(|(axis, drawn)| axis.extent().saturating_sub(axis.before + axis.after).max(1) + drawn.5);
            let x_shape = [vec![samples, inputs * groups], size.collect()].concat();
            let kernel = axes.iter().map(|axis| axis.kernel).collect();
            let w_shape = [vec![outputs * groups, inputs], kernel].concat();
            Problem {
                operator: "Conv",
                attributes: attributes(&axes, groups),
                operands: operands((&x_shape, x), (&w_shape, w), bias, outputs * groups),
            }
        },
    )
}

/// x [N,C,…] transposed with w [C,O/groups,…] + bias \[O\], with this many spatial axes.
pub fn conv_transpose(spatial: usize) -> impl Strategy<Value = Problem> {
    let (channels, side, kernel) = match spatial {
        2 => (1..=12_usize, 1..=9_usize, 1..=5_usize),
        _ => (1..=8, 1..=5, 1..=4),
    };
    let axis = (kernel, 1..=2_usize, 1..=3_usize, side, any::<[usize; 3]>());
    let axes = prop::collection::vec(axis, spatial);
    let sizes = (1..=2_usize, channels.clone(), channels, 1..=2_usize);
    (sizes, axes, any::<Values>(), any::<Values>(), prop::option::of(any::<Values>())).prop_map(
        |((samples, inputs, outputs, groups), drawn, x, w, bias)| {
            let (mut axes, mut output_padding) = (Vec::new(), Vec::new());
            for &(kernel, dilation, stride, side, [before, after, extra]) in &drawn {
                // What is cut is less than the kernel's extent, as exporters write it, and leaves a pixel.
                let mut axis = Axis { kernel, stride, dilation, before: 0, after: 0 };
                axis.before = before % axis.extent();
                let room = (side - 1) * stride + axis.extent() - 1 - axis.before;
                axis.after = after % axis.extent().min(room + 1);
                axes.push(axis);
                output_padding.push(extra % stride);
            }
            let size = drawn.iter().map(|axis| axis.3).collect();
            let x_shape = [vec![samples, inputs * groups], size].concat();
            let kernel = axes.iter().map(|axis| axis.kernel).collect();
            let w_shape = [vec![inputs * groups, outputs], kernel].concat();
            let mut attributes = attributes(&axes, groups);
            attributes.push(ints("output_padding", &output_padding));
            Problem {
                operator: "ConvTranspose",
                attributes,
                operands: operands((&x_shape, x), (&w_shape, w), bias, outputs * groups),
            }
        },
    )
}

/// A convolution like those of the networks, on ordinary numbers: the ground on which faults are planted.
pub fn ordinary_conv(spatial: usize, channels: usize) -> impl Strategy<Value = Problem> {
    let side = if spatial == 2 { 12_usize } else { 6 };
    any::<[u64; 3]>().prop_map(move |seeds| {
        let axes = vec![Axis { kernel: 3, stride: 1, dilation: 1, before: 1, after: 1 }; spatial];
        let [x, w, bias] = seeds.map(Values::ordinary);
        let x_shape = [vec![1, channels], vec![side; spatial]].concat();
        let w_shape = [vec![8, channels], vec![3; spatial]].concat();
        let operands = operands((&x_shape, x), (&w_shape, w), Some(bias), 8);
        Problem { operator: "Conv", attributes: attributes(&axes, 1), operands }
    })
}

/// A doubling transposed convolution like those of the networks, on ordinary numbers.
pub fn ordinary_conv_transpose() -> impl Strategy<Value = Problem> {
    any::<[u64; 3]>().prop_map(|seeds| {
        let axes = vec![Axis { kernel: 4, stride: 2, dilation: 1, before: 1, after: 1 }; 2];
        let [x, w, bias] = seeds.map(Values::ordinary);
        let operands = operands((&[1, 32, 8, 8], x), (&[32, 8, 4, 4], w), Some(bias), 8);
        Problem { operator: "ConvTranspose", attributes: attributes(&axes, 1), operands }
    })
}

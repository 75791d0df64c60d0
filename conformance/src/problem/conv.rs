//! Conv in one, two and three dimensions; in one dimension with a kernel of one it is the layer of a point network.

use proptest::prelude::*;
use vitruvian_reference::nn::{Conv, Rounded, Tensor, conv};

use super::values::Values;
use super::{Problem, Task, exact};
use crate::array::Array;
use crate::onnx::builder::{GraphBuilder, int, ints};

/// x [N,C,…] * w [O,C/groups,…] + bias [O].
#[derive(Clone, Debug)]
pub struct ConvProblem {
    /// Input.
    pub x: Array,
    /// Kernels.
    pub w: Array,
    /// One number per output channel, or none.
    pub bias: Option<Array>,
    /// Stride, padding, dilation and groups.
    pub conv: Conv,
}

impl ConvProblem {
    /// A problem with this many spatial axes, random in everything else.
    pub fn strategy(spatial: usize) -> impl Strategy<Value = Self> {
        // In 1-D kernel 1 dominates and channels are many (a point network), in 3-D everything is small.
        let (channels, extra, kernel) = match spatial {
            1 => (1..=96_usize, 0..=40_usize, 1..=3_usize),
            2 => (1..=12, 0..=9, 1..=7),
            _ => (1..=10, 0..=5, 1..=3),
        };
        let axis = (kernel, 1..=2_usize, 1..=3_usize, 0..=3_usize, 0..=3_usize, extra);
        let axes = prop::collection::vec(axis, spatial);
        let sizes = (1..=2_usize, channels.clone(), channels, 1..=2_usize);
        (sizes, axes, any::<Values>(), any::<Values>(), prop::option::of(any::<Values>())).prop_map(
            |((samples, inputs, outputs, groups), axes, x, w, bias)| {
                let kernel: Vec<_> = axes.iter().map(|axis| axis.0).collect();
                let padding: Vec<_> = axes.iter().map(|axis| [axis.3, axis.4]).collect();
                let conv = Conv {
                    dilation: axes.iter().map(|axis| axis.1).collect(),
                    stride: axes.iter().map(|axis| axis.2).collect(),
                    padding,
                    groups,
                };
                // At least one pixel, and at least one window.
                let size = axes.iter().map(|&(kernel, dilation, _, before, after, extra)| {
                    ((kernel - 1) * dilation + 1).saturating_sub(before + after).max(1) + extra
                });
                let x = x.fill(&[vec![samples, inputs * groups], size.collect()].concat());
                let w = w.fill(&[vec![outputs * groups, inputs], kernel].concat());
                let bias = bias.map(|bias| bias.fill(&[outputs * groups]));
                Self { x, w, bias, conv }
            },
        )
    }
}

/// The attributes that Conv and ConvTranspose share.
pub(super) fn attributes(conv: &Conv, kernel: &[usize]) -> Vec<crate::onnx::message::AttributeProto> {
    // ONNX wants all paddings before, then all after.
    let (before, after): (Vec<_>, Vec<_>) =
        conv.padding.iter().map(|&[before, after]| (before, after)).unzip();
    vec![
        ints("kernel_shape", kernel),
        ints("strides", &conv.stride),
        ints("dilations", &conv.dilation),
        ints("pads", &[before, after].concat()),
        int("group", conv.groups as i64),
    ]
}

impl Problem for ConvProblem {
    fn operator(&self) -> &'static str {
        "Conv"
    }

    fn reference(&self) -> Tensor<Rounded> {
        conv(&exact(&self.x), &exact(&self.w), self.bias.as_ref().map(exact).as_ref(), &self.conv)
    }

    fn task(&self) -> Task {
        let graph =
            GraphBuilder::new(20).input("x", &self.x.shape).constant("w", &self.w.shape, &self.w.values);
        let attributes = attributes(&self.conv, &self.w.shape[2..]);
        let graph = match &self.bias {
            Some(bias) => graph.constant("b", &bias.shape, &bias.values).node(
                "Conv",
                &["x", "w", "b"],
                &["y"],
                attributes,
            ),
            None => graph.node("Conv", &["x", "w"], &["y"], attributes),
        };
        Task { graph: graph.output("y"), inputs: vec![("x", self.x.clone())] }
    }
}

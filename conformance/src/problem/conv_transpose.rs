//! ConvTranspose in two and three dimensions.

use proptest::prelude::*;
use vitruvian_reference::nn::{Conv, ConvTranspose, Rounded, Tensor, conv_transpose};

use super::conv::attributes;
use super::values::Values;
use super::{Problem, Task, exact};
use crate::array::Array;
use crate::onnx::builder::{GraphBuilder, ints};

/// x [N,C,…] transposed with w [C,O/groups,…] + bias [O].
#[derive(Clone, Debug)]
pub struct ConvTransposeProblem {
    /// Input.
    pub x: Array,
    /// Kernels.
    pub w: Array,
    /// One number per output channel, or none.
    pub bias: Option<Array>,
    /// Stride, padding, dilation, groups and output padding.
    pub params: ConvTranspose,
}

impl ConvTransposeProblem {
    /// A problem with this many spatial axes, random in everything else.
    pub fn strategy(spatial: usize) -> impl Strategy<Value = Self> {
        let (channels, side, kernel) = match spatial {
            2 => (1..=12_usize, 1..=9_usize, 1..=5_usize),
            _ => (1..=8, 1..=5, 1..=4),
        };
        // Kernel, dilation, stride, input side, and what is cut or added as it fits.
        let axis = (kernel, 1..=2_usize, 1..=3_usize, side, any::<[usize; 3]>());
        let axes = prop::collection::vec(axis, spatial);
        let sizes = (1..=2_usize, channels.clone(), channels, 1..=2_usize);
        (sizes, axes, any::<Values>(), any::<Values>(), prop::option::of(any::<Values>())).prop_map(
            |((samples, inputs, outputs, groups), axes, x, w, bias)| {
                let kernel: Vec<_> = axes.iter().map(|axis| axis.0).collect();
                let size: Vec<_> = axes.iter().map(|axis| axis.3).collect();
                let mut conv = Conv { groups, ..Conv::new(axes.len()) };
                let mut output_padding = Vec::new();
                for (a, &(kernel, dilation, stride, side, [before, after, extra])) in axes.iter().enumerate()
                {
                    (conv.dilation[a], conv.stride[a]) = (dilation, stride);
                    // Less than the extent, as exporters write it, and at least one pixel of output stays.
                    let extent = (kernel - 1) * dilation + 1;
                    let before = before % extent;
                    let room = (side - 1) * stride + extent - 1 - before;
                    conv.padding[a] = [before, after % extent.min(room + 1)];
                    output_padding.push(extra % stride);
                }
                Self {
                    x: x.fill(&[vec![samples, inputs * groups], size].concat()),
                    w: w.fill(&[vec![inputs * groups, outputs], kernel].concat()),
                    bias: bias.map(|bias| bias.fill(&[outputs * groups])),
                    params: ConvTranspose { conv, output_padding },
                }
            },
        )
    }
}

impl Problem for ConvTransposeProblem {
    fn operator(&self) -> &'static str {
        "ConvTranspose"
    }

    fn reference(&self) -> Tensor<Rounded> {
        conv_transpose(&exact(&self.x), &exact(&self.w), self.bias.as_ref().map(exact).as_ref(), &self.params)
    }

    fn task(&self) -> Task {
        let mut attributes = attributes(&self.params.conv, &self.w.shape[2..]);
        attributes.push(ints("output_padding", &self.params.output_padding));
        let graph =
            GraphBuilder::new(20).input("x", &self.x.shape).constant("w", &self.w.shape, &self.w.values);
        let graph = match &self.bias {
            Some(bias) => {
                let graph = graph.constant("b", &bias.shape, &bias.values);
                graph.node("ConvTranspose", &["x", "w", "b"], &["y"], attributes)
            }
            None => graph.node("ConvTranspose", &["x", "w"], &["y"], attributes),
        };
        Task { graph: graph.output("y"), inputs: vec![("x", self.x.clone())] }
    }
}

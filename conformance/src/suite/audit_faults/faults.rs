//! The mistakes that are planted, and the name that each must be given.

use std::sync::Arc;

use super::scenes::{Scene, bytes, drawn, images, lists, maps, tokens, volumes, wide};
use crate::array::Array;
use crate::audit::party::{Held, Tensors};
use crate::onnx::builder::{float, int, ints, text};
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// A mistake in one node.
pub struct Fault {
    /// What is wrong.
    pub name: &'static str,
    /// The name that the hypothesis engine must give it.
    pub hypothesis: &'static str,
    /// The graph.
    pub scene: fn() -> Scene,
    /// The output of the node in which the mistake is made.
    pub output: &'static str,
    plant: Plant,
}

/// How a mistake is made.
enum Plant {
    /// The node has other attributes.
    Attributes(fn() -> Vec<AttributeProto>),
    /// The node is another.
    Node(fn(NodeProto) -> NodeProto),
    /// An operand is another.
    Operand(usize, fn(Array) -> Array),
    /// An operand is another, and so are attributes.
    Both(usize, fn(Array) -> Array, fn() -> Vec<AttributeProto>),
    /// All operands that are numbers are other numbers.
    Numbers(fn(f32) -> f32),
    /// The output is another.
    Output(fn(Array) -> Array),
    /// The output is made of the operands, not by the node.
    Made(fn(Vec<Array>) -> Array),
    /// The output is another tensor's.
    Stale(&'static str),
}

impl Fault {
    /// The node as the engine reads it.
    pub(super) fn change_node(&self, node: NodeProto) -> NodeProto {
        let with = |new: Vec<AttributeProto>| {
            let mut node = node.clone();
            node.attribute.retain(|old| new.iter().all(|new| new.name != old.name));
            node.attribute.extend(new);
            node
        };
        match self.plant {
            Plant::Attributes(attributes) | Plant::Both(_, _, attributes) => with(attributes()),
            Plant::Node(change) => change(node),
            _ => node,
        }
    }

    /// The operands as the engine has them at the node.
    pub(super) fn change_operands(&self, node: &NodeProto, held: &mut Tensors) {
        let mut change = |name: &String, change: &dyn Fn(Array) -> Array| {
            let new = match held.get(name) {
                Some(Held::Given(tensor) | Held::Constant(tensor)) => array(tensor).map(|x| typed(change(x))),
                _ => None,
            };
            if let Some(new) = new {
                held.insert(name.clone(), Held::Given(Arc::new(new)));
            }
        };
        match self.plant {
            Plant::Operand(place, with) | Plant::Both(place, with, _) => change(&node.input[place], &with),
            Plant::Numbers(with) => node.input.iter().for_each(|name| change(name, &|x: Array| x.map(with))),
            _ => {}
        }
    }

    /// The output as the engine leaves it.
    pub(super) fn change_output(&self, tensor: TypedTensor, node: &NodeProto, held: &Tensors) -> TypedTensor {
        let of = |name: &str| match held.get(name) {
            Some(Held::Given(tensor) | Held::Constant(tensor)) => array(tensor),
            _ => None,
        };
        match self.plant {
            Plant::Output(change) => array(&tensor).map_or(tensor, |x| typed(change(x))),
            Plant::Made(make) => typed(make(node.input.iter().filter_map(|name| of(name)).collect())),
            Plant::Stale(name) => match of(name) {
                Some(other) => typed(Array { shape: tensor.shape.clone(), ..other }),
                None => tensor,
            },
            _ => tensor,
        }
    }
}

fn array(tensor: &TypedTensor) -> Option<Array> {
    match &tensor.elements {
        Elements::F32(values) => Some(Array { shape: tensor.shape.clone(), values: values.clone() }),
        _ => None,
    }
}

fn typed(array: Array) -> TypedTensor {
    TypedTensor { shape: array.shape, elements: Elements::F32(array.values) }
}

const fn attributes(
    name: &'static str,
    hypothesis: &'static str,
    (scene, output): (fn() -> Scene, &'static str),
    attributes: fn() -> Vec<AttributeProto>,
) -> Fault {
    Fault { name, hypothesis, scene, output, plant: Plant::Attributes(attributes) }
}

const fn operand(
    name: &'static str,
    hypothesis: &'static str,
    (scene, output): (fn() -> Scene, &'static str),
    place: usize,
    change: fn(Array) -> Array,
) -> Fault {
    Fault { name, hypothesis, scene, output, plant: Plant::Operand(place, change) }
}

const fn fault(
    name: &'static str,
    hypothesis: &'static str,
    (scene, output): (fn() -> Scene, &'static str),
    plant: Plant,
) -> Fault {
    Fault { name, hypothesis, scene, output, plant }
}

const ELEVEN_BITS: &str = "reduced precision, 11 bits (f16 or tf32)";
const EIGHT_BITS: &str = "reduced precision, 8 bits (bf16)";

/// Every mistake that must be found at its node; the first families by the attribute, then by the numbers.
pub const FAULTS: &[Fault] = &[
    // Sampling.
    attributes("GridSample: align_corners 0 for 1", "align_corners", (maps, "sampled"), || {
        vec![int("align_corners", 0)]
    }),
    attributes("GridSample 3-D: align_corners 1 for 0", "align_corners", (volumes, "at"), || {
        vec![int("align_corners", 1)]
    }),
    attributes("GridSample: border for zeros", "padding_mode", (maps, "sampled"), || {
        vec![text("padding_mode", "border")]
    }),
    attributes("GridSample: reflection for zeros", "padding_mode", (maps, "sampled"), || {
        vec![text("padding_mode", "reflection")]
    }),
    attributes("GridSample: nearest for linear", "mode", (maps, "sampled"), || vec![text("mode", "nearest")]),
    operand("GridSample: y, x for x, y", "axis-order", (maps, "sampled"), 1, |grid| {
        reversed_points(&grid, 2)
    }),
    operand("GridSample 3-D: z, y, x for x, y, z", "axis-order", (volumes, "at"), 1, |grid| {
        reversed_points(&grid, 3)
    }),
    attributes("Resize: asymmetric for half_pixel", "coordinate_transformation_mode", (images, "r"), || {
        vec![text("coordinate_transformation_mode", "asymmetric")]
    }),
    attributes("Resize: align_corners for half_pixel", "align_corners", (images, "r"), || {
        vec![text("coordinate_transformation_mode", "align_corners")]
    }),
    attributes("Resize: cubic a −0.5 for −0.75", "cubic_coeff_a", (maps, "cubic"), || {
        vec![float("cubic_coeff_a", -0.5)]
    }),
    attributes("Resize: cubic a −0.65 for −0.75", "cubic_coeff_a", (maps, "cubic"), || {
        vec![float("cubic_coeff_a", -0.65)]
    }),
    attributes("Resize: outside excluded", "exclude_outside", (maps, "cubic"), || {
        vec![int("exclude_outside", 1)]
    }),
    attributes("Resize: antialias", "antialias", (maps, "smaller"), || vec![int("antialias", 1)]),
    attributes("Resize: ceil for floor", "nearest_mode", (maps, "nearest"), || {
        vec![text("nearest_mode", "ceil")]
    }),
    attributes(
        "Resize: half_pixel for asymmetric, nearest",
        "coordinate_transformation_mode",
        (maps, "nearest"),
        || vec![text("coordinate_transformation_mode", "half_pixel")],
    ),
    attributes("Resize: linear for cubic", "mode", (maps, "cubic"), || vec![text("mode", "linear")]),
    // Paddings.
    attributes("Conv: paddings before and after exchanged", "pads", (images, "c3"), || {
        vec![ints("pads", &[2, 1, 0, 1])]
    }),
    attributes("Conv: SAME_LOWER for SAME_UPPER", "auto_pad", (maps, "f"), || {
        vec![text("auto_pad", "NOTSET"), ints("pads", &[1, 1, 0, 0])]
    }),
    fault(
        "Conv: border repeated for zeros",
        "padding_mode",
        (images, "c1"),
        Plant::Both(0, |x| repeated_border(&x), || vec![ints("pads", &[0, 0, 0, 0])]),
    ),
    attributes("AveragePool: padding counted", "count_include_pad", (images, "p"), || {
        vec![int("count_include_pad", 1)]
    }),
    attributes("MaxPool: ceil_mode", "ceil_mode", (maps, "coarse"), || vec![int("ceil_mode", 1)]),
    attributes("Pad: edge for reflect", "padding_mode", (maps, "padded"), || vec![text("mode", "edge")]),
    attributes("Pad: constant for reflect", "padding_mode", (maps, "padded"), || {
        vec![text("mode", "constant")]
    }),
    // Kernels.
    attributes("Conv: dilation ignored", "dilations", (images, "c2"), || {
        vec![ints("dilations", &[1, 1]), ints("pads", &[1, 1, 1, 1])]
    }),
    operand("Conv: kernel flipped", "kernel-flip", (images, "c1"), 1, |w| flipped(&flipped(&w, 2), 3)),
    operand("ConvTranspose: kernel flipped", "kernel-flip", (volumes, "up"), 1, |w| {
        flipped(&flipped(&flipped(&w, 2), 3), 4)
    }),
    operand("Conv: kernel's axes exchanged", "axis-order", (images, "c1"), 1, |w| w.swap_axes(2, 3)),
    operand("Conv 3-D: input and output channels exchanged", "weights-transposed", (volumes, "c"), 1, |w| {
        w.swap_axes(0, 1)
    }),
    operand("Conv: channels dealt out to groups in turn", "group", (images, "c2"), 0, |x| dealt(&x, 2)),
    operand("Conv: BGR for RGB", "channel-order", (images, "c1"), 0, |x| flipped(&x, 1)),
    attributes("ConvTranspose: output_padding before", "output_padding", (volumes, "up"), || {
        vec![ints("pads", &[0, 0, 0, 1, 1, 1]), ints("output_padding", &[0, 0, 0])]
    }),
    // Normalisations.
    attributes("BatchNormalization: ε 1e-3 for 1e-5", "epsilon", (images, "n1"), || {
        vec![float("epsilon", 1e-3)]
    }),
    attributes("BatchNormalization: ε 3e-4 for 1e-5", "epsilon", (images, "n1"), || {
        vec![float("epsilon", 3e-4)]
    }),
    attributes("GroupNormalization: ε 1e-3 for 1e-5", "epsilon", (images, "n2"), || {
        vec![float("epsilon", 1e-3)]
    }),
    attributes("InstanceNormalization: ε 1e-3 for 1e-5", "epsilon", (volumes, "n"), || {
        vec![float("epsilon", 1e-3)]
    }),
    attributes("LayerNormalization: ε 1e-6 for 1e-5", "epsilon", (tokens, "n"), || {
        vec![float("epsilon", 1e-6)]
    }),
    fault(
        "InstanceNormalization: unbiased variance",
        "variance",
        (volumes, "n"),
        Plant::Made(|x| unbiased(&x)),
    ),
    fault(
        "BatchNormalization: mean and variance exchanged",
        "mean-variance-swapped",
        (images, "n1"),
        Plant::Node(|mut node| {
            node.input.swap(3, 4);
            node
        }),
    ),
    fault(
        "BatchNormalization: scale and shift exchanged",
        "scale-bias-swapped",
        (images, "n1"),
        Plant::Node(|mut node| {
            node.input.swap(1, 2);
            node
        }),
    ),
    attributes("GroupNormalization: 2 groups for 4", "num_groups", (images, "n2"), || {
        vec![int("num_groups", 2)]
    }),
    operand("GroupNormalization: one scale a group", "scale-per-group", (images, "n2"), 1, |scale| {
        of_groups(&scale, 2)
    }),
    attributes("LayerNormalization: axis 1 for 2", "axis", (tokens, "n"), || vec![int("axis", 1)]),
    operand("taken apart: ε 1e-3 for 1e-5", "epsilon", (lists, "guarded"), 1, |small| small.map(|_| 1e-3)),
    fault(
        "taken apart: unbiased variance",
        "variance",
        (lists, "variance"),
        Plant::Output(|y| y.map(|y| y * (16.0 / 15.0))),
    ),
    // Matrices and biases.
    attributes("Gemm: transB ignored", "weights-transposed", (lists, "g2"), || vec![int("transB", 0)]),
    operand("MatMul: weights transposed", "weights-transposed", (tokens, "q"), 1, |w| w.swap_axes(0, 1)),
    attributes("Gemm: alpha ignored", "alpha", (lists, "g1"), || vec![float("alpha", 1.0)]),
    attributes("Gemm: beta ignored", "beta", (lists, "g1"), || vec![float("beta", 1.0)]),
    operand("Conv: bias left out", "bias-missing", (images, "c1"), 2, |b| b.map(|_| 0.0)),
    operand("Gemm: bias twice", "bias-twice", (lists, "g2"), 2, |b| b.map(|b| 2.0 * b)),
    operand("ConvTranspose: bias subtracted", "bias-sign", (volumes, "up"), 2, |b| b.map(|b| -b)),
    // Activations.
    attributes("LeakyRelu: slope 0.01 for 0.1", "alpha", (images, "a1"), || vec![float("alpha", 0.01)]),
    attributes("LeakyRelu: slope 0.13 for 0.1", "alpha", (images, "a1"), || vec![float("alpha", 0.13)]),
    attributes("Gelu: tanh for erf", "approximate", (tokens, "g"), || vec![text("approximate", "tanh")]),
    attributes("Elu: α 0.9 for 1", "alpha", (lists, "e"), || vec![float("alpha", 0.9)]),
    attributes("Softmax: axis 2 for 3", "axis", (tokens, "weights"), || vec![int("axis", 2)]),
    fault(
        "Sigmoid: a hard one",
        "activation",
        (lists, "share"),
        Plant::Node(|node| renamed(node, "HardSigmoid")),
    ),
    fault("Relu: left out", "activation", (lists, "positive"), Plant::Node(|node| renamed(node, "Identity"))),
    fault("Relu: Relu6", "activation", (lists, "positive"), Plant::Output(|y| y.map(|y| y.min(6.0)))),
    operand("Clip: upper bound ignored", "bounds", (lists, "clipped"), 2, |high| high.map(|_| f32::MAX)),
    // Reductions and movements.
    fault("ReduceMean: a sum", "operator", (lists, "mean"), Plant::Node(|node| renamed(node, "ReduceSum"))),
    fault(
        "Concat: the other way round",
        "concat-order",
        (lists, "both"),
        Plant::Node(|mut node| {
            node.input.reverse();
            node
        }),
    ),
    attributes("Transpose: the inverse", "perm", (maps, "turned"), || vec![ints("perm", &[0, 3, 1, 2])]),
    fault("Slice: one too late", "slice-off-by-one", (lists, "cut"), Plant::Made(|x| columns(&x[0], 4..20))),
    fault(
        "Gather: one too far",
        "index-off-by-one",
        (lists, "taken"),
        Plant::Made(|x| taken(&x[0], &[1, 8, 4, 0, 13])),
    ),
    fault(
        "Gather: −1 taken as 0",
        "negative-indices",
        (lists, "taken"),
        Plant::Made(|x| taken(&x[0], &[0, 7, 3, 0, 12])),
    ),
    fault(
        "Sub: operands exchanged",
        "operands-swapped",
        (lists, "centred"),
        Plant::Node(|mut node| {
            node.input.swap(0, 1);
            node
        }),
    ),
    // To integers.
    fault(
        "Round: halves away from zero",
        "rounding-ties",
        (bytes, "whole"),
        Plant::Made(|x| x[0].map(f32::round)),
    ),
    fault("Round: down", "truncation", (bytes, "whole"), Plant::Node(|node| renamed(node, "Floor"))),
    // Layouts.
    fault("Conv: channels last in memory", "layout", (images, "c1"), Plant::Output(|y| channels_last(&y))),
    fault(
        "Conv: views exchanged",
        "batch-order",
        (images, "c2"),
        Plant::Output(|y| first_slices(&y, &[1, 0, 2])),
    ),
    fault(
        "Conv: one view twice",
        "batch-order",
        (images, "c2"),
        Plant::Output(|y| first_slices(&y, &[0, 1, 1])),
    ),
    // Factors.
    operand("Conv: weights × 1.0005", "scale", (images, "c1"), 1, |w| w.map(|w| w * 1.0005)),
    fault("MatMul: output × 1.000001", "scale", (tokens, "m1"), Plant::Output(|y| y.map(|y| y * 1.000_001))),
    fault(
        "GroupNormalization: output × 1.0005",
        "scale",
        (images, "n2"),
        Plant::Output(|y| y.map(|y| y * 1.0005)),
    ),
    operand("Conv: image in 0..255", "scale", (images, "c1"), 0, |x| x.map(|x| x * 255.0)),
    fault("Gemm: output and 0.001", "offset", (lists, "g2"), Plant::Output(|y| y.map(|y| y + 0.001))),
    // Precision.
    fault("Conv: f16 operands", ELEVEN_BITS, (images, "c2"), Plant::Numbers(as_f16)),
    fault("Gemm: tf32 operands", ELEVEN_BITS, (lists, "g2"), Plant::Numbers(as_tf32)),
    fault("MatMul: bf16 operands", EIGHT_BITS, (tokens, "m3"), Plant::Numbers(as_bf16)),
    fault("ConvTranspose: f16 result", ELEVEN_BITS, (volumes, "up"), Plant::Output(|y| y.map(as_f16))),
    operand("Conv: f16 weights", ELEVEN_BITS, (images, "c3"), 1, |w| w.map(as_f16)),
    fault("MatMul: f16 sums", ELEVEN_BITS, (tokens, "m1"), Plant::Made(|x| summed_in_f16(&x))),
    operand("Conv: int8 weights, one scale", "int8 weights, per tensor", (images, "c1"), 1, |w| {
        in_eight_bits(&w, 1)
    }),
    operand("Conv: int8 weights, one scale a channel", "int8 weights, per channel", (images, "c1"), 1, |w| {
        let channels = w.shape[0];
        in_eight_bits(&w, channels)
    }),
    // Constants.
    operand("Gemm: weights in 3 decimals", "truncated-constant", (lists, "g2"), 1, |w| {
        w.map(|w| ((f64::from(w) * 1e3).round_ties_even() / 1e3) as f32)
    }),
    operand("BatchNormalization: variances in 2 decimals", "truncated-constant", (images, "n1"), 4, |v| {
        v.map(|v| ((f64::from(v) * 1e2).round_ties_even() / 1e2) as f32)
    }),
    // Nodes of which a part is tried.
    operand("wide Conv: kernel flipped", "kernel-flip", (wide, "c"), 1, |w| flipped(&flipped(&w, 2), 3)),
    attributes("wide Conv: paddings before and after exchanged", "pads", (wide, "c"), || {
        vec![ints("pads", &[1, 2, 1, 0])]
    }),
    operand("wide Conv: f16 weights", ELEVEN_BITS, (wide, "c"), 1, |w| w.map(as_f16)),
    operand("wide Conv: weights × 1.000001", "scale", (wide, "c"), 1, |w| w.map(|w| w * 1.000_001)),
    operand("wide ConvTranspose: kernel flipped", "kernel-flip", (wide, "up"), 1, |w| {
        flipped(&flipped(&w, 2), 3)
    }),
    operand("wide MatMul: weights transposed", "weights-transposed", (wide, "m"), 1, |w| w.swap_axes(0, 1)),
    // Numbers that belong elsewhere.
    fault("Conv: another layer's output", "stale", (images, "c2"), Plant::Stale("c1")),
    operand("MatMul: another layer's operand", "stale", (tokens, "m3"), 0, |x| Array {
        values: drawn("elsewhere", &x.shape),
        ..x
    }),
    operand("Conv: another image's output", "stale", (images, "c1"), 0, |x| Array {
        values: drawn("another image", &x.shape),
        ..x
    }),
    fault(
        "Conv: elements in the opposite order",
        "permuted",
        (images, "c1"),
        Plant::Output(|y| Array { values: y.values.iter().rev().copied().collect(), ..y }),
    ),
    fault("Conv: never written", "zero-output", (images, "c3"), Plant::Output(|y| y.map(|_| 0.0))),
    fault(
        "Conv: last channel never written",
        "unwritten",
        (images, "c3"),
        Plant::Output(|y| last_channel_zero(&y)),
    ),
    fault(
        "Conv: a NaN",
        "not-finite",
        (images, "c3"),
        Plant::Output(|mut y| {
            y.values[17] = f32::NAN;
            y
        }),
    ),
    fault(
        "MatMul: limited to ±1",
        "clipped",
        (tokens, "m3"),
        Plant::Output(|y| y.map(|y| y.clamp(-1.0, 1.0))),
    ),
    fault(
        "MatMul: one element",
        "few-elements",
        (tokens, "m3"),
        Plant::Output(|mut y| {
            y.values[100] += 0.25;
            y
        }),
    ),
    fault("Tanh: opposite sign", "sign", (volumes, "y"), Plant::Output(|y| y.map(|y| -y))),
];

fn renamed(mut node: NodeProto, operator: &str) -> NodeProto {
    node.op_type = Some(operator.into());
    node
}

/// Every point of a grid with its coordinates in the opposite order.
fn reversed_points(grid: &Array, coordinates: usize) -> Array {
    let points = grid.values.chunks_exact(coordinates);
    Array {
        shape: grid.shape.clone(),
        values: points.flat_map(|point| point.iter().rev().copied()).collect(),
    }
}

/// Slices along an axis in another order.
fn slices(x: &Array, axis: usize, order: &[usize]) -> Array {
    let inner: usize = x.shape[axis + 1..].iter().product();
    let blocks = x.values.chunks_exact(inner * x.shape[axis]);
    let values = blocks
        .flat_map(|block| order.iter().flat_map(|&i| block[i * inner..(i + 1) * inner].iter().copied()));
    let values = values.collect();
    let mut shape = x.shape.clone();
    shape[axis] = order.len();
    Array { shape, values }
}

fn flipped(x: &Array, axis: usize) -> Array {
    slices(x, axis, &(0..x.shape[axis]).rev().collect::<Vec<_>>())
}

fn first_slices(x: &Array, order: &[usize]) -> Array {
    slices(x, 0, order)
}

fn columns(x: &Array, columns: std::ops::Range<usize>) -> Array {
    slices(x, 1, &columns.collect::<Vec<_>>())
}

fn taken(x: &Array, places: &[usize]) -> Array {
    slices(x, 1, places)
}

/// Channels 0, 2, 4, …, 1, 3, 5, … for two groups.
fn dealt(x: &Array, groups: usize) -> Array {
    let channels = x.shape[1];
    slices(
        x,
        1,
        &(0..channels)
            .map(|c| c % (channels / groups) * groups + c / (channels / groups))
            .collect::<Vec<_>>(),
    )
}

/// A border of one element around the last two axes, repeating the nearest.
fn repeated_border(x: &Array) -> Array {
    let around = |side: usize| {
        let mut places: Vec<usize> = (0..side).collect();
        places.insert(0, 0);
        places.push(side - 1);
        places
    };
    let rows = slices(x, 2, &around(x.shape[2]));
    slices(&rows, 3, &around(x.shape[3]))
}

/// Memory as N H W C under the shape N C H W.
fn channels_last(y: &Array) -> Array {
    let moved = y.swap_axes(1, 2).swap_axes(2, 3);
    Array { shape: y.shape.clone(), values: moved.values }
}

fn last_channel_zero(y: &Array) -> Array {
    let (channels, place) = (y.shape[1], y.shape[2] * y.shape[3]);
    let value = |(i, &y): (usize, &f32)| if i / place % channels == channels - 1 { 0.0 } else { y };
    Array { shape: y.shape.clone(), values: y.values.iter().enumerate().map(value).collect() }
}

/// The first element of each group for all of it.
fn of_groups(scale: &Array, size: usize) -> Array {
    slices(scale, 0, &(0..scale.shape[0]).map(|c| c / size * size).collect::<Vec<_>>())
}

/// Instance normalisation with the variance divided by N − 1.
fn unbiased(operands: &[Array]) -> Array {
    let [x, scale, shift] = operands else { panic!("{} operands, three were expected", operands.len()) };
    let (channels, place) = (x.shape[1], x.shape[2..].iter().product::<usize>());
    let slice = |(i, values): (usize, &[f32])| -> Vec<f32> {
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / place as f64;
        let squares: f64 = values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum();
        let root = (squares / (place - 1) as f64 + 1e-5).sqrt();
        let (scale, shift) = (f64::from(scale.values[i % channels]), f64::from(shift.values[i % channels]));
        values.iter().map(|&v| ((f64::from(v) - mean) / root * scale + shift) as f32).collect()
    };
    Array {
        shape: x.shape.clone(),
        values: x.values.chunks_exact(place).enumerate().flat_map(slice).collect(),
    }
}

fn as_f16(x: f32) -> f32 {
    half::f16::from_f32(x).to_f32()
}

fn as_bf16(x: f32) -> f32 {
    half::bf16::from_f32(x).to_f32()
}

/// The nearest number with ten bits of fraction, ties to even.
fn as_tf32(x: f32) -> f32 {
    let bits = x.to_bits();
    f32::from_bits((bits + 0xfff + (bits >> 13 & 1)) & !0x1fff)
}

/// A matrix product whose products and partial sums are kept in f16.
fn summed_in_f16(operands: &[Array]) -> Array {
    let [a, b] = operands else { panic!("{} operands, two were expected", operands.len()) };
    let (depth, columns) = (b.shape[0], b.shape[1]);
    let row = |row: &[f32]| -> Vec<f32> {
        let element = |j: usize| {
            let products = (0..depth).map(|k| as_f16(as_f16(row[k]) * as_f16(b.values[k * columns + j])));
            products.fold(0.0, |sum, product| as_f16(sum + product))
        };
        (0..columns).map(element).collect()
    };
    let mut shape = a.shape.clone();
    *shape.last_mut().expect("a matrix") = columns;
    Array { shape, values: a.values.chunks_exact(depth).flat_map(row).collect() }
}

/// Numbers rounded to −127..127 steps, with one step size for each of so many slices.
fn in_eight_bits(w: &Array, slices: usize) -> Array {
    let length = w.values.len() / slices;
    let slice = |values: &[f32]| -> Vec<f32> {
        let step = values.iter().fold(0.0_f32, |largest, v| largest.max(v.abs())) / 127.0;
        values.iter().map(|v| (v / step).round_ties_even() * step).collect()
    };
    Array { shape: w.shape.clone(), values: w.values.chunks_exact(length).flat_map(slice).collect() }
}

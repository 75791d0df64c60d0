//! Graphs of a few nodes in which mistakes are made: as the networks' layers follow each other, only smaller.

use std::collections::BTreeMap;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::onnx::builder::{GraphBuilder, float, int, ints, text};
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// A graph and its inputs.
pub struct Scene {
    /// The graph.
    pub model: Model,
    /// Its inputs by name.
    pub inputs: BTreeMap<String, TypedTensor>,
}

/// All scenes by name.
pub const SCENES: &[(&str, fn() -> Scene)] = &[
    ("images", images),
    ("maps", maps),
    ("volumes", volumes),
    ("tokens", tokens),
    ("lists", lists),
    ("bytes", bytes),
    ("wide", wide),
];

/// Seed of all numbers in the scenes.
pub const SEED: u64 = 20;

/// Numbers of about unit size, in as many decimals as f32 has.
pub fn drawn(name: &str, shape: &[usize]) -> Vec<f32> {
    let salt = name.bytes().fold(SEED, |seed, byte| seed.wrapping_mul(31).wrapping_add(u64::from(byte)));
    let mut random = ChaCha8Rng::seed_from_u64(salt);
    (0..shape.iter().product::<usize>()).map(|_| random.random_range(-1.7..1.7)).collect()
}

/// A graph under construction with drawn weights and inputs.
struct Builder {
    graph: GraphBuilder,
    inputs: BTreeMap<String, TypedTensor>,
}

impl Builder {
    fn new(opset: i64) -> Self {
        Self { graph: GraphBuilder::new(opset), inputs: BTreeMap::new() }
    }

    fn input(self, name: &str, shape: &[usize]) -> Self {
        self.given(name, shape, drawn(name, shape))
    }

    fn given(mut self, name: &str, shape: &[usize], values: Vec<f32>) -> Self {
        self.graph = self.graph.input(name, shape);
        let tensor = TypedTensor::new(shape, Elements::F32(values)).expect("values for the shape");
        self.inputs.insert(name.to_owned(), tensor);
        self
    }

    /// A weight, smaller where more products are summed.
    fn weight(mut self, name: &str, shape: &[usize]) -> Self {
        let products: usize = shape[1..].iter().product();
        let factor = 1.0 / (products as f32).sqrt();
        let values: Vec<f32> = drawn(name, shape).iter().map(|x| x * factor).collect();
        self.graph = self.graph.constant(name, shape, &values);
        self
    }

    /// A list of constants mapped from drawn numbers.
    fn list(mut self, name: &str, count: usize, map: fn(f32) -> f32) -> Self {
        let values: Vec<f32> = drawn(name, &[count]).into_iter().map(map).collect();
        self.graph = self.graph.constant(name, &[count], &values);
        self
    }

    fn with(mut self, add: impl FnOnce(GraphBuilder) -> GraphBuilder) -> Self {
        self.graph = add(self.graph);
        self
    }

    fn output(self, name: &str) -> Self {
        self.with(|graph| graph.output(name))
    }

    fn scene(self, name: &str) -> Scene {
        let model = Model::from_bytes(name, self.graph.to_bytes()).expect("a graph as it was built");
        Scene { model, inputs: self.inputs }
    }
}

/// A convolutional encoder: convolutions with groups and dilations, both normalisations, pooling, resampling.
pub fn images() -> Scene {
    Builder::new(21)
        .input("image", &[3, 3, 12, 14])
        .weight("w1", &[8, 3, 3, 3])
        .list("b1", 8, |x| x)
        .list("scale", 8, |x| 1.0 + 0.3 * x)
        .list("shift", 8, |x| 0.5 * x)
        .list("mean", 8, |x| 0.1 + 0.3 * x.abs())
        .list("variance", 8, |x| 0.2 + 0.1 * x.abs())
        .weight("w2", &[8, 4, 3, 3])
        .list("b2", 8, |x| x)
        .list("gamma", 8, |x| 1.0 + 0.3 * x)
        .list("beta", 8, |x| 0.5 * x)
        .weight("w3", &[8, 8, 3, 3])
        .with(|graph| {
            graph
                .constant("twice", &[4], &[1.0, 1.0, 2.0, 2.0])
                .node("Conv", &["image", "w1", "b1"], &["c1"], vec![ints("pads", &[1, 1, 1, 1])])
                .node("BatchNormalization", &["c1", "scale", "shift", "mean", "variance"], &["n1"], vec![])
                .node("LeakyRelu", &["n1"], &["a1"], vec![float("alpha", 0.1)])
                .node(
                    "Conv",
                    &["a1", "w2", "b2"],
                    &["c2"],
                    vec![ints("pads", &[2, 2, 2, 2]), ints("dilations", &[2, 2]), int("group", 2)],
                )
                .node("GroupNormalization", &["c2", "gamma", "beta"], &["n2"], vec![int("num_groups", 4)])
                .node("Relu", &["n2"], &["a2"], vec![])
                .node(
                    "AveragePool",
                    &["a2"],
                    &["p"],
                    vec![
                        ints("kernel_shape", &[3, 3]),
                        ints("strides", &[2, 2]),
                        ints("pads", &[1, 1, 1, 1]),
                    ],
                )
                .node(
                    "Resize",
                    &["p", "", "twice"],
                    &["r"],
                    vec![text("mode", "linear"), text("coordinate_transformation_mode", "half_pixel")],
                )
                .node("Add", &["r", "a2"], &["s"], vec![])
                .node(
                    "Conv",
                    &["s", "w3"],
                    &["c3"],
                    vec![ints("pads", &[0, 1, 2, 1]), ints("strides", &[2, 2])],
                )
                .node("Sigmoid", &["c3"], &["y"], vec![])
        })
        .output("y")
        .scene("images")
}

/// Maps that are sampled: cubic and nearest resizing, grids, paddings, largest elements.
pub fn maps() -> Scene {
    let coordinates = drawn("grid", &[2, 5, 6, 2]).into_iter().map(|x| 0.7 * x).collect();
    Builder::new(20)
        .input("x", &[2, 4, 9, 9])
        .given("grid", &[2, 5, 6, 2], coordinates)
        .weight("w", &[4, 4, 3, 3])
        .weight("even", &[4, 4, 2, 2])
        .with(|graph| {
            graph
                .constant("half", &[4], &[1.0, 1.0, 0.5, 0.5])
                .constant("more", &[4], &[1.0, 1.0, 1.5, 2.0])
                .integers("pads", &[8], &[0, 0, 1, 2, 0, 0, 2, 1])
                .node(
                    "Conv",
                    &["x", "w"],
                    &["f"],
                    vec![text("auto_pad", "SAME_UPPER"), ints("strides", &[2, 2])],
                )
                .node("Conv", &["x", "w"], &["g"], vec![ints("pads", &[1, 1, 1, 1])])
                .node(
                    "Resize",
                    &["g", "", "more"],
                    &["cubic"],
                    vec![text("mode", "cubic"), float("cubic_coeff_a", -0.75)],
                )
                .node("Resize", &["g", "", "half"], &["smaller"], vec![text("mode", "linear")])
                .node(
                    "Resize",
                    &["g", "", "more"],
                    &["nearest"],
                    vec![
                        text("mode", "nearest"),
                        text("coordinate_transformation_mode", "asymmetric"),
                        text("nearest_mode", "floor"),
                    ],
                )
                .node("Pad", &["g", "pads"], &["padded"], vec![text("mode", "reflect")])
                .node(
                    "GridSample",
                    &["g", "grid"],
                    &["sampled"],
                    vec![text("mode", "linear"), text("padding_mode", "zeros"), int("align_corners", 1)],
                )
                .node(
                    "MaxPool",
                    &["g"],
                    &["largest"],
                    vec![
                        ints("kernel_shape", &[3, 3]),
                        ints("strides", &[2, 2]),
                        ints("pads", &[1, 1, 1, 1]),
                    ],
                )
                .node(
                    "MaxPool",
                    &["g"],
                    &["coarse"],
                    vec![ints("kernel_shape", &[2, 2]), ints("strides", &[2, 2])],
                )
                .node("Relu", &["sampled"], &["kept"], vec![])
                .node("Transpose", &["padded"], &["turned"], vec![ints("perm", &[0, 2, 3, 1])])
        })
        .output("kept")
        .output("turned")
        .scene("maps")
}

/// A network of voxels: three-dimensional convolutions, their transposes, grids of x, y, z.
pub fn volumes() -> Scene {
    let coordinates = drawn("points", &[1, 7, 5, 1, 3]).into_iter().map(|x| 0.6 * x).collect();
    Builder::new(20)
        .input("voxels", &[1, 4, 6, 6, 6])
        .given("points", &[1, 7, 5, 1, 3], coordinates)
        .weight("w1", &[4, 4, 3, 3, 3])
        .list("b1", 4, |x| x)
        .list("scale", 4, |x| 1.0 + 0.3 * x)
        .list("shift", 4, |x| 0.5 * x)
        .weight("w2", &[4, 4, 3, 3, 3])
        .list("b2", 4, |x| x)
        .with(|graph| {
            graph
                .node("Conv", &["voxels", "w1", "b1"], &["c"], vec![ints("pads", &[1; 6])])
                .node("InstanceNormalization", &["c", "scale", "shift"], &["n"], vec![])
                .node("Relu", &["n"], &["a"], vec![])
                .node(
                    "ConvTranspose",
                    &["a", "w2", "b2"],
                    &["up"],
                    vec![
                        ints("strides", &[2, 2, 2]),
                        ints("pads", &[1; 6]),
                        ints("output_padding", &[1, 1, 1]),
                    ],
                )
                .node(
                    "GridSample",
                    &["a", "points"],
                    &["at"],
                    vec![text("mode", "linear"), text("padding_mode", "border"), int("align_corners", 0)],
                )
                .node("Tanh", &["up"], &["y"], vec![])
                .node("Abs", &["at"], &["z"], vec![])
        })
        .output("y")
        .output("z")
        .scene("volumes")
}

/// A transformer's block.
pub fn tokens() -> Scene {
    Builder::new(20)
        .input("x", &[2, 8, 16])
        .list("scale", 16, |x| 1.0 + 0.3 * x)
        .list("shift", 16, |x| 0.5 * x)
        .weight("wq", &[16, 16])
        .weight("wk", &[16, 16])
        .weight("w1", &[16, 32])
        .list("b1", 32, |x| x)
        .weight("w2", &[32, 16])
        .with(|graph| {
            graph
                .integers("heads", &[4], &[2, 8, 4, 4])
                .integers("joined", &[3], &[2, 8, 16])
                .node("LayerNormalization", &["x", "scale", "shift"], &["n"], vec![int("axis", 2)])
                .node("MatMul", &["n", "wq"], &["q"], vec![])
                .node("MatMul", &["n", "wk"], &["k"], vec![])
                .node("Reshape", &["q", "heads"], &["qr"], vec![])
                .node("Transpose", &["qr"], &["qh"], vec![ints("perm", &[0, 2, 1, 3])])
                .node("Reshape", &["k", "heads"], &["kr"], vec![])
                .node("Transpose", &["kr"], &["kh"], vec![ints("perm", &[0, 2, 3, 1])])
                .node("MatMul", &["qh", "kh"], &["scores"], vec![])
                .node("Softmax", &["scores"], &["weights"], vec![int("axis", 3)])
                .node("MatMul", &["weights", "qh"], &["mixed"], vec![])
                .node("Transpose", &["mixed"], &["back"], vec![ints("perm", &[0, 2, 1, 3])])
                .node("Reshape", &["back", "joined"], &["flat"], vec![])
                .node("Add", &["flat", "x"], &["h"], vec![])
                .node("MatMul", &["h", "w1"], &["m1"], vec![])
                .node("Add", &["m1", "b1"], &["m2"], vec![])
                .node("Gelu", &["m2"], &["g"], vec![])
                .node("MatMul", &["g", "w2"], &["m3"], vec![])
                .node("Add", &["m3", "h"], &["y"], vec![])
        })
        .output("y")
        .scene("tokens")
}

/// A regressor's head: linear layers, joins, cuts and reductions.
pub fn lists() -> Scene {
    Builder::new(18)
        .input("x", &[6, 24])
        .weight("w1", &[24, 24])
        .list("b1", 24, |x| x)
        .weight("w2", &[24, 24])
        .list("b2", 24, |x| x)
        .with(|graph| {
            graph
                .integers("starts", &[1], &[3])
                .integers("ends", &[1], &[19])
                .integers("axes", &[1], &[1])
                .integers("places", &[5], &[0, 7, 3, -1, 12])
                .constant("low", &[], &[-0.5])
                .constant("high", &[], &[0.6])
                .constant("eight", &[], &[8.0])
                .constant("small", &[], &[1e-5])
                .node(
                    "Gemm",
                    &["x", "w1", "b1"],
                    &["g1"],
                    vec![int("transB", 1), float("alpha", 0.5), float("beta", 2.0)],
                )
                .node("Elu", &["g1"], &["e"], vec![float("alpha", 1.0)])
                .node("Gemm", &["e", "w2", "b2"], &["g2"], vec![int("transB", 1)])
                .node("Concat", &["g1", "g2"], &["both"], vec![int("axis", 1)])
                .node("Slice", &["both", "starts", "ends", "axes"], &["cut"], vec![])
                .node("Gather", &["both", "places"], &["taken"], vec![int("axis", 1)])
                .node("ReduceMean", &["cut", "axes"], &["mean"], vec![int("keepdims", 1)])
                .node("Sub", &["cut", "mean"], &["centred"], vec![])
                .node("Clip", &["centred", "low", "high"], &["clipped"], vec![])
                .node("Mul", &["taken", "eight"], &["eightfold"], vec![])
                .node("Mul", &["centred", "centred"], &["squares"], vec![])
                .node("ReduceMean", &["squares", "axes"], &["variance"], vec![int("keepdims", 1)])
                .node("Add", &["variance", "small"], &["guarded"], vec![])
                .node("Sqrt", &["guarded"], &["deviation"], vec![])
                .node("Div", &["centred", "deviation"], &["normal"], vec![])
                .node("Sigmoid", &["g2"], &["share"], vec![])
                .node("ReduceSum", &["g2"], &["total"], vec![int("keepdims", 0)])
                .node("Relu", &["eightfold"], &["positive"], vec![])
        })
        .output("clipped")
        .output("share")
        .output("total")
        .output("normal")
        .output("positive")
        .scene("lists")
}

/// Numbers that become integers.
pub fn bytes() -> Scene {
    // Multiples of a quarter: every second of the halves is a tie.
    let quarters: Vec<f32> = (0..96_i16).map(|i| f32::from(i - 48) * 0.25).collect();
    Builder::new(19)
        .given("x", &[4, 24], quarters)
        .with(|graph| {
            graph
                .constant("step", &[], &[0.5])
                .node("Round", &["x"], &["whole"], vec![])
                .node("Cast", &["x"], &["integer"], vec![int("to", 7)])
                .node("QuantizeLinear", &["x", "step"], &["level"], vec![])
                .node("DequantizeLinear", &["level", "step"], &["again"], vec![])
                .node("Add", &["whole", "again"], &["y"], vec![])
        })
        .output("y")
        .output("integer")
        .scene("bytes")
}

/// Nodes that are large enough for meanings to be tried on a part of them.
pub fn wide() -> Scene {
    Builder::new(20)
        .input("x", &[1, 16, 44, 41])
        .input("rows", &[190, 160])
        .weight("w1", &[24, 16, 3, 3])
        .list("b1", 24, |x| x)
        .weight("w2", &[24, 12, 4, 4])
        .weight("w3", &[160, 160])
        .with(|graph| {
            graph
                .node("Conv", &["x", "w1", "b1"], &["c"], vec![ints("pads", &[1, 0, 1, 2])])
                .node("Relu", &["c"], &["a"], vec![])
                .node(
                    "ConvTranspose",
                    &["a", "w2"],
                    &["up"],
                    vec![ints("strides", &[2, 2]), ints("pads", &[1, 1, 1, 1])],
                )
                .node("MatMul", &["rows", "w3"], &["m"], vec![])
        })
        .output("up")
        .output("m")
        .scene("wide")
}

//! The regressor written as a graph, node by node.
//!
//! It is written here from the table of the architecture and not exported, so that a fault can be put in any place of it.

use std::collections::BTreeMap;

use vitruvian_reference::network::regressor::Size;
use vitruvian_reference::network::resnet::BLOCKS;

use super::faults::Fault;
use crate::array::Array;
use crate::onnx::builder::{GraphBuilder, float, int, ints};
use crate::onnx::message::AttributeProto;
use crate::onnx::model::Model;
use crate::problem::OPSET;
use crate::problem::values::Values;

/// The outputs, in the order of the contract.
const OUTPUTS: [&str; 3] = ["pose", "betas", "camera"];

/// A node under construction: operator, inputs, output, attributes.
type Node = (&'static str, Vec<String>, String, Vec<AttributeProto>);

/// The nodes of a graph, and the fault that is put into them on the way.
struct Builder {
    nodes: Vec<Node>,
    fault: Option<Fault>,
}

impl Builder {
    fn has(&self, fault: Fault) -> bool {
        self.fault == Some(fault)
    }

    /// Adds a node and names its output.
    fn node(&mut self, operator: &'static str, inputs: &[&str], attributes: Vec<AttributeProto>) -> String {
        let output = format!("{}_{}", operator.to_lowercase(), self.nodes.len());
        let inputs = inputs.iter().map(|&name| name.to_owned()).collect();
        self.nodes.push((operator, inputs, output.clone(), attributes));
        output
    }

    /// A convolution and its batch norm; `pads` are those before and after, of both axes.
    fn normed(&mut self, x: &str, conv: &str, norm: &str, stride: usize, pads: [usize; 2]) -> String {
        let attributes =
            vec![ints("strides", &[stride, stride]), ints("pads", &[pads[0], pads[0], pads[1], pads[1]])];
        let y = self.node("Conv", &[x, &format!("{conv}.weight")], attributes);
        let parts = ["weight", "bias", "running_mean", "running_var"].map(|part| format!("{norm}.{part}"));
        let [scale, bias, mean, variance] = parts.each_ref().map(String::as_str);
        let coarse = self.has(Fault::BatchNormEpsilon) && norm == "layer2.1.bn2";
        let epsilon = if coarse { 1e-3 } else { 1e-5 };
        self.node("BatchNormalization", &[&y, scale, bias, mean, variance], vec![float("epsilon", epsilon)])
    }

    fn relu(&mut self, x: &str) -> String {
        self.node("Relu", &[x], vec![])
    }

    fn bottleneck(&mut self, x: &str, name: &str, stride: usize, downsample: bool) -> String {
        let named = |part: &str| format!("{name}.{part}");
        // Where the stride is: on the 3×3, or, as a fault, on the 1×1 before it.
        let (first, second) = if self.has(Fault::StrideOnTheFirst) { (stride, 1) } else { (1, stride) };
        let y = self.normed(x, &named("conv1"), &named("bn1"), first, [0, 0]);
        let missing = self.has(Fault::MissingRelu) && name == "layer3.2";
        let y = if missing { y } else { self.relu(&y) };
        let after = self.has(Fault::PaddingAfter) && name == "layer2.0";
        let y = self.normed(&y, &named("conv2"), &named("bn2"), second, if after { [0, 1] } else { [1, 1] });
        let y = self.relu(&y);
        let y = self.normed(&y, &named("conv3"), &named("bn3"), 1, [0, 0]);
        let shortcut = if downsample {
            self.normed(x, &named("downsample.0"), &named("downsample.1"), stride, [0, 0])
        } else {
            x.to_owned()
        };
        let sum = self.node("Add", &[&y, &shortcut], vec![]);
        self.relu(&sum)
    }

    fn linear(&mut self, x: &str, name: &str) -> String {
        let (weight, bias) = (format!("{name}.weight"), format!("{name}.bias"));
        self.node("Gemm", &[x, &weight, &bias], vec![int("transB", 1)])
    }

    fn resnet(&mut self) -> String {
        let y = self.normed("image", "conv1", "bn1", 2, [3, 3]);
        let y = self.relu(&y);
        let window =
            vec![ints("kernel_shape", &[3, 3]), ints("strides", &[2, 2]), ints("pads", &[1, 1, 1, 1])];
        let mut y = self.node("MaxPool", &[&y], window);
        for (l, blocks) in BLOCKS.into_iter().enumerate() {
            for k in 0..blocks {
                let stride = if l > 0 && k == 0 { 2 } else { 1 };
                y = self.bottleneck(&y, &format!("layer{}.{k}", l + 1), stride, k == 0);
            }
        }
        self.node("ReduceMean", &[&y, "pixels"], vec![int("keepdims", 0)])
    }

    /// The head; its last round's outputs are the graph's.
    fn head(&mut self, feature: &str) {
        // As many rows of the mean person as there are images.
        let images = self.node("Shape", &["image"], vec![int("start", 0), int("end", 1)]);
        let shape = self.node("Concat", &[&images, "one"], vec![int("axis", 0)]);
        let mut state =
            ["init_pose", "init_shape", "init_cam"].map(|mean| self.node("Expand", &[mean, &shape], vec![]));
        let rounds = if self.has(Fault::FourthRound) { 4 } else { 3 };
        for round in 1..=rounds {
            let x = self.node("Concat", &[feature, &state[0], &state[1], &state[2]], vec![int("axis", 1)]);
            let x = self.linear(&x, "fc1");
            let x = if self.has(Fault::ActivationInTheHead) { self.relu(&x) } else { x };
            let x = self.linear(&x, "fc2");
            for (k, layer) in ["decpose", "decshape", "deccam"].into_iter().enumerate() {
                let correction = self.linear(&x, layer);
                state[k] = self.node("Add", &[&state[k], &correction], vec![]);
                if round == rounds {
                    // The last node's output is one of the graph's.
                    self.nodes.last_mut().expect("one was just added").2 = OUTPUTS[k].to_owned();
                }
            }
        }
    }
}

/// Random weights of size about one after each layer: every fault has a signal to spoil.
fn weights(size: &Size, seed: u64) -> BTreeMap<String, Array> {
    let weight = |(k, (name, shape)): (usize, (String, Vec<usize>))| {
        let even = Values::ordinary(seed + k as u64).fill(&shape);
        let inputs: usize = shape[1..].iter().product();
        let array = if name.starts_with("init") {
            even
        } else if shape.len() > 1 {
            // Var(w)·inputs = 2, which a ReLU halves; the head is narrower, so that its rounds converge.
            let variance = if shape.len() == 2 { 0.2 } else { 2.0 };
            let scale = (3.0 * variance / inputs as f32).sqrt();
            even.map(|x| scale * x)
        } else if name.ends_with("running_var") || name.ends_with("weight") {
            even.map(|x| 1.0 + 0.5 * x)
        } else {
            even.map(|x| 0.2 * x)
        };
        (name, array)
    };
    size.weights().into_iter().enumerate().map(weight).collect()
}

/// The regressor of this size with random weights, for images of any number and side, healthy or with a fault.
///
/// The weights are the same with every fault but [`Fault::OneWeight`].
pub fn graph(size: &Size, side: usize, images: usize, seed: u64, fault: Option<Fault>) -> Model {
    let mut graph = GraphBuilder::new(OPSET)
        .property("vitruvian.kind", "regressor")
        .input("image", &[images, 3, side, side])
        .integers("pixels", &[2], &[2, 3])
        .integers("one", &[1], &[1]);
    for (name, mut array) in weights(size, seed) {
        if fault == Some(Fault::OneWeight) && name == "layer3.1.conv2.weight" {
            array.values[4] *= 1.01;
        }
        graph = graph.constant(&name, &array.shape, &array.values);
    }
    let mut builder = Builder { nodes: Vec::new(), fault };
    let feature = builder.resnet();
    builder.head(&feature);
    for (operator, inputs, output, attributes) in builder.nodes {
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        graph = graph.node(operator, &inputs, &[&output], attributes);
    }
    let graph = OUTPUTS.iter().fold(graph, |graph, output| graph.output(output));
    Model::from_bytes("regressor built here", graph.to_bytes()).expect("a graph that was just built")
}

//! A graph with some of its nodes in f16 or int8, simulated in f32.
//!
//! # How is f16 simulated?
//! A lowered node reads its constants, the graph's inputs and what f32 nodes made rounded to f16, computes in f32, and its
//! outputs are rounded to f16: pairs of Casts. That is f16 storage with f32 sums, as on every accelerator and in ONNX Runtime on
//! a CPU; f16 sums would cost more. Overflow goes to infinity. (onnxconverter-common also clamps constants to ±10⁴ and keeps
//! them from 10⁻⁷ up; that is not simulated.)
//!
//! # How is int8 simulated?
//! Conv, ConvTranspose, Gemm and MatMul with a constant weight: the weight is rounded to −127 … 127 steps, symmetric, one step per
//! output channel; what the node reads and makes goes through QuantizeLinear and DequantizeLinear to u8 with one scale and zero
//! point per tensor, from the least and largest number (and 0) on the inputs drawn. Biases, which int8 engines hold in 32 bits, stay.

use std::collections::{BTreeMap, BTreeSet};

use prost::Message as _;

use super::flow::Flow;
use super::runner::Arrays;
use super::surgery::{cast, operator};
use crate::onnx::element::ElementType;
use crate::onnx::message::{NodeProto, TensorProto};
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// The precision that nodes are lowered to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// IEEE binary16.
    F16,
    /// 8-bit integers with scales.
    Int8,
}

/// The least and the largest number of each tensor, with 0 between them.
pub type Ranges = BTreeMap<String, (f32, f32)>;

impl Precision {
    /// `f16` or `int8`.
    pub fn name(self) -> &'static str {
        match self {
            Self::F16 => "f16",
            Self::Int8 => "int8",
        }
    }

    /// How it is simulated, in words.
    pub fn simulation(self) -> &'static str {
        match self {
            Self::F16 => {
                "a lowered node's operands, constants and outputs are rounded to f16, its sums are f32"
            }
            Self::Int8 => {
                "int8 weights per output channel, u8 operands and outputs per tensor with the least and largest number of the inputs drawn, sums and biases f32"
            }
        }
    }

    /// Places of the nodes that can be lowered.
    pub fn candidates(self, flow: &Flow) -> Vec<usize> {
        (0..flow.nodes().len())
            .filter(|&place| match self {
                Self::F16 => {
                    flow.nodes()[place].output.iter().any(|name| flow.floats.get(name) == Some(&F32))
                }
                Self::Int8 => weight(flow, &flow.nodes()[place]).is_some(),
            })
            .collect()
    }
}

/// ONNX's numbers of the element types written here.
const F32: i32 = 1;
const F16: i32 = 10;

/// The ranges of all floats over several records.
pub fn ranges(recorded: &[Arrays]) -> Ranges {
    let mut ranges = Ranges::new();
    for (name, array) in recorded.iter().flatten() {
        let (low, high) = ranges.entry(name.clone()).or_insert((0.0, 0.0));
        for &x in array.values.iter().filter(|x| x.is_finite()) {
            *low = low.min(x);
            *high = high.max(x);
        }
    }
    ranges
}

/// The graph with all candidates lowered but those at the places to `keep`, as a file's bytes.
///
/// # Errors
/// When a weight cannot be read; names it.
pub fn lower(flow: &Flow, to: Precision, keep: &BTreeSet<usize>, ranges: &Ranges) -> Result<Vec<u8>, String> {
    let lowered: BTreeSet<usize> =
        to.candidates(flow).into_iter().filter(|place| !keep.contains(place)).collect();
    let mut model = flow.model.clone();
    let Some(graph) = model.graph.as_mut() else { return Ok(model.encode_to_vec()) };
    let mut rewriting = Lowering {
        flow,
        ranges,
        constants: graph.initializer.clone(),
        nodes: Vec::new(),
        made: BTreeSet::new(),
    };
    for (place, node) in flow.nodes().iter().enumerate() {
        match (lowered.contains(&place), to) {
            (false, _) => rewriting.nodes.push(node.clone()),
            (true, Precision::F16) => rewriting.half(node, &lowered),
            (true, Precision::Int8) => rewriting.eight_bits(node)?,
        }
    }
    graph.node = rewriting.nodes;
    graph.initializer = rewriting.constants;
    Ok(model.encode_to_vec())
}

/// A graph being lowered.
struct Lowering<'a> {
    flow: &'a Flow,
    ranges: &'a Ranges,
    constants: Vec<TensorProto>,
    nodes: Vec<NodeProto>,
    /// Tensors that were added.
    made: BTreeSet<String>,
}

impl Lowering<'_> {
    /// A node with operands and outputs rounded to f16.
    fn half(&mut self, node: &NodeProto, lowered: &BTreeSet<usize>) {
        let mut node = node.clone();
        for name in &mut node.input {
            let from_lowered = self.flow.maker.get(name).is_some_and(|place| lowered.contains(place));
            if self.is_f32(name) && !from_lowered {
                *name = self.through_half(name);
            }
        }
        let outputs = node.output.clone();
        for name in node.output.iter_mut().filter(|name| self.flow.floats.get(*name) == Some(&F32)) {
            *name = format!("exact:{name}");
        }
        self.nodes.push(node);
        for name in outputs.iter().filter(|name| self.flow.floats.get(*name) == Some(&F32)) {
            let half = format!("stored:{name}");
            self.nodes.push(cast(&format!("exact:{name}"), &half, F16));
            self.nodes.push(cast(&half, name, F32));
        }
    }

    /// A tensor that is rounded to f16 and back.
    fn through_half(&mut self, name: &str) -> String {
        let (half, back) = (format!("half:{name}"), format!("read:{name}"));
        if self.made.insert(back.clone()) {
            self.nodes.push(cast(name, &half, F16));
            self.nodes.push(cast(&half, &back, F32));
        }
        back
    }

    /// Whether a tensor holds f32: computed, given, or constant.
    fn is_f32(&self, name: &str) -> bool {
        if self.flow.floats.get(name) == Some(&F32) || self.flow.input_element(name) == Some(ElementType::F32)
        {
            return true;
        }
        if let Some(constant) = self.constants.iter().find(|t| t.name.as_deref() == Some(name)) {
            return constant.data_type == Some(F32);
        }
        let made = self.flow.maker.get(name).map(|&place| &self.flow.nodes()[place]);
        made.is_some_and(|node| {
            node.op_type.as_deref() == Some("Constant")
                && node.attribute.iter().any(|a| a.t.as_ref().is_some_and(|t| t.data_type == Some(F32)))
        })
    }

    /// A node with a rounded weight, between quantised tensors.
    fn eight_bits(&mut self, node: &NodeProto) -> Result<(), String> {
        let mut node = node.clone();
        if let Some((tensor, axis)) = weight(self.flow, &node) {
            let name = tensor.name.clone().unwrap_or_default();
            let rounded = format!("rounded:{name}");
            if self.made.insert(rounded.clone()) {
                let constant =
                    rounded_weight(tensor, axis).map_err(|why| format!("weight \"{name}\": {why}"))?;
                self.constants.push(TensorProto { name: Some(rounded.clone()), ..constant });
            }
            node.input[1] = rounded;
        }
        node.input[0] = self.quantised(&node.input[0].clone(), None);
        let output = node.output[0].clone();
        if self.ranges.contains_key(&output) {
            node.output[0] = format!("exact:{output}");
            self.nodes.push(node);
            self.quantised(&format!("exact:{output}"), Some(&output));
        } else {
            self.nodes.push(node);
        }
        Ok(())
    }

    /// A tensor through eight bits, under a new name or the given one; its own name where it holds nothing but 0.
    fn quantised(&mut self, name: &str, back: Option<&str>) -> String {
        let range = self.ranges.get(back.unwrap_or(name)).copied();
        let back = back.map_or(format!("read:{name}"), str::to_owned);
        let Some((low, high)) = range.filter(|(low, high)| high > low) else {
            if back != format!("read:{name}") {
                self.nodes.push(operator("Identity", &[name], &back, vec![]));
                return back;
            }
            return name.to_owned();
        };
        if self.made.insert(back.clone()) {
            let scale = (high - low) / 255.0;
            let zero = (-low / scale).round_ties_even().clamp(0.0, 255.0) as u8;
            let names = [format!("scale:{back}"), format!("zero:{back}"), format!("stored:{back}")];
            self.constants.push(scalar(&names[0], ElementType::F32, &scale.to_le_bytes()));
            self.constants.push(scalar(&names[1], ElementType::U8, &[zero]));
            self.nodes.push(operator("QuantizeLinear", &[name, &names[0], &names[1]], &names[2], vec![]));
            self.nodes.push(operator("DequantizeLinear", &[&names[2], &names[0], &names[1]], &back, vec![]));
        }
        back
    }
}

/// The constant f32 weight of a node that int8 engines run, and its axis of output channels.
fn weight<'a>(flow: &'a Flow, node: &NodeProto) -> Option<(&'a TensorProto, usize)> {
    let name = node.input.get(1)?;
    let tensor = flow.model.graph.as_ref()?.initializer.iter().find(|t| t.name.as_ref() == Some(name))?;
    if tensor.data_type != Some(F32) || !flow.is_live(node.input.first()?) || tensor.dims.is_empty() {
        return None;
    }
    let transposed = || node.attribute.iter().any(|a| a.name.as_deref() == Some("transB") && a.i == Some(1));
    let axis = match node.op_type.as_deref()? {
        "Conv" => 0,
        "ConvTranspose" => 1,
        "Gemm" if transposed() => 0,
        "Gemm" => 1,
        "MatMul" => tensor.dims.len() - 1,
        _ => return None,
    };
    (axis < tensor.dims.len()).then_some((tensor, axis))
}

/// W rounded to multiples of max|W_c|/127 in every slice c of an axis.
fn rounded_weight(tensor: &TensorProto, axis: usize) -> Result<TensorProto, String> {
    let TypedTensor { shape, elements: Elements::F32(mut values) } = TypedTensor::read(tensor)? else {
        return Err("it is not f32".to_owned());
    };
    let (channels, inner) = (shape[axis], shape[axis + 1..].iter().product::<usize>());
    let channel = |place: usize| place / inner.max(1) % channels.max(1);
    let mut largest = vec![0.0_f32; channels];
    for (place, &x) in values.iter().enumerate() {
        largest[channel(place)] = largest[channel(place)].max(x.abs());
    }
    for (place, x) in values.iter_mut().enumerate() {
        let step = largest[channel(place)] / 127.0;
        if step > 0.0 {
            *x = (*x / step).round_ties_even() * step;
        }
    }
    Ok(TensorProto {
        dims: tensor.dims.clone(),
        data_type: Some(F32),
        raw_data: Some(values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>().into()),
        ..Default::default()
    })
}

fn scalar(name: &str, element: ElementType, bytes: &[u8]) -> TensorProto {
    TensorProto {
        name: Some(name.to_owned()),
        data_type: Some(element.number()),
        raw_data: Some(bytes.to_vec().into()),
        ..Default::default()
    }
}

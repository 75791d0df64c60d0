//! Nodes of a graph that follow each other, as a graph of their own.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use prost::Message as _;

use super::estimate::output_shapes;
use super::party::{Held, Tensors};
use crate::onnx::message::{
    DimensionProto, DimensionValue, GraphProto, ModelProto, OperatorSetIdProto, TensorProto,
    TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto,
};
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// Container version of the graphs that are built: the oldest that knows every element type that is read here.
const IR_VERSION: i64 = 10;

/// A part of a graph, ready to run.
pub(super) struct Part {
    /// An ONNX file: the nodes, with the constants that they read.
    pub bytes: Vec<u8>,
    /// What it is to be given.
    pub inputs: Vec<(String, Arc<TypedTensor>)>,
    /// What it gives: all that its nodes make.
    pub outputs: Vec<String>,
}

impl Part {
    /// The nodes of this range, reading what is held.
    ///
    /// # Errors
    /// When a tensor that they read is not there; names it.
    pub fn of(model: &Model, nodes: Range<usize>, held: &Tensors) -> Result<Self, String> {
        let nodes = &model.nodes()[nodes];
        let names =
            |tensors: &[String]| tensors.iter().filter(|name| !name.is_empty()).cloned().collect::<Vec<_>>();
        let outputs: Vec<String> = nodes.iter().flat_map(|node| names(&node.output)).collect();
        let made: BTreeSet<&String> = outputs.iter().collect();
        let read: BTreeSet<String> = nodes.iter().flat_map(|node| names(&node.input)).collect();
        let mut graph = GraphProto {
            name: Some("part".into()),
            node: nodes.to_vec(),
            output: outputs
                .iter()
                .map(|name| ValueInfoProto { name: Some(name.clone()), r#type: None })
                .collect(),
            ..GraphProto::default()
        };
        let mut inputs = Vec::new();
        for name in read.into_iter().filter(|name| !made.contains(name)) {
            match held.get(&name) {
                Some(Held::Constant(tensor)) => graph.initializer.push(constant(&name, tensor)),
                Some(Held::Given(tensor)) => {
                    graph.input.push(declaration(&name, tensor));
                    inputs.push((name, tensor.clone()));
                }
                Some(Held::Derived(_)) | None => return Err(format!("its operand \"{name}\" is not there")),
                Some(Held::Unknown(why)) => {
                    return Err(format!("its operand \"{name}\" is not there: {why}"));
                }
            }
        }
        let domains: BTreeSet<&str> =
            nodes.iter().map(|node| node.domain.as_deref().unwrap_or_default()).chain([""]).collect();
        let version = |domain: &str| if matches!(domain, "" | "ai.onnx") { model.opset() } else { 1 };
        let file = ModelProto {
            ir_version: Some(IR_VERSION),
            graph: Some(graph),
            opset_import: domains
                .into_iter()
                .map(|domain| OperatorSetIdProto {
                    domain: Some(domain.to_owned()),
                    version: Some(version(domain)),
                })
                .collect(),
            ..ModelProto::default()
        };
        Ok(Self { bytes: file.encode_to_vec(), inputs, outputs })
    }
}

fn constant(name: &str, tensor: &TypedTensor) -> TensorProto {
    TensorProto {
        dims: tensor.shape.iter().map(|&side| side as i64).collect(),
        data_type: Some(tensor.element().number()),
        raw_data: Some(tensor.elements.to_bytes()),
        name: Some(name.to_owned()),
        ..TensorProto::default()
    }
}

fn declaration(name: &str, tensor: &TypedTensor) -> ValueInfoProto {
    let dim = tensor
        .shape
        .iter()
        .map(|&side| DimensionProto { value: Some(DimensionValue::Number(side as i64)) })
        .collect();
    let tensor_type =
        TensorTypeProto { elem_type: Some(tensor.element().number()), shape: Some(TensorShapeProto { dim }) };
    ValueInfoProto { name: Some(name.to_owned()), r#type: Some(TypeProto { tensor_type: Some(tensor_type) }) }
}

/// How many nodes from `first` on make tensors of about `memory` bytes; at least one.
pub(super) fn reach(model: &Model, first: usize, held: &Tensors, memory: usize) -> usize {
    let mut shapes: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (name, tensor) in held {
        if let Some(shape) = tensor.shape() {
            shapes.insert(name, shape.to_vec());
        }
    }
    let mut bytes = 0_usize;
    let nodes = &model.nodes()[first..];
    for (count, node) in nodes.iter().enumerate() {
        let estimated = output_shapes(node, &shapes, held);
        for (name, shape) in node.output.iter().zip(estimated) {
            let elements = shape.iter().fold(1_usize, |n, &side| n.saturating_mul(side));
            bytes = bytes.saturating_add(elements.saturating_mul(4));
            shapes.insert(name, shape);
        }
        if bytes > memory && count > 0 {
            return count;
        }
    }
    nodes.len()
}

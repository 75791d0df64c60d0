//! Nodes of a graph that follow each other, as a graph of their own.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use super::estimate::output_shapes;
use super::party::{Held, Tensors};
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::write::{constant, declaration, model_of, undeclared};

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
        let (mut constants, mut declared) = (Vec::new(), Vec::new());
        let mut inputs = Vec::new();
        for name in read.into_iter().filter(|name| !made.contains(name)) {
            match held.get(&name) {
                Some(Held::Constant(tensor)) => constants.push(constant(&name, tensor)),
                Some(Held::Given(tensor)) => {
                    declared.push(declaration(&name, tensor.element(), &tensor.shape));
                    inputs.push((name, tensor.clone()));
                }
                Some(Held::Derived(_)) | None => return Err(format!("its operand \"{name}\" is not there")),
                Some(Held::Unknown(why)) => {
                    return Err(format!("its operand \"{name}\" is not there: {why}"));
                }
            }
        }
        let asked = outputs.iter().map(|name| undeclared(name)).collect();
        let bytes = model_of(nodes.to_vec(), constants, declared, asked, &model.opsets());
        Ok(Self { bytes, inputs, outputs })
    }
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

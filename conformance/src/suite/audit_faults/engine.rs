//! ONNX Runtime, node by node, with one mistake.

use std::collections::BTreeMap;
use std::sync::Arc;

use prost::Message as _;

use super::faults::Fault;
use super::scenes::Scene;
use crate::audit::OnnxRuntime;
use crate::audit::party::{Held, Party, Segment, Tensors};
use crate::error::{Error, Result};
use crate::onnx::message::ModelProto;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// What an engine left of a graph: all tensors, of which those from one node on may be wrong.
pub struct Engine {
    tensors: BTreeMap<String, TypedTensor>,
}

impl Engine {
    /// Runs a scene with a mistake, or with none.
    ///
    /// # Errors
    /// When ONNX Runtime is missing, or refuses a node.
    pub fn with(scene: &Scene, fault: Option<&Fault>) -> Result<Self> {
        let model = &scene.model;
        let mut held: Tensors = BTreeMap::new();
        for (name, tensor) in model.constants()? {
            held.insert(name, Held::Constant(Arc::new(tensor)));
        }
        for (name, tensor) in &scene.inputs {
            held.insert(name.clone(), Held::Given(Arc::new(tensor.clone())));
        }
        let mut all = BTreeMap::new();
        for index in 0..model.nodes().len() {
            let here =
                fault.filter(|fault| model.nodes()[index].output.iter().any(|name| name == fault.output));
            let (read, mut operands) =
                (here.map_or_else(|| Ok(model.clone()), |fault| misread(model, index, fault))?, held.clone());
            if let Some(fault) = here {
                fault.change_operands(&model.nodes()[index], &mut operands);
            }
            let made = alone(&read, index, &operands)?;
            for (name, mut tensor) in made {
                if let Some(fault) = here.filter(|fault| fault.output == name) {
                    tensor = fault.change_output(tensor, &model.nodes()[index], &held);
                }
                held.insert(name.clone(), Held::Given(Arc::new(tensor.clone())));
                all.insert(name, tensor);
            }
        }
        Ok(Self { tensors: all })
    }
}

/// The outputs of one node.
fn alone(model: &Model, index: usize, held: &Tensors) -> Result<BTreeMap<String, TypedTensor>> {
    // A part that may make no bytes is one node.
    let mut runtime = OnnxRuntime { threads: 1, memory: 0, ..Default::default() };
    let segment = runtime.segment(model, index, held)?;
    let node = &model.nodes()[index];
    if let Some((name, why)) = segment.missing.first_key_value() {
        return Err(Error::Onnx {
            graph: model.name().to_owned(),
            item: format!("node {:?} → \"{name}\"", node.name),
            message: why.clone(),
        });
    }
    let own = |(name, _): &(String, TypedTensor)| node.output.contains(name);
    Ok(segment.tensors.into_iter().filter(own).collect())
}

/// The graph as the engine reads it: one node is another.
fn misread(model: &Model, index: usize, fault: &Fault) -> Result<Model> {
    let mut proto = ModelProto::decode(model.bytes()).expect("the bytes were a model before");
    let node = &mut proto.graph.as_mut().expect("a graph").node[index];
    *node = fault.change_node(node.clone());
    Model::from_bytes(model.name(), proto.encode_to_vec())
}

impl Party for Engine {
    fn describe(&self) -> String {
        "an engine with a mistake".into()
    }

    fn segment(&mut self, model: &Model, first: usize, _: &Tensors) -> Result<Segment> {
        let nodes = first..model.nodes().len();
        Ok(Segment { nodes, tensors: self.tensors.clone(), ..Segment::default() })
    }
}

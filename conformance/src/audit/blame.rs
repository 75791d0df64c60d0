//! What is told about the first node outside rounding: why, from what, and a folder to reproduce it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::case::Case;
use super::hypothesis::{Others, explain};
use super::party::{Held, Tensors};
use super::receptive_field::{receptive_field, text};
use super::report::Outside;
use super::{Options, reproduction};
use crate::error::Result;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// Bytes of further tensors that are kept for a stale output to be found among them.
const KEPT: usize = 512 << 20;

/// A node outside rounding with what surrounds it in the run.
#[derive(Debug)]
pub(super) struct Scene {
    /// The node.
    pub case: Case,
    /// Tensors of the run that have the shape of an operand or an output.
    others: BTreeMap<String, Arc<TypedTensor>>,
    /// Operands that the graph holds as constants.
    constants: BTreeSet<String>,
}

impl Scene {
    /// What of the tensors that are held now belongs to the node.
    pub fn new(case: Case, held: &Tensors) -> Self {
        let own: Vec<&TypedTensor> = case.operands.iter().chain(&case.found).flatten().collect();
        let mut left = KEPT;
        let mut others = BTreeMap::new();
        let mut constants = BTreeSet::new();
        for (name, tensor) in held {
            match tensor {
                Held::Given(tensor) => {
                    let bytes = tensor.len() * tensor.element().size();
                    let alike =
                        own.iter().any(|own| own.shape == tensor.shape && own.element() == tensor.element());
                    if alike && bytes <= left {
                        left -= bytes;
                        others.insert(name.clone(), Arc::clone(tensor));
                    }
                }
                Held::Constant(_) if case.node.input.contains(name) => {
                    constants.insert(name.clone());
                }
                Held::Constant(_) | Held::Derived(_) | Held::Unknown(_) => {}
            }
        }
        Self { case, others, constants }
    }

    /// Completes what is told about the node: hypothesis, receptive fields, reproduction.
    ///
    /// # Errors
    /// When the reproduction was asked for and cannot be written.
    pub fn blame(&self, outside: &mut Outside, options: &Options, party: &str, model: &Model) -> Result<()> {
        let Some(case) = Some(&self.case).filter(|case| case.name == outside.node) else { return Ok(()) };
        for worst in &mut outside.worst {
            let output = case.node.output.iter().position(|name| *name == worst.tensor);
            let of_its_shape = |output: usize| {
                case.found[output].as_ref().is_some_and(|found| {
                    found.shape.len() == worst.index.len()
                        && found.shape.iter().zip(&worst.index).all(|(side, i)| i < side)
                })
            };
            if let Some(output) = output.filter(|&output| of_its_shape(output)) {
                worst.receptive_field = text(case, &receptive_field(case, output, &worst.index));
            }
        }
        let first = case.node.output.first();
        let place = outside.worst.iter().find(|worst| Some(&worst.tensor) == first);
        let others = Others { tensors: &self.others, later: &computed_from(model, &case.node.output) };
        outside.hypothesis = explain(case, place.map(|worst| &worst.index[..]), others);
        if let Some(parent) = &options.reproductions {
            let folder = reproduction::write(parent, case, &self.constants, party)?;
            outside.reproduction = Some(folder.display().to_string());
        }
        Ok(())
    }
}

/// The tensors that are computed from these.
fn computed_from(model: &Model, names: &[String]) -> BTreeSet<String> {
    let mut all: BTreeSet<String> = names.iter().cloned().collect();
    for node in model.nodes() {
        if node.input.iter().any(|name| all.contains(name)) {
            all.extend(node.output.iter().cloned());
        }
    }
    all
}

//! One node of a graph, judged, as the report tells it.

use std::time::Instant;

use super::case::{Case, Operand, View};
use super::judge::{self, Judgement, judge_view};
use super::party::{Held, Tensors};
use super::report::NodeReport;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// One node, judged.
pub(super) struct Node {
    pub report: NodeReport,
    pub judgement: Judgement,
    /// Its operands that the reference filled in.
    pub derived: Vec<String>,
    /// The case itself, of a node that may be the first outside rounding.
    pub case: Option<Case>,
}

impl Node {
    /// Judges a node from the tensors that are held.
    pub fn judge(model: &Model, index: usize, held: &Tensors, effort: f64) -> Self {
        let begin = Instant::now();
        let node = &model.nodes()[index];
        let name = name(node, index);
        let (mut case, mut derived) = (None, Vec::new());
        let viewed = known_version(model, node).and_then(|()| view(node, model.opset(), held, &mut derived));
        let judgement = match viewed {
            Ok(view) => {
                let judgement = judge_view(&view, effort);
                if judgement.is_outside() {
                    case = owned(&view, &name);
                }
                judgement
            }
            Err(why) => Judgement::incomparable(why),
        };
        let report = NodeReport {
            index,
            name,
            op: operator(node),
            verdict: judgement.verdict,
            why: judgement.why.clone(),
            attributes: node.attribute.iter().map(attribute).collect(),
            inputs: node.input.clone(),
            outputs: node.output.clone(),
            tensors: judgement.tensors.clone(),
            source: super::source::source(node),
            seconds: begin.elapsed().as_secs_f64(),
        };
        Self { report, judgement, derived, case }
    }
}

/// About how many products a node of a graph takes.
pub(super) fn cost(model: &Model, index: usize, held: &Tensors) -> f64 {
    let view = view(&model.nodes()[index], model.opset(), held, &mut Vec::new());
    view.map_or(0.0, |view| judge::cost(&view))
}

/// A node's name as reports give it: the file's, or `OPERATOR_INDEX` where it gives none.
pub fn name(node: &NodeProto, index: usize) -> String {
    match node.name.as_deref() {
        None | Some("") => format!("{}_{index}", node.op_type.as_deref().unwrap_or_default()),
        Some(name) => name.to_owned(),
    }
}

/// A node's operator, with its domain where that is not ONNX's own.
pub fn operator(node: &NodeProto) -> String {
    let operator = node.op_type.clone().unwrap_or_default();
    match node.domain.as_deref() {
        None | Some("" | "ai.onnx") => operator,
        Some(domain) => format!("{domain}.{operator}"),
    }
}

fn view<'a>(
    node: &'a NodeProto,
    opset: i64,
    held: &'a Tensors,
    derived: &mut Vec<String>,
) -> Result<View<'a>, String> {
    let mut operands = Vec::with_capacity(node.input.len());
    for name in &node.input {
        operands.push(match held.get(name) {
            _ if name.is_empty() => None,
            Some(Held::Given(tensor) | Held::Constant(tensor)) => Some(Operand::Given(tensor)),
            Some(Held::Derived(value)) => {
                derived.push(name.clone());
                Some(Operand::Derived(value))
            }
            Some(Held::Unknown(why)) => return Err(format!("its operand \"{name}\" is not there: {why}")),
            None => return Err(format!("its operand \"{name}\" is made by no node before it")),
        });
    }
    let found = node.output.iter().map(|name| match held.get(name) {
        Some(Held::Given(tensor)) => Some(tensor.as_ref()),
        _ => None,
    });
    Ok(View { node, opset, operands, found: found.collect() })
}

/// Refuses another version of ONNX Runtime's domain than that whose meaning is known; ONNX's own is looked at with the operator.
fn known_version(model: &Model, node: &NodeProto) -> Result<(), String> {
    match node.domain.as_deref().and_then(|domain| Some((domain, model.opset_of(domain)?))) {
        Some((domain @ "com.microsoft", version)) if version != 1 => {
            Err(format!("version {version} of domain {domain}; version 1 is known"))
        }
        _ => Ok(()),
    }
}

/// The case with its own tensors; `None` where the reference filled some in.
fn owned(view: &View, name: &str) -> Option<Case> {
    let operands = view
        .operands
        .iter()
        .map(|operand| match operand {
            None => Some(None),
            Some(Operand::Given(tensor)) => Some(Some((*tensor).clone())),
            Some(Operand::Derived(_)) => None,
        })
        .collect::<Option<Vec<Option<TypedTensor>>>>()?;
    Some(Case {
        node: view.node.clone(),
        opset: view.opset,
        name: name.to_owned(),
        operands,
        found: view.found.iter().map(|found| found.cloned()).collect(),
    })
}

/// An attribute's name and its value as text.
fn attribute(attribute: &AttributeProto) -> (String, String) {
    let name = attribute.name.clone().unwrap_or_default();
    let text = if let Some(tensor) = &attribute.t {
        match TypedTensor::read(tensor) {
            Ok(tensor) if tensor.len() <= 8 => {
                let numbers = tensor.to_f64().map(|v| format!("{v:?}"));
                format!("{}{:?} {}", tensor.element(), tensor.shape, numbers.unwrap_or_default())
            }
            Ok(tensor) => format!("{}{:?}", tensor.element(), tensor.shape),
            Err(why) => why,
        }
    } else if let Some(bytes) = &attribute.s {
        String::from_utf8_lossy(bytes).into_owned()
    } else if let Some(number) = attribute.f {
        number.to_string()
    } else if let Some(number) = attribute.i {
        number.to_string()
    } else if !attribute.ints.is_empty() {
        format!("{:?}", attribute.ints)
    } else if !attribute.floats.is_empty() {
        format!("{:?}", attribute.floats)
    } else {
        String::new()
    };
    (name, text.trim_end().to_owned())
}

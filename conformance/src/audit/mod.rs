//! The audit of an exported graph: every node a second party ran, judged against the node's specified meaning.
//!
//! Each node is evaluated by the reference from the second party's *own* operands, so that a fault is counted once, where
//! it is made, and not again in every node that it flows through. What a difference can be is graded as
//! [`precision`] states it; the grades of all nodes make the verdict.
//!
//! | file | is |
//! |---|---|
//! | [`report`] | what an audit found, as data |
//! | [`party`] | who computed: [`onnx_runtime`] runs the graph, [`dump`] reads what another engine left |
//! | [`case`] | one node with its operands and outputs |
//! | [`judge`] | the certificate of one node |
//! | [`precision`], [`measure`], [`slope`] | the grade of an element, of a tensor, of what all its elements share |
//!
//! # What if the second party lacks a tensor?
//! The reference fills it in from the tensors before it, with the bound of its rounding, and the next tensor that is there
//! is judged against a bound that has grown along the way. The nodes between are judged together, and count as compared
//! only if that bound still says something.

pub mod case;
mod discontinuity;
pub mod dump;
mod estimate;
mod findings;
pub mod inputs;
pub mod judge;
pub mod measure;
mod node;
pub mod onnx_runtime;
pub mod party;
pub mod precision;
mod reading;
mod region;
pub mod report;
mod segment;
pub mod slope;
pub mod variant;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;

pub use case::Case;
pub use dump::Dump;
pub use judge::{Judgement, judge, judge_as};
pub use onnx_runtime::OnnxRuntime;
pub use party::Party;
pub use report::Audit;

use crate::error::{Error, Result};
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;
use findings::Findings;
use node::Node;
use party::{Held, Segment, Tensors};
use report::{GraphSummary, SCHEMA};

/// What may be chosen about an audit.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Where the inputs came from, for the report.
    pub inputs: String,
}

/// Audits a graph: every node that `party` ran, from the party's own operands.
///
/// `progress` is told how many nodes of how many are judged, and the name of the last.
///
/// # Errors
/// When an input is missing or unknown, a constant cannot be read, or the party is not there. A disagreement is no error.
pub fn audit(
    model: &Model,
    inputs: &BTreeMap<String, TypedTensor>,
    party: &mut dyn Party,
    options: &Options,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<Audit> {
    let begin = Instant::now();
    let mut held = given(model, inputs)?;
    let last_use = last_uses(model);
    let mut findings = Findings::new(party.computes());
    let total = model.nodes().len();
    while findings.nodes.len() < total {
        let first = findings.nodes.len();
        let mut segment = party.segment(model, first, &held)?;
        findings.notes.append(&mut segment.notes);
        judge_segment(model, segment, &mut held, &mut findings, progress);
        let next = findings.nodes.len();
        held.retain(|name, _| last_use.get(name.as_str()).is_some_and(|&last| last >= next));
    }
    let coverage = findings.coverage(party.unmatched());
    Ok(Audit {
        schema: SCHEMA.to_owned(),
        verdict: findings.verdict(),
        graph: GraphSummary {
            path: model.name().to_owned(),
            sha256: model.sha256(),
            opset: model.opset(),
            producer: model.producer().to_owned(),
        },
        runtime: party.describe(),
        inputs: options.inputs.clone(),
        first_outside: findings.first_outside(),
        notes: findings.notes(),
        nodes: findings.nodes,
        coverage,
        outputs: Vec::new(),
        shipped: None,
        seconds: begin.elapsed().as_secs_f64(),
    })
}

/// The constants and inputs, before the first node.
fn given(model: &Model, inputs: &BTreeMap<String, TypedTensor>) -> Result<Tensors> {
    let error = |item: String, message: &str| Error::Onnx {
        graph: model.name().to_owned(),
        item,
        message: message.to_owned(),
    };
    let declared: BTreeSet<&str> = model.inputs().into_iter().collect();
    if let Some(name) = declared.iter().find(|name| !inputs.contains_key(**name)) {
        return Err(error(format!("input \"{name}\""), "is not given; give an array of this name"));
    }
    if let Some(name) = inputs.keys().find(|name| !declared.contains(name.as_str())) {
        return Err(error(format!("input \"{name}\""), "is given, but the graph has no such input"));
    }
    // A constant that is not read, such as a list of texts, is missing in those nodes alone that read it.
    let constants = model.constant_names().map(|name| match model.constant(name) {
        Ok(tensor) => (name.to_owned(), Held::Constant(Arc::new(tensor))),
        Err(why) => (name.to_owned(), Held::Unknown(why.to_string())),
    });
    let inputs = inputs.iter().map(|(name, tensor)| (name.clone(), Held::Given(Arc::new(tensor.clone()))));
    Ok(constants.chain(inputs).collect())
}

/// The last node that reads each tensor.
fn last_uses(model: &Model) -> BTreeMap<&str, usize> {
    let mut last = BTreeMap::new();
    for (index, node) in model.nodes().iter().enumerate() {
        for name in node.input.iter().filter(|name| !name.is_empty()) {
            last.insert(name.as_str(), index);
        }
    }
    last
}

/// Judges the nodes of a segment: those whose outputs are all there in parallel, the others one after the other, since what
/// is filled in for one is read by the next.
fn judge_segment(
    model: &Model,
    segment: Segment,
    held: &mut Tensors,
    findings: &mut Findings,
    progress: &mut dyn FnMut(usize, usize, &str),
) {
    let Segment { nodes, tensors, missing, .. } = segment;
    held.extend(tensors.into_iter().map(|(name, tensor)| (name, Held::Given(Arc::new(tensor)))));
    let is_whole =
        |index: &usize| model.nodes()[*index].output.iter().all(|name| !missing.contains_key(name));
    let mut index = nodes.start;
    while index < nodes.end {
        let run = (index..nodes.end).take_while(is_whole).count().max(1);
        let judged: Vec<Node> =
            (index..index + run).into_par_iter().map(|i| Node::judge(model, i, held)).collect();
        for node in judged {
            progress(node.report.index + 1, model.nodes().len(), &node.report.name);
            findings.add(node, &missing, held);
        }
        index += run;
    }
}

#[cfg(test)]
mod tests;

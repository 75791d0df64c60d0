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
//! | [`judge`](mod@judge) | the certificate of one node |
//! | [`region`] | a box of a tensor; large nodes are judged box by box, or by a stated sample of boxes |
//! | [`hypothesis`] | which mistake explains the numbers of a node that is outside rounding |
//! | [`receptive_field`], [`source`], [`reproduction`] | what else is told about that node |
//! | [`shipped`], [`passes`] | the session as shipped, and which optimiser changes what |
//! | `recurrence` | recurrent layers, step by step |
//! | `gap` | nodes of which the second party kept nothing |
//! | [`precision`], [`measure`], [`slope`] | the grade of an element, of a tensor, of what all its elements share |
//!
//! # What if the second party lacks a tensor?
//! The reference fills it in from the tensors before it, with the bound of its rounding, and the next tensor that is there
//! is judged against a bound that has grown along the way, or against drawn roundings where that bound says nothing any
//! more (`gap`). The nodes between are judged together, and count as compared only if either says something.

mod blame;
pub mod case;
#[cfg(test)]
mod cases_for_tests;
mod chain;
mod compare;
mod discontinuity;
mod division;
pub mod dump;
mod estimate;
mod findings;
mod gap;
pub mod hypothesis;
pub mod inputs;
pub mod judge;
pub mod measure;
mod node;
pub mod onnx_runtime;
pub mod party;
pub mod passes;
pub mod precision;
mod reading;
pub mod receptive_field;
mod recurrence;
pub mod region;
pub mod report;
pub mod reproduction;
mod retype;
mod same_order;
mod sample;
mod segment;
pub mod shipped;
pub mod slope;
pub mod source;
pub mod variant;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::PathBuf;
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
use chain::Chain;
use findings::Findings;
use gap::Gaps;
use node::Node;
use party::{Held, Segment, Tensors};
use report::{GraphSummary, SCHEMA};
use retype::{output_element, retyped};

/// What may be chosen about an audit.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where the inputs came from, for the report.
    pub inputs: String,
    /// About how many products the reference may compute, over all nodes. What would take more is judged by sample, with a
    /// quarter of it: a larger sample would find little else.
    pub effort: f64,
    /// About how many products one pass of the reference's own chain may compute; it makes several.
    pub chain: f64,
    /// Where the one-node reproduction of the first node outside rounding is written; nowhere by default.
    pub reproductions: Option<PathBuf>,
}

impl Default for Options {
    /// An effort that two cores make in a quarter of a minute.
    fn default() -> Self {
        Self { inputs: String::new(), effort: 4e9, chain: 3e8, reproductions: None }
    }
}

/// Audits a graph: every node that `party` ran, from the party's own operands.
///
/// `progress` is told how many nodes of how many are judged, and the name of the last.
///
/// # Errors
/// When an input is missing or unknown, a constant cannot be read, the party is not there, or the
/// reproduction that was asked for cannot be written. A disagreement is no error.
pub fn audit(
    model: &Model,
    inputs: &BTreeMap<String, TypedTensor>,
    party: &mut dyn Party,
    options: &Options,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<Audit> {
    let begin = Instant::now();
    let mut run = Run {
        model,
        computes: party.computes(),
        effort: options.effort,
        last_use: last_uses(model),
        held: given(model, inputs)?,
        findings: Findings::new(party.computes()),
        gaps: Gaps::default(),
        chain: Chain::new(model, inputs, options.chain),
    };
    while run.findings.nodes.len() < model.nodes().len() {
        let segment = party.segment(model, run.findings.nodes.len(), &run.held)?;
        run.judge(segment, progress);
    }
    let Run { mut findings, chain, .. } = run;
    if let Some(why) = &chain.ended {
        findings.notes.push(format!("differences from end to end are not stated: {why}"));
    }
    let mut first_outside = findings.first_outside();
    if let (Some(outside), Some(scene)) = (&mut first_outside, findings.scene_outside()) {
        scene.blame(outside, options, &party.describe(), model)?;
    }
    let coverage = findings.coverage(party.unmatched());
    let shipped = party.ships().and_then(|threads| {
        shipped::shipped(model, inputs, threads, &findings.nodes)
            .map_err(|why| findings.notes.push(format!("the session as shipped was not audited: {why}")))
            .ok()
    });
    Ok(Audit {
        schema: SCHEMA.to_owned(),
        verdict: findings.verdict(),
        graph: GraphSummary {
            path: model.name().to_owned(),
            sha256: model.sha256(),
            opset: model.opset(),
            producer: model.producer().to_owned(),
            inputs: model.inputs().into_iter().map(str::to_owned).collect(),
        },
        runtime: party.describe(),
        inputs: options.inputs.clone(),
        first_outside,
        notes: findings.notes(),
        nodes: findings.nodes,
        coverage,
        outputs: chain.outputs(),
        shipped,
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
    for (value, tensor) in
        model.declared_inputs().into_iter().filter_map(|v| Some((v, inputs.get(v.name.as_deref()?)?)))
    {
        inputs::check(value, tensor)
            .map_err(|why| error(format!("input \"{}\"", value.name.as_deref().unwrap_or_default()), &why))?;
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

/// An audit under way.
struct Run<'a> {
    model: &'a Model,
    computes: bool,
    effort: f64,
    last_use: BTreeMap<&'a str, usize>,
    held: Tensors,
    findings: Findings,
    gaps: Gaps,
    chain: Chain,
}

impl Run<'_> {
    /// Holds the tensors of a segment, each in the type that it has in the graph.
    fn hold(&mut self, nodes: &Range<usize>, mut tensors: BTreeMap<String, TypedTensor>) {
        for node in &self.model.nodes()[nodes.clone()] {
            // An engine's own types are what they are; only what was written to a file may have been widened.
            let element = if self.computes {
                None
            } else {
                output_element(node, |name| self.held.get(name)?.element())
            };
            for (k, name) in node.output.iter().enumerate() {
                let Some(mut tensor) = tensors.remove(name) else { continue };
                if let Some(element) = element.filter(|&element| k == 0 && element != tensor.element()) {
                    let kept = tensor.element();
                    self.findings.notes.push(format!(
                        "\"{name}\" is {element} in the graph and was kept as {kept}; it is judged as {element}"
                    ));
                    tensor = retyped(&tensor, element);
                }
                self.held.insert(name.clone(), Held::Given(Arc::new(tensor)));
            }
        }
    }

    /// Judges the nodes of a segment: those whose outputs are all there in parallel, the others one after the other, since
    /// what is filled in for one is read by the next.
    fn judge(&mut self, segment: Segment, progress: &mut dyn FnMut(usize, usize, &str)) {
        let Segment { nodes, tensors, missing, mut notes } = segment;
        let total = self.model.nodes().len();
        self.findings.notes.append(&mut notes);
        self.hold(&nodes, tensors);
        let costs: Vec<f64> = nodes.clone().map(|i| node::cost(self.model, i, &self.held)).collect();
        let effort = self.effort * nodes.len() as f64 / total as f64;
        let is_affordable = costs.iter().sum::<f64>() <= effort;
        let effort = sample::share(&costs, if is_affordable { effort } else { effort / 4.0 });
        let is_whole =
            |index: &usize| self.model.nodes()[*index].output.iter().all(|name| !missing.contains_key(name));
        let mut next = nodes.start;
        while next < nodes.end {
            let end = next + (next..nodes.end).take_while(is_whole).count().max(1);
            let judge = |index| Node::judge(self.model, index, &self.held, effort);
            let judged: Vec<Node> = (next..end).into_par_iter().map(judge).collect();
            for node in judged {
                let index = node.report.index;
                progress(index + 1, total, &node.report.name);
                let cost = costs[index - nodes.start];
                let evidence = self.gaps.step(self.model, index, &self.held, &missing, cost);
                self.findings.add(node, &missing, evidence, &mut self.held);
                let report = &mut self.findings.nodes[index];
                self.chain.step(self.model, index, &self.held, cost, report);
                let needed = |name: &str| self.last_use.get(name).is_some_and(|&last| last > index);
                self.chain.retain(needed);
                self.gaps.retain(needed);
            }
            next = end;
        }
        let needed = |name: &str| self.last_use.get(name).is_some_and(|&last| last >= nodes.end);
        self.held.retain(|name, _| needed(name));
    }
}

#[cfg(test)]
mod tests;

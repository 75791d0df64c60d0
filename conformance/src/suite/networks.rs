//! Whole graphs: every node from its own inputs, and every named stage from the graph's inputs.
//!
//! Two questions, asked apart:
//!
//! - *Is every node right?* [`judge_nodes`] runs the graph once with every intermediate tensor as an output, feeds the
//!   reference each node's own operands, as the runtime saw them, and asks for the bound derived from rounding. An
//!   error made early is counted once, where it is made, and not again in every node that it flows through.
//! - *Is the graph the network?* [`judge_stages`] compares the reference's forward pass, written from the thesis and
//!   not from the graph, with the graph's outputs, in the tolerance that
//!   [`tolerance`](crate::tolerance) records.

use std::collections::{BTreeMap, BTreeSet};

use vitruvian_reference::network::{Stages, Weights, mf_pifu, vsr};
use vitruvian_reference::nn::{Rounded, Tensor};

use crate::array::Array;
use crate::compare::{Comparison, Expected, Found, compare};
use crate::engine::{self, Optimization};
use crate::error::{Error, Result};
use crate::onnx::expose::expose;
use crate::onnx::model::Model;
use crate::onnx::walk::{self, Value};
use crate::problem::{exact, expected};
use crate::tolerance::{Kind, Tolerance};

/// One node's verdict.
#[derive(Clone, Debug)]
pub struct NodeVerdict {
    /// The node's output tensor.
    pub tensor: String,
    /// ONNX's name of the operator.
    pub operator: String,
    /// The runtime's output against the reference's, both from the runtime's own operands.
    pub comparison: Comparison,
}

/// Judges every node of a graph from its own operands, as the runtime computed them with optimisation off.
///
/// # Errors
/// When the graph cannot run, or a node is not understood; names the node's output.
pub fn judge_nodes(model: &Model, inputs: &[(&str, &Array)]) -> Result<Vec<NodeVerdict>> {
    let mut values: BTreeMap<String, Value<Rounded>> =
        model.constants()?.iter().map(|(name, constant)| (name.clone(), Value::constant(constant))).collect();
    for (name, array) in inputs {
        values.insert((*name).to_owned(), Value::Numbers(exact(&array.shape, &array.values)));
    }

    // Constants are no results; everything else is asked for.
    let computed: Vec<_> =
        model.nodes().iter().filter(|node| node.op_type.as_deref() != Some("Constant")).collect();
    let tensors: Vec<&str> =
        computed.iter().filter_map(|node| node.output.first()).map(String::as_str).collect();
    let bytes = expose(model, &tensors);
    let names: Vec<String> =
        Model::from_bytes(model.name(), bytes.clone())?.outputs().into_iter().map(str::to_owned).collect();
    let found = engine::run(model.name(), &bytes, Optimization::Disabled, inputs)?;
    let mut found: BTreeMap<String, Found> = names.into_iter().zip(found).collect();

    let mut verdicts = Vec::new();
    for node in model.nodes() {
        let tensor = node.output.first().cloned().unwrap_or_default();
        let operator = node.op_type.clone().unwrap_or_default();
        let error = |message: String| Error::Onnx {
            graph: model.name().to_owned(),
            item: format!("node {operator} → \"{tensor}\""),
            message,
        };
        let mut operands = Vec::new();
        for name in &node.input {
            let value = values.get(name);
            if value.is_none() && !name.is_empty() {
                return Err(error(format!("its operand \"{name}\" is made by no node before it")));
            }
            operands.push(value);
        }
        match walk::evaluate(node, &operands).map_err(error)? {
            Value::Integers(integers) => {
                values.insert(tensor, Value::Integers(integers));
            }
            Value::Numbers(answer) => {
                let own = if operator == "Constant" {
                    Value::Numbers(answer)
                } else {
                    let found = found
                        .remove(&tensor)
                        .ok_or_else(|| error("the runtime gave no such tensor".into()))?;
                    let comparison = compare(&expected(&operator, &answer), &found);
                    let own = Value::Numbers(exact(&found.shape, &found.values));
                    verdicts.push(NodeVerdict {
                        tensor: tensor.clone(),
                        operator: operator.clone(),
                        comparison,
                    });
                    own
                };
                values.insert(tensor, own);
            }
        }
    }
    Ok(verdicts)
}

/// One stage's agreement.
#[derive(Clone, Debug)]
pub struct StageVerdict {
    /// The stage, which is an output of the graph.
    pub stage: String,
    /// Largest |ŷ − y| over the stage's largest |y|.
    pub relative_error: f64,
    /// The comparison in the recorded tolerance.
    pub comparison: Comparison,
}

/// The weights of a graph by their names.
fn weights(model: &Model) -> Result<Weights> {
    let mut weights = Vec::new();
    for (name, constant) in model.constants()? {
        let values = constant.to_f64().ok_or_else(|| Error::Onnx {
            graph: model.name().to_owned(),
            item: format!("initializer \"{name}\""),
            message: "holds integers, weights were expected".into(),
        })?;
        weights.push((name, Tensor::new(&constant.shape, values)));
    }
    Ok(weights.into_iter().collect())
}

/// The reference's forward pass of the network that a graph declares by `vitruvian.kind`, with the graph's weights, from the
/// graph's inputs in their order.
///
/// # Errors
/// When the graph declares no kind that is known here, or a weight is not floating-point.
///
/// # Panics
/// As the reference does when a weight is missing, left over or of a shape that does not fit, or the inputs do not fit.
pub fn reference_stages(model: &Model, inputs: &[(&str, &Array)]) -> Result<Stages> {
    let exact =
        |array: &Array| Tensor::new(&array.shape, array.values.iter().map(|&v| f64::from(v)).collect());
    let inputs: Vec<Tensor> = inputs.iter().map(|(_, array)| exact(array)).collect();
    let inputs: Vec<&Tensor> = inputs.iter().collect();
    let weights = weights(model)?;
    Ok(match Kind::of(model)? {
        Kind::MfPifuEncoder => mf_pifu::Encoder::from_weights(weights).forward(inputs[0]),
        Kind::MfPifuQuery => {
            mf_pifu::Query::from_weights(weights).forward(&inputs[..4], inputs[4], inputs[5])
        }
        Kind::VsrEncoder => vsr::Encoder::from_weights(weights).forward(inputs[0]),
        Kind::VsrQuery => vsr::Query::from_weights(weights).forward(&inputs[..5], inputs[5]),
    })
}

/// Compares the graph's outputs with the stages of the same names; gives the outputs as well.
///
/// # Errors
/// When the graph cannot run.
///
/// # Panics
/// When an output is no stage of the reference.
pub fn judge_stages(
    model: &Model,
    stages: &Stages,
    inputs: &[(&str, &Array)],
    optimization: Optimization,
    tolerance: &Tolerance,
) -> Result<(Vec<StageVerdict>, Vec<Found>)> {
    let found = engine::run(model.name(), model.bytes(), optimization, inputs)?;
    let verdicts = model.outputs().into_iter().zip(&found).map(|(stage, found)| {
        let answer = stages.get(stage);
        let largest = answer.data.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        let expected = Expected::within(&answer.shape, answer.data.clone(), tolerance.allowed * largest);
        let comparison = compare(&expected, found);
        let relative_error =
            comparison.report().map_or(f64::INFINITY, |report| report.csu * tolerance.allowed);
        StageVerdict { stage: stage.to_owned(), relative_error, comparison }
    });
    Ok((verdicts.collect(), found))
}

/// Operators of the graph that no judge covers; empty when the judgement is complete.
pub fn unjudged(model: &Model) -> BTreeSet<String> {
    let judged: BTreeSet<&str> = super::operators::JUDGES.iter().map(|judge| judge.operator).collect();
    // A Constant computes nothing: it is read, by the same reader as every weight.
    model
        .operators()
        .into_iter()
        .filter(|name| !judged.contains(name.as_str()) && name != "Constant")
        .collect()
}

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

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use vitruvian_reference::network::{Stages, Weights, mf_pifu, regressor, vsr};
use vitruvian_reference::nn::{Rounded, Tensor};

use crate::array::Array;
use crate::certificate::UNIT_ROUNDOFF;
use crate::compare::{Comparison, Expected, Found, compare};
use crate::engine::{self, Optimization};
use crate::error::{Error, Result};
use crate::onnx::element::ElementType;
use crate::onnx::expose::expose;
use crate::onnx::model::Model;
use crate::onnx::walk::{self, Data, Value};
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
/// Shapes, places and truths are no results of rounding: the reference computes them for itself, and a runtime that got one
/// wrong would be seen in the numbers that it chose or moved.
///
/// # Errors
/// When the graph cannot run, or a node is not understood; names the node's output.
pub fn judge_nodes(model: &Model, inputs: &[(&str, &Array)]) -> Result<Vec<NodeVerdict>> {
    let mut values: BTreeMap<String, Value<Rounded>> = BTreeMap::new();
    for (name, constant) in model.constants()? {
        let value = Value::of(&constant).map_err(|message| Error::Onnx {
            graph: model.name().to_owned(),
            item: format!("initializer \"{name}\""),
            message,
        })?;
        values.insert(name, value);
    }
    for (name, array) in inputs {
        values.insert((*name).to_owned(), f32_value(&array.shape, &array.values));
    }

    // Constants are no results; everything else is asked for.
    let computed = model.nodes().iter().filter(|node| node.op_type.as_deref() != Some("Constant"));
    let tensors: Vec<&str> = computed.flat_map(|node| &node.output).map(String::as_str).collect();
    let tensors: Vec<&str> = tensors.into_iter().filter(|name| !name.is_empty()).collect();
    let bytes = expose(model, &tensors);
    let found = engine::run_f32(model.name(), &bytes, Optimization::Disabled, inputs)?;
    let mut found: BTreeMap<String, Found> = found.into_iter().collect();

    let mut verdicts = Vec::new();
    for node in model.nodes() {
        let operator = node.op_type.clone().unwrap_or_default();
        let error = |message: String| Error::Onnx {
            graph: model.name().to_owned(),
            item: format!("node {operator} → \"{}\"", node.output.first().map_or("", String::as_str)),
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
        let answers = walk::evaluate(node, model.opset(), &operands).map_err(error)?;
        for (tensor, answer) in node.output.iter().zip(answers) {
            let Some(answer) = answer else { continue };
            let own = match answer.data {
                Data::Numbers(answer) if operator != "Constant" => {
                    let found = found
                        .remove(tensor)
                        .ok_or_else(|| error(format!("the runtime gave no f32 tensor \"{tensor}\"")))?;
                    let comparison = compare(&expected(&operator, &answer), &found);
                    verdicts.push(NodeVerdict {
                        tensor: tensor.clone(),
                        operator: operator.clone(),
                        comparison,
                    });
                    f32_value(&found.shape, &found.values)
                }
                data => Value { element: answer.element, data },
            };
            values.insert(tensor.clone(), own);
        }
    }
    Ok(verdicts)
}

/// f32 numbers as exact operands.
fn f32_value(shape: &[usize], values: &[f32]) -> Value<Rounded> {
    Value::from_numbers(ElementType::F32, exact(shape, values))
}

/// The reference's forward pass of a graph's network, and how far rounding carries it.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The stages by name.
    pub stages: Stages,
    /// The same with every weight and every coordinate off by a random share of one rounding.
    disturbed: Stages,
}

/// The weights of a graph by their names; with a seed, each off by a random relative error of at most u.
fn weights(model: &Model, disturbance: Option<u64>) -> Result<Weights> {
    let mut random = ChaCha8Rng::seed_from_u64(disturbance.unwrap_or_default());
    let mut weights = Vec::new();
    for (name, constant) in model.constants()? {
        // Integers name shapes and axes.
        let Some(mut values) = constant.to_f64() else { continue };
        if disturbance.is_some() {
            values.iter_mut().for_each(|w| *w *= 1.0 + UNIT_ROUNDOFF * random.random_range(-1.0..1.0));
        }
        weights.push((name, Tensor::new(&constant.shape, values)));
    }
    Ok(weights.into_iter().collect())
}

impl Reference {
    /// The forward pass of the network that a graph declares by `vitruvian.kind`, with the graph's weights, from the graph's
    /// inputs in their order.
    ///
    /// # Errors
    /// When the graph declares no kind that is known here, or a weight cannot be read.
    ///
    /// # Panics
    /// As the reference does when a weight is missing, left over or of a shape that does not fit, or the inputs do not fit.
    pub fn of(model: &Model, inputs: &[(&str, &Array)]) -> Result<Self> {
        let exact =
            |array: &Array| Tensor::new(&array.shape, array.values.iter().map(|&v| f64::from(v)).collect());
        let exact: Vec<Tensor> = inputs.iter().map(|(_, array)| exact(array)).collect();
        let kind = Kind::of(model)?;
        let forward = |weights: Weights, inputs: &[Tensor]| {
            let inputs: Vec<&Tensor> = inputs.iter().collect();
            match kind {
                Kind::MfPifuEncoder => mf_pifu::Encoder::from_weights(weights).forward(inputs[0]),
                Kind::MfPifuQuery => {
                    mf_pifu::Query::from_weights(weights).forward(&inputs[..4], inputs[4], inputs[5])
                }
                Kind::Regressor => regressor::Regressor::from_weights(weights).forward(inputs[0]),
                Kind::VsrEncoder => vsr::Encoder::from_weights(weights).forward(inputs[0]),
                Kind::VsrQuery => vsr::Query::from_weights(weights).forward(&inputs[..5], inputs[5]),
            }
        };
        let mut disturbed = exact.clone();
        let coordinates = match kind {
            Kind::MfPifuQuery => Some(4),
            Kind::VsrQuery => Some(5),
            Kind::MfPifuEncoder | Kind::Regressor | Kind::VsrEncoder => None,
        };
        if let Some(grid) = coordinates {
            let mut random = ChaCha8Rng::seed_from_u64(2);
            let rounding =
                |x: &mut f64| *x += UNIT_ROUNDOFF * (x.abs() + 1.0) * random.random_range(-1.0..1.0);
            disturbed[grid].data.iter_mut().for_each(rounding);
        }
        Ok(Self {
            stages: forward(weights(model, None)?, &exact),
            disturbed: forward(weights(model, Some(1))?, &disturbed),
        })
    }

    /// The noise floor of a stage: the largest change that one rounding per product and coordinate makes, and at least one of the
    /// stage's largest value.
    ///
    /// A weight off by a share of u disturbs its products as their own rounding does, and a coordinate x off by a share of
    /// u·(|x| + 1) moves a sampled point as the sum x + 1 does that sampling begins with. So this is what f32 can be asked for,
    /// whatever the weights: the steeper the network, the higher the floor.
    ///
    /// # Panics
    /// When there is no such stage.
    pub fn noise_floor(&self, stage: &str) -> f64 {
        let (exact, disturbed) = (&self.stages.get(stage).data, &self.disturbed.get(stage).data);
        let noise = exact.iter().zip(disturbed).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs()));
        exact.iter().fold(noise, |a, x| a.max(UNIT_ROUNDOFF * x.abs()))
    }
}

/// One stage's agreement.
#[derive(Clone, Debug)]
pub struct StageVerdict {
    /// The stage, which is an output of the graph.
    pub stage: String,
    /// Largest |ŷ − y| in units of the stage's noise floor.
    pub noise: f64,
    /// The comparison in the recorded tolerance.
    pub comparison: Comparison,
}

/// Compares the graph's outputs with the stages of the same names, and of a regressor also its
/// [inner stages](super::regressor::stages); gives the outputs as well.
///
/// # Errors
/// When the graph cannot run.
///
/// # Panics
/// When an output is no stage of the reference.
pub fn judge_stages(
    model: &Model,
    reference: &Reference,
    inputs: &[(&str, &Array)],
    optimization: Optimization,
    tolerance: &Tolerance,
) -> Result<(Vec<StageVerdict>, Vec<Found>)> {
    let outputs = model.outputs();
    let mut stages: Vec<(String, String)> =
        outputs.iter().map(|&name| (name.to_owned(), name.to_owned())).collect();
    if Kind::of(model)? == Kind::Regressor {
        let inner = super::regressor::stages(model)?;
        stages.extend(inner.into_iter().filter(|(_, tensor)| !outputs.contains(&tensor.as_str())));
    }
    let tensors: Vec<&str> = stages.iter().map(|(_, tensor)| tensor.as_str()).collect();
    let mut found = engine::run(model.name(), &expose(model, &tensors), optimization, inputs)?;
    let verdicts = stages.iter().zip(&found).map(|((stage, _), found)| {
        let answer = reference.stages.get(stage);
        let allowed = tolerance.allowed * reference.noise_floor(stage);
        let comparison = compare(&Expected::within(&answer.shape, answer.data.clone(), allowed), found);
        let noise = comparison.report().map_or(f64::INFINITY, |report| report.csu * tolerance.allowed);
        StageVerdict { stage: stage.clone(), noise, comparison }
    });
    let verdicts = verdicts.collect();
    found.truncate(outputs.len());
    Ok((verdicts, found))
}

/// Operators of the graph that no judge covers; empty when the judgement is complete.
pub fn unjudged(model: &Model) -> BTreeSet<String> {
    let judged: BTreeSet<&str> = super::operators::JUDGES.iter().map(|judge| judge.operator).collect();
    // A Constant computes nothing: it is read, by the same reader as every weight.
    let judged = |name: &String| name == "Constant" || judged.contains(name.as_str());
    model.operators().into_iter().filter(|name| !judged(name)).collect()
}

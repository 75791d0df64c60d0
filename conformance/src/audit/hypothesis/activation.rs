//! Activations: slopes, approximations, bounds, axes of softmax, and functions taken for others.

use super::Suspicion;
use super::change::{Meaning, Operands, Outputs, attributes, float, in_opset, int, numbers, operator, text};
use super::fit::Parameter;
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::walk;

/// Attributes that are one number, ONNX's default, and values that other frameworks use.
const NUMBERS: &[(&str, &str, f32, &[f32])] = &[
    ("LeakyRelu", "alpha", 0.01, &[0.01, 0.1, 0.2, 0.3, 0.0, 1.0 / 3.0]),
    ("Elu", "alpha", 1.0, &[1.0]),
    ("Celu", "alpha", 1.0, &[1.0]),
    ("ThresholdedRelu", "alpha", 1.0, &[1.0, 0.0]),
    ("HardSigmoid", "alpha", 0.2, &[0.2, 1.0 / 6.0]),
    ("HardSigmoid", "beta", 0.5, &[0.5]),
    ("Selu", "alpha", 1.673_263_2, &[1.673_263_2]),
    ("Selu", "gamma", 1.050_701, &[1.050_701]),
    ("Shrink", "lambd", 0.5, &[0.5]),
    ("Shrink", "bias", 0.0, &[0.0, 0.5]),
    ("Swish", "alpha", 1.0, &[1.0, 1.702]),
];

/// Functions of one number that one may be taken for.
const FUNCTIONS: &[&str] = &[
    "Relu",
    "Identity",
    "LeakyRelu",
    "Sigmoid",
    "Tanh",
    "HardSigmoid",
    "HardSwish",
    "Gelu",
    "Elu",
    "Selu",
    "Softplus",
    "Softsign",
    "Swish",
    "Mish",
    "Erf",
    "Exp",
    "Log",
    "Sqrt",
    "Abs",
    "Neg",
    "Reciprocal",
    "Sin",
    "Cos",
    "Tan",
    "Asin",
    "Acos",
    "Atan",
];

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let mut all = own(trial);
    let name = trial.operator();
    if FUNCTIONS.contains(&name)
        || matches!(name, "Celu" | "Clip" | "ThresholdedRelu" | "PRelu" | "Softmax" | "LogSoftmax")
    {
        for other in FUNCTIONS.iter().filter(|&&other| other != name) {
            all.push(Suspicion::new(
                "activation",
                format!("{name} in the graph; {other} explains the numbers"),
                operator(other, Vec::new(), &[0]),
            ));
        }
        for (other, low, high) in
            [("Relu6", 0.0, 6.0), ("a clip to −1..1", -1.0, 1.0), ("a clip to 0..1", 0.0, 1.0)]
        {
            all.push(Suspicion::new(
                "activation",
                format!("{name} in the graph; {other} explains the numbers"),
                clipped(low, high),
            ));
        }
    } else {
        // An activation that was fused to the node, though the graph has none here, or has it at a later node.
        for (other, attributes) in [
            ("Relu", vec![]),
            ("LeakyRelu", vec![]),
            ("Sigmoid", vec![]),
            ("Tanh", vec![]),
            ("Gelu", vec![]),
            ("Elu", vec![]),
            ("HardSwish", vec![]),
        ] {
            all.push(Suspicion::new(
                "activation",
                format!("{name} in the graph; {name} and then {other} explain the numbers"),
                followed(other, attributes),
            ));
        }
    }
    all
}

/// The specified outputs, the first of them put through one more function.
fn followed(function: &'static str, attributes: Vec<AttributeProto>) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let mut outputs = walk::evaluate(node, opset, operands)?;
        let more = NodeProto {
            op_type: Some(function.into()),
            output: vec!["followed".into()],
            attribute: attributes.clone(),
            ..NodeProto::default()
        };
        let first = outputs.first().and_then(Option::as_ref);
        let changed = walk::evaluate(&more, opset.max(20), &[first])?.into_iter().next().flatten();
        outputs[0] = changed;
        Ok(outputs)
    })
}

/// Operand 0 between two numbers.
fn clipped(low: f64, high: f64) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let identity = NodeProto { op_type: Some("Identity".into()), attribute: Vec::new(), ..node.clone() };
        let first = operands.first().copied().flatten().ok_or("has no operand")?;
        let bounded =
            super::change::changed(first, |x| x.value.clamp(low, high)).ok_or("holds no numbers")?;
        walk::evaluate(&identity, opset, &[Some(&bounded)])
    })
}

fn own(trial: &Trial) -> Vec<Suspicion> {
    let (node, name) = (trial.node(), trial.operator());
    let mut all = Vec::new();
    for &(operator, attribute, default, values) in NUMBERS.iter().filter(|(operator, ..)| *operator == name) {
        let is = float(node, attribute, default);
        for &other in values.iter().filter(|&&other| other != is) {
            all.push(Suspicion::new(
                attribute,
                format!("{attribute} of {operator} is {is} in the graph; {other} explains the numbers"),
                attributes(vec![builder::float(attribute, other)]),
            ));
        }
    }
    match name {
        "Gelu" => {
            let is = text(node, "approximate", "none");
            let other = if is == "tanh" { "none" } else { "tanh" };
            all.push(Suspicion::new(
                "approximate",
                format!("approximate is {is} in the graph; {other} explains the numbers"),
                attributes(vec![builder::text("approximate", other)]),
            ));
            all.push(Suspicion::new(
                "approximate",
                format!("approximate is {is} in the graph; x·sigmoid(1.702·x) explains the numbers"),
                operator("Swish", vec![builder::float("alpha", 1.702)], &[0]),
            ));
        }
        "Sigmoid" => {
            for (alpha, beta) in [(0.2, 0.5), (1.0 / 6.0, 0.5), (0.25, 0.5)] {
                all.push(Suspicion::new(
                    "activation",
                    format!("Sigmoid in the graph; a hard sigmoid of slope {alpha:.4} explains the numbers"),
                    operator(
                        "HardSigmoid",
                        vec![builder::float("alpha", alpha), builder::float("beta", beta)],
                        &[0],
                    ),
                ));
            }
        }
        "Softmax" | "LogSoftmax" | "Hardmax" | "CumSum" => {
            let rank = trial.shape(0).map_or(0, <[usize]>::len);
            let is = int(node, "axis", if trial.case.opset < 13 { 1 } else { -1 });
            for axis in (0..rank as i64).filter(|&axis| axis != is && axis != is + rank as i64) {
                all.push(Suspicion::new(
                    "axis",
                    format!("axis is {is} in the graph; {axis} explains the numbers"),
                    attributes(vec![builder::int("axis", axis)]),
                ));
            }
            let (other, how) = if trial.case.opset < 13 {
                (13, "along the axis alone, as since opset 13, not over all axes from it on")
            } else {
                (11, "over all axes from the given one on, as before opset 13, not along the axis alone")
            };
            all.push(Suspicion::new("axis", format!("{name} was taken {how}"), in_opset(other)));
            let other = if name == "Softmax" { "LogSoftmax" } else { "Softmax" };
            all.push(Suspicion::new(
                "activation",
                format!("{name} in the graph; {other} explains the numbers"),
                Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| {
                    walk::evaluate(
                        &NodeProto { op_type: Some(other.into()), ..node.clone() },
                        opset,
                        operands,
                    )
                }),
            ));
        }
        "Clip" => {
            let bounds = [("min", 1, f64::NEG_INFINITY), ("max", 2, f64::INFINITY)];
            for (what, place, nothing) in bounds {
                all.push(Suspicion::new(
                    "bounds",
                    format!("the bound {what} was ignored"),
                    numbers(place, move |_| nothing),
                ));
                let attribute = if what == "min" { -f32::MAX } else { f32::MAX };
                all.push(Suspicion::new(
                    "bounds",
                    format!("the bound {what} was ignored"),
                    attributes(vec![builder::float(what, attribute)]),
                ));
            }
            all.push(Suspicion::new(
                "bounds",
                "both bounds were ignored",
                operator("Identity", Vec::new(), &[0]),
            ));
        }
        _ => {}
    }
    all
}

pub(super) fn parameters(trial: &Trial) -> Vec<Parameter> {
    let named = NUMBERS.iter().filter(|(operator, ..)| *operator == trial.operator());
    named
        .map(|&(operator, attribute, default, _)| {
            let is = float(trial.node(), attribute, default);
            Parameter::new(
                attribute,
                f64::from(is),
                move |value| {
                    format!("{attribute} of {operator} is {is} in the graph; {value} explains the numbers")
                },
                move |value| attributes(vec![builder::float(attribute, value as f32)]),
            )
        })
        .collect()
}

//! What lies beyond the border: kinds of padding, its sides, and what counts it.

use vitruvian_reference::nn::{Rounded, Tensor};

use super::Suspicion;
use super::change::{Meaning, Operands, attributes, exact, int, ints, numbers, text, with_attributes};
use super::fit::Parameter;
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::element::ElementType;
use crate::onnx::message::{AttributeKind, AttributeProto, NodeProto};
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    match trial.operator() {
        "Conv" | "ConvTranspose" | "AveragePool" | "MaxPool" | "LpPool" | "ConvInteger" | "QLinearConv" => {
            window(trial)
        }
        "Pad" => pad(trial),
        _ => Vec::new(),
    }
}

/// An attribute of integers of either sign.
pub(super) fn list(name: &str, values: &[i64]) -> AttributeProto {
    AttributeProto {
        name: Some(name.into()),
        kind: Some(AttributeKind::Ints as i32),
        ints: values.to_vec(),
        ..Default::default()
    }
}

/// Other ways to read a list of paddings, all before and then all after, each with a name for people.
fn misread(pads: &[i64]) -> Vec<(&'static str, Vec<i64>)> {
    let axes = pads.len() / 2;
    let (before, after) = pads.split_at(axes);
    let total: Vec<i64> = before.iter().zip(after).map(|(b, a)| b + a).collect();
    let zeros = vec![0; axes];
    let mut all = vec![
        ("before and after exchanged", [after, before].concat()),
        ("all of it before", [&total[..], &zeros].concat()),
        ("all of it after", [&zeros[..], &total].concat()),
        (
            "as before, after of each axis in turn",
            (0..pads.len()).map(|i| pads[2 * i % pads.len() + 2 * i / pads.len()]).collect(),
        ),
        (
            "axes in the opposite order",
            [before.iter().rev().copied().collect::<Vec<_>>(), after.iter().rev().copied().collect()]
                .concat(),
        ),
        ("none", vec![0; pads.len()]),
        (
            "one more before and one less after",
            before.iter().map(|b| b + 1).chain(after.iter().map(|a| a - 1)).collect(),
        ),
        (
            "one less before and one more after",
            before.iter().map(|b| b - 1).chain(after.iter().map(|a| a + 1)).collect(),
        ),
    ];
    all.retain(|(_, other)| other != pads && other.iter().all(|&side| side >= 0));
    all
}

/// The paddings of a window, also where `auto_pad` asks for computed ones.
fn pads(trial: &Trial) -> Option<Vec<i64>> {
    let node = trial.node();
    let (x, y) = (trial.shape(0)?, trial.output_shape()?);
    let axes = x.len().checked_sub(2)?;
    let auto = text(node, "auto_pad", "NOTSET");
    if !auto.starts_with("SAME") {
        let given = ints(node, "pads");
        return Some(if given.len() == 2 * axes { given } else { vec![0; 2 * axes] });
    }
    let kernel = match trial.operator() {
        "Conv" | "ConvTranspose" | "ConvInteger" | "QLinearConv" => {
            trial.shape(trial.weights())?.get(2..)?.iter().map(|&k| k as i64).collect()
        }
        _ => ints(node, "kernel_shape"),
    };
    let along = |name: &str, axis: usize| ints(node, name).get(axis).copied().unwrap_or(1);
    let total = |axis: usize| {
        let extent = (kernel[axis] - 1) * along("dilations", axis) + 1;
        let (x, y) = (x[axis + 2] as i64, y[axis + 2] as i64);
        match trial.operator() {
            "ConvTranspose" => (along("strides", axis) * (x - 1) + extent - y).max(0),
            _ => ((y - 1) * along("strides", axis) + extent - x).max(0),
        }
    };
    let totals: Vec<i64> = (0..axes).map(total).collect();
    let upper = auto == "SAME_UPPER";
    let before = |total: &i64| if upper { total / 2 } else { total - total / 2 };
    Some(totals.iter().map(before).chain(totals.iter().map(|total| total - before(total))).collect())
}

fn explicit(pads: &[i64]) -> Vec<AttributeProto> {
    vec![builder::text("auto_pad", "NOTSET"), list("pads", pads)]
}

fn window(trial: &Trial) -> Vec<Suspicion> {
    let node = trial.node();
    // Of the same numbers the additional rows on the other side are the closer meaning.
    let mut all =
        if trial.operator() == "ConvTranspose" { super::kernel::output_padding(trial) } else { Vec::new() };
    let pool = trial.operator().ends_with("Pool");
    if let Some(pads) = pads(trial) {
        let auto = text(node, "auto_pad", "NOTSET");
        let name = if auto == "NOTSET" { "pads" } else { "auto_pad" };
        for (how, other) in misread(&pads) {
            let is = if auto == "NOTSET" { format!("{pads:?}") } else { format!("{auto}, {pads:?}") };
            all.push(Suspicion::new(
                name,
                format!("{name} is {is} in the graph; {other:?} ({how}) explains the numbers"),
                attributes(explicit(&other)),
            ));
        }
        if pads.iter().any(|&side| side > 0) {
            for mode in ["edge", "reflect", "wrap"] {
                all.push(Suspicion::new(
                    "padding_mode",
                    format!("the graph pads with nothing; padding by {mode} explains the numbers"),
                    padded(mode, None, pads.clone()),
                ));
            }
            if trial.operator() == "MaxPool" {
                all.push(Suspicion::new(
                    "padding_mode",
                    "a padding never is a largest element; padding with zeros, which can be, explains the numbers",
                    padded("constant", Some(0.0), pads.clone()),
                ));
            }
        }
    }
    if pool {
        for (name, default) in [("count_include_pad", 0), ("ceil_mode", 0)] {
            let is = int(node, name, default);
            all.push(Suspicion::new(
                name,
                format!("{name} is {is} in the graph; {} explains the numbers", 1 - is),
                attributes(vec![builder::int(name, 1 - is)]),
            ));
        }
    }
    all
}

/// The node on an operand 0 that was padded beforehand.
fn padded(mode: &'static str, constant: Option<f64>, pads: Vec<i64>) -> Meaning {
    Box::new(move |node, _, operands| {
        let axes = pads.len() / 2;
        let all: Vec<i64> = [&[0, 0], &pads[..axes], &[0, 0], &pads[axes..]].concat();
        let sides = integers(all);
        let constant: Option<Value<Rounded>> = constant.map(|x| Value {
            element: ElementType::F32,
            data: Data::Numbers(Tensor::new(&[], vec![exact(x)])),
        });
        let pad = NodeProto {
            op_type: Some("Pad".into()),
            output: vec!["padded".into()],
            attribute: vec![builder::text("mode", mode)],
            ..NodeProto::default()
        };
        let x = operands.first().copied().flatten();
        // Wrapping came with version 19.
        let padded = walk::evaluate(&pad, 21, &[x, Some(&sides), constant.as_ref()])?;
        let mut others: Vec<_> = operands.to_vec();
        others[0] = padded.first().and_then(Option::as_ref);
        let bare = with_attributes(node, &explicit(&vec![0; pads.len()]));
        walk::evaluate(&bare, 21, &others)
    })
}

fn integers(list: Vec<i64>) -> Value<Rounded> {
    Value { element: ElementType::I64, data: Data::Integers(Tensor::new(&[list.len()], list)) }
}

fn pad(trial: &Trial) -> Vec<Suspicion> {
    let node = trial.node();
    let mut all = Vec::new();
    let is = text(node, "mode", "constant");
    for mode in ["constant", "edge", "reflect", "wrap"] {
        if mode != is {
            all.push(Suspicion::new(
                "padding_mode",
                format!("mode is {is} in the graph; {mode} explains the numbers"),
                Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| {
                    walk::evaluate(
                        &with_attributes(node, &[builder::text("mode", mode)]),
                        opset.max(19),
                        operands,
                    )
                }),
            ));
        }
    }
    let as_attribute = ints(node, "pads");
    let pads = match trial.integers(1) {
        Some(pads) => pads,
        None => as_attribute.clone(),
    };
    for (how, other) in misread(&pads) {
        let detail = format!("the paddings are {pads:?}; {other:?} ({how}) explains the numbers");
        let meaning = if as_attribute.is_empty() {
            super::change::integers(1, move |old| Some(Tensor::new(&old.shape, other.clone())))
        } else {
            attributes(vec![list("pads", &other)])
        };
        all.push(Suspicion::new("pads", detail, meaning));
    }
    all
}

pub(super) fn parameters(trial: &Trial) -> Vec<Parameter> {
    if trial.operator() != "Pad" || text(trial.node(), "mode", "constant") != "constant" {
        return Vec::new();
    }
    let is = trial.numbers(2).and_then(|numbers| numbers.first().copied()).unwrap_or(0.0);
    let meaning = move |value: f64| -> Meaning {
        if is == 0.0 {
            // The operand may be left out.
            Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| {
                let constant = Value {
                    element: ElementType::F32,
                    data: Data::Numbers(Tensor::new(&[], vec![exact(value)])),
                };
                let mut operands = operands.to_vec();
                operands.resize(operands.len().max(3), None);
                operands[2] = Some(&constant);
                walk::evaluate(node, opset, &operands)
            })
        } else {
            numbers(2, move |_| value)
        }
    };
    vec![Parameter::new(
        "constant_value",
        is,
        move |value| format!("the padding's value is {is} in the graph; {value} explains the numbers"),
        meaning,
    )]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paddings_are_misread_in_ways_that_differ_from_them() {
        let ways = misread(&[0, 1, 1, 2]);
        assert_eq!(ways[0], ("before and after exchanged", vec![1, 2, 0, 1]), "sides");
        assert!(ways.iter().all(|(_, other)| other != &[0, 1, 1, 2]), "{ways:?}");
        assert!(misread(&[1, 1, 1, 1]).iter().any(|(how, _)| *how == "none"), "left out");
    }

    #[test]
    fn sides_in_turn_are_read_as_tensorflow_writes_them() {
        // b0 a0 b1 a1 read as b0 b1 a0 a1.
        let turned = misread(&[10, 20, 30, 40]).into_iter().find(|(how, _)| how.contains("in turn"));
        assert_eq!(turned.map(|(_, pads)| pads), Some(vec![10, 30, 20, 40]), "every second");
    }
}

//! Movements: slices, indices and orders of operands that are off by one or the other way round.

use vitruvian_reference::nn::Tensor;

use super::Suspicion;
use super::change::{Meaning, attributes, int, integers, ints, operator, reordered};
use super::padding::list;
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::message::NodeProto;
use crate::onnx::walk;

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    match trial.operator() {
        "Concat" => concat(trial),
        "Transpose" => transpose(trial),
        "Slice" => slice(trial),
        "Gather" | "GatherElements" | "GatherND" | "ScatterElements" | "ScatterND" => gather(trial),
        "Where" => vec![Suspicion::new(
            "operands-swapped",
            "the two choices were exchanged",
            reordered(vec![0, 2, 1]),
        )],
        "DepthToSpace" => {
            let is = super::change::text(trial.node(), "mode", "DCR");
            let other = if is == "CRD" { "DCR" } else { "CRD" };
            vec![Suspicion::new(
                "mode",
                format!("mode is {is} in the graph; {other} explains the numbers"),
                attributes(vec![builder::text("mode", other)]),
            )]
        }
        "Split" => split(trial),
        _ => Vec::new(),
    }
}

/// Another axis.
pub(super) fn axes(trial: &Trial, default: i64) -> Vec<Suspicion> {
    let rank = trial.shape(0).map_or(0, <[usize]>::len) as i64;
    let is = int(trial.node(), "axis", default);
    let others = (0..rank).filter(|&axis| axis != is && axis != is + rank);
    others
        .map(|axis| {
            Suspicion::new(
                "axis",
                format!("axis is {is} in the graph; {axis} explains the numbers"),
                attributes(vec![builder::int("axis", axis)]),
            )
        })
        .collect()
}

fn concat(trial: &Trial) -> Vec<Suspicion> {
    let count = trial.case.operands.len();
    let mut all = Vec::new();
    let order = |order: Vec<usize>| {
        Suspicion::new(
            "concat-order",
            format!("the operands were joined in the order {order:?}"),
            reordered(order),
        )
    };
    all.push(order((0..count).rev().collect()));
    for a in 0..count.min(8) {
        for b in a + 1..count.min(8) {
            let mut exchanged: Vec<usize> = (0..count).collect();
            exchanged.swap(a, b);
            all.push(order(exchanged));
        }
    }
    for by in 1..count.min(8) {
        all.push(order((0..count).map(|i| (i + by) % count).collect()));
    }
    all.extend(axes(trial, 1));
    all
}

fn transpose(trial: &Trial) -> Vec<Suspicion> {
    let rank = trial.shape(0).map_or(0, <[usize]>::len);
    let is = match ints(trial.node(), "perm") {
        given if given.len() == rank => given,
        _ => (0..rank as i64).rev().collect(),
    };
    let inverse: Vec<i64> =
        (0..rank as i64).map(|axis| is.iter().position(|&from| from == axis).unwrap_or(0) as i64).collect();
    let mut others = vec![inverse, (0..rank as i64).collect(), (0..rank as i64).rev().collect()];
    for a in 0..rank {
        for b in a + 1..rank {
            let mut exchanged = is.clone();
            exchanged.swap(a, b);
            others.push(exchanged);
        }
    }
    others.retain(|other| *other != is);
    let mut all: Vec<Suspicion> = others
        .into_iter()
        .map(|other| {
            Suspicion::new(
                "perm",
                format!("perm is {is:?} in the graph; {other:?} explains the numbers"),
                attributes(vec![list("perm", &other)]),
            )
        })
        .collect();
    // The numbers as they lay, under the new shape.
    if let Some(shape) = trial.output_shape().map(<[usize]>::to_vec) {
        all.push(Suspicion::new(
            "perm",
            "only the shape was changed, the numbers were left as they lay",
            reshaped(shape),
        ));
    }
    all
}

/// Operand 0's elements as they lie, in another shape.
fn reshaped(shape: Vec<usize>) -> Meaning {
    Box::new(move |node, _, operands| {
        let shape = crate::onnx::value::Value::list(shape.iter().map(|&side| side as i64).collect());
        let reshape = NodeProto { op_type: Some("Reshape".into()), attribute: Vec::new(), ..node.clone() };
        walk::evaluate(&reshape, 14, &[operands.first().copied().flatten(), Some(&shape)])
    })
}

/// Starts and ends moved by one, together or alone, and steps.
fn slice(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    let as_attributes = !ints(trial.node(), "starts").is_empty();
    for by in [1, -1] {
        let detail = format!(
            "the slice begins and ends {} its place",
            if by > 0 { "one after" } else { "one before" }
        );
        let meaning: Meaning = if as_attributes {
            let moved = |name: &str| {
                // A negative place counts from the end: −1 + 1 is the end itself, which is no longer 0.
                let new: Vec<i64> = ints(trial.node(), name).iter().map(|i| moved_place(*i, by)).collect();
                list(name, &new)
            };
            attributes(vec![moved("starts"), moved("ends")])
        } else {
            Box::new(move |node, opset, operands| {
                let moved = |i: usize| -> Result<_, String> {
                    let old = operands.get(i).copied().flatten().ok_or("has no such operand")?.integers()?;
                    Ok(crate::onnx::value::Value::list(
                        old.data.iter().map(|&i| moved_place(i, by)).collect(),
                    ))
                };
                let (starts, ends) = (moved(1)?, moved(2)?);
                let mut operands = operands.to_vec();
                (operands[1], operands[2]) = (Some(&starts), Some(&ends));
                walk::evaluate(node, opset, &operands)
            })
        };
        all.push(Suspicion::new("slice-off-by-one", detail, meaning));
    }
    if trial.shape(4).is_some() {
        all.push(Suspicion::new("steps", "the steps were ignored", integers(4, |old| Some(old.map(|_| 1)))));
        all.push(Suspicion::new(
            "steps",
            "the steps had the opposite sign",
            Box::new(|node, opset, operands| {
                // The same elements the other way round.
                let mut outputs = walk::evaluate(node, opset, operands)?;
                let axes = operands.get(3).copied().flatten().ok_or("has no axes")?.integers()?.data.clone();
                let first = outputs.first_mut().and_then(Option::as_mut).ok_or("has no output")?;
                let rank = first.shape().len() as i64;
                let axes = axes.iter().map(|&a| (if a < 0 { a + rank } else { a }) as usize).collect();
                *first = super::change::rearranged(first, &super::change::flipped(axes))
                    .ok_or("has no such axes")?;
                Ok(outputs)
            }),
        ));
    }
    if trial.shape(0) == trial.output_shape() {
        all.push(Suspicion::new("slice", "nothing was cut", operator("Identity", Vec::new(), &[0])));
    }
    all
}

fn moved_place(place: i64, by: i64) -> i64 {
    match place.checked_add(by) {
        // From the end's side to the start's or back.
        Some(moved) if (moved < 0) == (place < 0) => moved,
        Some(_) if by > 0 => i64::MAX,
        _ => 0,
    }
}

fn gather(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    let side = match trial.operator() {
        "Gather" | "GatherElements" | "ScatterElements" => {
            let rank = trial.shape(0).map_or(0, <[usize]>::len) as i64;
            let axis = int(trial.node(), "axis", 0);
            let axis = if axis < 0 { axis + rank } else { axis };
            trial.shape(0).and_then(|shape| shape.get(usize::try_from(axis).ok()?).copied())
        }
        _ => None,
    };
    let indices = |change: fn(i64, i64) -> i64| {
        let side = side.unwrap_or(usize::MAX) as i64;
        integers(1, move |old: &Tensor<i64>| Some(old.map(|i| change(i, side))))
    };
    all.push(Suspicion::new(
        "negative-indices",
        "negative indices were taken as 0",
        indices(|i, _| i.max(0)),
    ));
    if side.is_some() {
        all.push(Suspicion::new(
            "negative-indices",
            "negative indices were counted from the start",
            indices(|i, _| i.abs()),
        ));
        all.push(Suspicion::new(
            "negative-indices",
            "negative indices were counted from the last element, not from the end",
            indices(|i, side| if i < 0 { (i - 1).max(-side) } else { i }),
        ));
        for (by, what) in [(1, "one too large"), (-1, "one too small, as where they are counted from 1")] {
            let change = move |old: &Tensor<i64>| {
                let side = side.unwrap_or(1) as i64;
                Some(old.map(|i| (if i < 0 { i + side } else { i } + by).clamp(0, side - 1)))
            };
            all.push(Suspicion::new(
                "index-off-by-one",
                format!("the indices were {what}"),
                integers(1, change),
            ));
            let change = move |old: &Tensor<i64>| {
                let side = side.unwrap_or(1) as i64;
                Some(old.map(|i| (i + by).rem_euclid(side)))
            };
            all.push(Suspicion::new(
                "index-off-by-one",
                format!("the indices were {what}, around the end"),
                integers(1, change),
            ));
        }
        all.extend(axes(trial, 0));
    }
    all
}

/// The parts in another order.
fn split(trial: &Trial) -> Vec<Suspicion> {
    let mut all = vec![Suspicion::new(
        "split-order",
        "the parts came in the opposite order",
        Box::new(|node: &NodeProto, opset: i64, operands: &super::change::Operands| {
            let mut outputs = walk::evaluate(node, opset, operands)?;
            outputs.reverse();
            Ok(outputs)
        }) as Meaning,
    )];
    all.extend(axes(trial, 0));
    all
}

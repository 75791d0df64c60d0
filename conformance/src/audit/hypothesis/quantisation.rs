//! Operands of quantised numbers: zero points, signs, the scales of channels.

use vitruvian_reference::nn::Rounded;

use super::Suspicion;
use super::change::{Meaning, chosen, elements, operand, operand_arranged, operand_then};
use super::indexing::axes;
use super::requantisation::{admissible, unrounded};
use super::trial::Trial;
use crate::certificate::UNIT_ROUNDOFF;
use crate::onnx::element::ElementType;
use crate::onnx::value::{Data, Value};

/// Where an operand's integers, their scales and their zero points stand.
struct Places {
    integers: Option<usize>,
    scale: Option<usize>,
    zero: usize,
}

fn places(operator: &str) -> Vec<Places> {
    let of = |integers, scale, zero| Places { integers, scale, zero };
    match operator {
        "QuantizeLinear" => vec![of(None, Some(1), 2)],
        "DequantizeLinear" => vec![of(Some(0), Some(1), 2)],
        "QGemm" | "QLinearAdd" | "QLinearConv" | "QLinearMatMul" | "QLinearMul" => {
            vec![of(Some(0), Some(1), 2), of(Some(3), Some(4), 5)]
        }
        "QLinearAveragePool"
        | "QLinearGlobalAveragePool"
        | "QLinearLeakyRelu"
        | "QLinearSigmoid"
        | "QLinearSoftmax" => vec![of(Some(0), Some(1), 2)],
        "QLinearConcat" => vec![of(Some(2), Some(3), 4), of(Some(5), Some(6), 7)],
        "QLinearWhere" => vec![of(Some(1), Some(2), 3), of(Some(4), Some(5), 6)],
        "ConvInteger" | "MatMulInteger" => vec![of(Some(0), None, 2), of(Some(1), None, 3)],
        _ => Vec::new(),
    }
}

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let operands = places(trial.operator());
    let mut all = Vec::new();
    for Places { integers, zero, .. } in &operands {
        // QuantizeLinear's zero point is the output's.
        if integers.is_some() && trial.shape(*zero).is_some() {
            all.extend(zero_points(trial, *zero));
        }
    }
    for Places { integers, zero, .. } in &operands {
        if let Some(integers) = *integers {
            all.extend(signs(trial, integers, *zero));
        }
    }
    if let [Places { zero: a, .. }, Places { zero: b, .. }] = operands[..]
        && let (Some([x]), Some([y])) = (trial.integers(a).as_deref(), trial.integers(b).as_deref())
        && x != y
    {
        all.push(Suspicion::new(
            "zero-point",
            format!("the zero points in operands {a} and {b} were exchanged"),
            exchanged(a, *x, b, *y),
        ));
    }
    for Places { scale, zero, .. } in &operands {
        for (what, place) in [("scale", *scale), ("zero point", Some(*zero))] {
            all.extend(place.map_or(Vec::new(), |place| of_channels(trial, what, place)));
        }
    }
    if matches!(trial.operator(), "QuantizeLinear" | "DequantizeLinear") {
        all.extend(axes(trial, 1));
    }
    if trial.operator() == "QuantizeLinear" {
        all.push(Suspicion::new(
            "reciprocal-scale",
            "numbers were multiplied by the scale, not divided",
            super::change::numbers(1, |s| 1.0 / s),
        ));
    }
    all
}

/// How messages name an operand.
fn named(trial: &Trial, place: usize) -> String {
    format!("operand {place} (\"{}\")", trial.node().input.get(place).map_or("", String::as_str))
}

/// Integers changed, which may then lie beyond their type.
fn widened(change: impl Fn(i64) -> i64) -> impl Fn(&Value<Rounded>) -> Option<Value<Rounded>> {
    move |old| {
        let new = old.integers().ok()?.map(&change);
        Some(Value { element: old.element, data: Data::Integers(new) })
    }
}

/// A zero point that was ignored, added, or another.
fn zero_points(trial: &Trial, place: usize) -> Vec<Suspicion> {
    let name = named(trial, place);
    let mut all = vec![
        Suspicion::new(
            "zero-point",
            format!("the zero point in {name} was ignored"),
            operand(place, widened(|_| 0)),
        ),
        Suspicion::new(
            "zero-point",
            format!("the zero point in {name} was added, not subtracted"),
            operand(place, widened(|z| -z)),
        ),
    ];
    if let Some(k) = addend(trial, place) {
        all.push(Suspicion::new(
            "zero-point",
            format!("the zero point in {name} was {k:+} what it should be"),
            operand(place, widened(move |z| z + k)),
        ));
    }
    all
}

/// The least whole number that added to a zero point explains the numbers, which depend on it linearly.
fn addend(trial: &Trial, place: usize) -> Option<i64> {
    let found = trial.found()?;
    let is = trial.values(&unrounded(trial, true))?;
    let with_one = operand_then(place, widened(|z| z + 1), unrounded(trial, true));
    let moved =
        trial.values(&with_one).filter(|moved| moved.len() == found.len() && moved.len() == is.len())?;
    // What was limited to the type tells nothing.
    let element = trial.case.found.first()?.as_ref()?.element();
    let limits = element.range().unwrap_or((i128::MIN, i128::MAX));
    let rounds = element.range().is_some() && element != ElementType::I32;
    let inside = |y: f64| (limits.0 as f64) < y && y < limits.1 as f64;
    // A number is rounded once to its type.
    let reach = |found: f64| if rounds { 0.5 } else { UNIT_ROUNDOFF * found.abs() };
    let elements = found.iter().zip(&is).zip(&moved).filter(|((found, _), _)| inside(**found));
    let (least, most) = admissible(
        elements.map(|((found, is), moved)| (found - is.value, moved.value - is.value, reach(*found))),
    )?;
    let (least, most) = (least.ceil(), most.floor());
    let k = if least > 0.0 { least } else { most.min(0.0) };
    (least <= most && k != 0.0).then_some(k as i64)
}

/// Integers read with a sign for without, or the other way round; and their zero point with them.
fn signs(trial: &Trial, place: usize, zero: usize) -> Vec<Suspicion> {
    let element = trial.case.operands.get(place).and_then(Option::as_ref).map(|x| x.element());
    let Some(element) = element.filter(|element| element.size() <= 2) else { return Vec::new() };
    let turn = 1_i64 << (8 * element.size());
    let other = move |i: i64| match element.range() {
        Some((0, _)) if i >= turn / 2 => i - turn,
        Some((low, _)) if low < 0 && i < 0 => i + turn,
        _ => i,
    };
    let how = match element.range() {
        Some((0, _)) => "with a sign, not without",
        _ => "without a sign, not with one",
    };
    let name = named(trial, place);
    let mut all =
        vec![Suspicion::new("signedness", format!("{name} was read {how}"), operand(place, widened(other)))];
    if trial.shape(zero).is_some() {
        all.push(Suspicion::new(
            "signedness",
            format!("{name} and its zero point were read {how}"),
            operand_then(place, widened(other), operand(zero, widened(other))),
        ));
    }
    all
}

fn exchanged(a: usize, x: i64, b: usize, y: i64) -> Meaning {
    operand_then(a, widened(move |_| y), operand(b, widened(move |_| x)))
}

/// One parameter a channel: the first for all, or the opposite order.
fn of_channels(trial: &Trial, what: &str, place: usize) -> Vec<Suspicion> {
    let Some(&[count]) = trial.shape(place).filter(|shape| shape.iter().product::<usize>() > 1) else {
        return Vec::new();
    };
    let (name, of) = (if what == "scale" { "scale" } else { "zero-point" }, named(trial, place));
    let first = trial.first(place).unwrap_or_default();
    vec![
        Suspicion::new(
            name,
            format!("the first {what} in {of} was taken for all channels"),
            elements(place, move |_| first),
        ),
        Suspicion::new(
            "channel-order",
            format!("the {what}s of the channels in {of} were taken in the opposite order"),
            operand_arranged(place, chosen(0, (0..count).rev().collect())),
        ),
        Suspicion::new(
            "channel-order",
            format!("the {what} in {of} of the next channel was taken for each"),
            operand_arranged(place, chosen(0, (0..count).map(|c| (c + 1) % count).collect())),
        ),
        Suspicion::new(
            "channel-order",
            format!("the {what} in {of} of the channel before was taken for each"),
            operand_arranged(place, chosen(0, (0..count).map(|c| (c + count - 1) % count).collect())),
        ),
    ]
}

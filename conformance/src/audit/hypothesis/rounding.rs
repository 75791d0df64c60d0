//! From numbers to integers: ties, truncation, saturation, and the division of integers.

use vitruvian_reference::nn::{Rounded, Tensor};

use super::Suspicion;
use super::change::{Meaning, Operands, Outputs, attributes, exact, int, operator};
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::message::NodeProto;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// Ways to an integer, beside "to the nearest, ties to even".
pub(super) const WAYS: [(&str, &str, fn(f64) -> f64); 7] = [
    ("rounding-ties", "ties were rounded away from zero, not to even", f64::round),
    ("rounding-ties", "ties were rounded up, not to even", |x| (x + 0.5).floor()),
    ("rounding-ties", "ties were rounded down, not to even", |x| (x - 0.5).ceil()),
    ("truncation", "numbers were cut towards zero, not rounded", f64::trunc),
    ("truncation", "numbers were rounded down", f64::floor),
    ("truncation", "numbers were rounded up", f64::ceil),
    ("rounding-ties", "numbers were rounded to even at ties", f64::round_ties_even),
];

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let mut all: Vec<Suspicion> = Vec::new();
    match trial.operator() {
        "Round" | "Floor" | "Ceil" => {
            for (name, detail, way) in WAYS {
                all.push(Suspicion::new(name, detail, each(way)));
            }
        }
        "Cast" => {
            for (name, detail, way) in WAYS {
                let name = if name == "truncation" { "truncation" } else { "rounding" };
                let detail = if detail.contains("cut") { "numbers were cut towards zero" } else { detail };
                all.push(Suspicion::new(name, detail.replace(", not to even", ""), before_cast(way)));
            }
            all.push(Suspicion::new(
                "saturation",
                "numbers beyond the type were limited to it, they did not wrap around",
                saturated_cast(),
            ));
        }
        "Mod" => {
            let is = int(trial.node(), "fmod", 0);
            all.push(Suspicion::new(
                "fmod",
                format!("fmod is {is} in the graph; {} explains the numbers", 1 - is),
                attributes(vec![builder::int("fmod", 1 - is)]),
            ));
        }
        "Div" => all.push(Suspicion::new(
            "truncation",
            "integers were divided downwards, not towards zero",
            Box::new(|_, _, operands: &Operands| -> Outputs {
                let of = |i: usize| operands.get(i).copied().flatten().ok_or("has no such operand");
                let (a, b) = (of(0)?.integers()?, of(1)?.integers()?);
                if a.shape != b.shape && b.data.len() != 1 {
                    return Err("is broadcast".into());
                }
                let quotient = |(i, &a): (usize, &i64)| {
                    let b = b.data[i % b.data.len()];
                    a.checked_div_euclid(b).map(|q| if b < 0 && a.rem_euclid(b) != 0 { q - 1 } else { q })
                };
                let data: Option<Vec<i64>> = a.data.iter().enumerate().map(quotient).collect();
                let data = Tensor::new(&a.shape, data.ok_or("divides by zero")?);
                Ok(vec![Some(Value { element: of(0)?.element, data: Data::Integers(data) })])
            }),
        )),
        _ => {}
    }
    all
}

/// Every number by itself.
fn each(way: fn(f64) -> f64) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| {
        let first = operands.first().copied().flatten().ok_or("has no operand")?;
        let rounded = super::change::changed(first, |x| way(x.value)).ok_or("holds no numbers")?;
        operator("Identity", Vec::new(), &[0])(node, opset, &[Some(&rounded)])
    })
}

/// The number rounded in some way and then cast.
fn before_cast(way: fn(f64) -> f64) -> Meaning {
    super::change::operand(0, move |old| super::change::changed(old, |x| way(x.value)))
}

fn saturated_cast() -> Meaning {
    Box::new(|node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let specified: Vec<Option<Value<Rounded>>> = walk::evaluate(node, opset, operands)?;
        let element = specified.first().and_then(Option::as_ref).ok_or("has no output")?.element;
        let (low, high) = element.range().ok_or("makes no integers")?;
        let old = operands.first().copied().flatten().ok_or("has no operand")?;
        let within = |x: f64| x.clamp(low as f64, high as f64);
        let new = match &old.data {
            Data::Numbers(x) => {
                Value { element: old.element, data: Data::Numbers(x.map(|r| exact(within(r.value)))) }
            }
            Data::Integers(x) => {
                let clamped = x.map(|i| i128::from(i).clamp(low, high) as i64);
                Value { element: old.element, data: Data::Integers(clamped) }
            }
            Data::Truths(_) => return Err("holds truths".into()),
        };
        walk::evaluate(node, opset, &[Some(&new)])
    })
}

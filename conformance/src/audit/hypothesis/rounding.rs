//! From numbers to integers and back: ties, truncation, zero points, saturation and wrap-around.

use vitruvian_reference::nn::{Rounded, Tensor};

use super::Suspicion;
use super::change::{Meaning, Operands, Outputs, attributes, exact, int, integers, operator};
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// Ways to an integer, beside "to the nearest, ties to even".
const WAYS: [(&str, &str, fn(f64) -> f64); 7] = [
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
        "QuantizeLinear" => {
            for (name, detail, way) in WAYS {
                all.push(Suspicion::new(name, detail, quantised(way, true, true)));
            }
            all.push(Suspicion::new(
                "zero-point",
                "the zero point was ignored",
                quantised(f64::round_ties_even, true, false),
            ));
            all.push(Suspicion::new(
                "saturation",
                "numbers beyond the type wrapped around, they were not limited",
                quantised(f64::round_ties_even, false, true),
            ));
            all.push(Suspicion::new(
                "reciprocal-scale",
                "numbers were multiplied by the scale, not divided",
                super::change::numbers(1, |s| 1.0 / s),
            ));
            all.extend(axes(trial));
        }
        "DequantizeLinear" => {
            all.push(Suspicion::new(
                "zero-point",
                "the zero point was ignored",
                integers(2, |old| Some(old.map(|_| 0))),
            ));
            all.push(Suspicion::new(
                "zero-point",
                "the zero point was added, not subtracted",
                Box::new(|node, opset, operands| {
                    let wide = |i: usize, sign: i64| -> Result<_, String> {
                        let x = operands.get(i).copied().flatten().ok_or("has no zero point")?.integers()?;
                        Ok(Value { element: ElementType::I32, data: Data::Integers(x.map(|i| sign * i)) })
                    };
                    let (x, zero) = (wide(0, 1)?, wide(2, -1)?);
                    walk::evaluate(node, opset, &[Some(&x), operands[1], Some(&zero)])
                }),
            ));
            all.push(Suspicion::new(
                "signedness",
                "the bytes were read with a sign for without, or the other way round",
                integers(0, |old| {
                    Some(old.map(|i| {
                        if i > 127 {
                            i - 256
                        } else if i < 0 {
                            i + 256
                        } else {
                            i
                        }
                    }))
                }),
            ));
            all.extend(axes(trial));
        }
        "QLinearConv" | "QLinearMatMul" | "ConvInteger" | "MatMulInteger" => {
            let places: &[usize] = if trial.operator().starts_with("QLinear") { &[2, 5, 7] } else { &[2, 3] };
            for &place in places.iter().filter(|&&place| trial.shape(place).is_some()) {
                all.push(Suspicion::new(
                    "zero-point",
                    format!("the zero point in operand {place} was ignored"),
                    integers(place, |old| Some(old.map(|_| 0))),
                ));
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

fn axes(trial: &Trial) -> Vec<Suspicion> {
    let rank = trial.shape(0).map_or(0, <[usize]>::len) as i64;
    let is = int(trial.node(), "axis", 1);
    (0..rank)
        .filter(|&axis| axis != is && axis != is + rank)
        .map(|axis| {
            Suspicion::new(
                "axis",
                format!("axis is {is} in the graph; {axis} explains the numbers"),
                attributes(vec![builder::int("axis", axis)]),
            )
        })
        .collect()
}

/// Every number by itself.
fn each(way: fn(f64) -> f64) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| {
        let first = operands.first().copied().flatten().ok_or("has no operand")?;
        let rounded = super::change::changed(first, |x| way(x.value)).ok_or("holds no numbers")?;
        operator("Identity", Vec::new(), &[0])(node, opset, &[Some(&rounded)])
    })
}

/// x/s to an integer in some way, plus the zero point or not, limited to the type or wrapped around.
///
/// The quotient is rounded once to f32, as the specification's own is.
fn quantised(way: fn(f64) -> f64, limited: bool, zero_point: bool) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let of = |i: usize| operands.get(i).copied().flatten().ok_or("has no such operand");
        let (x, scale) = (of(0)?.numbers()?, of(1)?.numbers()?);
        let zero = of(2).ok().map(Value::integers).transpose()?;
        let specified: Vec<Option<Value<Rounded>>> = walk::evaluate(node, opset, operands)?;
        let element = specified.first().and_then(Option::as_ref).ok_or("has no output")?.element;
        let (low, high) = element.range().ok_or("makes no integers")?;
        let axis = int(node, "axis", 1);
        let rank = x.shape.len() as i64;
        let axis =
            usize::try_from(if axis < 0 { axis + rank } else { axis }).map_err(|why| why.to_string())?;
        let stride: usize = x.shape.iter().skip(axis + 1).product();
        let at = |i: usize, count: usize| if count == 1 { 0 } else { i / stride.max(1) % count };
        let data = x.data.iter().enumerate().map(|(i, r)| {
            let quotient = (r.value / scale.data[at(i, scale.data.len())].value) as f32;
            let zero = zero.filter(|_| zero_point).map_or(0, |zero| zero.data[at(i, zero.data.len())]);
            let whole = i128::from(way(f64::from(quotient)) as i64) + i128::from(zero);
            if limited {
                whole.clamp(low, high) as i64
            } else {
                (low + (whole - low).rem_euclid(high - low + 1)) as i64
            }
        });
        let data = Tensor::new(&x.shape, data.collect());
        Ok(vec![Some(Value { element, data: Data::Integers(data) })])
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

//! The last step of operators on quantised numbers, from a number to its integer: truncation, saturation, wrap-around,
//! the scale and the zero point of the output.
//!
//! y = saturate(round(q) + z), where the quotient q is the operator's result over the output's scale. It is read off the
//! reference itself: with an output scale of 2⁻⁴⁰ times the given one, a zero point of 0 and integers of 64 bits the
//! operator makes 2⁴⁰·q, which is whole where q is an f32 of 2⁻¹⁶ or more.
//!
//! # How is a number fitted to integers?
//! An integer says between which two numbers the quotient lay, so each element bounds the factor p of q·p, or the addend k
//! of q + k·d: by (y − z ∓ ½)/q. What lies within all bounds explains all elements; where nothing does, no factor explains.

use std::ops::RangeInclusive;

use vitruvian_reference::nn::{Rounded, Tensor};

use super::Suspicion;
use super::change::{Meaning, Operands, changed, exact, int, specified};
use super::fit::shortest;
use super::rounding::WAYS;
use super::trial::Trial;
use crate::certificate::UNIT_ROUNDOFF;
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// Binary places of a quotient.
const FRACTION: i32 = 40;

/// How far roundings on its way through the operator may move a quotient, relatively.
const REACH: f64 = 4.0 * UNIT_ROUNDOFF;

/// An integer from a quotient, a zero point and the range of the type; what is beyond the range wraps around.
type Step = dyn Fn(f64, i64, &RangeInclusive<i64>) -> i64 + Send + Sync;

/// Where the scale of the output stands; its zero point follows.
fn output_scale(operator: &str) -> Option<usize> {
    match operator {
        "QuantizeLinear" => Some(1),
        "QLinearAdd" | "QLinearConv" | "QLinearMatMul" | "QLinearMul" => Some(6),
        "QGemm" | "QLinearWhere" => Some(7),
        "QLinearAveragePool"
        | "QLinearGlobalAveragePool"
        | "QLinearLeakyRelu"
        | "QLinearSigmoid"
        | "QLinearSoftmax" => Some(3),
        "QLinearConcat" => Some(0),
        _ => None,
    }
}

/// What is rounded to integers: the quotients, the zero points, and the type of the integers.
struct Unrounded {
    quotients: Tensor<f64>,
    zeros: Vec<i64>,
    element: ElementType,
}

impl Unrounded {
    fn of(node: &NodeProto, opset: i64, operands: &Operands) -> Result<Self, String> {
        let place = node.op_type.as_deref().and_then(output_scale).ok_or("rounds nothing")?;
        let of = |i: usize| operands.get(i).copied().flatten();
        let (first, scale) = (of(0).ok_or("has no operand")?, of(place).ok_or("has no scale")?);
        let zero = of(place + 1);
        let asked = |name: &str| i32::try_from(int(node, name, 0)).ok().and_then(ElementType::from_number);
        let element = asked("output_dtype").or(zero.map(|zero| zero.element)).unwrap_or(ElementType::U8);
        let precision = asked("precision").unwrap_or(scale.element);
        // The operator with wide integers, and with quotients in f64.
        let mut wide = node.clone();
        wide.attribute.retain(|old| !matches!(old.name.as_deref(), Some("output_dtype" | "precision")));
        let run = |first: &Value<Rounded>, factor: f64, zero: Tensor<i64>| -> Result<Tensor<i64>, String> {
            let zero = Value { element: ElementType::I64, data: Data::Integers(zero) };
            let mut scale = changed(scale, |s| s.value * factor).ok_or("has no scale")?;
            scale.element = ElementType::F64;
            let mut operands = operands.to_vec();
            operands.resize(operands.len().max(place + 2), None);
            (operands[0], operands[place], operands[place + 1]) = (Some(first), Some(&scale), Some(&zero));
            let outputs = walk::evaluate(&wide, opset, &operands)?;
            Ok(outputs.first().and_then(Option::as_ref).ok_or("has no output")?.integers()?.clone())
        };
        let scaled = run(first, 2f64.powi(-FRACTION), Tensor::filled(scale.shape(), 0))?;
        let zeros = match zero.map(Value::integers).transpose()? {
            None => vec![0; scaled.data.len()],
            Some(zero) if zero.data.len() == 1 => vec![zero.data[0]; scaled.data.len()],
            Some(zero) => run(&changed(first, |_| 0.0).ok_or("holds no numbers")?, 1.0, zero.clone())?.data,
        };
        let quotients = scaled.map(|q| precision.round(q as f64 * 2f64.powi(-FRACTION)));
        Ok(Self { quotients, zeros, element })
    }

    fn rounded(&self, step: &Step) -> Result<Value<Rounded>, String> {
        let range = range(self.element)?;
        let data = self.quotients.data.iter().zip(&self.zeros).map(|(&q, &z)| step(q, z, &range));
        Value::from_integers(self.element, Tensor::new(&self.quotients.shape, data.collect()))
    }
}

/// The integers of a type that an i64 holds.
fn range(element: ElementType) -> Result<RangeInclusive<i64>, String> {
    let range = element.range().and_then(|(low, high)| Some(low.try_into().ok()?..=high.try_into().ok()?));
    range.ok_or_else(|| format!("{element} is no type of quantised numbers"))
}

/// What is made of the quotients of a node.
///
/// `DynamicQuantizeLinear` is `QuantizeLinear` by the scale and the zero point that it found itself: its own, so that a
/// quotient moves by no rounding of theirs.
fn last_step(
    trial: &Trial,
    make: impl Fn(&Unrounded) -> Result<Value<Rounded>, String> + Send + Sync + 'static,
) -> Meaning {
    if trial.operator() != "DynamicQuantizeLinear" {
        return Box::new(move |node, opset, operands| {
            Ok(vec![Some(make(&Unrounded::of(node, opset, operands)?)?)])
        });
    }
    let own = |output: usize| Value::of(trial.case.found.get(output)?.as_ref()?).ok();
    let (scale, zero) = (own(1), own(2));
    Box::new(move |node, opset, operands| {
        let mut outputs = walk::evaluate(node, opset, operands)?;
        let mut fixed = NodeProto { op_type: Some("QuantizeLinear".into()), ..node.clone() };
        fixed.output.truncate(1);
        let x = operands.first().copied().flatten();
        let made = make(&Unrounded::of(&fixed, opset.max(10), &[x, scale.as_ref(), zero.as_ref()])?)?;
        *outputs.first_mut().ok_or("has no output")? = Some(made);
        Ok(outputs)
    })
}

/// The operator with another last step.
fn rounded_by(
    trial: &Trial,
    step: impl Fn(f64, i64, &RangeInclusive<i64>) -> i64 + Send + Sync + 'static,
) -> Meaning {
    // Nothing else of this operator moves a quotient: where one is closer to a jump than its rounding, either is right.
    let found = trial.found().filter(|_| trial.operator() == "DynamicQuantizeLinear");
    last_step(trial, move |unrounded| {
        let mut y = unrounded.rounded(&step)?;
        if let (Some(found), Data::Integers(y)) = (&found, &mut y.data) {
            let range = range(unrounded.element)?;
            let steps = unrounded.quotients.data.iter().zip(&unrounded.zeros);
            for ((y, found), (&q, &z)) in y.data.iter_mut().zip(found).zip(steps) {
                let either = [q * (1.0 - REACH), q * (1.0 + REACH)].map(|q| step(q, z, &range));
                *y = either.into_iter().find(|&i| i as f64 == *found).unwrap_or(*y);
            }
        }
        Ok(y)
    })
}

/// The outputs before they are rounded to integers, q + z or q alone; those of other operators are specified.
pub(super) fn unrounded(trial: &Trial, with_zero: bool) -> Meaning {
    if !rounds(trial) {
        return specified();
    }
    last_step(trial, move |unrounded| {
        let sum = |(&q, &z): (&f64, &i64)| exact(if with_zero { q + z as f64 } else { q });
        let data = unrounded.quotients.data.iter().zip(&unrounded.zeros).map(sum).collect();
        Ok(Value::from_numbers(ElementType::F64, Tensor::new(&unrounded.quotients.shape, data)))
    })
}

/// Whether the operator rounds to integers.
fn rounds(trial: &Trial) -> bool {
    // QGemm without a scale of the output gives numbers.
    output_scale(trial.operator()).is_some_and(|place| trial.shape(place).is_some())
        || trial.operator() == "DynamicQuantizeLinear"
}

fn saturated(whole: f64, z: i64, range: &RangeInclusive<i64>) -> i64 {
    (whole as i64).saturating_add(z).clamp(*range.start(), *range.end())
}

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    if !rounds(trial) {
        return Vec::new();
    }
    let mut all = Vec::new();
    // Which way a tie goes is open: one rounding of the quotient decides it.
    for (name, detail, way) in WAYS.into_iter().filter(|(name, ..)| *name == "truncation") {
        all.push(Suspicion::new(
            name,
            detail,
            rounded_by(trial, move |q, z, range| saturated(way(q), z, range)),
        ));
        all.push(Suspicion::new(
            name,
            format!("{detail}, and after the zero point was added, not before"),
            rounded_by(trial, move |q, z, range| saturated(way(q + z as f64), 0, range)),
        ));
    }
    for (detail, sign) in
        [("the zero point was ignored", 0), ("the zero point was subtracted, not added", -1)]
    {
        all.push(Suspicion::new(
            "zero-point",
            detail,
            rounded_by(trial, move |q, z, range| saturated(q.round_ties_even(), sign * z, range)),
        ));
    }
    all.push(Suspicion::new(
        "saturation",
        "numbers beyond the type wrapped around, they were not limited",
        rounded_by(trial, |q, z, _| (q.round_ties_even() as i64).wrapping_add(z)),
    ));
    all.extend(fitted(trial));
    all
}

/// Steps with a number that the integers tell: another zero point, another scale, other limits.
fn fitted(trial: &Trial) -> Vec<Suspicion> {
    let element = trial.case.found.first().and_then(Option::as_ref).map(TypedTensor::element);
    let (Some(found), Some(range)) = (trial.found(), element.and_then(|element| range(element).ok())) else {
        return Vec::new();
    };
    let numbers = |with_zero: bool| trial.values(&unrounded(trial, with_zero));
    let (Some(sums), Some(quotients)) = (numbers(true), numbers(false)) else { return Vec::new() };
    if found.is_empty() || sums.len() != found.len() {
        return Vec::new();
    }
    let mut all = Vec::new();
    let (low, high) = (*range.start() as f64, *range.end() as f64);
    let inside = |y: f64| low < y && y < high;
    let elements = || found.iter().zip(&sums).zip(&quotients).map(|((f, s), q)| (*f, s.value, q.value));
    let mut addends: Vec<i64> = elements()
        .filter(|&(found, sum, _)| inside(found) && inside(sum))
        .map(|(found, sum, _)| (found - sum.round_ties_even()) as i64)
        .collect();
    addends.sort_unstable();
    if let Some(&k) = addends.get(addends.len() / 2).filter(|&&k| k != 0) {
        all.push(Suspicion::new(
            "zero-point",
            format!("the zero point of the output was {k:+} what it should be"),
            rounded_by(trial, move |q, z, range| saturated(q.round_ties_even(), z + k, range)),
        ));
        all.push(Suspicion::new(
            "offset",
            format!("the output is what it should be and {k}"),
            rounded_by(trial, move |q, z, range| {
                saturated(saturated(q.round_ties_even(), z, range) as f64, k, range)
            }),
        ));
    }
    let (least, most) = found.iter().fold((high, low), |(a, b), &y| (a.min(y), b.max(y)));
    if (least > low || most < high) && elements().any(|(_, sum, _)| sum < least || sum > most) {
        let relu = most == high && elements().all(|(_, sum, q)| sum - q == least);
        let (name, detail) = match relu {
            true => {
                ("activation", format!("no number lies below the zero point {least}: a Relu was applied"))
            }
            false => ("saturation", format!("numbers were limited to {least}..{most}, not to {low}..{high}")),
        };
        let within = least as i64..=most as i64;
        all.push(Suspicion::new(
            name,
            detail,
            rounded_by(trial, move |q, z, _| saturated(q.round_ties_even(), z, &within)),
        ));
    }
    let factor = elements().filter(|&(found, _, _)| inside(found));
    if let Some((least, most)) = admissible(factor.map(|(found, sum, q)| (found - (sum - q), q, 0.5))) {
        let (p, inverse) = (short(least, most), short(1.0 / most, 1.0 / least));
        let of_output = trial.node().input.get(output_scale(trial.operator()).unwrap_or(usize::MAX));
        let detail = match of_output {
            Some(name) if format!("{inverse}").len() < format!("{p}").len() => {
                format!("the scale of the output (\"{name}\") was {inverse} times what it should be")
            }
            _ => format!(
                "the numbers were {p} times what they should be before they were rounded: so a scale was"
            ),
        };
        for p in [p, 1.0 / inverse] {
            all.push(Suspicion::new(
                "scale",
                &detail[..],
                rounded_by(trial, move |q, z, range| saturated((q * p).round_ties_even(), z, range)),
            ));
        }
    }
    all
}

fn short(least: f64, most: f64) -> f64 {
    shortest((least + most) / 2.0, (most - least).abs() / 2.0)
}

/// The p for which all p·d are within `reach` of their r; `None` where no p is, or any.
pub(super) fn admissible(elements: impl Iterator<Item = (f64, f64, f64)>) -> Option<(f64, f64)> {
    let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
    for (r, d, reach) in elements {
        let reach = reach + REACH * (r.abs() + d.abs());
        if d == 0.0 && r.abs() > reach {
            return None;
        }
        if d != 0.0 {
            let (a, b) = ((r - reach) / d, (r + reach) / d);
            (least, most) = (least.max(a.min(b)), most.min(a.max(b)));
        }
    }
    (least <= most && least.is_finite() && most.is_finite()).then_some((least, most))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::cases_for_tests::{case, given};
    use crate::onnx::typed_tensor::Elements;

    #[test]
    fn quotients_are_read_off_the_reference_with_their_fractions() {
        let zero = TypedTensor::new(&[], Elements::U8(vec![100])).ok();
        let scale = TypedTensor::new(&[], Elements::F32(vec![0.5])).ok();
        let case = case("QuantizeLinear", vec![given(&[0.3, -0.25, 1000.0, -7.75]), scale, zero], vec![]);
        let operands: Vec<_> =
            case.operands.iter().flatten().map(|x| Value::of(x).expect("a value")).collect();
        let operands: Vec<_> = operands.iter().map(Some).collect();
        let unrounded = Unrounded::of(&case.node, case.opset, &operands).expect("it rounds");
        let fifth = f64::from(0.3_f32) / 0.5;
        assert!((unrounded.quotients.data[0] - fifth).abs() < 2f64.powi(-FRACTION), "a fraction");
        assert_eq!(unrounded.quotients.data[1..], [-0.5, 2000.0, -15.5], "beyond the type, too");
        assert_eq!((unrounded.zeros[0], unrounded.element), (100, ElementType::U8));
        let y = unrounded.rounded(&|q, z, range| saturated(q.round_ties_even(), z, range)).expect("integers");
        assert_eq!(y.integers().expect("integers").data, [101, 100, 255, 84], "as it is specified");
        let wrapped = unrounded.rounded(&|q, z, _| q as i64 + z).expect("integers");
        assert_eq!(wrapped.integers().expect("integers").data[2], 2100 % 256, "wrapped around");
    }

    #[test]
    fn every_integer_bounds_the_factor_and_none_may_contradict() {
        let (least, most) = admissible([(10.0, 9.7, 0.5), (-20.0, -19.5, 0.5)].into_iter()).expect("one");
        assert!(least < 1.02 && 1.02 < most && least >= 9.5 / 9.7 && most < 1.06, "{least}..{most}");
        assert!(admissible([(10.0, 9.7, 0.5), (-30.0, -19.5, 0.5)].into_iter()).is_none(), "two factors");
        assert!(admissible([(10.0, 0.0, 0.5)].into_iter()).is_none(), "no factor makes 10 of 0");
        assert!(admissible([(0.0, 0.0, 0.5)].into_iter()).is_none(), "any does");
    }
}

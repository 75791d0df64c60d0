//! Decisions that are closer than the rounding: the other outcomes that a right implementation may arrive at.
//!
//! A sample taken at a pixel's border, a number halfway between two steps of a quantisation: one rounding of the
//! coordinate, made inside the operator where nobody sees it, decides which of two values comes out. Both are right. So
//! the operator is evaluated again with its deciding operand moved either way by its own rounding, and an element that is
//! wrong by one outcome is accepted, as undecidable and counted, if it is right by another. No tolerance is widened.

use vitruvian_reference::nn::{Rounded, Scalar as _};

use super::judge::Meaning;
use super::precision::Precision;
use crate::certificate::UNIT_ROUNDOFF;
use crate::onnx::message::NodeProto;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// Roundings of a coordinate, or of a quotient before it is cut to an integer, on its way through the operator.
const ROUNDINGS: f64 = 4.0;

/// Operators whose result jumps where an operand crosses another or an integer.
const JUMPING: [&str; 11] = [
    "Cast",
    "Ceil",
    "Equal",
    "Floor",
    "Greater",
    "GreaterOrEqual",
    "Less",
    "LessOrEqual",
    "Mod",
    "Round",
    "Sign",
];

/// The outputs of a node, once for each way in which its decisions may fall.
pub(super) type Outcomes = Vec<Vec<Option<Value<Rounded>>>>;

/// An operand that decides, and how far each of its numbers may be off.
struct Deciding {
    operand: usize,
    /// Numbers of the last axis move on their own, as the coordinates of a point do.
    axes: usize,
    reach: fn(&Rounded, &Precision) -> f64,
}

fn relative(x: &Rounded, precision: &Precision) -> f64 {
    ROUNDINGS * precision.unit * x.value.abs()
}

/// A grid's coordinate g goes in as g + 1.
fn coordinate(x: &Rounded, precision: &Precision) -> f64 {
    ROUNDINGS * precision.unit * (x.value.abs() + 1.0)
}

fn bound(x: &Rounded, precision: &Precision) -> f64 {
    precision.bound(x)
}

fn deciding(node: &NodeProto, operands: &[Option<Value<Rounded>>]) -> Vec<Deciding> {
    match node.op_type.as_deref().unwrap_or_default() {
        "GridSample" if node.attribute.iter().any(|attribute| attribute.s.as_deref() == Some(b"nearest")) => {
            let axes = operands.get(1).and_then(Option::as_ref).and_then(|grid| grid.shape().last().copied());
            vec![Deciding { operand: 1, axes: axes.unwrap_or(1).min(3), reach: coordinate }]
        }
        "QuantizeLinear" => vec![Deciding { operand: 0, axes: 1, reach: relative }],
        "QLinearConv" | "QLinearMatMul" => vec![Deciding { operand: 1, axes: 1, reach: relative }],
        operator if JUMPING.contains(&operator) => {
            let inexact = |operand: &Option<Value<Rounded>>| {
                let numbers = operand.as_ref().and_then(|value| value.numbers().ok());
                numbers.is_some_and(|numbers| numbers.data.iter().any(|x| x.terms > 0.0))
            };
            let inexact = operands.iter().enumerate().filter(|(_, operand)| inexact(operand));
            inexact.map(|(operand, _)| Deciding { operand, axes: 1, reach: bound }).collect()
        }
        _ => Vec::new(),
    }
}

/// What the specification leaves open of a node: the outputs with its decisions made otherwise.
pub(super) fn specified_outcomes(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<Value<Rounded>>],
) -> Outcomes {
    let borrowed: Vec<_> = operands.iter().map(Option::as_ref).collect();
    // Coordinates are rarely kept in less than f32, whatever the image is of.
    let unit = borrowed.iter().flatten().filter_map(|value| value.element.unit_roundoff());
    let unit = unit.fold(UNIT_ROUNDOFF, f64::max);
    let specified = walk::alternatives(node, opset, &borrowed, unit);
    if specified.is_empty() {
        return other_outcomes(node, opset, operands, &walk::evaluate);
    }
    specified.into_iter().map(|value| vec![Some(value)]).collect()
}

/// The outputs with the deciding operands moved in every combination of directions; none where nothing jumps.
pub(super) fn other_outcomes(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<Value<Rounded>>],
    meaning: &Meaning,
) -> Outcomes {
    let deciding = deciding(node, operands);
    let directions: usize = deciding.iter().map(|deciding| deciding.axes).sum();
    if directions == 0 {
        return Vec::new();
    }
    let outcome = |signs: usize| {
        let mut moved = operands.to_vec();
        let mut first = 0;
        for Deciding { operand, axes, reach } in &deciding {
            if let Some(value) = moved.get_mut(*operand).and_then(Option::as_mut)
                && let Some(precision) = Precision::of(value.element)
                && let Data::Numbers(numbers) = &mut value.data
            {
                for (place, x) in numbers.data.iter_mut().enumerate() {
                    let sign = if signs >> (first + place % axes) & 1 == 0 { -1.0 } else { 1.0 };
                    *x = Rounded::exact(x.value + sign * reach(x, &precision));
                }
            }
            first += axes;
        }
        let borrowed: Vec<_> = moved.iter().map(Option::as_ref).collect();
        meaning(node, opset, &borrowed).ok()
    };
    (0..1_usize << directions).filter_map(outcome).collect()
}

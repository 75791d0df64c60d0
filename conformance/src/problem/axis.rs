//! Softmax, LogSoftmax, Hardmax, ArgMax, ArgMin and CumSum, along one axis.

use proptest::prelude::*;
use vitruvian_reference::nn::Tensor;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::int;

fn sides() -> impl Strategy<Value = (Vec<usize>, i64)> {
    prop::collection::vec(1..=20_usize, 1..=4)
        .prop_flat_map(|sides| (Just(sides.clone()), -(sides.len() as i64)..sides.len() as i64))
}

/// Shares of exponentials, of numbers near enough to each other that none underflows.
pub fn softmax(operator: &'static str) -> impl Strategy<Value = Problem> {
    (sides(), any::<Values>()).prop_map(move |((sides, axis), x)| Problem {
        operator,
        attributes: vec![int("axis", axis)],
        operands: vec![Operand::Input(x.fill(&sides).map(|x| x.clamp(-30.0, 30.0)))],
    })
}

/// Softmax over the last axis, as in attention, on ordinary numbers.
pub fn ordinary_softmax() -> impl Strategy<Value = Problem> {
    any::<u64>().prop_map(|seed| Problem {
        operator: "Softmax",
        attributes: vec![int("axis", -1)],
        operands: vec![Operand::Input(Values::ordinary(seed).fill(&[2, 8, 8]))],
    })
}

/// The place of the largest or smallest number, the first or the last of several.
pub fn place(operator: &'static str) -> impl Strategy<Value = Problem> {
    (sides(), any::<Values>(), any::<[bool; 2]>()).prop_map(move |((sides, axis), x, [keepdims, last])| {
        Problem {
            operator,
            attributes: vec![
                int("axis", axis),
                int("keepdims", keepdims.into()),
                int("select_last_index", last.into()),
            ],
            operands: vec![Operand::Input(x.fill(&sides))],
        }
    })
}

/// Running sums, in both directions, with and without the element itself.
pub fn cumulative_sum() -> impl Strategy<Value = Problem> {
    (sides(), any::<Values>(), any::<[bool; 2]>()).prop_map(|((sides, axis), x, [exclusive, reverse])| {
        Problem {
            operator: "CumSum",
            attributes: vec![int("exclusive", exclusive.into()), int("reverse", reverse.into())],
            operands: vec![Operand::Input(x.fill(&sides)), Operand::Integers(Tensor::new(&[], vec![axis]))],
        }
    })
}

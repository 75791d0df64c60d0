//! Operators that move numbers and round nothing: they must be met bit by bit.

use proptest::prelude::*;
use proptest::sample::Index;
use vitruvian_reference::nn::Tensor;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::{int, ints};

fn sides() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(1..=6_usize, 1..=4)
}

fn list(values: Vec<i64>) -> Operand {
    Operand::Integers(Tensor::new(&[values.len()], values))
}

/// Two or three tensors, one after the other along an axis.
pub fn concat() -> impl Strategy<Value = Problem> {
    (sides(), any::<Index>(), prop::collection::vec((1..=5_usize, any::<Values>()), 2..=3)).prop_map(
        |(sides, axis, parts)| {
            let axis = axis.index(sides.len());
            let operands = parts.iter().map(|&(side, values)| {
                let mut shape = sides.clone();
                shape[axis] = side;
                Operand::Input(values.fill(&shape))
            });
            Problem {
                operator: "Concat",
                attributes: vec![int("axis", axis as i64)],
                operands: operands.collect(),
            }
        },
    )
}

/// The same numbers in another shape: two axes joined, with one side left open or kept.
pub fn reshape() -> impl Strategy<Value = Problem> {
    (sides(), any::<Index>(), any::<Index>(), any::<Values>()).prop_map(|(sides, joined, open, x)| {
        let joined = joined.index(sides.len());
        let mut target: Vec<i64> = sides[..joined].iter().map(|&side| side as i64).collect();
        target.push(sides[joined..].iter().product::<usize>() as i64);
        let open = open.index(target.len());
        target[open] = -1;
        if open > 0 && joined > 0 {
            target[0] = 0;
        }
        Problem {
            operator: "Reshape",
            attributes: vec![],
            operands: vec![Operand::Input(x.fill(&sides)), list(target)],
        }
    })
}

/// New axes of length one, counted from the front or from the back.
pub fn unsqueeze() -> impl Strategy<Value = Problem> {
    (sides(), any::<[Index; 2]>(), any::<bool>(), any::<Values>()).prop_map(|(sides, axes, from_back, x)| {
        let mut axes: Vec<i64> = axes.iter().map(|axis| axis.index(sides.len() + 1) as i64).collect();
        axes.sort_unstable();
        axes.dedup();
        let rank = (sides.len() + axes.len()) as i64;
        if from_back {
            axes.iter_mut().for_each(|axis| *axis -= rank);
        }
        Problem {
            operator: "Unsqueeze",
            attributes: vec![],
            operands: vec![Operand::Input(x.fill(&sides)), list(axes)],
        }
    })
}

/// The axes in another order.
pub fn transpose() -> impl Strategy<Value = Problem> {
    let order = sides().prop_flat_map(|sides| {
        let order = Just((0..sides.len()).collect::<Vec<_>>()).prop_shuffle();
        (Just(sides), order)
    });
    (order, any::<Values>()).prop_map(|((sides, order), x)| Problem {
        operator: "Transpose",
        attributes: vec![ints("perm", &order)],
        operands: vec![Operand::Input(x.fill(&sides))],
    })
}

/// One place along an axis, which goes (a scalar index) or stays (a list of one).
pub fn gather() -> impl Strategy<Value = Problem> {
    (sides(), any::<Index>(), any::<Index>(), any::<bool>(), any::<Values>()).prop_map(
        |(sides, axis, place, scalar, x)| {
            let axis = axis.index(sides.len());
            let place = place.index(sides[axis]) as i64;
            let shape: &[usize] = if scalar { &[] } else { &[1] };
            Problem {
                operator: "Gather",
                attributes: vec![int("axis", axis as i64)],
                operands: vec![
                    Operand::Input(x.fill(&sides)),
                    Operand::Integers(Tensor::new(shape, vec![place])),
                ],
            }
        },
    )
}

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

/// Places along an axis, counted from either end: one that goes (a scalar index), or a table of them.
pub fn gather() -> impl Strategy<Value = Problem> {
    let places = prop_oneof![Just(vec![]), prop::collection::vec(1..=3_usize, 1..=2)];
    (
        sides(),
        any::<Index>(),
        places,
        prop::collection::vec((any::<Index>(), any::<bool>()), 9),
        any::<Values>(),
    )
        .prop_map(|(sides, axis, shape, places, x)| {
            let axis = axis.index(sides.len());
            let length = sides[axis] as i64;
            let count = shape.iter().product();
            let place = |&(place, from_end): &(Index, bool)| {
                place.index(sides[axis]) as i64 - if from_end { length } else { 0 }
            };
            let places = places.iter().take(count).map(place).collect();
            Problem {
                operator: "Gather",
                attributes: vec![int("axis", axis as i64)],
                operands: vec![
                    Operand::Input(x.fill(&sides)),
                    Operand::Integers(Tensor::new(&shape, places)),
                ],
            }
        })
}

/// A tensor repeated to a larger shape; wanted sides of one keep its own.
pub fn expand() -> impl Strategy<Value = Problem> {
    let side = (1..=4_usize, 0..=2_u8);
    (prop::collection::vec(side, 1..=4), 0..=2_usize, any::<Values>()).prop_map(|(sides, leading, x)| {
        // 0: both have the side, 1: only what is wanted has it, 2: only the tensor.
        let own: Vec<usize> = sides.iter().map(|&(n, who)| if who == 1 { 1 } else { n }).collect();
        let wanted = sides.iter().map(|&(n, who)| if who == 2 { 1 } else { n as i64 });
        Problem {
            operator: "Expand",
            attributes: vec![],
            operands: vec![
                Operand::Input(x.fill(&own)),
                list(std::iter::repeat_n(2, leading).chain(wanted).collect()),
            ],
        }
    })
}

/// A tensor laid beside itself.
pub fn tile() -> impl Strategy<Value = Problem> {
    (prop::collection::vec((1..=4_usize, 1..=3_i64), 1..=4), any::<Values>()).prop_map(|(sides, x)| Problem {
        operator: "Tile",
        attributes: vec![],
        operands: vec![
            Operand::Input(x.fill(&sides.iter().map(|side| side.0).collect::<Vec<_>>())),
            list(sides.iter().map(|side| side.1).collect()),
        ],
    })
}

/// Ranges along one or two axes, from either end, beyond the end, in steps, backwards.
///
/// A range to the very end is written by the largest end forwards and by the smallest backwards, as the specification advises;
/// of the other two ONNX Runtime makes what no other implementation does.
pub fn slice() -> impl Strategy<Value = Problem> {
    let step = prop::sample::select(vec![1_i64, 1, 2, 3, -1, -2]);
    let range = (-8..=8_i64, prop::option::weighted(0.7, -8..=8_i64), step).prop_map(|(start, end, step)| {
        (start, end.unwrap_or(if step > 0 { i64::MAX } else { i64::MIN }), step)
    });
    (sides(), prop::collection::vec(range, 1..=2), any::<bool>(), any::<Values>()).prop_map(
        |(sides, ranges, last_axes, x)| {
            let count = ranges.len().min(sides.len());
            let first = if last_axes { sides.len() - count } else { 0 };
            let each = |of: fn(&(i64, i64, i64)) -> i64| list(ranges[..count].iter().map(of).collect());
            Problem {
                operator: "Slice",
                attributes: vec![],
                operands: vec![
                    Operand::Input(x.fill(&sides)),
                    each(|range| range.0),
                    each(|range| range.1),
                    list((first..first + count).map(|axis| axis as i64).collect()),
                    each(|range| range.2),
                ],
            }
        },
    )
}

/// Parts along an axis, of which the last is judged.
pub fn split() -> impl Strategy<Value = Problem> {
    (sides(), any::<Index>(), prop::collection::vec(1..=3_usize, 1..=3), any::<Values>()).prop_map(
        |(mut sides, axis, parts, x)| {
            let axis = axis.index(sides.len());
            sides[axis] = parts.iter().sum();
            Problem {
                operator: "Split",
                attributes: vec![int("axis", axis as i64)],
                operands: vec![
                    Operand::Input(x.fill(&sides)),
                    list(parts.iter().map(|&part| part as i64).collect()),
                ],
            }
        },
    )
}

/// Axes of length one removed, counted from the front or from the back. (What an empty list removes is not specified.)
pub fn squeeze() -> impl Strategy<Value = Problem> {
    (prop::collection::vec((1..=4_usize, any::<bool>()), 1..=4), any::<bool>(), any::<Values>()).prop_map(
        |(mut sides, from_back, x)| {
            sides[0].1 |= sides.iter().all(|side| !side.1);
            let shape: Vec<usize> = sides.iter().map(|&(n, gone)| if gone { 1 } else { n }).collect();
            let rank = if from_back { sides.len() as i64 } else { 0 };
            let gone = (0..sides.len()).filter(|&axis| sides[axis].1).map(|axis| axis as i64 - rank);
            Problem {
                operator: "Squeeze",
                attributes: vec![],
                operands: vec![Operand::Input(x.fill(&shape)), list(gone.collect())],
            }
        },
    )
}

/// All axes before one joined, and all from it on.
pub fn flatten() -> impl Strategy<Value = Problem> {
    (sides(), any::<Index>(), any::<Values>()).prop_map(|(sides, axis, x)| Problem {
        operator: "Flatten",
        attributes: vec![int("axis", axis.index(sides.len() + 1) as i64)],
        operands: vec![Operand::Input(x.fill(&sides))],
    })
}

/// The shape itself, or a part of it.
pub fn shape() -> impl Strategy<Value = Problem> {
    (sides(), any::<Values>(), 0..=3_i64, -3..=5_i64).prop_map(|(sides, x, start, end)| Problem {
        operator: "Shape",
        attributes: vec![int("start", start), int("end", end)],
        operands: vec![Operand::Input(x.fill(&sides))],
    })
}

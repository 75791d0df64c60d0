//! Operators that compare and choose: they round nothing and must be met bit by bit.

use proptest::prelude::*;
use proptest::sample::Index;
use vitruvian_reference::nn::Tensor;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::int;

/// a < b, a > b or a = b, where some are equal.
pub fn comparison(operator: &'static str) -> impl Strategy<Value = Problem> {
    (1..=4_usize, 1..=40_usize, any::<bool>(), any::<[Values; 2]>()).prop_map(
        move |(rows, columns, broadcast, [a, b])| {
            let a = a.fill(&[rows, columns]);
            let mut b = b.fill(&[if broadcast { 1 } else { rows }, columns]);
            for (place, value) in b.values.iter_mut().enumerate().step_by(3) {
                *value = a.values[place];
            }
            Problem { operator, attributes: vec![], operands: vec![Operand::Input(a), Operand::Input(b)] }
        },
    )
}

/// Numbers, infinities and what is no number.
pub fn is_nan() -> impl Strategy<Value = Problem> {
    (prop::collection::vec(0..4_usize, 1..=40), any::<Values>()).prop_map(|(kinds, x)| {
        let mut x = x.fill(&[kinds.len()]);
        for (value, kind) in x.values.iter_mut().zip(kinds) {
            *value = [*value, f32::NAN, f32::INFINITY, -f32::NAN][kind];
        }
        Problem { operator: "IsNaN", attributes: vec![], operands: vec![Operand::Input(x)] }
    })
}

/// One tensor where a choice holds, another elsewhere; the choice has rows or is one for all.
pub fn choice() -> impl Strategy<Value = Problem> {
    (1..=4_usize, prop::collection::vec(any::<bool>(), 1..=40), any::<bool>(), any::<[Values; 2]>()).prop_map(
        |(rows, condition, column, [a, b])| {
            let columns = condition.len();
            Problem {
                operator: "Where",
                attributes: vec![],
                operands: vec![
                    Operand::Truths(Tensor::new(&[columns], condition)),
                    Operand::Input(a.fill(&[rows, columns])),
                    Operand::Input(b.fill(&[rows, if column { 1 } else { columns }])),
                ],
            }
        },
    )
}

/// A tensor with some slices replaced, no place twice.
pub fn scatter_nd() -> impl Strategy<Value = Problem> {
    (1..=6_usize, 1..=5_usize, any::<Index>(), any::<bool>(), any::<[Values; 2]>()).prop_map(
        |(rows, columns, first, single, [x, updates])| {
            // Every other row from one on, or in each of them the element of its column.
            let places: Vec<usize> = (first.index(rows)..rows).step_by(2).collect();
            let (indices, shape): (Vec<i64>, Vec<usize>) = if single {
                let pairs = places.iter().flat_map(|&row| [row as i64, -((row % columns) as i64) - 1]);
                (pairs.collect(), vec![places.len()])
            } else {
                (places.iter().map(|&row| row as i64 - rows as i64).collect(), vec![places.len(), columns])
            };
            let depth = if single { 2 } else { 1 };
            Problem {
                operator: "ScatterND",
                attributes: vec![],
                operands: vec![
                    Operand::Input(x.fill(&[rows, columns])),
                    Operand::Integers(Tensor::new(&[places.len(), depth], indices)),
                    Operand::Input(updates.fill(&shape)),
                ],
            }
        },
    )
}

/// A tensor with some elements replaced, no place twice.
pub fn scatter_elements() -> impl Strategy<Value = Problem> {
    (1..=6_usize, 1..=5_usize, any::<Index>(), any::<bool>(), any::<[Values; 2]>()).prop_map(
        |(rows, columns, shift, along_rows, [x, updates])| {
            let length = if along_rows { rows } else { columns };
            // The places of a line are a rotation of it, so that none occurs twice.
            let place = |line: usize, k: usize| ((line + k + shift.index(length)) % length) as i64;
            let indices: Vec<i64> = (0..rows * columns)
                .map(|i| {
                    if along_rows { place(i % columns, i / columns) } else { place(i / columns, i % columns) }
                })
                .collect();
            Problem {
                operator: "ScatterElements",
                attributes: vec![int("axis", i64::from(!along_rows))],
                operands: vec![
                    Operand::Input(x.fill(&[rows, columns])),
                    Operand::Integers(Tensor::new(&[rows, columns], indices)),
                    Operand::Input(updates.fill(&[rows, columns])),
                ],
            }
        },
    )
}

//! Arithmetic with broadcasting, and activations.

use proptest::prelude::*;

use super::values::Values;
use super::{Operand, Problem};
use crate::array::Array;
use crate::onnx::builder::float;

/// a ∘ b for Add, Sub, Mul, Div, Max or Min, where b has some sides of one or lacks leading axes.
pub fn binary(operator: &'static str) -> impl Strategy<Value = Problem> {
    let sides = prop::collection::vec((1..=9_usize, any::<bool>()), 1..=4);
    (sides, any::<prop::sample::Index>(), any::<Values>(), any::<Values>()).prop_map(
        move |(sides, missing, a, b)| {
            let a_shape: Vec<_> = sides.iter().map(|side| side.0).collect();
            let b_shape: Vec<_> = sides[missing.index(sides.len())..]
                .iter()
                .map(|&(side, repeated)| if repeated { 1 } else { side })
                .collect();
            let mut b = b.fill(&b_shape);
            if operator == "Div" {
                // A quotient by zero is no number; the networks divide by deviations.
                b = b.map(|x| if x == 0.0 { 1.0 } else { x });
            }
            Problem {
                operator,
                attributes: vec![],
                operands: vec![Operand::Input(a.fill(&a_shape)), Operand::Input(b)],
            }
        },
    )
}

/// x kept within bounds of which one may be absent.
pub fn clip() -> impl Strategy<Value = Problem> {
    (1..=70_usize, any::<Values>(), -1.0..1.0_f32, 0.0..2.0_f32, any::<bool>()).prop_map(
        |(count, x, low, width, bounded_above)| {
            let bound = |value: f32| Operand::Weight(Array::new(&[], vec![value]));
            let mut operands = vec![Operand::Input(x.fill(&[count])), bound(low)];
            operands.extend(bounded_above.then(|| bound(low + width)));
            Problem { operator: "Clip", attributes: vec![], operands }
        },
    )
}

/// xⁿ of positive x for one exponent n.
pub fn pow() -> impl Strategy<Value = Problem> {
    (1..=70_usize, any::<Values>(), prop::sample::select(vec![2.0_f32, 3.0, 0.5, -1.0, 1.7])).prop_map(
        |(count, x, exponent)| Problem {
            operator: "Pow",
            attributes: vec![],
            operands: vec![
                Operand::Input(x.fill(&[count]).map(|x| x.abs().max(1e-6))),
                Operand::Weight(Array::new(&[], vec![exponent])),
            ],
        },
    )
}

/// f(x) for the functions of angles and cosines, exponentials and logarithms: angles of a few turns, cosines in −1…1.
pub fn transcendental(operator: &'static str) -> impl Strategy<Value = Problem> {
    (1..=70_usize, any::<u64>()).prop_map(move |(count, seed)| {
        let x = Values::ordinary(seed).fill(&[count]);
        let x = match operator {
            "Acos" => x,
            "Log" => x.map(|x| 10.0 * x.abs() + 1e-3),
            _ => x.map(|x| 8.0 * x),
        };
        Problem { operator, attributes: vec![], operands: vec![Operand::Input(x)] }
    })
}

/// f(x) for Relu, LeakyRelu, Sigmoid, Sqrt, Tanh, Softplus, Neg, Abs or Reciprocal.
pub fn unary(operator: &'static str) -> impl Strategy<Value = Problem> {
    // Sizes around the width of a vector register: kernels treat the remainder apart.
    let sizes = (1..=3_usize, 1..=70_usize);
    (sizes, any::<Values>(), prop::sample::select(vec![0.01_f32, 0.0, 0.2, 1.0])).prop_map(
        move |((rows, columns), x, slope)| {
            let x = x.fill(&[rows, columns]);
            Problem {
                operator,
                attributes: if operator == "LeakyRelu" { vec![float("alpha", slope)] } else { vec![] },
                operands: vec![Operand::Input(match operator {
                    "Sqrt" => x.map(f32::abs),
                    // The reciprocal of zero is no number.
                    "Reciprocal" => x.map(|x| if x == 0.0 { 1.0 } else { x }),
                    _ => x,
                })],
            }
        },
    )
}

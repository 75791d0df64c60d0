//! Arithmetic with broadcasting, and activations.

use proptest::prelude::*;

use super::values::{Pattern, Values};
use super::{Operand, Problem};
use crate::array::Array;
use crate::onnx::builder::{float, int, text};

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

/// xʸ of positive x with an exponent for each element, each column or all of them.
pub fn powers() -> impl Strategy<Value = Problem> {
    (1..=5_usize, 1..=40_usize, any::<[u64; 2]>(), 0..3_usize).prop_map(|(rows, columns, seeds, kind)| {
        let [x, exponent] = seeds.map(|seed| Values { pattern: Pattern::Decades, decade: 0, seed });
        let shapes: [&[usize]; 3] = [&[rows, columns], &[columns], &[rows, 1]];
        Problem {
            operator: "Pow",
            attributes: vec![],
            operands: vec![
                Operand::Input(x.fill(&[rows, columns]).map(f32::abs)),
                Operand::Input(exponent.fill(shapes[kind]).map(|y| y.clamp(-4.0, 4.0))),
            ],
        }
    })
}

/// The remainder with the dividend's sign; no divisor is zero.
pub fn modulo() -> impl Strategy<Value = Problem> {
    (1..=70_usize, any::<[Values; 2]>()).prop_map(|(count, [a, b])| Problem {
        operator: "Mod",
        attributes: vec![int("fmod", 1)],
        operands: vec![
            Operand::Input(a.fill(&[count])),
            Operand::Input(b.fill(&[count]).map(|b| if b == 0.0 { 1.0 } else { b })),
        ],
    })
}

/// Activations that take attributes or none, on numbers whose exponentials do not underflow.
pub fn activation(operator: &'static str) -> impl Strategy<Value = Problem> {
    let settings = prop::sample::select(vec![[1.0_f32, 0.5], [0.2, 0.0], [1.7, 1.05]]);
    (1..=3_usize, 1..=70_usize, any::<Values>(), settings, any::<bool>()).prop_map(
        move |(rows, columns, x, [alpha, beta], approximate)| Problem {
            operator,
            attributes: match operator {
                "Celu" | "Elu" | "ThresholdedRelu" => vec![float("alpha", alpha)],
                "Gelu" => vec![text("approximate", if approximate { "tanh" } else { "none" })],
                "HardSigmoid" => vec![float("alpha", alpha), float("beta", beta)],
                "Selu" => vec![float("alpha", alpha), float("gamma", 1.0 + beta)],
                "Shrink" => vec![float("lambd", alpha), float("bias", beta)],
                _ => vec![],
            },
            operands: vec![Operand::Input(x.fill(&[rows, columns]).map(|x| x.clamp(-30.0, 30.0)))],
        },
    )
}

/// Gelu as in transformers, on ordinary numbers.
pub fn ordinary_gelu() -> impl Strategy<Value = Problem> {
    any::<u64>().prop_map(|seed| Problem {
        operator: "Gelu",
        attributes: vec![text("approximate", "none")],
        operands: vec![Operand::Input(Values::ordinary(seed).fill(&[8, 32]))],
    })
}

/// A slope for each channel, or one for all, below zero.
pub fn prelu() -> impl Strategy<Value = Problem> {
    (1..=6_usize, 1..=12_usize, any::<[Values; 2]>(), any::<bool>()).prop_map(
        |(channels, pixels, [x, slope], shared)| Problem {
            operator: "PRelu",
            attributes: vec![],
            operands: vec![
                Operand::Input(x.fill(&[2, channels, pixels])),
                Operand::Weight(slope.fill(&[if shared { 1 } else { channels }, 1])),
            ],
        },
    )
}

/// f(x) for the functions of angles and cosines, exponentials and logarithms: angles of a few turns, cosines in −1…1.
pub fn transcendental(operator: &'static str) -> impl Strategy<Value = Problem> {
    (1..=70_usize, any::<u64>()).prop_map(move |(count, seed)| {
        let x = Values::ordinary(seed).fill(&[count]);
        let x = match operator {
            "Acos" | "Asin" | "Atanh" => x,
            "Acosh" => x.map(|x| 1.0 + 10.0 * x.abs()),
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

//! Arithmetic with broadcasting, and activations.

use proptest::prelude::*;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::float;

/// a ∘ b for Add, Sub, Mul or Div, where b has some sides of one or lacks leading axes.
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

/// f(x) for Relu, LeakyRelu, Sigmoid or Sqrt.
pub fn unary(operator: &'static str) -> impl Strategy<Value = Problem> {
    // Sizes around the width of a vector register: kernels treat the remainder apart.
    let sizes = (1..=3_usize, 1..=70_usize);
    (sizes, any::<Values>(), prop::sample::select(vec![0.01_f32, 0.0, 0.2, 1.0])).prop_map(
        move |((rows, columns), x, slope)| {
            let x = x.fill(&[rows, columns]);
            Problem {
                operator,
                attributes: if operator == "LeakyRelu" { vec![float("alpha", slope)] } else { vec![] },
                operands: vec![Operand::Input(if operator == "Sqrt" { x.map(f32::abs) } else { x })],
            }
        },
    )
}

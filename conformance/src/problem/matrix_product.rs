//! Gemm, MatMul and Einsum: the layers of a regressor and of point networks, and products of rotations.

use proptest::prelude::*;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::{float, int, text};

/// α·A′B′ + β·C, transposed or not; C \[M,N\], \[N\], \[1\] or absent.
pub fn gemm() -> impl Strategy<Value = Problem> {
    let sizes = (1..=20_usize, 1..=150_usize, 1..=40_usize);
    let factors = prop::sample::select(vec![1.0_f32, 0.5, -2.3]);
    (sizes, any::<[bool; 2]>(), [factors.clone(), factors], any::<[Values; 3]>(), 0..=3_usize).prop_map(
        |((m, k, n), [trans_a, trans_b], [alpha, beta], [a, b, c], added)| {
            let a_shape = if trans_a { [k, m] } else { [m, k] };
            let b_shape = if trans_b { [n, k] } else { [k, n] };
            let mut operands = vec![Operand::Input(a.fill(&a_shape)), Operand::Weight(b.fill(&b_shape))];
            let c_shapes: [&[usize]; 3] = [&[m, n], &[n], &[1]];
            operands.extend(c_shapes.get(added).map(|shape| Operand::Weight(c.fill(shape))));
            Problem {
                operator: "Gemm",
                attributes: vec![
                    float("alpha", alpha),
                    float("beta", beta),
                    int("transA", trans_a.into()),
                    int("transB", trans_b.into()),
                ],
                operands,
            }
        },
    )
}

/// A·B of matrices, in batches that broadcast.
pub fn matmul() -> impl Strategy<Value = Problem> {
    let sizes = (1..=3_usize, 1..=20_usize, 1..=150_usize, 1..=20_usize);
    (sizes, any::<bool>(), any::<[Values; 2]>()).prop_map(|((batch, m, k, n), shared, [a, b])| {
        let b_shape = if shared { vec![k, n] } else { vec![batch, k, n] };
        Problem {
            operator: "MatMul",
            attributes: vec![],
            operands: vec![Operand::Input(a.fill(&[batch, m, k])), Operand::Weight(b.fill(&b_shape))],
        }
    })
}

/// Inner products of rows, products of matrices and sums over axes, by the names of their axes.
pub fn einsum() -> impl Strategy<Value = Problem> {
    let equations = vec!["bi,bi->b", "bij,bjk->bik", "bij,bj->bi", "ij,kj->ik", "bij->bji", "bij->i"];
    (prop::sample::select(equations), [1..=5_usize, 1..=40, 1..=6, 1..=6], any::<[Values; 2]>()).prop_map(
        |(equation, sides, values)| {
            let side = |name: char| sides["bijk".find(name).expect("a name of these equations")];
            let (left, _) = equation.split_once("->").expect("an arrow");
            let operands = left.split(',').zip(values).map(|(names, values)| {
                Operand::Input(values.fill(&names.chars().map(side).collect::<Vec<_>>()))
            });
            Problem {
                operator: "Einsum",
                attributes: vec![text("equation", equation)],
                operands: operands.collect(),
            }
        },
    )
}

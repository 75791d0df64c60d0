//! Pools of windows and of whole images, and reductions over axes.

use proptest::prelude::*;
use vitruvian_reference::nn::Tensor;

use super::values::Values;
use super::{Operand, Problem};
use crate::onnx::builder::{int, ints};

/// Kernel, stride, what the paddings are drawn from, and pixels beyond the kernel.
type Axis = (usize, usize, [usize; 2], usize);

/// Windows whose taps lie apart and whose last may hang over the end.
pub fn dilated_pool(operator: &'static str, spatial: usize) -> impl Strategy<Value = Problem> {
    let axis = (1..=3_usize, 1..=3_usize, 1..=3_usize, any::<[usize; 2]>(), 0..=9_usize);
    let axes = prop::collection::vec(axis, spatial);
    (1..=3_usize, axes, any::<[bool; 2]>(), any::<Values>()).prop_map(
        move |(channels, axes, [ceil, include_pad], x)| {
            let all = |of: fn(&(usize, usize, usize, [usize; 2], usize)) -> usize| {
                axes.iter().map(of).collect::<Vec<_>>()
            };
            let extent = |axis: &(usize, usize, usize, [usize; 2], usize)| (axis.0 - 1) * axis.2 + 1;
            let size = axes.iter().map(|axis| extent(axis) + axis.4).collect();
            // Paddings of less than a kernel, as ONNX Runtime asks for.
            let pads = [all(|axis| axis.3[0] % axis.0), all(|axis| axis.3[1] % axis.0)].concat();
            let mut attributes = vec![
                ints("kernel_shape", &all(|axis| axis.0)),
                ints("strides", &all(|axis| axis.1)),
                ints("dilations", &all(|axis| axis.2)),
                ints("pads", &pads),
                int("ceil_mode", ceil.into()),
            ];
            match operator {
                "AveragePool" => attributes.push(int("count_include_pad", include_pad.into())),
                "LpPool" => attributes.push(int("p", 1 + i64::from(include_pad))),
                _ => (),
            }
            let operands = vec![Operand::Input(x.fill(&[vec![1, channels], size].concat()))];
            Problem { operator, attributes, operands }
        },
    )
}

/// x [N,C,…]: the largest of each window, with this many spatial axes.
pub fn max_pool(spatial: usize) -> impl Strategy<Value = Problem> {
    let extra = if spatial == 2 { 0..=12_usize } else { 0..=5 };
    let axis = (1..=3_usize, 1..=3_usize, any::<[usize; 2]>(), extra);
    (1..=2_usize, 1..=6_usize, prop::collection::vec(axis, spatial), any::<Values>()).prop_map(
        |(samples, channels, axes, x)| {
            let all = |of: fn(&Axis) -> usize| axes.iter().map(of).collect::<Vec<_>>();
            // Paddings below the kernel's side, so that every window holds a pixel.
            let before = all(|axis| axis.2[0] % axis.0);
            let after = all(|axis| axis.2[1] % axis.0);
            let size = all(|axis| axis.0 + axis.3);
            Problem {
                operator: "MaxPool",
                attributes: vec![
                    ints("kernel_shape", &all(|axis| axis.0)),
                    ints("strides", &all(|axis| axis.1)),
                    ints("pads", &[before, after].concat()),
                ],
                operands: vec![Operand::Input(x.fill(&[vec![samples, channels], size].concat()))],
            }
        },
    )
}

/// x \[N,C,H,W\]: the mean of each window, with its padding as zeros or not at all.
pub fn average_pool() -> impl Strategy<Value = Problem> {
    (max_pool(2), any::<bool>()).prop_map(|(problem, include_pad)| {
        let mut attributes = problem.attributes;
        attributes.push(int("count_include_pad", include_pad.into()));
        Problem { operator: "AveragePool", attributes, operands: problem.operands }
    })
}

/// x [N,C,…]: the mean, the largest or the length of each image.
pub fn global_pool(operator: &'static str) -> impl Strategy<Value = Problem> {
    let sides = prop::collection::vec(1..=9_usize, 1..=3);
    (1..=2_usize, 1..=20_usize, sides, any::<Values>()).prop_map(move |(samples, channels, sides, x)| {
        Problem {
            operator,
            attributes: vec![],
            operands: vec![Operand::Input(x.fill(&[vec![samples, channels], sides].concat()))],
        }
    })
}

/// A reduction over one or two axes, as over the views of a capture.
pub fn reduce(operator: &'static str) -> impl Strategy<Value = Problem> {
    let sides = prop::collection::vec(1..=12_usize, 2..=4);
    (sides, any::<[prop::sample::Index; 2]>(), any::<bool>(), any::<Values>()).prop_map(
        move |(sides, axes, keepdims, x)| {
            let mut axes: Vec<i64> = axes.iter().map(|axis| axis.index(sides.len()) as i64).collect();
            axes.sort_unstable();
            axes.dedup();
            Problem {
                operator,
                attributes: vec![int("keepdims", keepdims.into())],
                operands: vec![
                    Operand::Input(match operator {
                        // No logarithm of a negative sum, no power that underflows, no product that overflows.
                        "ReduceLogSum" => x.fill(&sides).map(|x| x.abs() + 1e-3),
                        "ReduceLogSumExp" => x.fill(&sides).map(|x| x.clamp(-30.0, 30.0)),
                        "ReduceProd" => x.fill(&sides).map(|x| (0.8 + 0.4 * x.abs().min(1.0)).copysign(x)),
                        _ => x.fill(&sides),
                    }),
                    Operand::Integers(Tensor::new(&[axes.len()], axes)),
                ],
            }
        },
    )
}

//! BatchNormalization at inference, GroupNormalization, InstanceNormalization, LayerNormalization and LpNormalization.

use proptest::prelude::*;

use super::values::{Pattern, Values};
use super::{Operand, Problem};
use crate::array::Array;
use crate::onnx::builder::{float, int};

/// Variances: positive, from 10⁻³ to 10³.
fn variances(seed: u64, channels: usize) -> Array {
    Values { pattern: Pattern::Decades, decade: 0, seed }.fill(&[channels]).map(f32::abs)
}

fn epsilon() -> impl Strategy<Value = f32> {
    prop::sample::select(vec![1e-5_f32, 1e-3])
}

/// x [N,C,…] with stored statistics; two or three spatial axes.
pub fn batch_norm() -> impl Strategy<Value = Problem> {
    let sizes = (1..=2_usize, 1..=12_usize, prop::collection::vec(1..=5_usize, 2..=3));
    (sizes, any::<[Values; 4]>(), any::<u64>(), epsilon()).prop_map(
        |((samples, channels, sides), [x, scale, bias, mean], seed, epsilon)| {
            let weight = |values: Values| Operand::Weight(values.fill(&[channels]));
            Problem {
                operator: "BatchNormalization",
                attributes: vec![float("epsilon", epsilon)],
                operands: vec![
                    Operand::Input(x.fill(&[vec![samples, channels], sides].concat())),
                    weight(scale),
                    weight(bias),
                    weight(mean),
                    Operand::Weight(variances(seed, channels)),
                ],
            }
        },
    )
}

/// x \[N,C,H,W\] in groups of channels.
pub fn group_norm() -> impl Strategy<Value = Problem> {
    let sizes = (1..=2_usize, 1..=4_usize, 1..=8_usize, 1..=9_usize, 1..=9_usize);
    (sizes, any::<[Values; 3]>(), epsilon()).prop_map(
        |((samples, groups, per_group, height, width), [x, scale, bias], epsilon)| {
            let channels = groups * per_group;
            Problem {
                operator: "GroupNormalization",
                attributes: vec![int("num_groups", groups as i64), float("epsilon", epsilon)],
                operands: vec![
                    Operand::Input(x.fill(&[samples, channels, height, width])),
                    Operand::Weight(scale.fill(&[channels])),
                    Operand::Weight(bias.fill(&[channels])),
                ],
            }
        },
    )
}

/// x [N,C,…] with each channel by itself; one to three spatial axes.
pub fn instance_norm() -> impl Strategy<Value = Problem> {
    let sizes = (1..=2_usize, 1..=6_usize, prop::collection::vec(1..=7_usize, 1..=3));
    (sizes, any::<[Values; 3]>(), epsilon()).prop_map(
        |((samples, channels, sides), [x, scale, bias], epsilon)| Problem {
            operator: "InstanceNormalization",
            attributes: vec![float("epsilon", epsilon)],
            operands: vec![
                Operand::Input(x.fill(&[vec![samples, channels], sides].concat())),
                Operand::Weight(scale.fill(&[channels])),
                Operand::Weight(bias.fill(&[channels])),
            ],
        },
    )
}

/// x [N,…] over its last axes, with or without a bias.
pub fn layer_norm() -> impl Strategy<Value = Problem> {
    let sides = prop::collection::vec(1..=12_usize, 2..=4);
    (sides, any::<prop::sample::Index>(), any::<[Values; 3]>(), any::<bool>(), epsilon()).prop_map(
        |(sides, axis, [x, scale, bias], biased, epsilon)| {
            let axis = axis.index(sides.len());
            let mut operands =
                vec![Operand::Input(x.fill(&sides)), Operand::Weight(scale.fill(&sides[axis..]))];
            operands.extend(biased.then(|| Operand::Weight(bias.fill(&sides[axis..]))));
            Problem {
                operator: "LayerNormalization",
                attributes: vec![int("axis", axis as i64), float("epsilon", epsilon)],
                operands,
            }
        },
    )
}

/// x divided by the length of its lines, none of which is zero.
pub fn lp_norm() -> impl Strategy<Value = Problem> {
    ([1..=6_usize, 1..=20, 1..=6], 0..3_i64, 1..=2_i64, any::<Values>()).prop_map(|(sides, axis, p, x)| {
        Problem {
            operator: "LpNormalization",
            attributes: vec![int("axis", axis), int("p", p)],
            operands: vec![Operand::Input(x.fill(&sides).map(|x| if x == 0.0 { 1e-3 } else { x }))],
        }
    })
}

/// Layer normalisation as in transformers, on ordinary numbers (variance ⅓) with ε = 10⁻⁵.
pub fn ordinary_layer_norm() -> impl Strategy<Value = Problem> {
    any::<[u64; 3]>().prop_map(|seeds| {
        let [x, scale, bias] = seeds.map(Values::ordinary);
        Problem {
            operator: "LayerNormalization",
            attributes: vec![int("axis", -1), float("epsilon", 1e-5)],
            operands: vec![
                Operand::Input(x.fill(&[4, 6, 32])),
                Operand::Weight(scale.fill(&[32])),
                Operand::Weight(bias.fill(&[32])),
            ],
        }
    })
}

/// Group normalisation as in the networks, on ordinary numbers (variance ⅓) with ε = 10⁻⁵.
pub fn ordinary_group_norm() -> impl Strategy<Value = Problem> {
    any::<[u64; 3]>().prop_map(|seeds| {
        let [x, scale, bias] = seeds.map(Values::ordinary);
        Problem {
            operator: "GroupNormalization",
            attributes: vec![int("num_groups", 4), float("epsilon", 1e-5)],
            operands: vec![
                Operand::Input(x.fill(&[1, 16, 8, 8])),
                Operand::Weight(scale.fill(&[16])),
                Operand::Weight(bias.fill(&[16])),
            ],
        }
    })
}

/// Batch normalisation as in the networks, on ordinary numbers with variances in ½..1½ and ε = 10⁻⁵.
pub fn ordinary_batch_norm() -> impl Strategy<Value = Problem> {
    any::<[u64; 5]>().prop_map(|seeds| {
        let [x, scale, bias, mean, variance] = seeds.map(Values::ordinary);
        let weight = |values: Values| Operand::Weight(values.fill(&[8]));
        Problem {
            operator: "BatchNormalization",
            attributes: vec![float("epsilon", 1e-5)],
            operands: vec![
                Operand::Input(x.fill(&[1, 8, 4, 4, 4])),
                weight(scale),
                weight(bias),
                weight(mean),
                Operand::Weight(variance.fill(&[8]).map(|v| 1.0 + v / 2.0)),
            ],
        }
    })
}

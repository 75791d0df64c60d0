//! Mistakes in normalisations, and in those that an exporter has taken apart.

use super::changes::slices;
use super::{Fault, Plant, attributes, fault, operand};
use crate::array::Array;
use crate::onnx::builder::{float, int};
use crate::suite::audit_faults::scenes::{images, lists, tokens, volumes};

pub(super) const FAULTS: &[Fault] = &[
    attributes("BatchNormalization: ε 1e-3 for 1e-5", "epsilon", (images, "n1"), || {
        vec![float("epsilon", 1e-3)]
    }),
    attributes("BatchNormalization: ε 3e-4 for 1e-5", "epsilon", (images, "n1"), || {
        vec![float("epsilon", 3e-4)]
    }),
    attributes("GroupNormalization: ε 1e-3 for 1e-5", "epsilon", (images, "n2"), || {
        vec![float("epsilon", 1e-3)]
    }),
    attributes("InstanceNormalization: ε 1e-3 for 1e-5", "epsilon", (volumes, "n"), || {
        vec![float("epsilon", 1e-3)]
    }),
    attributes("LayerNormalization: ε 1e-6 for 1e-5", "epsilon", (tokens, "n"), || {
        vec![float("epsilon", 1e-6)]
    }),
    fault(
        "InstanceNormalization: unbiased variance",
        "variance",
        (volumes, "n"),
        Plant::Made(|x| unbiased(&x)),
    ),
    fault(
        "BatchNormalization: mean and variance exchanged",
        "mean-variance-swapped",
        (images, "n1"),
        Plant::Node(|mut node| {
            node.input.swap(3, 4);
            node
        }),
    ),
    fault(
        "BatchNormalization: scale and shift exchanged",
        "scale-bias-swapped",
        (images, "n1"),
        Plant::Node(|mut node| {
            node.input.swap(1, 2);
            node
        }),
    ),
    attributes("GroupNormalization: 2 groups for 4", "num_groups", (images, "n2"), || {
        vec![int("num_groups", 2)]
    }),
    operand("GroupNormalization: one scale a group", "scale-per-group", (images, "n2"), 1, |scale| {
        of_groups(&scale, 2)
    }),
    attributes("LayerNormalization: axis 1 for 2", "axis", (tokens, "n"), || vec![int("axis", 1)]),
    operand("taken apart: ε 1e-3 for 1e-5", "epsilon", (lists, "guarded"), 1, |small| small.map(|_| 1e-3)),
    fault(
        "taken apart: unbiased variance",
        "variance",
        (lists, "variance"),
        Plant::Output(|y| y.map(|y| y * (16.0 / 15.0))),
    ),
];

/// The first element of each group for all of it.
fn of_groups(scale: &Array, size: usize) -> Array {
    slices(scale, 0, &(0..scale.shape[0]).map(|c| c / size * size).collect::<Vec<_>>())
}

/// Instance normalisation with the variance divided by N − 1.
fn unbiased(operands: &[Array]) -> Array {
    let [x, scale, shift] = operands else { panic!("{} operands, three were expected", operands.len()) };
    let (channels, place) = (x.shape[1], x.shape[2..].iter().product::<usize>());
    let slice = |(i, values): (usize, &[f32])| -> Vec<f32> {
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / place as f64;
        let squares: f64 = values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum();
        let root = (squares / (place - 1) as f64 + 1e-5).sqrt();
        let (scale, shift) = (f64::from(scale.values[i % channels]), f64::from(shift.values[i % channels]));
        values.iter().map(|&v| ((f64::from(v) - mean) / root * scale + shift) as f32).collect()
    };
    Array {
        shape: x.shape.clone(),
        values: x.values.chunks_exact(place).enumerate().flat_map(slice).collect(),
    }
}

//! Numbers that belong elsewhere, in another order, or were never written.

use super::changes::slices;
use super::{Fault, Plant, fault, operand};
use crate::array::Array;
use crate::suite::audit_faults::scenes::{drawn, images, tokens, volumes};

pub(super) const FAULTS: &[Fault] = &[
    // Layouts.
    fault("Conv: channels last in memory", "layout", (images, "c1"), Plant::Output(|y| channels_last(&y))),
    fault(
        "Conv: views exchanged",
        "batch-order",
        (images, "c2"),
        Plant::Output(|y| first_slices(&y, &[1, 0, 2])),
    ),
    fault(
        "Conv: one view twice",
        "batch-order",
        (images, "c2"),
        Plant::Output(|y| first_slices(&y, &[0, 1, 1])),
    ),
    // Numbers that belong elsewhere.
    fault("Conv: another layer's output", "stale", (images, "c2"), Plant::Stale("c1")),
    operand("MatMul: another layer's operand", "stale", (tokens, "m3"), 0, |x| Array {
        values: drawn("elsewhere", &x.shape),
        ..x
    }),
    operand("Conv: another image's output", "stale", (images, "c1"), 0, |x| Array {
        values: drawn("another image", &x.shape),
        ..x
    }),
    fault(
        "Conv: elements in the opposite order",
        "permuted",
        (images, "c1"),
        Plant::Output(|y| Array { values: y.values.iter().rev().copied().collect(), ..y }),
    ),
    fault("Conv: never written", "zero-output", (images, "c3"), Plant::Output(|y| y.map(|_| 0.0))),
    fault(
        "Conv: last channel never written",
        "unwritten",
        (images, "c3"),
        Plant::Output(|y| last_channel_zero(&y)),
    ),
    fault(
        "Conv: a NaN",
        "not-finite",
        (images, "c3"),
        Plant::Output(|mut y| {
            y.values[17] = f32::NAN;
            y
        }),
    ),
    fault(
        "MatMul: limited to ±1",
        "clipped",
        (tokens, "m3"),
        Plant::Output(|y| y.map(|y| y.clamp(-1.0, 1.0))),
    ),
    fault(
        "MatMul: one element",
        "few-elements",
        (tokens, "m3"),
        Plant::Output(|mut y| {
            y.values[100] += 0.25;
            y
        }),
    ),
    fault("Tanh: opposite sign", "sign", (volumes, "y"), Plant::Output(|y| y.map(|y| -y))),
];

fn first_slices(x: &Array, order: &[usize]) -> Array {
    slices(x, 0, order)
}

/// Memory as N H W C under the shape N C H W.
fn channels_last(y: &Array) -> Array {
    let moved = y.swap_axes(1, 2).swap_axes(2, 3);
    Array { shape: y.shape.clone(), values: moved.values }
}

fn last_channel_zero(y: &Array) -> Array {
    let (channels, place) = (y.shape[1], y.shape[2] * y.shape[3]);
    let value = |(i, &y): (usize, &f32)| if i / place % channels == channels - 1 { 0.0 } else { y };
    Array { shape: y.shape.clone(), values: y.values.iter().enumerate().map(value).collect() }
}

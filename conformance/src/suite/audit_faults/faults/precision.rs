//! Numbers that are a little off: factors, too few bits, constants with too few digits.

use super::changes::as_f16;
use super::{EIGHT_BITS, ELEVEN_BITS, Fault, Plant, fault, operand};
use crate::array::Array;
use crate::suite::audit_faults::scenes::{images, lists, tokens, volumes};

pub(super) const FAULTS: &[Fault] = &[
    // Factors.
    operand("Conv: weights × 1.0005", "scale", (images, "c1"), 1, |w| w.map(|w| w * 1.0005)),
    fault("MatMul: output × 1.000001", "scale", (tokens, "m1"), Plant::Output(|y| y.map(|y| y * 1.000_001))),
    fault(
        "GroupNormalization: output × 1.0005",
        "scale",
        (images, "n2"),
        Plant::Output(|y| y.map(|y| y * 1.0005)),
    ),
    operand("Conv: image in 0..255", "scale", (images, "c1"), 0, |x| x.map(|x| x * 255.0)),
    fault("Gemm: output and 0.001", "offset", (lists, "g2"), Plant::Output(|y| y.map(|y| y + 0.001))),
    // Precision.
    fault("Conv: f16 operands", ELEVEN_BITS, (images, "c2"), Plant::Numbers(as_f16)),
    fault("Gemm: tf32 operands", ELEVEN_BITS, (lists, "g2"), Plant::Numbers(as_tf32)),
    fault("MatMul: bf16 operands", EIGHT_BITS, (tokens, "m3"), Plant::Numbers(as_bf16)),
    fault("ConvTranspose: f16 result", ELEVEN_BITS, (volumes, "up"), Plant::Output(|y| y.map(as_f16))),
    operand("Conv: f16 weights", ELEVEN_BITS, (images, "c3"), 1, |w| w.map(as_f16)),
    fault("MatMul: f16 sums", ELEVEN_BITS, (tokens, "m1"), Plant::Made(|x| summed_in_f16(&x))),
    operand("Conv: int8 weights, one scale", "int8 weights, per tensor", (images, "c1"), 1, |w| {
        in_eight_bits(&w, 1)
    }),
    operand("Conv: int8 weights, one scale a channel", "int8 weights, per channel", (images, "c1"), 1, |w| {
        let channels = w.shape[0];
        in_eight_bits(&w, channels)
    }),
    // Constants.
    operand("Gemm: weights in 3 decimals", "truncated-constant", (lists, "g2"), 1, |w| {
        w.map(|w| ((f64::from(w) * 1e3).round_ties_even() / 1e3) as f32)
    }),
    operand("BatchNormalization: variances in 2 decimals", "truncated-constant", (images, "n1"), 4, |v| {
        v.map(|v| ((f64::from(v) * 1e2).round_ties_even() / 1e2) as f32)
    }),
];

fn as_bf16(x: f32) -> f32 {
    half::bf16::from_f32(x).to_f32()
}

/// The nearest number with ten bits of fraction, ties to even.
fn as_tf32(x: f32) -> f32 {
    let bits = x.to_bits();
    f32::from_bits((bits + 0xfff + (bits >> 13 & 1)) & !0x1fff)
}

/// A matrix product whose products and partial sums are kept in f16.
fn summed_in_f16(operands: &[Array]) -> Array {
    let [a, b] = operands else { panic!("{} operands, two were expected", operands.len()) };
    let (depth, columns) = (b.shape[0], b.shape[1]);
    let row = |row: &[f32]| -> Vec<f32> {
        let element = |j: usize| {
            let products = (0..depth).map(|k| as_f16(as_f16(row[k]) * as_f16(b.values[k * columns + j])));
            products.fold(0.0, |sum, product| as_f16(sum + product))
        };
        (0..columns).map(element).collect()
    };
    let mut shape = a.shape.clone();
    *shape.last_mut().expect("a matrix") = columns;
    Array { shape, values: a.values.chunks_exact(depth).flat_map(row).collect() }
}

/// Numbers rounded to −127..127 steps, with one step size for each of so many slices.
fn in_eight_bits(w: &Array, slices: usize) -> Array {
    let length = w.values.len() / slices;
    let slice = |values: &[f32]| -> Vec<f32> {
        let step = values.iter().fold(0.0_f32, |largest, v| largest.max(v.abs())) / 127.0;
        values.iter().map(|v| (v / step).round_ties_even() * step).collect()
    };
    Array { shape: w.shape.clone(), values: w.values.chunks_exact(length).flat_map(slice).collect() }
}

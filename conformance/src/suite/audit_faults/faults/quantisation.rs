//! Mistakes on the way to integers, and in operators on quantised numbers.

use super::changes::{flipped, renamed, slices};
use super::{Fault, Plant, attributes, fault, operand};
use crate::array::Array;
use crate::onnx::builder::ints;
use crate::suite::audit_faults::scenes::{bytes, levels};

pub(super) const FAULTS: &[Fault] = &[
    // Numbers to integers.
    fault(
        "Round: halves away from zero",
        "rounding-ties",
        (bytes, "whole"),
        Plant::Made(|x| x[0].map(f32::round)),
    ),
    fault("Round: down", "truncation", (bytes, "whole"), Plant::Node(|node| renamed(node, "Floor"))),
    operand("Cast: to the nearest", "rounding", (bytes, "integer"), 0, |x| x.map(f32::round_ties_even)),
    fault("Cast: output × 1.0005", "scale", (levels, "mf"), Plant::Output(|y| y.map(|y| y * 1.0005))),
    // QuantizeLinear.
    fault(
        "QuantizeLinear: cut towards zero",
        "truncation",
        (levels, "q"),
        Plant::Made(|x| quantised(&x, |q, z| limited(q.trunc() + z))),
    ),
    fault(
        "QuantizeLinear: rounded down",
        "truncation",
        (levels, "q"),
        Plant::Made(|x| quantised(&x, |q, z| limited(q.floor() + z))),
    ),
    fault(
        "QuantizeLinear: wrapped around",
        "saturation",
        (levels, "q"),
        Plant::Made(|x| quantised(&x, |q, z| q.round_ties_even() + z)),
    ),
    fault(
        "QuantizeLinear: limited to 7 bits",
        "saturation",
        (levels, "q"),
        Plant::Output(|y| y.map(|y| y.min(127.0))),
    ),
    fault("QuantizeLinear: a Relu", "activation", (levels, "q"), Plant::Output(|y| y.map(|y| y.max(121.0)))),
    operand("QuantizeLinear: zero point ignored", "zero-point", (levels, "q"), 2, |z| z.map(|_| 0.0)),
    operand("QuantizeLinear: zero point and 1", "zero-point", (levels, "q"), 2, |z| z.map(|z| z + 1.0)),
    fault(
        "QuantizeLinear: output and 1",
        "offset",
        (levels, "q"),
        Plant::Output(|y| y.map(|y| limited(y + 1.0))),
    ),
    operand("QuantizeLinear: scale × 1.02", "scale", (levels, "q"), 1, |s| s.map(|s| s * 1.02)),
    operand("QuantizeLinear: first scale for all", "scale", (levels, "k"), 1, |s| slices(&s, 0, &[0, 0, 0])),
    operand("QuantizeLinear: scales in the opposite order", "channel-order", (levels, "k"), 1, |s| {
        flipped(&s, 0)
    }),
    operand("QuantizeLinear: first zero point for all", "zero-point", (levels, "k"), 2, |z| {
        slices(&z, 0, &[0, 0, 0])
    }),
    // DequantizeLinear.
    operand("DequantizeLinear: zero point ignored", "zero-point", (levels, "d"), 2, |z| z.map(|_| 0.0)),
    operand("DequantizeLinear: zero point and 2", "zero-point", (levels, "d"), 2, |z| z.map(|z| z + 2.0)),
    operand("DequantizeLinear: scale × 1.01", "scale", (levels, "d"), 1, |s| s.map(|s| s * 1.01)),
    operand("DequantizeLinear: scale of the next channel", "channel-order", (levels, "f"), 1, |s| {
        slices(&s, 0, &[1, 2, 0])
    }),
    fault(
        "DequantizeLinear: bytes with a sign",
        "signedness",
        (levels, "d"),
        Plant::Made(|x| {
            let [q, s, z] = &x[..] else { panic!("{} operands, three were expected", x.len()) };
            q.map(|q| (with_sign(q) - z.values[0]) * s.values[0])
        }),
    ),
    // DynamicQuantizeLinear.
    fault(
        "DynamicQuantizeLinear: cut towards zero",
        "truncation",
        (levels, "l"),
        Plant::Made(|x| quantised_dynamically(&x, |q, z| limited(q.trunc() + z))),
    ),
    fault(
        "DynamicQuantizeLinear: zero point ignored",
        "zero-point",
        (levels, "l"),
        Plant::Made(|x| quantised_dynamically(&x, |q, _| limited(q.round_ties_even()))),
    ),
    // QLinearConv.
    operand("QLinearConv: zero point of x ignored", "zero-point", (levels, "c"), 2, |z| z.map(|_| 0.0)),
    operand("QLinearConv: zero point of x less 3", "zero-point", (levels, "c"), 2, |z| z.map(|z| z - 3.0)),
    operand("QLinearConv: zero point of w ignored", "zero-point", (levels, "c"), 5, |z| z.map(|_| 0.0)),
    operand("QLinearConv: zero point of y and 1", "zero-point", (levels, "c"), 7, |z| z.map(|z| z + 1.0)),
    fault(
        "QLinearConv: output and 1",
        "offset",
        (levels, "c"),
        Plant::Output(|y| y.map(|y| limited(y + 1.0))),
    ),
    operand("QLinearConv: scale of x × 1.02", "scale", (levels, "c"), 1, |s| s.map(|s| s * 1.02)),
    operand("QLinearConv: scale of y × 1.02", "scale", (levels, "c"), 6, |s| s.map(|s| s * 1.02)),
    operand("QLinearConv: first scale of w for all", "scale", (levels, "c"), 4, |s| slices(&s, 0, &[0; 6])),
    operand("QLinearConv: scales of w in the opposite order", "channel-order", (levels, "c"), 4, |s| {
        flipped(&s, 0)
    }),
    operand("QLinearConv: bias left out", "bias-missing", (levels, "c"), 8, |b| b.map(|_| 0.0)),
    operand("QLinearConv: bias twice", "bias-twice", (levels, "c"), 8, |b| b.map(|b| 2.0 * b)),
    operand("QLinearConv: bias in the opposite order", "bias-order", (levels, "c"), 8, |b| flipped(&b, 0)),
    operand("QLinearConv: kernel flipped", "kernel-flip", (levels, "c"), 3, |w| flipped(&flipped(&w, 2), 3)),
    attributes("QLinearConv: paddings before and after exchanged", "pads", (levels, "c"), || {
        vec![ints("pads", &[1, 2, 1, 0])]
    }),
    fault(
        "QLinearConv: cut towards zero",
        "truncation",
        (levels, "c"),
        Plant::Made(|x| convolved(&x, |x| x, |q, z| limited(q.trunc() + z))),
    ),
    fault(
        "QLinearConv: wrapped around",
        "saturation",
        (levels, "c"),
        Plant::Made(|x| convolved(&x, |x| x, |q, z| q.round_ties_even() + z)),
    ),
    fault(
        "QLinearConv: x with a sign",
        "signedness",
        (levels, "c"),
        Plant::Made(|x| convolved(&x, with_sign, |q, z| limited(q.round_ties_even() + z))),
    ),
    fault("QLinearConv: a Relu", "activation", (levels, "c"), Plant::Output(|y| y.map(|y| y.max(117.0)))),
    // QLinearMatMul.
    operand("QLinearMatMul: zero point of a ignored", "zero-point", (levels, "p"), 2, |z| z.map(|_| 0.0)),
    operand("QLinearMatMul: zero point of b ignored", "zero-point", (levels, "p"), 5, |z| z.map(|_| 0.0)),
    operand("QLinearMatMul: zero point of y ignored", "zero-point", (levels, "p"), 7, |z| z.map(|_| 0.0)),
    operand("QLinearMatMul: b transposed", "weights-transposed", (levels, "p"), 3, |b| b.swap_axes(0, 1)),
    operand("QLinearMatMul: scale of b × 0.5", "scale", (levels, "p"), 4, |s| s.map(|s| s * 0.5)),
    fault(
        "QLinearMatMul: cut after the zero point was added",
        "truncation",
        (levels, "p"),
        Plant::Made(|x| multiplied(&x, |q, z| limited((q + z).trunc()))),
    ),
    fault(
        "QLinearMatMul: wrapped around",
        "saturation",
        (levels, "p"),
        Plant::Made(|x| multiplied(&x, |q, z| q.round_ties_even() + z)),
    ),
    // Sums of products of integers.
    operand("ConvInteger: zero point of x ignored", "zero-point", (levels, "ci"), 2, |z| z.map(|_| 0.0)),
    operand("ConvInteger: zero point of w ignored", "zero-point", (levels, "ci"), 3, |z| z.map(|_| 0.0)),
    operand("ConvInteger: zero point of x and 1", "zero-point", (levels, "ci"), 2, |z| z.map(|z| z + 1.0)),
    operand("ConvInteger: kernel flipped", "kernel-flip", (levels, "ci"), 1, |w| flipped(&flipped(&w, 2), 3)),
    attributes("ConvInteger: strides ignored", "strides", (levels, "ci"), || vec![ints("strides", &[1, 1])]),
    operand("MatMulInteger: zero point of a ignored", "zero-point", (levels, "mi"), 2, |z| z.map(|_| 0.0)),
    operand("MatMulInteger: zero points of b ignored", "zero-point", (levels, "mi"), 3, |z| z.map(|_| 0.0)),
    operand("MatMulInteger: first zero point of b for all", "zero-point", (levels, "mi"), 3, |z| {
        slices(&z, 0, &[0; 7])
    }),
];

fn limited(level: f32) -> f32 {
    level.clamp(0.0, 255.0)
}

fn with_sign(byte: f32) -> f32 {
    if byte > 127.0 { byte - 256.0 } else { byte }
}

/// Numbers over a scale, with the last step of an engine of its own.
fn quantised(operands: &[Array], step: fn(f32, f32) -> f32) -> Array {
    let [x, s, rest @ ..] = operands else { panic!("{} operands, two were expected", operands.len()) };
    let z = rest.first().map_or(0.0, |z| z.values[0]);
    x.map(|x| step(x / s.values[0], z))
}

/// The same with the scale and the zero point of the numbers' own range.
fn quantised_dynamically(operands: &[Array], step: fn(f32, f32) -> f32) -> Array {
    let [x] = operands else { panic!("{} operands, one was expected", operands.len()) };
    let (low, high) = x.values.iter().fold((0.0_f32, 0.0_f32), |(low, high), &x| (low.min(x), high.max(x)));
    let s = (high - low) / 255.0;
    let z = (-low / s).round_ties_even();
    x.map(|x| step(x / s, z))
}

/// The parameters of a product of quantised numbers, in the order of its operands.
fn product(operands: &[Array]) -> [&Array; 8] {
    operands.first_chunk().expect("eight operands").each_ref()
}

/// A product of matrices with the last step of an engine of its own.
fn multiplied(operands: &[Array], step: fn(f32, f32) -> f32) -> Array {
    let [a, sa, za, b, sb, zb, sy, zy] = product(operands);
    let scale = sa.values[0] * sb.values[0] / sy.values[0];
    let columns = b.shape[1];
    let row = |row: &[f32]| -> Vec<f32> {
        let sum = |j: usize| -> f32 {
            let products = row.iter().enumerate();
            products.map(|(k, a)| (a - za.values[0]) * (b.values[k * columns + j] - zb.values[0])).sum()
        };
        (0..columns).map(|j| step(sum(j) * scale, zy.values[0])).collect()
    };
    let mut shape = a.shape.clone();
    *shape.last_mut().expect("a matrix") = columns;
    Array { shape, values: a.values.chunks_exact(b.shape[0]).flat_map(row).collect() }
}

/// The convolution of the scene, with paddings 1, 0, 1, 2, by an engine that reads bytes and steps in its own way.
fn convolved(operands: &[Array], read: fn(f32) -> f32, step: fn(f32, f32) -> f32) -> Array {
    let [x, sx, zx, w, sw, zw, sy, zy] = product(operands);
    let (&[samples, channels, height, width], &[outputs, _, rows, columns]) = (&x.shape[..], &w.shape[..])
    else {
        panic!("images and kernels of two spatial axes were expected")
    };
    let out = [samples, outputs, height + 2 + 1 - rows, width + 2 + 1 - columns];
    let element = |place: usize| {
        let (j, i) = (place % out[3], place / out[3] % out[2]);
        let (o, n) = (place / (out[3] * out[2]) % outputs, place / (out[3] * out[2] * outputs));
        let mut sum = operands[8].values[o];
        for tap in 0..channels * rows * columns {
            let (c, r, k) = (tap / (rows * columns), tap / columns % rows, tap % columns);
            // One row lies above the image.
            if let Some(h) = (i + r).checked_sub(1).filter(|&h| h < height)
                && j + k < width
            {
                let x = read(x.values[((n * channels + c) * height + h) * width + j + k]) - zx.values[0];
                sum += x * (w.values[o * channels * rows * columns + tap] - zw.values[0]);
            }
        }
        step(sum * (sx.values[0] * sw.values[o] / sy.values[0]), zy.values[0])
    };
    Array { shape: out.to_vec(), values: (0..out.iter().product()).map(element).collect() }
}

//! Mistakes in nodes of which a part is tried.

use super::changes::{as_f16, flipped};
use super::{ELEVEN_BITS, Fault, attributes, operand};
use crate::onnx::builder::ints;
use crate::suite::audit_faults::scenes::wide;

pub(super) const FAULTS: &[Fault] = &[
    operand("wide Conv: kernel flipped", "kernel-flip", (wide, "c"), 1, |w| flipped(&flipped(&w, 2), 3)),
    attributes("wide Conv: paddings before and after exchanged", "pads", (wide, "c"), || {
        vec![ints("pads", &[1, 2, 1, 0])]
    }),
    operand("wide Conv: f16 weights", ELEVEN_BITS, (wide, "c"), 1, |w| w.map(as_f16)),
    operand("wide Conv: weights × 1.000001", "scale", (wide, "c"), 1, |w| w.map(|w| w * 1.000_001)),
    operand("wide ConvTranspose: kernel flipped", "kernel-flip", (wide, "up"), 1, |w| {
        flipped(&flipped(&w, 2), 3)
    }),
    operand("wide MatMul: weights transposed", "weights-transposed", (wide, "m"), 1, |w| w.swap_axes(0, 1)),
];

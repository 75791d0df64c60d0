//! Mistakes in windows: paddings, kernels, groups.

use super::changes::{flipped, slices};
use super::{Fault, Plant, attributes, fault, operand};
use crate::array::Array;
use crate::onnx::builder::{int, ints, text};
use crate::suite::audit_faults::scenes::{images, maps, volumes};

pub(super) const FAULTS: &[Fault] = &[
    // Paddings.
    attributes("Conv: paddings before and after exchanged", "pads", (images, "c3"), || {
        vec![ints("pads", &[2, 1, 0, 1])]
    }),
    attributes("Conv: SAME_LOWER for SAME_UPPER", "auto_pad", (maps, "f"), || {
        vec![text("auto_pad", "NOTSET"), ints("pads", &[1, 1, 0, 0])]
    }),
    fault(
        "Conv: border repeated for zeros",
        "padding_mode",
        (images, "c1"),
        Plant::Both(0, |x| repeated_border(&x), || vec![ints("pads", &[0, 0, 0, 0])]),
    ),
    attributes("AveragePool: padding counted", "count_include_pad", (images, "p"), || {
        vec![int("count_include_pad", 1)]
    }),
    attributes("MaxPool: ceil_mode", "ceil_mode", (maps, "coarse"), || vec![int("ceil_mode", 1)]),
    attributes("Pad: edge for reflect", "padding_mode", (maps, "padded"), || vec![text("mode", "edge")]),
    attributes("Pad: constant for reflect", "padding_mode", (maps, "padded"), || {
        vec![text("mode", "constant")]
    }),
    // Kernels.
    attributes("Conv: dilation ignored", "dilations", (images, "c2"), || {
        vec![ints("dilations", &[1, 1]), ints("pads", &[1, 1, 1, 1])]
    }),
    operand("Conv: kernel flipped", "kernel-flip", (images, "c1"), 1, |w| flipped(&flipped(&w, 2), 3)),
    operand("ConvTranspose: kernel flipped", "kernel-flip", (volumes, "up"), 1, |w| {
        flipped(&flipped(&flipped(&w, 2), 3), 4)
    }),
    operand("Conv: kernel's axes exchanged", "axis-order", (images, "c1"), 1, |w| w.swap_axes(2, 3)),
    operand("Conv 3-D: input and output channels exchanged", "weights-transposed", (volumes, "c"), 1, |w| {
        w.swap_axes(0, 1)
    }),
    operand("Conv: channels dealt out to groups in turn", "group", (images, "c2"), 0, |x| dealt(&x, 2)),
    operand("Conv: BGR for RGB", "channel-order", (images, "c1"), 0, |x| flipped(&x, 1)),
    attributes("ConvTranspose: output_padding before", "output_padding", (volumes, "up"), || {
        vec![ints("pads", &[0, 0, 0, 1, 1, 1]), ints("output_padding", &[0, 0, 0])]
    }),
];

/// Channels 0, 2, 4, …, 1, 3, 5, … for two groups.
fn dealt(x: &Array, groups: usize) -> Array {
    let channels = x.shape[1];
    slices(
        x,
        1,
        &(0..channels)
            .map(|c| c % (channels / groups) * groups + c / (channels / groups))
            .collect::<Vec<_>>(),
    )
}

/// A border of one element around the last two axes, repeating the nearest.
fn repeated_border(x: &Array) -> Array {
    let around = |side: usize| {
        let mut places: Vec<usize> = (0..side).collect();
        places.insert(0, 0);
        places.push(side - 1);
        places
    };
    let rows = slices(x, 2, &around(x.shape[2]));
    slices(&rows, 3, &around(x.shape[3]))
}

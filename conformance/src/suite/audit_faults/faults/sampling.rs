//! Mistakes in what is read between pixels: grids and resizing.

use super::{Fault, attributes, operand};
use crate::array::Array;
use crate::onnx::builder::{float, int, text};
use crate::suite::audit_faults::scenes::{images, maps, volumes};

pub(super) const FAULTS: &[Fault] = &[
    attributes("GridSample: align_corners 0 for 1", "align_corners", (maps, "sampled"), || {
        vec![int("align_corners", 0)]
    }),
    attributes("GridSample 3-D: align_corners 1 for 0", "align_corners", (volumes, "at"), || {
        vec![int("align_corners", 1)]
    }),
    attributes("GridSample: border for zeros", "padding_mode", (maps, "sampled"), || {
        vec![text("padding_mode", "border")]
    }),
    attributes("GridSample: reflection for zeros", "padding_mode", (maps, "sampled"), || {
        vec![text("padding_mode", "reflection")]
    }),
    attributes("GridSample: nearest for linear", "mode", (maps, "sampled"), || vec![text("mode", "nearest")]),
    operand("GridSample: y, x for x, y", "axis-order", (maps, "sampled"), 1, |grid| {
        reversed_points(&grid, 2)
    }),
    operand("GridSample 3-D: z, y, x for x, y, z", "axis-order", (volumes, "at"), 1, |grid| {
        reversed_points(&grid, 3)
    }),
    attributes("Resize: asymmetric for half_pixel", "coordinate_transformation_mode", (images, "r"), || {
        vec![text("coordinate_transformation_mode", "asymmetric")]
    }),
    attributes("Resize: align_corners for half_pixel", "align_corners", (images, "r"), || {
        vec![text("coordinate_transformation_mode", "align_corners")]
    }),
    attributes("Resize: cubic a −0.5 for −0.75", "cubic_coeff_a", (maps, "cubic"), || {
        vec![float("cubic_coeff_a", -0.5)]
    }),
    attributes("Resize: cubic a −0.65 for −0.75", "cubic_coeff_a", (maps, "cubic"), || {
        vec![float("cubic_coeff_a", -0.65)]
    }),
    attributes("Resize: outside excluded", "exclude_outside", (maps, "cubic"), || {
        vec![int("exclude_outside", 1)]
    }),
    attributes("Resize: antialias", "antialias", (maps, "smaller"), || vec![int("antialias", 1)]),
    attributes("Resize: ceil for floor", "nearest_mode", (maps, "nearest"), || {
        vec![text("nearest_mode", "ceil")]
    }),
    attributes(
        "Resize: half_pixel for asymmetric, nearest",
        "coordinate_transformation_mode",
        (maps, "nearest"),
        || vec![text("coordinate_transformation_mode", "half_pixel")],
    ),
    attributes("Resize: linear for cubic", "mode", (maps, "cubic"), || vec![text("mode", "linear")]),
];

/// Every point of a grid with its coordinates in the opposite order.
fn reversed_points(grid: &Array, coordinates: usize) -> Array {
    let points = grid.values.chunks_exact(coordinates);
    Array {
        shape: grid.shape.clone(),
        values: points.flat_map(|point| point.iter().rev().copied()).collect(),
    }
}

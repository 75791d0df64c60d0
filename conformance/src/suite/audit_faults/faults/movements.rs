//! Mistakes in reductions and in what moves elements.

use super::changes::{renamed, slices};
use super::{Fault, Plant, attributes, fault};
use crate::array::Array;
use crate::onnx::builder::ints;
use crate::suite::audit_faults::scenes::{lists, maps};

pub(super) const FAULTS: &[Fault] = &[
    fault("ReduceMean: a sum", "operator", (lists, "mean"), Plant::Node(|node| renamed(node, "ReduceSum"))),
    fault(
        "Concat: the other way round",
        "concat-order",
        (lists, "both"),
        Plant::Node(|mut node| {
            node.input.reverse();
            node
        }),
    ),
    attributes("Transpose: the inverse", "perm", (maps, "turned"), || vec![ints("perm", &[0, 3, 1, 2])]),
    fault("Slice: one too late", "slice-off-by-one", (lists, "cut"), Plant::Made(|x| columns(&x[0], 4..20))),
    fault(
        "Gather: one too far",
        "index-off-by-one",
        (lists, "taken"),
        Plant::Made(|x| taken(&x[0], &[1, 8, 4, 0, 13])),
    ),
    fault(
        "Gather: −1 taken as 0",
        "negative-indices",
        (lists, "taken"),
        Plant::Made(|x| taken(&x[0], &[0, 7, 3, 0, 12])),
    ),
    fault(
        "Sub: operands exchanged",
        "operands-swapped",
        (lists, "centred"),
        Plant::Node(|mut node| {
            node.input.swap(0, 1);
            node
        }),
    ),
];

fn columns(x: &Array, columns: std::ops::Range<usize>) -> Array {
    slices(x, 1, &columns.collect::<Vec<_>>())
}

fn taken(x: &Array, places: &[usize]) -> Array {
    slices(x, 1, places)
}

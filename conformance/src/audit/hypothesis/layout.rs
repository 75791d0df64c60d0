//! The right numbers in the wrong places: orders of axes, channels and batches, and layouts in memory.

use super::Suspicion;
use super::change::{
    Arrangement, Meaning, chosen, flipped, misread, misread_back, operand_arranged, output_arranged,
    permuted, specified,
};
use super::trial::Trial;

/// Slices along an axis that are compared with each other; more would take long.
const SLICES: usize = 64;

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    if let Some(shape) = trial.output_shape() {
        all.extend(of_memory(shape, "the output", output_arranged));
        all.extend(of_axes(shape));
    }
    for place in [0, trial.weights()] {
        if let Some(Some(operand)) = trial.case.operands.get(place) {
            let what = format!("operand {place}");
            let arranged = move |arrangement| operand_arranged(place, arrangement);
            all.extend(of_memory(&operand.shape, &what, arranged));
            all.extend(of_operand(&operand.shape, place));
        }
    }
    all.extend(of_slices(trial));
    all
}

/// Channels last for channels first, and back.
fn of_memory(shape: &[usize], what: &str, arranged: impl Fn(Arrangement) -> Meaning) -> Vec<Suspicion> {
    let rank = shape.len();
    if rank < 3 || shape[1] == 1 {
        return Vec::new();
    }
    let mut last: Vec<usize> = (0..rank).collect();
    last[1..].rotate_left(1);
    vec![
        Suspicion::new(
            "layout",
            format!(
                "{what} lay in memory with its channels last (NHWC), and was read with its channels first"
            ),
            arranged(misread(last.clone())),
        ),
        Suspicion::new(
            "layout",
            format!(
                "{what} lay in memory with its channels first (NCHW), and was read with its channels last"
            ),
            arranged(misread_back(last)),
        ),
    ]
}

/// Axes of one length exchanged, and axes that run backwards.
fn of_axes(shape: &[usize]) -> Vec<Suspicion> {
    let rank = shape.len();
    let mut all = exchanged(shape, "the output", output_arranged);
    if rank == 5 && shape[2] == shape[3] && shape[3] == shape[4] {
        for order in [vec![0, 1, 3, 4, 2], vec![0, 1, 4, 2, 3]] {
            all.push(Suspicion::new(
                "axis-order",
                "the three spatial axes of the output were turned",
                output_arranged(permuted(order)),
            ));
        }
    }
    for axis in (0..rank).filter(|&axis| shape[axis] > 1) {
        let name = if axis == 1 && rank > 2 { "channel-order" } else { "flipped" };
        all.push(Suspicion::new(
            name,
            format!("axis {axis} of the output ran backwards"),
            output_arranged(flipped(vec![axis])),
        ));
    }
    all
}

/// Channels in the opposite order, and spatial axes exchanged, before the node computed.
fn of_operand(shape: &[usize], place: usize) -> Vec<Suspicion> {
    let rank = shape.len();
    let mut all = Vec::new();
    if rank > 2 && shape[1] > 1 {
        all.push(Suspicion::new(
            "channel-order",
            format!("the channels of operand {place} were in the opposite order, as RGB for BGR"),
            operand_arranged(place, chosen(1, (0..shape[1]).rev().collect())),
        ));
    }
    if rank > 2 && shape[rank - 1] > 1 && shape[rank - 1] <= 4 {
        all.push(Suspicion::new(
            "axis-order",
            format!("the last axis of operand {place} was in the opposite order, as z, y, x for x, y, z"),
            operand_arranged(place, chosen(rank - 1, (0..shape[rank - 1]).rev().collect())),
        ));
    }
    all.extend(exchanged(shape, &format!("operand {place}"), |order| operand_arranged(place, order)));
    all
}

/// Two axes of one length in each other's place.
fn exchanged(shape: &[usize], what: &str, arranged: impl Fn(Arrangement) -> Meaning) -> Vec<Suspicion> {
    let pairs = (0..shape.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    pairs
        .filter(|&(a, b)| shape[a] == shape[b] && shape[a] > 1)
        .map(|(a, b)| {
            let mut order: Vec<usize> = (0..shape.len()).collect();
            order.swap(a, b);
            let detail = format!("axes {a} and {b} of {what} were exchanged");
            Suspicion::new("axis-order", detail, arranged(permuted(order)))
        })
        .collect()
}

/// Slices of an axis in an order that the numbers themselves tell: each found slice is the expected one nearest to it.
fn of_slices(trial: &Trial) -> Vec<Suspicion> {
    let (Some(shape), Some(expected), Some(found)) =
        (trial.excerpt_shape(), trial.values(&specified()), trial.found())
    else {
        return Vec::new();
    };
    if expected.len() != found.len() || expected.len() != shape.iter().product::<usize>() {
        return Vec::new();
    }
    let mut all = Vec::new();
    for axis in 0..shape.len().min(3) {
        let side = shape[axis];
        if !(2..=SLICES).contains(&side) {
            continue;
        }
        let inner: usize = shape[axis + 1..].iter().product();
        let outer: usize = shape[..axis].iter().product();
        if inner * outer < 2 {
            continue;
        }
        let distance = |a: usize, b: usize| -> f64 {
            let lines = (0..outer).flat_map(|o| (0..inner).map(move |i| (o * side * inner + i, inner)));
            lines.map(|(at, inner)| (found[at + a * inner] - expected[at + b * inner].value).powi(2)).sum()
        };
        let nearest =
            |a: usize| (0..side).min_by(|&b, &c| distance(a, b).total_cmp(&distance(a, c))).unwrap_or(a);
        let order: Vec<usize> = (0..side).map(nearest).collect();
        if order.iter().enumerate().all(|(i, &from)| i == from) {
            continue;
        }
        let name = match axis {
            0 => "batch-order",
            1 => "channel-order",
            _ => "axis-order",
        };
        let shifted = order.iter().enumerate().filter(|(i, from)| *i != **from).count();
        all.push(Suspicion::new(
            name,
            format!("{shifted} of {side} slices along axis {axis} of the output are those of others: slice i is slice {order:?}[i]"),
            output_arranged(chosen(axis, order)),
        ));
    }
    all
}

//! Windows with weights: strides, dilations, groups, and the kernel's own axes.

use super::Suspicion;
use super::change::{attributes, chosen, flipped, int, ints, operand_arranged, output_arranged, permuted};
use super::padding::list;
use super::trial::Trial;
use crate::onnx::builder;

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    match trial.operator() {
        "Conv" | "ConvInteger" | "ConvTranspose" | "QLinearConv" => {
            let place = trial.weights();
            [steps(trial), weights(trial, place), groups(trial, place)].into_iter().flatten().collect()
        }
        "AveragePool" | "MaxPool" | "LpPool" => steps(trial),
        _ => Vec::new(),
    }
}

/// No dilation, and paddings such that the sides stay: so an engine ignores it without a shape that differs.
fn no_dilation(trial: &Trial) -> Option<Suspicion> {
    let node = trial.node();
    let (dilations, pads) = (ints(node, "dilations"), ints(node, "pads"));
    let kernel: Vec<i64> = match trial.operator() {
        "Conv" | "ConvTranspose" | "ConvInteger" | "QLinearConv" => {
            trial.shape(trial.weights())?.get(2..)?.iter().map(|&k| k as i64).collect()
        }
        _ => ints(node, "kernel_shape"),
    };
    let axes = dilations.len();
    if dilations.iter().all(|&d| d == 1) || pads.len() != 2 * axes || kernel.len() != axes {
        return None;
    }
    let less = |(i, pad): (usize, &i64)| {
        let lost = (dilations[i % axes] - 1) * (kernel[i % axes] - 1);
        pad - if i < axes { lost / 2 } else { lost - lost / 2 }
    };
    let pads: Vec<i64> = pads.iter().enumerate().map(less).collect();
    pads.iter().all(|&side| side >= 0).then(|| {
        Suspicion::new(
            "dilations",
            format!(
                "dilations are {dilations:?} in the graph; none, and paddings {pads:?}, explain the numbers"
            ),
            attributes(vec![list("dilations", &vec![1; axes]), list("pads", &pads)]),
        )
    })
}

/// Strides and dilations that are ignored or belong to other axes.
fn steps(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    all.extend(no_dilation(trial));
    for name in ["dilations", "strides"] {
        let is = ints(trial.node(), name);
        let reversed: Vec<i64> = is.iter().rev().copied().collect();
        for other in [vec![1; is.len()], reversed] {
            if other != is {
                all.push(Suspicion::new(
                    name,
                    format!("{name} is {is:?} in the graph; {other:?} explains the numbers"),
                    attributes(vec![list(name, &other)]),
                ));
            }
        }
    }
    all
}

fn weights(trial: &Trial, place: usize) -> Vec<Suspicion> {
    let Some(shape) = trial.shape(place).filter(|shape| shape.len() > 2) else { return Vec::new() };
    let rank = shape.len();
    let space: Vec<usize> = (2..rank).collect();
    let mut all = vec![Suspicion::new(
        "kernel-flip",
        "the kernel was flipped along every axis: a convolution for a correlation, or the other way round",
        operand_arranged(place, flipped(space.clone())),
    )];
    for &axis in &space {
        all.push(Suspicion::new(
            "kernel-flip",
            format!("the kernel was flipped along spatial axis {}", axis - 2),
            operand_arranged(place, flipped(vec![axis])),
        ));
    }
    for (i, &a) in space.iter().enumerate() {
        for &b in &space[i + 1..] {
            if shape[a] == shape[b] && shape[a] > 1 {
                let mut order: Vec<usize> = (0..rank).collect();
                order.swap(a, b);
                all.push(Suspicion::new(
                    "axis-order",
                    format!("the kernel's spatial axes {} and {} were exchanged", a - 2, b - 2),
                    operand_arranged(place, permuted(order)),
                ));
            }
        }
    }
    if shape[0] == shape[1] && shape[0] > 1 {
        let mut order: Vec<usize> = (0..rank).collect();
        order.swap(0, 1);
        all.push(Suspicion::new(
            "weights-transposed",
            "the kernel's axes of input and output channels were exchanged",
            operand_arranged(place, permuted(order.clone())),
        ));
        let both = permuted(order);
        let flip = flipped(space);
        all.push(Suspicion::new(
            "weights-transposed",
            "the kernel's channels were exchanged and it was flipped: the adjoint operator",
            operand_arranged(place, Box::new(move |x| flip(&both(x)?))),
        ));
    }
    for (axis, what) in [(1, "the kernel's second axis"), (0, "the kernel's first axis")] {
        if shape[axis] > 1 {
            all.push(Suspicion::new(
                "channel-order",
                format!("the channels along {what} were in the opposite order, as RGB for BGR"),
                operand_arranged(place, chosen(axis, (0..shape[axis]).rev().collect())),
            ));
        }
    }
    all
}

/// Channels dealt out to the groups in turn, not in blocks.
fn groups(trial: &Trial, place: usize) -> Vec<Suspicion> {
    let groups = usize::try_from(int(trial.node(), "group", 1)).unwrap_or(1);
    let (Some(x), Some(w)) = (trial.shape(0), trial.shape(place)) else { return Vec::new() };
    if groups < 2 || x.len() < 3 || x[1] % groups != 0 || w[0] % groups != 0 {
        return Vec::new();
    }
    let dealt =
        |count: usize| (0..count).map(|i| i % (count / groups) * groups + i / (count / groups)).collect();
    let gathered = |count: usize| (0..count).map(|i| i % groups * (count / groups) + i / groups).collect();
    let mut all: Vec<Suspicion> = Vec::new();
    for (what, place, axis) in [("input channels", 0, 1), ("kernels", place, 0)] {
        let count = if place == 0 { x[1] } else { w[0] };
        for order in [dealt(count), gathered(count)] {
            all.push(Suspicion::new(
                "group",
                format!("the {what} were dealt out to the {groups} groups in turn, not in blocks"),
                operand_arranged(place, chosen(axis, order)),
            ));
        }
    }
    if let Some(y) = trial.output_shape() {
        for order in [dealt(y[1]), gathered(y[1])] {
            all.push(Suspicion::new(
                "group",
                format!("the output channels were dealt out to the {groups} groups in turn, not in blocks"),
                output_arranged(chosen(1, order)),
            ));
        }
    }
    if x[1] == w[1] * groups {
        let reversed: Vec<usize> = (0..x[1]).map(|c| (groups - 1 - c / w[1]) * w[1] + c % w[1]).collect();
        all.push(Suspicion::new(
            "group",
            "the groups were taken in the opposite order",
            operand_arranged(0, chosen(1, reversed)),
        ));
    }
    all
}

/// The additional rows before the output, not after it.
pub(super) fn output_padding(trial: &Trial) -> Vec<Suspicion> {
    let node = trial.node();
    let more = ints(node, "output_padding");
    let Some(axes) = trial.shape(0).and_then(|shape| shape.len().checked_sub(2)) else { return Vec::new() };
    if more.iter().all(|&side| side == 0) {
        return Vec::new();
    }
    let given = ints(node, "pads");
    let pads = if given.len() == 2 * axes { given } else { vec![0; 2 * axes] };
    let moved: Vec<i64> = (0..2 * axes).map(|i| if i < axes { pads[i] - more[i] } else { pads[i] }).collect();
    if moved.iter().any(|&side| side < 0) {
        return Vec::new();
    }
    vec![Suspicion::new(
        "output_padding",
        format!("output_padding {more:?} was added before the output, not after it"),
        attributes(vec![builder::ints("output_padding", &vec![0; axes]), list("pads", &moved)]),
    )]
}

//! Sampling between elements: Resize, Upsample and GridSample.
//!
//! Exporters and runtimes disagree here most of all: where an element's centre lies, which neighbour is the nearest, which
//! cubic is meant. `align_corners` is PyTorch's word for a choice that ONNX's Resize makes among several coordinate
//! transformations; a mistake between it and half pixels goes by that name.

use super::Suspicion;
use super::change::{attributes, chosen, float, int, numbers, operand_arranged, text};
use super::fit::Parameter;
use super::trial::Trial;
use crate::onnx::builder;

const TRANSFORMATIONS: [&str; 6] = [
    "half_pixel",
    "align_corners",
    "asymmetric",
    "pytorch_half_pixel",
    "tf_half_pixel_for_nn",
    "half_pixel_symmetric",
];

const NEAREST: [&str; 4] = ["round_prefer_floor", "round_prefer_ceil", "floor", "ceil"];

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    match trial.operator() {
        "GridSample" => grid_sample(trial),
        "Resize" | "Upsample" => resize(trial),
        "AffineGrid" => vec![flag(trial, "align_corners", 0)],
        _ => Vec::new(),
    }
}

/// A flag that is 1 for 0 or 0 for 1.
fn flag(trial: &Trial, name: &str, default: i64) -> Suspicion {
    let is = int(trial.node(), name, default);
    Suspicion::new(
        name,
        format!("{name} is {is} in the graph; {} explains the numbers", 1 - is),
        attributes(vec![builder::int(name, 1 - is)]),
    )
}

/// A text that is another.
fn other(trial: &Trial, called: &str, name: &str, default: &str, alternative: &str) -> Option<Suspicion> {
    let is = text(trial.node(), name, default);
    (is != alternative).then(|| {
        Suspicion::new(
            called,
            format!("{name} is {is} in the graph; {alternative} explains the numbers"),
            attributes(vec![builder::text(name, alternative)]),
        )
    })
}

fn grid_sample(trial: &Trial) -> Vec<Suspicion> {
    let mut all = vec![flag(trial, "align_corners", 0)];
    for padding in ["zeros", "border", "reflection"] {
        all.extend(other(trial, "padding_mode", "padding_mode", "zeros", padding));
    }
    let names = if trial.case.opset < 20 {
        ["bilinear", "nearest", "bicubic"]
    } else {
        ["linear", "nearest", "cubic"]
    };
    for mode in names {
        all.extend(other(trial, "mode", "mode", names[0], mode));
    }
    // The grid's last axis holds x, y (, z), from the last axis of the map to the first.
    if let Some(space) = trial.shape(1).and_then(|shape| shape.last().copied()) {
        let order = if space == 2 { "y, x for x, y" } else { "z, y, x for x, y, z" };
        let reversed: Vec<usize> = (0..space).rev().collect();
        let rank = trial.shape(1).map_or(0, <[usize]>::len);
        all.push(Suspicion::new(
            "axis-order",
            format!("the grid's coordinates were read as {order}"),
            operand_arranged(1, chosen(rank - 1, reversed)),
        ));
    }
    all.push(Suspicion::new(
        "grid-range",
        "the grid's coordinates were read as 0..1 for −1..1",
        numbers(1, |x| 2.0 * x - 1.0),
    ));
    all
}

fn resize(trial: &Trial) -> Vec<Suspicion> {
    let node = trial.node();
    let mut all = Vec::new();
    let name = "coordinate_transformation_mode";
    let is = text(node, name, "half_pixel");
    let nearest = text(node, "nearest_mode", "round_prefer_floor");
    for transformation in TRANSFORMATIONS {
        let corners = is == "align_corners" || transformation == "align_corners";
        all.extend(other(
            trial,
            if corners { "align_corners" } else { name },
            name,
            "half_pixel",
            transformation,
        ));
    }
    for mode in NEAREST {
        all.extend(other(trial, "nearest_mode", "nearest_mode", "round_prefer_floor", mode));
    }
    if text(node, "mode", "nearest") == "nearest" {
        for transformation in TRANSFORMATIONS.into_iter().filter(|&other| other != is) {
            for mode in NEAREST.into_iter().filter(|&other| other != nearest) {
                all.push(Suspicion::new(
                    name,
                    format!("{name} is {is} and nearest_mode {nearest}; {transformation} and {mode} explain the numbers"),
                    attributes(vec![builder::text(name, transformation), builder::text("nearest_mode", mode)]),
                ));
            }
        }
    }
    for mode in ["nearest", "linear", "cubic"] {
        all.extend(other(trial, "mode", "mode", "nearest", mode));
    }
    if text(node, "mode", "nearest") == "cubic" {
        let is = float(node, "cubic_coeff_a", -0.75);
        for a in [-0.5, -0.75, -1.0, -0.6] {
            if a != is {
                all.push(Suspicion::new(
                    "cubic_coeff_a",
                    format!("cubic_coeff_a is {is} in the graph; {a} explains the numbers"),
                    attributes(vec![builder::float("cubic_coeff_a", a)]),
                ));
            }
        }
    }
    all.push(flag(trial, "antialias", 0));
    all.push(flag(trial, "exclude_outside", 0));
    all
}

pub(super) fn parameters(trial: &Trial) -> Vec<Parameter> {
    if trial.operator() != "Resize" || text(trial.node(), "mode", "nearest") != "cubic" {
        return Vec::new();
    }
    let is = float(trial.node(), "cubic_coeff_a", -0.75);
    vec![Parameter::new(
        "cubic_coeff_a",
        f64::from(is),
        move |a| format!("cubic_coeff_a is {is} in the graph; {a} explains the numbers"),
        |a| attributes(vec![builder::float("cubic_coeff_a", a as f32)]),
    )]
}

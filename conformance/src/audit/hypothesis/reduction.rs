//! Reductions: another one, other axes, axes that are kept or not.

use super::Suspicion;
use super::change::{Meaning, attribute, attributes, exact, int, integers, output_numbers};
use super::padding::list;
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::message::NodeProto;
use crate::onnx::walk;
use vitruvian_reference::nn::Tensor;

const REDUCTIONS: [&str; 10] = [
    "ReduceMean",
    "ReduceSum",
    "ReduceMax",
    "ReduceMin",
    "ReduceL2",
    "ReduceL1",
    "ReduceSumSquare",
    "ReduceProd",
    "ReduceLogSum",
    "ReduceLogSumExp",
];

const POOLS: [&str; 3] = ["AveragePool", "MaxPool", "LpPool"];
const GLOBAL_POOLS: [&str; 3] = ["GlobalAveragePool", "GlobalMaxPool", "GlobalLpPool"];
const PAIRS: [&str; 8] = ["Add", "Sub", "Mul", "Div", "Max", "Min", "Pow", "Mod"];

/// The same node with another operator; the attributes that the other does not know are left out.
fn taken_for(other: &'static str, known: &'static [&'static str]) -> Meaning {
    Box::new(move |node, opset, operands| {
        let mut other = NodeProto { op_type: Some(other.into()), ..node.clone() };
        other.attribute.retain(|a| a.name.as_deref().is_some_and(|name| known.contains(&name)));
        walk::evaluate(&other, opset, operands)
    })
}

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let name = trial.operator();
    let mut all = Vec::new();
    if REDUCTIONS.contains(&name) {
        all.extend(axes(trial));
    }
    // A variance, taken apart by the exporter, is a mean of squares.
    if let (true, Some(x), Some(y)) = (name == "ReduceMean", trial.shape(0), trial.output_shape()) {
        let n = x.iter().product::<usize>() as f64 / y.iter().product::<usize>().max(1) as f64;
        if n > 1.0 {
            all.push(Suspicion::new(
                "variance",
                format!("the sum was divided by N − 1 = {}, not by N = {n}", n - 1.0),
                output_numbers(move |y| y * exact(n / (n - 1.0))),
            ));
        }
    }
    let families: [(&[&'static str], &'static [&'static str]); 4] = [
        (&REDUCTIONS, &["axes", "keepdims", "noop_with_empty_axes"]),
        (&POOLS, &["auto_pad", "ceil_mode", "dilations", "kernel_shape", "pads", "strides"]),
        (&GLOBAL_POOLS, &[]),
        (&PAIRS, &[]),
    ];
    for (family, known) in families {
        if family.contains(&name) {
            for &other in family.iter().filter(|&&other| other != name) {
                all.push(Suspicion::new(
                    "operator",
                    format!("{name} in the graph; {other} explains the numbers"),
                    taken_for(other, known),
                ));
            }
        }
    }
    if matches!(name, "ArgMax" | "ArgMin") {
        let is = int(trial.node(), "select_last_index", 0);
        all.push(Suspicion::new(
            "select_last_index",
            format!("select_last_index is {is} in the graph; {} explains the numbers", 1 - is),
            attributes(vec![builder::int("select_last_index", 1 - is)]),
        ));
    }
    all
}

fn axes(trial: &Trial) -> Vec<Suspicion> {
    let Some(rank) = trial.shape(0).map(<[usize]>::len) else { return Vec::new() };
    let mut all = Vec::new();
    let keepdims = int(trial.node(), "keepdims", 1);
    all.push(Suspicion::new(
        "keepdims",
        format!("keepdims is {keepdims} in the graph; {} explains the shape", 1 - keepdims),
        attributes(vec![builder::int("keepdims", 1 - keepdims)]),
    ));
    let as_attribute = attribute(trial.node(), "axes").map(|axes| axes.ints.clone());
    let Some(is) = as_attribute.clone().or_else(|| trial.integers(1)) else { return all };
    let counted: Vec<i64> = is.iter().map(|&axis| if axis < 0 { axis + rank as i64 } else { axis }).collect();
    // All other choices of as many axes, of which there are few.
    for bits in 0..1_u32 << rank.min(6) {
        let other: Vec<i64> = (0..rank as i64).filter(|axis| bits >> axis & 1 == 1).collect();
        if other.len() == is.len() && other.iter().any(|axis| !counted.contains(axis)) {
            let detail = format!("axes are {is:?} in the graph; {other:?} explain the numbers");
            let meaning = match as_attribute {
                Some(_) => attributes(vec![list("axes", &other)]),
                None => integers(1, move |old| Some(Tensor::new(&old.shape, other.clone()))),
            };
            all.push(Suspicion::new("axes", detail, meaning));
        }
    }
    all
}

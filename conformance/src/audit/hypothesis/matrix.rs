//! Matrix products and biases: factors, transposed matrices, a bias left out, doubled or of the wrong sign.

use super::Suspicion;
use super::change::{attributes, elements, float, int, operand_arranged, permuted, reordered};
use super::trial::Trial;
use crate::onnx::builder;

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let mut all = match trial.operator() {
        "Gemm" => gemm(trial),
        "MatMul" | "MatMulInteger" | "QLinearMatMul" | "QGemm" | "Einsum" => product(trial),
        _ => Vec::new(),
    };
    all.extend(biases(trial));
    // Weights and data subtracted, not added, and the like: for operators that are not symmetric.
    if matches!(trial.operator(), "Sub" | "Div" | "Pow" | "Mod" | "PRelu" | "Less" | "Greater" | "MatMul")
        && trial.case.operands.len() == 2
    {
        all.push(Suspicion::new("operands-swapped", "the operands were exchanged", reordered(vec![1, 0])));
    }
    all
}

fn biases(trial: &Trial) -> Vec<Suspicion> {
    let place = match trial.operator() {
        "Conv" | "ConvTranspose" | "Gemm" => 2,
        "QLinearConv" => 8,
        "QGemm" => 6,
        _ => return Vec::new(),
    };
    let Some(shape) = trial.shape(place) else { return Vec::new() };
    let mut all = vec![
        Suspicion::new("bias-missing", "the bias was left out", elements(place, |_| 0.0)),
        Suspicion::new("bias-twice", "the bias was added twice", elements(place, |b| 2.0 * b)),
        Suspicion::new("bias-sign", "the bias was subtracted, not added", elements(place, |b| -b)),
    ];
    if shape.len() == 1 && shape[0] > 1 {
        all.push(Suspicion::new(
            "bias-order",
            "the bias was read in the opposite order",
            operand_arranged(place, super::change::chosen(0, (0..shape[0]).rev().collect())),
        ));
        all.extend(trial.first(place).map(|first| {
            let detail = "the first element of the bias was added to all";
            Suspicion::new("bias-broadcast", detail, elements(place, move |_| first))
        }));
    }
    all
}

fn gemm(trial: &Trial) -> Vec<Suspicion> {
    let node = trial.node();
    let mut all = Vec::new();
    for (name, what) in [("transB", "weights-transposed"), ("transA", "operand-transposed")] {
        let is = int(node, name, 0);
        all.push(Suspicion::new(
            what,
            format!("{name} is {is} in the graph; {} explains the numbers", 1 - is),
            attributes(vec![builder::int(name, 1 - is)]),
        ));
    }
    let (alpha, beta) = (float(node, "alpha", 1.0), float(node, "beta", 1.0));
    for (name, is, others) in [("alpha", alpha, [1.0, beta]), ("beta", beta, [1.0, alpha])] {
        for other in others.into_iter().filter(|&other| other != is) {
            all.push(Suspicion::new(
                name,
                format!("{name} is {is} in the graph; {other} explains the numbers"),
                attributes(vec![builder::float(name, other)]),
            ));
        }
    }
    all.push(Suspicion::new(
        "alpha",
        format!("alpha is {alpha} and beta {beta} in the graph; 1 and 1 explain the numbers"),
        attributes(vec![builder::float("alpha", 1.0), builder::float("beta", 1.0)]),
    ));
    all.push(Suspicion::new(
        "beta",
        format!("alpha is {alpha} and beta {beta} in the graph; exchanged, they explain the numbers"),
        attributes(vec![builder::float("alpha", beta), builder::float("beta", alpha)]),
    ));
    all
}

/// The last two axes of a matrix exchanged, where they have one length.
fn product(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    for (place, name) in [(trial.weights(), "weights-transposed"), (0, "operand-transposed")] {
        let Some(shape) = trial.shape(place) else { continue };
        let rank = shape.len();
        if rank >= 2 && shape[rank - 1] == shape[rank - 2] && shape[rank - 1] > 1 {
            let mut order: Vec<usize> = (0..rank).collect();
            order.swap(rank - 1, rank - 2);
            all.push(Suspicion::new(
                name,
                format!("operand {place} was transposed"),
                operand_arranged(place, permuted(order)),
            ));
        }
    }
    // A matrix whose rows were read as columns lies in memory the other way round.
    for place in [trial.weights(), 0] {
        let Some(shape) = trial.shape(place).filter(|shape| shape.len() >= 2) else { continue };
        let rank = shape.len();
        if shape[rank - 1] != shape[rank - 2] && shape[rank - 1] > 1 && shape[rank - 2] > 1 {
            let mut order: Vec<usize> = (0..rank).collect();
            order.swap(rank - 1, rank - 2);
            all.push(Suspicion::new(
                if place > 0 { "weights-transposed" } else { "operand-transposed" },
                format!("operand {place} was read column by column"),
                operand_arranged(place, super::change::misread_back(order)),
            ));
        }
    }
    all
}

//! Tokens and lists: matrix products, attention, reductions.

use super::{Builder, Scene};
use crate::onnx::builder::{float, int, ints};

/// A transformer's block.
pub fn tokens() -> Scene {
    Builder::new(20)
        .input("x", &[2, 8, 16])
        .list("scale", 16, |x| 1.0 + 0.3 * x)
        .list("shift", 16, |x| 0.5 * x)
        .weight("wq", &[16, 16])
        .weight("wk", &[16, 16])
        .weight("w1", &[16, 32])
        .list("b1", 32, |x| x)
        .weight("w2", &[32, 16])
        .with(|graph| {
            graph
                .integers("heads", &[4], &[2, 8, 4, 4])
                .integers("joined", &[3], &[2, 8, 16])
                .node("LayerNormalization", &["x", "scale", "shift"], &["n"], vec![int("axis", 2)])
                .node("MatMul", &["n", "wq"], &["q"], vec![])
                .node("MatMul", &["n", "wk"], &["k"], vec![])
                .node("Reshape", &["q", "heads"], &["qr"], vec![])
                .node("Transpose", &["qr"], &["qh"], vec![ints("perm", &[0, 2, 1, 3])])
                .node("Reshape", &["k", "heads"], &["kr"], vec![])
                .node("Transpose", &["kr"], &["kh"], vec![ints("perm", &[0, 2, 3, 1])])
                .node("MatMul", &["qh", "kh"], &["scores"], vec![])
                .node("Softmax", &["scores"], &["weights"], vec![int("axis", 3)])
                .node("MatMul", &["weights", "qh"], &["mixed"], vec![])
                .node("Transpose", &["mixed"], &["back"], vec![ints("perm", &[0, 2, 1, 3])])
                .node("Reshape", &["back", "joined"], &["flat"], vec![])
                .node("Add", &["flat", "x"], &["h"], vec![])
                .node("MatMul", &["h", "w1"], &["m1"], vec![])
                .node("Add", &["m1", "b1"], &["m2"], vec![])
                .node("Gelu", &["m2"], &["g"], vec![])
                .node("MatMul", &["g", "w2"], &["m3"], vec![])
                .node("Add", &["m3", "h"], &["y"], vec![])
        })
        .output("y")
        .scene("tokens")
}

/// A regressor's head: linear layers, joins, cuts and reductions.
pub fn lists() -> Scene {
    Builder::new(18)
        .input("x", &[6, 24])
        .weight("w1", &[24, 24])
        .list("b1", 24, |x| x)
        .weight("w2", &[24, 24])
        .list("b2", 24, |x| x)
        .with(|graph| {
            graph
                .integers("starts", &[1], &[3])
                .integers("ends", &[1], &[19])
                .integers("axes", &[1], &[1])
                .integers("places", &[5], &[0, 7, 3, -1, 12])
                .constant("low", &[], &[-0.5])
                .constant("high", &[], &[0.6])
                .constant("eight", &[], &[8.0])
                .constant("small", &[], &[1e-5])
                .node(
                    "Gemm",
                    &["x", "w1", "b1"],
                    &["g1"],
                    vec![int("transB", 1), float("alpha", 0.5), float("beta", 2.0)],
                )
                .node("Elu", &["g1"], &["e"], vec![float("alpha", 1.0)])
                .node("Gemm", &["e", "w2", "b2"], &["g2"], vec![int("transB", 1)])
                .node("Concat", &["g1", "g2"], &["both"], vec![int("axis", 1)])
                .node("Slice", &["both", "starts", "ends", "axes"], &["cut"], vec![])
                .node("Gather", &["both", "places"], &["taken"], vec![int("axis", 1)])
                .node("ReduceMean", &["cut", "axes"], &["mean"], vec![int("keepdims", 1)])
                .node("Sub", &["cut", "mean"], &["centred"], vec![])
                .node("Clip", &["centred", "low", "high"], &["clipped"], vec![])
                .node("Mul", &["taken", "eight"], &["eightfold"], vec![])
                .node("Mul", &["centred", "centred"], &["squares"], vec![])
                .node("ReduceMean", &["squares", "axes"], &["variance"], vec![int("keepdims", 1)])
                .node("Add", &["variance", "small"], &["guarded"], vec![])
                .node("Sqrt", &["guarded"], &["deviation"], vec![])
                .node("Div", &["centred", "deviation"], &["normal"], vec![])
                .node("Sigmoid", &["g2"], &["share"], vec![])
                .node("ReduceSum", &["g2"], &["total"], vec![int("keepdims", 0)])
                .node("Relu", &["eightfold"], &["positive"], vec![])
        })
        .output("clipped")
        .output("share")
        .output("total")
        .output("normal")
        .output("positive")
        .scene("lists")
}

//! Numbers that become integers, and networks of such integers.

use super::{Builder, Scene, drawn};
use crate::onnx::builder::{int, ints};
use crate::onnx::typed_tensor::Elements;

/// Numbers that become integers.
pub fn bytes() -> Scene {
    // Multiples of a quarter: every second of the halves is a tie.
    let quarters: Vec<f32> = (0..96_i16).map(|i| f32::from(i - 48) * 0.25).collect();
    Builder::new(19)
        .given("x", &[4, 24], quarters)
        .with(|graph| {
            graph
                .constant("step", &[], &[0.5])
                .node("Round", &["x"], &["whole"], vec![])
                .node("Cast", &["x"], &["integer"], vec![int("to", 7)])
                .node("QuantizeLinear", &["x", "step"], &["level"], vec![])
                .node("DequantizeLinear", &["level", "step"], &["again"], vec![])
                .node("Add", &["whole", "again"], &["y"], vec![])
        })
        .output("y")
        .output("integer")
        .scene("bytes")
}

/// A network of quantised numbers: a convolution and a matrix product between integers, quantised again; the same with sums
/// that stay; scales for each channel. Some numbers lie beyond their type.
pub fn levels() -> Scene {
    let signed = |name: &str, shape: &[usize]| {
        Elements::I8(drawn(name, shape).iter().map(|x| (60.0 * x) as i8).collect())
    };
    let unsigned = |name: &str, shape: &[usize]| {
        Elements::U8(drawn(name, shape).iter().map(|x| (128.0 + 60.0 * x) as u8).collect())
    };
    let bias = Elements::I32(drawn("bias", &[6]).iter().map(|x| (9000.0 * x) as i32).collect());
    Builder::new(19)
        .input("x", &[2, 3, 9, 10])
        .tensor("zx", &[], Elements::U8(vec![121]))
        .tensor("w", &[6, 3, 3, 3], signed("w", &[6, 3, 3, 3]))
        .list("sw", 6, |x| 0.002 + 0.0008 * x)
        .tensor("zw", &[], Elements::I8(vec![-5]))
        .tensor("b", &[6], bias)
        .tensor("zy", &[], Elements::U8(vec![117]))
        .tensor("m", &[10, 10], unsigned("m", &[10, 10]))
        .tensor("zm", &[], Elements::U8(vec![130]))
        .tensor("v", &[10, 7], signed("v", &[10, 7]))
        .tensor("zv", &[7], Elements::I8(vec![4, -3, 9, 1, -8, 2, 6]))
        .tensor("zn", &[], Elements::U8(vec![139]))
        .list("sc", 3, |x| 0.011 + 0.002 * x)
        .tensor("zc", &[3], Elements::I8(vec![5, -14, 8]))
        .with(|graph| {
            graph
                .constant("sx", &[], &[0.0125])
                .constant("sy", &[], &[0.0093])
                .constant("sm", &[], &[0.0104])
                .constant("sn", &[], &[0.0181])
                .node("QuantizeLinear", &["x", "sx", "zx"], &["q"], vec![])
                .node(
                    "QLinearConv",
                    &["q", "sx", "zx", "w", "sw", "zw", "sy", "zy", "b"],
                    &["c"],
                    vec![ints("pads", &[1, 0, 1, 2])],
                )
                .node("DequantizeLinear", &["c", "sy", "zy"], &["d"], vec![])
                .node("QLinearMatMul", &["q", "sx", "zx", "m", "sm", "zm", "sn", "zn"], &["p"], vec![])
                .node("DequantizeLinear", &["p", "sn", "zn"], &["e"], vec![])
                .node("QuantizeLinear", &["x", "sc", "zc"], &["k"], vec![int("axis", 1)])
                .node("DequantizeLinear", &["k", "sc", "zc"], &["f"], vec![int("axis", 1)])
                .node("DynamicQuantizeLinear", &["x"], &["l", "sl", "zl"], vec![])
                .node(
                    "ConvInteger",
                    &["l", "w", "zl", "zw"],
                    &["ci"],
                    vec![ints("pads", &[1, 1, 1, 1]), ints("strides", &[2, 1])],
                )
                .node("MatMulInteger", &["l", "v", "zl", "zv"], &["mi"], vec![])
                .node("Cast", &["mi"], &["mf"], vec![int("to", 1)])
                .node("Mul", &["mf", "sl"], &["g"], vec![])
        })
        .output("d")
        .output("e")
        .output("f")
        .output("ci")
        .output("g")
        .scene("levels")
}

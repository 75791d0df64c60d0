//! Mistakes in matrix products, biases and activations.

use super::changes::renamed;
use super::{Fault, Plant, attributes, fault, operand};
use crate::onnx::builder::{float, int, text};
use crate::suite::audit_faults::scenes::{images, lists, tokens, volumes};

pub(super) const FAULTS: &[Fault] = &[
    // Matrices and biases.
    attributes("Gemm: transB ignored", "weights-transposed", (lists, "g2"), || vec![int("transB", 0)]),
    operand("MatMul: weights transposed", "weights-transposed", (tokens, "q"), 1, |w| w.swap_axes(0, 1)),
    attributes("Gemm: alpha ignored", "alpha", (lists, "g1"), || vec![float("alpha", 1.0)]),
    attributes("Gemm: beta ignored", "beta", (lists, "g1"), || vec![float("beta", 1.0)]),
    operand("Conv: bias left out", "bias-missing", (images, "c1"), 2, |b| b.map(|_| 0.0)),
    operand("Gemm: bias twice", "bias-twice", (lists, "g2"), 2, |b| b.map(|b| 2.0 * b)),
    operand("ConvTranspose: bias subtracted", "bias-sign", (volumes, "up"), 2, |b| b.map(|b| -b)),
    // Activations.
    attributes("LeakyRelu: slope 0.01 for 0.1", "alpha", (images, "a1"), || vec![float("alpha", 0.01)]),
    attributes("LeakyRelu: slope 0.13 for 0.1", "alpha", (images, "a1"), || vec![float("alpha", 0.13)]),
    attributes("Gelu: tanh for erf", "approximate", (tokens, "g"), || vec![text("approximate", "tanh")]),
    attributes("Elu: α 0.9 for 1", "alpha", (lists, "e"), || vec![float("alpha", 0.9)]),
    attributes("Softmax: axis 2 for 3", "axis", (tokens, "weights"), || vec![int("axis", 2)]),
    fault(
        "Sigmoid: a hard one",
        "activation",
        (lists, "share"),
        Plant::Node(|node| renamed(node, "HardSigmoid")),
    ),
    fault("Relu: left out", "activation", (lists, "positive"), Plant::Node(|node| renamed(node, "Identity"))),
    fault("Relu: Relu6", "activation", (lists, "positive"), Plant::Output(|y| y.map(|y| y.min(6.0)))),
    operand("Clip: upper bound ignored", "bounds", (lists, "clipped"), 2, |high| high.map(|_| f32::MAX)),
];

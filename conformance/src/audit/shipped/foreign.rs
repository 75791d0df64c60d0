//! Operators of an optimised graph that are not ONNX's own.

use std::collections::BTreeMap;

use crate::audit::report::ForeignOperator;
use crate::onnx::message::NodeProto;

/// The operators that are not ONNX's own, with what they stand for.
pub(super) fn foreign(nodes: &[NodeProto]) -> Vec<ForeignOperator> {
    let mut counts: BTreeMap<String, (usize, Option<&str>)> = BTreeMap::new();
    for node in nodes {
        let (domain, operator) =
            (node.domain.as_deref().unwrap_or_default(), node.op_type.as_deref().unwrap_or_default());
        if !matches!(domain, "" | "ai.onnx") {
            counts.entry(format!("{domain}.{operator}")).or_insert((0, meaning(domain, operator))).0 += 1;
        }
    }
    let operator = |(op, (count, meaning)): (String, (usize, Option<&str>))| ForeignOperator {
        op,
        count,
        meaning: meaning.map(str::to_owned),
    };
    counts.into_iter().map(operator).collect()
}

/// What an operator of ONNX Runtime stands for in ONNX's own.
fn meaning(domain: &str, operator: &str) -> Option<&'static str> {
    Some(match (domain, operator) {
        ("com.microsoft.nchwc", "Conv") => "Conv with bias, sum and activation, channels in blocks",
        ("com.microsoft.nchwc", "MaxPool") => "MaxPool, channels in blocks",
        ("com.microsoft.nchwc", "AveragePool") => "AveragePool, channels in blocks",
        ("com.microsoft.nchwc", "GlobalMaxPool") => "GlobalMaxPool, channels in blocks",
        ("com.microsoft.nchwc", "GlobalAveragePool") => "GlobalAveragePool, channels in blocks",
        ("com.microsoft.nchwc", "Upsample") => "Resize, channels in blocks",
        ("com.microsoft.nchwc", "ReorderInput") => "channels into blocks, no arithmetic",
        ("com.microsoft.nchwc", "ReorderOutput") => "channels out of blocks, no arithmetic",
        ("com.ms.internal.nhwc" | "com.microsoft", "NhwcConv" | "NhwcFusedConv") => "Conv, channels last",
        ("com.microsoft", "FusedConv") => "Conv, then Add and the activation",
        ("com.microsoft", "FusedGemm") => "Gemm, then the activation",
        ("com.microsoft", "FusedMatMul") => "MatMul of operands transposed and scaled",
        ("com.microsoft", "FusedMatMulActivation") => "MatMul, then the activation",
        ("com.microsoft", "Gelu") => "Gelu",
        ("com.microsoft", "BiasGelu") => "Add, then Gelu",
        ("com.microsoft", "FastGelu") => "Gelu by tanh",
        ("com.microsoft", "QuickGelu") => "x · Sigmoid(alpha · x)",
        ("com.microsoft", "BiasSoftmax") => "Add, then Softmax",
        ("com.microsoft", "SkipLayerNormalization") => "Add, then LayerNormalization",
        ("com.microsoft", "SimplifiedLayerNormalization") => "RMSNormalization",
        ("com.microsoft", "SkipSimplifiedLayerNormalization") => "Add, then RMSNormalization",
        ("com.microsoft", "Attention" | "MultiHeadAttention") => "Softmax(q·kᵀ)·v over heads",
        ("com.microsoft", "QLinearAdd" | "QLinearMul") => "dequantised, computed, quantised",
        ("com.microsoft", "QLinearAveragePool" | "QLinearGlobalAveragePool") => "the pool, quantised",
        ("com.microsoft", "DynamicQuantizeMatMul") => "MatMul of an operand quantised as it comes",
        ("com.microsoft", "MatMulIntegerToFloat") => "MatMulInteger, then scaled",
        ("com.microsoft", "TransposeMatMul") => "MatMul of transposed operands",
        _ => return None,
    })
}

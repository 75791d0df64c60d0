//! The same graph with every intermediate tensor as an output, so that each stage can be judged on its own inputs.

use std::collections::BTreeSet;

use prost::Message as _;

use super::message::{GraphProto, ModelProto};
use super::model::Model;
use super::write::undeclared;

/// The model's bytes with the named tensors added to its outputs, each after those that are there already.
///
/// Protocol buffers merge a message that occurs twice: lists are joined. So the additions are appended as a second,
/// otherwise empty model, and nothing of the file is rewritten, including fields that are not known here. No types are
/// given: ONNX Runtime infers them. Tensors that are outputs already are skipped.
///
/// Tensors inside the subgraphs of `If` and `Loop` cannot be exposed in this way.
pub fn expose(model: &Model, tensors: &[&str]) -> Vec<u8> {
    let mut taken: BTreeSet<_> = model.outputs().into_iter().collect();
    let output = tensors.iter().filter(|name| taken.insert(name)).map(|name| undeclared(name)).collect();
    let addition =
        ModelProto { graph: Some(GraphProto { output, ..Default::default() }), ..Default::default() };
    let mut bytes = model.bytes().to_vec();
    bytes.extend(addition.encode_to_vec());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::GraphBuilder;

    #[test]
    fn exposed_tensors_follow_the_outputs_and_nothing_else_changes() {
        let bytes = GraphBuilder::new(20)
            .input("x", &[2])
            .constant("w", &[2], &[1.0, 2.0])
            .node("Mul", &["x", "w"], &["m"], vec![])
            .node("Relu", &["m"], &["y"], vec![])
            .output("y")
            .to_bytes();
        let model = Model::from_bytes("g", bytes.clone()).expect("a model");
        let exposed = expose(&model, &model.intermediates());
        assert!(exposed.starts_with(&bytes), "the file itself is untouched");
        let exposed = Model::from_bytes("g exposed", exposed).expect("a model");
        assert_eq!(exposed.outputs(), ["y", "m"], "outputs");
        assert_eq!(exposed.nodes(), model.nodes(), "nodes");
        assert_eq!(exposed.opset(), 20, "opset");
    }
}

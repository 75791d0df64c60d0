//! An ONNX file read and checked: its operators, constants and properties.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use prost::Message as _;

use super::message::{GraphProto, ModelProto, NodeProto, ValueInfoProto};
use super::typed_tensor::TypedTensor;
use crate::error::{Error, Result};

/// A graph as read from a file, with its bytes for whoever wants to run it.
#[derive(Clone, Debug)]
pub struct Model {
    name: String,
    producer: String,
    bytes: Vec<u8>,
    graph: GraphProto,
    opsets: BTreeMap<String, i64>,
    properties: BTreeMap<String, String>,
}

impl Model {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read, or is not an ONNX model with a graph.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
        Self::from_bytes(&path.display().to_string(), bytes)
    }

    /// Reads a model's bytes; `name` stands for the file in messages.
    ///
    /// # Errors
    /// When the bytes are not an ONNX model with a graph of named outputs.
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Result<Self> {
        let error = |item: &str, message: String| Error::Onnx {
            graph: name.to_owned(),
            item: item.to_owned(),
            message,
        };
        let model = ModelProto::decode(bytes.as_slice())
            .map_err(|why| error("file", format!("not an ONNX model: {why}")))?;
        let graph = model.graph.ok_or_else(|| error("file", "an ONNX model without a graph".into()))?;
        if graph.output.is_empty() {
            return Err(error("graph", "no outputs; at least one was expected".into()));
        }
        let opsets = model
            .opset_import
            .into_iter()
            .map(|set| (set.domain.unwrap_or_default(), set.version.unwrap_or(0)))
            .collect();
        let properties = model
            .metadata_props
            .into_iter()
            .map(|entry| (entry.key.unwrap_or_default(), entry.value.unwrap_or_default()))
            .collect();
        let producer = model.producer_name.unwrap_or_default();
        Ok(Self { name: name.to_owned(), producer, bytes, graph, opsets, properties })
    }

    /// The file's path or the name given for it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The program that wrote the file, empty when it does not say.
    pub fn producer(&self) -> &str {
        &self.producer
    }

    /// The file's bytes, unchanged.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The graph itself.
    pub fn graph(&self) -> &GraphProto {
        &self.graph
    }

    /// The nodes in topological order.
    pub fn nodes(&self) -> &[NodeProto] {
        &self.graph.node
    }

    /// The version of ONNX's own operators, 0 when the file does not say.
    pub fn opset(&self) -> i64 {
        self.opsets.get("").or_else(|| self.opsets.get("ai.onnx")).copied().unwrap_or(0)
    }

    /// The versions of all operators by domain, "" being ONNX's own.
    pub fn opsets(&self) -> Vec<(String, i64)> {
        self.opsets.iter().map(|(domain, &version)| (domain.clone(), version)).collect()
    }

    /// A property of the file, such as `vitruvian.kind`.
    pub fn property(&self, key: &str) -> Option<&str> {
        self.properties.get(key).map(String::as_str)
    }

    /// The distinct operators, with their domain where it is not ONNX's own: `Conv`, `com.microsoft.FusedConv`.
    pub fn operators(&self) -> BTreeSet<String> {
        self.graph
            .node
            .iter()
            .map(|node| {
                let operator = node.op_type.clone().unwrap_or_default();
                match node.domain.as_deref() {
                    None | Some("" | "ai.onnx") => operator,
                    Some(domain) => format!("{domain}.{operator}"),
                }
            })
            .collect()
    }

    /// Names of the graph's inputs that are not constants, in order.
    pub fn inputs(&self) -> Vec<&str> {
        let constants: BTreeSet<_> =
            self.graph.initializer.iter().filter_map(|t| t.name.as_deref()).collect();
        self.graph
            .input
            .iter()
            .filter_map(|value| value.name.as_deref())
            .filter(|name| !constants.contains(name))
            .collect()
    }

    /// The graph's inputs that are not constants, with their types as declared, in order.
    pub fn declared_inputs(&self) -> Vec<&ValueInfoProto> {
        let names = self.inputs();
        let named = |value: &&ValueInfoProto| value.name.as_deref().is_some_and(|name| names.contains(&name));
        self.graph.input.iter().filter(named).collect()
    }

    /// Names of the graph's outputs, in order.
    pub fn outputs(&self) -> Vec<&str> {
        self.graph.output.iter().filter_map(|value| value.name.as_deref()).collect()
    }

    /// Names of all tensors that nodes make, in the nodes' order; nodes inside subgraphs are not visited.
    pub fn intermediates(&self) -> Vec<&str> {
        self.graph
            .node
            .iter()
            .flat_map(|node| &node.output)
            .map(String::as_str)
            .filter(|name| !name.is_empty())
            .collect()
    }

    /// All constants by name.
    ///
    /// # Errors
    /// When a constant has no name or one that is taken, or its elements cannot be read; names the constant.
    pub fn constants(&self) -> Result<BTreeMap<String, TypedTensor>> {
        let mut constants = BTreeMap::new();
        for tensor in &self.graph.initializer {
            let name = tensor.name.clone().unwrap_or_default();
            let error = |message: String| Error::Onnx {
                graph: self.name.clone(),
                item: format!("initializer \"{name}\""),
                message,
            };
            let constant = TypedTensor::read(tensor).map_err(error)?;
            if name.is_empty() {
                return Err(error("has no name".into()));
            }
            if constants.insert(name.clone(), constant).is_some() {
                return Err(error("its name is used twice".into()));
            }
        }
        Ok(constants)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::GraphBuilder;

    fn small() -> Vec<u8> {
        GraphBuilder::new(20)
            .input("x", &[1, 2])
            .constant("w", &[2], &[3.0, 4.0])
            .node("Mul", &["x", "w"], &["m"], vec![])
            .node("Relu", &["m"], &["y"], vec![])
            .output("y")
            .to_bytes()
    }

    #[test]
    fn a_graph_that_was_built_is_read_back() {
        let model = Model::from_bytes("small", small()).expect("readable");
        assert_eq!(model.opset(), 20, "opset");
        assert_eq!(model.operators().into_iter().collect::<Vec<_>>(), ["Mul", "Relu"], "operators");
        assert_eq!(model.inputs(), ["x"], "inputs");
        assert_eq!(model.outputs(), ["y"], "outputs");
        assert_eq!(model.intermediates(), ["m", "y"], "intermediates");
        assert_eq!(model.constants().expect("constants")["w"].to_f64(), Some(vec![3.0, 4.0]), "weights");
    }

    #[test]
    fn bytes_that_are_no_model_are_refused_with_the_name() {
        for bytes in [b"\x89PNG\r\n\x1a\n".to_vec(), Vec::new(), small()[..20].to_vec()] {
            let message = Model::from_bytes("some.onnx", bytes).expect_err("refused").to_string();
            assert!(message.starts_with("some.onnx: "), "{message}");
        }
    }

    #[test]
    fn a_constant_that_cannot_be_read_is_named() {
        let bytes = GraphBuilder::new(20)
            .input("x", &[2])
            .constant("w", &[3], &[1.0, 2.0])
            .node("Add", &["x", "w"], &["y"], vec![])
            .output("y")
            .to_bytes();
        let message =
            Model::from_bytes("g", bytes).expect("a model").constants().expect_err("refused").to_string();
        assert!(message.contains("initializer \"w\""), "{message}");
    }
}

//! An ONNX file read and checked: its operators, constants and properties.
//!
//! A file that is opened has a graph in which every tensor has one maker and every node stands behind those that it reads,
//! in a version of ONNX's operators that is known here, and its constants are as large as their shapes say. What single
//! nodes hold may still be unknown (other domains, subgraphs, elements that are texts or narrower than a byte): that is
//! found when the node is evaluated, and leaves the others readable.
//!
//! Elements that lie in other files stay there until they are asked for.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use prost::Message as _;
use prost::bytes::Bytes;
use sha2::{Digest as _, Sha256};

use super::external::{Folder, LONGEST, embed, is_external};
use super::message::{GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto};
use super::structure::{self, Flaw, quoted};
use super::tensor_info::TensorInfo;
use super::typed_tensor::{self, TypedTensor};
use super::walk::OPSETS;
use super::{inline, scan};
use crate::error::{Error, Result};

/// A graph as read from a file, with its bytes for whoever wants to run it.
#[derive(Clone, Debug)]
pub struct Model {
    name: String,
    folder: Option<PathBuf>,
    bytes: Bytes,
    producer: String,
    graph: GraphProto,
    opsets: BTreeMap<String, i64>,
    properties: BTreeMap<String, String>,
    /// The place of each constant in the graph's list.
    constants: HashMap<String, usize>,
    /// What the graph says of tensors' types and shapes.
    declared: HashMap<String, TensorInfo>,
}

impl Model {
    /// Reads a file. Elements in other files must lie in its folder.
    ///
    /// # Errors
    /// When it cannot be read, or as [`Model::from_bytes`].
    pub fn read(path: &Path) -> Result<Self> {
        let io = |source| Error::Io { path: path.to_owned(), source };
        let name = path.display().to_string();
        let metadata = std::fs::metadata(path).map_err(io)?;
        let found = match metadata.len() {
            _ if !metadata.is_file() => Err("is no file".to_owned()),
            length if length >= LONGEST => Err(format!(
                "has {length} bytes, an ONNX file has less than 2 GB; keep its weights in external data"
            )),
            _ => Ok(()),
        };
        found.map_err(|message| Error::Onnx { graph: name.clone(), item: "file".into(), message })?;
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        Self::open(name, std::fs::read(path).map_err(io)?.into(), Some(folder))
    }

    /// Reads a model's bytes; `name` stands for the file in messages.
    ///
    /// # Errors
    /// When the bytes are not an ONNX model with a graph of named outputs, or would take far more memory than the file is
    /// long, or the graph has a flaw; names the node or the tensor.
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Result<Self> {
        Self::open(name.to_owned(), bytes.into(), None)
    }

    fn open(name: String, bytes: Bytes, folder: Option<&Path>) -> Result<Self> {
        Self::checked(&name, bytes, folder).map_err(|flaw| Error::Onnx {
            graph: name,
            item: flaw.item,
            message: flaw.message,
        })
    }

    fn checked(name: &str, bytes: Bytes, folder: Option<&Path>) -> std::result::Result<Self, Flaw> {
        scan::check(&bytes).map_err(|why| Flaw::new("file", why))?;
        // Weights are not copied: they share the file's bytes.
        let model = ModelProto::decode(bytes.clone())
            .map_err(|why| Flaw::new("file", format!("not an ONNX model: {why}")))?;
        let mut graph = model.graph.ok_or_else(|| Flaw::new("file", "an ONNX model without a graph"))?;
        if graph.output.is_empty() {
            return Err(Flaw::new("graph", "no outputs; at least one was expected"));
        }
        let own = |domain: &str| if domain == "ai.onnx" { String::new() } else { domain.to_owned() };
        let opsets: BTreeMap<String, i64> = model
            .opset_import
            .iter()
            .map(|set| (own(set.domain.as_deref().unwrap_or_default()), set.version.unwrap_or(0)))
            .collect();
        let opset = opsets.get("").copied().unwrap_or(0);
        if !OPSETS.contains(&opset) && graph.node.iter().any(is_own) {
            let (first, last) = (OPSETS.start(), OPSETS.end());
            return Err(Flaw::new(
                "operator set",
                format!(
                    "version {opset} of ONNX's operators; {first} to {last} are read, export or convert it to one"
                ),
            ));
        }
        inline::inline(&mut graph, &model.functions, opset)?;
        structure::check(&graph)?;

        let mut files = Folder::of(folder);
        let mut constants = HashMap::with_capacity(graph.initializer.len());
        for (place, tensor) in graph.initializer.iter().enumerate() {
            let name = tensor.name.clone().unwrap_or_default();
            if is_external(tensor) { files.check(tensor) } else { typed_tensor::check(tensor) }
                .map_err(|why| Flaw::new(format!("initializer {}", quoted(&name)), why))?;
            constants.insert(name, place);
        }
        let mut declared = HashMap::new();
        for value in graph.value_info.iter().chain(&graph.input).chain(&graph.output) {
            let info = TensorInfo::of(value).map_err(|why| {
                Flaw::new(format!("tensor {}", quoted(value.name.as_deref().unwrap_or_default())), why)
            })?;
            declared.insert(info.name.clone(), info);
        }
        let producer = [model.producer_name, model.producer_version];
        let producer = producer.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>();
        let properties = model
            .metadata_props
            .into_iter()
            .map(|entry| (entry.key.unwrap_or_default(), entry.value.unwrap_or_default()))
            .collect();
        Ok(Self {
            name: name.to_owned(),
            folder: folder.map(Path::to_owned),
            bytes,
            producer: producer.join(" "),
            graph,
            opsets,
            properties,
            constants,
            declared,
        })
    }

    /// The file's path or the name given for it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The folder that the file lies in, where its external data is; `None` of a model in memory.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// The program that wrote the file and its version, empty when it does not say.
    pub fn producer(&self) -> &str {
        &self.producer
    }

    /// The file's bytes, unchanged.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The same file with the elements that lie in other files inside, for an engine that gets bytes and no path.
    ///
    /// # Errors
    /// When a file has changed since, or all is too much for one file; names the constant.
    pub fn embedded(&self) -> Result<Cow<'_, Self>> {
        if !self.graph.initializer.iter().any(is_external) {
            return Ok(Cow::Borrowed(self));
        }
        let failed = |message: String| Error::Onnx { graph: self.name.clone(), item: "file".into(), message };
        let mut model = ModelProto::decode(self.bytes.clone()).map_err(|why| failed(why.to_string()))?;
        if let Some(graph) = &mut model.graph {
            embed(graph, self.folder.as_deref()).map_err(failed)?;
        }
        Self::from_bytes(&self.name, model.encode_to_vec()).map(Cow::Owned)
    }

    /// The graph itself; calls of the file's own functions are written out.
    pub fn graph(&self) -> &GraphProto {
        &self.graph
    }

    /// SHA-256 of the file's bytes in hexadecimal digits; what lies in other files is not in it.
    pub fn sha256(&self) -> String {
        Sha256::digest(&self.bytes).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The nodes in topological order.
    pub fn nodes(&self) -> &[NodeProto] {
        &self.graph.node
    }

    /// The version of ONNX's own operators, 0 when the file does not say.
    pub fn opset(&self) -> i64 {
        self.opset_of("").unwrap_or(0)
    }

    /// The version of a domain's operators, "" being ONNX's own.
    pub fn opset_of(&self, domain: &str) -> Option<i64> {
        self.opsets.get(if domain == "ai.onnx" { "" } else { domain }).copied()
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
        let name = |node: &NodeProto| {
            let operator = node.op_type.clone().unwrap_or_default();
            match node.domain.as_deref() {
                Some(domain) if !is_own(node) => format!("{domain}.{operator}"),
                _ => operator,
            }
        };
        self.graph.node.iter().map(name).collect()
    }

    /// Names of the graph's inputs that are not constants, in order.
    pub fn inputs(&self) -> Vec<&str> {
        self.declared_inputs().into_iter().filter_map(|value| value.name.as_deref()).collect()
    }

    /// The graph's inputs that are not constants, with their types as declared, in order.
    pub fn declared_inputs(&self) -> Vec<&ValueInfoProto> {
        let given = |value: &&ValueInfoProto| !self.is_constant(value.name.as_deref().unwrap_or_default());
        self.graph.input.iter().filter(given).collect()
    }

    /// Names of the graph's outputs, in order.
    pub fn outputs(&self) -> Vec<&str> {
        self.graph.output.iter().filter_map(|value| value.name.as_deref()).collect()
    }

    /// What the graph says of a tensor's type and shape, be it an input, an output or between.
    pub fn declared(&self, tensor: &str) -> Option<&TensorInfo> {
        self.declared.get(tensor)
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

    /// Whether a tensor is a constant of the graph, of whatever type.
    pub fn is_constant(&self, tensor: &str) -> bool {
        self.constants.contains_key(tensor) || self.sparse().any(|name| name == tensor)
    }

    fn sparse(&self) -> impl Iterator<Item = &str> {
        self.graph.sparse_initializer.iter().filter_map(|tensor| tensor.values.as_ref()?.name.as_deref())
    }

    /// Names of the constants, in the file's order.
    pub fn constant_names(&self) -> impl Iterator<Item = &str> {
        self.graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref()).chain(self.sparse())
    }

    /// A constant as the file has it, without the elements that lie in another file.
    pub fn constant_message(&self, name: &str) -> Option<&TensorProto> {
        self.constants.get(name).map(|&place| &self.graph.initializer[place])
    }

    /// A constant's elements, read from another file where they lie in one.
    ///
    /// # Errors
    /// When there is no such constant, it is sparse or of a type that is not read, or its file has changed; names it.
    pub fn constant(&self, name: &str) -> Result<TypedTensor> {
        let read = match self.constant_message(name) {
            Some(tensor) if is_external(tensor) => Folder::of(self.folder.as_deref()).read(tensor),
            Some(tensor) => TypedTensor::read(tensor),
            None if self.is_constant(name) => Err("is a sparse tensor, which is not read".into()),
            None => Err("is not in the graph".into()),
        };
        read.map_err(|message| Error::Onnx {
            graph: self.name.clone(),
            item: format!("initializer {}", quoted(name)),
            message,
        })
    }

    /// All constants by name.
    ///
    /// # Errors
    /// As [`Model::constant`].
    pub fn constants(&self) -> Result<BTreeMap<String, TypedTensor>> {
        self.constant_names().map(|name| Ok((name.to_owned(), self.constant(name)?))).collect()
    }
}

/// Whether a node's operator is one of ONNX's own.
pub(crate) fn is_own(node: &NodeProto) -> bool {
    matches!(node.domain.as_deref(), None | Some("" | "ai.onnx"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::GraphBuilder;
    use crate::onnx::tensor_info::Dimension;

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
        let message = Model::from_bytes("g", bytes).expect_err("refused").to_string();
        assert!(message.contains("initializer \"w\""), "{message}");
    }

    #[test]
    fn opsets_that_are_not_known_are_refused_with_those_that_are() {
        for opset in [0, 5, 29] {
            let bytes = GraphBuilder::new(opset).input("x", &[1]).node("Relu", &["x"], &["y"], vec![]);
            let refused = Model::from_bytes("g", bytes.output("y").to_bytes()).expect_err("refused");
            assert!(refused.to_string().contains("6 to 28"), "{refused}");
        }
    }

    #[test]
    fn what_is_declared_is_told_by_name() {
        let model = Model::from_bytes("small", small()).expect("readable");
        let x = model.declared("x").expect("a declaration");
        assert_eq!(x.shape, Some(vec![Dimension::Fixed(1), Dimension::Fixed(2)]));
        assert_eq!((model.declared("m"), model.producer()), (None, "vitruvian-conformance"));
        assert_eq!(model.sha256().len(), 64);
        assert!(model.is_constant("w") && !model.is_constant("x"), "constants");
        assert!(
            model.constant("x").expect_err("refused").to_string().contains("initializer \"x\""),
            "no constant"
        );
    }
}

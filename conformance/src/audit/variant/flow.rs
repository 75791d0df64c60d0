//! A graph as a flow of tensors: which node makes and reads which, and what they hold on given inputs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use prost::Message as _;
use vitruvian_runtime::session::{Optimization, Session, Settings};

use super::runner::{Arrays, Runner};
use super::surgery::{self, Port, Rewriting};
use crate::error::{Error, Result};
use crate::onnx::element::ElementType;
use crate::onnx::message::{ModelProto, NodeProto};

/// A graph with its edges looked up.
#[derive(Debug)]
pub struct Flow {
    /// Its path or name, for messages.
    pub name: String,
    /// The file.
    pub model: ModelProto,
    /// The graph's inputs that are not constants.
    pub inputs: Vec<String>,
    /// The graph's outputs.
    pub outputs: Vec<String>,
    /// The place of the node that makes each tensor.
    pub maker: BTreeMap<String, usize>,
    /// Tensors that depend on an input, and so are computed at run time, of which ONNX Runtime says they are floats: their
    /// element types by ONNX's numbers.
    pub floats: BTreeMap<String, i32>,
    /// Tensors that depend on an input.
    live: BTreeSet<String>,
}

impl Flow {
    /// Takes the bytes of a file apart; weights may lie beside it.
    ///
    /// # Errors
    /// When they are no graph that can be taken apart, or ONNX Runtime does not load it.
    pub fn of_file(path: &Path, bytes: &[u8]) -> Result<Self> {
        let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        Self::open(&path.display().to_string(), bytes, Some(folder))
    }

    /// As [`Flow::of_file`], of bytes that lie nowhere.
    ///
    /// # Errors
    /// As [`Flow::of_file`].
    pub fn new(name: &str, bytes: &[u8]) -> Result<Self> {
        Self::open(name, bytes, None)
    }

    fn open(name: &str, bytes: &[u8], folder: Option<&Path>) -> Result<Self> {
        let model = surgery::open(bytes, folder).map_err(|message| fault(name, message))?;
        let graph = model.graph.clone().unwrap_or_default();
        let constants: BTreeSet<&str> = graph.initializer.iter().filter_map(|t| t.name.as_deref()).collect();
        let names = |infos: &[crate::onnx::message::ValueInfoProto]| -> Vec<String> {
            infos.iter().filter_map(|info| info.name.clone()).collect()
        };
        let inputs: Vec<String> =
            names(&graph.input).into_iter().filter(|name| !constants.contains(name.as_str())).collect();
        let mut live: BTreeSet<String> = inputs.iter().cloned().collect();
        let mut maker = BTreeMap::new();
        for (place, node) in graph.node.iter().enumerate() {
            let reads = node.input.iter().any(|name| live.contains(name));
            for output in node.output.iter().filter(|name| !name.is_empty()) {
                maker.insert(output.clone(), place);
                if reads {
                    live.insert(output.clone());
                }
            }
        }
        let made =
            live.iter().filter(|name| maker.contains_key(*name)).map(String::as_str).collect::<Vec<_>>();
        let floats = float_elements(name, model.encode_to_vec(), &made)?;
        let outputs = names(&graph.output);
        Ok(Self { name: name.to_owned(), model, inputs, outputs, maker, floats, live })
    }

    /// The nodes in the file's order.
    pub fn nodes(&self) -> &[NodeProto] {
        self.model.graph.as_ref().map_or(&[], |graph| &graph.node)
    }

    /// The operator that makes a tensor; "" for an input or a constant.
    pub fn operator(&self, tensor: &str) -> &str {
        self.maker.get(tensor).map_or("", |&place| self.nodes()[place].op_type.as_deref().unwrap_or_default())
    }

    /// The version of ONNX's own operators, 0 where the file does not say.
    pub fn opset(&self) -> i64 {
        let own = |set: &&crate::onnx::message::OperatorSetIdProto| {
            matches!(set.domain.as_deref(), None | Some("" | "ai.onnx"))
        };
        self.model.opset_import.iter().find(own).and_then(|set| set.version).unwrap_or(0)
    }

    /// The element type that an input is declared to have; `None` for what is no input.
    pub fn input_element(&self, name: &str) -> Option<ElementType> {
        if !self.inputs.iter().any(|input| input == name) {
            return None;
        }
        let inputs = self.model.graph.iter().flat_map(|graph| &graph.input);
        let tensor = inputs
            .filter(|info| info.name.as_deref() == Some(name))
            .find_map(|info| info.r#type.as_ref()?.tensor_type.as_ref());
        tensor.and_then(|tensor| ElementType::from_number(tensor.elem_type?))
    }

    /// The element type of an input or output in words, such as `f32`; "" where the file does not say.
    pub fn element(&self, tensor: &str) -> String {
        let graph = self.model.graph.as_ref();
        let infos = graph.into_iter().flat_map(|graph| graph.input.iter().chain(&graph.output));
        let declared = infos
            .filter(|info| info.name.as_deref() == Some(tensor))
            .find_map(|info| info.r#type.as_ref()?.tensor_type.as_ref()?.elem_type);
        let number = declared.or_else(|| self.floats.get(tensor).copied());
        number.and_then(ElementType::from_number).map_or(String::new(), |element| element.to_string())
    }

    /// Whether a tensor depends on an input.
    pub fn is_live(&self, tensor: &str) -> bool {
        self.live.contains(tensor)
    }

    /// A node's name, `OPERATOR_INDEX` where the file gives none.
    pub fn node_name(&self, place: usize) -> String {
        let node = &self.nodes()[place];
        match node.name.as_deref() {
            None | Some("") => format!("{}_{place}", node.op_type.as_deref().unwrap_or_default()),
            Some(name) => name.to_owned(),
        }
    }

    /// The nodes from which a tensor is computed, as far back as tensors at which `stop` says to: their places in the file's
    /// order, and the tensors that were stopped at.
    pub fn region(&self, tensor: &str, stop: impl Fn(&str) -> bool) -> (Vec<usize>, BTreeSet<String>) {
        let (mut places, mut frontier) = (BTreeSet::new(), BTreeSet::new());
        let mut open: Vec<usize> = self.maker.get(tensor).copied().into_iter().collect();
        while let Some(place) = open.pop() {
            if !places.insert(place) {
                continue;
            }
            for read in self.nodes()[place].input.iter().filter(|name| self.is_live(name)) {
                match self.maker.get(read) {
                    Some(&before) if !stop(read) => open.push(before),
                    _ => {
                        frontier.insert(read.clone());
                    }
                }
            }
        }
        (places.into_iter().collect(), frontier)
    }

    /// The graph rewritten and loaded.
    ///
    /// # Errors
    /// When it cannot be rewritten or loaded.
    pub fn runner(&self, rewriting: &Rewriting) -> Result<Runner> {
        let bytes = surgery::rewrite(&self.model, rewriting).map_err(|message| fault(&self.name, message))?;
        Runner::new(&self.name, &bytes)
    }

    /// The graph as it is, loaded.
    ///
    /// # Errors
    /// When it cannot be loaded.
    pub fn outputs_runner(&self) -> Result<Runner> {
        let wanted: Vec<&str> = self.outputs.iter().map(String::as_str).collect();
        self.runner(&Rewriting { outputs: &wanted, ..Default::default() })
    }

    /// What all floats hold on these inputs, by the tensors' own names.
    ///
    /// # Errors
    /// When the graph does not run on them.
    pub fn record(&self, inputs: &Arrays) -> Result<Arrays> {
        let wanted: Vec<&str> = self.floats.keys().map(String::as_str).collect();
        let mut runner = self.runner(&Rewriting { outputs: &wanted, ..Default::default() })?;
        let found = runner.run(|name| inputs.get(name))?;
        Ok(unprefixed(found, "out:"))
    }

    /// The place at which a tensor is opened, of as many axes as it was found to have.
    pub fn port(&self, tensor: &str, rank: usize) -> Port {
        Port { tensor: tensor.to_owned(), element: self.floats.get(tensor).copied().unwrap_or(1), rank }
    }
}

/// Arrays whose names lose a prefix.
pub fn unprefixed(arrays: Arrays, prefix: &str) -> Arrays {
    let strip = |name: String| name.strip_prefix(prefix).map_or(name.clone(), str::to_owned);
    arrays.into_iter().map(|(name, array)| (strip(name), array)).collect()
}

/// An error about a graph as a whole.
pub fn fault(name: &str, message: String) -> Error {
    Error::Onnx { graph: name.to_owned(), item: "graph".to_owned(), message }
}

/// Those of the tensors that are floats, with ONNX's numbers of their element types: what ONNX Runtime infers.
fn float_elements(name: &str, bytes: Vec<u8>, tensors: &[&str]) -> Result<BTreeMap<String, i32>> {
    let model = crate::onnx::model::Model::from_bytes(name, bytes)?;
    let exposed = crate::onnx::expose::expose(&model, tensors);
    let settings = Settings { optimization: Optimization::Disabled, threads: 1 };
    let session = Session::from_bytes(name, &exposed, &settings)?;
    let number = |element: &str| match element {
        "f32" => Some(1),
        "f16" => Some(10),
        "f64" => Some(11),
        "bf16" => Some(16),
        _ => None,
    };
    let floats =
        session.outputs().iter().filter_map(|info| Some((info.name.clone(), number(&info.element)?)));
    Ok(floats.filter(|(name, _)| tensors.contains(&name.as_str())).collect())
}

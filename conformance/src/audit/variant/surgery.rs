//! Graphs rewritten to be questioned: cut open at tensors, nudged at tensors, asked for tensors, pruned to what that needs.
//!
//! Everything goes in and comes out in f32, whatever the graph holds: an input of another type is cast inside the graph. An
//! f16 graph and its f32 base can so be given the same numbers and the first rounds them for itself.
//!
//! | name in the rewritten graph | is |
//! |---|---|
//! | `NAME` of an input | the input, f32 |
//! | `feed:T` | an input: T is read from here instead of from the node that makes it |
//! | `nudge:T` | an input: it is added to T wherever T is read |
//! | `out:T` | an output: T in f32 |

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use prost::Message as _;

use crate::onnx::builder::int;
use crate::onnx::external::embed;
use crate::onnx::message::{
    AttributeProto, DimensionProto, DimensionValue, GraphProto, ModelProto, NodeProto, TensorShapeProto,
    TensorTypeProto, TypeProto, ValueInfoProto,
};

/// ONNX's number of f32.
const F32: i32 = 1;

/// A tensor at which a graph is opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Its name.
    pub tensor: String,
    /// ONNX's number of its element type.
    pub element: i32,
    /// Its number of axes.
    pub rank: usize,
}

/// What to do to a graph.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rewriting<'a> {
    /// Tensors that are given.
    pub feeds: &'a [Port],
    /// Tensors that get something added.
    pub nudges: &'a [Port],
    /// Tensors that are asked for.
    pub outputs: &'a [&'a str],
    /// Whether outputs are what the nodes make, rather than what is read in its place where a tensor is fed or nudged.
    pub as_made: bool,
}

/// The name of the input that feeds a tensor.
pub fn feed(tensor: &str) -> String {
    format!("feed:{tensor}")
}

/// The name of the input that nudges a tensor.
pub fn nudge(tensor: &str) -> String {
    format!("nudge:{tensor}")
}

/// The name of the output that gives a tensor.
pub fn out(tensor: &str) -> String {
    format!("out:{tensor}")
}

/// The graph of a file's bytes, with the weights that lie beside it in `folder`.
///
/// # Errors
/// When they hold none, or one that cannot be taken apart, with subgraphs, which read tensors unseen; or weights are not there.
pub fn open(bytes: &[u8], folder: Option<&Path>) -> Result<ModelProto, String> {
    let mut model = ModelProto::decode(bytes).map_err(|why| format!("not an ONNX model: {why}"))?;
    let graph = model.graph.as_mut().ok_or("an ONNX model without a graph")?;
    if let Some(node) =
        graph.node.iter().find(|node| node.attribute.iter().any(|a| a.g.is_some() || !a.graphs.is_empty()))
    {
        let (name, operator) = (node.name.as_deref().unwrap_or(""), node.op_type.as_deref().unwrap_or(""));
        return Err(format!(
            "node \"{name}\" ({operator}) has a subgraph; graphs with If, Loop or Scan are not taken apart"
        ));
    }
    embed(graph, folder)?;
    graph.node = in_order(std::mem::take(&mut graph.node))?;
    Ok(model)
}

/// Nodes, each after those that it reads, otherwise in the order given: converters append what they insert at the end, and ONNX
/// Runtime takes it.
fn in_order(nodes: Vec<NodeProto>) -> Result<Vec<NodeProto>, String> {
    let maker: BTreeMap<&str, usize> = nodes
        .iter()
        .enumerate()
        .flat_map(|(i, node)| node.output.iter().map(move |name| (name.as_str(), i)))
        .collect();
    let mut readers: Vec<Vec<usize>> = vec![Vec::new(); nodes.len()];
    let mut waits = vec![0_usize; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for &before in
            node.input.iter().filter(|name| !name.is_empty()).filter_map(|name| maker.get(name.as_str()))
        {
            readers[before].push(i);
            waits[i] += 1;
        }
    }
    let mut ready: BTreeSet<usize> = (0..nodes.len()).filter(|&i| waits[i] == 0).collect();
    let mut order = Vec::with_capacity(nodes.len());
    while let Some(next) = ready.pop_first() {
        order.push(next);
        for &reader in &readers[next] {
            waits[reader] -= 1;
            if waits[reader] == 0 {
                ready.insert(reader);
            }
        }
    }
    if let Some(stuck) = waits.iter().position(|&left| left > 0) {
        let name = nodes[stuck].name.as_deref().unwrap_or_default();
        return Err(format!("node \"{name}\" reads, directly or not, what it makes itself"));
    }
    let mut nodes: Vec<Option<NodeProto>> = nodes.into_iter().map(Some).collect();
    Ok(order.into_iter().filter_map(|i| nodes[i].take()).collect())
}

/// The rewritten graph as a file's bytes.
///
/// # Errors
/// When an input has no element type, or an output is not made by the graph; names it.
pub fn rewrite(model: &ModelProto, rewriting: &Rewriting) -> Result<Vec<u8>, String> {
    let empty = GraphProto::default();
    let graph = model.graph.as_ref().unwrap_or(&empty);
    let constants: BTreeSet<&str> = graph.initializer.iter().filter_map(|t| t.name.as_deref()).collect();

    // What consumers read in place of a tensor.
    let mut read: BTreeMap<&str, String> = BTreeMap::new();
    let (mut inputs, mut nodes) = (Vec::new(), Vec::new());
    for input in &graph.input {
        let name = input.name.as_deref().unwrap_or_default();
        if constants.contains(name) {
            continue;
        }
        let tensor = input.r#type.as_ref().and_then(|t| t.tensor_type.as_ref());
        let (element, shape) = tensor
            .and_then(|t| Some((t.elem_type?, t.shape.clone())))
            .ok_or_else(|| format!("input \"{name}\" has no element type"))?;
        if element != F32 {
            let typed = format!("typed:{name}");
            nodes.push(cast(name, &typed, element));
            read.insert(name, typed);
        }
        inputs.push(value_info(name, shape));
    }
    for port in rewriting.feeds {
        let given = feed(&port.tensor);
        inputs.push(value_info(&given, Some(free_shape(&given, port.rank))));
        let typed = if port.element == F32 { given } else { format!("fed:{}", port.tensor) };
        if port.element != F32 {
            nodes.push(cast(&feed(&port.tensor), &typed, port.element));
        }
        read.insert(&port.tensor, typed);
    }
    let mut nudged: BTreeMap<&str, &Port> = BTreeMap::new();
    for port in rewriting.nudges {
        let given = nudge(&port.tensor);
        inputs.push(value_info(&given, Some(free_shape(&given, port.rank))));
        nudged.insert(&port.tensor, port);
    }

    for node in &graph.node {
        let mut node = node.clone();
        for name in &mut node.input {
            if let Some(other) = read.get(name.as_str()) {
                name.clone_from(other);
            }
        }
        let made: Vec<(&str, &Port)> = node
            .output
            .iter()
            .filter_map(|name| nudged.get_key_value(name.as_str()))
            .map(|(k, v)| (*k, *v))
            .collect();
        nodes.push(node);
        for (tensor, port) in made {
            let (given, sum) = (nudge(tensor), format!("nudged:{tensor}"));
            let term = if port.element == F32 { given } else { format!("typed:{given}") };
            if port.element != F32 {
                nodes.push(cast(&nudge(tensor), &term, port.element));
            }
            nodes.push(operator("Add", &[tensor, &term], &sum, vec![]));
            read.insert(tensor, sum);
        }
    }
    let mut outputs = Vec::new();
    let made: BTreeSet<&str> =
        nodes.iter().flat_map(|node: &NodeProto| &node.output).map(String::as_str).collect::<BTreeSet<_>>();
    let known = |name: &str| {
        made.contains(name)
            || constants.contains(name)
            || inputs.iter().any(|i| i.name.as_deref() == Some(name))
    };
    if let Some(missing) = rewriting.outputs.iter().find(|&&name| !known(name)) {
        return Err(format!("tensor \"{missing}\" is not made by the graph"));
    }
    for &tensor in rewriting.outputs {
        let source = read.get(tensor).map_or(tensor, String::as_str);
        nodes.push(cast(if rewriting.as_made { tensor } else { source }, &out(tensor), F32));
        outputs.push(value_info(&out(tensor), None));
    }

    let needed = needed(&nodes, rewriting.outputs);
    nodes.retain(|node| node.output.iter().any(|name| needed.contains(name)));
    inputs.retain(|input| input.name.as_ref().is_some_and(|name| needed.contains(name)));
    let initializer =
        graph.initializer.iter().filter(|t| t.name.as_ref().is_some_and(|n| needed.contains(n)));
    let rewritten = GraphProto {
        node: nodes,
        name: graph.name.clone(),
        initializer: initializer.cloned().collect(),
        input: inputs,
        output: outputs,
        ..Default::default()
    };
    let model = ModelProto { graph: Some(rewritten), ..model_without_graph(model) };
    Ok(model.encode_to_vec())
}

/// Everything of a file but its graph and its properties.
fn model_without_graph(model: &ModelProto) -> ModelProto {
    ModelProto { graph: None, metadata_props: Vec::new(), ..model.clone() }
}

/// Names of all tensors from which the outputs are computed.
fn needed(nodes: &[NodeProto], outputs: &[&str]) -> BTreeSet<String> {
    let mut needed: BTreeSet<String> = outputs.iter().map(|name| out(name)).collect();
    for node in nodes.iter().rev() {
        if node.output.iter().any(|name| needed.contains(name)) {
            needed.extend(node.input.iter().filter(|name| !name.is_empty()).cloned());
        }
    }
    needed
}

/// A Cast to the element type of this number.
pub fn cast(from: &str, to: &str, element: i32) -> NodeProto {
    operator("Cast", &[from], to, vec![int("to", element.into())])
}

/// A node of ONNX's own operators with one output, named after it.
pub fn operator(operator: &str, inputs: &[&str], output: &str, attribute: Vec<AttributeProto>) -> NodeProto {
    NodeProto {
        input: inputs.iter().map(|&name| name.to_owned()).collect(),
        output: vec![output.to_owned()],
        name: Some(format!("make:{output}")),
        op_type: Some(operator.to_owned()),
        attribute,
        ..Default::default()
    }
}

fn value_info(name: &str, shape: Option<TensorShapeProto>) -> ValueInfoProto {
    let tensor = TensorTypeProto { elem_type: Some(F32), shape };
    ValueInfoProto {
        name: Some(name.to_owned()),
        r#type: Some(TypeProto { tensor_type: Some(tensor), ..Default::default() }),
        ..Default::default()
    }
}

/// So many free sides of a tensor, each of a name of its own: two sides of one name would have to be equally long.
fn free_shape(name: &str, rank: usize) -> TensorShapeProto {
    let symbol = |axis| DimensionProto {
        value: Some(DimensionValue::Symbol(format!("{name}/axis{axis}"))),
        ..Default::default()
    };
    TensorShapeProto { dim: (0..rank).map(symbol).collect() }
}

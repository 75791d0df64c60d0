//! The structure of a graph: every tensor has one maker, and every node stands behind those that it reads.

use std::collections::{HashMap, HashSet};

use super::message::{AttributeProto, GraphProto, NodeProto};

/// What is wrong with a graph, and where.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Flaw {
    /// The part of the graph.
    pub item: String,
    /// What was found and what was expected.
    pub message: String,
}

impl Flaw {
    pub fn new(item: impl Into<String>, message: impl Into<String>) -> Self {
        Self { item: item.into(), message: message.into() }
    }
}

/// A name from a file as it may stand in a message of one line.
pub(super) fn quoted(name: &str) -> String {
    const LONGEST: usize = 80;
    let cut = if name.chars().nth(LONGEST).is_some() { "…" } else { "" };
    let shown: String = name.chars().take(LONGEST).flat_map(char::escape_debug).collect();
    format!("\"{shown}{cut}\"")
}

/// A node by its name or its place, and its operator.
pub(super) fn label(place: usize, node: &NodeProto) -> String {
    let operator = node.op_type.as_deref().unwrap_or("without operator");
    match node.name.as_deref() {
        Some(name) if !name.is_empty() => format!("node {} ({operator})", quoted(name)),
        _ => format!("node {place} ({operator})"),
    }
}

/// The names of all tensors that a node reads: its operands, and what its subgraphs take from the graph around them.
pub fn reads(node: &NodeProto) -> Vec<&str> {
    let operands = node.input.iter().map(String::as_str).filter(|name| !name.is_empty());
    operands.chain(subgraphs(&node.attribute).flat_map(captured)).collect()
}

fn subgraphs(attributes: &[AttributeProto]) -> impl Iterator<Item = &GraphProto> {
    attributes.iter().flat_map(|attribute| attribute.g.as_deref().into_iter().chain(&attribute.graphs))
}

/// What a subgraph reads and does not make.
fn captured(graph: &GraphProto) -> Vec<&str> {
    let inputs = graph.input.iter().filter_map(|value| value.name.as_deref());
    let made = graph.node.iter().flat_map(|node| node.output.iter().map(String::as_str));
    let own: HashSet<&str> = inputs.chain(constants(graph)).chain(made).collect();
    graph.node.iter().flat_map(reads).filter(|name| !own.contains(name)).collect()
}

fn constants(graph: &GraphProto) -> impl Iterator<Item = &str> {
    let sparse = graph.sparse_initializer.iter().filter_map(|tensor| tensor.values.as_ref());
    graph.initializer.iter().chain(sparse).map(|tensor| tensor.name.as_deref().unwrap_or_default())
}

/// Who makes a tensor.
#[derive(Clone, Copy, PartialEq)]
enum Maker {
    Input,
    Constant,
    Node(usize),
}

/// Checks a graph in time proportional to its size.
///
/// # Errors
/// Names the tensor that is made twice, by nobody or too late, and the nodes around a cycle.
pub(super) fn check(graph: &GraphProto) -> Result<(), Flaw> {
    let mut makers: HashMap<&str, Maker> = HashMap::new();
    for input in &graph.input {
        let name = input.name.as_deref().unwrap_or_default();
        if name.is_empty() || makers.insert(name, Maker::Input).is_some() {
            let why = if name.is_empty() { "has no name" } else { "its name is used twice" };
            return Err(Flaw::new(format!("input {}", quoted(name)), why));
        }
    }
    for name in constants(graph) {
        // A constant may also be an input, whose default it then is.
        if name.is_empty() || makers.insert(name, Maker::Constant) == Some(Maker::Constant) {
            let why = if name.is_empty() { "has no name" } else { "its name is used twice" };
            return Err(Flaw::new(format!("initializer {}", quoted(name)), why));
        }
    }
    for (place, node) in graph.node.iter().enumerate() {
        for name in node.output.iter().map(String::as_str).filter(|name| !name.is_empty()) {
            if let Some(maker) = makers.insert(name, Maker::Node(place)) {
                let maker = match maker {
                    Maker::Input => "an input".to_owned(),
                    Maker::Constant => "an initializer".to_owned(),
                    Maker::Node(first) => label(first, &graph.node[first]),
                };
                let message = format!("makes {}, which {maker} is already; rename one", quoted(name));
                return Err(Flaw::new(label(place, node), message));
            }
        }
    }
    for (place, node) in graph.node.iter().enumerate() {
        for name in reads(node) {
            match makers.get(name) {
                None => {
                    let message = format!("reads {}, which no input, initializer or node is", quoted(name));
                    return Err(Flaw::new(label(place, node), message));
                }
                Some(Maker::Node(maker)) if *maker >= place => {
                    return Err(match cycle(graph, &makers) {
                        Some(flaw) => flaw,
                        None => {
                            let (name, maker) = (quoted(name), label(*maker, &graph.node[*maker]));
                            let message = format!("reads {name} before {maker} makes it; sort the nodes");
                            Flaw::new(label(place, node), message)
                        }
                    });
                }
                Some(_) => {}
            }
        }
    }
    match graph
        .output
        .iter()
        .filter_map(|value| value.name.as_deref())
        .find(|name| !makers.contains_key(name))
    {
        Some(name) => Err(Flaw::new(format!("output {}", quoted(name)), "is made by no node")),
        None => Ok(()),
    }
}

/// Nodes that read each other around, if there are any.
fn cycle(graph: &GraphProto, makers: &HashMap<&str, Maker>) -> Option<Flaw> {
    let before = |place: usize| {
        reads(&graph.node[place]).into_iter().filter_map(|name| match makers.get(name) {
            Some(&Maker::Node(maker)) => Some(maker),
            _ => None,
        })
    };
    // Nodes whose operands are all made, again and again, until only those around and behind cycles are left.
    let mut open = vec![0_usize; graph.node.len()];
    let mut readers: Vec<Vec<usize>> = vec![Vec::new(); graph.node.len()];
    for (place, open) in open.iter_mut().enumerate() {
        for maker in before(place) {
            *open += 1;
            readers[maker].push(place);
        }
    }
    let mut ready: Vec<usize> = (0..open.len()).filter(|&place| open[place] == 0).collect();
    while let Some(place) = ready.pop() {
        for &reader in &readers[place] {
            open[reader] -= 1;
            if open[reader] == 0 {
                ready.push(reader);
            }
        }
    }
    // Each of those left reads another of them; going from one to the next must come back.
    let mut place = open.iter().position(|&open| open > 0)?;
    let mut met = HashMap::new();
    let mut path = Vec::new();
    while !met.contains_key(&place) {
        met.insert(place, path.len());
        path.push(place);
        place = before(place).find(|&maker| open[maker] > 0)?;
    }
    let around = &path[met[&place]..];
    let shown: Vec<String> =
        around.iter().rev().take(5).map(|&place| label(place, &graph.node[place])).collect();
    let more = if around.len() > shown.len() { " → …" } else { "" };
    let message = format!(
        "{} nodes read each other in a cycle: {}{more} → and again; no order of them can be computed",
        around.len(),
        shown.join(" → ")
    );
    Some(Flaw::new("graph", message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::message::ValueInfoProto;
    use crate::onnx::write::undeclared;

    fn node(inputs: &[&str], output: &str) -> NodeProto {
        NodeProto {
            input: inputs.iter().map(|&name| name.into()).collect(),
            output: vec![output.into()],
            op_type: Some("Add".into()),
            ..Default::default()
        }
    }

    fn graph(nodes: Vec<NodeProto>) -> GraphProto {
        let value = |name| -> Vec<ValueInfoProto> { vec![undeclared(name)] };
        GraphProto { node: nodes, input: value("x"), output: value("y"), ..Default::default() }
    }

    fn why(nodes: Vec<NodeProto>) -> String {
        let flaw = check(&graph(nodes)).expect_err("refused");
        format!("{}: {}", flaw.item, flaw.message)
    }

    #[test]
    fn each_flaw_is_named_with_its_tensor() {
        assert_eq!(check(&graph(vec![node(&["x", ""], "m"), node(&["m", "x"], "y")])), Ok(()));
        let unsorted = why(vec![node(&["m"], "y"), node(&["x"], "m")]);
        assert_eq!(unsorted, "node 0 (Add): reads \"m\" before node 1 (Add) makes it; sort the nodes");
        let cyclic = why(vec![node(&["x", "b"], "a"), node(&["a"], "b"), node(&["b"], "y")]);
        assert!(cyclic.starts_with("graph: 2 nodes read each other in a cycle: node "), "{cyclic}");
        let own = why(vec![node(&["y"], "y")]);
        assert!(own.contains("1 nodes read each other"), "{own}");
        let undefined = why(vec![node(&["z"], "y")]);
        assert_eq!(undefined, "node 0 (Add): reads \"z\", which no input, initializer or node is");
        let twice = why(vec![node(&["x"], "y"), node(&["x"], "y")]);
        assert_eq!(twice, "node 1 (Add): makes \"y\", which node 0 (Add) is already; rename one");
        assert_eq!(why(vec![node(&["x"], "m")]), "output \"y\": is made by no node");
        assert!(why(vec![node(&["x"], "x")]).contains("an input is already"), "an input is made again");
    }

    #[test]
    fn what_a_subgraph_takes_from_around_it_is_read_by_its_node() {
        let inner = GraphProto {
            node: vec![node(&["x", "inner"], "sum"), node(&["sum", "outer"], "result")],
            input: vec![undeclared("inner")],
            ..Default::default()
        };
        let attribute = AttributeProto { g: Some(Box::new(inner)), ..Default::default() };
        let mut branching = node(&["x"], "y");
        branching.attribute.push(attribute);
        assert_eq!(reads(&branching), ["x", "x", "outer"]);
        assert!(why(vec![branching]).contains("reads \"outer\""), "an undefined name inside");
    }

    #[test]
    fn a_name_in_a_message_is_one_short_line() {
        assert_eq!(quoted("a\nb"), "\"a\\nb\"");
        assert!(quoted(&"x".repeat(1000)).len() < 100);
    }
}

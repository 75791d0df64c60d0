//! Functions that a file brings along, written out where they are called.
//!
//! A function is an operator that is defined by a graph. PyTorch's newer exporter writes some, with attributes that are
//! filled in by the call. Inside, the names are the function's own; written out, a tensor `t` of the call that makes `y`
//! is named `y::t`.
//!
//! A function that is written in another version of ONNX's operators than the graph, or that has subgraphs, stays a call.

use std::collections::HashMap;

use prost::Message as _;

use super::message::{AttributeProto, FunctionProto, GraphProto, NodeProto, StringStringEntryProto};
use super::structure::{Flaw, label, quoted};

/// The most nodes that calls may become: functions that call functions grow without end.
const MOST_NODES: usize = 1 << 20;

/// The most bytes of a file that they may be.
const MOST_BYTES: usize = 1 << 28;

/// Functions may call each other as deep as this.
const DEEPEST: usize = 100;

/// Domain, name and overload.
type Key<'a> = (&'a str, &'a str, &'a str);

/// Nodes written out, and what may still be.
struct Writer<'a> {
    functions: HashMap<Key<'a>, &'a FunctionProto>,
    nodes: Vec<NodeProto>,
    nodes_left: usize,
    bytes_left: usize,
}

/// Writes out all calls of a graph whose operators are those of `opset`.
///
/// # Errors
/// When a function is defined twice, is called with too many operands or outputs, or calls grow without end.
pub(super) fn inline(graph: &mut GraphProto, functions: &[FunctionProto], opset: i64) -> Result<(), Flaw> {
    let mut by_name = HashMap::new();
    for function in functions {
        let key = key(&function.domain, &function.name, &function.overload);
        if by_name.insert(key, function).is_some() {
            return Err(Flaw::new(format!("function {}", quoted(key.1)), "is defined twice"));
        }
    }
    by_name.retain(|_, function| understood(function, opset));
    if by_name.is_empty() {
        return Ok(());
    }
    let mut writer =
        Writer { functions: by_name, nodes: Vec::new(), nodes_left: MOST_NODES, bytes_left: MOST_BYTES };
    for (place, node) in std::mem::take(&mut graph.node).into_iter().enumerate() {
        let name = label(place, &node);
        writer.write(node, 0).map_err(|message| Flaw::new(name, message))?;
    }
    graph.node = writer.nodes;
    Ok(())
}

fn key<'a>(domain: &'a Option<String>, name: &'a Option<String>, overload: &'a Option<String>) -> Key<'a> {
    let text = |text: &'a Option<String>| text.as_deref().unwrap_or_default();
    (text(domain), text(name), text(overload))
}

fn understood(function: &FunctionProto, opset: i64) -> bool {
    let own = |domain: &Option<String>| matches!(domain.as_deref(), None | Some("" | "ai.onnx"));
    let versions = function.opset_import.iter().filter(|set| own(&set.domain));
    let branching = |attribute: &AttributeProto| attribute.g.is_some() || !attribute.graphs.is_empty();
    versions.into_iter().all(|set| set.version == Some(opset))
        && !function.node.iter().any(|node| node.attribute.iter().any(branching))
}

impl Writer<'_> {
    /// A node, or what it stands for.
    fn write(&mut self, node: NodeProto, depth: usize) -> Result<(), String> {
        let Some(&function) = self.functions.get(&key(&node.domain, &node.op_type, &node.overload)) else {
            self.nodes.push(node);
            return Ok(());
        };
        let name = quoted(function.name.as_deref().unwrap_or_default());
        if depth == DEEPEST {
            return Err(format!("functions call each other deeper than {DEEPEST}, at last {name}"));
        }
        for inner in body(function, &node).map_err(|why| format!("function {name}: {why}"))? {
            self.nodes_left = self.nodes_left.saturating_sub(1);
            self.bytes_left = self.bytes_left.saturating_sub(inner.encoded_len());
            if self.nodes_left == 0 || self.bytes_left == 0 {
                return Err(format!(
                    "its functions would become more than {MOST_NODES} nodes or {MOST_BYTES} bytes, at {name}"
                ));
            }
            self.write(inner, depth + 1)?;
        }
        Ok(())
    }
}

/// A function's nodes with the call's names and attributes.
fn body<'a>(
    function: &'a FunctionProto,
    call: &'a NodeProto,
) -> Result<impl Iterator<Item = NodeProto> + 'a, String> {
    for (what, given, known) in
        [("operands", &call.input, &function.input), ("outputs", &call.output, &function.output)]
    {
        if given.len() > known.len() {
            return Err(format!("called with {} {what}, it has {}", given.len(), known.len()));
        }
    }
    let label = call.output.iter().find(|name| !name.is_empty()).cloned().unwrap_or_default();
    let mut outer: HashMap<&str, String> = HashMap::new();
    let given = |names: &'a [String], k: usize| names.get(k).filter(|name| !name.is_empty()).cloned();
    for (k, inner) in function.output.iter().enumerate() {
        if let Some(name) = given(&call.output, k) {
            outer.insert(inner, name);
        }
    }
    // An operand that is handed through to an output needs a node to do so.
    let mut handed = Vec::new();
    for (k, inner) in function.input.iter().enumerate() {
        let operand = given(&call.input, k).unwrap_or_default();
        if let Some(output) = outer.insert(inner, operand.clone()) {
            handed.push(NodeProto {
                input: vec![operand],
                output: vec![output],
                op_type: Some("Identity".into()),
                ..Default::default()
            });
        }
    }
    let renamed = move |name: &String| match outer.get(name.as_str()) {
        _ if name.is_empty() => String::new(),
        Some(name) => name.clone(),
        None => format!("{label}::{name}"),
    };
    let named = call.name.clone().unwrap_or_default();
    let nodes = function.node.iter().map(move |node| NodeProto {
        input: node.input.iter().map(&renamed).collect(),
        output: node.output.iter().map(&renamed).collect(),
        name: Some(format!("{named}/{}", node.name.as_deref().unwrap_or_default())),
        attribute: node.attribute.iter().filter_map(|given| attribute(given, function, call)).collect(),
        // Where the source is known only of the call, it is the source of all that the call stands for.
        doc_string: node.doc_string.clone().or_else(|| call.doc_string.clone()),
        metadata_props: properties(&node.metadata_props, &call.metadata_props),
        op_type: node.op_type.clone(),
        domain: node.domain.clone(),
        overload: node.overload.clone(),
        device_configurations: node.device_configurations.clone(),
    });
    Ok(nodes.chain(handed))
}

/// An attribute with the value that the call gives it, or the function's default; `None` where neither does.
fn attribute(given: &AttributeProto, function: &FunctionProto, call: &NodeProto) -> Option<AttributeProto> {
    let Some(reference) = given.ref_attr_name.as_deref().filter(|name| !name.is_empty()) else {
        return Some(given.clone());
    };
    let value = call.attribute.iter().chain(&function.attribute_proto);
    let value = value.into_iter().find(|attribute| attribute.name.as_deref() == Some(reference))?;
    Some(AttributeProto { name: given.name.clone(), ..value.clone() })
}

fn properties(
    own: &[StringStringEntryProto],
    call: &[StringStringEntryProto],
) -> Vec<StringStringEntryProto> {
    let more = call.iter().filter(|entry| own.iter().all(|own| own.key != entry.key));
    own.iter().chain(more).cloned().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::{float, int};
    use crate::onnx::message::OperatorSetIdProto;

    fn node(operator: &str, domain: &str, inputs: &[&str], outputs: &[&str]) -> NodeProto {
        NodeProto {
            input: inputs.iter().map(|&name| name.into()).collect(),
            output: outputs.iter().map(|&name| name.into()).collect(),
            op_type: Some(operator.into()),
            domain: Some(domain.into()),
            ..Default::default()
        }
    }

    fn function(name: &str, inputs: &[&str], outputs: &[&str], nodes: Vec<NodeProto>) -> FunctionProto {
        FunctionProto {
            name: Some(name.into()),
            domain: Some("local".into()),
            input: inputs.iter().map(|&name| name.into()).collect(),
            output: outputs.iter().map(|&name| name.into()).collect(),
            node: nodes,
            opset_import: vec![OperatorSetIdProto { domain: None, version: Some(20) }],
            ..Default::default()
        }
    }

    fn referring(name: &str, to: &str) -> AttributeProto {
        AttributeProto { ref_attr_name: Some(to.into()), ..float(name, 0.0) }
    }

    /// local.slope(x): LeakyRelu with alpha = slope, 0.5 by default; local.twice(x) = slope(slope(x)).
    fn functions() -> Vec<FunctionProto> {
        let mut leaky = node("LeakyRelu", "", &["x"], &["y"]);
        leaky.attribute.push(referring("alpha", "slope"));
        let mut slope = function("slope", &["x"], &["y"], vec![leaky]);
        slope.attribute_proto.push(float("slope", 0.5));
        let mut first = node("slope", "local", &["x"], &["m"]);
        first.attribute.push(float("slope", 0.25));
        let second = node("slope", "local", &["m"], &["y"]);
        vec![slope, function("twice", &["x"], &["y"], vec![first, second])]
    }

    fn inlined(nodes: Vec<NodeProto>, functions: &[FunctionProto]) -> Result<Vec<NodeProto>, Flaw> {
        let mut graph = GraphProto { node: nodes, ..Default::default() };
        inline(&mut graph, functions, 20).map(|()| graph.node)
    }

    #[test]
    fn calls_are_written_out_with_their_names_and_attributes() {
        let nodes = inlined(vec![node("twice", "local", &["image"], &["result"])], &functions());
        let nodes = nodes.expect("nodes");
        let seen: Vec<_> = nodes
            .iter()
            .map(|node| (&node.input[0][..], &node.output[0][..], node.attribute[0].f.expect("a number")))
            .collect();
        assert_eq!(seen, [("image", "result::m", 0.25), ("result::m", "result", 0.5)]);
        assert!(nodes.iter().all(|node| node.op_type.as_deref() == Some("LeakyRelu")));
    }

    #[test]
    fn an_operand_handed_through_is_an_identity_and_one_left_out_stays_out() {
        let clip = node("Clip", "", &["x", "low"], &["y"]);
        let both = function("both", &["x", "low"], &["x", "y"], vec![clip]);
        let nodes = inlined(vec![node("both", "local", &["a"], &["b", "c"])], &[both]).expect("nodes");
        assert_eq!(
            (&nodes[0].input[..], &nodes[0].output[..]),
            (&["a".into(), String::new()][..], &["c".into()][..])
        );
        assert_eq!(nodes[1].op_type.as_deref(), Some("Identity"));
        assert_eq!((&nodes[1].input[0][..], &nodes[1].output[0][..]), ("a", "b"));
    }

    #[test]
    fn functions_that_grow_without_end_are_refused_by_name() {
        let call = |name: &str| node(name, "local", &["x"], &["y"]);
        let own = function("own", &["x"], &["y"], vec![call("own")]);
        let flaw = inlined(vec![call("own")], &[own]).expect_err("refused");
        assert!(flaw.message.contains("deeper than 100, at last \"own\""), "{}", flaw.message);
        // Ten calls of ten calls of … of nothing.
        let level = |k: usize| {
            let nodes = if k == 0 { Vec::new() } else { vec![call(&format!("f{}", k - 1)); 10] };
            function(&format!("f{k}"), &["x"], &["y"], nodes)
        };
        let many: Vec<_> = (0..12).map(level).collect();
        let flaw = inlined(vec![call("f11")], &many).expect_err("refused");
        assert!(flaw.message.contains("1048576 nodes"), "{}", flaw.message);
        let mut two = call("slope");
        two.input.push("b".into());
        let flaw = inlined(vec![two], &functions()).expect_err("refused");
        assert!(flaw.message.contains("called with 2 operands, it has 1"), "{}", flaw.message);
    }

    #[test]
    fn what_is_not_understood_stays_a_call() {
        let mut other = functions();
        other[0].opset_import[0].version = Some(18);
        let mut kept = node("slope", "local", &["x"], &["y"]);
        kept.attribute.push(int("slope", 1));
        assert_eq!(inlined(vec![kept.clone()], &other), Ok(vec![kept]));
    }
}

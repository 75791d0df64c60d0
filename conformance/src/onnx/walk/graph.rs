//! A whole graph by the reference, node after node.

use std::collections::BTreeMap;

use vitruvian_reference::nn::Scalar;

use super::{Value, evaluate};
use crate::onnx::message::{GraphProto, NodeProto};
use crate::onnx::typed_tensor::TypedTensor;

/// The tensors that a graph can name: its own, and those of the graphs around it.
struct Scope<'a, T> {
    own: BTreeMap<&'a str, Value<T>>,
    around: Option<&'a Scope<'a, T>>,
}

impl<T> Scope<'_, T> {
    fn find(&self, name: &str) -> Option<&Value<T>> {
        self.own.get(name).or_else(|| self.around?.find(name))
    }
}

/// The outputs of a graph, and with `see` every tensor on the way. Of the operators with subgraphs, If is understood.
///
/// An input that is not given has the value of the initializer of its name.
///
/// # Errors
/// When an input or an operand is missing, an initializer cannot be read, or as [`evaluate`]; names the node or tensor.
pub fn evaluate_graph<T: Scalar>(
    graph: &GraphProto,
    opset: i64,
    inputs: &BTreeMap<String, Value<T>>,
    see: &mut dyn FnMut(&Value<T>),
) -> Result<Vec<Value<T>>, String> {
    let given = inputs.iter().map(|(name, value)| (name.as_str(), value.clone())).collect();
    run(graph, opset, given, None, see)
}

fn run<'a, T: Scalar>(
    graph: &'a GraphProto,
    opset: i64,
    mut own: BTreeMap<&'a str, Value<T>>,
    around: Option<&'a Scope<'a, T>>,
    see: &mut dyn FnMut(&Value<T>),
) -> Result<Vec<Value<T>>, String> {
    for tensor in &graph.initializer {
        let name = tensor.name.as_deref().unwrap_or_default();
        if !own.contains_key(name) {
            let value = TypedTensor::read(tensor).and_then(|tensor| Value::of(&tensor));
            own.insert(name, value.map_err(|why| format!("initializer \"{name}\": {why}"))?);
        }
    }
    let mut scope = Scope { own, around };
    for node in &graph.node {
        let outputs = outputs_of(node, opset, &scope, see)?;
        for (name, value) in node.output.iter().zip(outputs) {
            if let Some(value) = value {
                see(&value);
                scope.own.insert(name, value);
            }
        }
    }
    let outputs = graph.output.iter().map(|output| output.name.as_deref().unwrap_or_default());
    outputs.map(|name| found(&scope, name).cloned()).collect()
}

fn outputs_of<T: Scalar>(
    node: &NodeProto,
    opset: i64,
    scope: &Scope<T>,
    see: &mut dyn FnMut(&Value<T>),
) -> Result<Vec<Option<Value<T>>>, String> {
    let operand = |name: &String| (!name.is_empty()).then(|| found(scope, name)).transpose();
    let operands: Vec<Option<&Value<T>>> = node.input.iter().map(operand).collect::<Result<_, _>>()?;
    if node.op_type.as_deref() != Some("If") {
        return evaluate(node, opset, &operands);
    }
    let condition = operands.first().copied().flatten().ok_or("If: operand 0 is missing")?.truths()?;
    let &[condition] = &condition.data[..] else {
        return Err(format!("If: the condition has shape {:?}, one truth was expected", condition.shape));
    };
    let branch = if condition { "then_branch" } else { "else_branch" };
    let graph = node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(branch));
    let graph = graph.and_then(|attribute| attribute.g.as_deref());
    let graph = graph.ok_or_else(|| format!("If: attribute \"{branch}\" holds no graph"))?;
    let outputs = run(graph, opset, BTreeMap::new(), Some(scope), see)?;
    if outputs.len() != node.output.len() {
        return Err(format!("If: {branch} has {} outputs, the node {}", outputs.len(), node.output.len()));
    }
    Ok(outputs.into_iter().map(Some).collect())
}

fn found<'a, T>(scope: &'a Scope<T>, name: &str) -> Result<&'a Value<T>, String> {
    scope.find(name).ok_or_else(|| format!("tensor \"{name}\" is made by no node before its reader"))
}

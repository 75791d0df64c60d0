//! A graph by the reference: every node in f64 from the node before.

use std::collections::BTreeMap;

use vitruvian_reference::nn::Tensor;

use super::flow::{Flow, fault};
use super::geometry::Outputs;
use super::runner::Arrays;
use crate::error::Result;
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::walk::{self, Value};

/// The graph's outputs on these inputs, with no rounding but that of f64 and of the graph's own casts.
///
/// # Errors
/// When the reference does not know a node or a constant; names it.
pub fn outputs(flow: &Flow, inputs: &Arrays) -> Result<Outputs> {
    let about = |message: String| fault(&flow.name, message);
    let mut values: BTreeMap<&str, Value> = BTreeMap::new();
    let graph = flow.model.graph.as_ref();
    for tensor in graph.into_iter().flat_map(|graph| &graph.initializer) {
        let name = tensor.name.as_deref().unwrap_or_default();
        let value = TypedTensor::read(tensor).and_then(|constant| Value::of(&constant));
        values.insert(name, value.map_err(|why| about(format!("initializer \"{name}\" {why}")))?);
    }
    for name in &flow.inputs {
        let array = inputs.get(name).ok_or_else(|| about(format!("input \"{name}\" is not given")))?;
        let numbers =
            Tensor::new(&array.shape, array.values.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>());
        let element = flow.input_element(name).unwrap_or(ElementType::F32);
        values.insert(
            name,
            value_of(element, numbers).map_err(|why| about(format!("input \"{name}\" {why}")))?,
        );
    }
    let mut readers: BTreeMap<&str, usize> = BTreeMap::new();
    for name in flow.nodes().iter().flat_map(|node| &node.input).chain(&flow.outputs) {
        *readers.entry(name).or_default() += 1;
    }
    for (place, node) in flow.nodes().iter().enumerate() {
        let operands: Vec<Option<&Value>> = node.input.iter().map(|name| values.get(name.as_str())).collect();
        let made = walk::evaluate(node, flow.opset(), &operands)
            .map_err(|why| about(format!("node \"{}\": {why}", flow.node_name(place))))?;
        // A tensor is dropped once its last reader has run.
        for name in &node.input {
            if let Some(left) = readers.get_mut(name.as_str()) {
                *left -= 1;
                if *left == 0 {
                    values.remove(name.as_str());
                }
            }
        }
        values.extend(node.output.iter().zip(made).filter_map(|(name, value)| Some((name.as_str(), value?))));
    }
    flow.outputs
        .iter()
        .map(|name| {
            let value =
                values.get(name.as_str()).ok_or_else(|| about(format!("output \"{name}\" is not made")))?;
            let numbers = numbers_of(value).map_err(|why| about(format!("output \"{name}\" {why}")))?;
            Ok((name.clone(), numbers))
        })
        .collect()
}

/// Numbers as an input of this type holds them: rounded to it.
fn value_of(element: ElementType, numbers: Tensor) -> std::result::Result<Value, String> {
    match element {
        ElementType::Bool => Ok(Value::from_truths(numbers.map(|x| x != 0.0))),
        _ if element.is_float() => Ok(Value::from_numbers(element, numbers.map(|x| element.round(x)))),
        _ => Value::from_integers(element, numbers.map(|x| x as i64)),
    }
}

/// What a value holds, as numbers.
fn numbers_of(value: &Value) -> std::result::Result<Tensor, String> {
    match (value.numbers(), value.integers(), value.truths()) {
        (Ok(numbers), ..) => Ok(numbers.clone()),
        (_, Ok(integers), _) => Ok(integers.map(|i| i as f64)),
        (.., Ok(truths)) => Ok(truths.map(|t| f64::from(u8::from(t)))),
        (Err(why), ..) => Err(why),
    }
}

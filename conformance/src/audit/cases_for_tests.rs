//! Nodes with drawn operands and the reference's own outputs, for the laws of what is told about a node.

use vitruvian_reference::nn::Rounded;

use super::case::Case;
use super::findings::rounded;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::Value;
use crate::onnx::walk;
use crate::suite::audit_faults::scenes::drawn;

/// An operand of drawn numbers.
pub fn numbers(name: &str, shape: &[usize]) -> Option<TypedTensor> {
    TypedTensor::new(shape, Elements::F32(drawn(name, shape))).ok()
}

/// An operand of these numbers.
pub fn given(numbers: &[f32]) -> Option<TypedTensor> {
    TypedTensor::new(&[numbers.len()], Elements::F32(numbers.to_vec())).ok()
}

/// An operand of integers.
pub fn list(integers: &[i64]) -> Option<TypedTensor> {
    TypedTensor::new(&[integers.len()], Elements::I64(integers.to_vec())).ok()
}

/// An operand of drawn bytes, with a sign or without.
pub fn drawn_bytes(name: &str, shape: &[usize], signed: bool) -> Option<TypedTensor> {
    let levels = drawn(name, shape).into_iter().map(|x| 60.0 * x);
    let elements = match signed {
        true => Elements::I8(levels.map(|x| x as i8).collect()),
        false => Elements::U8(levels.map(|x| (128.0 + x) as u8).collect()),
    };
    TypedTensor::new(shape, elements).ok()
}

/// An operand of one number.
pub fn one(number: f32) -> Option<TypedTensor> {
    TypedTensor::new(&[], Elements::F32(vec![number])).ok()
}

/// An operand of one byte.
pub fn byte(byte: u8) -> Option<TypedTensor> {
    TypedTensor::new(&[], Elements::U8(vec![byte])).ok()
}

/// A node with one output, right.
pub fn case(operator: &str, operands: Vec<Option<TypedTensor>>, attributes: Vec<AttributeProto>) -> Case {
    let names = ["X", "W", "B", "C", "D", "E", "F", "G", "H"];
    let input =
        operands.iter().zip(names).map(|(o, name)| if o.is_some() { name.into() } else { String::new() });
    let node = NodeProto {
        input: input.collect(),
        output: vec!["Y".into()],
        op_type: Some(operator.into()),
        attribute: attributes,
        ..Default::default()
    };
    let mut case = Case { node, opset: 21, name: operator.into(), operands, found: vec![None] };
    case.found = vec![output(&case)];
    case
}

/// The first output, rounded to its type.
pub fn output(case: &Case) -> Option<TypedTensor> {
    let value = |operand: &Option<TypedTensor>| operand.as_ref().map(|o| Value::of(o).expect("a value"));
    let operands: Vec<Option<Value<Rounded>>> = case.operands.iter().map(value).collect();
    let operands: Vec<_> = operands.iter().map(Option::as_ref).collect();
    let outputs = walk::evaluate(&case.node, case.opset, &operands).unwrap_or_else(|why| panic!("{why}"));
    outputs[0].as_ref().and_then(rounded)
}

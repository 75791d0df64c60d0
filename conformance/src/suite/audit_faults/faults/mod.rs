//! The mistakes that are planted, and the name that each must be given.

use std::sync::Arc;

use super::scenes::Scene;
use crate::array::Array;
use crate::audit::party::{Held, Tensors};
use crate::onnx::element::ElementType;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};

mod changes;
mod elsewhere;
mod functions;
mod large;
mod movements;
mod normalisations;
mod precision;
mod quantisation;
mod sampling;
mod windows;

/// A mistake in one node.
pub struct Fault {
    /// What is wrong.
    pub name: &'static str,
    /// The name that the hypothesis engine must give it.
    pub hypothesis: &'static str,
    /// The graph.
    pub scene: fn() -> Scene,
    /// The output of the node in which the mistake is made.
    pub output: &'static str,
    plant: Plant,
}

/// How a mistake is made.
enum Plant {
    /// The node has other attributes.
    Attributes(fn() -> Vec<AttributeProto>),
    /// The node is another.
    Node(fn(NodeProto) -> NodeProto),
    /// An operand is another.
    Operand(usize, fn(Array) -> Array),
    /// An operand is another, and so are attributes.
    Both(usize, fn(Array) -> Array, fn() -> Vec<AttributeProto>),
    /// All operands that are numbers are other numbers.
    Numbers(fn(f32) -> f32),
    /// The output is another.
    Output(fn(Array) -> Array),
    /// The output is made of the operands, not by the node.
    Made(fn(Vec<Array>) -> Array),
    /// The output is another tensor's.
    Stale(&'static str),
}

impl Fault {
    /// The node as the engine reads it.
    pub(super) fn change_node(&self, node: NodeProto) -> NodeProto {
        let with = |new: Vec<AttributeProto>| {
            let mut node = node.clone();
            node.attribute.retain(|old| new.iter().all(|new| new.name != old.name));
            node.attribute.extend(new);
            node
        };
        match self.plant {
            Plant::Attributes(attributes) | Plant::Both(_, _, attributes) => with(attributes()),
            Plant::Node(change) => change(node),
            _ => node,
        }
    }

    /// The operands as the engine has them at the node.
    pub(super) fn change_operands(&self, node: &NodeProto, held: &mut Tensors) {
        let mut change = |name: &String, change: &dyn Fn(Array) -> Array| {
            let new = match held.get(name) {
                Some(Held::Given(tensor) | Held::Constant(tensor)) => {
                    array(tensor).map(|x| typed(change(x), tensor.element()))
                }
                _ => None,
            };
            if let Some(new) = new {
                held.insert(name.clone(), Held::Given(Arc::new(new)));
            }
        };
        match self.plant {
            Plant::Operand(place, with) | Plant::Both(place, with, _) => change(&node.input[place], &with),
            Plant::Numbers(with) => node.input.iter().for_each(|name| change(name, &|x: Array| x.map(with))),
            _ => {}
        }
    }

    /// The output as the engine leaves it.
    pub(super) fn change_output(&self, tensor: TypedTensor, node: &NodeProto, held: &Tensors) -> TypedTensor {
        let of = |name: &str| match held.get(name) {
            Some(Held::Given(tensor) | Held::Constant(tensor)) => array(tensor),
            _ => None,
        };
        let changed = match self.plant {
            Plant::Output(change) => array(&tensor).map(change),
            Plant::Made(make) => Some(make(node.input.iter().filter_map(|name| of(name)).collect())),
            Plant::Stale(name) => of(name).map(|other| Array { shape: tensor.shape.clone(), ..other }),
            _ => None,
        };
        let element = tensor.element();
        changed.map_or(tensor, |array| typed(array, element))
    }
}

/// Any tensor as numbers: the integers of the scenes are short enough.
fn array(tensor: &TypedTensor) -> Option<Array> {
    let values = match Value::<f64>::of(tensor).ok()?.data {
        Data::Numbers(x) => x.data.iter().map(|&x| x as f32).collect(),
        Data::Integers(x) => x.data.iter().map(|&i| i as f32).collect(),
        Data::Truths(_) => return None,
    };
    Some(Array { shape: tensor.shape.clone(), values })
}

/// The numbers in a tensor's type; what is beyond a type of integers wraps around.
fn typed(array: Array, element: ElementType) -> TypedTensor {
    let whole = || array.values.iter().map(|&x| x as i64);
    let elements = match element {
        ElementType::I8 => Elements::I8(whole().map(|i| i as i8).collect()),
        ElementType::U8 => Elements::U8(whole().map(|i| i as u8).collect()),
        ElementType::I32 => Elements::I32(whole().map(|i| i as i32).collect()),
        ElementType::I64 => Elements::I64(whole().collect()),
        _ => Elements::F32(array.values),
    };
    TypedTensor { shape: array.shape, elements }
}

const fn attributes(
    name: &'static str,
    hypothesis: &'static str,
    (scene, output): (fn() -> Scene, &'static str),
    attributes: fn() -> Vec<AttributeProto>,
) -> Fault {
    Fault { name, hypothesis, scene, output, plant: Plant::Attributes(attributes) }
}

const fn operand(
    name: &'static str,
    hypothesis: &'static str,
    (scene, output): (fn() -> Scene, &'static str),
    place: usize,
    change: fn(Array) -> Array,
) -> Fault {
    Fault { name, hypothesis, scene, output, plant: Plant::Operand(place, change) }
}

const fn fault(
    name: &'static str,
    hypothesis: &'static str,
    (scene, output): (fn() -> Scene, &'static str),
    plant: Plant,
) -> Fault {
    Fault { name, hypothesis, scene, output, plant }
}

const ELEVEN_BITS: &str = "reduced precision, 11 bits (f16 or tf32)";
const EIGHT_BITS: &str = "reduced precision, 8 bits (bf16)";

/// Every mistake that must be found at its node; the first families by the attribute, then by the numbers.
pub fn all() -> impl Iterator<Item = &'static Fault> {
    const FAMILIES: [&[Fault]; 9] = [
        sampling::FAULTS,
        windows::FAULTS,
        normalisations::FAULTS,
        functions::FAULTS,
        movements::FAULTS,
        quantisation::FAULTS,
        precision::FAULTS,
        elsewhere::FAULTS,
        large::FAULTS,
    ];
    FAMILIES.into_iter().flatten()
}

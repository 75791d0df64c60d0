//! One node as the second party ran it: what it was given and what it gave.

use vitruvian_reference::nn::Rounded;

use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::Value;

/// One node as the second party ran it: its own operands, its own outputs.
///
/// The operands are the second party's, so an error made in a node before this one is not counted here again.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The node.
    pub node: NodeProto,
    /// The version of ONNX's operators, which decides what the node means.
    pub opset: i64,
    /// The node's name, as reports give it.
    pub name: String,
    /// What it was given; `None` where an optional operand is left out.
    pub operands: Vec<Option<TypedTensor>>,
    /// What it gave; `None` where an output is not asked for, or was not kept.
    pub found: Vec<Option<TypedTensor>>,
}

impl Case {
    /// The case without its own copies.
    pub(super) fn view(&self) -> View<'_> {
        View {
            node: &self.node,
            opset: self.opset,
            operands: self.operands.iter().map(|operand| operand.as_ref().map(Operand::Given)).collect(),
            found: self.found.iter().map(Option::as_ref).collect(),
        }
    }
}

/// An operand: the second party's own numbers, or where it kept none the reference's, with what rounding may have made
/// of them.
#[derive(Clone, Copy, Debug)]
pub(super) enum Operand<'a> {
    Given(&'a TypedTensor),
    Derived(&'a Value<Rounded>),
}

impl Operand<'_> {
    pub fn shape(&self) -> &[usize] {
        match self {
            Self::Given(tensor) => &tensor.shape,
            Self::Derived(value) => value.shape(),
        }
    }
}

/// A case whose tensors lie elsewhere.
#[derive(Clone, Debug)]
pub(super) struct View<'a> {
    pub node: &'a NodeProto,
    pub opset: i64,
    pub operands: Vec<Option<Operand<'a>>>,
    pub found: Vec<Option<&'a TypedTensor>>,
}

impl View<'_> {
    /// The operator, such as `Conv`.
    pub fn operator(&self) -> &str {
        self.node.op_type.as_deref().unwrap_or_default()
    }
}

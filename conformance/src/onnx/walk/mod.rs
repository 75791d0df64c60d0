//! ONNX operators by the reference: a node and its operands in, its outputs out.
//!
//! This is a dictionary, from ONNX's operators and attributes to `vitruvian_reference::nn`; it computes nothing itself.
//! Generic over the number, like the reference: with `f64` it gives values, with `Rounded` also their bounds.
//!
//! | file | operators that |
//! |---|---|
//! | `layers` | have weights or windows: convolutions, pools, normalisations, products, reductions |
//! | `arithmetic` | compute element by element |
//! | `choice` | compare, cast and choose |
//! | `movement` | move elements and read shapes |
//!
//! Axes and other settings that newer versions of an operator take as an operand, and older ones as an attribute, are
//! understood in both ways.

use vitruvian_reference::nn::{Scalar, Tensor};

use super::attributes::Attributes;
use super::message::NodeProto;
pub use super::value::Value;

mod arithmetic;
mod choice;
mod layers;
mod movement;

/// A node with its operands, as the dictionary reads it.
struct Call<'a, T> {
    node: &'a NodeProto,
    operator: &'a str,
    operands: &'a [Option<&'a Value<T>>],
}

impl<'a, T: Scalar> Call<'a, T> {
    fn optional(&self, i: usize) -> Option<&'a Value<T>> {
        self.operands.get(i).copied().flatten()
    }

    fn operand(&self, i: usize) -> Result<&'a Value<T>, String> {
        self.optional(i).ok_or_else(|| format!("operand {i} is missing"))
    }

    fn numbers(&self, i: usize) -> Result<&'a Tensor<T>, String> {
        self.operand(i)?.numbers().map_err(|why| format!("operand {i} {why}"))
    }

    fn optional_numbers(&self, i: usize) -> Result<Option<&'a Tensor<T>>, String> {
        self.optional(i).map(|_| self.numbers(i)).transpose()
    }

    fn integers(&self, i: usize) -> Result<&'a Tensor<i64>, String> {
        self.operand(i)?.integers().map_err(|why| format!("operand {i} {why}"))
    }

    fn truths(&self, i: usize) -> Result<&'a Tensor<bool>, String> {
        self.operand(i)?.truths().map_err(|why| format!("operand {i} {why}"))
    }

    fn attributes(&self, known: &[&str]) -> Result<Attributes<'a>, String> {
        Attributes::of(self.node, known)
    }

    /// A list of integers that is operand `i`, or an attribute of the operator's older versions.
    fn list(&self, i: usize, attributes: Attributes, name: &str) -> Result<Option<Vec<i64>>, String> {
        match self.optional(i) {
            Some(_) => Ok(Some(self.integers(i)?.data.clone())),
            None => Ok(attributes.integers(name)),
        }
    }
}

/// A node's outputs, of those that are tensors of the values computed (not the masks and indices beside them); optional
/// operands that are left out are `None`.
///
/// # Errors
/// When the operator, an attribute or an operand's kind is not understood.
///
/// # Panics
/// When the operands' shapes do not fit, as the reference's operators do.
pub fn evaluate<T: Scalar>(
    node: &NodeProto,
    operands: &[Option<&Value<T>>],
) -> Result<Vec<Value<T>>, String> {
    let operator = node.op_type.as_deref().unwrap_or_default();
    if !matches!(node.domain.as_deref(), None | Some("" | "ai.onnx")) {
        return Err(format!("operator {operator} of domain {:?} is not known to the judge", node.domain));
    }
    let call = Call { node, operator, operands };
    let families = [layers::evaluate, arithmetic::evaluate, choice::evaluate, movement::evaluate];
    for family in families {
        if let Some(outputs) = family(&call) {
            return outputs.map_err(|why| format!("{operator}: {why}"));
        }
    }
    Err(format!("operator {operator} is not known to the judge"))
}

/// What a family says of a node: nothing if it is another's, else its outputs or what is not understood.
type Answer<T> = Option<Result<Vec<Value<T>>, String>>;

/// A negative axis or place counts from the end.
fn axis(axis: i64, length: usize) -> Result<usize, String> {
    let from_start = if axis < 0 { axis + length as i64 } else { axis };
    usize::try_from(from_start)
        .ok()
        .filter(|&a| a < length)
        .ok_or_else(|| format!("axis or index {axis} does not lie in a length of {length}"))
}

fn axes(axes: &[i64], rank: usize) -> Result<Vec<usize>, String> {
    axes.iter().map(|&a| axis(a, rank)).collect()
}

/// A list of lengths that must not be negative.
fn lengths(list: &[i64]) -> Result<Vec<usize>, String> {
    list.iter()
        .map(|&n| usize::try_from(n).map_err(|_| format!("{list:?} holds {n}, a length was expected")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::{GraphBuilder, int};
    use crate::onnx::model::Model;

    pub(super) fn node(operator: &str, attributes: Vec<crate::onnx::message::AttributeProto>) -> NodeProto {
        let bytes =
            GraphBuilder::new(21).input("x", &[1]).node(operator, &["x"], &["y"], attributes).output("y");
        Model::from_bytes("node", bytes.to_bytes()).expect("a model").nodes()[0].clone()
    }

    #[test]
    fn what_is_not_understood_is_refused_by_name() {
        let x: Value = Value::Numbers(Tensor::new(&[2], vec![1.0, 2.0]));
        let why = |node: &NodeProto| evaluate(node, &[Some(&x)]).expect_err("refused");
        let unknown = why(&node("Erf", vec![]));
        assert!(unknown.contains("operator Erf"), "{unknown}");
        let attribute = why(&node("LeakyRelu", vec![int("beta", 1)]));
        assert!(attribute.contains("LeakyRelu: attribute \"beta\""), "{attribute}");
        let missing = why(&node("Add", vec![]));
        assert!(missing.contains("Add: operand 1 is missing"), "{missing}");
        let mut foreign = node("Relu", vec![]);
        foreign.domain = Some("com.microsoft".into());
        let domain = why(&foreign);
        assert!(domain.contains("com.microsoft"), "{domain}");
    }
}

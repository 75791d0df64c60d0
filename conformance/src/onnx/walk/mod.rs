//! ONNX operators by the reference: a node and its operands in, its outputs out.
//!
//! This is a dictionary, from ONNX's operators and attributes to `vitruvian_reference::nn`; it computes nothing itself.
//! Generic over the number, like the reference: with `f64` it gives values, with `Rounded` also their bounds.
//!
//! | file | operators that |
//! |---|---|
//! | `convolution`, `pooling` | have windows; what these have in common is in `window` |
//! | `resampling` | read an image between its pixels |
//! | `padding` | add and cut borders, and turn pixels into channels |
//! | `functions` | are functions of one number, and activations |
//! | `arithmetic` | add, multiply and choose, element by element |
//! | `reductions` | run over axes: sums, means, extrema, softmax |
//! | `normalizations` | normalise |
//! | `products` | multiply matrices and tensors |
//! | `attention` | attend to tokens |
//! | `recurrent`, `causal_convolution` | are layers with a state |
//! | `losses` | measure how likely classes are |
//! | `signals` | transform signals |
//! | `bits` | work on the bits of integers |
//! | `boxes` | choose among boxes |
//! | `cast` | change the element type |
//! | `choice` | compare, combine truths and choose |
//! | `creation` | make tensors of shapes, patterns and constants |
//! | `indexing` | pick elements by their places, and put others into theirs |
//! | `movement` | move elements and change nothing else |
//! | `quantization` | work on quantised numbers |
//! | `microsoft` | are none of ONNX's own but of ONNX Runtime's domain `com.microsoft` |
//!
//! `graph` runs a whole graph; `refusal` turns the reference's panics into errors.
//!
//! Axes and other settings that newer versions of an operator take as an operand, and older ones as an attribute, are
//! understood in both ways.

use std::ops::RangeInclusive;

use vitruvian_reference::nn::{Scalar, Tensor};

pub use self::graph::evaluate_graph;
pub(crate) use self::refusal::caught;
use super::attributes::Attributes;
use super::element::ElementType;
use super::message::NodeProto;
pub use super::value::{Data, Value};

mod arithmetic;
mod attention;
mod bits;
mod boxes;
mod cast;
mod causal_convolution;
mod choice;
mod convolution;
mod creation;
mod functions;
mod graph;
mod indexing;
mod losses;
mod microsoft;
mod movement;
mod normalizations;
mod padding;
mod pooling;
mod products;
mod quantization;
mod recurrent;
mod reductions;
mod refusal;
mod resampling;
mod signals;
mod window;

/// The most elements that an output may have: 2²⁸, which take 6 GB with their bounds.
pub const LARGEST: usize = 1 << 28;

/// The versions of ONNX's operators whose meaning is known here.
///
/// Those of opset 6 mean what they mean in opset 7, or say by an attribute that they do not, which is refused; but for
/// `BatchNormalization`, `Dropout` and `PRelu`, which are refused.
pub const OPSETS: RangeInclusive<i64> = 6..=28;

/// Operators whose meaning changed from opset 6 to opset 7 without an attribute to tell.
///
/// Inference was the exception for batch normalisation and Dropout, and a list of slopes belonged to the channels.
const CHANGED_SILENTLY: [&str; 3] = ["BatchNormalization", "Dropout", "PRelu"];

/// A node with its operands, as the dictionary reads it.
struct Call<'a, T> {
    node: &'a NodeProto,
    operator: &'a str,
    opset: i64,
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

    /// Numbers of the element type of operand 0, as most operators give.
    fn like(&self, numbers: Tensor<T>) -> Result<Value<T>, String> {
        let element = self.operand(0)?.element;
        if element.is_float() {
            Ok(Value::from_numbers(element, numbers))
        } else {
            Err(format!("operand 0 is of {element}, a float type was expected"))
        }
    }

    /// The one element type of all operands.
    fn same_type(&self) -> Result<ElementType, String> {
        let element = self.operand(0)?.element;
        match self.operands.iter().flatten().find(|operand| operand.element != element) {
            Some(other) => Err(format!("operands of {element} and of {} do not mix", other.element)),
            None => Ok(element),
        }
    }

    /// A setting of the operator: exact where the element type of operand 0 holds it, else a kernel may round it.
    fn constant(&self, value: f64) -> Result<T, String> {
        let exact = self.operand(0)?.element.round(value) == value;
        Ok(if exact { T::exact(value) } else { T::within(value, value.abs(), 1.0) })
    }

    /// Whether the node asks for output `i`.
    fn wants(&self, i: usize) -> bool {
        self.node.output.get(i).is_some_and(|name| !name.is_empty())
    }
}

/// Refuses a shape of more than [`LARGEST`] elements before anything is allocated for it.
fn room(shape: &[usize]) -> Result<(), String> {
    let count = shape.iter().try_fold(1_usize, |count, &side| count.checked_mul(side.max(1)));
    match count {
        Some(count) if count <= LARGEST => Ok(()),
        _ => Err(format!("an output of shape {shape:?} has more than {LARGEST} elements")),
    }
}

/// The shape that two shapes have in common by ONNX's broadcasting, of no more than [`LARGEST`] elements.
fn broadcast(a: &[usize], b: &[usize]) -> Result<Vec<usize>, String> {
    let rank = a.len().max(b.len());
    // Axes that are missing in front have length one.
    let side = |shape: &[usize], axis: usize| (axis + shape.len()).checked_sub(rank).map_or(1, |k| shape[k]);
    let shape = (0..rank).map(|axis| match (side(a, axis), side(b, axis)) {
        (1, side) | (side, 1) => Ok(side),
        (side, other) if side == other => Ok(side),
        _ => Err(format!("shapes {a:?} and {b:?} do not broadcast")),
    });
    let shape = shape.collect::<Result<Vec<_>, _>>()?;
    room(&shape)?;
    Ok(shape)
}

/// A node's outputs, one per name in `node.output`: `None` where the node leaves it out. Optional operands that are left
/// out are `None`.
///
/// The meaning is that of version `opset` of ONNX's operators, and of version 1 of those of ONNX Runtime's domain
/// `com.microsoft`.
///
/// # Errors
/// When the operator, its version, an attribute or an operand's kind is not understood, the operands' shapes do not fit,
/// or an output would have more than [`LARGEST`] elements.
pub fn evaluate<T: Scalar>(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<&Value<T>>],
) -> Result<Vec<Option<Value<T>>>, String> {
    let operator = node.op_type.as_deref().unwrap_or_default();
    let (family, name): (fn(&Call<T>) -> Answer<T>, _) = match node.domain.as_deref().unwrap_or_default() {
        "" | "ai.onnx" => (own, operator.to_owned()),
        microsoft::DOMAIN => (microsoft::evaluate, format!("{}.{operator}", microsoft::DOMAIN)),
        domain => {
            return Err(format!("operator {operator} of domain \"{domain}\" is not known to the judge"));
        }
    };
    // Another domain has versions of its own.
    let is_own = name == operator;
    if is_own && opset == 6 && CHANGED_SILENTLY.contains(&operator) {
        return Err(format!("operator {operator} of opset 6 means something else than that of opset 7"));
    }
    if is_own && !OPSETS.contains(&opset) {
        let (first, last) = (OPSETS.start(), OPSETS.end());
        return Err(format!("operator {operator} of opset {opset}; opsets {first} to {last} are known"));
    }
    let call = Call { node, operator, opset, operands };
    // The reference's operators panic where shapes do not fit: there it is a caller's mistake, here the file's.
    let answer = caught(|| family(&call)).unwrap_or_else(|why| Some(Err(why)));
    let outputs = answer.unwrap_or_else(|| Err("the operator is not known to the judge".into()));
    let outputs = outputs.map_err(|why| format!("{name}: {why}"))?;
    if let Some(more) = node.output.get(outputs.len()..).and_then(<[String]>::first) {
        return Err(format!("{name}: output \"{more}\" is one more than the operator has"));
    }
    let asked = |(name, value): (&String, Value<T>)| (!name.is_empty()).then_some(value);
    Ok(node.output.iter().zip(outputs).map(asked).collect())
}

/// What ONNX's own operators say.
fn own<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let families = [
        convolution::evaluate,
        pooling::evaluate,
        resampling::evaluate,
        padding::evaluate,
        functions::evaluate,
        arithmetic::evaluate,
        reductions::evaluate,
        normalizations::evaluate,
        products::evaluate,
        attention::evaluate,
        recurrent::evaluate,
        causal_convolution::evaluate,
        losses::evaluate,
        signals::evaluate,
        choice::evaluate,
        movement::evaluate,
        bits::evaluate,
        boxes::evaluate,
        cast::evaluate,
        creation::evaluate,
        indexing::evaluate,
        quantization::evaluate,
    ];
    families.iter().find_map(|family| family(call))
}

/// What a node's first output may also be: where a coordinate lies within its rounding of a tie between two pixels, a number
/// within its rounding of a tie between two integers, or a conversion to integers is not specified.
///
/// Each element of a second party with this unit roundoff is right if it is that of [`evaluate`] or of one of these. Most
/// operators have none, and one that cannot be evaluated has none either.
pub fn alternatives<T: Scalar>(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<&Value<T>>],
    unit_roundoff: f64,
) -> Vec<Value<T>> {
    let operator = node.op_type.as_deref().unwrap_or_default();
    let call = Call { node, operator, opset, operands };
    let others = || match node.domain.as_deref() {
        None | Some("" | "ai.onnx") => resampling::alternatives(&call, unit_roundoff),
        Some(microsoft::DOMAIN) => microsoft::alternatives(&call, unit_roundoff),
        Some(_) => Ok(Vec::new()),
    };
    caught(others).and_then(|found| found).unwrap_or_default()
}

/// What a family says of a node: nothing if it is another's, else all outputs of the operator or what is not understood.
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
        let x: Value = Value::from_numbers(ElementType::F32, Tensor::new(&[2], vec![1.0, 2.0]));
        let why = |node: &NodeProto| evaluate(node, 21, &[Some(&x)]).expect_err("refused");
        let unknown = why(&node("Erfc", vec![]));
        assert!(unknown.contains("Erfc: the operator is not known"), "{unknown}");
        let attribute = why(&node("LeakyRelu", vec![int("beta", 1)]));
        assert!(attribute.contains("LeakyRelu: attribute \"beta\""), "{attribute}");
        let missing = why(&node("Add", vec![]));
        assert!(missing.contains("Add: operand 1 is missing"), "{missing}");
        let mut foreign = node("Relu", vec![]);
        foreign.domain = Some("com.microsoft".into());
        let domain = why(&foreign);
        assert!(domain.contains("com.microsoft.Relu: the operator is not known"), "{domain}");
        foreign.domain = Some("nobody's".into());
        let domain = why(&foreign);
        assert!(domain.contains("Relu of domain \"nobody's\" is not known"), "{domain}");
        let old = evaluate(&node("Relu", vec![]), 5, &[Some(&x)]).expect_err("refused");
        assert!(old.contains("opset 5; opsets 6 to 28"), "{old}");
        let changed = evaluate(&node("PRelu", vec![]), 6, &[Some(&x), Some(&x)]).expect_err("refused");
        assert!(changed.contains("PRelu of opset 6"), "{changed}");
    }

    #[test]
    fn shapes_that_do_not_fit_are_an_error_and_not_a_panic() {
        let x: Value = Value::from_numbers(ElementType::F32, Tensor::new(&[2], vec![1.0, 2.0]));
        let y: Value = Value::from_numbers(ElementType::F32, Tensor::new(&[3], vec![1.0, 2.0, 3.0]));
        let why = evaluate(&node("Add", vec![]), 21, &[Some(&x), Some(&y)]).expect_err("refused");
        assert!(why.contains("[2]") && why.contains("[3]"), "{why}");
    }

    #[test]
    fn outputs_are_given_by_name() {
        let x: Value = Value::from_numbers(ElementType::F32, Tensor::new(&[2], vec![1.0, 2.0]));
        let mut split = node("Split", vec![int("num_outputs", 2)]);
        split.output = vec![String::new(), "second".into()];
        let outputs = evaluate(&split, 21, &[Some(&x)]).expect("outputs");
        assert!(outputs[0].is_none() && outputs[1].is_some(), "{outputs:?}");
        let mut relu = node("Relu", vec![]);
        relu.output.push("more".into());
        assert!(evaluate(&relu, 21, &[Some(&x)]).expect_err("refused").contains("\"more\""), "too many");
    }
}

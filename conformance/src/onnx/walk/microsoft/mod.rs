//! Operators of ONNX Runtime's domain `com.microsoft`, version 1: what its quantiser and its optimiser write.
//!
//! | file | operators |
//! |---|---|
//! | `quantized` | one of ONNX's between integers that stand for numbers: `QLinearAdd`, `QLinearConcat` … |
//! | `products` | products of matrices of integers, scaled: `QGemm`, `DynamicQuantizeMatMul`, `MatMulIntegerToFloat` |
//! | `fused` | several of ONNX's in one: `FusedConv`, `FusedMatMul`, `BiasGelu` … |
//!
//! They mean what `docs/ContribOperators.md` of ONNX Runtime says, in real numbers: integers are made numbers, the operator
//! is applied, and its numbers are rounded to the nearest level, the even one half way, and cut off to the integer type. An
//! engine rounds on the way, so a number within its rounding of a tie may come out on either side of it: these are the
//! [`alternatives`].

use vitruvian_reference::nn::{IntegerRange, Scalar, Tensor, gamma, levels, transpose};

use super::{Answer, Attributes, Call, Value, broadcast, own, quantization};
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;

mod fused;
mod products;
mod quantized;

/// The domain's name.
pub(super) const DOMAIN: &str = "com.microsoft";

/// The version of ONNX's operators that have more around them here and do not say their version.
const OPSET: i64 = 21;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    if let Some(levels) = levelled(call) {
        return Some(levels.and_then(|levels| Ok(vec![levels.integers(|_| 0.0)?])));
    }
    let families = [quantized::evaluate, products::evaluate, fused::evaluate];
    families.iter().find_map(|family| family(call))
}

/// What the operator may also give where a number lies within its rounding of a tie between two levels.
pub(super) fn alternatives<T: Scalar>(call: &Call<T>, unit_roundoff: f64) -> Result<Vec<Value<T>>, String> {
    if let Some(levels) = levelled(call) {
        let (levels, reach) = (levels?, |x: T| gamma(x.terms(), unit_roundoff) * x.magnitude());
        return Ok(vec![levels.integers(|x| -reach(x))?, levels.integers(reach)?]);
    }
    products::alternatives(call, unit_roundoff)
}

fn levelled<T: Scalar>(call: &Call<T>) -> Option<Result<Levels<T>, String>> {
    quantized::levelled(call).or_else(|| products::levelled(call))
}

/// Where the numbers of an output lie among the integers that are to stand for them.
struct Levels<T> {
    levels: Tensor<T>,
    element: ElementType,
}

impl<T: Scalar> Levels<T> {
    /// Numbers among the integers with the scale in operand `at` and the zero point after it, of the type `otherwise` where
    /// there is none.
    fn of(call: &Call<T>, x: &Tensor<T>, at: usize, otherwise: ElementType) -> Result<Self, String> {
        let element = call.optional(at + 1).map_or(otherwise, |zero| zero.element);
        Ok(Self { levels: levels(x, scale(call, at)?, zero_point(call, at + 1)?), element })
    }

    /// The nearest integers, with every level moved before.
    fn integers(&self, moved: impl Fn(T) -> f64) -> Result<Value<T>, String> {
        let range: IntegerRange = quantization::range(self.element)?;
        Value::from_integers(self.element, self.levels.map(|x| range.saturated(x.value() + moved(x))))
    }
}

/// The one scale of a tensor.
fn scale<T: Scalar>(call: &Call<T>, i: usize) -> Result<T, String> {
    let scale = call.numbers(i)?;
    match scale.data[..] {
        [one] => Ok(one),
        _ => Err(format!("operand {i} has shape {:?}, one scale was expected", scale.shape)),
    }
}

/// The one zero point of a tensor: 0 where it is left out.
fn zero_point<T: Scalar>(call: &Call<T>, i: usize) -> Result<i64, String> {
    if call.optional(i).is_none() {
        return Ok(0);
    }
    let zero = call.integers(i)?;
    match zero.data[..] {
        [one] => Ok(one),
        _ => Err(format!("operand {i} has shape {:?}, one zero point was expected", zero.shape)),
    }
}

/// One of ONNX's own operators inside one of this domain, which has more attributes around it.
struct Inner {
    node: NodeProto,
    outer: NodeProto,
    opset: i64,
}

impl Inner {
    /// The operator inside, with all attributes but those of `outer`.
    fn of<T>(call: &Call<T>, operator: &str, outer: &[&str]) -> Self {
        let is_outer = |name: Option<&str>| name.is_some_and(|name| outer.contains(&name));
        let (around, own) =
            call.node.attribute.iter().cloned().partition(|attribute| is_outer(attribute.name.as_deref()));
        let node = |attribute| NodeProto {
            op_type: Some(operator.into()),
            output: vec!["y".into()],
            attribute,
            ..NodeProto::default()
        };
        Self { node: node(own), outer: node(around), opset: OPSET }
    }

    /// The attributes around it.
    fn attributes(&self, outer: &[&str]) -> Result<Attributes<'_>, String> {
        Attributes::of(&self.outer, outer)
    }

    fn run<T: Scalar>(&self, operands: &[Option<&Value<T>>]) -> Result<Value<T>, String> {
        let operator = self.node.op_type.as_deref().unwrap_or_default();
        let call = Call { node: &self.node, operator, opset: self.opset, operands };
        let outputs = own(&call).unwrap_or_else(|| Err(format!("{operator} is not known to the judge")))?;
        outputs.into_iter().next().ok_or_else(|| format!("{operator} has no output"))
    }
}

/// [N,spatial…,C] as [N,C,spatial…].
fn channels_first<E: Copy>(x: &Tensor<E>) -> Tensor<E> {
    let rank = x.rank();
    let from = |axis| match axis {
        0 => 0,
        1 => rank - 1,
        _ => axis - 1,
    };
    let order: Vec<usize> = (0..rank).map(from).collect();
    transpose(x, &order)
}

/// [N,C,spatial…] as [N,spatial…,C].
fn channels_last<E: Copy>(x: &Tensor<E>) -> Tensor<E> {
    let rank = x.rank();
    let order: Vec<usize> = (0..rank).map(|axis| if axis == 0 { 0 } else { axis % (rank - 1) + 1 }).collect();
    transpose(x, &order)
}

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

#[cfg(test)]
mod tests {
    use vitruvian_reference::nn::Rounded;

    use super::super::tests::node;
    use super::super::{alternatives, evaluate};
    use super::*;
    use crate::onnx::builder::{float, int};
    use crate::onnx::message::AttributeProto;

    fn foreign(operator: &str, attributes: Vec<AttributeProto>) -> NodeProto {
        NodeProto { domain: Some(DOMAIN.into()), ..node(operator, attributes) }
    }

    fn bytes(shape: &[usize], data: &[i64]) -> Value<Rounded> {
        Value::from_integers(ElementType::U8, Tensor::new(shape, data.to_vec())).expect("bytes")
    }

    fn numbers(shape: &[usize], data: &[f64]) -> Value<Rounded> {
        Value::from_numbers(ElementType::F32, Tensor::new(shape, data.to_vec()).rounded())
    }

    fn first(node: &NodeProto, operands: &[&Value<Rounded>]) -> Result<Value<Rounded>, String> {
        let operands: Vec<_> = operands.iter().copied().map(Some).collect();
        Ok(evaluate(node, 21, &operands)?[0].clone().expect("an output"))
    }

    fn integers(value: &Value<Rounded>) -> &[i64] {
        &value.integers().expect("integers").data
    }

    #[test]
    fn integers_are_made_numbers_added_and_rounded_to_a_level() {
        let (a, b) = (bytes(&[4], &[10, 11, 12, 255]), bytes(&[1], &[6]));
        let (zero, five, half, two) =
            (bytes(&[], &[0]), bytes(&[], &[5]), numbers(&[], &[0.5]), numbers(&[], &[2.0]));
        let operands = [&a, &half, &five, &b, &half, &zero, &two, &five];
        // ((a − 5)/2 + 3)/2 + 5 = 7.75, 8, 8.25 and 69.
        assert_eq!(integers(&first(&foreign("QLinearAdd", vec![]), &operands).expect("y")), [8, 8, 8, 69]);
        let operands = [&a, &two, &zero, &b, &two, &five, &half, &zero];
        // 2a·2(6 − 5)/½ = 8a.
        assert_eq!(
            integers(&first(&foreign("QLinearMul", vec![]), &operands).expect("y")),
            [80, 88, 96, 255]
        );
    }

    #[test]
    fn a_number_at_a_tie_may_be_rounded_either_way_and_no_other_may() {
        let (a, zero, one, two) =
            (bytes(&[3], &[4, 5, 6]), bytes(&[], &[0]), numbers(&[], &[1.0]), numbers(&[], &[2.0]));
        let node = foreign("QLinearConcat", vec![int("axis", 0)]);
        let operands: Vec<_> = [&two, &zero, &a, &one, &zero].into_iter().map(Some).collect();
        let others = alternatives(&node, 21, &operands, 2.0_f64.powi(-24));
        let others: Vec<_> = others.iter().map(integers).collect();
        assert_eq!(others, [[2, 2, 3], [2, 3, 3]], "2, 2½ and 3");
    }

    #[test]
    fn channels_behind_the_image_are_pooled_apart() {
        let x = bytes(&[1, 2, 1, 2], &[1, 10, 3, 30]);
        let (zero, one) = (bytes(&[], &[0]), numbers(&[], &[1.0]));
        let mean = |last| {
            let node = foreign("QLinearGlobalAveragePool", vec![int("channels_last", last)]);
            first(&node, &[&x, &one, &zero, &one, &zero]).expect("y")
        };
        assert_eq!((mean(1).shape(), integers(&mean(1))), (&[1, 1, 1, 2][..], &[2, 20][..]));
        assert_eq!(
            (mean(0).shape(), integers(&mean(0))),
            (&[1, 2, 1, 1][..], &[6, 16][..]),
            "5½ and 16½, to even"
        );
        let x = Tensor::from_fn(&[1, 2, 3, 4], |at| at[3]);
        assert_eq!(channels_last(&channels_first(&x)), x);
        assert_eq!(channels_first(&x).shape, [1, 4, 2, 3]);
    }

    #[test]
    fn columns_have_scales_of_their_own_and_without_one_of_the_output_numbers_are_given() {
        let (a, b) = (bytes(&[1, 2], &[3, 5]), bytes(&[2, 2], &[1, 2, 3, 4]));
        let (zero, half) = (bytes(&[], &[1]), numbers(&[], &[0.5]));
        let (steps, zeros) = (numbers(&[2], &[1.0, 10.0]), bytes(&[2], &[0, 1]));
        let operands = [&a, &half, &zero, &b, &steps, &zeros];
        // 2·1 + 4·3 = 14 and 2·1 + 4·3 again, by ½ and by 5.
        let y = first(&foreign("QGemm", vec![]), &operands).expect("y");
        assert_eq!(y.numbers().expect("numbers").values().data, [7.0, 70.0]);
        let y = first(&foreign("QGemm", vec![float("alpha", 2.0), int("transB", 1)]), &operands).expect("y");
        assert_eq!(y.numbers().expect("numbers").values().data, [10.0, 160.0], "rows are columns now");
    }

    #[test]
    fn what_an_operator_does_not_have_is_refused_by_name() {
        let (a, zero, one) = (bytes(&[2], &[4, 5]), bytes(&[], &[0]), numbers(&[], &[1.0]));
        let operands = [&a, &one, &zero, &one, &zero];
        let why =
            |operator, attributes| first(&foreign(operator, attributes), &operands).expect_err("refused");
        let attribute = why("QLinearSigmoid", vec![int("channels_last", 1)]);
        assert!(
            attribute.contains("com.microsoft.QLinearSigmoid: attribute \"channels_last\""),
            "{attribute}"
        );
        let opset = why("QLinearSoftmax", vec![]);
        assert!(opset.contains("\"opset\" is missing"), "{opset}");
        let steps = numbers(&[2], &[1.0, 1.0]);
        let several = first(&foreign("QLinearSigmoid", vec![]), &[&a, &steps, &zero, &one, &zero]);
        assert!(
            several.expect_err("refused").contains("operand 1 has shape [2], one scale was expected"),
            "two"
        );
        let float = first(&foreign("QLinearSigmoid", vec![]), &[&one, &one, &zero, &one, &zero]);
        assert!(float.expect_err("refused").contains("operand 0 is of f32, i8 or u8 was expected"), "f32");
        let activation = foreign("FusedGemm", vec![crate::onnx::builder::text("activation", "Softsign")]);
        let x = numbers(&[1, 1], &[1.0]);
        let softsign = first(&activation, &[&x, &x]).expect_err("refused");
        assert!(softsign.contains("\"activation\" is Softsign"), "{softsign}");
    }
}

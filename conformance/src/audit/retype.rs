//! Tensors that were kept in another element type than the graph's.
//!
//! Programs that write dumps like to widen: f16 as f32, i32 as i64, truths as bytes. Such a tensor is brought back to the
//! graph's type, which is what the next node was given; a number that the type does not hold is rounded.

use super::compare::{integers, numbers};
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// The element type of a node's first output, where it follows from the operands' or an attribute.
pub(super) fn output_element(
    node: &NodeProto,
    operand: impl Fn(&str) -> Option<ElementType>,
) -> Option<ElementType> {
    let attribute =
        |name: &str| node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name));
    let of = |i: usize| node.input.get(i).and_then(|name| operand(name));
    match node.op_type.as_deref()? {
        "Cast" => ElementType::from_number(i32::try_from(attribute("to")?.i?).ok()?),
        "CastLike" => of(1),
        "Where" => of(1).or_else(|| of(2)),
        "Equal" | "Greater" | "GreaterOrEqual" | "Less" | "LessOrEqual" | "And" | "Or" | "Xor" | "Not"
        | "IsNaN" | "IsInf" => Some(ElementType::Bool),
        "Shape" | "Size" | "ArgMax" | "ArgMin" | "NonZero" => Some(ElementType::I64),
        "DequantizeLinear" => of(1),
        "Constant"
        | "ConstantOfShape"
        | "QuantizeLinear"
        | "DynamicQuantizeLinear"
        | "QLinearConv"
        | "QLinearMatMul"
        | "ConvInteger"
        | "MatMulInteger"
        | "EyeLike"
        | "RandomNormal"
        | "RandomUniform"
        | "RandomNormalLike"
        | "RandomUniformLike"
        | "Bernoulli"
        | "Multinomial"
        | "OneHot"
        | "BitCast"
        | "NonMaxSuppression"
        | "Range"
        | "BlackmanWindow"
        | "HammingWindow"
        | "HannWindow"
        | "MelWeightMatrix"
        | "StringNormalizer"
        | "TfIdfVectorizer"
        | "Unique" => None,
        _ if node.domain.as_deref().is_some_and(|domain| !domain.is_empty() && domain != "ai.onnx") => None,
        _ => of(0),
    }
}

/// The tensor in another element type.
pub(super) fn retyped(tensor: &TypedTensor, element: ElementType) -> TypedTensor {
    macro_rules! whole {
        ($type:ty) => {
            integers(tensor)
                .into_iter()
                .map(|i| i.clamp(<$type>::MIN.into(), <$type>::MAX.into()) as $type)
                .collect()
        };
    }
    let rounded = || numbers(tensor).into_iter().map(|x| element.round(x));
    let elements = match element {
        ElementType::F32 => Elements::F32(rounded().map(|x| x as f32).collect()),
        ElementType::F64 => Elements::F64(rounded().collect()),
        ElementType::F16 => Elements::F16(rounded().map(half::f16::from_f64).collect()),
        ElementType::Bf16 => Elements::Bf16(rounded().map(half::bf16::from_f64).collect()),
        ElementType::I8 => Elements::I8(whole!(i8)),
        ElementType::U8 => Elements::U8(whole!(u8)),
        ElementType::I16 => Elements::I16(whole!(i16)),
        ElementType::U16 => Elements::U16(whole!(u16)),
        ElementType::I32 => Elements::I32(whole!(i32)),
        ElementType::U32 => Elements::U32(whole!(u32)),
        ElementType::I64 => Elements::I64(whole!(i64)),
        ElementType::U64 => Elements::U64(whole!(u64)),
        ElementType::Bool => Elements::Bool(integers(tensor).into_iter().map(|i| i != 0).collect()),
    };
    TypedTensor { shape: tensor.shape.clone(), elements }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_widened_comes_back_as_it_was() {
        let half = TypedTensor {
            shape: vec![3],
            elements: Elements::F16([0.1, -7.5, 65504.0].map(half::f16::from_f64).to_vec()),
        };
        assert_eq!(retyped(&retyped(&half, ElementType::F32), ElementType::F16), half);
        let truths = TypedTensor { shape: vec![2], elements: Elements::Bool(vec![true, false]) };
        assert_eq!(retyped(&retyped(&truths, ElementType::U8), ElementType::Bool), truths);
        let integers = TypedTensor { shape: vec![2], elements: Elements::I32(vec![-5, i32::MAX]) };
        assert_eq!(retyped(&retyped(&integers, ElementType::I64), ElementType::I32), integers);
    }
}

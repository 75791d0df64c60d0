//! Operators that give another element type to the same numbers, or to the same bits.

use vitruvian_reference::nn::{Scalar, Tensor};

use super::creation::element;
use super::{Answer, Call, Data, Value};
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "BitCast" => reread(call),
        "Cast" => named(call).and_then(|to| cast(call.operand(0)?, to)),
        // What `saturate` and `round_mode` say is about 8-bit floats alone.
        "CastLike" => call
            .attributes(&["round_mode", "saturate"])
            .and_then(|_| cast(call.operand(0)?, call.operand(1)?.element)),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

fn named<T: Scalar>(call: &Call<T>) -> Result<ElementType, String> {
    let attributes = call.attributes(&["round_mode", "saturate", "to"])?;
    if !attributes.has("to") {
        return Err("attribute \"to\" is missing".into());
    }
    element(attributes, "to", ElementType::F32)
}

/// The same numbers in another element type: rounded to the nearest, cut off towards zero, or whether they are not zero.
fn cast<T: Scalar>(x: &Value<T>, to: ElementType) -> Result<Value<T>, String> {
    match (&x.data, to) {
        (Data::Numbers(x), ElementType::Bool) => Ok(Value::from_truths(x.map(|x| x.value() != 0.0))),
        (Data::Integers(x), ElementType::Bool) => Ok(Value::from_truths(x.map(|i| i != 0))),
        (Data::Truths(x), ElementType::Bool) => Ok(Value::from_truths(x.clone())),
        (Data::Numbers(x), to) if to.is_float() => Ok(Value::from_numbers(to, x.map(|x| rounded(x, to)))),
        (Data::Integers(x), to) if to.is_float() => {
            Ok(Value::from_numbers(to, x.map(|i| T::exact(to.round_integer(i)))))
        }
        (Data::Truths(x), to) if to.is_float() => {
            Ok(Value::from_numbers(to, x.map(|t| T::exact(f64::from(u8::from(t))))))
        }
        (Data::Numbers(x), to) => {
            let integers: Result<_, _> = x.data.iter().map(|x| towards_zero(x.value(), to)).collect();
            Value::from_integers(to, Tensor::new(&x.shape, integers?))
        }
        (Data::Integers(x), to) => Value::from_integers(to, x.clone()),
        (Data::Truths(x), to) => Value::from_integers(to, x.map(i64::from)),
    }
}

/// The bits of the elements, read as another type of the same size.
fn reread<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let to = named(call)?;
    let x = call.operand(0)?;
    if x.element.size() != to.size() {
        return Err(format!("the bits of {} are not those of {to}: the sizes differ", x.element));
    }
    Value::of(&TypedTensor::from_bytes(to, x.shape(), &bits(x)?)?)
}

/// The elements as their type stores them, little endian.
fn bits<T: Scalar>(x: &Value<T>) -> Result<Vec<u8>, String> {
    Ok(match &x.data {
        Data::Truths(x) => Elements::Bool(x.data.clone()).to_bytes(),
        // The lower bytes of a two's complement are the narrower two's complement.
        Data::Integers(tensor) => {
            let size = x.element.size();
            tensor.data.iter().flat_map(|i| i.to_le_bytes().into_iter().take(size)).collect()
        }
        Data::Numbers(tensor) => {
            let numbers = tensor.data.iter().map(|v| v.value());
            match x.element {
                ElementType::F64 => Elements::F64(numbers.collect()),
                ElementType::F32 => Elements::F32(numbers.map(|v| v as f32).collect()),
                ElementType::F16 => Elements::F16(numbers.map(half::f16::from_f64).collect()),
                ElementType::Bf16 => Elements::Bf16(numbers.map(half::bf16::from_f64).collect()),
                other => return Err(format!("{other} is no float type")),
            }
            .to_bytes()
        }
    })
}

/// The nearest number of a float type; an exact number becomes an exact number again.
fn rounded<T: Scalar>(x: T, to: ElementType) -> T {
    let value = to.round(x.value());
    if x.terms() == 0.0 || value == x.value() {
        return if value == x.value() { x } else { T::exact(value) };
    }
    T::within(value, x.magnitude(), x.terms() + 1.0)
}

/// The integer part, as C converts.
///
/// # Errors
/// When the type does not hold it: what becomes of such a number ONNX leaves open.
fn towards_zero(x: f64, to: ElementType) -> Result<i64, String> {
    let (low, high) = to.range().ok_or_else(|| format!("{to} is no integer type"))?;
    // A NaN and what is beyond i128 fail one of the comparisons.
    let whole = x.trunc();
    if whole >= low as f64 && whole as i128 <= high.min(i64::MAX.into()) {
        Ok(whole as i64)
    } else {
        Err(format!("{x} does not fit into {to}; ONNX leaves the result open"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::int;

    fn numbers(element: ElementType, data: &[f64]) -> Value {
        Value::from_numbers(element, Tensor::new(&[data.len()], data.to_vec()))
    }

    #[test]
    fn numbers_become_integers_towards_zero_and_floats_to_the_nearest() {
        let x = numbers(ElementType::F32, &[-1.9, 1.9]);
        assert_eq!(cast(&x, ElementType::I8).expect("an i8").integers().expect("integers").data, [-1, 1]);
        let f16 = cast(&numbers(ElementType::F32, &[0.1, 1e6]), ElementType::F16).expect("an f16");
        assert_eq!(f16.numbers().expect("numbers").data, [half::f16::from_f32(0.1).to_f64(), f64::INFINITY]);
        let open = cast(&numbers(ElementType::F32, &[300.0]), ElementType::U8).expect_err("refused");
        assert!(open.contains("300 does not fit into u8"), "{open}");
        let wrapped = cast(&Value::<f64>::list(vec![300, -1]), ElementType::U8).expect("an u8");
        assert_eq!(wrapped.integers().expect("integers").data, [44, 255]);
    }

    #[test]
    fn bits_are_read_as_another_type() {
        let read = |x: &Value, to: ElementType| {
            let y = evaluate(&node("BitCast", vec![int("to", to.number().into())]), 26, &[Some(x)])?;
            Ok::<_, String>(y[0].clone().expect("an output"))
        };
        let x = numbers(ElementType::F32, &[1.0, -2.0]);
        let bits = read(&x, ElementType::U32).expect("of one size");
        assert_eq!(bits.integers().expect("integers").data, [0x3f80_0000, 0xc000_0000]);
        assert_eq!(read(&bits, ElementType::F32), Ok(x), "there and back");
        assert!(read(&bits, ElementType::I64).expect_err("refused").contains("sizes differ"), "8 bytes of 4");
    }
}

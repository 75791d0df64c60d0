//! Operators that compare, cast and choose.
//!
//! Numbers are compared by their values: of numbers that are known exactly, as those that a runtime handed over, this
//! is what any implementation must do.

use vitruvian_reference::nn::{Scalar, Tensor, expand};

use super::arithmetic::zipped;
use super::{Answer, Call, Value};
use crate::onnx::message::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "And" => logical(call, |a, b| a && b),
        "Cast" => cast(call),
        "Equal" => compared(call, |a, b| a == b, |a, b| a == b),
        "Greater" => compared(call, |a, b| a > b, |a, b| a > b),
        "GreaterOrEqual" => compared(call, |a, b| a >= b, |a, b| a >= b),
        "IsNaN" => call.numbers(0).map(|x| Value::Truths(x.map(|x| x.value().is_nan()))),
        "Less" => compared(call, |a, b| a < b, |a, b| a < b),
        "LessOrEqual" => compared(call, |a, b| a <= b, |a, b| a <= b),
        "Not" => call.truths(0).map(|x| Value::Truths(x.map(|x| !x))),
        "Or" => logical(call, |a, b| a || b),
        "Where" => chosen(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

fn logical<T: Scalar>(call: &Call<T>, f: fn(bool, bool) -> bool) -> Result<Value<T>, String> {
    Ok(Value::Truths(zipped(call.truths(0)?, call.truths(1)?, f)))
}

fn compared<T: Scalar>(
    call: &Call<T>,
    numbers: fn(f64, f64) -> bool,
    integers: fn(i64, i64) -> bool,
) -> Result<Value<T>, String> {
    Ok(Value::Truths(match call.operand(0)? {
        Value::Numbers(a) => zipped(a, call.numbers(1)?, |a: T, b: T| numbers(a.value(), b.value())),
        Value::Integers(a) => zipped(a, call.integers(1)?, integers),
        Value::Truths(a) => {
            zipped(a, call.truths(1)?, |a: bool, b: bool| integers(i64::from(a), i64::from(b)))
        }
    }))
}

fn cast<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let number = call.attributes(&["round_mode", "saturate", "to"])?.int("to", 0);
    let to = i32::try_from(number).ok().and_then(ElementType::from_number);
    let to = to.ok_or_else(|| format!("element type {number} is not understood"))?;
    let x = call.operand(0)?;
    Ok(match (to, x) {
        (ElementType::F32, Value::Numbers(x)) => Value::Numbers(x.clone()),
        (ElementType::F32, Value::Integers(x)) => {
            // Integers up to 2²⁴ are f32; larger ones round.
            if let Some(large) = x.data.iter().find(|i| i.unsigned_abs() > 1 << 24) {
                return Err(format!("{large} is no exact f32"));
            }
            Value::Numbers(x.map(|i| T::exact(i as f64)))
        }
        (ElementType::F32, Value::Truths(x)) => Value::Numbers(x.map(|t| T::exact(f64::from(u8::from(t))))),
        (ElementType::I32 | ElementType::I64, Value::Numbers(x)) => {
            // Towards zero, as C converts.
            Value::Integers(x.map(|x| x.value() as i64))
        }
        (ElementType::I32 | ElementType::I64, Value::Integers(x)) => Value::Integers(x.clone()),
        (ElementType::I32 | ElementType::I64, Value::Truths(x)) => Value::Integers(x.map(i64::from)),
        (ElementType::Bool, Value::Numbers(x)) => Value::Truths(x.map(|x| x.value() != 0.0)),
        (ElementType::Bool, Value::Integers(x)) => Value::Truths(x.map(|i| i != 0)),
        (ElementType::Bool, Value::Truths(x)) => Value::Truths(x.clone()),
        (ElementType::F64, _) => return Err("to f64; this judge's subject computes in f32".into()),
    })
}

/// The element of operand 1 where operand 0 holds, else of operand 2.
fn chosen<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let condition = call.truths(0)?;
    Value::arranged(&[call.operand(1)?, call.operand(2)?], |places| {
        let [yes, no] = places else { unreachable!("two values were given") };
        let both: Tensor<[usize; 2]> = zipped(yes, no, |yes, no| [yes, no]);
        let condition = expand(condition, &both.shape);
        Ok(zipped(&condition, &both, |condition, [yes, no]| if condition { yes } else { no }))
    })
}

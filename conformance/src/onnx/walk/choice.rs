//! Operators that compare, cast and choose.
//!
//! Numbers are compared by their values: of numbers that are known exactly, as those that a runtime handed over, this
//! is what any implementation must do.

use vitruvian_reference::nn::{Scalar, Tensor, broadcast as zip};

use super::{Answer, Call, Data, Value, broadcast};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "And" => logical(call, |a, b| a && b),
        "Cast" => cast(call),
        "Equal" => compared(call, |a, b| a == b, |a, b| a == b),
        "Greater" => compared(call, |a, b| a > b, |a, b| a > b),
        "GreaterOrEqual" => compared(call, |a, b| a >= b, |a, b| a >= b),
        "Less" => compared(call, |a, b| a < b, |a, b| a < b),
        "LessOrEqual" => compared(call, |a, b| a <= b, |a, b| a <= b),
        "Not" => call.truths(0).map(|x| Value::from_truths(x.map(|x| !x))),
        "Or" => logical(call, |a, b| a || b),
        "Where" => chosen(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// f(a, b) element by element, with broadcasting.
fn zipped<A: Copy, B: Copy, C>(
    a: &Tensor<A>,
    b: &Tensor<B>,
    f: impl Fn(A, B) -> C,
) -> Result<Tensor<C>, String> {
    broadcast(&a.shape, &b.shape)?;
    Ok(zip("Where", a, b, f))
}

fn logical<T: Scalar>(call: &Call<T>, f: fn(bool, bool) -> bool) -> Result<Value<T>, String> {
    Ok(Value::from_truths(zipped(call.truths(0)?, call.truths(1)?, f)?))
}

fn compared<T: Scalar>(
    call: &Call<T>,
    numbers: fn(f64, f64) -> bool,
    integers: fn(i64, i64) -> bool,
) -> Result<Value<T>, String> {
    call.same_type()?;
    Ok(Value::from_truths(match &call.operand(0)?.data {
        Data::Numbers(a) => zipped(a, call.numbers(1)?, |a: T, b: T| numbers(a.value(), b.value()))?,
        Data::Integers(a) => zipped(a, call.integers(1)?, integers)?,
        Data::Truths(a) => {
            zipped(a, call.truths(1)?, |a: bool, b: bool| integers(i64::from(a), i64::from(b)))?
        }
    }))
}

fn cast<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let number = call.attributes(&["round_mode", "saturate", "to"])?.int("to", 0);
    let to = i32::try_from(number).ok().and_then(ElementType::from_number);
    let to = to.ok_or_else(|| format!("element type {number} is not understood"))?;
    let shape = call.operand(0)?.shape();
    match (&call.operand(0)?.data, to) {
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
            Value::from_integers(to, Tensor::new(shape, integers?))
        }
        (Data::Integers(x), to) => Value::from_integers(to, x.clone()),
        (Data::Truths(x), to) => Value::from_integers(to, x.map(i64::from)),
    }
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

/// The element of operand 1 where operand 0 holds, else of operand 2.
fn chosen<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let condition = call.truths(0)?;
    Value::arranged(&[call.operand(1)?, call.operand(2)?], |places| {
        let [yes, no] = places else { unreachable!("two values were given") };
        let both: Tensor<[usize; 2]> = zipped(yes, no, |yes, no| [yes, no])?;
        zipped(condition, &both, |condition, [yes, no]| if condition { yes } else { no })
    })
}

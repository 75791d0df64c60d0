//! Operators that compare, combine truths and choose.
//!
//! Numbers are compared by their values: of numbers that are known exactly, as those that a runtime handed over, this
//! is what any implementation must do.

use std::cmp::Ordering;

use vitruvian_reference::nn::{Scalar, Tensor, broadcast as zip};

use super::{Answer, Call, Data, Value, broadcast};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "And" => logical(call, |a, b| a && b),
        "Equal" => compared(call, |a, b| a == b, |a, b| a == b),
        "Greater" => compared(call, |a, b| a > b, |a, b| a > b),
        "GreaterOrEqual" => compared(call, |a, b| a >= b, |a, b| a >= b),
        "Less" => compared(call, |a, b| a < b, |a, b| a < b),
        "LessOrEqual" => compared(call, |a, b| a <= b, |a, b| a <= b),
        "Not" => call.truths(0).map(|x| Value::from_truths(x.map(|x| !x))),
        "Or" => logical(call, |a, b| a || b),
        "Where" => chosen(call),
        "Xor" => logical(call, |a, b| a != b),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// f(a, b) element by element, with broadcasting.
pub(super) fn zipped<A: Copy, B: Copy, C>(
    a: &Tensor<A>,
    b: &Tensor<B>,
    f: impl Fn(A, B) -> C,
) -> Result<Tensor<C>, String> {
    broadcast(&a.shape, &b.shape)?;
    Ok(zip("Where", a, b, f))
}

fn logical<T: Scalar>(call: &Call<T>, f: fn(bool, bool) -> bool) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    Ok(Value::from_truths(zipped(call.truths(0)?, call.truths(1)?, f)?))
}

fn compared<T: Scalar>(
    call: &Call<T>,
    numbers: fn(f64, f64) -> bool,
    integers: fn(i64, i64) -> bool,
) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    call.same_type()?;
    Ok(Value::from_truths(match &call.operand(0)?.data {
        Data::Numbers(a) => zipped(a, call.numbers(1)?, |a: T, b: T| numbers(a.value(), b.value()))?,
        Data::Integers(a) => zipped(a, call.integers(1)?, integers)?,
        Data::Truths(a) => {
            zipped(a, call.truths(1)?, |a: bool, b: bool| integers(i64::from(a), i64::from(b)))?
        }
    }))
}

/// How two elements of a tensor compare; a NaN is larger than every number.
pub(super) fn order<T: Scalar>(x: &Value<T>, a: usize, b: usize) -> Ordering {
    match &x.data {
        Data::Numbers(x) => {
            let (a, b) = (x.data[a].value(), x.data[b].value());
            // Only a NaN has no order; −0 and 0 are equal.
            a.partial_cmp(&b).unwrap_or_else(|| a.is_nan().cmp(&b.is_nan()))
        }
        Data::Integers(x) => x.data[a].cmp(&x.data[b]),
        Data::Truths(x) => x.data[a].cmp(&x.data[b]),
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

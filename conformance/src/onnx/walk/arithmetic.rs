//! Operators that compute element by element; sums, differences and products also of integers, as shapes need them.

use vitruvian_reference::nn::{
    Scalar, Tensor, acos, add, atan, clip, cos, div, exp, expand, leaky_relu, log, maximum, minimum, mul,
    pow, relu, sigmoid, sin, softplus, sub, tanh,
};

use super::{Answer, Call, Data, Value, broadcast};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let unary = |f: &dyn Fn(&Tensor<T>) -> Tensor<T>| call.numbers(0).and_then(|x| call.like(f(x)));
    let y = match call.operator {
        "Abs" => unary(&|x| x.map(|x| x.maximum(-x))),
        "Acos" => unary(&acos),
        "Add" => binary(call, add, |a, b| Some(a.wrapping_add(b))),
        "Atan" => unary(&atan),
        "Clip" => bounded(call).and_then(|y| call.like(y)),
        "Cos" => unary(&cos),
        "Div" => binary(call, div, i64::checked_div),
        "Exp" => unary(&exp),
        "LeakyRelu" => call
            .attributes(&["alpha"])
            .and_then(|known| unary(&|x| leaky_relu(x, known.float("alpha", 0.01)))),
        "Log" => unary(&log),
        "Max" => folded(call, maximum),
        "Min" => folded(call, minimum),
        "Mul" => binary(call, mul, |a, b| Some(a.wrapping_mul(b))),
        "Neg" => match call.optional(0) {
            Some(Value { element, data: Data::Integers(x) }) => {
                Value::from_integers(*element, x.map(i64::wrapping_neg))
            }
            _ => unary(&|x| x.map(|x| -x)),
        },
        "Pow" => power(call).and_then(|y| call.like(y)),
        "Reciprocal" => unary(&|x| x.map(|x| T::exact(1.0) / x)),
        "Relu" => unary(&relu),
        "Sigmoid" => unary(&sigmoid),
        "Sin" => unary(&sin),
        "Softplus" => unary(&softplus),
        "Sqrt" => unary(&|x| x.map(T::sqrt)),
        "Sub" => binary(call, sub, |a, b| Some(a.wrapping_sub(b))),
        "Tanh" => unary(&tanh),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// a ∘ b of numbers or of integers, whose division may not exist.
fn binary<T: Scalar>(
    call: &Call<T>,
    numbers: fn(&Tensor<T>, &Tensor<T>) -> Tensor<T>,
    integers: fn(i64, i64) -> Option<i64>,
) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let element = same_type(call)?;
    match &call.operand(0)?.data {
        Data::Integers(a) => {
            let b = call.integers(1)?;
            let results = zipped(a, b, integers)?;
            let whole: Option<Vec<i64>> = results.data.into_iter().collect();
            let data =
                whole.ok_or_else(|| format!("integers {:?} have no quotient by {:?}", a.data, b.data))?;
            Value::from_integers(element, Tensor { shape: results.shape, data })
        }
        _ => {
            let (a, b) = (call.numbers(0)?, call.numbers(1)?);
            broadcast(&a.shape, &b.shape)?;
            call.like(numbers(a, b))
        }
    }
}

/// The one element type of all operands.
pub(super) fn same_type<T: Scalar>(call: &Call<T>) -> Result<ElementType, String> {
    let element = call.operand(0)?.element;
    match call.operands.iter().flatten().find(|operand| operand.element != element) {
        Some(other) => Err(format!("operands of {element} and of {} do not mix", other.element)),
        None => Ok(element),
    }
}

/// f(a, b) element by element, with broadcasting.
pub(super) fn zipped<A: Copy, B: Copy, C: Copy>(
    a: &Tensor<A>,
    b: &Tensor<B>,
    f: impl Fn(A, B) -> C,
) -> Result<Tensor<C>, String> {
    let shape = broadcast(&a.shape, &b.shape)?;
    let (a, b) = (expand(a, &shape), expand(b, &shape));
    Ok(Tensor { data: a.data.iter().zip(&b.data).map(|(&a, &b)| f(a, b)).collect(), shape })
}

/// The largest or smallest of one tensor or more.
fn folded<T: Scalar>(
    call: &Call<T>,
    choose: fn(&Tensor<T>, &Tensor<T>) -> Tensor<T>,
) -> Result<Value<T>, String> {
    same_type(call)?;
    let first = call.numbers(0)?.clone();
    let all = (1..call.operands.len()).try_fold(first, |y, i| {
        let x = call.numbers(i)?;
        broadcast(&y.shape, &x.shape)?;
        Ok::<_, String>(choose(&y, x))
    });
    call.like(all?)
}

/// A number given as a tensor of one element.
fn scalar<T: Scalar>(call: &Call<T>, i: usize) -> Result<Option<T>, String> {
    let Some(x) = call.optional_numbers(i)? else { return Ok(None) };
    match x.data[..] {
        [value] => Ok(Some(value)),
        _ => Err(format!("operand {i} has shape {:?}, one number was expected", x.shape)),
    }
}

fn bounded<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["min", "max"])?;
    let attribute = |name| attributes.has(name).then(|| T::exact(attributes.float(name, 0.0)));
    let (low, high) = (scalar(call, 1)?.or(attribute("min")), scalar(call, 2)?.or(attribute("max")));
    Ok(clip(call.numbers(0)?, low, high))
}

fn power<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let exponent = match &call.operand(1)?.data {
        Data::Integers(n) if n.data.len() == 1 => n.data[0] as f64,
        _ => scalar(call, 1)?.map(T::value).ok_or("one exponent was expected")?,
    };
    Ok(pow(call.numbers(0)?, exponent))
}

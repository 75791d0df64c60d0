//! Operators that compute element by element; sums, differences and products also of integers, as shapes need them.

use vitruvian_reference::nn::{
    Scalar, Tensor, acos, add, atan, clip, cos, div, exp, expand, leaky_relu, log, maximum, minimum, mul,
    pow, relu, sigmoid, sin, softplus, sub, tanh,
};

use super::{Answer, Call, Value};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let unary = |f: &dyn Fn(&Tensor<T>) -> Tensor<T>| call.numbers(0).map(|x| Value::Numbers(f(x)));
    let y = match call.operator {
        "Abs" => unary(&|x| x.map(|x| x.maximum(-x))),
        "Acos" => unary(&acos),
        "Add" => binary(call, add, |a, b| Some(a.wrapping_add(b))),
        "Atan" => unary(&atan),
        "Clip" => bounded(call).map(Value::Numbers),
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
            Some(Value::Integers(x)) => Ok(Value::Integers(x.map(i64::wrapping_neg))),
            _ => unary(&|x| x.map(|x| -x)),
        },
        "Pow" => power(call).map(Value::Numbers),
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
    match call.operand(0)? {
        Value::Integers(a) => {
            let b = call.integers(1)?;
            let results = zipped(a, b, integers);
            let whole: Option<Vec<i64>> = results.data.into_iter().collect();
            let data =
                whole.ok_or_else(|| format!("integers {:?} have no quotient by {:?}", a.data, b.data))?;
            Ok(Value::Integers(Tensor { shape: results.shape, data }))
        }
        _ => Ok(Value::Numbers(numbers(call.numbers(0)?, call.numbers(1)?))),
    }
}

/// f(a, b) element by element, with broadcasting.
pub(super) fn zipped<A: Copy, B: Copy, C: Copy>(
    a: &Tensor<A>,
    b: &Tensor<B>,
    f: impl Fn(A, B) -> C,
) -> Tensor<C> {
    let a = expand(a, &b.shape);
    let b = expand(b, &a.shape);
    Tensor { data: a.data.iter().zip(&b.data).map(|(&a, &b)| f(a, b)).collect(), shape: a.shape }
}

/// The largest or smallest of one tensor or more.
fn folded<T: Scalar>(
    call: &Call<T>,
    choose: fn(&Tensor<T>, &Tensor<T>) -> Tensor<T>,
) -> Result<Value<T>, String> {
    let first = call.numbers(0)?.clone();
    let all = (1..call.operands.len()).try_fold(first, |y, i| Ok::<_, String>(choose(&y, call.numbers(i)?)));
    Ok(Value::Numbers(all?))
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
    let exponent = match call.operand(1)? {
        Value::Integers(n) if n.data.len() == 1 => n.data[0] as f64,
        _ => scalar(call, 1)?.map(T::value).ok_or("one exponent was expected")?,
    };
    Ok(pow(call.numbers(0)?, exponent))
}

//! Sums, products, quotients, remainders and powers of two operands or more, and what chooses among them; of integers as well.
//!
//! Integers are exact and wrap to their type. A quotient is cut off towards zero; there is none by zero.

use std::num::Wrapping;

use vitruvian_reference::nn::{
    Elementary, Ring, Scalar, Tensor, add, broadcast as zip, clip, div, maximum, mean, minimum, modulo, mul,
    sub, sum,
};

use super::{Answer, Call, Data, Value, broadcast};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "Add" => ring(call, add, add),
        "Clip" => clipped(call),
        "Div" => binary(call, div, |a, b| a.checked_div(b).or((b != 0).then_some(a.wrapping_neg()))),
        "Max" => folded(call, maximum, i64::max),
        "Mean" => several(call).and_then(|all| call.like(mean(&all))),
        "Min" => folded(call, minimum, i64::min),
        "Mod" => remainder(call),
        "Mul" => ring(call, mul, mul),
        "Pow" => power(call),
        "Sub" => ring(call, sub, sub),
        "Sum" => several(call).and_then(|all| call.like(sum(&all))),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// a ∘ b in a ring: of numbers, or of integers modulo 2⁶⁴, which are then cut to their type.
fn ring<T: Scalar>(
    call: &Call<T>,
    numbers: fn(&Tensor<T>, &Tensor<T>) -> Tensor<T>,
    integers: fn(&Tensor<Wrapping<i64>>, &Tensor<Wrapping<i64>>) -> Tensor<Wrapping<i64>>,
) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let element = call.same_type()?;
    broadcast(call.operand(0)?.shape(), call.operand(1)?.shape())?;
    match &call.operand(0)?.data {
        Data::Integers(a) => {
            let y = integers(&a.map(Wrapping), &call.integers(1)?.map(Wrapping));
            Value::from_integers(element, y.map(|y| y.0))
        }
        _ => call.like(numbers(call.numbers(0)?, call.numbers(1)?)),
    }
}

/// a ∘ b of numbers or of integers, where there may be no answer.
fn binary<T: Scalar>(
    call: &Call<T>,
    numbers: impl Fn(&Tensor<T>, &Tensor<T>) -> Tensor<T>,
    integers: impl Fn(i64, i64) -> Option<i64>,
) -> Result<Value<T>, String> {
    let element = call.same_type()?;
    broadcast(call.operand(0)?.shape(), call.operand(1)?.shape())?;
    match &call.operand(0)?.data {
        Data::Integers(a) => {
            let results = zip(call.operator, a, call.integers(1)?, |a, b| {
                integers(a, b).ok_or_else(|| format!("the integers {a} and {b} have no answer"))
            });
            let data = results.data.into_iter().collect::<Result<_, _>>()?;
            Value::from_integers(element, Tensor { shape: results.shape, data })
        }
        _ => call.like(numbers(call.numbers(0)?, call.numbers(1)?)),
    }
}

/// The remainder with the divisor's sign, or with `fmod` that of the dividend.
fn remainder<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let truncated = call.attributes(&["fmod"])?.flag("fmod", false)?;
    binary(
        call,
        |a, b| modulo(a, b, truncated),
        |a, b| {
            if b == 0 {
                return None;
            }
            let remainder = a.wrapping_rem(b);
            let other_side = remainder != 0 && (remainder < 0) != (b < 0);
            Some(if other_side && !truncated { remainder + b } else { remainder })
        },
    )
}

/// All operands, which are numbers of one type and broadcast together.
fn several<'a, T: Scalar>(call: &Call<'a, T>) -> Result<Vec<&'a Tensor<T>>, String> {
    call.attributes(&[])?;
    call.same_type()?;
    call.operand(0)?;
    let all: Vec<&Tensor<T>> = (0..call.operands.len()).map(|i| call.numbers(i)).collect::<Result<_, _>>()?;
    all.iter().try_fold(Vec::new(), |shape, x| broadcast(&shape, &x.shape))?;
    Ok(all)
}

/// The largest or smallest of one tensor or more.
fn folded<T: Scalar>(
    call: &Call<T>,
    numbers: fn(&Tensor<T>, &Tensor<T>) -> Tensor<T>,
    integers: fn(i64, i64) -> i64,
) -> Result<Value<T>, String> {
    if let Data::Integers(first) = &call.operand(0)?.data {
        call.attributes(&[])?;
        let element = call.same_type()?;
        let all = (1..call.operands.len()).try_fold(first.clone(), |y, i| {
            let x = call.integers(i)?;
            broadcast(&y.shape, &x.shape)?;
            Ok::<_, String>(zip(call.operator, &y, x, integers))
        });
        return Value::from_integers(element, all?);
    }
    let all = several(call)?;
    call.like(all[1..].iter().fold(all[0].clone(), |y, x| numbers(&y, x)))
}

/// x within bounds that are operands of one element, or attributes of the older versions; the upper one wins.
fn clipped<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["max", "min"])?;
    let element = call.same_type()?;
    let one = |i: usize| match call.optional(i) {
        Some(bound) if bound.len() != 1 => {
            Err(format!("operand {i} has shape {:?}, one element was expected", bound.shape()))
        }
        bound => Ok(bound),
    };
    let (low, high) = (one(1)?, one(2)?);
    if let Data::Integers(x) = &call.operand(0)?.data {
        let bound = |value: Option<&Value<T>>| value.map(|v| v.integers().map(|v| v.data[0])).transpose();
        let (low, high) = (bound(low)?.unwrap_or(i64::MIN), bound(high)?.unwrap_or(i64::MAX));
        return Value::from_integers(element, x.map(|x| x.max(low).min(high)));
    }
    let bound = |value: Option<&Value<T>>, name: &str| match value {
        Some(value) => value.numbers().map(|v| Some(v.data[0])),
        None => attributes.has(name).then(|| call.constant(attributes.float(name, 0.0))).transpose(),
    };
    call.like(clip(call.numbers(0)?, bound(low, "min")?, bound(high, "max")?))
}

/// xʸ in the type of x, whatever that of y: an integer x has its power cut off towards zero.
fn power<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let (base, exponent) = (call.operand(0)?, call.operand(1)?);
    broadcast(base.shape(), exponent.shape())?;
    let zipped = |f: &dyn Fn(i64, f64) -> Result<i64, String>, x: &Tensor<i64>, y: &Tensor<f64>| {
        let results = zip("Pow", x, y, f);
        let data = results.data.into_iter().collect::<Result<_, _>>()?;
        Value::from_integers(base.element, Tensor { shape: results.shape, data })
    };
    match (&base.data, &exponent.data) {
        (Data::Numbers(x), Data::Numbers(y)) => call.like(zip("Pow", x, y, Elementary::pow)),
        (Data::Numbers(x), Data::Integers(y)) => {
            call.like(zip("Pow", x, &y.map(|y| T::exact(y as f64)), Elementary::pow))
        }
        (Data::Integers(x), Data::Integers(y)) if y.data.iter().all(|&y| y >= 0) => {
            let y = zip("Pow", x, y, |x, y| whole_power(Wrapping(x), y).0);
            Value::from_integers(base.element, y)
        }
        (Data::Integers(x), Data::Integers(y)) => zipped(&cut_off_power, x, &y.map(|y| y as f64)),
        (Data::Integers(x), Data::Numbers(y)) => zipped(&cut_off_power, x, &y.map(T::value)),
        _ => Err("truths have no powers".into()),
    }
}

/// xʸ for y ≥ 0, by squaring.
fn whole_power<T: Ring>(x: T, y: i64) -> T {
    let (mut power, mut square, mut rest) = (T::one(), x, y);
    while rest > 0 {
        if rest % 2 == 1 {
            power = power * square;
        }
        square = square * square;
        rest /= 2;
    }
    power
}

fn cut_off_power(x: i64, y: f64) -> Result<i64, String> {
    let power = (x as f64).powf(y).trunc();
    // An i64 as f64 is below 2⁶³.
    if power.abs() < 9_223_372_036_854_775_808.0 {
        Ok(power as i64)
    } else {
        Err(format!("the integer {x} has no power {y}"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::int;
    use crate::onnx::element::ElementType;

    fn integers(element: ElementType, data: &[i64]) -> Value {
        Value::from_integers(element, Tensor::new(&[data.len()], data.to_vec())).expect("integers")
    }

    fn of(operator: &str, a: &Value, b: &Value) -> Result<Vec<i64>, String> {
        let y = evaluate(&node(operator, vec![]), 21, &[Some(a), Some(b)])?;
        Ok(y[0].as_ref().expect("an output").integers()?.data.clone())
    }

    #[test]
    fn integers_wrap_to_their_type() {
        let (a, b) = (integers(ElementType::U8, &[200, 3]), integers(ElementType::U8, &[100, 5]));
        assert_eq!(of("Add", &a, &b), Ok(vec![44, 8]));
        assert_eq!(of("Sub", &a, &b), Ok(vec![100, 254]));
        assert_eq!(of("Mul", &a, &b), Ok(vec![32, 15]));
        assert_eq!(of("Max", &a, &b), Ok(vec![200, 5]));
        let (a, b) = (integers(ElementType::I8, &[-128, -7]), integers(ElementType::I8, &[-1, 2]));
        assert_eq!(of("Div", &a, &b), Ok(vec![-128, -3]), "towards zero, with wrap");
        assert_eq!(of("Mod", &a, &b), Ok(vec![0, 1]), "with the sign of the divisor");
    }

    #[test]
    fn nothing_divides_by_zero() {
        let (a, zero) = (integers(ElementType::I32, &[7]), integers(ElementType::I32, &[0]));
        for operator in ["Div", "Mod"] {
            let why = of(operator, &a, &zero).expect_err("refused");
            assert!(why.contains("the integers 7 and 0 have no answer"), "{why}");
        }
    }

    #[test]
    fn integer_powers_wrap_and_are_cut_off() {
        let x = integers(ElementType::I32, &[3, -2, 65_536, 2]);
        assert_eq!(of("Pow", &x, &integers(ElementType::I64, &[4, 3, 2, 0])), Ok(vec![81, -8, 0, 1]));
        assert_eq!(of("Pow", &x, &integers(ElementType::I64, &[-1, -1, -1, -1])), Ok(vec![0, 0, 0, 0]));
        let half = Value::from_numbers(ElementType::F32, Tensor::new(&[], vec![0.5]));
        let x = integers(ElementType::I32, &[9, 8]);
        assert_eq!(of("Pow", &x, &half), Ok(vec![3, 2]));
        let zero = integers(ElementType::I32, &[0]);
        assert!(of("Pow", &zero, &integers(ElementType::I32, &[-1])).is_err(), "0⁻¹");
    }

    #[test]
    fn types_do_not_mix_and_attributes_are_not_passed_over() {
        let (a, b) = (integers(ElementType::I32, &[1]), integers(ElementType::I64, &[1]));
        assert!(of("Add", &a, &b).expect_err("refused").contains("operands of i32 and of i64 do not mix"));
        let old =
            evaluate(&node("Add", vec![int("axis", 1)]), 21, &[Some(&a), Some(&a)]).expect_err("refused");
        assert!(old.contains("\"axis\""), "{old}");
    }
}

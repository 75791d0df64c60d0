//! Operators over axes: sums, means, extrema and their places, softmax, running sums.

use std::num::Wrapping;

use vitruvian_reference::nn::{
    Cumulative, Scalar, Tensor, cumulative_product, cumulative_sum, hardmax, log_softmax, place_of_extremum,
    reduce, reduce_l1, reduce_l2, reduce_log_sum, reduce_log_sum_exp, reduce_max, reduce_mean, reduce_min,
    reduce_prod, reduce_sum, reduce_sum_square, softmax,
};

use super::{Answer, Call, Data, Value, axes, axis};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "ArgMax" => place(call, |a, b| a > b, |a, b| a > b || (a.is_nan() && !b.is_nan())),
        "ArgMin" => place(call, |a, b| a < b, |a, b| a < b || (a.is_nan() && !b.is_nan())),
        "CumProd" => running(call, cumulative_product, cumulative_product),
        "CumSum" => running(call, cumulative_sum, cumulative_sum),
        "Hardmax" => along_axis(call, hardmax),
        "LogSoftmax" => along_axis(call, log_softmax),
        "ReduceL1" => reduced(call, reduce_l1, |x, _| Ok(total(x.iter().map(|x| x.wrapping_abs())))),
        "ReduceL2" => reduced(call, reduce_l2, |x, _| {
            cut_off(x.iter().map(|&x| (x as f64) * (x as f64)).sum::<f64>().sqrt())
        }),
        "ReduceLogSum" => {
            reduced(call, reduce_log_sum, |x, _| cut_off(x.iter().map(|&x| x as f64).sum::<f64>().ln()))
        }
        "ReduceLogSumExp" => reduced(call, reduce_log_sum_exp, |x, _| {
            let x = Tensor::new(&[x.len()], x.iter().map(|&x| x as f64).collect());
            cut_off(reduce_log_sum_exp(&x, &[0], false).data[0])
        }),
        "ReduceMax" => reduced(call, reduce_max, |x, (low, _)| Ok(x.iter().copied().max().unwrap_or(low))),
        "ReduceMean" => reduced(call, reduce_mean, |x, _| {
            let sum: i128 = x.iter().map(|&x| i128::from(x)).sum();
            sum.checked_div(x.len() as i128)
                .map(|mean| mean as i64)
                .ok_or_else(|| "the mean of nothing".into())
        }),
        "ReduceMin" => reduced(call, reduce_min, |x, (_, high)| Ok(x.iter().copied().min().unwrap_or(high))),
        "ReduceProd" => {
            reduced(call, reduce_prod, |x, _| Ok(x.iter().fold(1, |y: i64, &x| y.wrapping_mul(x))))
        }
        "ReduceSum" => reduced(call, reduce_sum, |x, _| Ok(total(x.iter().copied()))),
        "ReduceSumSquare" => {
            reduced(call, reduce_sum_square, |x, _| Ok(total(x.iter().map(|x| x.wrapping_mul(*x)))))
        }
        "Softmax" => along_axis(call, softmax),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// A sum modulo 2⁶⁴.
fn total(terms: impl Iterator<Item = i64>) -> i64 {
    terms.fold(0, i64::wrapping_add)
}

/// What is left of a number when an integer must hold it.
fn cut_off(y: f64) -> Result<i64, String> {
    // An i64 as f64 is below 2⁶³.
    if y.abs() < 9_223_372_036_854_775_808.0 { Ok(y as i64) } else { Err(format!("{y} is no integer")) }
}

/// The axes that an operator with `axes` as its attribute or its operand 1 reduces: all, unless it asks for none.
fn reduced_axes<T: Scalar>(call: &Call<T>) -> Result<(Vec<usize>, bool), String> {
    let attributes = call.attributes(&["axes", "keepdims", "noop_with_empty_axes"])?;
    let rank = call.operand(0)?.shape().len();
    let mut over = axes(&call.list(1, attributes, "axes")?.unwrap_or_default(), rank)?;
    // Without axes only the reduction itself is left out: a ReduceSumSquare still squares.
    if over.is_empty() && !attributes.flag("noop_with_empty_axes", false)? {
        over = (0..rank).collect();
    }
    Ok((over, attributes.flag("keepdims", true)?))
}

/// A reduction of numbers, or of integers given the smallest and largest of their type.
fn reduced<T: Scalar>(
    call: &Call<T>,
    numbers: fn(&Tensor<T>, &[usize], bool) -> Tensor<T>,
    integers: fn(&[i64], (i64, i64)) -> Result<i64, String>,
) -> Result<Value<T>, String> {
    let (over, keepdims) = reduced_axes(call)?;
    let element = call.operand(0)?.element;
    match &call.operand(0)?.data {
        Data::Numbers(x) => call.like(numbers(x, &over, keepdims)),
        Data::Integers(x) => {
            let (low, high) = element.range().unwrap_or((i64::MIN.into(), i64::MAX.into()));
            let range = (low as i64, high.min(i64::MAX.into()) as i64);
            let y = reduce(x, &over, keepdims, |x| integers(x, range));
            let data = y.data.into_iter().collect::<Result<_, _>>()?;
            Value::from_integers(element, Tensor { shape: y.shape, data })
        }
        // Truths are ordered: false is less than true.
        Data::Truths(x) if call.operator == "ReduceMax" => {
            Ok(Value::from_truths(reduce(x, &over, keepdims, |x| x.contains(&true))))
        }
        Data::Truths(x) if call.operator == "ReduceMin" => {
            Ok(Value::from_truths(reduce(x, &over, keepdims, |x| !x.contains(&false))))
        }
        Data::Truths(_) => Err("operand 0 holds truths, numbers were expected".into()),
    }
}

fn place<T: Scalar>(
    call: &Call<T>,
    integers: fn(i64, i64) -> bool,
    numbers: fn(f64, f64) -> bool,
) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axis", "keepdims", "select_last_index"])?;
    let at = axis(attributes.int("axis", 0), call.operand(0)?.shape().len())?;
    let (keepdims, last) = (attributes.flag("keepdims", true)?, attributes.flag("select_last_index", false)?);
    let places = match &call.operand(0)?.data {
        Data::Integers(x) => place_of_extremum(x, at, keepdims, last, integers),
        _ => place_of_extremum(&call.numbers(0)?.map(T::value), at, keepdims, last, numbers),
    };
    Value::from_integers(ElementType::I64, places.map(|place| place as i64))
}

/// Over `axis` alone from version 13 on; before, over all axes from `axis` on, which is then 1 if not given.
fn along_axis<T: Scalar>(call: &Call<T>, f: fn(&Tensor<T>, usize) -> Tensor<T>) -> Result<Value<T>, String> {
    let x = call.numbers(0)?;
    let attributes = call.attributes(&["axis"])?;
    if call.opset >= 13 {
        return call.like(f(x, axis(attributes.int("axis", -1), x.rank())?));
    }
    // The axis may also stand behind the last.
    let at = attributes.int("axis", 1);
    let at = if at == x.rank() as i64 { x.rank() } else { axis(at, x.rank())? };
    let rows = x.shape[..at].iter().product();
    let flat = x.reshape(&[rows, x.shape[at..].iter().product()]);
    call.like(f(&flat, 1).reshape(&x.shape))
}

type Running<T> = fn(&Tensor<T>, usize, Cumulative) -> Tensor<T>;

fn running<T: Scalar>(
    call: &Call<T>,
    numbers: Running<T>,
    integers: Running<Wrapping<i64>>,
) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["exclusive", "reverse"])?;
    let how = Cumulative {
        exclusive: attributes.flag("exclusive", false)?,
        reverse: attributes.flag("reverse", false)?,
    };
    let at = match call.integers(1)?.data[..] {
        [at] => axis(at, call.operand(0)?.shape().len())?,
        _ => return Err(format!("operand 1 has shape {:?}, one axis was expected", call.integers(1)?.shape)),
    };
    match &call.operand(0)?.data {
        Data::Integers(x) => {
            let y = integers(&x.map(Wrapping), at, how);
            Value::from_integers(call.operand(0)?.element, y.map(|y| y.0))
        }
        _ => call.like(numbers(call.numbers(0)?, at, how)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::int;

    #[test]
    fn softmax_meant_all_axes_from_its_axis_on_until_version_13() {
        let x: Value = Value::from_numbers(ElementType::F32, Tensor::new(&[1, 2, 2], vec![0.0; 4]));
        let y = |opset, axis| {
            let y = evaluate(&node("Softmax", vec![int("axis", axis)]), opset, &[Some(&x)]).expect("y");
            y[0].as_ref().expect("an output").numbers().expect("numbers").data[0]
        };
        assert_eq!((y(12, 1), y(13, 1), y(12, 2)), (0.25, 0.5, 0.5));
    }

    #[test]
    fn no_axes_mean_all_unless_none_are_asked_for() {
        let x: Value = Value::from_numbers(ElementType::F32, Tensor::new(&[2], vec![3.0, -2.0]));
        let y = |attributes| {
            let y = evaluate(&node("ReduceSumSquare", attributes), 18, &[Some(&x)]).expect("y");
            y[0].as_ref().expect("an output").numbers().expect("numbers").data.clone()
        };
        assert_eq!(y(vec![]), [13.0]);
        assert_eq!(y(vec![int("noop_with_empty_axes", 1)]), [9.0, 4.0], "the squares remain");
    }

    #[test]
    fn integers_are_reduced_exactly() {
        let x: Value =
            Value::from_integers(ElementType::I8, Tensor::new(&[3], vec![100, -50, 99])).expect("i8");
        let y = |operator| {
            let y = evaluate(&node(operator, vec![]), 18, &[Some(&x)]).expect("y");
            y[0].as_ref().expect("an output").integers().expect("integers").data[0]
        };
        assert_eq!((y("ReduceSum"), y("ReduceMean"), y("ReduceMax"), y("ReduceMin")), (-107, 49, 100, -50));
        assert_eq!((y("ArgMax"), y("ArgMin")), (0, 1));
    }
}

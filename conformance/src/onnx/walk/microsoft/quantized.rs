//! ONNX's operators between integers that stand for numbers, x = (q − z)·s, with one scale and zero point for a tensor.

use vitruvian_reference::nn::{Scalar, Tensor, dequantize, global_average_pool, mul};

use super::{
    Answer, Call, Inner, Levels, Value, broadcast, channels_first, channels_last, scale, zero_point,
};
use crate::onnx::element::ElementType;
use crate::onnx::value::Data;

/// Operators that give integers where their numbers can be told.
pub(super) fn levelled<T: Scalar>(call: &Call<T>) -> Option<Result<Levels<T>, String>> {
    let all = |first: usize| (first..call.operands.len()).step_by(3);
    Some(match call.operator {
        "QLinearAdd" => between(call, "Add", &[0, 3], 6),
        "QLinearAveragePool" => between(call, "AveragePool", &[0], 3),
        "QLinearConcat" => between(call, "Concat", &all(2).collect::<Vec<_>>(), 0),
        "QLinearGlobalAveragePool" => mean_of_images(call),
        "QLinearLeakyRelu" => between(call, "LeakyRelu", &[0], 3),
        "QLinearMul" => product(call),
        "QLinearSigmoid" => between(call, "Sigmoid", &[0], 3),
        "QLinearSoftmax" => between(call, "Softmax", &[0], 3),
        "QLinearWhere" => between(call, "Where", &[1, 4], 7),
        _ => return None,
    })
}

/// Operators of ONNX's own names.
pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "DequantizeLinear" | "QuantizeLinear" => along_axis(call),
        "NhwcMaxPool" => largest_of_windows(call),
        "QLinearConv" => convolution(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// The attributes that an operator has here: fewer than ONNX's, and others.
fn known(operator: &str) -> &'static [&'static str] {
    match operator {
        "AveragePool" => &[
            "auto_pad",
            "ceil_mode",
            "channels_last",
            "count_include_pad",
            "kernel_shape",
            "pads",
            "strides",
        ],
        "Concat" => &["axis"],
        "LeakyRelu" => &["alpha"],
        "Softmax" => &["axis", "opset"],
        _ => &[],
    }
}

/// The attributes that ONNX's operators do not have.
const OUTER: [&str; 2] = ["channels_last", "opset"];

/// The integers of operand `i`, which stand for numbers.
fn stored<'a, T: Scalar>(call: &Call<'a, T>, i: usize) -> Result<&'a Tensor<i64>, String> {
    let element = call.operand(i)?.element;
    if !matches!(element, ElementType::I8 | ElementType::U8) {
        return Err(format!("operand {i} is of {element}, i8 or u8 was expected"));
    }
    if let Some(zero) = call.optional(i + 2).filter(|zero| zero.element != element) {
        return Err(format!("operand {i} is of {element} and its zero point of {}", zero.element));
    }
    call.integers(i)
}

/// One of ONNX's operators on the numbers that the operands `at` stand for; `to` is where the output's scale is.
fn between<T: Scalar>(call: &Call<T>, operator: &str, at: &[usize], to: usize) -> Result<Levels<T>, String> {
    let attributes = call.attributes(known(operator))?;
    let last = attributes.flag("channels_last", false)?;
    let mut inner = Inner::of(call, operator, &OUTER);
    if operator == "Softmax" {
        if !attributes.has("opset") {
            return Err("attribute \"opset\" is missing, which says what Softmax means".into());
        }
        inner.opset = attributes.int("opset", 0);
    }
    let number = |&i: &usize| {
        let x = dequantize(stored(call, i)?, scale(call, i + 1)?, zero_point(call, i + 2)?);
        Ok(Value::from_numbers(ElementType::F32, if last { channels_first(&x) } else { x }))
    };
    let numbers = at.iter().map(number).collect::<Result<Vec<Value<T>>, String>>()?;
    // What is chosen by is no number.
    let choice = (operator == "Where").then(|| call.operand(0)).transpose()?;
    let operands: Vec<_> = choice.into_iter().chain(&numbers).map(Some).collect();
    let y = inner.run(&operands)?;
    let first = at.first().ok_or("there is nothing to join")?;
    let y = y.numbers()?;
    let y = if last { &channels_last(y) } else { y };
    Levels::of(call, y, to, call.operand(*first)?.element)
}

/// The mean of a whole image: the integers are added up exactly, and their mean is scaled.
fn mean_of_images<T: Scalar>(call: &Call<T>) -> Result<Levels<T>, String> {
    let last = call.attributes(&["channels_last"])?.flag("channels_last", false)?;
    let (q, zero) = (stored(call, 0)?, zero_point(call, 2)?);
    let steps = q.map(|q| (q - zero) as f64);
    let mean = global_average_pool(&if last { channels_first(&steps) } else { steps });
    let scale = scale(call, 1)?;
    // The sum as a float, and the quotient by the number of pixels.
    let y = mean.map(|mean| T::within(mean, mean.abs(), 2.0) * scale);
    Levels::of(call, &if last { channels_last(&y) } else { y }, 3, call.operand(0)?.element)
}

/// A product: that of the integers is exact, and is scaled.
fn product<T: Scalar>(call: &Call<T>) -> Result<Levels<T>, String> {
    call.attributes(&[])?;
    let steps = |i: usize| {
        let zero = zero_point(call, i + 2)?;
        Ok::<_, String>(stored(call, i)?.map(|q| (q - zero) as f64))
    };
    let (a, b) = (steps(0)?, steps(3)?);
    broadcast(&a.shape, &b.shape)?;
    let (a_scale, b_scale) = (scale(call, 1)?, scale(call, 4)?);
    let y = mul(&a, &b).map(|steps| T::exact(steps) * a_scale * b_scale);
    Levels::of(call, &y, 6, call.operand(0)?.element)
}

/// Along the axis that is given, or with one scale where none is, which ONNX's own have an axis for.
fn along_axis<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let inner = Inner::of(call, call.operator, &[]);
    let scales = call.operand(1)?;
    if scales.len() != 1 && !call.node.attribute.iter().any(|a| a.name.as_deref() == Some("axis")) {
        return Err(format!("scales {:?} without the attribute \"axis\", one was expected", scales.shape()));
    }
    inner.run(call.operands)
}

fn largest_of_windows<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let x = moved(call.operand(0)?, channels_first)?;
    moved(&Inner::of(call, "MaxPool", &[]).run(&[Some(&x)])?, channels_last)
}

/// ONNX's own, with the channels behind the image if asked for.
fn convolution<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let inner = Inner::of(call, "QLinearConv", &OUTER[..1]);
    if !inner.attributes(&OUTER[..1])?.flag("channels_last", false)? {
        return inner.run(call.operands);
    }
    let x = moved(call.operand(0)?, channels_first)?;
    let operands: Vec<_> = [Some(&x)].into_iter().chain(call.operands.iter().skip(1).copied()).collect();
    moved(&inner.run(&operands)?, channels_last)
}

/// Integers in another order.
fn moved<T: Scalar>(x: &Value<T>, order: fn(&Tensor<i64>) -> Tensor<i64>) -> Result<Value<T>, String> {
    match &x.data {
        Data::Integers(q) if q.rank() > 2 => Value::from_integers(x.element, order(q)),
        _ => Err(format!("{} of shape {:?}, integers [N,spatial…,C] were expected", x.kind(), x.shape())),
    }
}

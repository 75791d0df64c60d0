//! Operators on quantised numbers: q = saturate(round(x/s) + z), x ≈ (q − z)·s.
//!
//! Products of integers are summed in f64, which is exact below 2⁵³: sums of 8-bit products stay there.

use vitruvian_reference::nn::{
    IntegerRange, Scalar, Tensor, conv, expand, matmul, quantize, quantize_dynamically, spread,
};

use super::convolution::window_over;
use super::creation::element;
use super::{Answer, Attributes, Call, Value, axis};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "ConvInteger" => convolved(call),
        "DequantizeLinear" => dequantized(call),
        "DynamicQuantizeLinear" => return Some(dynamic(call)),
        "MatMulInteger" => multiplied(call),
        "QLinearConv" => quantised_convolution(call),
        "QLinearMatMul" => quantised_product(call),
        "QuantizeLinear" => quantized(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// Parameters spread over a shape, along the axis and in the blocks that the attributes say.
fn over<E: Copy>(
    parameters: &Tensor<E>,
    shape: &[usize],
    attributes: Attributes,
) -> Result<Tensor<E>, String> {
    let block = attributes.count("block_size", 0)?;
    // One parameter for all needs no axis, and the default may not exist.
    let along = match parameters.data.len() == 1 && block == 0 {
        true => 0,
        false => axis(attributes.int("axis", 1), shape.len())?,
    };
    Ok(spread(parameters, shape, along, block))
}

/// The integers of a type, all of which an i64 holds.
pub(super) fn range(element: ElementType) -> Result<IntegerRange, String> {
    let range = element.range().and_then(|(first, last)| {
        Some(IntegerRange { first: i64::try_from(first).ok()?, last: i64::try_from(last).ok()? })
    });
    range.ok_or_else(|| format!("{element} is no type of quantised numbers"))
}

/// Numbers, or integers as numbers.
fn values<T: Scalar>(call: &Call<T>, i: usize) -> Result<Tensor<f64>, String> {
    if call.operand(i)?.element.is_float() {
        return Ok(call.numbers(i)?.map(T::value));
    }
    Ok(call.integers(i)?.map(|i| i as f64))
}

/// A zero point, or as many zeros as there are scales.
fn zero_point<T: Scalar>(call: &Call<T>, i: usize, scales: &[usize]) -> Result<Tensor<i64>, String> {
    match call.optional(i) {
        Some(_) => Ok(call.integers(i)?.clone()),
        None => Ok(Tensor::filled(scales, 0)),
    }
}

fn quantized<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    // What `saturate` says is about 8-bit floats alone.
    let known = ["axis", "block_size", "output_dtype", "precision", "saturate"];
    let attributes = call.attributes(&known)?;
    let (x, scale) = (values(call, 0)?, call.numbers(1)?.map(T::value));
    let default = call.optional(2).map_or(ElementType::U8, |zero_point| zero_point.element);
    let to = match attributes.int("output_dtype", 0) {
        0 => default,
        _ => element(attributes, "output_dtype", default)?,
    };
    let zero_point = over(&zero_point(call, 2, &scale.shape)?, &x.shape, attributes)?;
    let scale = over(&scale, &x.shape, attributes)?;
    // The quotient has the type that `precision` names, else that of the scale.
    let precision = match attributes.int("precision", 0) {
        0 => call.operand(1)?.element,
        _ => element(attributes, "precision", ElementType::F32)?,
    };
    Value::from_integers(to, quantize(&x, &scale, &zero_point, range(to)?, |x| precision.round(x)))
}

fn dequantized<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axis", "block_size", "output_dtype"])?;
    let (q, scale) = (call.integers(0)?, call.numbers(1)?);
    let default = call.operand(1)?.element;
    let to = match attributes.int("output_dtype", 0) {
        0 => default,
        _ => element(attributes, "output_dtype", default)?,
    };
    if !to.is_float() {
        return Err(format!("an output of {to}, a float type was expected"));
    }
    let zero_point = over(&zero_point(call, 2, &scale.shape)?, &q.shape, attributes)?;
    let scale = over(scale, &q.shape, attributes)?;
    let back = |((&q, &z), &s): ((&i64, &i64), &T)| {
        // A wide integer, as a bias has, is rounded on its way into the float type.
        let steps = (q - z) as f64;
        let fits = to.round(steps) == steps;
        (if fits { T::exact(steps) } else { T::within(steps, steps.abs(), 1.0) }) * s
    };
    let data = q.data.iter().zip(&zero_point.data).zip(&scale.data).map(back).collect();
    Ok(Value::from_numbers(to, Tensor::new(&q.shape, data)))
}

fn dynamic<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    call.attributes(&[])?;
    let (x, element) = (call.numbers(0)?, call.operand(0)?.element);
    let (q, scale, zero_point) = quantize_dynamically(&x.map(T::value), |x| element.round(x));
    // (max − min)/255 is two roundings of exact numbers; neither cancels, as max ≥ 0 ≥ min.
    let scale = T::within(scale, scale, 2.0);
    Ok(vec![
        Value::from_integers(ElementType::U8, q)?,
        call.like(Tensor::new(&[], vec![scale]))?,
        Value::from_integers(ElementType::U8, Tensor::new(&[], vec![zero_point]))?,
    ])
}

/// q − z as numbers, the zero points standing along `along` axes from the last one where there are several.
pub(super) fn centred<T: Scalar>(
    call: &Call<T>,
    q: usize,
    z: usize,
    shape: &[usize],
) -> Result<Tensor<f64>, String> {
    let q = call.integers(q)?;
    if call.optional(z).is_none() {
        return Ok(q.map(|q| q as f64));
    }
    let z = expand(&call.integers(z)?.reshape(shape), &q.shape);
    if z.shape != q.shape {
        return Err(format!("zero points {:?} do not fit {:?}", z.shape, q.shape));
    }
    let data = q.data.iter().zip(&z.data).map(|(q, z)| (q - z) as f64).collect();
    Ok(Tensor::new(&q.shape, data))
}

/// The shape in which parameters broadcast over a matrix: one for each row, or one for each column.
pub(super) fn of_matrix<T: Scalar>(call: &Call<T>, i: usize, rows: bool) -> Vec<usize> {
    match call.optional(i).map_or(&[][..], Value::shape) {
        &[1] => vec![],
        &[count] if rows => vec![count, 1],
        shape => shape.to_vec(),
    }
}

/// The shape in which parameters broadcast over weights: one for all, or one for each output channel.
fn of_weights<T: Scalar>(call: &Call<T>, i: usize, rank: usize) -> Vec<usize> {
    match call.optional(i).map_or(&[][..], Value::shape) {
        [] | [1] => vec![1; rank],
        shape => [shape, &vec![1; rank.saturating_sub(1)]].concat(),
    }
}

fn multiplied<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let a = centred(call, 0, 2, &of_matrix(call, 2, true))?;
    let b = centred(call, 1, 3, &of_matrix(call, 3, false))?;
    Value::from_integers(ElementType::I32, matmul(&a, &b).map(|y| y as i64))
}

/// Sums of products of scaled integers, quantised again: saturate(round(sum·scale/s_y) + z_y).
fn requantized<T: Scalar>(
    call: &Call<T>,
    sums: &Tensor<f64>,
    scale: &Tensor<f64>,
    parameters: usize,
) -> Result<Value<T>, String> {
    let element = call.operand(parameters + 1)?.element;
    let (&[s], &[z]) = (&call.numbers(parameters)?.data[..], &call.integers(parameters + 1)?.data[..]) else {
        return Err("one scale and one zero point of the output were expected".into());
    };
    let scale = expand(scale, &sums.shape);
    let data = sums.data.iter().zip(&scale.data).map(|(sum, scale)| sum * scale).collect();
    let s = Tensor::filled(&sums.shape, s.value());
    let z = Tensor::filled(&sums.shape, z);
    let precision = call.operand(parameters)?.element;
    let scaled = Tensor::new(&sums.shape, data);
    Value::from_integers(element, quantize(&scaled, &s, &z, range(element)?, |x| precision.round(x)))
}

fn product(a: &Tensor<f64>, b: &Tensor<f64>) -> Tensor<f64> {
    vitruvian_reference::nn::mul(a, b)
}

fn quantised_product<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let a = centred(call, 0, 2, &of_matrix(call, 2, true))?;
    let b = centred(call, 3, 5, &of_matrix(call, 5, false))?;
    let scale = |i, rows| Ok::<_, String>(values(call, i)?.reshape(&of_matrix(call, i, rows)));
    requantized(call, &matmul(&a, &b), &product(&scale(1, true)?, &scale(4, false)?), 6)
}

fn convolved<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let rank = call.operand(1)?.shape().len();
    let x = centred(call, 0, 2, &[])?;
    let w = centred(call, 1, 3, &of_weights(call, 3, rank))?;
    let y = conv(&x, &w, None, &window_over(call, &x, &w)?);
    Value::from_integers(ElementType::I32, y.map(|y| y as i64))
}

fn quantised_convolution<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let rank = call.operand(3)?.shape().len();
    let x = centred(call, 0, 2, &[])?;
    let w = centred(call, 3, 5, &of_weights(call, 5, rank))?;
    let bias = call.optional(8).map(|_| values(call, 8)).transpose()?;
    let sums = conv(&x, &w, bias.as_ref(), &window_over(call, &x, &w)?);
    // One scale for each output channel stands at axis 1 of the output, not at axis 0 as in the weights.
    let of_channels = of_weights(call, 4, rank.saturating_sub(1));
    let scales = product(&values(call, 1)?, &values(call, 4)?.reshape(&of_channels));
    requantized(call, &sums, &scales, 6)
}

#[cfg(test)]
mod tests {
    use vitruvian_reference::nn::Rounded;

    use super::super::tests::node;
    use super::super::{Data, evaluate};
    use super::*;
    use crate::onnx::builder::int;

    fn numbers(shape: &[usize], data: Vec<f64>) -> Value {
        Value::from_numbers(ElementType::F32, Tensor::new(shape, data))
    }

    fn integers(element: ElementType, shape: &[usize], data: Vec<i64>) -> Value {
        Value::from_integers(element, Tensor::new(shape, data)).expect("integers of the type")
    }

    fn first(operator: &str, axis: i64, operands: &[&Value]) -> Result<Value, String> {
        let operands: Vec<Option<&Value>> = operands.iter().copied().map(Some).collect();
        Ok(evaluate(&node(operator, vec![int("axis", axis)]), 21, &operands)?[0].clone().expect("an output"))
    }

    #[test]
    fn each_place_of_the_axis_has_its_own_scale() {
        let x = numbers(&[2, 2], vec![1.0, 2.0, 1.0, 2.0]);
        let (scale, zero) = (numbers(&[2], vec![1.0, 0.5]), integers(ElementType::I8, &[2], vec![0, -3]));
        let q = first("QuantizeLinear", 0, &[&x, &scale, &zero]).expect("quantised");
        assert_eq!(
            (q.element, &q.integers().expect("integers").data[..]),
            (ElementType::I8, &[1, 2, -1, 1][..])
        );
        assert_eq!(first("DequantizeLinear", 0, &[&q, &scale, &zero]), Ok(x.clone()), "and back");
        let other = first("QuantizeLinear", 0, &[&x, &numbers(&[3], vec![1.0; 3])]);
        assert!(other.expect_err("refused").contains("[3] do not fit shape [2, 2]"), "three scales for two");
    }

    #[test]
    fn a_wide_integer_is_rounded_before_it_is_scaled() {
        let q = integers(ElementType::I32, &[2], vec![(1 << 24) + 1, 1 << 24]);
        let q = Value::<Rounded> {
            element: q.element,
            data: Data::Integers(q.integers().expect("integers").clone()),
        };
        let scale = Value::from_numbers(ElementType::F32, Tensor::new(&[], vec![Rounded::exact(0.5)]));
        let y =
            evaluate(&node("DequantizeLinear", vec![]), 21, &[Some(&q), Some(&scale)]).expect("an answer");
        let y = y[0].as_ref().expect("an output").numbers().expect("numbers").terms();
        assert_eq!(y.data, [2.0, 1.0], "2²⁴ + 1 is no f32");
    }

    #[test]
    fn a_product_of_integers_is_scaled_rounded_and_cut_off() {
        let element = ElementType::U8;
        let one = |x: f64| numbers(&[], vec![x]);
        let zero = |z: i64| integers(element, &[], vec![z]);
        let a = integers(element, &[1, 2], vec![3, 5]);
        let b = integers(element, &[2, 2], vec![1, 255, 2, 0]);
        // (3 − 1)·1 + (5 − 1)·2 = 10 and 2·255: a quarter of them is 2.5, to even, and 127.5; and ten more.
        let operands = [a, one(0.5), zero(1), b, one(0.5), zero(0), one(1.0), zero(10)];
        let operands: Vec<Option<&Value>> = operands.iter().map(Some).collect();
        let y = evaluate(&node("QLinearMatMul", vec![]), 21, &operands).expect("an answer");
        assert_eq!(y[0].as_ref().expect("an output").integers().expect("integers").data, [12, 138]);
    }
}

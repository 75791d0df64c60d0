//! Products of matrices of integers, whose sums are exact, scaled to numbers.

use vitruvian_reference::nn::{
    IntegerRange, Scalar, Tensor, add, gemm, matmul, mul, quantize, quantize_dynamically,
};

use super::super::products::product_room;
use super::super::quantization::{centred, of_matrix};
use super::super::room;
use super::{Answer, Call, Levels, Value, scale};
use crate::onnx::element::ElementType;

/// Operators that give integers where their numbers can be told.
pub(super) fn levelled<T: Scalar>(call: &Call<T>) -> Option<Result<Levels<T>, String>> {
    let gives_integers = call.operator == "QGemm" && call.optional(8).is_some();
    gives_integers.then(|| Levels::of(call, &general(call)?, 7, ElementType::U8))
}

/// Operators that give numbers.
pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "DynamicQuantizeMatMul" => dynamic(call, 0.0),
        "MatMulIntegerToFloat" => scaled(call),
        "QGemm" if call.optional(7).is_some() => Err("the output has a scale and no zero point".into()),
        "QGemm" => general(call),
        _ => return None,
    };
    Some(y.map(|y| vec![Value::from_numbers(ElementType::F32, y)]))
}

/// Roundings of a quotient before it is cut to an integer, as an engine may form it: by the reciprocal, and added to the
/// zero point.
const ROUNDINGS: f64 = 4.0;

/// The products with the numbers that are quantised inside moved either way by their rounding.
pub(super) fn alternatives<T: Scalar>(call: &Call<T>, unit_roundoff: f64) -> Result<Vec<Value<T>>, String> {
    if call.operator != "DynamicQuantizeMatMul" {
        return Ok(Vec::new());
    }
    let moved = |sign: f64| {
        Ok(Value::from_numbers(ElementType::F32, dynamic(call, sign * ROUNDINGS * unit_roundoff)?))
    };
    [-1.0, 1.0].into_iter().map(moved).collect()
}

/// A sum of integers as an engine's float.
fn number<T: Scalar>(sum: f64) -> T {
    // An f32 holds integers up to 2²⁴.
    if sum.abs() <= f64::from(1 << 24) { T::exact(sum) } else { T::within(sum, sum.abs(), 1.0) }
}

/// Sums with the scales of their columns, and a bias where operand `bias` is one.
fn numbers<T: Scalar>(
    call: &Call<T>,
    sums: &Tensor<f64>,
    scales: &Tensor<T>,
    bias: usize,
) -> Result<Tensor<T>, String> {
    if scales.rank() > sums.rank() {
        return Err(format!("scales {:?} do not fit the product {:?}", scales.shape, sums.shape));
    }
    let y = mul(&sums.map(number), scales);
    let y = match call.optional_numbers(bias)? {
        Some(bias) => add(&y, bias),
        None => y,
    };
    match y.shape == sums.shape {
        true => Ok(y),
        false => Err(format!("scales and bias make {:?} of the product {:?}", y.shape, sums.shape)),
    }
}

/// alpha·s_a·s_b·(Σ(a − z_a)(b − z_b) + c).
fn general<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["alpha", "transA", "transB"])?;
    let (trans_a, trans_b) = (attributes.flag("transA", false)?, attributes.flag("transB", false)?);
    let a = centred(call, 0, 2, &of_matrix(call, 2, true))?;
    let b = centred(call, 3, 5, &of_matrix(call, 5, trans_b))?;
    let ([m, k], [l, n]) = (&a.shape[..], &b.shape[..]) else {
        return Err(format!("operands {:?} and {:?}, two matrices were expected", a.shape, b.shape));
    };
    room(&[if trans_a { *k } else { *m }, if trans_b { *l } else { *n }])?;
    let c = call.optional(6).map(|_| call.integers(6)).transpose()?.map(|c| c.map(|c| c as f64));
    let sums = gemm(&a, &b, c.as_ref(), 1.0, 1.0, trans_a, trans_b);
    let alpha = T::exact(attributes.float("alpha", 1.0)) * scale(call, 1)?;
    let scales = call.numbers(4)?.map(|b| alpha * b);
    let nothing = call.operands.len();
    numbers(call, &sums, &scales, nothing)
}

/// s_a·s_b·Σ(a − z_a)(b − z_b) + bias.
fn scaled<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    call.attributes(&[])?;
    let a = centred(call, 0, 4, &of_matrix(call, 4, true))?;
    let b = centred(call, 1, 5, &of_matrix(call, 5, false))?;
    product_room(&a.shape, &b.shape)?;
    let scales = mul(&call.numbers(2)?.reshape(&of_matrix(call, 2, true)), call.numbers(3)?);
    numbers(call, &matmul(&a, &b), &scales, 6)
}

/// As [`scaled`], of numbers a that are quantised as `DynamicQuantizeLinear` does; their quotients are moved by a share of
/// themselves.
fn dynamic<T: Scalar>(call: &Call<T>, moved: f64) -> Result<Tensor<T>, String> {
    call.attributes(&[])?;
    let (a, element) = (call.numbers(0)?.map(T::value), call.operand(0)?.element);
    let (_, step, zero) = quantize_dynamically(&a, |x| element.round(x));
    let filled = |value: f64| Tensor::filled(&a.shape, if value == 0.0 { 1.0 } else { value });
    let zeros = Tensor::filled(&a.shape, zero);
    let fl = |x: f64| element.round(x) * (1.0 + moved);
    let q = quantize(&a, &filled(step), &zeros, IntegerRange::U8, fl).map(|q| (q - zero) as f64);
    let b = centred(call, 1, 3, &of_matrix(call, 3, false))?;
    product_room(&q.shape, &b.shape)?;
    // (max − min)/255 is two roundings.
    let step = T::within(step, step, 2.0);
    numbers(call, &matmul(&q, &b), &call.numbers(2)?.map(|b| step * b), 4)
}

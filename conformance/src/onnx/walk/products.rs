//! Products of matrices and tensors, of numbers or of integers modulo 2⁶⁴, and determinants.

use std::num::Wrapping;

use vitruvian_reference::nn::{Ring, Scalar, Tensor, det, einsum, einsum_shape, gemm, matmul};

use super::{Answer, Call, Data, Value, broadcast, room};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "Det" => call.attributes(&[]).and_then(|_| call.like(det(call.numbers(0)?))),
        "Einsum" => sum_of_products(call),
        "Gemm" => matrix_product(call),
        "MatMul" => batched_product(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// The operands as integers modulo 2⁶⁴.
fn whole<T: Scalar>(call: &Call<T>) -> Result<Vec<Tensor<Wrapping<i64>>>, String> {
    (0..call.operands.len()).map(|i| Ok(call.integers(i)?.map(Wrapping))).collect()
}

fn integers<T: Scalar>(call: &Call<T>, y: Tensor<Wrapping<i64>>) -> Result<Value<T>, String> {
    Value::from_integers(call.operand(0)?.element, y.map(|y| y.0))
}

/// Refuses a product of matrices of these shapes that there is no room for.
pub(super) fn product_room(a: &[usize], b: &[usize]) -> Result<(), String> {
    let split = |shape: &[usize]| shape.len().saturating_sub(2);
    let outer = broadcast(&a[..split(a)], &b[..split(b)])?;
    let rows = if a.len() < 2 { 1 } else { a[a.len() - 2] };
    let columns = if b.len() < 2 { 1 } else { b[b.len() - 1] };
    room(&[&outer[..], &[rows, columns]].concat())
}

fn batched_product<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    call.same_type()?;
    product_room(call.operand(0)?.shape(), call.operand(1)?.shape())?;
    match &call.operand(0)?.data {
        Data::Integers(_) => {
            let all = whole(call)?;
            integers(call, matmul(&all[0], &all[1]))
        }
        _ => call.like(matmul(call.numbers(0)?, call.numbers(1)?)),
    }
}

fn matrix_product<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["alpha", "beta", "transA", "transB"])?;
    call.same_type()?;
    let (alpha, beta) = (attributes.float("alpha", 1.0), attributes.float("beta", 1.0));
    let (trans_a, trans_b) = (attributes.flag("transA", false)?, attributes.flag("transB", false)?);
    if let ([a, k], [l, b]) = (call.operand(0)?.shape(), call.operand(1)?.shape()) {
        room(&[if trans_a { *k } else { *a }, if trans_b { *l } else { *b }])?;
    }
    match &call.operand(0)?.data {
        Data::Integers(_) => {
            let factor = |name: &str, value: f64| match value {
                value if value.fract() == 0.0 && value.abs() < 1e9 => Ok(Wrapping(value as i64)),
                value => {
                    Err(format!("attribute \"{name}\" is {value}, a whole number was expected for integers"))
                }
            };
            let (alpha, beta) = (factor("alpha", alpha)?, factor("beta", beta)?);
            let [a, b] = [call.integers(0)?, call.integers(1)?].map(|x| x.map(Wrapping));
            let c = call.optional(2).map(|_| call.integers(2)).transpose()?.map(|c| c.map(Wrapping));
            integers(call, gemm(&a, &b, c.as_ref(), alpha, beta, trans_a, trans_b))
        }
        _ => {
            let (alpha, beta) = (call.constant(alpha)?, call.constant(beta)?);
            let [a, b, c] = [Some(call.numbers(0)?), Some(call.numbers(1)?), call.optional_numbers(2)?];
            let [Some(a), Some(b)] = [a, b] else { unreachable!("two operands were found") };
            call.like(gemm(a, b, c, alpha, beta, trans_a, trans_b))
        }
    }
}

fn sum_of_products<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let equation = call.attributes(&["equation"])?.text("equation", "")?;
    call.same_type()?;
    let shapes: Vec<&[usize]> =
        (0..call.operands.len()).map(|i| Ok(call.operand(i)?.shape())).collect::<Result<_, String>>()?;
    room(&einsum_shape(equation, &shapes))?;
    fn sum<R: Ring>(equation: &str, operands: &[Tensor<R>]) -> Tensor<R> {
        einsum(equation, &operands.iter().collect::<Vec<_>>())
    }
    match &call.operand(0)?.data {
        Data::Integers(_) => integers(call, sum(equation, &whole(call)?)),
        _ => {
            let operands: Vec<_> = (0..shapes.len()).map(|i| call.numbers(i)).collect::<Result<_, _>>()?;
            call.like(einsum(equation, &operands))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::{float, text};
    use crate::onnx::element::ElementType;

    fn integers(shape: &[usize], data: &[i64]) -> Value {
        Value::from_integers(ElementType::I32, Tensor::new(shape, data.to_vec())).expect("integers")
    }

    #[test]
    fn integers_are_multiplied_exactly_with_wrap() {
        let (a, b) = (integers(&[1, 2], &[1 << 20, 3]), integers(&[2, 1], &[1 << 12, -5]));
        let y = |node: &crate::onnx::message::NodeProto| {
            let y = evaluate(node, 21, &[Some(&a), Some(&b)])?;
            Ok::<_, String>(y[0].as_ref().expect("y").integers()?.data.clone())
        };
        assert_eq!(y(&node("MatMul", vec![])), Ok(vec![-15]), "2³² is 0 in 32 bits");
        assert_eq!(y(&node("Gemm", vec![float("alpha", 2.0)])), Ok(vec![-30]));
        let why = y(&node("Gemm", vec![float("alpha", 0.5)])).expect_err("refused");
        assert!(why.contains("\"alpha\" is 0.5"), "{why}");
        assert_eq!(y(&node("Einsum", vec![text("equation", "ij,jk->")])), Ok(vec![-15]));
    }

    #[test]
    fn an_output_that_no_memory_holds_is_refused() {
        let a = Value::from_numbers(ElementType::F32, Tensor::new(&[1 << 15, 1], vec![0.0; 1 << 15]));
        let row = Value::from_numbers(ElementType::F32, Tensor::new(&[1, 1 << 15], vec![0.0; 1 << 15]));
        let equation = vec![text("equation", "ij,jk->ik")];
        for node in [node("MatMul", vec![]), node("Gemm", vec![]), node("Einsum", equation)] {
            let why = evaluate::<f64>(&node, 21, &[Some(&a), Some(&row)]).expect_err("refused");
            assert!(why.contains("[32768, 32768]"), "{why}");
        }
    }
}

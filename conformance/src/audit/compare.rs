//! A found tensor against the reference's, element by element.

use vitruvian_reference::nn::{Rounded, Tensor};

use super::measure::Measure;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};

/// Compares every element of a tensor or of a part of it, whose offset in the whole `place` tells; an element that is
/// different is accepted if it is that of one of the `others`.
pub(super) fn compare(
    measure: &mut Measure,
    expected: &Value<Rounded>,
    found: &TypedTensor,
    place: &dyn Fn(usize) -> usize,
    others: &[&Value<Rounded>],
) {
    let others = || others.iter().filter(|other| other.shape() == expected.shape());
    match &expected.data {
        Data::Numbers(expected) => {
            let others: Vec<&Tensor<Rounded>> = others().filter_map(|other| other.numbers().ok()).collect();
            for (i, (found, expected)) in numbers(found).iter().zip(&expected.data).enumerate() {
                let agrees = |with: &Rounded| measure.would_accept(*found, with);
                if !others.is_empty() && !agrees(expected) && others.iter().any(|o| agrees(&o.data[i])) {
                    measure.accept_undecidable(*found, expected.value);
                } else {
                    measure.number(|| place(i), *found, expected);
                }
            }
        }
        Data::Integers(expected) => {
            let others: Vec<&Tensor<i64>> = others().filter_map(|other| other.integers().ok()).collect();
            let other = |i: usize, found: i128| others.iter().any(|o| i128::from(o.data[i]) == found);
            compare_integers(measure, found, &|i| i128::from(expected.data[i]), place, &other);
        }
        Data::Truths(expected) => {
            let others: Vec<&Tensor<bool>> = others().filter_map(|other| other.truths().ok()).collect();
            let other = |i: usize, found: i128| others.iter().any(|o| i128::from(o.data[i]) == found);
            compare_integers(measure, found, &|i| i128::from(expected.data[i]), place, &other);
        }
    }
}

/// Compares whole numbers, which must be met.
fn compare_integers(
    measure: &mut Measure,
    found: &TypedTensor,
    expected: &dyn Fn(usize) -> i128,
    place: &dyn Fn(usize) -> usize,
    other: &dyn Fn(usize, i128) -> bool,
) {
    for (i, found) in integers(found).into_iter().enumerate() {
        let expected = expected(i);
        if found != expected && other(i, found) {
            measure.accept_undecidable(found as f64, expected as f64);
        } else {
            measure.integer(|| place(i), found, expected);
        }
    }
}

/// The elements as f64, whatever they are.
pub(super) fn numbers(tensor: &TypedTensor) -> Vec<f64> {
    match tensor.to_f64() {
        Some(numbers) => numbers,
        None => integers(tensor).into_iter().map(|i| i as f64).collect(),
    }
}

/// The elements as whole numbers; a fraction, which no integer is, becomes the least of all.
pub(super) fn integers(tensor: &TypedTensor) -> Vec<i128> {
    fn all<E: Copy + Into<i128>>(elements: &[E]) -> Vec<i128> {
        elements.iter().map(|&e| e.into()).collect()
    }
    match &tensor.elements {
        Elements::I8(v) => all(v),
        Elements::U8(v) => all(v),
        Elements::I16(v) => all(v),
        Elements::U16(v) => all(v),
        Elements::I32(v) => all(v),
        Elements::U32(v) => all(v),
        Elements::I64(v) => all(v),
        Elements::U64(v) => all(v),
        Elements::Bool(v) => all(v),
        Elements::F32(_) | Elements::F64(_) | Elements::F16(_) | Elements::Bf16(_) => {
            let whole = |x: f64| if x.fract() == 0.0 { x as i128 } else { i128::MIN / 2 };
            tensor.to_f64().unwrap_or_default().into_iter().map(whole).collect()
        }
    }
}

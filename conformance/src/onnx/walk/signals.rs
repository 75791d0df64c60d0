//! Fourier transforms and windows.

use vitruvian_reference::nn::{Fourier, Scalar, Tensor, Window, dft, mel_weight_matrix, stft};

use super::{Answer, Attributes, Call, Value, axis, room};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "BlackmanWindow" => window(call, Window::Blackman),
        "DFT" => transformed(call).and_then(|y| call.like(y)),
        "HammingWindow" => window(call, Window::Hamming),
        "HannWindow" => window(call, Window::Hann),
        "MelWeightMatrix" => mel_weights(call),
        "STFT" => transformed_in_pieces(call).and_then(|y| call.like(y)),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// Operand i as one integer.
fn one<T: Scalar>(call: &Call<T>, i: usize) -> Result<Option<i64>, String> {
    match call.optional(i).map(|_| call.integers(i)).transpose()? {
        None => Ok(None),
        Some(Tensor { data, .. }) if data.len() == 1 => Ok(Some(data[0])),
        Some(other) => Err(format!("operand {i} has shape {:?}, one integer was expected", other.shape)),
    }
}

fn length(i: usize, value: i64) -> Result<usize, String> {
    usize::try_from(value).map_err(|_| format!("operand {i} is {value}, a length was expected"))
}

fn output_type(attributes: Attributes) -> Result<ElementType, String> {
    let number = attributes.int("output_datatype", 1);
    let element = i32::try_from(number).ok().and_then(ElementType::from_number);
    element
        .filter(|element| element.is_float())
        .ok_or_else(|| format!("attribute \"output_datatype\" is {number}, a float type was expected"))
}

fn mel_weights<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let element = output_type(call.attributes(&["output_datatype"])?)?;
    let count = |i: usize| length(i, one(call, i)?.ok_or_else(|| format!("operand {i} is missing"))?);
    let (filters, dft_length, rate) = (count(0)?, count(1)?, count(2)?);
    let edge = |i: usize| match call.numbers(i)?.data[..] {
        [hz] => Ok(hz.value()),
        _ => Err(format!("operand {i} has shape {:?}, one number was expected", call.numbers(i)?.shape)),
    };
    room(&[dft_length / 2 + 1, filters])?;
    Ok(Value::from_numbers(element, mel_weight_matrix(filters, dft_length, rate as f64, edge(3)?, edge(4)?)))
}

fn window<T: Scalar>(call: &Call<T>, window: Window) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["output_datatype", "periodic"])?;
    let element = output_type(attributes)?;
    let size = length(0, one(call, 0)?.ok_or("operand 0 is missing")?)?;
    room(&[size])?;
    Ok(Value::from_numbers(element, window.of(size, attributes.flag("periodic", true)?)))
}

/// The axis is an attribute (1 by default) in version 17, operand 2 (−2 by default) since 20.
fn transformed<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["axis", "inverse", "onesided"])?;
    let x = call.numbers(0)?;
    let at = if call.opset < 20 { attributes.int("axis", 1) } else { one(call, 2)?.unwrap_or(-2) };
    let at = axis(at, x.rank())?;
    let (inverse, onesided) = (attributes.flag("inverse", false)?, attributes.flag("onesided", false)?);
    let whole = if inverse && onesided { 2 * x.shape[at].saturating_sub(1) } else { x.shape[at] };
    let length = one(call, 1)?.map_or(Ok(whole), |value| length(1, value))?;
    if onesided && !inverse && x.shape.last() != Some(&1) {
        return Err(format!(
            "attribute \"onesided\" is 1, which a complex signal {:?} does not have",
            x.shape
        ));
    }
    let mut shape = x.shape.clone();
    shape[at] = length;
    room(&shape)?;
    Ok(dft(x, at, Fourier { length, inverse, onesided }))
}

fn transformed_in_pieces<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let onesided = call.attributes(&["onesided"])?.flag("onesided", true)?;
    let x = call.numbers(0)?;
    let step = length(1, one(call, 1)?.ok_or("operand 1 is missing")?)?;
    let frame = one(call, 3)?.map(|value| length(3, value)).transpose()?;
    let window = match (call.optional_numbers(2)?, frame) {
        (Some(window), Some(frame)) if window.data.len() != frame => {
            return Err(format!("operand 2 has shape {:?}, operand 3 says {frame}", window.shape));
        }
        (Some(window), _) => window.clone(),
        (None, Some(frame)) => {
            room(&[frame])?;
            Tensor::filled(&[frame], T::exact(1.0))
        }
        (None, None) => return Err("operands 2 (window) and 3 (frame_length) are both missing".into()),
    };
    let pieces = x.shape.get(1).copied().unwrap_or(0) / step.max(1) + 1;
    room(&[x.shape.first().copied().unwrap_or(0), pieces, window.data.len(), 2])?;
    Ok(stft(x, step, &window, onesided))
}

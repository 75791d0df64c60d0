//! Operators on boxes in images.

use vitruvian_reference::nn::{NonMaxSuppression, Scalar, non_max_suppression};

use super::indexing::counted;
use super::{Answer, Call, Value};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    match call.operator {
        "NonMaxSuppression" => Some(chosen(call).map(|y| vec![y])),
        _ => None,
    }
}

fn chosen<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let center_point_box = call.attributes(&["center_point_box"])?.flag("center_point_box", false)?;
    let number = |i: usize| match call.optional_numbers(i)?.map(|x| &x.data[..]) {
        None => Ok(None),
        Some(&[number]) => Ok(Some(number.value())),
        Some(_) => {
            Err(format!("operand {i} has shape {:?}, one number was expected", call.operand(i)?.shape()))
        }
    };
    let most = match call.optional(2) {
        Some(_) => call.integers(2)?.data.first().copied().unwrap_or(0),
        None => 0,
    };
    let params = NonMaxSuppression {
        center_point_box,
        max_output_boxes: usize::try_from(most).unwrap_or(0),
        iou_threshold: number(3)?.unwrap_or(0.0),
        score_threshold: number(4)?,
    };
    let value = |i: usize| call.numbers(i).map(|x| x.map(T::value));
    counted(&non_max_suppression(&value(0)?, &value(1)?, &params))
}

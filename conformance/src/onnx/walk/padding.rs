//! Tensors with borders added or cut, and blocks of pixels that become channels: movements, of any element type.

use vitruvian_reference::nn::{
    BlockOrder, PadMode, Scalar, Tensor, center_crop_pad, depth_to_space, pad, space_to_depth,
};

use super::{Answer, Call, Data, LARGEST, Value, axes, lengths, room};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "CenterCropPad" => centred(call),
        "DepthToSpace" => blocks(call, depth_to_space),
        "Pad" => padded(call),
        "SpaceToDepth" => blocks(call, space_to_depth),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// Zero, or false, in the element type of a value.
fn zero_like<T: Scalar>(value: &Value<T>) -> Value<T> {
    let data = match value.data {
        Data::Numbers(_) => Data::Numbers(Tensor::new(&[], vec![T::ZERO])),
        Data::Integers(_) => Data::Integers(Tensor::new(&[], vec![0])),
        Data::Truths(_) => Data::Truths(Tensor::new(&[], vec![false])),
    };
    Value { element: value.element, data }
}

fn padded<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    // Before version 11 pads and value were attributes.
    let known: &[&str] = if call.opset < 11 { &["mode", "pads", "value"] } else { &["mode"] };
    let attributes = call.attributes(known)?;
    let mode = match attributes.text("mode", "constant")? {
        "constant" => PadMode::Constant,
        "reflect" => PadMode::Reflect,
        "edge" => PadMode::Edge,
        "wrap" if call.opset >= 19 => PadMode::Wrap,
        other => return Err(format!("attribute \"mode\" is {other}, which version {} lacks", call.opset)),
    };
    let x = call.operand(0)?;
    let rank = x.shape().len();
    let pads = call.list(1, attributes, "pads")?.ok_or("operand 1 is missing")?;
    let over = match call.optional(3) {
        Some(_) => axes(&call.integers(3)?.data, rank)?,
        None => (0..rank).collect(),
    };
    if pads.len() != 2 * over.len() || pads.iter().any(|pad| pad.unsigned_abs() > LARGEST as u64) {
        return Err(format!("pads {pads:?} for {} axes", over.len()));
    }
    let mut amounts = vec![[0, 0]; rank];
    for (i, &axis) in over.iter().enumerate() {
        amounts[axis] = [pads[i], pads[over.len() + i]];
    }
    let sides = x.shape().iter().zip(&amounts).map(|(&n, [before, after])| n as i64 + before + after);
    room(&lengths(&sides.collect::<Vec<_>>())?)?;
    let mut constant = zero_like(x);
    if let (Data::Numbers(number), true) = (&mut constant.data, attributes.has("value")) {
        number.data[0] = T::exact(attributes.float("value", 0.0));
    }
    if let Some(given) = call.optional(2) {
        if given.len() != 1 {
            return Err(format!("the constant has shape {:?}, one element was expected", given.shape()));
        }
        constant = given.clone();
    }
    Value::arranged(&[x, &constant], |places| Ok(pad(&places[0], &amounts, mode, places[1].data[0])))
}

fn centred<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axes"])?;
    let x = call.operand(0)?;
    let over = match attributes.integers("axes") {
        Some(list) => axes(&list, x.shape().len())?,
        None => (0..x.shape().len()).collect(),
    };
    let asked = lengths(&call.integers(1)?.data)?;
    if asked.len() != over.len() {
        return Err(format!("a shape {asked:?} for {} axes", over.len()));
    }
    let mut shape = x.shape().to_vec();
    for (&axis, &length) in over.iter().zip(&asked) {
        shape[axis] = length;
    }
    room(&shape)?;
    Value::arranged(&[x, &zero_like(x)], |places| Ok(center_crop_pad(&places[0], &shape, places[1].data[0])))
}

fn blocks<T: Scalar>(
    call: &Call<T>,
    rearrange: fn(&Tensor<usize>, usize, BlockOrder) -> Tensor<usize>,
) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["blocksize", "mode"])?;
    let order = match attributes.text("mode", "DCR")? {
        "DCR" => BlockOrder::Dcr,
        "CRD" => BlockOrder::Crd,
        other => return Err(format!("attribute \"mode\" is {other}, DCR or CRD was expected")),
    };
    let side = attributes.count("blocksize", 0)?;
    if !(1..=1 << 16).contains(&side) {
        return Err(format!("attribute \"blocksize\" is {side}, a length was expected"));
    }
    Value::arranged(&[call.operand(0)?], |places| Ok(rearrange(&places[0], side, order)))
}

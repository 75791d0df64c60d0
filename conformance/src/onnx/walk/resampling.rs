//! Images read at other places: Resize, Upsample, GridSample and the points of AffineGrid.
//!
//! # What older versions leave open
//! Upsample and Resize of version 10 do not say where a pixel looks. ONNX's tests and ONNX Runtime take j/scale, and of a
//! nearest pixel the one below, or above where the image shrinks.
//!
//! # How long is an output?
//! ⌊length · scale⌋ with the product rounded to f32, the type of a scale: 10 pixels times 0.7, which f32 holds as
//! 0.699999988, are 7 and not 6.

use vitruvian_reference::nn::{
    CoordinateTransformation, GridSample, Interpolation, NearestMode, PaddingMode, Resize, ResizedAxis,
    SampleMode, Scalar, Tensor, affine_grid, grid_sample, resize, resize_alternatives,
};

use super::window::{ToInteger, any_numbers, value_of};
use super::{Answer, Attributes, Call, Value, axes, lengths, room};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "AffineGrid" => grid_of_map(call),
        "GridSample" => sampled(call),
        "Resize" | "Upsample" => resized(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// What the operator may also give, where a decision lies within rounding or is not specified.
pub(super) fn alternatives<T: Scalar>(call: &Call<T>, unit_roundoff: f64) -> Result<Vec<Value<T>>, String> {
    match call.operator {
        // Where the points of a grid fall is decided by an operand, and not in here.
        "GridSample" if !call.operand(0)?.element.is_float() => {
            let (x, grid) = (any_numbers(call, 0)?, call.numbers(1)?);
            values(call, vec![grid_sample(&x, grid, grid_params(call)?)])
        }
        "Resize" | "Upsample" => {
            let x = any_numbers(call, 0)?;
            let mut found = vec![x.into_owned()];
            for step in steps(call)? {
                let others = found.iter().flat_map(|x| resize_alternatives(x, &step, unit_roundoff));
                let mut others: Vec<_> = others.collect();
                if let Some(text) = whole_lengths(&step, call.operand(0)?.shape()) {
                    others.extend(found.iter().map(|x| resize(x, &text)));
                }
                found = found.iter().map(|x| resize(x, &step)).collect();
                found.extend(others);
            }
            values(call, found)
        }
        _ => Ok(Vec::new()),
    }
}

/// `align_corners` as ONNX's text has it, and with it ONNX Runtime and PyTorch: between whole lengths, where its tests take the length that
/// the scale gives.
fn whole_lengths(step: &Resize, shape: &[usize]) -> Option<Resize> {
    let mut text = step.clone();
    for axis in &mut text.axes {
        axis.scale = [axis.output.max(1) as f64, shape[axis.axis] as f64];
    }
    (step.transformation == CoordinateTransformation::AlignCorners && text != *step).then_some(text)
}

/// Numbers in the operator's element type; of integers both conversions, since neither is specified.
fn values<T: Scalar>(call: &Call<T>, numbers: Vec<Tensor<T>>) -> Result<Vec<Value<T>>, String> {
    let element = call.operand(0)?.element;
    let conversions: &[ToInteger] = if element.is_float() {
        &[ToInteger::Nearest]
    } else {
        &[ToInteger::Nearest, ToInteger::TowardsZero]
    };
    conversions
        .iter()
        .flat_map(|&conversion| numbers.iter().map(move |x| value_of(element, x.clone(), conversion)))
        .collect()
}

fn resized<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let x = any_numbers(call, 0)?;
    let y = steps(call)?.iter().fold(x.into_owned(), |x, step| resize(&x, step));
    value_of(call.operand(0)?.element, y, ToInteger::Nearest)
}

/// The resizing that a node asks for: one, but for axes that shrink and grow by nearest pixels of their own.
fn steps<T: Scalar>(call: &Call<T>) -> Result<Vec<Resize>, String> {
    if call.operator == "Upsample" || call.opset < 11 { old_steps(call) } else { Ok(vec![new_step(call)?]) }
}

fn old_steps<T: Scalar>(call: &Call<T>) -> Result<Vec<Resize>, String> {
    let attribute = call.operator == "Upsample" && call.opset < 9;
    let attributes = call.attributes(if attribute { &["mode", "scales"] } else { &["mode"] })?;
    let scales: Vec<f64> = if attribute {
        attributes.floats("scales").unwrap_or_default().iter().map(|&scale| f64::from(scale)).collect()
    } else {
        call.numbers(1)?.data.iter().map(|scale| scale.value()).collect()
    };
    let shape = call.operand(0)?.shape();
    let all: Vec<usize> = (0..shape.len()).collect();
    let resized = by_scales(shape, &all, &scales, &[])?;
    let step = |axes, interpolation| Resize {
        axes,
        transformation: CoordinateTransformation::Asymmetric,
        interpolation,
        exclude_outside: false,
        extrapolation_value: 0.0,
    };
    match attributes.text("mode", "nearest")? {
        "nearest" => {
            let (smaller, larger): (Vec<_>, Vec<_>) =
                resized.into_iter().partition(|axis: &ResizedAxis| axis.scale[0] < 1.0);
            Ok(vec![
                step(larger, Interpolation::Nearest(NearestMode::Floor)),
                step(smaller, Interpolation::Nearest(NearestMode::Ceil)),
            ])
        }
        "linear" => Ok(vec![step(resized, Interpolation::Linear { antialias: false })]),
        other => Err(format!("attribute \"mode\" is {other}, nearest or linear was expected")),
    }
}

fn new_step<T: Scalar>(call: &Call<T>) -> Result<Resize, String> {
    let mut known = vec![
        "coordinate_transformation_mode",
        "cubic_coeff_a",
        "exclude_outside",
        "extrapolation_value",
        "mode",
        "nearest_mode",
    ];
    if call.opset >= 18 {
        known.extend(["antialias", "axes", "keep_aspect_ratio_policy"]);
    }
    let attributes = call.attributes(&known)?;
    let transformation = transformation(attributes, call.opset)?;
    let antialias = attributes.flag("antialias", false)?;
    let interpolation = match attributes.text("mode", "nearest")? {
        "nearest" if antialias => return Err("attribute \"antialias\" is 1, which mode nearest lacks".into()),
        "nearest" => Interpolation::Nearest(nearest_mode(attributes)?),
        "linear" => Interpolation::Linear { antialias },
        "cubic" => Interpolation::Cubic { a: attributes.float("cubic_coeff_a", -0.75), antialias },
        other => return Err(format!("attribute \"mode\" is {other}, which is not understood")),
    };
    let shape = call.operand(0)?.shape();
    let over = match attributes.integers("axes") {
        Some(list) => axes(&list, shape.len())?,
        None => (0..shape.len()).collect(),
    };
    let crops = transformation == CoordinateTransformation::TfCropAndResize;
    let roi: Vec<f64> = match call.optional_numbers(1)? {
        Some(roi) if crops => roi.data.iter().map(|end| end.value()).collect(),
        _ => Vec::new(),
    };
    if crops && roi.len() != 2 * over.len() {
        return Err(format!("operand 1 has {} ends of regions, {} were expected", roi.len(), 2 * over.len()));
    }
    let scales = call.optional_numbers(2)?.filter(|scales| !scales.data.is_empty());
    let sizes = call.optional(3).filter(|sizes| !sizes.is_empty());
    let axes = match (scales, sizes) {
        (Some(scales), None) => {
            let scales: Vec<f64> = scales.data.iter().map(|scale| scale.value()).collect();
            by_scales(shape, &over, &scales, &roi)?
        }
        (None, Some(_)) => {
            let sizes = lengths(&call.integers(3)?.data)?;
            let policy = attributes.text("keep_aspect_ratio_policy", "stretch")?;
            to_sizes(shape, &over, &sizes, &roi, policy)?
        }
        _ => return Err("either scales or sizes were expected".into()),
    };
    // What stays as it is needs no reading between pixels.
    let changes = |axis: &ResizedAxis| {
        let same = axis.output == shape[axis.axis] && axis.scale[0] == axis.scale[1];
        !same
            || transformation == CoordinateTransformation::TfHalfPixelForNn
            || (crops && axis.roi != [0.0, 1.0])
    };
    Ok(Resize {
        axes: axes.into_iter().filter(changes).collect(),
        transformation,
        interpolation,
        exclude_outside: attributes.flag("exclude_outside", false)?,
        extrapolation_value: attributes.float("extrapolation_value", 0.0),
    })
}

fn transformation(attributes: Attributes, opset: i64) -> Result<CoordinateTransformation, String> {
    Ok(match attributes.text("coordinate_transformation_mode", "half_pixel")? {
        "align_corners" => CoordinateTransformation::AlignCorners,
        "asymmetric" => CoordinateTransformation::Asymmetric,
        "half_pixel" => CoordinateTransformation::HalfPixel,
        "half_pixel_symmetric" if opset >= 19 => CoordinateTransformation::HalfPixelSymmetric,
        "pytorch_half_pixel" => CoordinateTransformation::PytorchHalfPixel,
        "tf_crop_and_resize" => CoordinateTransformation::TfCropAndResize,
        "tf_half_pixel_for_nn" if opset < 13 => CoordinateTransformation::TfHalfPixelForNn,
        other => {
            return Err(format!(
                "attribute \"coordinate_transformation_mode\" is {other}, which version {opset} lacks"
            ));
        }
    })
}

fn nearest_mode(attributes: Attributes) -> Result<NearestMode, String> {
    Ok(match attributes.text("nearest_mode", "round_prefer_floor")? {
        "ceil" => NearestMode::Ceil,
        "floor" => NearestMode::Floor,
        "round_prefer_ceil" => NearestMode::RoundPreferCeil,
        "round_prefer_floor" => NearestMode::RoundPreferFloor,
        other => return Err(format!("attribute \"nearest_mode\" is {other}, which is not understood")),
    })
}

/// The part of axis `i` of `count` that is read.
fn part(roi: &[f64], i: usize, count: usize) -> [f64; 2] {
    if roi.is_empty() { [0.0, 1.0] } else { [roi[i], roi[count + i]] }
}

fn by_scales(
    shape: &[usize],
    over: &[usize],
    scales: &[f64],
    roi: &[f64],
) -> Result<Vec<ResizedAxis>, String> {
    if scales.len() != over.len() {
        return Err(format!("{} scales for {} axes", scales.len(), over.len()));
    }
    if let Some(scale) = scales.iter().find(|scale| !(scale.is_finite() && **scale > 0.0)) {
        return Err(format!("a scale of {scale}, a positive number was expected"));
    }
    let mut after = shape.to_vec();
    let mut resized = Vec::with_capacity(over.len());
    for (i, (&axis, &scale)) in over.iter().zip(scales).enumerate() {
        let part = part(roi, i, over.len());
        let length = shape[axis] as f32;
        let part_length = if roi.is_empty() { length } else { length * (part[1] - part[0]) as f32 };
        let output = (part_length * scale as f32).floor().max(0.0) as usize;
        after[axis] = output;
        let scale =
            if roi.is_empty() { [scale, 1.0] } else { [output.max(1) as f64, f64::from(length.max(1.0))] };
        resized.push(ResizedAxis { axis, output, scale, roi: part });
    }
    room(&after)?;
    Ok(resized)
}

fn to_sizes(
    shape: &[usize],
    over: &[usize],
    sizes: &[usize],
    roi: &[f64],
    policy: &str,
) -> Result<Vec<ResizedAxis>, String> {
    if sizes.len() != over.len() {
        return Err(format!("{} sizes for {} axes", sizes.len(), over.len()));
    }
    let quotients = || over.iter().zip(sizes).map(|(&axis, &size)| [size as f64, shape[axis] as f64]);
    let ordered = |a: &[f64; 2], b: &[f64; 2]| (a[0] * b[1]).total_cmp(&(b[0] * a[1]));
    let common = match policy {
        "stretch" => None,
        "not_larger" => quotients().min_by(ordered),
        "not_smaller" => quotients().max_by(ordered),
        other => {
            return Err(format!(
                "attribute \"keep_aspect_ratio_policy\" is {other}, which is not understood"
            ));
        }
    };
    let mut after = shape.to_vec();
    let mut resized = Vec::with_capacity(over.len());
    for (i, (&axis, own)) in over.iter().zip(quotients()).enumerate() {
        let scale = common.unwrap_or(own);
        let output = match common {
            Some([over, under]) => (shape[axis] as f64 * over / under + 0.5).floor() as usize,
            None => sizes[i],
        };
        if output > 0 && shape[axis] == 0 {
            return Err(format!("an axis of shape {shape:?} has no pixel to resize"));
        }
        after[axis] = output;
        let scale = if output == 0 { [1.0, 1.0] } else { scale };
        resized.push(ResizedAxis { axis, output, scale, roi: part(roi, i, over.len()) });
    }
    room(&after)?;
    Ok(resized)
}

fn grid_params<T: Scalar>(call: &Call<T>) -> Result<GridSample, String> {
    let attributes = call.attributes(&["align_corners", "mode", "padding_mode"])?;
    // The names of version 16 and of version 20 on.
    let mode = match attributes.text("mode", "linear")? {
        "linear" | "bilinear" => SampleMode::Linear,
        "nearest" => SampleMode::Nearest,
        "cubic" | "bicubic" => SampleMode::Cubic,
        other => return Err(format!("attribute \"mode\" is {other}, which is not understood")),
    };
    let padding = match attributes.text("padding_mode", "zeros")? {
        "zeros" => PaddingMode::Zeros,
        "border" => PaddingMode::Border,
        "reflection" => PaddingMode::Reflection,
        other => return Err(format!("attribute \"padding_mode\" is {other}, which is not understood")),
    };
    Ok(GridSample { mode, padding, align_corners: attributes.flag("align_corners", false)? })
}

fn sampled<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let (x, grid) = (any_numbers(call, 0)?, call.numbers(1)?);
    let points = grid.shape.get(1..grid.rank().saturating_sub(1)).unwrap_or_default();
    room(&[&x.shape[..x.rank().min(2)], points].concat())?;
    if x.data.is_empty() && !grid.data.is_empty() {
        return Err(format!("an image {:?} has no pixel to read", x.shape));
    }
    // The only operator here whose text says how its numbers become integers: it casts them.
    value_of(call.operand(0)?.element, grid_sample(&x, grid, grid_params(call)?), ToInteger::TowardsZero)
}

fn grid_of_map<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let align_corners = call.attributes(&["align_corners"])?.flag("align_corners", false)?;
    let size = lengths(&call.integers(1)?.data)?;
    let theta = call.numbers(0)?;
    let Some(spatial @ ([_, _] | [_, _, _])) = size.get(2..) else {
        return Err(format!("size is {size:?}, [N,C,H,W] or [N,C,D,H,W] was expected"));
    };
    if theta.shape.first() != size.first() {
        return Err(format!("theta {:?} has not the samples of size {size:?}", theta.shape));
    }
    room(&[&size[..1], spatial, &[spatial.len()]].concat())?;
    call.like(affine_grid(theta, spatial, align_corners))
}

//! Pools of windows, of whole images, of channels and of regions.

use vitruvian_reference::nn::{
    AveragePool, LocalResponse, Pool, RoiAlign, Scalar, Tensor, average_pool, global_average_pool,
    global_lp_pool, global_max_pool, local_response_norm, lp_pool, max_pool, max_pool_indices, max_roi_pool,
    max_unpool, roi_align,
};

use super::window::{ToInteger, Window, any_numbers, image, value_of};
use super::{Answer, Attributes, Call, Value, lengths, room};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "AveragePool" => mean_of_windows(call),
        "GlobalAveragePool" => whole(call, global_average_pool),
        "GlobalLpPool" => call
            .attributes(&["p"])
            .and_then(|attributes| order(attributes))
            .and_then(|p| whole(call, |x| global_lp_pool(x, p))),
        "GlobalMaxPool" => whole(call, global_max_pool),
        "LRN" => local_response(call),
        "LpPool" => length_of_windows(call),
        "MaxPool" => return Some(largest_of_windows(call)),
        "MaxRoiPool" => largest_of_regions(call),
        "MaxUnpool" => unpooled(call),
        "RoiAlign" => aligned_regions(call),
        _ => return None,
    };
    Some(y.and_then(|y| Ok(vec![call.like(y)?])))
}

fn whole<T: Scalar>(call: &Call<T>, f: impl Fn(&Tensor<T>) -> Tensor<T>) -> Result<Tensor<T>, String> {
    call.numbers(0).map(f)
}

/// The p of a length.
fn order(attributes: Attributes) -> Result<u32, String> {
    let p = attributes.int("p", 2);
    u32::try_from(p)
        .ok()
        .filter(|p| (1..=64).contains(p))
        .ok_or_else(|| format!("attribute \"p\" is {p}, a power from 1 to 64 was expected"))
}

/// A pool's window over [N,C,…], and its attributes with `more` beside those of the window.
fn pool<'a, T: Scalar>(
    call: &Call<'a, T>,
    x: &Tensor<T>,
    more: &[&str],
) -> Result<(Pool, Attributes<'a>), String> {
    let known = ["auto_pad", "ceil_mode", "dilations", "kernel_shape", "pads", "strides"];
    let attributes = call.attributes(&[&known, more].concat())?;
    let (maps, size) = image(x)?;
    let window = Window::of(attributes, size, None)?;
    window.room(maps, size)?;
    let explicit = attributes.text("auto_pad", "NOTSET")? == "NOTSET";
    let pool = Pool {
        kernel: window.kernel,
        stride: window.stride,
        padding: window.padding,
        dilation: window.dilation,
        ceil_mode: attributes.flag("ceil_mode", false)? && explicit,
    };
    Ok((pool, attributes))
}

fn mean_of_windows<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let x = call.numbers(0)?;
    let (window, attributes) = pool(call, x, &["count_include_pad"])?;
    let count_include_pad = attributes.flag("count_include_pad", false)?;
    Ok(average_pool(x, &AveragePool { window, count_include_pad }))
}

fn length_of_windows<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let x = call.numbers(0)?;
    let (window, attributes) = pool(call, x, &["p"])?;
    Ok(lp_pool(x, &window, order(attributes)?))
}

fn largest_of_windows<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let x = any_numbers(call, 0)?;
    let (window, attributes) = pool(call, &x, &["storage_order"])?;
    let column_major = attributes.flag("storage_order", false)?;
    let y = value_of(call.operand(0)?.element, max_pool(&x, &window), ToInteger::Nearest)?;
    if !call.wants(1) {
        return Ok(vec![y]);
    }
    let places = max_pool_indices(&x, &window, column_major);
    Ok(vec![y, Value::from_integers(ElementType::I64, places)?])
}

fn unpooled<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["kernel_shape", "pads", "strides"])?;
    let (x, places) = (call.numbers(0)?, call.integers(1)?);
    let (maps, size) = image(x)?;
    let window = Window::of(attributes, size, None)?;
    let side = |a: usize| {
        let full = size[a].saturating_sub(1) * window.stride[a] + window.kernel[a];
        full.checked_sub(window.padding[a][0] + window.padding[a][1])
    };
    let pooled: Option<Vec<usize>> = (0..size.len()).map(side).collect();
    let pooled = pooled.ok_or_else(|| format!("the pads take more than there is from {:?}", x.shape))?;
    let pooled = [&maps[..], &pooled].concat();
    let output = match call.optional(2) {
        Some(_) => lengths(&call.integers(2)?.data)?,
        None => pooled.clone(),
    };
    room(&pooled)?;
    room(&output)?;
    Ok(max_unpool(x, places, &pooled, &output))
}

fn local_response<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["alpha", "beta", "bias", "size"])?;
    let params = LocalResponse {
        size: attributes.count("size", 0)?,
        alpha: attributes.float("alpha", 1e-4),
        beta: attributes.float("beta", 0.75),
        bias: attributes.float("bias", 1.0),
    };
    Ok(local_response_norm(call.numbers(0)?, params))
}

fn aligned_regions<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&[
        "coordinate_transformation_mode",
        "mode",
        "output_height",
        "output_width",
        "sampling_ratio",
        "spatial_scale",
    ])?;
    // Before version 16 there was no shift by half a pixel.
    let default = if call.opset < 16 { "output_half_pixel" } else { "half_pixel" };
    let half_pixel = match attributes.text("coordinate_transformation_mode", default)? {
        "half_pixel" => true,
        "output_half_pixel" => false,
        other => {
            return Err(format!(
                "attribute \"coordinate_transformation_mode\" is {other}, which is not understood"
            ));
        }
    };
    let largest = match attributes.text("mode", "avg")? {
        "avg" => false,
        "max" => true,
        other => return Err(format!("attribute \"mode\" is {other}, avg or max was expected")),
    };
    let (x, rois, samples) = (call.numbers(0)?, call.numbers(1)?, call.integers(2)?);
    let output = [attributes.count("output_height", 1)?, attributes.count("output_width", 1)?];
    let params = RoiAlign {
        output,
        sampling_ratio: attributes.count("sampling_ratio", 0)?,
        spatial_scale: attributes.float("spatial_scale", 1.0),
        half_pixel,
        largest,
    };
    let ([_, channels], _) = image(x)?;
    room(&[samples.data.len(), channels, output[0], output[1]])?;
    // An adaptive lattice has a point per pixel of a region, which may be as large as its numbers say.
    let pixels: f64 = rois
        .data
        .chunks_exact(4)
        .map(|roi| (roi[2] - roi[0]).value().abs().max(1.0) * (roi[3] - roi[1]).value().abs().max(1.0))
        .sum();
    let scale = params.spatial_scale.abs().max(1.0).powi(2);
    let points = pixels * scale + (params.sampling_ratio as f64).powi(2) * (output[0] * output[1]) as f64;
    if points.is_nan() || points > 1e9 {
        return Err(format!("regions of {points:.0} points are too many"));
    }
    Ok(roi_align(x, rois, samples, params))
}

fn largest_of_regions<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["pooled_shape", "spatial_scale"])?;
    let (x, rois) = (call.numbers(0)?, call.numbers(1)?);
    let output = attributes.counts("pooled_shape", 2, 0)?;
    let ([_, channels], _) = image(x)?;
    room(&[rois.shape[0], channels, output[0], output[1]])?;
    Ok(max_roi_pool(x, rois, [output[0], output[1]], attributes.float("spatial_scale", 1.0)))
}

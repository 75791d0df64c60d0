//! Operators with windows: convolutions and pools.

use vitruvian_reference::nn::{
    AveragePool, Conv, ConvTranspose, GridSample, PaddingMode, Pool, Scalar, Tensor, average_pool, conv,
    conv_transpose, global_average_pool, grid_sample, max_pool,
};

use super::{Answer, Attributes, Call};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "AveragePool" => mean_of_windows(call),
        "Conv" => convolution(call),
        "ConvTranspose" => transposed_convolution(call),
        "GlobalAveragePool" => call.numbers(0).map(global_average_pool),
        "GridSample" => sampled(call),
        "MaxPool" => call.numbers(0).and_then(|x| Ok(max_pool(x, &pool(call, x, &[])?.0))),
        _ => return None,
    };
    Some(y.and_then(|y| Ok(vec![call.like(y)?])))
}

const WINDOW: &[&str] =
    &["auto_pad", "dilations", "group", "kernel_shape", "output_padding", "pads", "strides"];

fn window<T: Scalar>(call: &Call<T>, w: &Tensor<T>) -> Result<Conv, String> {
    let attributes = call.attributes(WINDOW)?;
    let axes = w.shape.len().saturating_sub(2);
    let kernel = attributes.counts("kernel_shape", axes, 0)?;
    if kernel.iter().zip(&w.shape[2..]).any(|(&said, &is)| said != 0 && said != is) {
        return Err(format!("attribute \"kernel_shape\" does not fit the weights {:?}", w.shape));
    }
    Ok(Conv {
        stride: attributes.counts("strides", axes, 1)?,
        padding: attributes.paddings(axes)?,
        dilation: attributes.counts("dilations", axes, 1)?,
        groups: attributes.count("group", 1)?,
    })
}

fn convolution<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let (x, w) = (call.numbers(0)?, call.numbers(1)?);
    Ok(conv(x, w, call.optional_numbers(2)?, &window(call, w)?))
}

fn transposed_convolution<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let (x, w) = (call.numbers(0)?, call.numbers(1)?);
    let output_padding = call.attributes(WINDOW)?.counts("output_padding", w.rank().saturating_sub(2), 0)?;
    let params = ConvTranspose { conv: window(call, w)?, output_padding };
    Ok(conv_transpose(x, w, call.optional_numbers(2)?, &params))
}

/// A pool's window, and its attributes with `more` beside those of the window.
fn pool<'a, T: Scalar>(
    call: &Call<'a, T>,
    x: &Tensor<T>,
    more: &[&str],
) -> Result<(Pool, Attributes<'a>), String> {
    let known = ["auto_pad", "ceil_mode", "dilations", "kernel_shape", "pads", "storage_order", "strides"];
    let attributes = call.attributes(&[&known, more].concat())?;
    let axes = x.rank().saturating_sub(2);
    let window = Pool {
        kernel: attributes.counts("kernel_shape", axes, 0)?,
        stride: attributes.counts("strides", axes, 1)?,
        padding: attributes.paddings(axes)?,
        dilation: attributes.counts("dilations", axes, 1)?,
        ceil_mode: attributes.flag("ceil_mode", false)?,
    };
    Ok((window, attributes))
}

fn mean_of_windows<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let x = call.numbers(0)?;
    let (window, attributes) = pool(call, x, &["count_include_pad"])?;
    let count_include_pad = attributes.flag("count_include_pad", false)?;
    Ok(average_pool(x, &AveragePool { window, count_include_pad }))
}

fn sampled<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["align_corners", "mode", "padding_mode"])?;
    let mode = attributes.text("mode", "linear")?;
    if mode != "linear" {
        return Err(format!("attribute \"mode\" is {mode}, linear was expected"));
    }
    let padding = match attributes.text("padding_mode", "zeros")? {
        "zeros" => PaddingMode::Zeros,
        "border" => PaddingMode::Border,
        "reflection" => PaddingMode::Reflection,
        other => return Err(format!("attribute \"padding_mode\" is {other}")),
    };
    let params = GridSample { padding, align_corners: attributes.flag("align_corners", false)? };
    Ok(grid_sample(call.numbers(0)?, call.numbers(1)?, params))
}

//! Convolutions, their adjoint and what is built like them.
//!
//! In ConvTranspose, a size that is asked for (`output_shape`, or `auto_pad` SAME) is reached by cutting: since opset 11 an odd pixel goes at
//! the end with SAME_UPPER and at the beginning otherwise; the text of older versions has it the other way round.

use vitruvian_reference::nn::{
    Conv, ConvTranspose, Scalar, Tensor, col2im, conv, conv_transpose, deform_conv,
};

use super::window::{Window, image};
use super::{Answer, Call, lengths, room};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "Col2Im" => folded(call),
        "Conv" => convolution(call),
        "ConvTranspose" => transposed_convolution(call),
        "DeformConv" => deformable_convolution(call),
        _ => return None,
    };
    Some(y.and_then(|y| Ok(vec![call.like(y)?])))
}

impl Window {
    fn conv(self, groups: usize) -> Conv {
        Conv { stride: self.stride, padding: self.padding, dilation: self.dilation, groups }
    }
}

/// The spatial lengths of the weights.
fn kernel_of<T: Copy>(w: &Tensor<T>, image: &[usize]) -> Result<Vec<usize>, String> {
    match w.shape.get(2..) {
        Some(kernel) if kernel.len() == image.len() => Ok(kernel.to_vec()),
        _ => Err(format!("weights {:?} do not have the spatial axes of the image {image:?}", w.shape)),
    }
}

fn convolution<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let (x, w) = (call.numbers(0)?, call.numbers(1)?);
    Ok(conv(x, w, call.optional_numbers(2)?, &window_over(call, x, w)?))
}

/// How weights slide over an image, by the attributes of a convolution.
pub(super) fn window_over<T: Scalar, E: Copy>(
    call: &Call<T>,
    x: &Tensor<E>,
    w: &Tensor<E>,
) -> Result<Conv, String> {
    let attributes =
        call.attributes(&["auto_pad", "dilations", "group", "kernel_shape", "pads", "strides"])?;
    let ([samples, _], size) = image(x)?;
    let window = Window::of(attributes, size, Some(&kernel_of(w, size)?))?;
    window.room([samples, w.shape[0]], size)?;
    Ok(window.conv(attributes.count("group", 1)?))
}

fn transposed_convolution<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let (x, w) = (call.numbers(0)?, call.numbers(1)?);
    let attributes = call.attributes(&[
        "auto_pad",
        "dilations",
        "group",
        "kernel_shape",
        "output_padding",
        "output_shape",
        "pads",
        "strides",
    ])?;
    let ([samples, _], size) = image(x)?;
    let kernel = kernel_of(w, size)?;
    let groups = attributes.count("group", 1)?;
    let output_padding = attributes.counts("output_padding", size.len(), 0)?;
    let auto = attributes.text("auto_pad", "NOTSET")?;
    let same = matches!(auto, "SAME_UPPER" | "SAME_LOWER");
    let window = Window::of(attributes, size, Some(&kernel))?;
    let asked = match attributes.integers("output_shape") {
        // Some exporters list samples and channels too.
        Some(shape) if shape.len() >= size.len() => Some(lengths(&shape[shape.len() - size.len()..])?),
        Some(shape) => return Err(format!("attribute \"output_shape\" is {shape:?} for the image {size:?}")),
        None if same => Some(size.iter().zip(&window.stride).map(|(n, stride)| n * stride).collect()),
        None => None,
    };
    let more: Vec<usize> = match &asked {
        Some(asked) => asked.iter().zip(&output_padding).map(|(a, b)| a.saturating_add(*b)).collect(),
        None => output_padding.clone(),
    };
    window.transposed_room([samples, w.shape[1].saturating_mul(groups)], size, &more)?;
    let mut params = ConvTranspose { conv: window.conv(groups), output_padding };
    if let Some(asked) = asked {
        let upper = (auto == "SAME_UPPER") == (call.opset >= 11);
        params = params.sized(size, &kernel, &asked, upper);
    }
    Ok(conv_transpose(x, w, call.optional_numbers(2)?, &params))
}

fn deformable_convolution<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes =
        call.attributes(&["dilations", "group", "kernel_shape", "offset_group", "pads", "strides"])?;
    let (x, w, offset) = (call.numbers(0)?, call.numbers(1)?, call.numbers(2)?);
    let ([samples, _], size) = image(x)?;
    let window = Window::of(attributes, size, Some(&kernel_of(w, size)?))?;
    window.room([samples, w.shape[0]], size)?;
    let (bias, mask) = (call.optional_numbers(3)?, call.optional_numbers(4)?);
    let (groups, offset_groups) = (attributes.count("group", 1)?, attributes.count("offset_group", 1)?);
    Ok(deform_conv(x, w, offset, bias, mask, &window.conv(groups), offset_groups))
}

fn folded<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["dilations", "pads", "strides"])?;
    let x = call.numbers(0)?;
    let (image, block) = (lengths(&call.integers(1)?.data)?, lengths(&call.integers(2)?.data)?);
    if block.len() != image.len() {
        return Err(format!("a block {block:?} of an image {image:?}"));
    }
    let window = Window::of(attributes, &image, Some(&block))?;
    room(&[&x.shape[..x.rank().min(2)], &image[..]].concat())?;
    Ok(col2im(x, &image, &block, &window.conv(1)))
}

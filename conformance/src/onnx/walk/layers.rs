//! Operators with weights or windows, products and reductions.

use vitruvian_reference::nn::{
    AveragePool, Conv, ConvTranspose, GridSample, PaddingMode, Pool, Scalar, Tensor, average_pool,
    batch_norm, conv, conv_transpose, einsum, gemm, global_average_pool, grid_sample, group_norm,
    instance_norm, matmul, max_pool, reduce_l2, reduce_mean, reduce_sum,
};

use super::{Answer, Attributes, Call, axes};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "AveragePool" => mean_of_windows(call),
        "BatchNormalization" => batch_normalization(call),
        "Conv" => convolution(call),
        "ConvTranspose" => transposed_convolution(call),
        "Einsum" => sum_of_products(call),
        "Gemm" => matrix_product(call),
        "GlobalAveragePool" => call.numbers(0).map(global_average_pool),
        "GridSample" => sampled(call),
        "GroupNormalization" => group_normalization(call),
        "InstanceNormalization" => instance_normalization(call),
        "MatMul" => call.numbers(0).and_then(|a| Ok(matmul(a, call.numbers(1)?))),
        "MaxPool" => call.numbers(0).and_then(|x| Ok(max_pool(x, &pool(call, x, &[])?.0))),
        "ReduceL2" => reduced(call, reduce_l2),
        "ReduceMean" => reduced(call, reduce_mean),
        "ReduceSum" => reduced(call, reduce_sum),
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

fn batch_normalization<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["epsilon", "momentum", "spatial", "training_mode"])?;
    if attributes.flag("training_mode", false)? {
        return Err("training_mode 1; only inference is defined here".into());
    }
    if !attributes.flag("spatial", true)? {
        return Err("spatial 0; one statistic per channel was expected".into());
    }
    let [x, scale, bias, mean, variance] =
        [call.numbers(0)?, call.numbers(1)?, call.numbers(2)?, call.numbers(3)?, call.numbers(4)?];
    Ok(batch_norm(x, scale, bias, mean, variance, attributes.float("epsilon", 1e-5)))
}

fn instance_normalization<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let epsilon = call.attributes(&["epsilon"])?.float("epsilon", 1e-5);
    Ok(instance_norm(call.numbers(0)?, call.numbers(1)?, call.numbers(2)?, epsilon))
}

fn group_normalization<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    // stash_type names the precision of the statistics; 1 is f32, the only one that the bound describes.
    let attributes = call.attributes(&["epsilon", "num_groups", "stash_type"])?;
    if attributes.int("stash_type", 1) != 1 {
        return Err("stash_type must be 1 (f32)".into());
    }
    let (groups, epsilon) = (attributes.count("num_groups", 0)?, attributes.float("epsilon", 1e-5));
    Ok(group_norm(call.numbers(0)?, groups, call.numbers(1)?, call.numbers(2)?, epsilon))
}

fn matrix_product<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["alpha", "beta", "transA", "transB"])?;
    let (alpha, beta) = (attributes.float("alpha", 1.0), attributes.float("beta", 1.0));
    let (trans_a, trans_b) = (attributes.flag("transA", false)?, attributes.flag("transB", false)?);
    Ok(gemm(call.numbers(0)?, call.numbers(1)?, call.optional_numbers(2)?, alpha, beta, trans_a, trans_b))
}

fn sum_of_products<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let equation = call.attributes(&["equation"])?.text("equation", "")?;
    if equation.contains('.') {
        return Err(format!("equation {equation:?} has an ellipsis, which is not understood"));
    }
    let operands: Vec<_> = (0..call.operands.len()).map(|i| call.numbers(i)).collect::<Result<_, _>>()?;
    Ok(einsum(equation, &operands))
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

fn reduced<T: Scalar>(
    call: &Call<T>,
    reduce: fn(&Tensor<T>, &[usize], bool) -> Tensor<T>,
) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["axes", "keepdims", "noop_with_empty_axes"])?;
    let x = call.numbers(0)?;
    let mut over = axes(&call.list(1, attributes, "axes")?.unwrap_or_default(), x.rank())?;
    if over.is_empty() {
        if attributes.flag("noop_with_empty_axes", false)? {
            return Ok(x.clone());
        }
        over = (0..x.rank()).collect();
    }
    Ok(reduce(x, &over, attributes.flag("keepdims", true)?))
}

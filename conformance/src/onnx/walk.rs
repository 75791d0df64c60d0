//! ONNX operators by the reference: a node and its operands in, its output out.
//!
//! This is a dictionary, from ONNX's operators and attributes to `vitruvian_reference::nn`; it computes nothing itself.
//! Generic over the number, like the reference: with `f64` it gives values, with `Rounded` also their bounds.

use vitruvian_reference::nn::{
    Conv, ConvTranspose, GridSample, PaddingMode, Pool, Scalar, Tensor, add, batch_norm, concat, conv,
    conv_transpose, div, gemm, grid_sample, group_norm, instance_norm, leaky_relu, matmul, max_pool, mul,
    reduce_mean, relu, sigmoid, slice, sub, transpose,
};

use super::attributes::Attributes;
use super::constant::{Constant, Elements};
use super::message::NodeProto;

/// A tensor in a graph: numbers that round, or integers that name shapes, axes and places.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<T = f64> {
    /// Floating-point numbers.
    Numbers(Tensor<T>),
    /// Integers.
    Integers(Tensor<i64>),
}

impl<T: Scalar> Value<T> {
    /// A constant of a graph, without error.
    pub fn constant(constant: &Constant) -> Self {
        let shape = &constant.shape;
        match &constant.elements {
            Elements::F32(v) => {
                Self::Numbers(Tensor::new(shape, v.iter().map(|&x| T::exact(x.into())).collect()))
            }
            Elements::F64(v) => Self::Numbers(Tensor::new(shape, v.iter().map(|&x| T::exact(x)).collect())),
            Elements::I32(v) => Self::Integers(Tensor::new(shape, v.iter().map(|&i| i.into()).collect())),
            Elements::I64(v) => Self::Integers(Tensor::new(shape, v.clone())),
        }
    }
}

/// The operators known here, by ONNX's names.
pub const OPERATORS: &[&str] = &[
    "Add",
    "BatchNormalization",
    "Concat",
    "Constant",
    "Conv",
    "ConvTranspose",
    "Div",
    "Gather",
    "Gemm",
    "GridSample",
    "GroupNormalization",
    "InstanceNormalization",
    "LeakyRelu",
    "MatMul",
    "MaxPool",
    "Mul",
    "ReduceMean",
    "Relu",
    "Reshape",
    "Sigmoid",
    "Sqrt",
    "Sub",
    "Transpose",
    "Unsqueeze",
];

/// A node's first output; optional operands that are left out are `None`.
///
/// # Errors
/// When the operator, an attribute or an operand's kind is not understood.
///
/// # Panics
/// When the operands' shapes do not fit, as the reference's operators do.
pub fn evaluate<T: Scalar>(node: &NodeProto, operands: &[Option<&Value<T>>]) -> Result<Value<T>, String> {
    let operator = node.op_type.as_deref().unwrap_or_default();
    let operand = |i: usize| operands.get(i).copied().flatten();
    let numbers = |i: usize| match operand(i) {
        Some(Value::Numbers(tensor)) => Ok(tensor),
        Some(Value::Integers(_)) => {
            Err(format!("{operator}: operand {i} holds integers, numbers were expected"))
        }
        None => Err(format!("{operator}: operand {i} is missing")),
    };
    let optional = |i: usize| operand(i).map(|_| numbers(i)).transpose();
    let integers = |i: usize| match operand(i) {
        Some(Value::Integers(tensor)) => Ok(tensor),
        _ => Err(format!("{operator}: operand {i} must hold integers")),
    };
    let known = |names: &[&str]| Attributes::of(node, names).map_err(|why| format!("{operator}: {why}"));

    let y = match operator {
        "Add" => add(numbers(0)?, numbers(1)?),
        "Sub" => sub(numbers(0)?, numbers(1)?),
        "Mul" => mul(numbers(0)?, numbers(1)?),
        "Div" => div(numbers(0)?, numbers(1)?),
        "Sqrt" => numbers(0)?.map(T::sqrt),
        "Relu" => relu(numbers(0)?),
        "LeakyRelu" => leaky_relu(numbers(0)?, known(&["alpha"])?.float("alpha", 0.01)),
        "Sigmoid" => sigmoid(numbers(0)?),
        "Conv" => conv(numbers(0)?, numbers(1)?, optional(2)?, &window(node, numbers(1)?)?),
        "ConvTranspose" => {
            let params = ConvTranspose {
                conv: window(node, numbers(1)?)?,
                output_padding: Attributes::of(node, WINDOW)?.counts(
                    "output_padding",
                    numbers(1)?.rank().saturating_sub(2),
                    0,
                )?,
            };
            conv_transpose(numbers(0)?, numbers(1)?, optional(2)?, &params)
        }
        "MaxPool" => max_pool(numbers(0)?, &pool(node, numbers(0)?.rank().saturating_sub(2))?),
        "BatchNormalization" => {
            let attributes = known(&["epsilon", "momentum", "training_mode"])?;
            if attributes.flag("training_mode", false)? {
                return Err(format!("{operator}: training_mode 1; only inference is defined here"));
            }
            let epsilon = attributes.float("epsilon", 1e-5);
            batch_norm(numbers(0)?, numbers(1)?, numbers(2)?, numbers(3)?, numbers(4)?, epsilon)
        }
        "InstanceNormalization" => {
            let epsilon = known(&["epsilon"])?.float("epsilon", 1e-5);
            instance_norm(numbers(0)?, numbers(1)?, numbers(2)?, epsilon)
        }
        "GroupNormalization" => {
            // stash_type names the precision of the statistics; 1 is f32, the only one that the bound describes.
            let attributes = known(&["epsilon", "num_groups", "stash_type"])?;
            if attributes.int("stash_type", 1) != 1 {
                return Err(format!("{operator}: stash_type must be 1 (f32)"));
            }
            let (groups, epsilon) = (attributes.count("num_groups", 0)?, attributes.float("epsilon", 1e-5));
            group_norm(numbers(0)?, groups, numbers(1)?, numbers(2)?, epsilon)
        }
        "Gemm" => {
            let attributes = known(&["alpha", "beta", "transA", "transB"])?;
            let (alpha, beta) = (attributes.float("alpha", 1.0), attributes.float("beta", 1.0));
            let (trans_a, trans_b) = (attributes.flag("transA", false)?, attributes.flag("transB", false)?);
            gemm(numbers(0)?, numbers(1)?, optional(2)?, alpha, beta, trans_a, trans_b)
        }
        "MatMul" => matmul(numbers(0)?, numbers(1)?),
        "GridSample" => grid_sample(numbers(0)?, numbers(1)?, sampling(node)?),
        "ReduceMean" => {
            let attributes = known(&["keepdims", "noop_with_empty_axes"])?;
            let x = numbers(0)?;
            let axes: Vec<usize> = match operand(1) {
                Some(_) => integers(1)?.data.iter().map(|&a| axis(a, x.rank())).collect::<Result<_, _>>()?,
                None => Vec::new(),
            };
            let noop = axes.is_empty() && attributes.flag("noop_with_empty_axes", false)?;
            let all: Vec<usize> = (0..x.rank()).collect();
            match (noop, axes.is_empty()) {
                (true, _) => x.clone(),
                (false, true) => reduce_mean(x, &all, attributes.flag("keepdims", true)?),
                (false, false) => reduce_mean(x, &axes, attributes.flag("keepdims", true)?),
            }
        }
        "Concat" => {
            let tensors: Vec<_> = (0..operands.len()).map(numbers).collect::<Result<_, _>>()?;
            let rank = tensors.first().map_or(0, |x| x.rank());
            concat(&tensors, axis(known(&["axis"])?.int("axis", 0), rank)?)
        }
        "Transpose" => {
            let x = numbers(0)?;
            let reversed: Vec<usize> = (0..x.rank()).rev().collect();
            match known(&["perm"])?.counts("perm", x.rank(), usize::MAX)? {
                order if order.contains(&usize::MAX) => transpose(x, &reversed),
                order => transpose(x, &order),
            }
        }
        "Reshape" => {
            let (x, allowzero) = (numbers(0)?, known(&["allowzero"])?.flag("allowzero", false)?);
            x.reshape(&reshaped(&x.shape, &integers(1)?.data, allowzero)?)
        }
        "Unsqueeze" => unsqueezed(numbers(0)?, &integers(1)?.data)?,
        "Gather" => {
            let (x, places) = (numbers(0)?, integers(1)?);
            let axis = axis(known(&["axis"])?.int("axis", 0), x.rank())?;
            let [place] = places.data[..] else {
                return Err(format!("{operator}: one index is understood, found shape {:?}", places.shape));
            };
            let place = self::axis(place, x.shape[axis])?;
            let one = slice(x, axis, place, place + 1, 1);
            // A scalar index removes the axis; an index of shape [1] keeps it.
            let mut shape = one.shape.clone();
            shape.splice(axis..=axis, places.shape.iter().copied());
            one.reshape(&shape)
        }
        "Constant" => return Ok(Value::constant(&known(&["value"])?.tensor("value")?)),
        _ => return Err(format!("operator {operator} is not known to the judge")),
    };
    Ok(Value::Numbers(y))
}

/// A negative axis or place counts from the end.
fn axis(axis: i64, length: usize) -> Result<usize, String> {
    let from_start = if axis < 0 { axis + length as i64 } else { axis };
    usize::try_from(from_start)
        .ok()
        .filter(|&a| a < length)
        .ok_or_else(|| format!("axis or index {axis} does not lie in a length of {length}"))
}

const WINDOW: &[&str] =
    &["auto_pad", "dilations", "group", "kernel_shape", "output_padding", "pads", "strides"];

fn window<T>(node: &NodeProto, w: &Tensor<T>) -> Result<Conv, String> {
    let attributes = Attributes::of(node, WINDOW)?;
    let axes = w.shape.len().saturating_sub(2);
    if attributes
        .counts("kernel_shape", axes, 0)?
        .iter()
        .zip(&w.shape[2..])
        .any(|(&said, &is)| said != 0 && said != is)
    {
        return Err(format!("attribute \"kernel_shape\" does not fit the weights {:?}", w.shape));
    }
    Ok(Conv {
        stride: attributes.counts("strides", axes, 1)?,
        padding: attributes.paddings(axes)?,
        dilation: attributes.counts("dilations", axes, 1)?,
        groups: attributes.count("group", 1)?,
    })
}

fn pool(node: &NodeProto, axes: usize) -> Result<Pool, String> {
    let known = ["auto_pad", "ceil_mode", "dilations", "kernel_shape", "pads", "storage_order", "strides"];
    let attributes = Attributes::of(node, &known)?;
    Ok(Pool {
        kernel: attributes.counts("kernel_shape", axes, 0)?,
        stride: attributes.counts("strides", axes, 1)?,
        padding: attributes.paddings(axes)?,
        dilation: attributes.counts("dilations", axes, 1)?,
        ceil_mode: attributes.flag("ceil_mode", false)?,
    })
}

fn sampling(node: &NodeProto) -> Result<GridSample, String> {
    let attributes = Attributes::of(node, &["align_corners", "mode", "padding_mode"])?;
    let mode = attributes.text("mode", "linear")?;
    if mode != "linear" {
        return Err(format!("GridSample: attribute \"mode\" is {mode}, linear was expected"));
    }
    let padding = match attributes.text("padding_mode", "zeros")? {
        "zeros" => PaddingMode::Zeros,
        "border" => PaddingMode::Border,
        "reflection" => PaddingMode::Reflection,
        other => return Err(format!("GridSample: attribute \"padding_mode\" is {other}")),
    };
    Ok(GridSample { padding, align_corners: attributes.flag("align_corners", false)? })
}

/// The shape that a Reshape asks for: 0 keeps a side (unless `allowzero`), −1 is what remains.
fn reshaped(from: &[usize], to: &[i64], allowzero: bool) -> Result<Vec<usize>, String> {
    let error = || format!("Reshape: shape {from:?} cannot become {to:?}");
    let mut shape = Vec::with_capacity(to.len());
    for (i, &side) in to.iter().enumerate() {
        shape.push(match side {
            0 if !allowzero => *from.get(i).ok_or_else(error)?,
            -1 => 1,
            side => usize::try_from(side).map_err(|_| error())?,
        });
    }
    let (total, rest): (usize, usize) = (from.iter().product(), shape.iter().product());
    if let Some(open) = to.iter().position(|&side| side == -1) {
        shape[open] = total.checked_div(rest).ok_or_else(error)?;
    }
    if shape.iter().product::<usize>() == total { Ok(shape) } else { Err(error()) }
}

fn unsqueezed<T: Scalar>(x: &Tensor<T>, axes: &[i64]) -> Result<Tensor<T>, String> {
    let rank = x.rank() + axes.len();
    let ones: Vec<usize> = axes.iter().map(|&a| axis(a, rank)).collect::<Result<_, _>>()?;
    let mut sides = x.shape.iter();
    let shape: Vec<usize> =
        (0..rank).map(|a| if ones.contains(&a) { 1 } else { sides.next().copied().unwrap_or(1) }).collect();
    Ok(x.reshape(&shape))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::{GraphBuilder, int};
    use crate::onnx::model::Model;

    fn node(operator: &str, attributes: Vec<super::super::message::AttributeProto>) -> NodeProto {
        let bytes =
            GraphBuilder::new(21).input("x", &[1]).node(operator, &["x"], &["y"], attributes).output("y");
        Model::from_bytes("node", bytes.to_bytes()).expect("a model").nodes()[0].clone()
    }

    #[test]
    fn what_is_not_understood_is_refused_by_name() {
        let x = Value::Numbers(Tensor::new(&[2], vec![1.0, 2.0]));
        let why = evaluate(&node("Erf", vec![]), &[Some(&x)]).expect_err("refused");
        assert!(why.contains("operator Erf"), "{why}");
        let why = evaluate(&node("LeakyRelu", vec![int("beta", 1)]), &[Some(&x)]).expect_err("refused");
        assert!(why.contains("attribute \"beta\""), "{why}");
        let why = evaluate(&node("Add", vec![]), &[Some(&x)]).expect_err("refused");
        assert!(why.contains("operand 1 is missing"), "{why}");
    }

    #[test]
    fn a_reshape_keeps_infers_and_refuses() {
        assert_eq!(reshaped(&[2, 3, 4], &[0, -1], false), Ok(vec![2, 12]), "keep and infer");
        assert_eq!(reshaped(&[2, 3, 4], &[4, 6], false), Ok(vec![4, 6]), "as said");
        assert!(reshaped(&[2, 3, 4], &[5, -1], false).is_err(), "24 is no multiple of 5");
        assert!(reshaped(&[2, 3, 4], &[0, 0], false).is_err(), "24 elements do not fit in 6");
    }
}

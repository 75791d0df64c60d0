//! The part of each operand that one element of an output is computed from.
//!
//! Three ways lead there, none of which needs the element itself:
//!
//! - operators with a window, a row or a channel say it by their definition, axis by axis;
//! - element-wise operators read the element at the same place, or the only one of a broadcast axis;
//! - movements are followed by moving places: the operands' elements are replaced by their places and the reference moves
//!   those.
//!
//! Where a place depends on coordinates (Resize, GridSample) the field is the smallest box of which it is certain that it
//! holds all elements read. An operator that is not known here reads, for all that is known, everything.

use std::ops::Range;

use super::case::Case;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::{Data, Value};

mod movement;
mod product;
mod sampling;
mod window;

/// A box in a tensor: one range per axis.
pub type Field = Vec<Range<usize>>;

/// The box of each operand that element `index` of output `output` is computed from; `None` for operands that are left out
/// and for those that nothing is read from, as by an element in a padding.
///
/// # Panics
/// When the index does not lie in the output.
pub fn receptive_field(case: &Case, output: usize, index: &[usize]) -> Vec<Option<Field>> {
    let shape = case.found[output].as_ref().map_or(&[][..], |found| &found.shape);
    assert!(
        index.len() == shape.len() && index.iter().zip(shape).all(|(i, side)| i < side),
        "element {index:?} of an output of shape {shape:?}"
    );
    let view = View { node: &case.node, operands: &case.operands, output: shape };
    let fields = view
        .known(index)
        .or_else(|| movement::moved(case, output, index))
        .unwrap_or_else(|| view.everything());
    fields
        .into_iter()
        .map(|field| field.filter(|field| field.iter().all(|range| !range.is_empty())))
        .collect()
}

/// The fields as text, `X[0, 0:64, 3:6, 7:10]`, one per operand that is read.
pub fn text(case: &Case, fields: &[Option<Field>]) -> Vec<String> {
    let named = case.node.input.iter().zip(fields);
    named
        .filter_map(|(name, field)| {
            let field = field.as_ref()?;
            let axis = |range: &Range<usize>| match range.len() {
                1 => range.start.to_string(),
                _ => format!("{}:{}", range.start, range.end),
            };
            let axes: Vec<String> = field.iter().map(axis).collect();
            Some(if axes.is_empty() { name.clone() } else { format!("{name}[{}]", axes.join(", ")) })
        })
        .collect()
}

/// What the definitions look at: attributes and shapes, and the numbers of a few small operands.
struct View<'a> {
    node: &'a NodeProto,
    operands: &'a [Option<TypedTensor>],
    output: &'a [usize],
}

/// Operators that read one element of each operand, at the place of the output's.
const ELEMENT_WISE: &str = "Abs Acos Acosh Add And Asin Asinh Atan Atanh BitShift BitwiseAnd BitwiseNot BitwiseOr BitwiseXor \
    Cast CastLike Ceil Celu Clip Cos Cosh Div Dropout Elu Equal Erf Exp Floor Gelu Greater \
    GreaterOrEqual HardSigmoid HardSwish Identity IsInf IsNaN LeakyRelu Less LessOrEqual Log Max Mean \
    Min Mish Mod Mul Neg Not Or PRelu Pow Reciprocal Relu Round Selu Shrink Sigmoid Sign Sin Sinh \
    Softplus Softsign Sqrt Sub Sum Swish Tan Tanh ThresholdedRelu Where Xor";

fn named(list: &str, operator: &str) -> bool {
    list.split(' ').any(|name| name == operator)
}

/// Whether an operator reads one element of each operand for one of its output, and all of them alike.
pub(super) fn is_element_wise(operator: &str) -> bool {
    named(ELEMENT_WISE, operator)
}

/// Those of ONNX Runtime's own domain that do.
const FOREIGN_ELEMENT_WISE: &str = "BiasGelu FastGelu Gelu QLinearAdd QLinearLeakyRelu QLinearMul QLinearSigmoid \
    QLinearWhere QuickGelu";

/// Operators that compute nothing: their elements are found by moving places.
const MOVEMENTS: &str = "CenterCropPad Concat DepthToSpace Expand Flatten Gather GatherElements GatherND Pad Reshape \
    ReverseSequence ScatterElements ScatterND Slice SpaceToDepth Split Squeeze Tile Transpose Trilu \
    Unsqueeze";

impl View<'_> {
    fn shape(&self, operand: usize) -> Option<&[usize]> {
        self.operands.get(operand)?.as_ref().map(|tensor| &tensor.shape[..])
    }

    fn attribute(&self, name: &str) -> Option<&AttributeProto> {
        self.node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name))
    }

    fn int(&self, name: &str, default: i64) -> i64 {
        self.attribute(name).map_or(default, |attribute| attribute.i.unwrap_or(0))
    }

    fn text(&self, name: &str) -> &str {
        let bytes = self.attribute(name).and_then(|attribute| attribute.s.as_deref());
        bytes.and_then(|bytes| std::str::from_utf8(bytes).ok()).unwrap_or_default()
    }

    /// One of a list of integers per axis.
    fn along(&self, name: &str, axis: usize, default: i64) -> i64 {
        self.attribute(name).and_then(|attribute| attribute.ints.get(axis).copied()).unwrap_or(default)
    }

    /// Every element of every operand.
    fn everything(&self) -> Vec<Option<Field>> {
        (0..self.operands.len()).map(|i| self.whole(i)).collect()
    }

    fn whole(&self, operand: usize) -> Option<Field> {
        Some(self.shape(operand)?.iter().map(|&side| 0..side).collect())
    }

    /// The element of an operand that is broadcast to the output.
    fn broadcast(&self, operand: usize, index: &[usize]) -> Option<Field> {
        let shape = self.shape(operand)?;
        let extra = index.len().checked_sub(shape.len())?;
        Some(
            shape
                .iter()
                .zip(&index[extra..])
                .map(|(&side, &i)| if side == 1 { 0..1 } else { i..i + 1 })
                .collect(),
        )
    }

    /// The element of a list with one number per channel, or the only number.
    fn channel(&self, operand: usize, channel: usize) -> Option<Field> {
        let shape = self.shape(operand)?;
        Some(
            shape
                .iter()
                .map(|&side| if side == 1 { 0..1 } else { channel..(channel + 1).min(side) })
                .collect(),
        )
    }

    /// Fields by the operator's definition; `None` for operators that have none here.
    fn known(&self, index: &[usize]) -> Option<Vec<Option<Field>>> {
        let count = self.operands.len();
        let operator = self.node.op_type.as_deref().unwrap_or_default();
        let element_wise = match self.node.domain.as_deref() {
            None | Some("" | "ai.onnx") => named(ELEMENT_WISE, operator),
            Some("com.microsoft") if named(FOREIGN_ELEMENT_WISE, operator) => true,
            Some(_) => return None,
        };
        if element_wise {
            return Some((0..count).map(|i| self.broadcast(i, index)).collect());
        }
        match operator {
            "Conv" | "ConvInteger" => self.convolution(index, 1),
            "QLinearConv" => self.convolution(index, 3),
            "ConvTranspose" => self.transposed_convolution(index),
            "AveragePool" | "MaxPool" | "LpPool" => Some(vec![Some(self.pool(index)?)]),
            "GlobalAveragePool" | "GlobalMaxPool" | "GlobalLpPool" => {
                Some(vec![Some(self.leading(0, &index[..2.min(index.len())])?)])
            }
            "Gemm" => self.gemm(index),
            "MatMul" => Some(vec![self.row(0, index), self.column(1, index)]),
            "MatMulInteger" => Some(
                (0..count)
                    .map(|i| match i {
                        0 => self.row(0, index),
                        1 => self.column(1, index),
                        _ => self.whole(i),
                    })
                    .collect(),
            ),
            "QLinearMatMul" => Some(
                (0..count)
                    .map(|i| match i {
                        0 => self.row(0, index),
                        3 => self.column(3, index),
                        _ => self.whole(i),
                    })
                    .collect(),
            ),
            "Einsum" => self.einsum(index),
            "BatchNormalization" => {
                let x = self.broadcast(0, index);
                let c = index.get(1).copied().unwrap_or(0);
                Some((0..count).map(|i| if i == 0 { x.clone() } else { self.channel(i, c) }).collect())
            }
            "InstanceNormalization" => {
                let x = self.leading(0, index.get(..2)?);
                Some((0..count).map(|i| if i == 0 { x.clone() } else { self.channel(i, index[1]) }).collect())
            }
            "GroupNormalization" => {
                let (channels, groups) =
                    (self.output.get(1).copied()?, usize::try_from(self.int("num_groups", 1)).ok()?);
                let size = channels.checked_div(groups)?.max(1);
                let group = index[1] / size;
                let mut x = self.leading(0, &index[..1])?;
                x[1] = group * size..(group + 1) * size;
                let own = |i: usize| {
                    let per_group =
                        self.shape(i).is_some_and(|shape| shape == [groups] && groups != channels);
                    self.channel(i, if per_group { group } else { index[1] })
                };
                Some((0..count).map(|i| if i == 0 { Some(x.clone()) } else { own(i) }).collect())
            }
            "LayerNormalization" | "RMSNormalization" => {
                let axis = self.axis("axis", -1, index.len())?;
                let x = self.leading(0, &index[..axis]);
                Some((0..count).map(|i| if i == 0 { x.clone() } else { self.broadcast(i, index) }).collect())
            }
            "Softmax" | "LogSoftmax" | "Hardmax" | "CumSum" | "LpNormalization" => {
                let mut fields = self.everything();
                fields[0] = self.broadcast(0, index);
                let axis = match operator {
                    "CumSum" => self.number(1)? as i64,
                    _ => self.int("axis", -1),
                };
                let axis = counted(axis, index.len())?;
                fields[0].as_mut()?[axis] = 0..self.output[axis];
                Some(fields)
            }
            "LRN" => {
                let mut x = self.broadcast(0, index)?;
                let size = usize::try_from(self.int("size", 1)).ok()?.max(1);
                let (before, after) = ((size - 1) / 2, size / 2);
                x[1] = index[1].saturating_sub(before)..(index[1] + after + 1).min(self.output[1]);
                Some(vec![Some(x)])
            }
            "QuantizeLinear" | "DequantizeLinear" => {
                let axis = counted(self.int("axis", 1), index.len()).unwrap_or(0);
                let own = |i: usize| match self.shape(i)?.len() {
                    0 => Some(Field::new()),
                    1 => self.channel(i, index[axis]),
                    _ => self.whole(i),
                };
                Some((0..count).map(|i| if i == 0 { self.broadcast(0, index) } else { own(i) }).collect())
            }
            "ArgMax" | "ArgMin" => {
                let axis = self.int("axis", 0);
                self.reduced(index, &[axis])
            }
            name if name.starts_with("Reduce") => {
                let axes = match self.operands.get(1).and_then(Option::as_ref) {
                    Some(axes) => integers(axes)?,
                    None => self.attribute("axes").map(|axes| axes.ints.clone()).unwrap_or_default(),
                };
                self.reduced(index, &axes)
            }
            "Resize" | "Upsample" => self.resized(index),
            "GridSample" => self.sampled(index),
            _ => None,
        }
    }

    fn axis(&self, name: &str, default: i64, rank: usize) -> Option<usize> {
        counted(self.int(name, default), rank)
    }

    /// An operand's only number.
    fn number(&self, operand: usize) -> Option<f64> {
        numbers(self.operands.get(operand)?.as_ref()?)?.first().copied()
    }

    /// All elements under the first indices.
    fn leading(&self, operand: usize, index: &[usize]) -> Option<Field> {
        let shape = self.shape(operand)?;
        Some(
            shape
                .iter()
                .enumerate()
                .map(|(axis, &side)| match index.get(axis) {
                    Some(&i) => i..i + 1,
                    None => 0..side,
                })
                .collect(),
        )
    }
}

/// The part of [begin, end) inside 0..side.
fn clipped(begin: i64, end: i64, side: usize) -> Range<usize> {
    let inside = |place: i64| usize::try_from(place.max(0)).unwrap_or(usize::MAX).min(side);
    inside(begin)..inside(end).max(inside(begin))
}

/// An axis counted from the start.
fn counted(axis: i64, rank: usize) -> Option<usize> {
    let axis = if axis < 0 { axis + rank as i64 } else { axis };
    usize::try_from(axis).ok().filter(|&axis| axis < rank)
}

/// The place in a shape that is broadcast to the axes of `index`, aligned at the end.
fn aligned(shape: &[usize], index: &[usize]) -> Field {
    let extra = index.len().saturating_sub(shape.len());
    let places = shape.iter().zip(&index[extra..]);
    places.map(|(&side, &i)| if side == 1 { 0..1 } else { i..i + 1 }).collect()
}

fn numbers(tensor: &TypedTensor) -> Option<Vec<f64>> {
    let value: Value = Value::of(tensor).ok()?;
    match value.data {
        Data::Numbers(x) => Some(x.data),
        Data::Integers(x) => Some(x.data.iter().map(|&i| i as f64).collect()),
        Data::Truths(_) => None,
    }
}

fn integers(tensor: &TypedTensor) -> Option<Vec<i64>> {
    let value: Value = Value::of(tensor).ok()?;
    value.integers().ok().map(|x| x.data.clone())
}

#[cfg(test)]
mod tests;

//! What shapes a node's outputs will about have, to plan how much is run at once.
//!
//! An estimate may be wrong: it costs memory or time, never a verdict.

use std::collections::BTreeMap;

use super::party::{Held, Tensors};
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::Elements;

fn ints<'a>(node: &'a NodeProto, name: &str) -> Option<&'a [i64]> {
    let attribute = node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name));
    attribute.map(|attribute| &attribute.ints[..])
}

fn int(node: &NodeProto, name: &str, default: i64) -> i64 {
    let attribute = node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name));
    attribute.map_or(default, |attribute| attribute.i.unwrap_or(0))
}

/// The integers of a held tensor, where it has some.
fn list(held: &Tensors, name: Option<&String>) -> Option<Vec<i64>> {
    match held.get(name?)? {
        Held::Given(tensor) | Held::Constant(tensor) => match &tensor.elements {
            Elements::I64(v) => Some(v.clone()),
            _ => None,
        },
        _ => None,
    }
}

fn scales(held: &Tensors, name: Option<&String>) -> Option<Vec<f32>> {
    match held.get(name?)? {
        Held::Given(tensor) | Held::Constant(tensor) => match &tensor.elements {
            Elements::F32(v) if !v.is_empty() => Some(v.clone()),
            _ => None,
        },
        _ => None,
    }
}

fn broadcast(shapes: &[&[usize]]) -> Vec<usize> {
    let rank = shapes.iter().map(|shape| shape.len()).max().unwrap_or(0);
    let mut sides = vec![1; rank];
    for shape in shapes {
        for (side, &own) in sides.iter_mut().rev().zip(shape.iter().rev()) {
            *side = (*side).max(own);
        }
    }
    sides
}

/// Estimated shapes of all outputs, from those of the operands that are known.
pub(super) fn output_shapes(
    node: &NodeProto,
    shapes: &BTreeMap<&str, Vec<usize>>,
    held: &Tensors,
) -> Vec<Vec<usize>> {
    let operand = |i: usize| node.input.get(i).and_then(|name| shapes.get(name.as_str())).map(Vec::as_slice);
    let all: Vec<&[usize]> = (0..node.input.len()).filter_map(operand).collect();
    let largest = all.iter().max_by_key(|shape| shape.iter().product::<usize>()).copied().unwrap_or(&[1]);
    let x = operand(0).unwrap_or(largest);
    let stride =
        |axis: usize| ints(node, "strides").and_then(|s| s.get(axis)).map_or(1, |&s| s.max(1) as usize);
    let shape = match node.op_type.as_deref().unwrap_or_default() {
        "Conv" | "ConvInteger" | "QLinearConv" if x.len() > 2 => {
            let weights = if node.op_type.as_deref() == Some("QLinearConv") { 3 } else { 1 };
            let channels = operand(weights).and_then(|w| w.first()).copied().unwrap_or(x[1]);
            let space = x[2..].iter().enumerate().map(|(axis, &side)| side.div_ceil(stride(axis)));
            [x[0], channels].into_iter().chain(space).collect()
        }
        "ConvTranspose" if x.len() > 2 => {
            let groups = int(node, "group", 1).max(1) as usize;
            let channels = operand(1).and_then(|w| w.get(1)).map_or(x[1], |&o| o * groups);
            let space = x[2..].iter().enumerate().map(|(axis, &side)| side * stride(axis));
            [x[0], channels].into_iter().chain(space).collect()
        }
        "MaxPool" | "AveragePool" | "LpPool" if x.len() > 2 => {
            let space = x[2..].iter().enumerate().map(|(axis, &side)| side.div_ceil(stride(axis)));
            x[..2].iter().copied().chain(space).collect()
        }
        "GlobalAveragePool" | "GlobalMaxPool" if x.len() > 2 => {
            x[..2].iter().copied().chain(x[2..].iter().map(|_| 1)).collect()
        }
        "Resize" | "Upsample" => {
            let factors = scales(held, node.input.get(2)).or_else(|| scales(held, node.input.get(1)));
            match (list(held, node.input.get(3)), factors) {
                (Some(sizes), _) if sizes.len() == x.len() => {
                    sizes.iter().map(|&s| s.max(0) as usize).collect()
                }
                (_, Some(factors)) if factors.len() == x.len() => x
                    .iter()
                    .zip(factors)
                    .map(|(&side, f)| (side as f32 * f.max(0.0)).ceil() as usize)
                    .collect(),
                _ => {
                    x.iter().enumerate().map(|(axis, &side)| if axis < 2 { side } else { 2 * side }).collect()
                }
            }
        }
        "GridSample" if x.len() > 2 => {
            let grid = operand(1).unwrap_or(&[]);
            let points = grid.get(1..grid.len().saturating_sub(1)).unwrap_or_default();
            x[..2].iter().chain(points).copied().collect()
        }
        "MatMul" | "MatMulInteger" | "QLinearMatMul" | "Gemm" => {
            let transposed = int(node, "transB", 0) == 1;
            let b = operand(1).unwrap_or(&[1]);
            let columns = if transposed { b.first() } else { b.last() };
            let mut shape =
                if int(node, "transA", 0) == 1 { x.iter().rev().copied().collect() } else { x.to_vec() };
            if let (Some(last), Some(&columns)) = (shape.last_mut(), columns) {
                *last = columns;
            }
            let batch = b.get(..b.len().saturating_sub(2)).unwrap_or_default();
            let from_b: usize = batch.iter().product();
            if from_b > shape[..shape.len().saturating_sub(2)].iter().product() {
                shape = batch.iter().chain(&shape[shape.len().saturating_sub(2)..]).copied().collect();
            }
            shape
        }
        "Concat" => {
            let axis = int(node, "axis", 0);
            let axis = if axis < 0 { axis + largest.len() as i64 } else { axis } as usize;
            let mut shape = largest.to_vec();
            if let Some(side) = shape.get_mut(axis) {
                *side = all.iter().filter_map(|shape| shape.get(axis)).sum();
            }
            shape
        }
        "Expand" | "Tile" | "ConstantOfShape" => {
            let at = usize::from(node.op_type.as_deref() != Some("ConstantOfShape"));
            let list: Vec<usize> = list(held, node.input.get(at))
                .unwrap_or_default()
                .iter()
                .map(|&side| side.max(1) as usize)
                .collect();
            match node.op_type.as_deref() {
                Some("Tile") => x.iter().zip(&list).map(|(a, b)| a * b).collect(),
                _ => broadcast(&[&list, if at == 1 { x } else { &[] }]),
            }
        }
        "Shape" | "Size" => vec![largest.len()],
        "Reshape" | "Transpose" | "Flatten" | "Gather" => x.to_vec(),
        "Add" | "Sub" | "Mul" | "Div" | "Pow" | "Where" | "Min" | "Max" | "Equal" | "Less" | "Greater" => {
            broadcast(&all)
        }
        _ => largest.to_vec(),
    };
    vec![shape; node.output.len()]
}

//! A small part of a large node, cut such that it is a node of the same kind.
//!
//! Some sixty meanings are tried, so a convolution that takes a second must not be evaluated whole. Few output channels and
//! a window of places are enough: what explains a mistake explains it anywhere. The operands are cut to what the places
//! are computed from, with a wide margin, so that a meaning which reads elsewhere (a flipped kernel, other paddings) still
//! finds what it would read; only the places inside the margin are compared.
//!
//! Windows are taken around the worst element and at the first corner, where paddings show.

use std::ops::Range;

use super::change::{int, ints, text};
use crate::audit::case::Case;
use crate::audit::region::{Region, part};
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// Products that one evaluation may cost before a part is taken: some tens of milliseconds.
const CHEAP: f64 = 2e6;

/// Products beyond which a node that cannot be cut is not tried at all.
const DEAR: f64 = 1e8;

/// Output channels of a part.
const CHANNELS: usize = 3;

/// A part of a node.
pub struct Excerpt {
    /// The node on the part's operands, with the part's outputs.
    pub case: Case,
    /// The places of the first output that are compared, where the operands reach further.
    pub window: Option<Region>,
}

/// The node itself where it is cheap, else one or two parts of it; none where it is dear and cannot be cut.
pub fn excerpts(case: &Case, worst: Option<&[usize]>) -> Vec<Excerpt> {
    cut_to(case, worst, CHEAP)
}

/// As [`excerpts`], of parts of about `products`.
fn cut_to(case: &Case, worst: Option<&[usize]>, products: f64) -> Vec<Excerpt> {
    let whole = || Excerpt { case: case.clone(), window: None };
    let (cost, Some(shape)) =
        (cost(case), case.found.first().and_then(Option::as_ref).map(|y| y.shape.clone()))
    else {
        return vec![whole()];
    };
    if cost <= products {
        return vec![whole()];
    }
    let zeros = vec![0; shape.len()];
    let worst = worst.filter(|worst| worst.len() == shape.len()).unwrap_or(&zeros);
    let operator = case.node.op_type.as_deref().unwrap_or_default();
    let parts: Vec<Excerpt> = match operator {
        "Conv" | "ConvTranspose" | "ConvInteger" | "QLinearConv" | "AveragePool" | "MaxPool" | "LpPool" => {
            let mut parts: Vec<Excerpt> = windowed(case, worst, products).into_iter().collect();
            let corner: Vec<usize> =
                worst.iter().enumerate().map(|(axis, &i)| if axis < 2 { i } else { 0 }).collect();
            parts.extend(windowed(case, &corner, products));
            parts
        }
        "MatMul" | "Gemm" | "MatMulInteger" | "QLinearMatMul" => {
            product(case, worst, products).into_iter().collect()
        }
        _ => leading(case, worst, products).into_iter().collect(),
    };
    if parts.is_empty() && cost <= DEAR { vec![whole()] } else { parts }
}

/// About how many products or elements an evaluation handles.
fn cost(case: &Case) -> f64 {
    let shape = |i: usize| case.operands.get(i).and_then(Option::as_ref).map_or(&[][..], |t| &t.shape);
    let count = |shape: &[usize]| shape.iter().product::<usize>() as f64;
    let output = case.found.iter().flatten().map(|t| t.len() as f64).fold(1.0, f64::max);
    let each = match case.node.op_type.as_deref().unwrap_or_default() {
        "Conv" | "ConvInteger" => count(shape(1)) / shape(1).first().copied().unwrap_or(1).max(1) as f64,
        "QLinearConv" => count(shape(3)) / shape(3).first().copied().unwrap_or(1).max(1) as f64,
        "ConvTranspose" => {
            let steps: i64 = ints(&case.node, "strides").iter().product();
            count(shape(1)) / shape(1).get(1).copied().unwrap_or(1).max(1) as f64 / steps.max(1) as f64
        }
        "MatMul" | "MatMulInteger" | "QLinearMatMul" => shape(0).last().copied().unwrap_or(1) as f64,
        "Gemm" => {
            count(shape(0))
                / shape(0).get(usize::from(int(&case.node, "transA", 0) == 1)).copied().unwrap_or(1).max(1)
                    as f64
        }
        "AveragePool" | "MaxPool" | "LpPool" => {
            ints(&case.node, "kernel_shape").iter().product::<i64>() as f64
        }
        "Resize" | "GridSample" => match text(&case.node, "mode", "linear") {
            "cubic" | "bicubic" => 16.0,
            _ => 4.0,
        },
        _ => 1.0,
    };
    let operands = case.operands.iter().flatten().map(|t| t.len() as f64).fold(0.0, f64::max);
    (output * each).max(operands)
}

/// The place of the weights, or of the second matrix.
pub fn weights(operator: &str) -> usize {
    if operator.starts_with("QLinear") || operator == "QGemm" { 3 } else { 1 }
}

fn tensor(case: &Case, place: usize) -> Option<&TypedTensor> {
    case.operands.get(place)?.as_ref()
}

/// The part of a tensor with these ranges of the first axes and all of the others.
fn cut(tensor: &TypedTensor, ranges: &[Range<usize>]) -> Option<TypedTensor> {
    let mut region = Region::whole(&tensor.shape);
    for (axis, range) in ranges.iter().enumerate() {
        *region.0.get_mut(axis)? = range.clone();
    }
    region.fits(&tensor.shape).then(|| part(tensor, &region))
}

/// A range of `length` places around one, inside a side.
fn around(place: usize, length: usize, side: usize) -> Range<usize> {
    let length = length.min(side);
    let start = place.saturating_sub(length / 2).min(side - length);
    start..start + length
}

/// A window of a convolution or a pool.
fn windowed(case: &Case, worst: &[usize], products: f64) -> Option<Excerpt> {
    let node = &case.node;
    let transposed = node.op_type.as_deref() == Some("ConvTranspose");
    let operator = node.op_type.as_deref().unwrap_or_default();
    let (pool, weights) = (operator.ends_with("Pool"), weights(operator));
    // Of ONNX Runtime's own operators some have their channels behind the image.
    if int(node, "channels_last", 0) != 0 {
        return None;
    }
    let x = tensor(case, 0)?;
    let y = case.found.first()?.as_ref()?;
    let axes = y.shape.len().checked_sub(2)?;
    let kernel: Vec<i64> = if pool {
        ints(node, "kernel_shape")
    } else {
        tensor(case, weights)?.shape.get(2..)?.iter().map(|&k| k as i64).collect()
    };
    let along =
        |name: &str, axis: usize, default: i64| ints(node, name).get(axis).copied().unwrap_or(default);
    let spatial = matches!(text(node, "auto_pad", "NOTSET"), "NOTSET" | "VALID")
        && ints(node, "output_shape").is_empty();

    // Channels: of a convolution in one group the kernels of a few, of a pool the few themselves.
    let groups = int(node, "group", 1);
    let channels = if groups == 1 || pool { around(worst[1], CHANNELS, y.shape[1]) } else { 0..y.shape[1] };
    let taps = cost(case) / y.len() as f64;
    let places = (products / taps / channels.len() as f64).max(16.0);
    let side = places.powf(1.0 / axes.max(1) as f64).floor().max(3.0) as usize;

    let batch = worst[0]..worst[0] + 1;
    let mut inputs = vec![batch.clone(), if pool { channels.clone() } else { 0..x.shape[1] }];
    let mut outputs = vec![batch, channels.clone()];
    let mut window = vec![0..1, 0..channels.len()];
    for axis in 0..axes {
        let (n, out) = (x.shape[axis + 2] as i64, y.shape[axis + 2]);
        let (stride, dilation) = (along("strides", axis, 1).max(1), along("dilations", axis, 1));
        let extent = (*kernel.get(axis)? - 1) * dilation + 1;
        let before = along("pads", axis, 0);
        let range = if spatial { around(worst[axis + 2], side, out) } else { 0..out };
        let (first, last) = (range.start as i64, range.end as i64 - 1);
        // Twice as far as the window reaches, on both sides.
        let margin = 2 * extent + before.abs() + stride;
        let (from, to, moved) = if transposed {
            let from = ((first + before - extent).div_euclid(stride) - margin.div_euclid(stride) - 1).max(0);
            let to = ((last + before).div_euclid(stride) + margin.div_euclid(stride) + 2).min(n);
            (from, to, from * stride)
        } else {
            let from = (first * stride - margin).div_euclid(stride).max(0) * stride;
            let to = (last * stride + margin).min(n);
            (from, to, from / stride)
        };
        if !spatial || from >= to {
            inputs.push(0..x.shape[axis + 2]);
            outputs.push(0..out);
            window.push(0..out);
            continue;
        }
        inputs.push(from as usize..to as usize);
        let start = usize::try_from(first - moved).ok()?;
        window.push(start..start + range.len());
        outputs.push(range);
    }
    let mut operands = case.operands.clone();
    operands[0] = Some(cut(x, &inputs)?);
    if !pool && groups == 1 {
        let w = tensor(case, weights)?;
        let kernels = if transposed { vec![0..w.shape[0], channels.clone()] } else { vec![channels.clone()] };
        operands[weights] = Some(cut(w, &kernels)?);
        // The bias, and scales and zero points of channels.
        for parameter in operands.iter_mut().skip(weights + 1).flatten() {
            if parameter.shape.iter().product::<usize>() > 1 || parameter.shape == [y.shape[1]] {
                *parameter = cut(parameter, std::slice::from_ref(&channels))?;
            }
        }
    }
    // Further outputs, such as a pool's places, count through the whole operand.
    let mut found = vec![None; case.found.len()];
    found[0] = Some(cut(y, &outputs)?);
    Some(Excerpt { case: Case { operands, found, ..case.clone() }, window: Some(Region(window)) })
}

/// Some rows and columns of a matrix product.
fn product(case: &Case, worst: &[usize], products: f64) -> Option<Excerpt> {
    let operator = case.node.op_type.as_deref().unwrap_or_default();
    let weights = weights(operator);
    let (a, b) = (tensor(case, 0)?, tensor(case, weights)?);
    let y = case.found.first()?.as_ref()?;
    let rank = y.shape.len();
    if rank < 2 || a.shape.len() != rank || b.shape.len() < 2 || (b.shape.len() != 2 && b.shape.len() != rank)
    {
        return None;
    }
    let gemm = operator == "Gemm";
    let flipped = |name: &str| gemm && int(&case.node, name, 0) == 1;
    let depth = cost(case) / y.len() as f64;
    // Whole columns where a few rows of them are cheap: so a matrix that was transposed can still be.
    let few = products / (depth * y.shape[rank - 1] as f64);
    let (height, width) = match few >= 8.0 {
        true => (few as usize, y.shape[rank - 1]),
        false => ((products / depth).sqrt().max(8.0) as usize, (products / depth).sqrt().max(8.0) as usize),
    };
    let mut rows: Vec<Range<usize>> = worst[..rank - 2].iter().map(|&i| i..i + 1).collect();
    let (m, n) = (
        around(worst[rank - 2], height, y.shape[rank - 2]),
        around(worst[rank - 1], width, y.shape[rank - 1]),
    );
    let batches = rows.clone();
    let left = if flipped("transA") {
        vec![0..a.shape[0], m.clone()]
    } else {
        [&batches[..], std::slice::from_ref(&m)].concat()
    };
    let own = b.shape.iter().zip(&batches).map(|(&side, range)| if side == 1 { 0..1 } else { range.clone() });
    let right: Vec<Range<usize>> = match b.shape.len() {
        2 if flipped("transB") => vec![n.clone()],
        2 => vec![0..b.shape[0], n.clone()],
        _ => own.chain([0..b.shape[rank - 2], n.clone()]).collect(),
    };
    if a.shape.iter().zip(&y.shape).take(rank - 2).any(|(a, y)| a != y) {
        return None;
    }
    let mut operands = case.operands.clone();
    operands[0] = Some(cut(a, &left)?);
    operands[weights] = Some(cut(b, &right)?);
    // Scales and zero points, of all or one each row or column.
    let parameters: &[(usize, &Range<usize>)] = match operator {
        "MatMulInteger" => &[(2, &m), (3, &n)],
        "QLinearMatMul" => &[(1, &m), (2, &m), (4, &n), (5, &n)],
        _ => &[],
    };
    for &(place, range) in parameters {
        let Some(parameter) = operands.get_mut(place).and_then(Option::as_mut) else { continue };
        match parameter.shape[..] {
            [] | [1] => {}
            [_] => *parameter = cut(parameter, std::slice::from_ref(range))?,
            _ => return None,
        }
    }
    if gemm && let Some(c) = tensor(case, 2) {
        let ranges = [&m, &n];
        let sides: Vec<Range<usize>> = c
            .shape
            .iter()
            .rev()
            .zip(ranges.iter().rev())
            .map(|(&side, range)| if side == 1 { 0..1 } else { (*range).clone() })
            .collect();
        operands[2] = Some(cut(c, &sides.into_iter().rev().collect::<Vec<_>>())?);
    }
    rows.extend([m, n]);
    let found = vec![Some(cut(y, &rows)?)];
    Some(Excerpt { case: Case { operands, found, ..case.clone() }, window: None })
}

/// One element of the batch and a few channels, for operators that treat them alike.
fn leading(case: &Case, worst: &[usize], products: f64) -> Option<Excerpt> {
    let node = &case.node;
    let operator = node.op_type.as_deref().unwrap_or_default();
    let y = case.found.first()?.as_ref()?;
    let rank = y.shape.len();
    // How many leading axes are independent, and which operands have them.
    let independent = match operator {
        "BatchNormalization"
        | "InstanceNormalization"
        | "GlobalAveragePool"
        | "GlobalMaxPool"
        | "Resize"
        | "GridSample" => 2,
        "GroupNormalization" | "LRN" => 1,
        "LayerNormalization" | "RMSNormalization" | "Softmax" | "LogSoftmax" => {
            let axis = int(node, "axis", -1);
            usize::try_from(if axis < 0 { axis + rank as i64 } else { axis }).ok()?
        }
        "QuantizeLinear" | "DequantizeLinear" => rank,
        _ if crate::audit::receptive_field::is_element_wise(operator) => rank,
        _ => 0,
    };
    if independent == 0 || rank == 0 {
        return None;
    }
    let inner: usize = y.shape.iter().product();
    let mut left = inner as f64 / (products / (cost(case) / inner as f64).max(1.0));
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for axis in 0..independent {
        let side = y.shape[axis];
        let keep = ((side as f64 / left).ceil() as usize).clamp(1, side);
        left = (left * keep as f64 / side as f64).max(1.0);
        ranges.push(around(worst[axis], keep, side));
    }
    let mut operands = case.operands.clone();
    for (place, operand) in operands.iter_mut().enumerate() {
        let Some(old) = operand.as_ref() else { continue };
        let per_channel = || ranges.get(1).filter(|_| old.shape == [y.shape[1]]).cloned();
        *operand = Some(match (operator, place) {
            ("BatchNormalization" | "InstanceNormalization", 1..) => cut(old, &[per_channel()?])?,
            ("QuantizeLinear" | "DequantizeLinear", 1..) => match old.shape[..] {
                [] | [1] => old.clone(),
                [_] => {
                    let axis = int(node, "axis", 1);
                    let axis = usize::try_from(if axis < 0 { axis + rank as i64 } else { axis }).ok()?;
                    cut(old, &[ranges.get(axis)?.clone()])?
                }
                _ => return None,
            },
            ("GroupNormalization", 1..) => old.clone(),
            ("GridSample", 1) => cut(old, &ranges[..1])?,
            ("Resize", 0) => cut(old, &ranges)?,
            // The sides that are asked for.
            ("Resize", 3) => resized(old, &ranges)?,
            ("Resize", _) => old.clone(),
            _ => {
                let extra = rank.checked_sub(old.shape.len())?;
                let own: Vec<Range<usize>> = ranges
                    .iter()
                    .skip(extra)
                    .zip(&old.shape)
                    .map(|(range, &side)| if side == 1 { 0..1 } else { range.clone() })
                    .collect();
                cut(old, &own)?
            }
        });
    }
    if operator == "Resize" && tensor(case, 0)?.shape.get(..2)? != &y.shape[..2] {
        return None;
    }
    let mut found = vec![None; case.found.len()];
    found[0] = Some(cut(y, &ranges)?);
    Some(Excerpt { case: Case { operands, found, ..case.clone() }, window: None })
}

fn resized(sizes: &TypedTensor, ranges: &[Range<usize>]) -> Option<TypedTensor> {
    let Elements::I64(old) = &sizes.elements else { return None };
    let mut new = old.clone();
    for (axis, range) in ranges.iter().enumerate() {
        *new.get_mut(axis)? = range.len() as i64;
    }
    Some(TypedTensor { shape: sizes.shape.clone(), elements: Elements::I64(new) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::cases_for_tests::{byte, case, drawn_bytes, given, list, numbers, one, output};
    use crate::onnx::builder::{float, int, ints, text as string};

    /// The first output of a part, cut to its window.
    fn of_part(excerpt: &Excerpt) -> TypedTensor {
        let y = output(&excerpt.case).expect("an output");
        match &excerpt.window {
            Some(window) => part(&y, window),
            None => y,
        }
    }

    #[test]
    fn a_part_is_a_node_that_gives_its_part_of_the_whole() {
        let window =
            || vec![ints("pads", &[1, 0, 2, 1]), ints("strides", &[2, 1]), ints("dilations", &[1, 2])];
        let channels = |name: &str| numbers(name, &[6]);
        let cases = [
            case(
                "Conv",
                vec![numbers("x", &[2, 4, 40, 31]), numbers("w", &[6, 4, 3, 2]), channels("b")],
                window(),
            ),
            case("Conv", vec![numbers("x", &[1, 4, 40, 31]), numbers("w", &[6, 2, 3, 2])], {
                let mut attributes = window();
                attributes.push(int("group", 2));
                attributes
            }),
            case(
                "Conv",
                vec![numbers("x", &[1, 2, 23, 24]), numbers("w", &[5, 2, 3, 3])],
                vec![string("auto_pad", "SAME_UPPER"), ints("strides", &[2, 2])],
            ),
            case(
                "ConvTranspose",
                vec![numbers("x", &[2, 4, 24, 19]), numbers("w", &[4, 6, 3, 4]), channels("b")],
                vec![ints("strides", &[2, 3]), ints("pads", &[1, 0, 0, 1]), ints("output_padding", &[1, 0])],
            ),
            case(
                "AveragePool",
                vec![numbers("x", &[2, 5, 40, 31])],
                [window(), vec![ints("kernel_shape", &[3, 2]), int("ceil_mode", 1)]].concat(),
            ),
            case("MatMul", vec![numbers("a", &[3, 40, 12]), numbers("b", &[3, 12, 50])], vec![]),
            case(
                "QLinearConv",
                vec![
                    drawn_bytes("x", &[2, 4, 40, 31], false),
                    one(0.02),
                    byte(120),
                    drawn_bytes("w", &[6, 4, 3, 2], true),
                    channels("s"),
                    drawn_bytes("z", &[6], true),
                    one(0.3),
                    byte(100),
                    TypedTensor::new(&[6], Elements::I32(vec![5, -80, 700, 0, 9, -4000])).ok(),
                ],
                window(),
            ),
            case(
                "ConvInteger",
                vec![
                    drawn_bytes("x", &[2, 4, 40, 31], false),
                    drawn_bytes("w", &[6, 4, 3, 2], true),
                    byte(120),
                    drawn_bytes("z", &[6], true),
                ],
                window(),
            ),
            case(
                "MatMulInteger",
                vec![
                    drawn_bytes("a", &[3, 40, 12], false),
                    drawn_bytes("b", &[12, 50], true),
                    byte(120),
                    drawn_bytes("z", &[50], true),
                ],
                vec![],
            ),
            case(
                "QLinearMatMul",
                vec![
                    drawn_bytes("a", &[40, 12], false),
                    numbers("sa", &[40]),
                    drawn_bytes("za", &[40], false),
                    drawn_bytes("b", &[12, 50], false),
                    numbers("sb", &[50]),
                    drawn_bytes("zb", &[50], false),
                    one(90.0),
                    byte(100),
                ],
                vec![],
            ),
            case("QuantizeLinear", vec![numbers("x", &[5, 30, 40]), one(0.02), byte(120)], vec![]),
            case(
                "DequantizeLinear",
                vec![
                    drawn_bytes("x", &[5, 30, 40], true),
                    numbers("s", &[30]),
                    drawn_bytes("z", &[30], true),
                ],
                vec![int("axis", 1)],
            ),
            case("MatMul", vec![numbers("a", &[3, 40, 12]), numbers("b", &[12, 50])], vec![]),
            case(
                "Gemm",
                vec![numbers("a", &[12, 40]), numbers("b", &[50, 12]), numbers("c", &[50])],
                vec![int("transA", 1), int("transB", 1), float("alpha", 0.5)],
            ),
            case(
                "InstanceNormalization",
                vec![numbers("x", &[3, 6, 9, 8]), channels("s"), channels("b")],
                vec![],
            ),
            case(
                "LayerNormalization",
                vec![numbers("x", &[30, 40, 8]), numbers("s", &[8])],
                vec![int("axis", -1)],
            ),
            case("Softmax", vec![numbers("x", &[30, 7, 8])], vec![int("axis", 1)]),
            case("Add", vec![numbers("a", &[3, 1, 40, 20]), numbers("b", &[5, 1, 20])], vec![]),
            case(
                "Resize",
                vec![numbers("x", &[2, 5, 9, 8]), None, given(&[1.0, 1.0, 2.0, 1.5])],
                vec![string("mode", "linear")],
            ),
            case(
                "Resize",
                vec![numbers("x", &[2, 5, 9, 8]), None, None, list(&[2, 5, 20, 6])],
                vec![string("mode", "linear")],
            ),
            case(
                "GridSample",
                vec![numbers("x", &[2, 5, 9, 8]), numbers("g", &[2, 12, 9, 2])],
                vec![string("mode", "linear")],
            ),
        ];
        for case in cases {
            let y = case.found[0].as_ref().expect("an output");
            let last: Vec<usize> = y.shape.iter().map(|side| side - 1).collect();
            let middle: Vec<usize> = y.shape.iter().map(|side| side / 2).collect();
            for worst in [vec![0; last.len()], middle, last] {
                let parts = cut_to(&case, Some(&worst), 700.0);
                assert!(!parts.is_empty(), "{} at {worst:?} is cut", case.name);
                for excerpt in &parts {
                    let found = excerpt.case.found[0].as_ref().expect("found");
                    assert!(found.len() < y.len(), "{}: a part is smaller", case.name);
                    assert_eq!(&of_part(excerpt), found, "{} at {worst:?}", case.name);
                }
            }
        }
    }

    #[test]
    fn a_cheap_node_is_tried_whole_and_a_dear_one_that_cannot_be_cut_is_not_tried() {
        let sum = case("ReduceSum", vec![numbers("x", &[8, 9])], vec![]);
        assert_eq!(excerpts(&sum, None).len(), 1, "cheap");
        assert_eq!(cut_to(&sum, None, 10.0)[0].case, sum, "not to be cut, but not dear");
    }
}

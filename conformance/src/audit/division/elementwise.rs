//! Nodes that compute each element from the elements at its place, with ONNX's broadcasting.

use std::ops::Range;

use super::{Asked, Division, Piece, Region, Source};

const OPERATORS: [&str; 73] = [
    "Abs",
    "Acos",
    "Acosh",
    "Add",
    "And",
    "Asin",
    "Asinh",
    "Atan",
    "Atanh",
    "BitShift",
    "BitwiseAnd",
    "BitwiseNot",
    "BitwiseOr",
    "BitwiseXor",
    "Cast",
    "CastLike",
    "Ceil",
    "Celu",
    "Clip",
    "Cos",
    "Cosh",
    "Div",
    "Elu",
    "Equal",
    "Erf",
    "Exp",
    "Floor",
    "Gelu",
    "Greater",
    "GreaterOrEqual",
    "HardSigmoid",
    "HardSwish",
    "IsInf",
    "IsNaN",
    "LeakyRelu",
    "Less",
    "LessOrEqual",
    "Log",
    "Max",
    "Mean",
    "Min",
    "Mish",
    "Mod",
    "Mul",
    "Neg",
    "Not",
    "Or",
    "PRelu",
    "Pow",
    "Reciprocal",
    "Relu",
    "Round",
    "Selu",
    "Shrink",
    "Sigmoid",
    "Sign",
    "Sin",
    "Sinh",
    "Softplus",
    "Softsign",
    "Sqrt",
    "Sub",
    "Sum",
    "Swish",
    "Tan",
    "Tanh",
    "ThresholdedRelu",
    "Where",
    "Xor",
    "QuantizeLinear",
    "DequantizeLinear",
    "Dropout",
    "Identity",
];

/// The part of an operand that meets a box of the output: axes of length one are repeated, axes that are missing lead.
pub(super) fn broadcast(region: &Region, shape: &[usize]) -> Option<Region> {
    let lead = region.0.len().checked_sub(shape.len())?;
    let side = |(range, &side): (&Range<usize>, &usize)| if side == 1 { 0..1 } else { range.clone() };
    Some(Region(region.0[lead..].iter().zip(shape).map(side).collect()))
}

pub(super) fn divide(asked: Asked<'_>) -> Option<Division<'_>> {
    if !OPERATORS.contains(&asked.operator()) {
        return None;
    }
    let quantises = matches!(asked.operator(), "QuantizeLinear" | "DequantizeLinear");
    // A scale per channel lies along `axis`, not along the last one.
    let per_axis = quantises && asked.shape(1).is_some_and(|scale| scale.iter().product::<usize>() > 1);
    let along = if per_axis {
        let x = asked.shape(0)?;
        let axis = asked.axis(asked.int("axis", 1), x.len())?;
        // Scales per block are not cut.
        if asked.shape(1)? != [x[axis]] {
            return None;
        }
        Some(axis)
    } else {
        None
    };
    let operands = asked.view.operands.len();
    let shapes: Vec<&[usize]> = if quantises || matches!(asked.operator(), "Dropout" | "CastLike") {
        vec![asked.shape(0)?]
    } else {
        (0..operands).filter_map(|i| asked.shape(i)).collect()
    };
    let shape = common(&shapes)?;
    let cut = move |region: &Region| {
        let mut sources = asked.operands();
        for (i, source) in sources.iter_mut().enumerate() {
            let Some(own) = asked.shape(i) else { continue };
            *source = Source::Part(match along {
                Some(axis) if i > 0 && own.len() == 1 => Region(vec![region.0[axis].clone()]),
                _ if i > 0 && (quantises || matches!(asked.operator(), "Dropout" | "CastLike")) => {
                    Region::whole(own)
                }
                _ => broadcast(region, own)?,
            });
        }
        Some(Piece { node: asked.node(), operands: sources })
    };
    let rank = shape.len();
    Some(Division {
        shape,
        axes: vec![true; rank],
        cost: 8.0,
        run: rank.checked_sub(1),
        block: None,
        cut: Box::new(cut),
    })
}

/// The shape that all have in common; `None` where they do not fit.
pub(super) fn common(shapes: &[&[usize]]) -> Option<Vec<usize>> {
    let rank = shapes.iter().map(|shape| shape.len()).max()?;
    let mut common = vec![1; rank];
    for shape in shapes {
        for (side, &own) in common.iter_mut().rev().zip(shape.iter().rev()) {
            match (*side, own) {
                (1, own) => *side = own,
                (side, own) if own == 1 || own == side => {}
                _ => return None,
            }
        }
    }
    Some(common)
}

//! Nodes that move elements: each output element is one of an operand's, or a shape is read.

use super::elementwise::broadcast;
use super::{Asked, Division, Piece, Region, Source, list};
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

pub(super) fn divide(asked: Asked<'_>) -> Option<Division<'_>> {
    let x = asked.shape(0)?;
    let rank = x.len();
    match asked.operator() {
        "Transpose" => {
            let axes = asked.ints("perm").map_or_else(|| (0..rank as i64).rev().collect(), <[i64]>::to_vec);
            let axes: Vec<usize> = axes.into_iter().map(|a| asked.axis(a, rank)).collect::<Option<_>>()?;
            let mut sorted = axes.clone();
            sorted.sort_unstable();
            if !sorted.into_iter().eq(0..rank) {
                return None;
            }
            let shape = axes.iter().map(|&axis| x[axis]).collect();
            let cut = move |region: &Region| {
                let mut own = Region::whole(x);
                axes.iter().zip(&region.0).for_each(|(&axis, range)| own.0[axis] = range.clone());
                Some(Piece { node: asked.node(), operands: vec![Source::Part(own)] })
            };
            Some(moved(shape, cut))
        }
        "Concat" => concat(asked),
        "Split" => split(asked, x),
        "Slice" => slice(asked, x),
        "Expand" => {
            let lengths = asked.integers(1)?;
            let lengths: Vec<usize> =
                lengths.iter().map(|&side| usize::try_from(side).ok()).collect::<Option<_>>()?;
            let shape = super::elementwise::common(&[x, &lengths])?;
            let cut = move |region: &Region| {
                let lengths = region.shape().into_iter().map(|side| side as i64).collect();
                let operands = vec![Source::Part(broadcast(region, x)?), Source::Made(list(lengths))];
                Some(Piece { node: asked.node(), operands })
            };
            Some(moved(shape, cut))
        }
        "Pad" => pad(asked, x),
        // Only the shape is read.
        "Shape" | "Size" => {
            let found = asked.view.found.get(asked.output).copied().flatten()?;
            let cut = move |_: &Region| {
                let places = TypedTensor {
                    shape: x.to_vec(),
                    elements: Elements::Bool(vec![false; x.iter().product()]),
                };
                Some(Piece { node: asked.node(), operands: vec![Source::Made(places)] })
            };
            let shape = found.shape.clone();
            let axes = vec![false; shape.len()];
            Some(Division { shape, axes, cost: 1.0, run: None, block: None, cut: Box::new(cut) })
        }
        _ => None,
    }
}

fn moved<'a>(shape: Vec<usize>, cut: impl Fn(&Region) -> Option<Piece> + Sync + 'a) -> Division<'a> {
    let rank = shape.len();
    Division {
        shape,
        axes: vec![true; rank],
        cost: 1.0,
        run: rank.checked_sub(1),
        block: None,
        cut: Box::new(cut),
    }
}

/// A part of the first operand as it is.
fn same(asked: Asked, own: Region) -> Piece {
    let node = NodeProto {
        op_type: Some("Identity".to_owned()),
        input: asked.view.node.input[..1].to_vec(),
        attribute: Vec::new(),
        ..asked.node()
    };
    Piece { node, operands: vec![Source::Part(own)] }
}

fn concat(asked: Asked<'_>) -> Option<Division<'_>> {
    let shapes: Vec<&[usize]> =
        (0..asked.view.operands.len()).map(|i| asked.shape(i)).collect::<Option<_>>()?;
    let rank = shapes.first()?.len();
    let axis = asked.axis(asked.int("axis", 1), rank)?;
    let alike =
        |shape: &&[usize]| shape.len() == rank && (0..rank).all(|a| a == axis || shape[a] == shapes[0][a]);
    if !shapes.iter().all(alike) {
        return None;
    }
    let mut shape = shapes[0].to_vec();
    shape[axis] = shapes.iter().map(|shape| shape[axis]).sum();
    let cut = move |region: &Region| {
        let mut first = 0;
        let mut operands = Vec::with_capacity(shapes.len());
        for shape in &shapes {
            let length = shape[axis];
            let range = &region.0[axis];
            let (start, end) = (range.start.max(first), range.end.min(first + length).max(first));
            let mut own = region.clone();
            own.0[axis] = start.min(end) - first..end - first;
            operands.push(Source::Part(own));
            first += length;
        }
        Some(Piece { node: asked.node(), operands })
    };
    Some(moved(shape, cut))
}

/// A box of an output of Split is a box of the operand, shifted by the outputs before it.
fn split<'a>(asked: Asked<'a>, x: &'a [usize]) -> Option<Division<'a>> {
    let axis = asked.axis(asked.int("axis", 0), x.len())?;
    let count = asked.view.node.output.len();
    let lengths: Vec<usize> = match asked.ints("split").map(<[i64]>::to_vec).or_else(|| asked.integers(1)) {
        Some(lengths) => lengths.into_iter().map(|n| usize::try_from(n).ok()).collect::<Option<_>>()?,
        None => {
            let part = x[axis].div_ceil(count.max(1));
            (0..count).map(|k| part.min(x[axis].saturating_sub(k * part))).collect()
        }
    };
    if lengths.len() != count || lengths.iter().sum::<usize>() != x[axis] {
        return None;
    }
    let mut shape = x.to_vec();
    shape[axis] = lengths[asked.output];
    let first: usize = lengths[..asked.output].iter().sum();
    let cut = move |region: &Region| {
        let mut own = region.clone();
        own.0[axis] = region.0[axis].start + first..region.0[axis].end + first;
        Some(same(asked, own))
    };
    Some(moved(shape, cut))
}

/// Slices of step one; others are judged whole.
fn slice<'a>(asked: Asked<'a>, x: &'a [usize]) -> Option<Division<'a>> {
    let rank = x.len();
    let given = |name: &str, operand: usize| {
        asked.ints(name).map(<[i64]>::to_vec).or_else(|| asked.integers(operand))
    };
    let (starts, ends) = (given("starts", 1)?, given("ends", 2)?);
    let axes = given("axes", 3).unwrap_or_else(|| (0..starts.len() as i64).collect());
    if starts.len() != ends.len() || starts.len() != axes.len() {
        return None;
    }
    if asked.shape(4).is_some() && asked.integers(4)?.iter().any(|&step| step != 1) {
        return None;
    }
    let mut window = Region::whole(x);
    for ((&start, &end), &axis) in starts.iter().zip(&ends).zip(&axes) {
        let axis = asked.axis(axis, rank)?;
        let side = x[axis] as i64;
        let place = |p: i64| (if p < 0 { p.saturating_add(side) } else { p }).clamp(0, side) as usize;
        window.0[axis] = place(start)..place(end).max(place(start));
    }
    let shape = window.shape();
    let cut = move |region: &Region| {
        let own = region
            .0
            .iter()
            .zip(&window.0)
            .map(|(range, window)| range.start + window.start..range.end + window.start);
        Some(same(asked, Region(own.collect())))
    };
    Some(moved(shape, cut))
}

/// Paddings that leave samples and channels alone are cut along these.
fn pad<'a>(asked: Asked<'a>, x: &'a [usize]) -> Option<Division<'a>> {
    let rank = x.len();
    let pads = asked.ints("pads").map(<[i64]>::to_vec).or_else(|| asked.integers(1))?;
    if rank < 3 || pads.len() != 2 * rank || asked.shape(3).is_some() {
        return None;
    }
    if [0, 1].iter().any(|&axis| pads[axis] != 0 || pads[rank + axis] != 0) {
        return None;
    }
    let side = |axis: usize| usize::try_from(x[axis] as i64 + pads[axis] + pads[rank + axis]).ok();
    let shape: Vec<usize> = (0..rank).map(side).collect::<Option<_>>()?;
    let cut = move |region: &Region| {
        let mut operands = asked.operands();
        let image = x[2..].iter().map(|&side| 0..side);
        operands[0] = Source::Part(Region(region.0[..2].iter().cloned().chain(image).collect()));
        Some(Piece { node: asked.node(), operands })
    };
    let axes = (0..rank).map(|axis| axis < 2).collect();
    Some(Division { shape, axes, cost: 2.0, run: None, block: None, cut: Box::new(cut) })
}

//! Nodes that work along some axes and treat all places of the others alike: normalisations, reductions, resampling.

use super::{Asked, Division, Piece, Region, Source, list};

pub(super) fn divide(asked: Asked<'_>) -> Option<Division<'_>> {
    let x = asked.shape(0)?;
    let rank = x.len();
    let alike = |kept: Vec<bool>, cost: f64| Some(along(asked, x.to_vec(), kept, cost));
    match asked.operator() {
        "BatchNormalization" if asked.int("training_mode", 0) == 0 => {
            let run = rank.checked_sub(1);
            Some(Division { run, ..along(asked, x.to_vec(), vec![true; rank], 16.0) })
        }
        "InstanceNormalization" => alike((0..rank).map(|axis| axis < 2).collect(), 24.0),
        "GroupNormalization" => alike((0..rank).map(|axis| axis < 1).collect(), 24.0),
        "LayerNormalization" | "RMSNormalization" => {
            let first = asked.axis(asked.int("axis", -1), rank)?;
            alike((0..rank).map(|axis| axis < first).collect(), 24.0)
        }
        "Softmax" | "LogSoftmax" | "Hardmax" => {
            let old = asked.view.opset < 13;
            let over = asked.axis(asked.int("axis", if old { 1 } else { -1 }), rank)?;
            alike((0..rank).map(|axis| if old { axis < over } else { axis != over }).collect(), 24.0)
        }
        "LpNormalization" => {
            let over = asked.axis(asked.int("axis", -1), rank)?;
            alike((0..rank).map(|axis| axis != over).collect(), 16.0)
        }
        "CumSum" => {
            let over = asked.axis(*asked.integers(1)?.first()?, rank)?;
            alike((0..rank).map(|axis| axis != over).collect(), 8.0)
        }
        "MaxPool" | "AveragePool" | "LpPool" | "Resize" | "Upsample" => per_channel(asked, x),
        "GlobalAveragePool" | "GlobalMaxPool" | "GlobalLpPool" => {
            let reduced: usize = x.get(2..)?.iter().product();
            let shape = x.iter().enumerate().map(|(axis, &side)| if axis < 2 { side } else { 1 }).collect();
            Some(reduced_to(
                asked,
                shape,
                (0..rank).map(|axis| (axis < 2).then_some(axis)).collect(),
                reduced,
            ))
        }
        "GridSample" => grid_sample(asked, x),
        operator if operator.starts_with("Reduce") || matches!(operator, "ArgMax" | "ArgMin") => {
            reduction(asked, x)
        }
        _ => None,
    }
}

/// A node whose output has the shape of its first operand, cut along the axes that are kept. Operands with one number per
/// channel are cut with the channels, all others stay whole.
fn along<'a>(asked: Asked<'a>, shape: Vec<usize>, kept: Vec<bool>, cost: f64) -> Division<'a> {
    let channels_cut = kept.get(1).copied().unwrap_or(false)
        && matches!(asked.operator(), "BatchNormalization" | "InstanceNormalization");
    let cut = move |region: &Region| {
        let mut operands = asked.operands();
        operands[0] = Source::Part(region.clone());
        if channels_cut {
            for source in operands[1..].iter_mut().filter(|source| **source == Source::Whole) {
                *source = Source::Part(Region(vec![region.0[1].clone()]));
            }
        }
        Some(Piece { node: asked.node(), operands })
    };
    Division { shape, axes: kept, cost, run: None, block: None, cut: Box::new(cut) }
}

/// A node that does the same with every channel's image: its output has as many channels, of a shape that was found.
fn per_channel<'a>(asked: Asked<'a>, x: &'a [usize]) -> Option<Division<'a>> {
    // The image's new size is the operator's to say; what was found is checked when a piece is evaluated.
    let found = asked.view.found.get(asked.output).copied().flatten()?;
    let rank = x.len();
    let resizes = matches!(asked.operator(), "Resize" | "Upsample");
    if rank < 3 || found.shape.len() != rank || found.shape[..2] != x[..2] {
        return None;
    }
    let sizes = asked.integers(3).filter(|_| resizes);
    if sizes.as_ref().is_some_and(|sizes| sizes.len() != rank && asked.ints("axes").is_none()) {
        return None;
    }
    if asked.ints("axes").is_some_and(|axes| axes.iter().any(|&a| asked.axis(a, rank).is_none_or(|a| a < 2)))
    {
        return None;
    }
    let cut = move |region: &Region| {
        let mut operands = asked.operands();
        let image = x[2..].iter().map(|&side| 0..side);
        operands[0] = Source::Part(Region(region.0[..2].iter().cloned().chain(image).collect()));
        if let Some(sizes) = sizes.as_ref().filter(|sizes| sizes.len() == rank) {
            let own = region.0[..2].iter().map(|range| range.len() as i64);
            operands[3] = Source::Made(list(own.chain(sizes[2..].iter().copied()).collect()));
        }
        Some(Piece { node: asked.node(), operands })
    };
    let taps: f64 = match asked.ints("kernel_shape") {
        Some(kernel) => kernel.iter().map(|&k| k as f64).product(),
        None => 32.0,
    };
    let axes = (0..rank).map(|axis| axis < 2).collect();
    Some(Division {
        shape: found.shape.clone(),
        axes,
        cost: taps.max(8.0),
        run: None,
        block: None,
        cut: Box::new(cut),
    })
}

/// A node that makes one number of many: `from` has the axis of the operand that each axis of the output is, or none.
fn reduced_to<'a>(
    asked: Asked<'a>,
    shape: Vec<usize>,
    from: Vec<Option<usize>>,
    reduced: usize,
) -> Division<'a> {
    let axes = from.iter().map(Option::is_some).collect();
    let run = from.iter().rposition(Option::is_some);
    let cut = move |region: &Region| {
        let mut operands = asked.operands();
        let mut own = Region::whole(asked.shape(0)?);
        for (range, axis) in region.0.iter().zip(&from) {
            if let Some(axis) = axis {
                own.0[*axis] = range.clone();
            }
        }
        operands[0] = Source::Part(own);
        Some(Piece { node: asked.node(), operands })
    };
    Division { shape, axes, cost: 8.0 + reduced as f64, run, block: None, cut: Box::new(cut) }
}

fn reduction<'a>(asked: Asked<'a>, x: &'a [usize]) -> Option<Division<'a>> {
    let rank = x.len();
    let over: Vec<i64> = if matches!(asked.operator(), "ArgMax" | "ArgMin") {
        vec![asked.int("axis", 0)]
    } else {
        match asked.ints("axes") {
            Some(axes) => axes.to_vec(),
            None => asked.integers(1).unwrap_or_default(),
        }
    };
    if over.is_empty() && asked.int("noop_with_empty_axes", 0) == 1 {
        return None;
    }
    let over: Vec<usize> = over.into_iter().map(|axis| asked.axis(axis, rank)).collect::<Option<_>>()?;
    let is_over = |axis: usize| over.is_empty() || over.contains(&axis);
    let keeps = asked.int("keepdims", 1) == 1;
    let kept = (0..rank).filter(|&axis| keeps || !is_over(axis));
    let from: Vec<Option<usize>> = kept.map(|axis| (!is_over(axis)).then_some(axis)).collect();
    let shape = from.iter().map(|axis| axis.map_or(1, |axis| x[axis])).collect();
    let reduced = (0..rank).filter(|&axis| is_over(axis)).map(|axis| x[axis]).product();
    Some(reduced_to(asked, shape, from, reduced))
}

/// x \[N,C,…\], grid \[N,points…,axes\] → \[N,C,points…\]: any point may look anywhere, so images stay whole.
fn grid_sample<'a>(asked: Asked<'a>, x: &'a [usize]) -> Option<Division<'a>> {
    let grid = asked.shape(1)?;
    if x.len() < 3 || grid.len() != x.len() {
        return None;
    }
    let shape: Vec<usize> = x[..2].iter().chain(&grid[1..grid.len() - 1]).copied().collect();
    let cut = move |region: &Region| {
        let mut operands = asked.operands();
        let image = x[2..].iter().map(|&side| 0..side);
        operands[0] = Source::Part(Region(region.0[..2].iter().cloned().chain(image).collect()));
        let points = region.0[2..].iter().cloned();
        let coordinates = 0..grid[grid.len() - 1];
        let grid = std::iter::once(region.0[0].clone()).chain(points).chain([coordinates]).collect();
        operands[1] = Source::Part(Region(grid));
        Some(Piece { node: asked.node(), operands })
    };
    let rank = shape.len();
    Some(Division {
        shape,
        axes: vec![true; rank],
        cost: 64.0,
        run: Some(rank - 1),
        block: None,
        cut: Box::new(cut),
    })
}

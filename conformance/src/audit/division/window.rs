//! Convolutions: a box of the output sees a box of the input, with what is left of the padding.

use std::ops::Range;

use super::{Asked, Division, Piece, Region, Source, set_int, set_ints};

/// One spatial axis.
#[derive(Clone, Copy)]
struct Axis {
    input: usize,
    kernel: usize,
    stride: usize,
    dilation: usize,
    before: usize,
    after: usize,
}

impl Axis {
    /// Pixels that the kernel spans.
    fn extent(&self) -> usize {
        (self.kernel - 1) * self.dilation + 1
    }
}

pub(super) fn divide(asked: Asked<'_>) -> Option<Division<'_>> {
    match asked.operator() {
        "Conv" => convolution(asked),
        "ConvTranspose" => transposed(asked),
        _ => None,
    }
}

/// The axes of a convolution whose paddings are written out.
fn axes(asked: Asked) -> Option<Vec<Axis>> {
    let (x, w) = (asked.shape(0)?, asked.shape(1)?);
    if x.len() != w.len() || x.len() < 3 || w[2..].contains(&0) {
        return None;
    }
    if !matches!(asked.text("auto_pad"), None | Some(b"NOTSET" | b"")) {
        return None;
    }
    let rank = x.len() - 2;
    let list = |name: &str, length: usize, default: i64| -> Option<Vec<usize>> {
        let all = asked.ints(name).map_or(vec![default; length], <[i64]>::to_vec);
        let all: Vec<usize> = all.into_iter().map(|v| usize::try_from(v).ok()).collect::<Option<_>>()?;
        (all.len() == length).then_some(all)
    };
    let (strides, dilations) = (list("strides", rank, 1)?, list("dilations", rank, 1)?);
    let pads = list("pads", 2 * rank, 0)?;
    if strides.contains(&0) || dilations.contains(&0) {
        return None;
    }
    let axis = |axis: usize| Axis {
        input: x[2 + axis],
        kernel: w[2 + axis],
        stride: strides[axis],
        dilation: dilations[axis],
        before: pads[axis],
        after: pads[rank + axis],
    };
    Some((0..rank).map(axis).collect())
}

/// The group that a range of output channels belongs to; `None` where they belong to several.
fn group_of(channels: &Range<usize>, outputs: usize) -> Option<usize> {
    let (first, last) = (channels.start / outputs, (channels.end.max(1) - 1) / outputs);
    (first == last).then_some(first)
}

/// x \[N,C,…\] * w \[O,C/groups,…\] → \[N,O,…\].
fn convolution(asked: Asked<'_>) -> Option<Division<'_>> {
    let axes = axes(asked)?;
    let (x, w) = (asked.shape(0)?, asked.shape(1)?);
    let groups = usize::try_from(asked.int("group", 1)).ok().filter(|&g| g > 0 && w[0].is_multiple_of(g))?;
    if w[1] * groups != x[1] || w[0] == 0 {
        return None;
    }
    let outputs = w[0] / groups;
    let mut shape = vec![x[0], w[0]];
    for axis in &axes {
        shape.push((axis.input + axis.before + axis.after).checked_sub(axis.extent())? / axis.stride + 1);
    }
    let cost = 8.0 + w[1..].iter().product::<usize>() as f64;
    let rank = shape.len();
    let cut = move |region: &Region| {
        let group = group_of(&region.0[1], outputs)?;
        let mut part = vec![region.0[0].clone(), group * w[1]..(group + 1) * w[1]];
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for (axis, range) in axes.iter().zip(&region.0[2..]) {
            // Places of the padded image that the box sees.
            let (start, end) =
                (range.start * axis.stride, (range.end.max(1) - 1) * axis.stride + axis.extent());
            let first = start.saturating_sub(axis.before).min(axis.input);
            let last = end.saturating_sub(axis.before).clamp(first, axis.input);
            let lacking = axis.before.saturating_sub(start).min(end - start);
            before.push(lacking as i64);
            after.push((end - start - lacking - (last - first)) as i64);
            part.push(first..last);
        }
        let mut operands = asked.operands();
        operands[0] = Source::Part(Region(part));
        let kernel = w[1..].iter().map(|&side| 0..side);
        operands[1] = Source::Part(Region(std::iter::once(region.0[1].clone()).chain(kernel).collect()));
        if asked.shape(2).is_some() {
            operands[2] = Source::Part(Region(vec![region.0[1].clone()]));
        }
        let mut node = asked.node();
        before.append(&mut after);
        set_ints(&mut node, "pads", before);
        set_int(&mut node, "group", 1);
        Some(Piece { node, operands })
    };
    Some(Division {
        shape,
        axes: vec![true; rank],
        cost,
        run: Some(1),
        block: Some(outputs),
        cut: Box::new(cut),
    })
}

/// x \[N,C,…\] * w \[C,O/groups,…\] → \[N,O,…\]: output o meets input i and tap k where o = i·stride + k·dilation − padding.
fn transposed(asked: Asked<'_>) -> Option<Division<'_>> {
    let axes = axes(asked)?;
    let (x, w) = (asked.shape(0)?, asked.shape(1)?);
    let groups = usize::try_from(asked.int("group", 1)).ok().filter(|&g| g > 0 && x[1].is_multiple_of(g))?;
    if w[0] != x[1] || w[1] == 0 || asked.ints("output_shape").is_some() || x[2..].contains(&0) {
        return None;
    }
    let outputs = w[1];
    let extra = asked.ints("output_padding").unwrap_or_default();
    let mut shape = vec![x[0], outputs * groups];
    for (k, axis) in axes.iter().enumerate() {
        let extra = extra.get(k).map_or(0, |&extra| extra.max(0) as usize);
        let full = (axis.input - 1) * axis.stride + axis.extent() + extra;
        shape.push(full.checked_sub(axis.before + axis.after)?);
    }
    // Each output is computed from about 1/stride of the taps along each axis.
    let taps: f64 = axes.iter().map(|axis| (axis.kernel as f64 / axis.stride as f64).max(1.0)).product();
    let cost = 8.0 + x[1] as f64 / groups as f64 * taps;
    let rank = shape.len();
    let inputs = x[1] / groups;
    let cut = move |region: &Region| {
        let channels = &region.0[1];
        let group = group_of(channels, outputs)?;
        let from = group * inputs..(group + 1) * inputs;
        let mut part = vec![region.0[0].clone(), from.clone()];
        let (mut before, mut after, mut extra) = (Vec::new(), Vec::new(), Vec::new());
        for (axis, range) in axes.iter().zip(&region.0[2..]) {
            // Places of the output before its padding is cut away.
            let (start, end) = (range.start + axis.before, range.end.max(1) - 1 + axis.before);
            let last = (end / axis.stride).min(axis.input - 1);
            let first = start.saturating_sub(axis.extent() - 1).div_ceil(axis.stride).min(last);
            let made = (last - first) * axis.stride + axis.extent();
            let skipped = start - first * axis.stride;
            let wanted = skipped + range.len();
            before.push(skipped as i64);
            after.push(made.saturating_sub(wanted) as i64);
            extra.push(wanted.saturating_sub(made) as i64);
            part.push(first..last + 1);
        }
        let mut operands = asked.operands();
        operands[0] = Source::Part(Region(part));
        let own = channels.start - group * outputs..channels.end - group * outputs;
        let kernel = w[2..].iter().map(|&side| 0..side);
        operands[1] = Source::Part(Region([from, own].into_iter().chain(kernel).collect()));
        if asked.shape(2).is_some() {
            operands[2] = Source::Part(Region(vec![channels.clone()]));
        }
        let mut node = asked.node();
        before.append(&mut after);
        set_ints(&mut node, "pads", before);
        set_ints(&mut node, "output_padding", extra);
        set_int(&mut node, "group", 1);
        Some(Piece { node, operands })
    };
    Some(Division {
        shape,
        axes: vec![true; rank],
        cost,
        run: Some(1),
        block: Some(outputs),
        cut: Box::new(cut),
    })
}

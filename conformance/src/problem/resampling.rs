//! Resize, and what moves pixels beside it: Pad and DepthToSpace.
//!
//! Nearest pixels are drawn with scales that are powers of two alone, where no coordinate rounds and so no tie is undecided; all
//! else with any scale. ONNX Runtime has the cubic mode in 2-D only, and leaves out what lies outside only there or where it stretches the
//! kernel. With antialiasing lengths are asked for, because it leaves an axis alone whose length stays, whatever its
//! scale; of symmetric half pixels to the nearest only such that stay whole, because there alone the centre is exact. With
//! `align_corners` lengths are asked for as well, because it reads scales that give no whole length as the text has it and not
//! as the tests do.

use proptest::prelude::*;
use vitruvian_reference::nn::Tensor;

use super::values::Values;
use super::{Operand, Problem};
use crate::array::Array;
use crate::onnx::builder::{int, ints, text};

/// Samples and channels, which stay as they are, then an axis each.
fn lengths(spatial: &[usize]) -> Vec<usize> {
    [&[1, 2], spatial].concat()
}

/// x \[1,2,…\] by another scale or to another size along each spatial axis.
pub fn resize(spatial: usize, mode: &'static str) -> impl Strategy<Value = Problem> {
    let axis = (
        1..=9_usize,
        1..=14_usize,
        prop::sample::select(vec![0.35_f32, 0.6, 0.75, 1.3, 2.4, 3.0]),
        -1..=2_i32,
    );
    let axes = prop::collection::vec(axis, spatial);
    let transformations =
        vec!["half_pixel", "pytorch_half_pixel", "asymmetric", "half_pixel_symmetric", "align_corners"];
    let nearest_modes = vec!["round_prefer_floor", "round_prefer_ceil", "floor", "ceil"];
    let names = (prop::sample::select(transformations), prop::sample::select(nearest_modes));
    (axes, names, any::<[bool; 3]>(), any::<Values>()).prop_map(
        move |(axes, (transformation, nearest_mode), [antialias, exclude_outside, scaled], x)| {
            let transformation = if mode == "nearest" && transformation == "align_corners" {
                "half_pixel"
            } else {
                transformation
            };
            let antialias = antialias && mode != "nearest" && spatial == 2;
            let length = |axis: &(usize, usize, f32, i32)| match (mode, transformation) {
                ("nearest", "half_pixel_symmetric") => axis.0.div_ceil(2) * 2,
                ("nearest", _) => axis.0.max(2),
                _ => axis.0,
            };
            let before: Vec<usize> = axes.iter().map(length).collect();
            let scaled = (scaled && !antialias && transformation != "align_corners") || mode == "nearest";
            // A scale leaves at least one pixel and changes the length: ONNX Runtime copies an image whose lengths stay.
            let scale = |(&n, axis): (&usize, &(usize, usize, f32, i32))| {
                let scale = if mode == "nearest" { 2_f32.powi(axis.3) } else { axis.2 };
                if [0, n].contains(&((n as f32 * scale) as usize)) { 2.0 } else { scale }
            };
            let mut attributes =
                vec![text("mode", mode), text("coordinate_transformation_mode", transformation)];
            match mode {
                "nearest" => attributes.push(text("nearest_mode", nearest_mode)),
                _ => attributes.push(int("antialias", antialias.into())),
            }
            if mode == "cubic" || antialias {
                attributes.push(int("exclude_outside", exclude_outside.into()));
            }
            let empty = || Operand::Weight(Array::new(&[0], vec![]));
            let mut operands = vec![Operand::Input(x.fill(&lengths(&before))), empty()];
            if scaled {
                let scales: Vec<f32> =
                    [1.0, 1.0].into_iter().chain(before.iter().zip(&axes).map(scale)).collect();
                operands.push(Operand::Weight(Array::new(&[scales.len()], scales)));
            } else {
                let sizes: Vec<usize> = axes.iter().map(|axis| axis.1).collect();
                let sizes: Vec<i64> = lengths(&sizes).into_iter().map(|n| n as i64).collect();
                operands.extend([empty(), Operand::Integers(Tensor::new(&[sizes.len()], sizes))]);
            }
            Problem { operator: "Resize", attributes, operands }
        },
    )
}

/// A tensor with borders added, and of constants also cut.
pub fn pad() -> impl Strategy<Value = Problem> {
    let sides = prop::collection::vec((2..=6_usize, any::<[i64; 2]>()), 1..=4);
    let mode = prop::sample::select(vec!["constant", "reflect", "edge", "wrap"]);
    (sides, mode, any::<Values>()).prop_map(|(sides, mode, x)| {
        // No more than the axis has, so that one reflection is enough.
        let amount = |n: usize, seed: i64| {
            if mode == "constant" { seed.rem_euclid(5) - 1 } else { seed.rem_euclid(n as i64) }
        };
        let shape: Vec<usize> = sides.iter().map(|side| side.0).collect();
        let [before, after] = [0, 1].map(|k| sides.iter().map(move |side| amount(side.0, side.1[k])));
        let pads: Vec<i64> = before.chain(after).collect();
        let operands =
            vec![Operand::Input(x.fill(&shape)), Operand::Integers(Tensor::new(&[pads.len()], pads))];
        Problem { operator: "Pad", attributes: vec![text("mode", mode)], operands }
    })
}

/// Channels that become blocks of pixels.
pub fn depth_to_space() -> impl Strategy<Value = Problem> {
    let sizes = (1..=3_usize, 1..=4_usize, 1..=4_usize, 1..=3_usize);
    (sizes, any::<bool>(), any::<Values>()).prop_map(|((channels, height, width, side), crd, x)| Problem {
        operator: "DepthToSpace",
        attributes: vec![int("blocksize", side as i64), text("mode", if crd { "CRD" } else { "DCR" })],
        operands: vec![Operand::Input(x.fill(&[1, channels * side * side, height, width]))],
    })
}

/// Channels that divide each other.
pub fn local_response() -> impl Strategy<Value = Problem> {
    (1..=9_usize, 0..=3_usize, any::<Values>()).prop_map(|(channels, reach, x)| Problem {
        operator: "LRN",
        attributes: vec![int("size", 2 * reach as i64 + 1)],
        operands: vec![Operand::Input(x.fill(&[2, channels, 3, 4]))],
    })
}

/// A convolution whose padding is named and not given.
pub fn same_convolution() -> impl Strategy<Value = Problem> {
    let axis = (1..=12_usize, 1..=4_usize, 1..=3_usize);
    (prop::collection::vec(axis, 2), any::<bool>(), any::<[Values; 2]>()).prop_map(|(axes, upper, [x, w])| {
        let all = |of: fn(&(usize, usize, usize)) -> usize| axes.iter().map(of).collect::<Vec<_>>();
        Problem {
            operator: "Conv",
            attributes: vec![
                text("auto_pad", if upper { "SAME_UPPER" } else { "SAME_LOWER" }),
                ints("strides", &all(|axis| axis.2)),
            ],
            operands: vec![
                Operand::Input(x.fill(&lengths(&all(|axis| axis.0)))),
                Operand::Weight(w.fill(&[vec![3, 2], all(|axis| axis.1)].concat())),
            ],
        }
    })
}

//! GridSample in two and three dimensions: all modes and paddings, both readings of the corners.

use proptest::prelude::*;

use super::values::Values;
use super::{Operand, Problem};
use crate::array::Array;
use crate::onnx::builder::{int, text};

fn problem(mode: &str, image: Array, grid: Array, padding: &str, align_corners: bool) -> Problem {
    Problem {
        operator: "GridSample",
        attributes: vec![
            text("mode", mode),
            text("padding_mode", padding),
            int("align_corners", align_corners.into()),
        ],
        operands: vec![Operand::Input(image), Operand::Input(grid)],
    }
}

/// Image [N,C,…] at a grid [N,…,spatial] of points that lie inside, outside, and (but for nearest pixels, where rounding would decide) exactly
/// on centres and edges.
///
/// ONNX Runtime has no cubic mode in 3-D. In 2-D it moves *both* coordinates of a point to the border where one is beyond it, so that
/// border and cubic do not go together here.
pub fn grid_sample(spatial: usize, mode: &'static str) -> impl Strategy<Value = Problem> {
    let side = if spatial == 2 { 1..=20_usize } else { 1..=9 };
    let sizes = (1..=2_usize, 1..=6_usize, prop::collection::vec(side, spatial), 1..=30_usize);
    let paddings =
        if mode == "cubic" { vec!["zeros", "reflection"] } else { vec!["zeros", "border", "reflection"] };
    let padding = prop::sample::select(paddings);
    let reach = prop::sample::select(vec![0.9_f32, 1.0, 1.5, 3.0]);
    (sizes, any::<Values>(), any::<u64>(), reach, any::<bool>(), padding, any::<bool>()).prop_map(
        move |((samples, channels, sides, points), image, seed, reach, snapped, padding, align_corners)| {
            let image = image.fill(&[vec![samples, channels], sides.clone()].concat());
            let mut outputs = vec![1; spatial];
            outputs[spatial - 1] = points;
            let mut grid = Values::ordinary(seed).fill(&[vec![samples], outputs, vec![spatial]].concat());
            for (i, x) in grid.values.iter_mut().enumerate() {
                *x *= reach;
                if snapped && mode != "nearest" {
                    // Quarter pixels of a cell-centred image of this side: centres, edges and what lies between.
                    let side = sides[spatial - 1 - i % spatial] as f32;
                    *x = (*x * 2.0 * side).round() / (2.0 * side);
                }
            }
            problem(mode, image, grid, padding, align_corners)
        },
    )
}

/// Sampling as in the networks, on ordinary numbers: a cubic image, 64 points of which some lie outside, corners not
/// aligned.
pub fn ordinary_grid_sample(spatial: usize, padding: &'static str) -> impl Strategy<Value = Problem> {
    any::<[u64; 2]>().prop_map(move |seeds| {
        let [image, grid] = seeds.map(Values::ordinary);
        let mut outputs = vec![1; spatial];
        outputs[spatial - 1] = 64;
        let grid = grid.fill(&[vec![1], outputs, vec![spatial]].concat()).map(|x| 1.3 * x);
        problem("linear", image.fill(&[vec![1, 4], vec![8; spatial]].concat()), grid, padding, false)
    })
}

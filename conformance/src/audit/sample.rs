//! Which boxes of an output are judged: all of them, or of a node that would take too long a stated sample.
//!
//! A sample always has every corner of the tensor, so the first and the last of every channel, row and column; a quarter of
//! the places drawn lie at a border, where padding is decided; the rest lie anywhere, drawn with the same chance. What it
//! may have missed follows: a fault in a share p of the places escapes k draws with probability (1 − p)ᵏ.

use std::ops::Range;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::division::Division;
use super::region::Region;

/// Elements of a box of a node that is judged wholly.
const BOX: usize = 1 << 15;

/// Products that a box of it takes at most, where its axes allow.
const BOX_COST: f64 = (1 << 22) as f64;

/// Products that a box takes beside its own, to be cut out and evaluated as a node: so much is drawn together.
const OVERHEAD: f64 = 4096.0;

/// Fewest and most neighbours along a division's run that are drawn together.
const RUN: [usize; 2] = [16, 512];

/// Fewest places that are drawn, whatever they cost.
const FEWEST: usize = 8;

/// Places within this many of an end are the border.
const BORDER: usize = 2;

/// The boxes of an output that are judged.
pub(super) struct Plan {
    /// The boxes, none twice where all are judged.
    pub boxes: Vec<Region>,
    /// How they were drawn, with what they may have missed; `None` where they are all.
    pub sample: Option<String>,
}

impl Plan {
    /// All boxes where they cost no more than `effort`, or else as many as it allows.
    pub fn of(division: &Division, effort: f64, seed: u64) -> Self {
        let count: usize = division.shape.iter().product();
        let cost = division.cost * count as f64;
        let drawn = Draw::of(division);
        let places = (effort / drawn.cost).max(FEWEST as f64) as usize;
        if cost <= effort || places >= drawn.places / 2 {
            return Self { boxes: all(division), sample: None };
        }
        drawn.plan(places, seed)
    }

    /// So many boxes, drawn.
    #[cfg(test)]
    pub fn drawn(division: &Division, places: usize, seed: u64) -> Self {
        Draw::of(division).plan(places, seed)
    }
}

/// Boxes of about equal size that cover the output.
fn all(division: &Division) -> Vec<Region> {
    let mut elements = ((BOX_COST / division.cost) as usize).clamp(64, BOX);
    let mut lengths = vec![1; division.shape.len()];
    for (axis, &side) in division.shape.iter().enumerate().rev() {
        lengths[axis] = if division.axes[axis] { elements.clamp(1, side.max(1)) } else { side.max(1) };
        elements /= lengths[axis];
    }
    let steps = |axis: usize| -> Vec<Range<usize>> {
        let side = division.shape[axis];
        let block = if axis == 1 { division.block.unwrap_or(side) } else { side }.max(1);
        let blocks = (0..side).step_by(block).map(|start| start..(start + block).min(side));
        blocks
            .flat_map(|block| {
                let length = lengths[axis];
                block.clone().step_by(length).map(move |start| start..(start + length).min(block.end))
            })
            .collect()
    };
    let mut boxes = vec![Vec::new()];
    for axis in 0..division.shape.len() {
        let steps = steps(axis);
        boxes = boxes
            .into_iter()
            .flat_map(|region| {
                steps.iter().map(move |step| {
                    let mut region: Vec<Range<usize>> = region.clone();
                    region.push(step.clone());
                    region
                })
            })
            .collect();
    }
    boxes.into_iter().map(Region).collect()
}

/// Drawing boxes of the same size.
struct Draw<'a> {
    shape: &'a [usize],
    /// Length of a box along each axis.
    lengths: Vec<usize>,
    block: Option<usize>,
    /// Places a box can be at, overlapping ones counted.
    places: usize,
    /// What one box costs.
    cost: f64,
}

impl<'a> Draw<'a> {
    fn of(division: &'a Division) -> Self {
        let shape = &division.shape[..];
        let run = ((OVERHEAD / division.cost) as usize).clamp(RUN[0], RUN[1]);
        let length = |(axis, &side): (usize, &usize)| match (division.axes[axis], division.run == Some(axis))
        {
            (false, _) => side,
            (true, true) => side.min(run).min(if axis == 1 { division.block.unwrap_or(side) } else { side }),
            (true, false) => side.min(1),
        };
        let lengths: Vec<usize> = shape.iter().enumerate().map(length).collect();
        let places =
            shape.iter().zip(&lengths).map(|(&side, &length)| side.div_ceil(length.max(1))).product();
        let cost = OVERHEAD + division.cost * lengths.iter().product::<usize>() as f64;
        Self { shape, lengths, block: division.block, places, cost }
    }

    /// The box that begins at these places, moved back where it would reach across a block or the end.
    fn at(&self, starts: &[usize]) -> Region {
        let range = |(axis, &start): (usize, &usize)| {
            let (side, length) = (self.shape[axis], self.lengths[axis]);
            let block = self.block.filter(|_| axis == 1).unwrap_or(side);
            let end = (start / block * block + block).min(side);
            let start = start.min(end - length.min(end));
            start..start + length
        };
        Region(starts.iter().enumerate().map(range).collect())
    }

    fn plan(&self, places: usize, seed: u64) -> Plan {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let free: Vec<usize> = (0..self.shape.len()).filter(|&a| self.shape[a] > self.lengths[a]).collect();
        let mut boxes: Vec<Region> = (0..1_usize << free.len().min(6))
            .map(|corner| {
                let mut starts = vec![0; self.shape.len()];
                for (_, &axis) in free.iter().enumerate().filter(|(bit, _)| corner >> bit & 1 == 1) {
                    starts[axis] = self.shape[axis] - 1;
                }
                self.at(&starts)
            })
            .collect();
        let corners = boxes.len();
        let border = places / 4;
        for place in 0..places {
            let mut starts: Vec<usize> =
                self.shape.iter().map(|&side| random.random_range(0..side.max(1))).collect();
            if place < border && !free.is_empty() {
                let axis = free[random.random_range(0..free.len())];
                let inwards = random.random_range(0..BORDER.min(self.shape[axis]));
                starts[axis] = if random.random_bool(0.5) { inwards } else { self.shape[axis] - 1 - inwards };
            }
            boxes.push(self.at(&starts));
        }
        let anywhere = places - border;
        // (1 − p)ᵏ = 1 %.
        let share = 1.0 - 0.01_f64.powf(1.0 / anywhere as f64);
        let sample = format!(
            "boxes of {:?} at all {corners} corners, {border} places at a border and {anywhere} anywhere of {} (seed {seed}): \
             a fault in a share p of the places escapes with probability (1 − p)^{anywhere}, 1 % for p = {:.2} %",
            self.lengths,
            self.places,
            100.0 * share
        );
        Plan { boxes, sample: Some(sample) }
    }
}

/// How many products each of some nodes may take so that all together take `effort`: those that need less leave the rest to
/// the others.
pub(super) fn share(costs: &[f64], effort: f64) -> f64 {
    let mut sorted = costs.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut left = effort;
    for (i, &cost) in sorted.iter().enumerate() {
        let level = left / (sorted.len() - i) as f64;
        if cost > level {
            return level;
        }
        left -= cost;
    }
    f64::INFINITY
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::case::Case;
    use crate::onnx::message::NodeProto;
    use crate::onnx::typed_tensor::{Elements, TypedTensor};

    fn case(shape: &[usize]) -> Case {
        let x =
            TypedTensor { shape: shape.to_vec(), elements: Elements::F32(vec![0.0; shape.iter().product()]) };
        Case {
            node: NodeProto {
                op_type: Some("Relu".into()),
                input: vec!["x".into()],
                output: vec!["y".into()],
                ..NodeProto::default()
            },
            opset: 20,
            name: "Relu".into(),
            operands: vec![Some(x.clone())],
            found: vec![Some(x)],
        }
    }

    #[test]
    fn a_sample_has_every_corner_and_the_border() {
        let shape = [1, 40, 50, 600];
        let case = case(&shape);
        let view = case.view();
        let division = Division::of(&view, 0).expect("a node that is cut");
        let plan = Plan::of(&division, 2e6, 1);
        let has = |index: [usize; 4]| {
            let holds = |region: &Region| region.0.iter().zip(index).all(|(range, i)| range.contains(&i));
            plan.boxes.iter().any(holds)
        };
        for corner in 0..8 {
            let end = |bit: usize, side: usize| if corner >> bit & 1 == 1 { side - 1 } else { 0 };
            assert!(has([0, end(0, 40), end(1, 50), end(2, 600)]), "corner {corner}");
        }
        assert!(plan.sample.as_ref().is_some_and(|text| text.contains("all 8 corners")), "{:?}", plan.sample);
        let first_row = plan.boxes.iter().filter(|region| region.0[2].start == 0).count();
        assert!(first_row > 4, "{first_row} boxes in the first row, of which 4 are corners");
        let compared: usize = plan.boxes.iter().map(Region::len).sum();
        assert!(compared * 8 < 40 * 50 * 600, "{compared} elements for an effort of two million products");
        assert_eq!(Plan::of(&division, 2e6, 1).boxes, plan.boxes, "the same seed, the same sample");
    }

    #[test]
    fn what_small_nodes_leave_goes_to_the_large_ones() {
        assert_eq!(share(&[1.0, 2.0, 100.0, 100.0], 43.0), 20.0);
        assert_eq!(share(&[1.0, 2.0], 43.0), f64::INFINITY);
    }
}

//! The judge is judged: faults planted in what the runtime computes must be seen.
//!
//! The reference answers the healthy problem and the runtime a faulty one. All problems are ordinary (numbers of size one,
//! sizes as in the networks), because a fault below rounding is no fault: ε = 10⁻³ for 10⁻⁵ beside a variance of 10⁶
//! changes no digit.
//!
//! Of 100 problems each, the bound of a single element sees every fault in every problem, but for the factor of 1.0005 in
//! sums of 3456 products: there it sees 21, and the slope sees all.

use std::cell::RefCell;

use proptest::prelude::*;

use super::operators::Draw;
use crate::array::Array;
use crate::certificate::Slope;
use crate::compare::compare;
use crate::engine::Optimization;
use crate::onnx::builder::{float, int, text};
use crate::problem::{Problem, axis, convolution, elementwise, grid_sample, normalization};

/// A fault to plant.
#[derive(Clone, Copy)]
pub struct Fault {
    /// What is wrong.
    pub name: &'static str,
    /// Draws healthy problems.
    problems: fn() -> BoxedStrategy<Problem>,
    /// Makes a healthy problem faulty.
    plant: fn(Problem) -> Problem,
}

/// In how many problems the fault was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Problems.
    pub cases: usize,
    /// Seen by the bound of a single element.
    pub by_bound: usize,
    /// Seen as a common factor of all differences.
    pub by_slope: usize,
    /// Seen by either.
    pub by_either: usize,
}

impl Fault {
    /// Plants the fault in random problems and counts in how many it is seen.
    ///
    /// # Panics
    /// When ONNX Runtime is missing or refuses a graph.
    pub fn plant(&self, draw: Draw) -> Seen {
        let seen = RefCell::new(Seen::default());
        let outcome = draw.runner(self.name).run(&(self.problems)(), |healthy| {
            let fail = |error: crate::error::Error| TestCaseError::fail(error.to_string());
            let expected = healthy.expected().map_err(fail)?;
            let found = (self.plant)(healthy).runtime(Optimization::Disabled).map_err(fail)?;
            let comparison = compare(&expected, &found);
            let slope = comparison.report().and_then(|report| report.slope);
            let mut seen = seen.borrow_mut();
            seen.cases += 1;
            seen.by_bound += usize::from(!comparison.within_bounds());
            seen.by_slope += usize::from(slope.is_some_and(|slope: Slope| slope.is_systematic()));
            seen.by_either += usize::from(!comparison.agrees());
            Ok(())
        });
        if let Err(error) = outcome {
            panic!("{}: {error}", self.name);
        }
        seen.into_inner()
    }
}

fn scaled(array: &Array) -> Array {
    array.map(|x| x * 1.0005)
}

/// Every fault that must be seen.
pub const FAULTS: &[Fault] = &[
    Fault {
        name: "GroupNormalization with ε 1e-3 for 1e-5",
        problems: || normalization::ordinary_group_norm().boxed(),
        plant: |problem| problem.with_attribute(float("epsilon", 1e-3)),
    },
    Fault {
        name: "BatchNormalization with ε 1e-3 for 1e-5",
        problems: || normalization::ordinary_batch_norm().boxed(),
        plant: |problem| problem.with_attribute(float("epsilon", 1e-3)),
    },
    Fault {
        name: "LayerNormalization with ε 1e-3 for 1e-5",
        problems: || normalization::ordinary_layer_norm().boxed(),
        plant: |problem| problem.with_attribute(float("epsilon", 1e-3)),
    },
    Fault {
        name: "Gelu by tanh for erf",
        problems: || elementwise::ordinary_gelu().boxed(),
        plant: |problem| problem.with_attribute(text("approximate", "tanh")),
    },
    Fault {
        name: "Softmax over the wrong axis",
        problems: || axis::ordinary_softmax().boxed(),
        plant: |problem| problem.with_attribute(int("axis", 1)),
    },
    Fault {
        name: "GridSample 2-D with align_corners flipped",
        problems: || grid_sample::ordinary_grid_sample(2, "zeros").boxed(),
        plant: |problem| problem.with_attribute(int("align_corners", 1)),
    },
    Fault {
        name: "GridSample 3-D with align_corners flipped",
        problems: || grid_sample::ordinary_grid_sample(3, "border").boxed(),
        plant: |problem| problem.with_attribute(int("align_corners", 1)),
    },
    Fault {
        name: "GridSample 2-D with zeros for border",
        problems: || grid_sample::ordinary_grid_sample(2, "border").boxed(),
        plant: |problem| problem.with_attribute(text("padding_mode", "zeros")),
    },
    Fault {
        name: "GridSample 3-D with zeros for border",
        problems: || grid_sample::ordinary_grid_sample(3, "border").boxed(),
        plant: |problem| problem.with_attribute(text("padding_mode", "zeros")),
    },
    Fault {
        name: "GridSample 3-D with z, y, x for x, y, z",
        problems: || grid_sample::ordinary_grid_sample(3, "border").boxed(),
        plant: |problem| problem.with_operand(1, reversed_points),
    },
    Fault {
        name: "Conv 2-D, 72 products, weights × 1.0005",
        problems: || convolution::ordinary_conv(2, 8).boxed(),
        plant: |problem| problem.with_operand(1, scaled),
    },
    Fault {
        name: "Conv 3-D, 864 products, weights × 1.0005",
        problems: || convolution::ordinary_conv(3, 32).boxed(),
        plant: |problem| problem.with_operand(1, scaled),
    },
    Fault {
        name: "Conv 3-D, 3456 products, weights × 1.0005",
        problems: || convolution::ordinary_conv(3, 128).boxed(),
        plant: |problem| problem.with_operand(1, scaled),
    },
    Fault {
        name: "ConvTranspose 2-D, 128 products, weights × 1.0005",
        problems: || convolution::ordinary_conv_transpose().boxed(),
        plant: |problem| problem.with_operand(1, scaled),
    },
    Fault {
        name: "Conv 2-D with the kernel's axes swapped",
        problems: || convolution::ordinary_conv(2, 8).boxed(),
        plant: |problem| problem.with_operand(1, |w| w.swap_axes(2, 3)),
    },
    Fault {
        name: "Conv 3-D with the kernel's z and x swapped",
        problems: || convolution::ordinary_conv(3, 32).boxed(),
        plant: |problem| problem.with_operand(1, |w| w.swap_axes(2, 4)),
    },
    Fault {
        name: "ConvTranspose 2-D with the kernel's axes swapped",
        problems: || convolution::ordinary_conv_transpose().boxed(),
        plant: |problem| problem.with_operand(1, |w| w.swap_axes(2, 3)),
    },
];

/// Every point of a grid [N,…,3] with its coordinates in the opposite order.
fn reversed_points(grid: &Array) -> Array {
    let values = grid.values.chunks_exact(3).flat_map(|point| point.iter().rev()).copied().collect();
    Array::new(&grid.shape, values)
}

//! Problems: one operator, its attributes and its tensors, as a value with two answers.
//!
//! A [`Problem`] is drawn at random ([`Arbitrary`](proptest::arbitrary::Arbitrary)), answered by the reference
//! ([`Problem::reference`], with the bound that comes out of the same text) and by the runtime
//! ([`Problem::runtime`], a graph of one operator through ONNX Runtime), and judged by [`compare`].
//!
//! | file | operators |
//! |---|---|
//! | [`conv`] | Conv in 1-D, 2-D and 3-D |
//! | [`conv_transpose`] | ConvTranspose in 2-D and 3-D |
//! | [`values`] | the numbers |

use std::fmt::Debug;

use vitruvian_reference::nn::{Rounded, Tensor, UNIT_ROUNDOFF_F32};

use crate::array::Array;
use crate::compare::{Comparison, Expected, Found, compare};
use crate::engine::{self, Optimization};
use crate::error::Result;
use crate::onnx::builder::GraphBuilder;

pub mod conv;
pub mod conv_transpose;
pub mod values;

/// A graph with its inputs, ready to run.
#[derive(Clone, Debug)]
pub struct Task {
    /// The graph; it has one output.
    pub graph: GraphBuilder,
    /// Its inputs by name.
    pub inputs: Vec<(&'static str, Array)>,
}

/// One operator applied to given tensors: the data, and the two parties' answers.
pub trait Problem: Clone + Debug {
    /// ONNX's name of the operator.
    fn operator(&self) -> &'static str;

    /// The reference's answer with its rounding analysis, from exactly the numbers that the runtime gets.
    fn reference(&self) -> Tensor<Rounded>;

    /// The graph of this one operator; weights are constants, as in an exported network.
    fn task(&self) -> Task;

    /// The runtime's answer.
    ///
    /// # Errors
    /// When ONNX Runtime refuses the graph.
    fn runtime(&self, optimization: Optimization) -> Result<Found> {
        let task = self.task();
        let mut outputs = engine::run(self.operator(), &task.graph.to_bytes(), optimization, &task.inputs)?;
        Ok(outputs.swap_remove(0))
    }

    /// Compares the two answers.
    ///
    /// # Errors
    /// As [`Problem::runtime`].
    fn judge(&self, optimization: Optimization) -> Result<Comparison> {
        Ok(compare(&Expected::from(&self.reference()), &self.runtime(optimization)?))
    }
}

impl From<&Tensor<Rounded>> for Expected {
    /// Value, bound γ_n·m and unit u·m of every element, in f32.
    fn from(tensor: &Tensor<Rounded>) -> Self {
        let unit = |r: &Rounded| if r.terms == 0.0 { 0.0 } else { UNIT_ROUNDOFF_F32 * r.magnitude };
        Self {
            shape: tensor.shape.clone(),
            values: tensor.data.iter().map(|r| r.value).collect(),
            bounds: tensor.data.iter().map(|r| r.bound(UNIT_ROUNDOFF_F32)).collect(),
            units: tensor.data.iter().map(unit).collect(),
        }
    }
}

/// An array as exact inputs of a rounding analysis.
pub(crate) fn exact(array: &Array) -> Tensor<Rounded> {
    Tensor::new(&array.shape, array.values.iter().map(|&v| f64::from(v)).collect()).rounded()
}

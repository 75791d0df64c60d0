//! Graphs through the runtime's sessions, with every output as plain numbers.

use ndarray::ArrayViewD;
use vitruvian_runtime::session::{Input, Session, Settings};

pub use vitruvian_runtime::session::Optimization;

use crate::array::Array;
use crate::compare::Found;
use crate::error::Result;

/// The two ways in which every graph is judged: as written, and as it ships.
pub const OPTIMIZATIONS: [Optimization; 2] = [Optimization::Disabled, Optimization::All];

/// Runs a graph once, on one thread; its outputs in order.
///
/// # Errors
/// When ONNX Runtime is missing, or refuses the graph or the inputs.
///
/// # Panics
/// When an input's shape and values do not fit, which [`Array`] excludes.
pub fn run(
    name: &str,
    graph: &[u8],
    optimization: Optimization,
    inputs: &[(&str, &Array)],
) -> Result<Vec<Found>> {
    let mut session = Session::from_bytes(name, graph, &Settings { optimization, threads: 1 })?;
    let outputs: Vec<String> = session.outputs().iter().map(|output| output.name.clone()).collect();
    let inputs: Vec<(&str, Input)> = inputs
        .iter()
        .map(|(input, array)| {
            let view = ArrayViewD::from_shape(&array.shape[..], &array.values);
            (*input, Input::F32(view.expect("an array has as many values as places")))
        })
        .collect();
    let outputs = session.run(&inputs, &outputs.iter().map(String::as_str).collect::<Vec<_>>())?;
    outputs
        .iter()
        .map(|value| {
            let values = value.f32()?;
            Ok(Found { shape: values.shape().to_vec(), values: values.iter().copied().collect() })
        })
        .collect()
}

//! Graphs through the runtime's sessions, with every output as plain numbers.

use ndarray::ArrayViewD;
use vitruvian_runtime::session::{Input, Session, Settings, TensorInfo, Value};

pub use vitruvian_runtime::session::Optimization;

use crate::array::Array;
use crate::compare::Found;
use crate::error::Result;

/// The two ways in which every graph is judged: as written, and as it ships.
pub const OPTIMIZATIONS: [Optimization; 2] = [Optimization::Disabled, Optimization::All];

/// Runs a graph once, on one thread; its outputs in order.
///
/// # Errors
/// When ONNX Runtime is missing, or refuses the graph or the inputs, or an output is not f32.
///
/// # Panics
/// When an input's shape and values do not fit, which [`Array`] excludes.
pub fn run(
    name: &str,
    graph: &[u8],
    optimization: Optimization,
    inputs: &[(&str, &Array)],
) -> Result<Vec<Found>> {
    let outputs = run_where(name, graph, optimization, inputs, |_| true)?;
    Ok(outputs.into_iter().map(|(_, found)| found).collect())
}

/// As [`run`], but of the outputs only those that ONNX Runtime found to be f32, with their names.
///
/// # Errors
/// As [`run`].
pub fn run_f32(
    name: &str,
    graph: &[u8],
    optimization: Optimization,
    inputs: &[(&str, &Array)],
) -> Result<Vec<(String, Found)>> {
    run_where(name, graph, optimization, inputs, |output| output.element == "f32")
}

fn run_where(
    name: &str,
    graph: &[u8],
    optimization: Optimization,
    inputs: &[(&str, &Array)],
    wanted: impl Fn(&TensorInfo) -> bool,
) -> Result<Vec<(String, Found)>> {
    let mut session = Session::from_bytes(name, graph, &Settings { optimization, threads: 1 })?;
    let wanted = session.outputs().iter().filter(|output| wanted(output));
    let outputs: Vec<String> = wanted.map(|output| output.name.clone()).collect();
    let inputs: Vec<(&str, Input)> = inputs
        .iter()
        .map(|(input, array)| {
            let view = ArrayViewD::from_shape(&array.shape[..], &array.values);
            (*input, Input::F32(view.expect("an array has as many values as places")))
        })
        .collect();
    let values = session.run(&inputs, &outputs.iter().map(String::as_str).collect::<Vec<_>>())?;
    let found = |(name, value): (String, &Value)| {
        let values = value.f32()?;
        let found = Found { shape: values.shape().to_vec(), values: values.iter().copied().collect() };
        Ok((name, found))
    };
    outputs.into_iter().zip(&values).map(found).collect()
}

//! ONNX Runtime as the runtime crate finds and starts it, for graphs that carry no contract.

use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::TensorRef;
use vitruvian_runtime::library;

use crate::array::Array;
use crate::compare::Found;
use crate::error::{Error, Result};

/// Whether ONNX Runtime may rewrite the graph before running it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optimization {
    /// Every node as written.
    Off,
    /// Everything it knows: fused nodes, other memory layouts.
    All,
}

impl Optimization {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Off, Self::All];
}

/// Runs a graph once; its outputs in order.
///
/// # Errors
/// When ONNX Runtime is missing, or refuses the graph or the inputs.
pub fn run(
    name: &str,
    graph: &[u8],
    optimization: Optimization,
    inputs: &[(&str, &Array)],
) -> Result<Vec<Found>> {
    let engine = |error: ort::Error| Error::Engine { graph: name.to_owned(), message: error.to_string() };
    let level = match optimization {
        Optimization::Off => GraphOptimizationLevel::Disable,
        Optimization::All => GraphOptimizationLevel::All,
    };
    let mut session = Session::builder(library::environment()?)
        .map_err(engine)?
        .with_optimization_level(level)
        .and_then(|builder| builder.with_intra_threads(1))
        .map_err(|error| engine(error.into()))?
        .commit_from_memory(graph)
        .map_err(engine)?;
    let mut values = Vec::with_capacity(inputs.len());
    for (input, array) in inputs {
        let tensor = TensorRef::from_array_view((&array.shape[..], &array.values[..])).map_err(engine)?;
        values.push((*input, tensor));
    }
    let outputs = session.run(values).map_err(engine)?;
    outputs
        .values()
        .map(|value| {
            let (shape, values) = value.try_extract_tensor::<f32>().map_err(engine)?;
            Ok(Found { shape: shape.iter().map(|&side| side as usize).collect(), values: values.to_vec() })
        })
        .collect()
}

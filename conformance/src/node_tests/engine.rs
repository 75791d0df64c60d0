//! The parties that compute a case for themselves.

use vitruvian_runtime::session::{Input, Optimization, Session, Settings, Value};

use super::case::Case;
use crate::audit::onnx_runtime::{given, taken};
use crate::onnx::typed_tensor::TypedTensor;

/// Something that runs graphs.
pub trait Engine {
    /// Its name, for the head of a column.
    fn name(&self) -> &'static str;

    /// The outputs of a case, in the graph's order.
    ///
    /// # Errors
    /// Why it does not run the case, in one line.
    fn run(&mut self, case: &Case) -> Result<Vec<TypedTensor>, String>;
}

/// ONNX Runtime's CPU kernels, on the graph as it is written, on one thread.
#[derive(Clone, Copy, Debug)]
pub struct OnnxRuntime;

impl Engine for OnnxRuntime {
    fn name(&self) -> &'static str {
        "ONNX Runtime"
    }

    fn run(&mut self, case: &Case) -> Result<Vec<TypedTensor>, String> {
        let settings = Settings { optimization: Optimization::Disabled, threads: 1 };
        let line = |error: vitruvian_runtime::error::Error| error.to_string();
        let mut session = Session::from_bytes(&case.name, case.model.bytes(), &settings).map_err(line)?;
        let values: Result<Vec<(&str, Value)>, String> = case
            .inputs
            .iter()
            .map(|(name, tensor)| Ok((name.as_str(), given(name, tensor).map_err(line)?)))
            .collect();
        let values = values?;
        let inputs: Vec<(&str, Input)> =
            values.iter().map(|(name, value)| (*name, Input::Value(value))).collect();
        let outputs = session.run(&inputs, &case.model.outputs()).map_err(line)?;
        outputs.iter().map(taken).collect()
    }
}

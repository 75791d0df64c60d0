//! ONNX Runtime's sessions of a graph: as they ship, and as they are written with any tensor shown.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use vitruvian_runtime::session::{Input, Optimization, Rewriting, Session, Settings, Value};

use crate::audit::onnx_runtime::{given, taken};
use crate::error::{Error, Result};
use crate::onnx::expose::expose;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// The inputs in ONNX Runtime's memory.
pub struct Inputs(Vec<(String, Value)>);

impl Inputs {
    pub fn new(inputs: &BTreeMap<String, TypedTensor>) -> Result<Self> {
        let held = inputs.iter().map(|(name, tensor)| Ok((name.clone(), given(name, tensor)?)));
        Ok(Self(held.collect::<Result<_>>()?))
    }

    /// Runs a session on them.
    pub fn run(&self, session: &mut Session, outputs: &[&str]) -> Result<Vec<TypedTensor>> {
        let inputs: Vec<(&str, Input)> =
            self.0.iter().map(|(name, value)| (name.as_str(), value.into())).collect();
        let values = session.run(&inputs, outputs)?;
        let tensor = |(name, value): (&&str, &Value)| {
            taken(value).map_err(|message| Error::Onnx {
                graph: session.path().display().to_string(),
                item: format!("output \"{name}\""),
                message,
            })
        };
        outputs.iter().zip(&values).map(tensor).collect()
    }
}

/// A file that is gone when it is dropped.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        Self(std::env::temp_dir().join(format!("vitruvian-optimised-{}-{count}.onnx", std::process::id())))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Nothing can be done about a file that does not go, and nothing depends on it.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// The outputs of the session as shipped at a level, and the graph that it runs.
pub(super) fn ship(
    model: &Model,
    inputs: &Inputs,
    optimization: Optimization,
    threads: usize,
) -> Result<(BTreeMap<String, TypedTensor>, Model)> {
    let scratch = Scratch::new();
    let rewriting = Rewriting { saved: Some(&scratch.0), ..Rewriting::default() };
    let settings = Settings { optimization, threads };
    let mut session = Session::rewritten(model.name(), model.bytes(), &settings, rewriting)?;
    let names: Vec<String> = session.outputs().iter().map(|output| output.name.clone()).collect();
    let found = inputs.run(&mut session, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    let optimised = Model::read(&scratch.0)?;
    Ok((names.into_iter().zip(found).collect(), optimised))
}

/// A graph that runs as it is written and gives any of its tensors.
pub(super) struct Exposed(Session);

impl Exposed {
    pub fn new(model: &Model, tensors: &[&str], threads: usize) -> Result<Self> {
        let settings = Settings { optimization: Optimization::Disabled, threads };
        Ok(Self(Session::from_bytes(model.name(), &expose(model, tensors), &settings)?))
    }

    pub fn run(&mut self, inputs: &Inputs, tensors: &[&str]) -> Result<Vec<TypedTensor>> {
        inputs.run(&mut self.0, tensors)
    }
}

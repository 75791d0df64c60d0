//! One loaded graph: its tensors, its metadata, and running it by name.
//!
//! Every failure names the graph and the tensor: inputs are checked against what the graph declares before ONNX Runtime
//! sees them.
//!
//! # Why are outputs not arrays?
//! An encoder's features are hundreds of megabytes and go straight into the next graph. A [`Value`] stays in ONNX
//! Runtime's memory, can be given to any number of runs without a copy, and is freed when dropped.
//!
//! # What about memory?
//! ONNX Runtime's arena keeps what it once took and its memory patterns plan for shapes seen before; with shapes
//! that vary (the last chunk of points is shorter) both hold memory that is never used again. They are off: a
//! tensor is freed as soon as nothing needs it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ndarray::{CowArray, IxDyn};
use ort::environment::Environment;
use ort::logging::LogLevel;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::session::{OutputSelector, RunOptions};
use ort::value::TensorRef;

use crate::error::{Error, Result};
use crate::library;

mod tensor;
#[cfg(test)]
mod tests;

pub use tensor::{Dimension, Input, Number, TensorInfo, Value};

/// Protocol buffers, and so ONNX files, end at 2 GiB.
const MAX_FILE_BYTES: u64 = 1 << 31;

/// How far ONNX Runtime may rewrite a graph before running it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Optimization {
    /// Run the nodes as they are written: the setting to compare with a reference.
    Disabled,
    /// Remove redundant nodes, fold constants.
    Basic,
    /// Also fuse nodes.
    Extended,
    /// Also change memory layouts: the fastest.
    #[default]
    All,
}

/// How a graph is loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// How far the graph may be rewritten.
    pub optimization: Optimization,
    /// Threads within an operator; 0 takes one per core.
    pub threads: usize,
}

/// What is done about the rewriting of a graph beside its level.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rewriting<'a> {
    /// Optimisers that are left out, by ONNX Runtime's names; names that it does not know are passed over.
    pub without: &'a [&'a str],
    /// Where the rewritten graph is written.
    pub saved: Option<&'a Path>,
}

/// A loaded graph.
///
/// ```no_run
/// use ndarray::Array4;
/// use vitruvian_runtime::session::{Session, Settings};
/// let mut encoder = Session::load("models/exported/mf_pifu_encoder.onnx", &Settings::default())?;
/// let images = Array4::<f32>::zeros((4, 3, 256, 256));
/// let features = encoder.run(&[("images", (&images).into())], &["features_1", "features_2"])?;
/// println!("{:?}", features[0].shape());
/// # Ok::<(), vitruvian_runtime::error::Error>(())
/// ```
#[derive(Debug)]
pub struct Session {
    path: PathBuf,
    session: ort::session::Session,
    inputs: Vec<TensorInfo>,
    outputs: Vec<TensorInfo>,
    metadata: BTreeMap<String, String>,
    /// The graph's own names of tensors that go by other ones here.
    own_names: BTreeMap<String, String>,
}

impl Session {
    /// Loads a graph from an ONNX file (with its external data, if it has any, from beside it).
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read, [`Error::File`] when it is empty, above 2 GiB or no graph that
    /// ONNX Runtime can run, [`Error::Missing`] without ONNX Runtime.
    pub fn load(path: impl AsRef<Path>, settings: &Settings) -> Result<Session> {
        let path = path.as_ref();
        let io = |source| Error::Io { path: path.to_path_buf(), source };
        let file = std::fs::File::open(path).map_err(io)?;
        let about = file.metadata().map_err(io)?;
        if !about.is_file() {
            return Err(refusal(path, "it is a folder; name the .onnx file"));
        }
        check_size(path, about.len())?;
        Self::commit(path, settings, Rewriting::default(), |builder| builder.commit_from_file(path))
    }

    /// Loads a graph from the bytes of an ONNX file; `name` stands for its path in messages.
    ///
    /// # Errors
    /// As [`Session::load`].
    pub fn from_bytes(name: impl AsRef<Path>, bytes: &[u8], settings: &Settings) -> Result<Session> {
        Self::rewritten(name, bytes, settings, Rewriting::default())
    }

    /// As [`Session::from_bytes`], with a say in how the graph is rewritten.
    ///
    /// # Errors
    /// As [`Session::load`], and when the rewritten graph cannot be written.
    pub fn rewritten(
        name: impl AsRef<Path>,
        bytes: &[u8],
        settings: &Settings,
        rewriting: Rewriting,
    ) -> Result<Session> {
        check_size(name.as_ref(), bytes.len() as u64)?;
        Self::commit(name.as_ref(), settings, rewriting, |builder| builder.commit_from_memory(bytes))
    }

    fn commit(
        path: &Path,
        settings: &Settings,
        rewriting: Rewriting,
        load: impl FnOnce(&mut SessionBuilder) -> ort::Result<ort::session::Session>,
    ) -> Result<Session> {
        let mut builder = configure(library::environment()?, settings, rewriting).map_err(|error| {
            refusal(path, &format!("ONNX Runtime takes no settings ({})", first_line(error.message())))
        })?;
        let session = load(&mut builder).map_err(|error| {
            let reason = first_line(error.message());
            refusal(path, &format!("ONNX Runtime cannot load it as a graph ({reason}); export it again, or check its download"))
        })?;
        let metadata = read_metadata(&session).map_err(|error| {
            refusal(path, &format!("its metadata cannot be read ({})", first_line(error.message())))
        })?;
        let inputs = session.inputs().iter().map(TensorInfo::of).collect();
        let outputs = session.outputs().iter().map(TensorInfo::of).collect();
        Ok(Session {
            path: path.to_path_buf(),
            session,
            inputs,
            outputs,
            metadata,
            own_names: BTreeMap::new(),
        })
    }

    /// The file, or the name it was loaded under.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The declared inputs, in the graph's order.
    pub fn inputs(&self) -> &[TensorInfo] {
        &self.inputs
    }

    /// The declared outputs, in the graph's order.
    pub fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    /// The graph's `metadata_props`.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Lets tensors go by other names from here on: `own_names` has the graph's own name of each new one.
    ///
    /// # Errors
    /// [`Error::Graph`] when the graph has no such tensor, or the new name is another tensor's.
    pub fn rename(&mut self, own_names: &BTreeMap<String, String>) -> Result<()> {
        let fault =
            |item: String, message: String| Err(Error::Graph { path: self.path.clone(), item, message });
        let all = || self.inputs.iter().chain(&self.outputs);
        for (name, own) in own_names {
            if all().all(|info| info.name != *own) {
                let message = format!(
                    "the graph has no such input or output; it has {} and {}",
                    names(&self.inputs),
                    names(&self.outputs)
                );
                return fault(format!("tensor \"{own}\" (for \"{name}\")"), message);
            }
            let taken =
                |info: &TensorInfo| info.name == *name && !own_names.values().any(|own| *own == *name);
            if name != own && all().any(taken) {
                return fault(
                    format!("tensor \"{name}\""),
                    format!("it cannot be \"{own}\": the graph has both"),
                );
            }
        }
        for info in self.inputs.iter_mut().chain(&mut self.outputs) {
            if let Some((name, _)) = own_names.iter().find(|(_, own)| **own == info.name) {
                info.name.clone_from(name);
            }
        }
        self.own_names.clone_from(own_names);
        Ok(())
    }

    /// Runs the graph: every input by name, the wanted outputs in the order asked for.
    ///
    /// # Errors
    /// [`Error::Graph`] naming the tensor: an input that is unknown, given twice, missing, or of another type or shape than
    /// declared; an output that does not exist; or whatever stops ONNX Runtime.
    pub fn run(&mut self, inputs: &[(&str, Input)], outputs: &[&str]) -> Result<Vec<Value>> {
        self.check(inputs, outputs)?;
        let path = self.path.clone();
        let fault = |item: &str, error: &ort::Error| Error::Graph {
            path: path.clone(),
            item: item.to_string(),
            message: first_line(error.message()),
        };

        // ONNX Runtime reads rows one after the other; an array in another order is copied once.
        enum Held<'a> {
            F32(CowArray<'a, f32, IxDyn>),
            I64(CowArray<'a, i64, IxDyn>),
            Value(&'a Value),
        }
        let held: Vec<(&str, Held)> = inputs
            .iter()
            .map(|(name, input)| match input {
                Input::F32(array) => (*name, Held::F32(array.as_standard_layout())),
                Input::I64(array) => (*name, Held::I64(array.as_standard_layout())),
                Input::Value(value) => (*name, Held::Value(value)),
            })
            .collect();
        let mut given: Vec<(&str, ort::session::SessionInputValue)> = Vec::with_capacity(held.len());
        for (name, held) in &held {
            let name_fault = |error| fault(&format!("input \"{name}\""), &error);
            given.push((
                own_name(&self.own_names, name),
                match held {
                    Held::F32(array) => TensorRef::from_array_view(array).map_err(name_fault)?.into(),
                    Held::I64(array) => TensorRef::from_array_view(array).map_err(name_fault)?.into(),
                    Held::Value(value) => (&value.value).into(),
                },
            ));
        }

        let own = outputs.iter().map(|name| own_name(&self.own_names, name));
        let selector = own.fold(OutputSelector::no_default(), |selector, name| selector.with(name));
        let options = RunOptions::new().map_err(|error| fault("run", &error))?.with_outputs(selector);
        let mut results =
            self.session.run_with_options(given, &options).map_err(|error| fault("run", &error))?;
        outputs
            .iter()
            .map(|name| {
                let item = format!("output \"{name}\"");
                let value = results.remove(own_name(&self.own_names, name)).ok_or_else(|| Error::Graph {
                    path: path.clone(),
                    item: item.clone(),
                    message: "ONNX Runtime gave no value for it; ask for each output once".to_string(),
                })?;
                Ok(Value { value, origin: (path.clone(), item) })
            })
            .collect()
    }

    fn check(&self, inputs: &[(&str, Input)], outputs: &[&str]) -> Result<()> {
        let fault =
            |item: String, message: String| Err(Error::Graph { path: self.path.clone(), item, message });
        for (at, (name, input)) in inputs.iter().enumerate() {
            let item = format!("input \"{name}\"");
            let Some(declared) = self.inputs.iter().find(|declared| declared.name == *name) else {
                return fault(item, format!("the graph has no such input; it has {}", names(&self.inputs)));
            };
            if inputs[..at].iter().any(|(earlier, _)| earlier == name) {
                return fault(item, "it is given twice".to_string());
            }
            if !declared.accepts(&input.element(), &input.shape()) {
                let found = format!("{}{:?}", input.element(), input.shape());
                return fault(item, format!("expected {}, found {found}", declared.signature()));
            }
        }
        if let Some(missing) =
            self.inputs.iter().find(|info| inputs.iter().all(|(name, _)| *name != info.name))
        {
            return fault(format!("input \"{}\"", missing.name), "it is not given".to_string());
        }
        for name in outputs {
            if self.outputs.iter().all(|declared| declared.name != *name) {
                let message = format!("the graph has no such output; it has {}", names(&self.outputs));
                return fault(format!("output \"{name}\""), message);
            }
        }
        Ok(())
    }
}

/// What the graph itself calls a tensor.
fn own_name<'a>(own_names: &'a BTreeMap<String, String>, name: &'a str) -> &'a str {
    own_names.get(name).map_or(name, String::as_str)
}

/// Names in quotes, for messages.
fn names(tensors: &[TensorInfo]) -> String {
    tensors.iter().map(|info| format!("\"{}\"", info.name)).collect::<Vec<_>>().join(", ")
}

/// A file that is no usable graph.
fn refusal(path: &Path, message: &str) -> Error {
    Error::File { path: path.to_path_buf(), message: message.to_string() }
}

fn check_size(path: &Path, bytes: u64) -> Result<()> {
    match bytes {
        0 => Err(refusal(path, "it is empty, expected an ONNX graph")),
        MAX_FILE_BYTES.. => {
            Err(refusal(path, &format!("it has {bytes} bytes; an ONNX file has less than 2 GiB")))
        }
        _ => Ok(()),
    }
}

/// ONNX Runtime's messages may go on over lines of context.
fn first_line(message: &str) -> String {
    message.lines().next().unwrap_or_default().trim().to_string()
}

fn configure(
    environment: &Environment,
    settings: &Settings,
    rewriting: Rewriting,
) -> ort::Result<SessionBuilder> {
    let level = match settings.optimization {
        Optimization::Disabled => GraphOptimizationLevel::Disable,
        Optimization::Basic => GraphOptimizationLevel::Level1,
        Optimization::Extended => GraphOptimizationLevel::Level2,
        Optimization::All => GraphOptimizationLevel::All,
    };
    let cpu = ort::ep::CPU::default().with_arena_allocator(false).build();
    let mut builder = ort::session::Session::builder(environment)?;
    if !rewriting.without.is_empty() {
        let names = rewriting.without.join(";");
        builder = builder.with_config_entry("optimization.disable_specified_optimizers", names)?;
    }
    if let Some(path) = rewriting.saved {
        builder = builder.with_optimized_model_path(path)?;
    }
    Ok(builder
        .with_optimization_level(level)?
        .with_intra_threads(settings.threads)?
        // Threads that wait by spinning take the core from whatever else runs.
        .with_intra_op_spinning(false)?
        .with_memory_pattern(false)?
        .with_execution_providers([cpu])?
        .with_log_level(LogLevel::Fatal)?)
}

fn read_metadata(session: &ort::session::Session) -> ort::Result<BTreeMap<String, String>> {
    let metadata = session.metadata()?;
    let keys = metadata.custom_keys()?;
    Ok(keys.into_iter().filter_map(|key| metadata.custom(&key).map(|value| (key, value))).collect())
}

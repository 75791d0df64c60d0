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

use ndarray::{Array, ArrayViewD, CowArray, IxDyn};
use ort::environment::Environment;
use ort::logging::LogLevel;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::session::{OutputSelector, RunOptions};
use ort::value::{
    DynValue, Outlet, PrimitiveTensorElementType, Tensor, TensorElementType, TensorRef, ValueType,
};

use crate::error::{Error, Result};
use crate::library;

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

/// One side of a tensor as a graph declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// Always this long.
    Fixed(usize),
    /// Any length, under this name (which may be empty).
    Free(String),
}

impl Dimension {
    /// The length, where it is declared.
    pub fn fixed(&self) -> Option<usize> {
        match self {
            Dimension::Fixed(length) => Some(*length),
            Dimension::Free(_) => None,
        }
    }
}

/// An input or output as a graph declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorInfo {
    /// Its name.
    pub name: String,
    /// Its element type in ONNX's words, such as `f32` or `i64`; or what it is if it is no tensor.
    pub element: String,
    /// Its sides.
    pub shape: Vec<Dimension>,
}

impl TensorInfo {
    fn of(outlet: &Outlet) -> TensorInfo {
        let name = outlet.name().to_string();
        match outlet.dtype() {
            ValueType::Tensor { ty, shape, dimension_symbols } => {
                let symbol = |axis: usize| dimension_symbols.get(axis).cloned().unwrap_or_default();
                let dimension = |(axis, &length): (usize, &i64)| {
                    usize::try_from(length).map_or_else(|_| Dimension::Free(symbol(axis)), Dimension::Fixed)
                };
                let shape = shape.iter().enumerate().map(dimension).collect();
                TensorInfo { name, element: ty.to_string(), shape }
            }
            other => TensorInfo { name, element: other.to_string(), shape: Vec::new() },
        }
    }

    /// Type and shape in one word, such as `f32[N, P, 2]`.
    pub fn signature(&self) -> String {
        let side = |dimension: &Dimension| match dimension {
            Dimension::Fixed(length) => length.to_string(),
            Dimension::Free(name) if name.is_empty() => "?".to_string(),
            Dimension::Free(name) => name.clone(),
        };
        format!("{}[{}]", self.element, self.shape.iter().map(side).collect::<Vec<_>>().join(", "))
    }

    /// Whether a tensor of this element type and shape may be given.
    fn accepts(&self, element: &str, shape: &[usize]) -> bool {
        self.element == element
            && self.shape.len() == shape.len()
            && self
                .shape
                .iter()
                .zip(shape)
                .all(|(side, &length)| side.fixed().is_none_or(|fixed| fixed == length))
    }
}

/// What a tensor can hold: f32, f64, `half::f16`, `half::bf16`, integers of 8 to 64 bits with and without sign, `bool`.
pub trait Number: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static {}

impl<T: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static> Number for T {}

/// A tensor that ONNX Runtime holds: an output, ready to be an input.
#[derive(Debug)]
pub struct Value {
    value: DynValue,
    /// For messages: `GRAPH: output "name"`.
    origin: (PathBuf, String),
}

impl Value {
    /// A tensor of any element type, which takes the numbers over; `name` stands for it in messages.
    ///
    /// # Errors
    /// [`Error::Graph`] when the shape does not fit the numbers, [`Error::Missing`] without ONNX Runtime.
    pub fn new<T: Number>(name: &str, shape: &[usize], numbers: Vec<T>) -> Result<Value> {
        library::environment()?;
        let origin = (PathBuf::from(name), "tensor".to_string());
        let fault =
            |message: String| Error::Graph { path: origin.0.clone(), item: origin.1.clone(), message };
        let count = numbers.len();
        let array = Array::from_shape_vec(shape, numbers)
            .map_err(|_| fault(format!("shape {shape:?} does not fit {count} numbers")))?;
        let value = Tensor::from_array(array).map_err(|error| fault(first_line(error.message())))?.into_dyn();
        Ok(Value { value, origin })
    }

    /// Its shape.
    pub fn shape(&self) -> Vec<usize> {
        match self.value.dtype() {
            ValueType::Tensor { shape, .. } => shape.iter().map(|&length| length.max(0) as usize).collect(),
            _ => Vec::new(),
        }
    }

    /// Its element type, such as `f32`.
    pub fn element(&self) -> String {
        self.value
            .dtype()
            .tensor_type()
            .map_or_else(|| "no tensor".to_string(), |element| element.to_string())
    }

    /// Its numbers, without a copy.
    ///
    /// # Errors
    /// [`Error::Graph`] when it is not an f32 tensor.
    pub fn f32(&self) -> Result<ArrayViewD<'_, f32>> {
        self.view(TensorElementType::Float32)
    }

    /// Its numbers as i64, without a copy.
    ///
    /// # Errors
    /// [`Error::Graph`] when it is not an i64 tensor.
    pub fn i64(&self) -> Result<ArrayViewD<'_, i64>> {
        self.view(TensorElementType::Int64)
    }

    /// Its numbers as `T`, without a copy.
    ///
    /// # Errors
    /// [`Error::Graph`] when it holds another type.
    pub fn numbers<T: Number>(&self) -> Result<ArrayViewD<'_, T>> {
        self.view(T::into_tensor_element_type())
    }

    fn view<T: Number>(&self, wanted: TensorElementType) -> Result<ArrayViewD<'_, T>> {
        self.value.try_extract_array::<T>().map_err(|_| Error::Graph {
            path: self.origin.0.clone(),
            item: self.origin.1.clone(),
            message: format!("it is {}, expected {wanted}", self.element()),
        })
    }
}

/// What is given to an input.
#[derive(Debug)]
pub enum Input<'a> {
    /// f32 numbers.
    F32(ArrayViewD<'a, f32>),
    /// i64 numbers.
    I64(ArrayViewD<'a, i64>),
    /// What another run gave.
    Value(&'a Value),
}

impl<'a, D: ndarray::Dimension> From<&'a Array<f32, D>> for Input<'a> {
    fn from(array: &'a Array<f32, D>) -> Self {
        Input::F32(array.view().into_dyn())
    }
}

impl<'a, D: ndarray::Dimension> From<&'a Array<i64, D>> for Input<'a> {
    fn from(array: &'a Array<i64, D>) -> Self {
        Input::I64(array.view().into_dyn())
    }
}

impl<'a> From<&'a Value> for Input<'a> {
    fn from(value: &'a Value) -> Self {
        Input::Value(value)
    }
}

impl Input<'_> {
    fn element(&self) -> String {
        match self {
            Input::F32(_) => TensorElementType::Float32.to_string(),
            Input::I64(_) => TensorElementType::Int64.to_string(),
            Input::Value(value) => value.element(),
        }
    }

    fn shape(&self) -> Vec<usize> {
        match self {
            Input::F32(array) => array.shape().to_vec(),
            Input::I64(array) => array.shape().to_vec(),
            Input::Value(value) => value.shape(),
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_graph::{Element, GraphBuilder, Side};
    use ndarray::{Array1, Array2, array};

    /// sum [N, 2] = a + b, with N free, and index i64[1], which is passed through.
    fn adder() -> Vec<u8> {
        let n = || Side::Free("N");
        GraphBuilder::default()
            .metadata("vitruvian.kind", "adder")
            .input("a", Element::F32, &[n(), Side::Fixed(2)])
            .input("b", Element::F32, &[n(), Side::Fixed(2)])
            .input("index", Element::I64, &[Side::Fixed(1)])
            .node("Add", &["a", "b"], &["sum"], &[])
            .node("Identity", &["index"], &["same"], &[])
            .output("sum", Element::F32, &[n(), Side::Fixed(2)])
            .output("same", Element::I64, &[Side::Fixed(1)])
            .to_bytes()
    }

    fn load(bytes: &[u8]) -> Session {
        Session::from_bytes("adder.onnx", bytes, &Settings::default())
            .unwrap_or_else(|error| panic!("{error}"))
    }

    /// The message of the error that giving these inputs raises.
    fn complaint(inputs: &[(&str, Input)], outputs: &[&str]) -> String {
        load(&adder()).run(inputs, outputs).expect_err("a wrong call").to_string()
    }

    #[test]
    fn a_graph_tells_its_tensors_and_metadata() {
        let session = load(&adder());
        let signatures: Vec<_> =
            session.inputs().iter().map(|info| (&*info.name, info.signature())).collect();
        let expected = [("a", "f32[N, 2]"), ("b", "f32[N, 2]"), ("index", "i64[1]")];
        assert_eq!(signatures, expected.map(|(name, signature)| (name, signature.to_string())));
        assert_eq!(session.metadata()["vitruvian.kind"], "adder");
    }

    #[test]
    fn outputs_come_in_the_order_asked_for_and_feed_the_next_run() {
        let mut session = load(&adder());
        let (a, b, index) =
            (array![[1.0_f32, 2.0], [3.0, 4.0]], array![[10.0_f32, 20.0], [30.0, 40.0]], array![7_i64]);
        let inputs = [("index", (&index).into()), ("b", (&b).into()), ("a", (&a).into())];
        let values = session.run(&inputs, &["same", "sum"]).expect("valid inputs");
        assert_eq!(values[0].i64().expect("i64"), index.view().into_dyn());
        assert_eq!(values[1].f32().expect("f32"), (&a + &b).view().into_dyn());
        assert!(values[0].f32().is_err(), "i64 is not read as f32");

        let again = session
            .run(&[("a", (&values[1]).into()), ("b", (&b).into()), ("index", (&values[0]).into())], &["sum"]);
        assert_eq!(again.expect("valid inputs")[0].f32().expect("f32"), (&a + &b + &b).view().into_dyn());
    }

    #[test]
    fn every_element_type_goes_in_and_comes_out() {
        fn passes<T: Number + PartialEq>(numbers: Vec<T>) {
            let value = Value::new("given", &[numbers.len()], numbers.clone()).expect("a tensor");
            let back: Vec<T> = value.numbers::<T>().expect("its own type").iter().cloned().collect();
            assert_eq!(back, numbers, "{}", value.element());
        }
        passes(vec![half::f16::from_f32(0.5), half::f16::INFINITY]);
        passes(vec![half::bf16::from_f32(-3.0)]);
        passes(vec![1.5_f64]);
        passes(vec![-7_i8]);
        passes(vec![u64::MAX]);
        passes(vec![true, false]);
        passes(Vec::<f32>::new());
        assert!(Value::new("given", &[3], vec![1_i32]).is_err(), "a shape that does not fit");
        assert!(Value::new("given", &[1], vec![1_i32]).expect("a tensor").f32().is_err(), "another type");
    }

    #[test]
    fn an_array_in_another_memory_order_is_read_by_its_indices() {
        let a = array![[1.0_f32, 3.0], [2.0, 4.0]].reversed_axes();
        let zero = Array2::<f32>::zeros((2, 2));
        let index = array![0_i64];
        let inputs = [("a", (&a).into()), ("b", (&zero).into()), ("index", (&index).into())];
        assert_eq!(
            load(&adder()).run(&inputs, &["sum"]).expect("valid inputs")[0].f32().expect("f32"),
            a.view().into_dyn()
        );
    }

    #[test]
    fn a_wrong_call_names_the_graph_and_the_tensor() {
        let (good, index) = (Array2::<f32>::zeros((3, 2)), array![0_i64]);
        let (narrow, flat) = (Array2::<f32>::zeros((3, 1)), Array1::<f32>::zeros(1));
        let a = || ("a", Input::from(&good));
        let i = || ("index", Input::from(&index));
        let expected = "adder.onnx: input \"b\": expected f32[N, 2], found f32[3, 1]";
        assert_eq!(complaint(&[a(), ("b", (&narrow).into()), i()], &["sum"]), expected);
        let expected = "adder.onnx: input \"index\": expected i64[1], found f32[1]";
        assert_eq!(complaint(&[a(), ("index", (&flat).into())], &["sum"]), expected);
        assert_eq!(complaint(&[a(), i()], &["sum"]), "adder.onnx: input \"b\": it is not given");
        assert!(complaint(&[a(), a()], &["sum"]).contains("given twice"));
        assert!(complaint(&[("c", (&good).into())], &["sum"]).contains("it has \"a\", \"b\", \"index\""));
        assert!(complaint(&[a(), ("b", (&good).into()), i()], &["total"]).contains("output \"total\""));
    }

    #[test]
    fn a_rewritten_graph_is_written_and_an_optimiser_can_be_left_out() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let written = |without: &[&str], name: &str| {
            let path = folder.path().join(name);
            let settings = Settings { optimization: Optimization::Basic, threads: 1 };
            let rewriting = Rewriting { without, saved: Some(&path) };
            Session::rewritten("turn.onnx", &turned(), &settings, rewriting).expect("a graph");
            std::fs::read(path).expect("a rewritten graph").len()
        };
        assert!(written(&[], "less.onnx") < written(&["EliminateIdentity", "NoSuchPass"], "more.onnx"));
    }

    /// y = −(the same as x).
    fn turned() -> Vec<u8> {
        GraphBuilder::default()
            .input("x", Element::F32, &[Side::Fixed(2)])
            .node("Identity", &["x"], &["the_same_as_x"], &[])
            .node("Neg", &["the_same_as_x"], &["y"], &[])
            .output("y", Element::F32, &[Side::Fixed(2)])
            .to_bytes()
    }

    #[test]
    fn lengths_that_do_not_fit_each_other_are_an_error_of_the_run() {
        let (three, four, index) =
            (Array2::<f32>::zeros((3, 2)), Array2::<f32>::zeros((4, 2)), array![0_i64]);
        let message =
            complaint(&[("a", (&three).into()), ("b", (&four).into()), ("index", (&index).into())], &["sum"]);
        assert!(message.starts_with("adder.onnx: run: "), "{message}");
    }

    #[test]
    fn what_is_no_graph_is_refused_with_its_name() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let complaint = |name: &str, content: Option<&[u8]>| {
            let path = folder.path().join(name);
            if let Some(content) = content {
                std::fs::write(&path, content).expect("a writable folder");
            }
            let message = Session::load(&path, &Settings::default()).expect_err("no graph").to_string();
            assert!(message.starts_with(&path.display().to_string()), "{message}");
            assert_eq!(message.lines().count(), 1, "{message}");
            message
        };
        complaint("absent.onnx", None);
        assert!(complaint("empty.onnx", Some(b"")).contains("it is empty"));
        assert!(complaint("text.onnx", Some(b"not a graph at all")).contains("cannot load it as a graph"));
        let whole = adder();
        for length in [1, whole.len() / 2, whole.len() - 1] {
            assert!(
                complaint("cut.onnx", Some(&whole[..length])).contains("cannot load it as a graph"),
                "{length} bytes"
            );
        }
        assert!(complaint(".", None).contains("it is a folder"));
    }
}

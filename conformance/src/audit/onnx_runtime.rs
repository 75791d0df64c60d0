//! ONNX Runtime as the second party: the graph as it is written, every tensor kept.

use vitruvian_runtime::library;
use vitruvian_runtime::session::{Input, Number, Optimization, Session, Settings, Value};

use super::party::{Party, Segment, Tensors};
use super::segment::{self, Part};
use crate::error::Result;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// ONNX Runtime on the CPU, with optimisation off, part by part.
///
/// Asked for every tensor at once, a graph of ordinary size gives more than memory holds. So it is cut into parts of nodes
/// that follow each other, each run as a graph of its own and fed with the runtime's own tensors from the parts before;
/// without optimisation a node computes the same wherever it stands.
#[derive(Clone, Copy, Debug)]
pub struct OnnxRuntime {
    /// Threads within an operator; 0 takes one per core.
    pub threads: usize,
    /// Bytes of tensors that a part may make, by estimate.
    pub memory: usize,
    /// Nodes that a part may have: fewer after a part that was refused, and more again with every part that runs.
    pub nodes: usize,
}

impl Default for OnnxRuntime {
    fn default() -> Self {
        Self { threads: 2, memory: 256 << 20, nodes: usize::MAX }
    }
}

impl Party for OnnxRuntime {
    fn describe(&self) -> String {
        let version = library::loaded().map_or("not loaded".to_owned(), |library| library.version);
        format!("ONNX Runtime {version}, optimisation off")
    }

    fn computes(&self) -> bool {
        true
    }

    fn ships(&self) -> Option<usize> {
        Some(self.threads)
    }

    fn segment(&mut self, model: &Model, first: usize, held: &Tensors) -> Result<Segment> {
        library::environment()?;
        let mut count = segment::reach(model, first, held, self.memory).min(self.nodes);
        loop {
            let part = Part::of(model, first..first + count, held);
            let mut segment = Segment { nodes: first..first + count, ..Segment::default() };
            match part.and_then(|part| self.run(model.name(), &part, &mut segment)) {
                Ok(()) => {
                    self.nodes = self.nodes.saturating_mul(2);
                    return Ok(segment);
                }
                // What a part cannot do, a smaller one may; one node alone tells what stands in the way.
                Err(_) if count > 1 => {
                    count = count.div_ceil(2);
                    self.nodes = count;
                }
                Err(why) => {
                    let outputs = &model.nodes()[first].output;
                    let outputs = outputs.iter().filter(|name| !name.is_empty());
                    segment.missing = outputs.map(|name| (name.clone(), why.clone())).collect();
                    return Ok(segment);
                }
            }
        }
    }
}

impl OnnxRuntime {
    fn run(&self, name: &str, part: &Part, segment: &mut Segment) -> std::result::Result<(), String> {
        let settings = Settings { optimization: Optimization::Disabled, threads: self.threads };
        let mut session = Session::from_bytes(name, &part.bytes, &settings).map_err(|e| e.to_string())?;
        let values: Vec<(&str, Value)> = part
            .inputs
            .iter()
            .map(|(name, tensor)| Ok((name.as_str(), given(name, tensor).map_err(|e| e.to_string())?)))
            .collect::<std::result::Result<_, String>>()?;
        let inputs: Vec<(&str, Input)> = values.iter().map(|(name, value)| (*name, value.into())).collect();
        let outputs: Vec<&str> = part.outputs.iter().map(String::as_str).collect();
        let found = session.run(&inputs, &outputs).map_err(|e| e.to_string())?;
        // The inputs are copies, and the outputs are copied in turn.
        drop(inputs);
        drop(values);
        for (name, value) in part.outputs.iter().zip(found) {
            match taken(&value) {
                Ok(tensor) => {
                    segment.tensors.insert(name.clone(), tensor);
                }
                Err(why) => {
                    segment.missing.insert(name.clone(), why);
                }
            }
        }
        Ok(())
    }
}

/// A tensor handed to ONNX Runtime.
pub(crate) fn given(name: &str, tensor: &TypedTensor) -> vitruvian_runtime::error::Result<Value> {
    let shape = &tensor.shape;
    match &tensor.elements {
        Elements::F32(v) => Value::new(name, shape, v.clone()),
        Elements::F64(v) => Value::new(name, shape, v.clone()),
        Elements::F16(v) => Value::new(name, shape, v.clone()),
        Elements::Bf16(v) => Value::new(name, shape, v.clone()),
        Elements::I8(v) => Value::new(name, shape, v.clone()),
        Elements::U8(v) => Value::new(name, shape, v.clone()),
        Elements::I16(v) => Value::new(name, shape, v.clone()),
        Elements::U16(v) => Value::new(name, shape, v.clone()),
        Elements::I32(v) => Value::new(name, shape, v.clone()),
        Elements::U32(v) => Value::new(name, shape, v.clone()),
        Elements::I64(v) => Value::new(name, shape, v.clone()),
        Elements::U64(v) => Value::new(name, shape, v.clone()),
        Elements::Bool(v) => Value::new(name, shape, v.clone()),
    }
}

/// A tensor taken from ONNX Runtime.
pub(crate) fn taken(value: &Value) -> std::result::Result<TypedTensor, String> {
    fn all<T: Number>(value: &Value) -> std::result::Result<Vec<T>, String> {
        let numbers = value.numbers::<T>().map_err(|e| e.to_string())?;
        Ok(numbers.iter().cloned().collect())
    }
    let elements = match value.element().as_str() {
        "f32" => Elements::F32(all(value)?),
        "f64" => Elements::F64(all(value)?),
        "f16" => Elements::F16(all(value)?),
        "bf16" => Elements::Bf16(all(value)?),
        "i8" => Elements::I8(all(value)?),
        "u8" => Elements::U8(all(value)?),
        "i16" => Elements::I16(all(value)?),
        "u16" => Elements::U16(all(value)?),
        "i32" => Elements::I32(all(value)?),
        "u32" => Elements::U32(all(value)?),
        "i64" => Elements::I64(all(value)?),
        "u64" => Elements::U64(all(value)?),
        "bool" => Elements::Bool(all(value)?),
        other => return Err(format!("ONNX Runtime gives it as {other}, which is not compared")),
    };
    Ok(TypedTensor { shape: value.shape(), elements })
}

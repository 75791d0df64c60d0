//! A file of tensors that another engine left, as the second party.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use vitruvian_runtime::file::npy::Raw;
use vitruvian_runtime::file::npz::Npz;

use super::party::{Party, Segment, Tensors};
use crate::error::Result;
use crate::onnx::element::ElementType;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// Bytes of tensors that are read at once, unless one alone has more.
const AT_ONCE: u64 = 512 << 20;

/// An `.npz` of arrays under the names of the graph's tensors: what PyTorch hooks, another runtime or an older release
/// computed.
///
/// Programs that write such files may not be able to keep a `/` or `:` in a name. So an array `a_b` also stands for the
/// tensor `a/b`, if there is no other tensor and no other array that it could be.
pub struct Dump {
    name: String,
    file: Npz,
    /// The array of each tensor, by the tensor's name.
    arrays: BTreeMap<String, String>,
    notes: Vec<String>,
}

impl Dump {
    /// Opens a dump of the tensors of this graph.
    ///
    /// # Errors
    /// When the file cannot be read or is no `.npz`.
    pub fn open(path: &Path, model: &Model) -> Result<Self> {
        let file = Npz::open(path)?;
        let mut names: BTreeSet<String> = file.names().into_iter().collect();
        let tensors: BTreeSet<&str> = tensors(model);
        let mut arrays = BTreeMap::new();
        for &tensor in &tensors {
            if names.remove(tensor) {
                arrays.insert(tensor.to_owned(), tensor.to_owned());
            }
        }
        let mut notes = Vec::new();
        let plain = |name: &str| name.replace(|c: char| !c.is_ascii_alphanumeric(), "_");
        let mut alike: BTreeMap<String, (Vec<&str>, Vec<&String>)> = BTreeMap::new();
        for &tensor in tensors.iter().filter(|tensor| !arrays.contains_key(**tensor)) {
            alike.entry(plain(tensor)).or_default().0.push(tensor);
        }
        for name in &names {
            alike.entry(plain(name)).or_default().1.push(name);
        }
        for (tensors, names) in alike.values() {
            if let ([tensor], [name]) = (&tensors[..], &names[..]) {
                arrays.insert((*tensor).to_owned(), (*name).clone());
                notes.push(format!("the array \"{name}\" is taken for the tensor \"{tensor}\""));
            }
        }
        Ok(Self { name: path.display().to_string(), file, arrays, notes })
    }

    /// The graph's inputs, those that the dump has.
    ///
    /// # Errors
    /// When an array is damaged or holds no numbers.
    pub fn inputs(&mut self, model: &Model) -> Result<BTreeMap<String, TypedTensor>> {
        let names: Vec<String> = model.inputs().into_iter().map(str::to_owned).collect();
        let mut inputs = BTreeMap::new();
        for name in names {
            if let Some(tensor) = self.tensor(&name)? {
                inputs.insert(name, tensor);
            }
        }
        Ok(inputs)
    }

    fn tensor(&mut self, name: &str) -> Result<Option<TypedTensor>> {
        let Some(array) = self.arrays.get(name) else { return Ok(None) };
        let raw = self.file.raw(array)?;
        let tensor = typed(raw).map_err(|why| crate::error::Error::Onnx {
            graph: self.name.clone(),
            item: format!("array \"{array}\""),
            message: why,
        })?;
        Ok(Some(tensor))
    }
}

/// The names of the graph's inputs and of what its nodes make.
fn tensors(model: &Model) -> BTreeSet<&str> {
    model.inputs().into_iter().chain(model.intermediates()).collect()
}

/// An array of a `.npy` as a tensor. NumPy has no bf16: the packages that add it store it as two plain bytes, `V2`.
fn typed(raw: Raw) -> std::result::Result<TypedTensor, String> {
    let element = match raw.kind.as_str() {
        "f2" => ElementType::F16,
        "V2" => ElementType::Bf16,
        "f4" => ElementType::F32,
        "f8" => ElementType::F64,
        "i1" => ElementType::I8,
        "u1" => ElementType::U8,
        "i2" => ElementType::I16,
        "u2" => ElementType::U16,
        "i4" => ElementType::I32,
        "u4" => ElementType::U32,
        "i8" => ElementType::I64,
        "u8" => ElementType::U64,
        "b1" => ElementType::Bool,
        other => {
            return Err(format!(
                "holds values of type '{other}'; expected f2, f4, f8, V2 (bf16), integers or b1"
            ));
        }
    };
    TypedTensor::from_bytes(element, &raw.shape, &raw.bytes)
}

impl Party for Dump {
    fn describe(&self) -> String {
        format!("npz:{}", self.name)
    }

    fn segment(&mut self, model: &Model, first: usize, _: &Tensors) -> Result<Segment> {
        let mut segment = Segment { nodes: first..first, ..Segment::default() };
        segment.notes.append(&mut self.notes);
        let mut bytes = 0;
        for node in &model.nodes()[first..] {
            let outputs = || node.output.iter().filter(|name| !name.is_empty());
            let more: u64 = outputs()
                .filter_map(|name| self.arrays.get(name))
                .map(|array| self.file.claimed_bytes(array))
                .sum();
            if !segment.nodes.is_empty() && bytes + more > AT_ONCE {
                break;
            }
            bytes += more;
            for name in outputs() {
                match self.tensor(name)? {
                    Some(tensor) => {
                        segment.tensors.insert(name.clone(), tensor);
                    }
                    None => {
                        segment.missing.insert(name.clone(), "the dump has no such array".into());
                    }
                }
            }
            segment.nodes.end += 1;
        }
        Ok(segment)
    }

    fn unmatched(&self) -> Vec<String> {
        let taken: BTreeSet<&String> = self.arrays.values().collect();
        self.file.names().into_iter().filter(|name| !taken.contains(name)).collect()
    }
}

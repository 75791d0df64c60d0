//! A case of the official tests: a model, inputs, and the outputs that its authors expect.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use prost::Message as _;

use crate::error::{Error, Result};
use crate::onnx::message::TensorProto;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// A model with one set of inputs and expected outputs.
#[derive(Clone, Debug)]
pub struct Case {
    /// `node`, `simple`, `pytorch-converted` or `pytorch-operator`.
    pub kind: String,
    /// Such as `test_conv_with_strides_padding`; `#K` behind it names a set of data after the first.
    pub name: String,
    /// The graph.
    pub model: Model,
    /// The inputs that are given, by name.
    pub inputs: BTreeMap<String, TypedTensor>,
    /// The expected outputs, in the graph's order.
    pub outputs: Vec<TypedTensor>,
}

/// The folders of all cases under `root`, sorted: `root/KIND/CASE`.
///
/// # Errors
/// When a folder cannot be read.
pub fn folders(root: &Path) -> Result<Vec<PathBuf>> {
    let mut cases = Vec::new();
    for kind in entries(root)? {
        if kind.is_dir() {
            cases.extend(entries(&kind)?.into_iter().filter(|case| case.join("model.onnx").is_file()));
        }
    }
    Ok(cases)
}

/// The cases of one folder, one for each set of data; what cannot be read is said of each by name.
///
/// # Errors
/// When the folder itself cannot be read.
pub fn read(folder: &Path) -> Result<Vec<(String, std::result::Result<Case, String>)>> {
    let part = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let name = part(folder);
    let kind = folder.parent().map(part).unwrap_or_default();
    let path = folder.join("model.onnx");
    let bytes = std::fs::read(&path).map_err(|source| Error::Io { path, source })?;
    // The name stands before the message of a model that cannot be read; it is known here.
    let model = Model::from_bytes("model", bytes).map_err(|error| error.to_string());
    let sets: Vec<PathBuf> = entries(folder)?.into_iter().filter(|path| path.is_dir()).collect();
    let case = |(k, set): (usize, &PathBuf)| {
        let name = if k == 0 { name.clone() } else { format!("{name}#{k}") };
        let case = model.as_ref().map_err(Clone::clone).and_then(|model| {
            let (inputs, outputs) = data(model, set)?;
            Ok(Case { kind: kind.clone(), name: name.clone(), model: model.clone(), inputs, outputs })
        });
        (name, case)
    };
    Ok(sets.iter().enumerate().map(case).collect())
}

type Data = (BTreeMap<String, TypedTensor>, Vec<TypedTensor>);

fn data(model: &Model, set: &Path) -> std::result::Result<Data, String> {
    for value in model.graph().input.iter().chain(&model.graph().output) {
        if value.r#type.as_ref().is_some_and(|declared| declared.tensor_type.is_none()) {
            return Err("an input or output is no tensor but a sequence, a map or an optional value".into());
        }
    }
    let inputs = files(set, "input")?;
    // The files follow the declared inputs, also those that an initializer would fill.
    let declared = model.graph().input.iter().filter_map(|value| value.name.as_deref());
    let declared: Vec<&str> = declared.collect();
    if inputs.len() > declared.len() {
        return Err(format!("{} inputs are given, the graph declares {declared:?}", inputs.len()));
    }
    let inputs = declared.into_iter().map(str::to_owned).zip(inputs).collect();
    Ok((inputs, files(set, "output")?))
}

/// `PREFIX_0.pb`, `PREFIX_1.pb`, … as far as they go.
fn files(set: &Path, prefix: &str) -> std::result::Result<Vec<TypedTensor>, String> {
    let paths = (0..).map(|j| set.join(format!("{prefix}_{j}.pb"))).take_while(|path| path.is_file());
    paths
        .map(|path| {
            let bytes = std::fs::read(&path).map_err(|why| format!("{}: {why}", path.display()))?;
            let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let tensor = TensorProto::decode(&bytes[..]).map_err(|why| format!("{file}: {why}"))?;
            TypedTensor::read(&tensor).map_err(|why| format!("{file}: {why}"))
        })
        .collect()
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let io = |source| Error::Io { path: folder.to_owned(), source };
    let entries: std::io::Result<Vec<PathBuf>> =
        std::fs::read_dir(folder).map_err(io)?.map(|entry| Ok(entry?.path())).collect();
    let mut entries = entries.map_err(io)?;
    entries.sort();
    Ok(entries)
}

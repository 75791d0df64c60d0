//! Elements of tensors that lie in other files beside the graph: found, checked, and read a tensor at a time.
//!
//! A graph says the file's name relative to its own folder, and where in it the elements begin. Nothing outside this
//! folder is touched, whatever the name says, and nothing is allocated before the file is known to be long enough.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Component, Path, PathBuf};

use super::message::{GraphProto, TensorProto};
use super::structure::quoted;
use super::typed_tensor::{TypedTensor, element_of, shape_of};

/// The longest file that the container can be: lengths in it are of 31 bits.
pub(super) const LONGEST: u64 = 1 << 31;

/// Whether a tensor's elements lie in another file.
pub(super) fn is_external(tensor: &TensorProto) -> bool {
    tensor.data_location == Some(1)
}

/// The files beside a graph, as far as they were asked for.
#[derive(Debug)]
pub(super) struct Folder {
    /// Where the graph lies; a graph in memory lies nowhere.
    folder: Option<PathBuf>,
    /// The real path and the length of each file, by the name that the graph has for it.
    files: HashMap<String, (PathBuf, u64)>,
}

/// A stretch of a file.
struct Stretch {
    path: PathBuf,
    offset: u64,
    length: usize,
}

impl Folder {
    pub fn of(folder: Option<&Path>) -> Self {
        Self { folder: folder.map(Path::to_owned), files: HashMap::new() }
    }

    /// Whether a tensor's elements are where it says, as many as its shape asks for; of a type that is not read, whether
    /// its file is in the folder.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn check(&mut self, tensor: &TensorProto) -> Result<(), String> {
        self.stretch(tensor).map(|_| ())
    }

    /// A tensor's elements, read from their file.
    ///
    /// # Errors
    /// As [`Folder::check`], and when the type is not read or the file cannot be.
    pub fn read(&mut self, tensor: &TensorProto) -> Result<TypedTensor, String> {
        let element = element_of(tensor)?;
        let Some(stretch) = self.stretch(tensor)? else { return Err(format!("{element} is not read")) };
        let failed = |why: std::io::Error| format!("{}: {why}", stretch.path.display());
        let mut file = File::open(&stretch.path).map_err(failed)?;
        file.seek(SeekFrom::Start(stretch.offset)).map_err(failed)?;
        let mut bytes = vec![0; stretch.length];
        file.read_exact(&mut bytes).map_err(failed)?;
        TypedTensor::from_bytes(element, &shape_of(tensor)?, &bytes)
    }

    /// Where a tensor's elements are; `None` of a type that is not read.
    fn stretch(&mut self, tensor: &TensorProto) -> Result<Option<Stretch>, String> {
        let location =
            entry(tensor, "location")?.ok_or("its elements lie in another file, which has no name")?;
        let (path, available) = self.file(location)?;
        let offset = number(tensor, "offset")?.unwrap_or(0);
        let shape = shape_of(tensor)?;
        let Ok(element) = element_of(tensor) else { return Ok(None) };
        // The product of the sides is counted already; that it fits with the size is seen in the file's length.
        let places: usize = shape.iter().product();
        let needed =
            places.checked_mul(element.size()).ok_or_else(|| format!("shape {shape:?} is too large"))?;
        let name = quoted(location);
        if let Some(length) = number(tensor, "length")?.filter(|&length| length != needed as u64) {
            return Err(format!(
                "shape {shape:?} of {element} asks for {needed} bytes, its length in {name} is {length}"
            ));
        }
        if offset.checked_add(needed as u64).is_none_or(|end| end > available) {
            return Err(format!(
                "{needed} bytes from {offset} on are asked for, file {name} has {available}; \
                 copy the whole file beside the graph or export the graph again"
            ));
        }
        Ok(Some(Stretch { path, offset, length: needed }))
    }

    /// The path and the length of a file in the folder.
    fn file(&mut self, location: &str) -> Result<(PathBuf, u64), String> {
        if let Some(known) = self.files.get(location) {
            return Ok(known.clone());
        }
        let name = quoted(location);
        let Some(folder) = &self.folder else {
            return Err(format!(
                "its elements lie in file {name}, and a graph in memory has no folder to find it in"
            ));
        };
        let inside = !location.is_empty()
            && !location.contains(['\\', '\0'])
            && Path::new(location)
                .components()
                .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        let outside =
            || format!("file {name} is not in the graph's folder; put it there and name it relative to it");
        if !inside {
            return Err(outside());
        }
        let failed = |why: std::io::Error| format!("file {name} beside the graph: {why}");
        // A link may still lead out of the folder.
        let path = folder.join(location).canonicalize().map_err(failed)?;
        if !path.starts_with(folder.canonicalize().map_err(failed)?) {
            return Err(outside());
        }
        let metadata = path.metadata().map_err(failed)?;
        if !metadata.is_file() {
            return Err(format!("{name} beside the graph is no file"));
        }
        let found = (path, metadata.len());
        self.files.insert(location.to_owned(), found.clone());
        Ok(found)
    }
}

/// Takes the elements of a graph's constants from the files beside it into the graph.
///
/// # Errors
/// Names the constant and what is wrong with its file, or says that together they are too much for one file.
pub(crate) fn embed(graph: &mut GraphProto, folder: Option<&Path>) -> Result<(), String> {
    let mut files = Folder::of(folder);
    let mut bytes = 0_u64;
    for tensor in graph.initializer.iter_mut().filter(|tensor| is_external(tensor)) {
        let item = |why: String| {
            let name = tensor.name.as_deref().unwrap_or_default();
            format!("initializer {}: {why}", quoted(name))
        };
        let element = element_of(tensor).map_err(item)?;
        let places: usize = shape_of(tensor).map_err(item)?.iter().product();
        bytes = bytes.saturating_add((places as u64).saturating_mul(element.size() as u64));
        if bytes >= LONGEST {
            return Err(item(
                "with the constants before it it takes 2 GB or more, too much for one file".into(),
            ));
        }
        let elements = files.read(tensor).map_err(item)?.elements;
        tensor.raw_data = Some(elements.to_bytes().into());
        tensor.data_location = None;
        tensor.external_data.clear();
    }
    Ok(())
}

/// An entry of a tensor's external data.
fn entry<'a>(tensor: &'a TensorProto, key: &str) -> Result<Option<&'a str>, String> {
    let mut entries = tensor.external_data.iter().filter(|entry| entry.key.as_deref() == Some(key));
    match (entries.next(), entries.next()) {
        (found, None) => Ok(found.map(|entry| entry.value.as_deref().unwrap_or_default())),
        (_, Some(_)) => Err(format!("its external data has {key} twice")),
    }
}

fn number(tensor: &TensorProto, key: &str) -> Result<Option<u64>, String> {
    let read = |text: &str| {
        text.parse()
            .map_err(|_| format!("its external data has {key} {}, a count was expected", quoted(text)))
    };
    entry(tensor, key)?.map(read).transpose()
}

/// For tests: the graph of these bytes in a folder, with its constants in a file beside it.
#[cfg(test)]
pub(crate) fn scattered(bytes: &[u8], folder: &Path) -> PathBuf {
    use super::message::{ModelProto, StringStringEntryProto};
    use prost::Message as _;

    let mut model = ModelProto::decode(bytes).expect("a model");
    let mut weights = Vec::new();
    for tensor in &mut model.graph.as_mut().expect("a graph").initializer {
        let elements = TypedTensor::read(tensor).expect("elements").elements.to_bytes();
        let entry =
            |key: &str, value: String| StringStringEntryProto { key: Some(key.into()), value: Some(value) };
        tensor.external_data = vec![
            entry("location", "graph.onnx.data".into()),
            entry("offset", weights.len().to_string()),
            entry("length", elements.len().to_string()),
        ];
        (tensor.data_location, tensor.raw_data) = (Some(1), None);
        tensor.float_data.clear();
        tensor.int64_data.clear();
        weights.extend(elements);
    }
    std::fs::write(folder.join("graph.onnx.data"), weights).expect("a file");
    let path = folder.join("graph.onnx");
    std::fs::write(&path, model.encode_to_vec()).expect("a file");
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::GraphBuilder;
    use crate::onnx::message::StringStringEntryProto;
    use crate::onnx::model::Model;
    use crate::onnx::typed_tensor::Elements;

    fn tensor(entries: &[(&str, &str)]) -> TensorProto {
        let entry = |&(key, value): &(&str, &str)| StringStringEntryProto {
            key: Some(key.into()),
            value: Some(value.into()),
        };
        TensorProto {
            dims: vec![2, 2],
            data_type: Some(1),
            data_location: Some(1),
            external_data: entries.iter().map(entry).collect(),
            ..Default::default()
        }
    }

    /// A folder with a file of 10 numbers in it, and a file beside the folder.
    fn folder() -> tempfile::TempDir {
        let outer = tempfile::tempdir().expect("a folder");
        let inner = outer.path().join("graph");
        std::fs::create_dir(&inner).expect("a folder");
        let bytes: Vec<u8> = (0..10).flat_map(|i| (i as f32).to_le_bytes()).collect();
        std::fs::write(inner.join("w.bin"), &bytes).expect("a file");
        std::fs::write(outer.path().join("secret.bin"), &bytes).expect("a file");
        outer
    }

    #[test]
    fn elements_are_read_from_where_they_lie() {
        let outer = folder();
        let mut files = Folder::of(Some(&outer.path().join("graph")));
        for entries in [
            &[("location", "w.bin"), ("offset", "8"), ("length", "16")][..],
            &[("location", "./w.bin"), ("offset", "8"), ("checksum", "…")],
        ] {
            let read = files.read(&tensor(entries)).expect("elements");
            assert_eq!(read.elements, Elements::F32(vec![2.0, 3.0, 4.0, 5.0]));
        }
    }

    #[test]
    fn what_lies_outside_or_is_not_there_is_refused_by_name() {
        let outer = folder();
        let inner = outer.path().join("graph");
        let absolute = outer.path().join("secret.bin").display().to_string();
        let mut files = Folder::of(Some(&inner));
        let mut why = |entries: &[(&str, &str)]| files.check(&tensor(entries)).expect_err("refused");
        for location in ["../secret.bin", "a/../../secret.bin", &absolute, "..\\secret.bin", ""] {
            let message = why(&[("location", location)]);
            assert!(message.contains("not in the graph's folder"), "{location}: {message}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../secret.bin", inner.join("link.bin")).expect("a link");
            assert!(why(&[("location", "link.bin")]).contains("not in the graph's folder"), "a link out");
            assert!(why(&[("location", ".")]).contains("is no file"), "the folder itself");
        }
        assert!(why(&[("location", "none.bin")]).contains("\"none.bin\" beside the graph"), "missing");
        assert!(why(&[]).contains("no name"), "no location");
        let nowhere = Folder::of(None).check(&tensor(&[("location", "w.bin")])).expect_err("refused");
        assert!(nowhere.contains("in memory"), "{nowhere}");
    }

    #[test]
    fn what_the_file_cannot_hold_is_refused_before_it_is_allocated() {
        let outer = folder();
        let mut files = Folder::of(Some(&outer.path().join("graph")));
        let mut why = |entries: &[(&str, &str)]| {
            let entries = [&[("location", "w.bin")], entries].concat();
            files.check(&tensor(&entries)).expect_err("refused")
        };
        assert!(why(&[("offset", "28")]).contains("16 bytes from 28 on"), "beyond the end");
        assert!(why(&[("offset", "18446744073709551615")]).contains("18446744073709551615"), "overflow");
        assert!(why(&[("length", "12")]).contains("asks for 16 bytes"), "another length");
        assert!(why(&[("offset", "-4")]).contains("a count was expected"), "negative");
        assert!(why(&[("offset", "0"), ("offset", "4")]).contains("twice"), "two of them");
        let huge = TensorProto { dims: vec![1 << 40, 1 << 15], ..tensor(&[("location", "w.bin")]) };
        assert!(files.check(&huge).expect_err("refused").contains("are asked for"), "a petabyte");
    }

    #[test]
    fn a_graph_takes_in_what_lies_beside_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let bytes = GraphBuilder::new(20)
            .input("x", &[2])
            .constant("w", &[2], &[3.0, 4.0])
            .node("Mul", &["x", "w"], &["y"], vec![])
            .output("y")
            .to_bytes();
        let path = scattered(&bytes, folder.path());
        let model = Model::read(&path).expect("a model");
        let embedded = model.embedded().expect("all in one file").into_owned();
        assert_eq!(embedded.folder(), None, "it needs nothing beside it");
        assert_eq!(embedded.constant("w").expect("elements").elements, Elements::F32(vec![3.0, 4.0]));
        std::fs::write(folder.path().join("graph.onnx.data"), [0; 4]).expect("a file");
        let why = model.embedded().expect_err("refused").to_string();
        assert!(why.contains("initializer \"w\"") && why.contains("graph.onnx.data"), "{why}");
    }
}

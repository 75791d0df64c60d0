//! A folder that shows one node's fault to whoever makes the engine, with nothing of the graph around it.
//!
//! ```text
//! NODE/
//!   model.onnx                    the node alone; operands that the graph holds as constants are initialisers
//!   test_data_set_0/input_0.pb    its operands, as the second party had them
//!   test_data_set_0/output_0.pb   what it specifies: the reference's outputs, rounded to their type
//!   test_data_set_0/found_0.pb    what the second party made of them
//!   README.txt                    what this is, and how to run it
//! ```
//!
//! It is the layout of ONNX's backend tests, so ONNX's own runner and those of most engines read it.
//!
//! # Why a new folder and then a rename?
//! A folder is there whole or not at all. One that an earlier audit wrote is replaced; anything else in its place is left
//! alone and is an error.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use prost::Message as _;
use vitruvian_reference::nn::Rounded;

use super::case::Case;
use super::findings::rounded;
use crate::error::{Error, Result};
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::Value;
use crate::onnx::walk;
use crate::onnx::write::{constant, declaration, model_of};

const DATA: &str = "test_data_set_0";

/// Writes the folder of a node under `parent`, named after the node; gives its path.
///
/// `constants` names the operands that the graph holds as constants. Outputs that the second party did not keep are
/// expected all the same.
///
/// # Errors
/// When the reference cannot evaluate the node, a file cannot be written, or something else stands in the folder's place.
pub fn write(parent: &Path, case: &Case, constants: &BTreeSet<String>, party: &str) -> Result<PathBuf> {
    let error =
        |message: String| Error::Onnx { graph: case.name.clone(), item: "reproduction".into(), message };
    let expected = expected(case).map_err(error)?;
    let folder = parent.join(folder_name(&case.name));
    let partial = parent.join(format!(".{}.{}", folder_name(&case.name), std::process::id()));
    let result = fill(&partial, case, constants, &expected, party).and_then(|()| {
        if folder.exists() {
            remove_own(&folder)?;
        }
        at(&folder, std::fs::rename(&partial, &folder))
    });
    if result.is_err() {
        // What is left over is of no use to anyone, and that it cannot be removed is not the error to tell.
        let _ = std::fs::remove_dir_all(&partial);
    }
    result.map(|()| folder)
}

/// The specified outputs in their own types; `None` where the node leaves one out.
fn expected(case: &Case) -> std::result::Result<Vec<Option<TypedTensor>>, String> {
    let operands: Vec<Option<Value<Rounded>>> = case
        .operands
        .iter()
        .map(|operand| operand.as_ref().map(Value::of).transpose())
        .collect::<std::result::Result<_, _>>()?;
    let operands: Vec<Option<&Value<Rounded>>> = operands.iter().map(Option::as_ref).collect();
    let outputs = walk::evaluate(&case.node, case.opset, &operands)?;
    outputs
        .iter()
        .map(|output| match output {
            Some(value) => {
                rounded(value).map(Some).ok_or_else(|| "an output does not fit its type".to_owned())
            }
            None => Ok(None),
        })
        .collect()
}

fn fill(
    folder: &Path,
    case: &Case,
    constants: &BTreeSet<String>,
    expected: &[Option<TypedTensor>],
    party: &str,
) -> Result<()> {
    let data = folder.join(DATA);
    at(&data, std::fs::create_dir_all(&data))?;
    let (mut weights, mut inputs, mut outputs) = (Vec::new(), Vec::new(), Vec::new());
    let mut seen = BTreeSet::new();
    for (name, operand) in case.node.input.iter().zip(&case.operands) {
        let Some(tensor) = operand.as_ref().filter(|_| seen.insert(name)) else { continue };
        if constants.contains(name) {
            weights.push(constant(name, tensor));
        } else {
            file(&data.join(format!("input_{}.pb", inputs.len())), &constant(name, tensor).encode_to_vec())?;
            inputs.push(declaration(name, tensor.element(), &tensor.shape));
        }
    }
    for (k, name) in case.node.output.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        let Some(tensor) = expected.get(k).and_then(Option::as_ref) else { continue };
        let count = outputs.len();
        file(&data.join(format!("output_{count}.pb")), &constant(name, tensor).encode_to_vec())?;
        if let Some(found) = case.found.get(k).and_then(Option::as_ref) {
            file(&data.join(format!("found_{count}.pb")), &constant(name, found).encode_to_vec())?;
        }
        outputs.push(declaration(name, tensor.element(), &tensor.shape));
    }
    let model = model_of(vec![case.node.clone()], weights, inputs, outputs, &[(String::new(), case.opset)]);
    file(&folder.join("model.onnx"), &model)?;
    file(&folder.join("README.txt"), readme(case, party).as_bytes())
}

fn readme(case: &Case, party: &str) -> String {
    let operator = case.node.op_type.as_deref().unwrap_or_default();
    format!(
        "Node {:?} ({operator}, opset {}) alone, in the layout of ONNX's backend tests.\n\n\
         {DATA}/input_*.pb   its operands\n\
         {DATA}/output_*.pb  what it specifies, computed in double precision and rounded\n\
         {DATA}/found_*.pb   what was found, by {party}\n\n\
         To see it, with the Python packages onnx and onnxruntime:\n\n\
         python3 - <<'END'\n\
         import glob, numpy, onnx, onnx.numpy_helper, onnxruntime\n\
         def read(kind):\n\
         \x20   load = lambda k: onnx.load_tensor(f'{DATA}/{{kind}}_{{k}}.pb')\n\
         \x20   return [load(k) for k in range(len(glob.glob(f'{DATA}/{{kind}}_*.pb')))]\n\
         inputs = {{t.name: onnx.numpy_helper.to_array(t) for t in read('input')}}\n\
         options = onnxruntime.SessionOptions()\n\
         options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL\n\
         session = onnxruntime.InferenceSession('model.onnx', options)\n\
         for found, t in zip(session.run(None, inputs), read('output')):\n\
         \x20   expected = onnx.numpy_helper.to_array(t)\n\
         \x20   same = found.shape == expected.shape\n\
         \x20   difference = numpy.abs(found.astype(float) - expected.astype(float)).max() if same and found.size else None\n\
         \x20   print(t.name, found.shape, expected.shape, 'largest difference', difference)\n\
         END\n",
        case.name, case.opset
    )
}

/// A folder's name from a node's: no separators, nothing hidden, not long.
fn folder_name(node: &str) -> String {
    let kept = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let name: String = node.chars().map(kept).take(80).collect();
    let name = name.trim_matches(|c| matches!(c, '.' | '_'));
    if name.is_empty() { "node".to_owned() } else { name.to_owned() }
}

fn at<T>(path: &Path, result: std::io::Result<T>) -> Result<T> {
    result.map_err(|source| Error::Io { path: path.to_owned(), source })
}

fn file(path: &Path, bytes: &[u8]) -> Result<()> {
    at(path, std::fs::write(path, bytes))
}

/// Removes a folder that holds nothing but what is written here.
fn remove_own(folder: &Path) -> Result<()> {
    let own = |name: &str, inside: bool| match inside {
        false => matches!(name, "model.onnx" | "README.txt" | DATA),
        true => {
            ["input_", "output_", "found_"].iter().any(|kind| name.starts_with(kind)) && name.ends_with(".pb")
        }
    };
    for (path, inside) in [(folder.to_owned(), false), (folder.join(DATA), true)] {
        for entry in at(&path, std::fs::read_dir(&path))? {
            let name = at(&path, entry)?.file_name();
            if !name.to_str().is_some_and(|name| own(name, inside)) {
                let why =
                    format!("holds {name:?}, which no audit wrote; name another folder for reproductions");
                return at(&path, Err(std::io::Error::new(std::io::ErrorKind::AlreadyExists, why)));
            }
        }
    }
    at(folder, std::fs::remove_dir_all(folder))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::{OnnxRuntime, Options, audit};
    use crate::onnx::message::TensorProto;
    use crate::onnx::model::Model;
    use crate::suite::audit_faults::scenes::images;
    use std::collections::BTreeMap;

    /// A folder of this test's own, removed at its end.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("vitruvian-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&path).expect("a folder for the test");
            Self(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn read(path: &Path) -> (String, TypedTensor) {
        let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let tensor = TensorProto::decode(bytes.as_slice()).expect("a tensor");
        (tensor.name.clone().unwrap_or_default(), TypedTensor::read(&tensor).expect("elements"))
    }

    /// The strided convolution of a scene, from drawn operands and with an output that is wrong.
    fn wrong_convolution() -> Case {
        let model = images().model;
        let node = model.nodes().iter().find(|node| node.output == ["c3"]).expect("a convolution").clone();
        let drawn = |name: &str, shape: &[usize]| {
            let values = crate::suite::audit_faults::scenes::drawn(name, shape);
            TypedTensor::new(shape, crate::onnx::typed_tensor::Elements::F32(values)).expect("a tensor")
        };
        Case {
            node,
            opset: 21,
            name: "/../encoder/Conv 9".into(),
            operands: vec![Some(drawn("s", &[3, 8, 12, 14])), Some(drawn("w3", &[8, 8, 3, 3]))],
            found: vec![Some(drawn("wrong", &[3, 8, 6, 7]))],
        }
    }

    #[test]
    fn a_reproduction_is_a_graph_that_runs_and_gives_what_is_expected() {
        let (folder, case) = (Folder::new("reproduction"), wrong_convolution());
        let constants = BTreeSet::from(["w3".to_owned()]);
        let written = write(&folder.0, &case, &constants, "an engine").expect("written");
        assert_eq!(written, folder.0.join("encoder_Conv_9"), "inside the folder, whatever the node's name");
        let model = Model::read(&written.join("model.onnx")).expect("a graph");
        assert_eq!((model.inputs(), model.outputs()), (vec!["s"], vec!["c3"]), "its constant is inside");
        let (name, input) = read(&written.join(DATA).join("input_0.pb"));
        assert_eq!((name.as_str(), Some(&input)), ("s", case.operands[0].as_ref()), "the operand");
        let (_, found) = read(&written.join(DATA).join("found_0.pb"));
        assert_eq!(Some(found), case.found[0], "what was found");
        assert!(!written.join(DATA).join("input_1.pb").exists(), "the constant is no input");

        let inputs = BTreeMap::from([("s".to_owned(), input)]);
        let mut party = OnnxRuntime::default();
        let audited =
            audit(&model, &inputs, &mut party, &Options::default(), &mut |_, _, _| ()).expect("an audit");
        assert!(
            audited.first_outside.is_none(),
            "the runtime agrees with the reference: {:?}",
            audited.first_outside
        );
        let (_, expected) = read(&written.join(DATA).join("output_0.pb"));
        assert_eq!(
            Some(&expected.shape),
            audited.nodes[0].tensors.first().map(|tensor| &tensor.shape),
            "output"
        );
    }

    #[test]
    fn a_reproduction_is_replaced_but_never_what_another_wrote() {
        let (folder, case) = (Folder::new("replaced"), wrong_convolution());
        let none = BTreeSet::new();
        let first = write(&folder.0, &case, &none, "an engine").expect("written");
        assert!(first.join(DATA).join("input_1.pb").exists(), "both operands");
        let constants = BTreeSet::from(["w3".to_owned()]);
        assert_eq!(write(&folder.0, &case, &constants, "an engine").expect("again"), first, "the same place");
        assert!(!first.join(DATA).join("input_1.pb").exists(), "of the first nothing is left");
        std::fs::write(first.join("notes.txt"), "mine").expect("a file");
        let message = write(&folder.0, &case, &none, "an engine").expect_err("refused").to_string();
        assert!(message.contains("notes.txt"), "{message}");
        assert!(first.join("notes.txt").exists() && first.join("model.onnx").exists(), "untouched");
        let left: Vec<_> = std::fs::read_dir(&folder.0).expect("the folder").collect();
        assert_eq!(left.len(), 1, "nothing partial is left over: {left:?}");
    }

    #[test]
    fn a_node_that_cannot_be_evaluated_has_no_reproduction() {
        let (folder, mut case) = (Folder::new("refused"), wrong_convolution());
        case.node.op_type = Some("Unheard".into());
        let message =
            write(&folder.0, &case, &BTreeSet::new(), "an engine").expect_err("refused").to_string();
        assert!(message.contains("Unheard"), "{message}");
        assert!(std::fs::read_dir(&folder.0).expect("the folder").next().is_none(), "nothing was written");
    }
}

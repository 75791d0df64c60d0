//! Large files take little memory: weights beside a graph are read one at a time, and messages that would fill the machine
//! are refused before they are made.

#![cfg(target_os = "linux")]

use std::fs::File;

use prost::Message as _;
use vitruvian_conformance::onnx::element::ElementType;
use vitruvian_conformance::onnx::message::{
    GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto, TensorProto,
};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::onnx::write::undeclared;

/// The most memory that this process has had, in bytes.
fn peak() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").expect("a status");
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).expect("a peak");
    1024 * line.split_whitespace().nth(1).and_then(|kb| kb.parse::<usize>().ok()).expect("a number")
}

/// A weight of a million numbers that begins here in `weights.bin`.
fn weight(name: &str, offset: u64) -> TensorProto {
    let entry =
        |key: &str, value: String| StringStringEntryProto { key: Some(key.into()), value: Some(value) };
    TensorProto {
        dims: vec![1000, 1000],
        data_type: Some(ElementType::F32.number()),
        name: Some(name.into()),
        data_location: Some(1),
        external_data: vec![entry("location", "weights.bin".into()), entry("offset", offset.to_string())],
        ..Default::default()
    }
}

// One test, because all tests of a process share its peak.
#[test]
fn a_graph_of_five_gigabytes_and_a_file_of_empty_messages_take_little_memory() {
    const LENGTH: u64 = 5 << 30;
    let folder = tempfile::tempdir().expect("a folder");
    // A file with a hole takes no place.
    File::create(folder.path().join("weights.bin")).and_then(|file| file.set_len(LENGTH)).expect("a file");
    let node = NodeProto {
        input: vec!["first".into(), "last".into()],
        output: vec!["y".into()],
        op_type: Some("Add".into()),
        ..Default::default()
    };
    let graph = GraphProto {
        node: vec![node],
        initializer: vec![weight("first", 0), weight("last", LENGTH - 4_000_000)],
        output: vec![undeclared("y")],
        ..Default::default()
    };
    let opset_import = vec![OperatorSetIdProto { domain: None, version: Some(20) }];
    let file = ModelProto { graph: Some(graph), opset_import, ..Default::default() };
    let path = folder.path().join("model.onnx");
    std::fs::write(&path, file.encode_to_vec()).expect("a file");

    let before = peak();
    let model = Model::read(&path).expect("a model");
    assert!(peak() - before < 1 << 20, "opening takes {} bytes", peak() - before);
    let last = model.constant("last").expect("a weight");
    assert_eq!((last.len(), last.element()), (1_000_000, ElementType::F32));
    assert!(peak() - before < 32 << 20, "a weight of 4 MB takes {} bytes", peak() - before);
    drop((model, last));

    // 40 MB of empty nodes would be 10 GB.
    let empty = [0x0a, 0x00].repeat(20_000_000);
    let mut bytes = vec![0x3a];
    prost::encoding::encode_varint(empty.len() as u64, &mut bytes);
    bytes.extend(&empty);
    drop(empty);
    let (before, length) = (peak().max(bytes.len()), bytes.len());
    let refused = Model::from_bytes("bomb", bytes).expect_err("refused").to_string();
    assert!(refused.contains("in memory"), "{refused}");
    assert!(peak() - before < length, "refusing takes {} bytes", peak() - before);
}

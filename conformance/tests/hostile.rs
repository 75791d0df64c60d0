//! Graphs that somebody made to do harm, or that broke on the way: each is refused in one line that names what is wrong.

use std::path::Path;
use std::time::Duration;

use prost::Message as _;
use vitruvian_conformance::onnx::builder::GraphBuilder;
use vitruvian_conformance::onnx::message::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, ValueInfoProto,
};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::onnx::write::{declaration, undeclared};
use vitruvian_conformance::onnx::{element::ElementType, walk};

/// Why the bytes are refused: one line of moderate length that begins with the file's name.
fn refusal(bytes: Vec<u8>) -> String {
    let message = Model::from_bytes("hostile.onnx", bytes).expect_err("refused").to_string();
    assert!(message.starts_with("hostile.onnx: "), "{message}");
    assert!(message.lines().count() == 1 && message.len() < 600, "{message}");
    message
}

fn node(inputs: &[&str], output: &str) -> NodeProto {
    NodeProto {
        input: inputs.iter().map(|&name| name.into()).collect(),
        output: vec![output.into()],
        op_type: Some("Add".into()),
        ..Default::default()
    }
}

fn model(graph: GraphProto) -> ModelProto {
    ModelProto {
        graph: Some(GraphProto {
            input: vec![declaration("x", ElementType::F32, &[2])],
            output: vec![undeclared("y")],
            ..graph
        }),
        opset_import: vec![OperatorSetIdProto { domain: None, version: Some(20) }],
        ..Default::default()
    }
}

fn file(graph: GraphProto) -> Vec<u8> {
    model(graph).encode_to_vec()
}

fn nodes(node: Vec<NodeProto>) -> Vec<u8> {
    file(GraphProto { node, ..Default::default() })
}

#[test]
fn a_truncated_file_is_refused_wherever_it_ends() {
    let bytes = include_bytes!("foreign/axis_angle_dynamo.onnx");
    for length in (0..bytes.len() - 1).step_by(61) {
        refusal(bytes[..length].to_vec());
    }
}

#[test]
fn what_is_no_model_at_all_is_refused() {
    for bytes in [&b"\x89PNG\r\n\x1a\n"[..], b"", b"ir_version: 8\ngraph {\n}\n", &[0xff; 4096], &[0; 4096]] {
        refusal(bytes.to_vec());
    }
}

#[test]
fn nodes_out_of_order_around_a_cycle_or_from_nowhere_are_named() {
    let cyclic = refusal(nodes(vec![node(&["x", "b"], "a"), node(&["a"], "b"), node(&["b"], "y")]));
    assert!(cyclic.contains("in a cycle: node "), "{cyclic}");
    let unsorted = refusal(nodes(vec![node(&["a"], "y"), node(&["x"], "a")]));
    assert!(unsorted.contains("reads \"a\" before node 1 (Add) makes it; sort the nodes"), "{unsorted}");
    let undefined = refusal(nodes(vec![node(&["x", "nobody's"], "y")]));
    assert!(undefined.contains("nobody"), "{undefined}");
    let twice = refusal(nodes(vec![node(&["x"], "y"), node(&["x"], "y")]));
    assert!(twice.contains("makes \"y\""), "{twice}");
    let nothing = refusal(nodes(vec![node(&["x"], "z")]));
    assert!(nothing.contains("output \"y\": is made by no node"), "{nothing}");
}

#[test]
fn dimensions_that_are_negative_huge_or_not_filled_are_refused_before_anything_is_allocated() {
    let weights = |dims: &[i64]| TensorProto {
        dims: dims.to_vec(),
        data_type: Some(ElementType::F32.number()),
        raw_data: Some(vec![0; 16].into()),
        name: Some("w".into()),
        ..Default::default()
    };
    for dims in [
        &[-1][..],
        &[-2, -2],
        &[i64::MIN],
        &[i64::MAX],
        &[1 << 33, 1 << 33],
        &[1 << 62, 4],
        &[0, 1 << 62, 1 << 62],
        &[1 << 40],
        &[5],
    ] {
        let graph = GraphProto {
            node: vec![node(&["x", "w"], "y")],
            initializer: vec![weights(dims)],
            ..Default::default()
        };
        let message = refusal(file(graph));
        assert!(message.contains("initializer \"w\": shape"), "{message}");
    }
    for side in [usize::MAX, 1 << 62] {
        let mut file = model(GraphProto { node: vec![node(&["x"], "y")], ..Default::default() });
        let graph = file.graph.as_mut().expect("a graph");
        graph.input = vec![declaration("x", ElementType::F32, &[side, 8])];
        let message = refusal(file.encode_to_vec());
        assert!(message.contains("tensor \"x\""), "{message}");
    }
}

#[test]
fn a_small_constant_cannot_ask_for_a_large_output() {
    let asked = |operator: &str, sizes: &[i64]| {
        let bytes = GraphBuilder::new(20)
            .input("x", &[1])
            .integers("sizes", &[sizes.len()], sizes)
            .node(operator, &["x", "sizes"], &["y"], vec![])
            .output("y")
            .to_bytes();
        let model = Model::from_bytes("g", bytes).expect("a model");
        let x = walk::Value::<f64>::from_numbers(
            ElementType::F32,
            vitruvian_reference::nn::Tensor::new(&[1], vec![1.0]),
        );
        let sizes = walk::Value::of(&model.constant("sizes").expect("sizes")).expect("sizes");
        walk::evaluate(&model.nodes()[0], model.opset(), &[Some(&x), Some(&sizes)]).expect_err("refused")
    };
    for (operator, sizes) in [("Expand", &[1 << 31, 1 << 31][..]), ("Tile", &[i64::MAX]), ("Expand", &[-1])] {
        let message = asked(operator, sizes);
        assert!(message.starts_with(operator), "{message}");
    }
}

#[test]
fn external_data_that_lies_or_leaves_the_folder_is_refused_by_name() {
    let outer = tempfile::tempdir().expect("a folder");
    let folder = outer.path().join("graph");
    std::fs::create_dir(&folder).expect("a folder");
    std::fs::write(outer.path().join("secret.bin"), [0; 64]).expect("a file");
    std::fs::write(folder.join("w.bin"), [0; 64]).expect("a file");
    let absolute = outer.path().join("secret.bin").display().to_string();

    let read = |entries: &[(&str, &str)]| {
        let entry = |&(key, value): &(&str, &str)| StringStringEntryProto {
            key: Some(key.into()),
            value: Some(value.into()),
        };
        let weights = TensorProto {
            dims: vec![2, 4],
            data_type: Some(ElementType::F32.number()),
            name: Some("w".into()),
            data_location: Some(1),
            external_data: entries.iter().map(entry).collect(),
            ..Default::default()
        };
        let graph = GraphProto {
            node: vec![node(&["x", "w"], "y")],
            initializer: vec![weights],
            ..Default::default()
        };
        let path = folder.join("model.onnx");
        std::fs::write(&path, file(graph)).expect("a file");
        Model::read(&path)
    };
    assert!(read(&[("location", "w.bin"), ("offset", "32"), ("length", "32")]).is_ok(), "the honest one");
    for (entries, named) in [
        (&[("location", "../secret.bin")][..], "../secret.bin"),
        (&[("location", &absolute)], "secret.bin"),
        (&[("location", "/dev/zero")], "/dev/zero"),
        (&[("location", "missing.bin")], "missing.bin"),
        (&[("location", "w.bin"), ("offset", "33")], "w.bin"),
        (&[("location", "w.bin"), ("offset", "18446744073709551615")], "w.bin"),
        (&[("location", "w.bin"), ("length", "31")], "w.bin"),
        (&[("location", "w.bin"), ("length", "-1")], "length"),
        (&[], "no name"),
    ] {
        let message = read(entries).expect_err("refused").to_string();
        assert!(message.contains("initializer \"w\"") && message.contains(named), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
}

#[test]
fn nesting_without_end_is_refused() {
    let mut graph = GraphProto { node: vec![node(&["x"], "y")], ..Default::default() };
    for _ in 0..200 {
        let attribute = AttributeProto { g: Some(Box::new(graph)), ..Default::default() };
        let branching = NodeProto { attribute: vec![attribute], ..node(&["x"], "y") };
        graph = GraphProto { node: vec![branching], ..Default::default() };
    }
    assert!(refusal(file(graph)).contains("deeper than 100"), "two hundred subgraphs in each other");
}

/// A million nodes, each reading the one before it.
fn chain(count: usize) -> Vec<NodeProto> {
    let name = |k: usize| if k == count { "y".to_owned() } else { format!("t{k}") };
    let first = node(&["x"], &name(1));
    std::iter::once(first).chain((2..=count).map(|k| node(&[&name(k - 1)], &name(k)))).collect()
}

/// What reading a million nodes may take of a processor's time.
const PATIENCE: Duration = Duration::from_secs(5);

/// How long this thread has been computing, whatever else the machine does; nothing where the system does not say.
fn busy() -> Duration {
    let said = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    Duration::from_nanos(
        said.split_whitespace().next().and_then(|nanoseconds| nanoseconds.parse().ok()).unwrap_or(0),
    )
}

#[test]
fn a_million_nodes_are_read_or_refused_in_seconds() {
    let count = 1_000_000;
    let mut sorted = chain(count);
    let bytes = nodes(sorted.clone());
    let begin = busy();
    let read = Model::from_bytes("long", bytes).expect("a model");
    assert_eq!(read.nodes().len(), count);
    drop(read);
    let time = busy() - begin;
    assert!(time < PATIENCE, "read in {time:?}");

    sorted[0].input.push("y".into());
    let bytes = nodes(sorted.clone());
    let begin = busy();
    let cyclic = refusal(bytes);
    assert!(cyclic.contains("1000000 nodes read each other in a cycle"), "{cyclic}");
    let cycle = busy() - begin;
    assert!(cycle < PATIENCE, "a cycle is found in {cycle:?}");

    sorted[0].input.pop();
    sorted.reverse();
    let reversed = refusal(nodes(sorted));
    assert!(reversed.contains("sort the nodes"), "{reversed}");
    println!("read in {time:?}, a cycle found in {cycle:?}");
}

#[test]
fn a_million_inputs_of_one_node_are_read_in_seconds() {
    let names: Vec<String> = (0..1_000_000).map(|k| format!("t{k}")).collect();
    let mut file = model(GraphProto {
        node: vec![node(&names.iter().map(String::as_str).collect::<Vec<_>>(), "y")],
        ..Default::default()
    });
    let value = |name: &String| ValueInfoProto { name: Some(name.clone()), ..Default::default() };
    file.graph.as_mut().expect("a graph").input = names.iter().map(value).collect();
    let bytes = file.encode_to_vec();
    let begin = busy();
    let read = Model::from_bytes("wide", bytes).expect("a model");
    assert_eq!(read.inputs().len(), names.len());
    let time = busy() - begin;
    assert!(time < PATIENCE, "read in {time:?}");
}

#[test]
fn only_the_node_that_is_not_understood_is_refused() {
    // Texts, a sparse tensor and another domain leave the graph readable.
    let texts = TensorProto {
        dims: vec![1],
        data_type: Some(8),
        string_data: vec![vec![b'a'].into()],
        name: Some("words".into()),
        ..Default::default()
    };
    let foreign = NodeProto { domain: Some("com.example".into()), ..node(&["x", "words"], "z") };
    let graph = GraphProto {
        node: vec![foreign, node(&["x", "z"], "y")],
        initializer: vec![texts],
        ..Default::default()
    };
    let model = Model::from_bytes("g", file(graph)).expect("a model");
    let why = model.constant("words").expect_err("refused").to_string();
    assert!(why.contains("initializer \"words\"") && why.contains("string"), "{why}");
    let why = walk::evaluate::<f64>(&model.nodes()[0], 20, &[]).expect_err("refused");
    assert!(why.contains("com.example"), "{why}");
}

#[test]
fn what_is_no_file_is_not_waited_for() {
    for path in ["/dev/zero", "/", "missing.onnx"] {
        assert!(Model::read(Path::new(path)).is_err(), "{path}");
    }
}

use super::*;
use crate::test_graph::{Element, GraphBuilder, Side};

use Side::{Fixed, Free};

/// A VSR query of two feature volumes, without metadata: occupancy is the points' first coordinate.
fn query() -> GraphBuilder {
    let volume = [Fixed(1), Fixed(2), Free("D"), Free("D"), Free("D")];
    GraphBuilder::default()
        .input("features_1", Element::F32, &volume)
        .input("features_2", Element::F32, &volume)
        .input("points", Element::F32, &[Free("P"), Fixed(3)])
        .integers("last", &[1])
        .node(
            "ReduceMean",
            &["points", "last"],
            &["occupancy"],
            &[("keepdims", crate::test_graph::Attribute::Int(0))],
        )
        .output("occupancy", Element::F32, &[Free("P")])
}

const QUERY_KEYS: [(&str, &str); 5] =
    [("kind", "vsr.query"), ("version", "1"), ("align_corners", "false"), ("inside", "1"), ("level", "0.5")];

fn with_keys<'a>(graph: GraphBuilder, keys: impl IntoIterator<Item = (&'a str, &'a str)>) -> GraphBuilder {
    keys.into_iter().fold(graph, |graph, (key, value)| graph.metadata(&format!("vitruvian.{key}"), value))
}

/// An MF-PIFu encoder of one feature map: the images themselves.
fn encoder(size: u64) -> GraphBuilder {
    GraphBuilder::default()
        .input("images", Element::F32, &[Free("N"), Fixed(3), Fixed(size), Fixed(size)])
        .node("Identity", &["images"], &["features_1"], &[])
        .output("features_1", Element::F32, &[Free("N"), Fixed(3), Fixed(size), Fixed(size)])
}

const ENCODER_KEYS: [(&str, &str); 5] = [
    ("kind", "mf-pifu.encoder"),
    ("image_size", "8"),
    ("mean", "0.5, 0.5, 0.25"),
    ("std", "0.5,0.5,1"),
    ("background", "0"),
];

fn contract(graph: &GraphBuilder) -> Result<Contract> {
    Contract::of(&Session::from_bytes("graph.onnx", &graph.to_bytes(), &Settings::default())?)
}

fn complaint(graph: &GraphBuilder) -> String {
    contract(graph).expect_err("a broken contract").to_string()
}

#[test]
fn a_kept_contract_is_read_into_its_type() {
    let expected = Contract::VsrQuery {
        channels: vec![2, 2],
        align_corners: false,
        occupancy: Occupancy { inside_is_one: true, level: 0.5 },
    };
    assert_eq!(contract(&with_keys(query(), QUERY_KEYS)).expect("a kept contract"), expected);
    let expected = Contract::MfPifuEncoder {
        image: ImageInput {
            size: 8,
            normalization: Normalization { mean: [0.5, 0.5, 0.25], std: [0.5, 0.5, 1.0], background: 0.0 },
        },
        channels: vec![3],
    };
    assert_eq!(contract(&with_keys(encoder(8), ENCODER_KEYS)).expect("a kept contract"), expected);
}

#[test]
fn outside_is_one_turns_values_and_level_round() {
    let occupancy = Occupancy { inside_is_one: false, level: 0.25 };
    assert_eq!((occupancy.value(0.125), occupancy.surface_level()), (0.875, 0.75));
}

#[test]
fn every_missing_key_is_named_with_its_fix() {
    for (missing, _) in QUERY_KEYS.into_iter().filter(|(key, _)| *key != "version") {
        let graph = with_keys(query(), QUERY_KEYS.into_iter().filter(|(key, _)| *key != missing));
        let message = complaint(&graph);
        let start = format!("graph.onnx: metadata \"vitruvian.{missing}\": it is missing, expected ");
        assert!(message.starts_with(&start), "{message}");
        assert!(message.ends_with(&format!("write {missing} = … into graph.toml")), "{message}");
    }
}

#[test]
fn every_unreadable_key_is_named_with_what_was_found() {
    for (wrong, value) in [
        ("kind", "vsr.decoder"),
        ("version", "2"),
        ("align_corners", "0"),
        ("inside", "2"),
        ("level", "half"),
        ("level", "NaN"),
    ] {
        let keys = QUERY_KEYS.into_iter().map(|(key, good)| (key, if key == wrong { value } else { good }));
        let message = complaint(&with_keys(query(), keys));
        assert!(
            message.starts_with(&format!("graph.onnx: metadata \"vitruvian.{wrong}\": found ")),
            "{message}"
        );
        assert!(message.contains(value) && message.contains("expected"), "{message}");
    }
}

#[test]
fn every_wrong_tensor_is_named_with_both_shapes() {
    let message = complaint(&with_keys(encoder(16), ENCODER_KEYS));
    assert_eq!(message, "graph.onnx: input \"images\": found f32[N, 3, 16, 16], expected f32[?, 3, 8, 8]");

    let keys = QUERY_KEYS
        .into_iter()
        .map(|(key, value)| if key == "kind" { (key, "mf-pifu.query") } else { (key, value) });
    let message = complaint(&with_keys(query(), keys));
    let expected = "graph.onnx: input \"features_1\": found f32[1, 2, D, D, D], expected f32[?, ?, ?, ?]";
    assert_eq!(message, expected);

    let extra = query().input("noise", Element::F32, &[Fixed(1)]);
    let message = complaint(&with_keys(extra, QUERY_KEYS));
    assert!(message.starts_with("graph.onnx: input \"noise\": the contract has no such input"), "{message}");
}

#[test]
fn a_side_file_gives_what_the_graph_lacks_and_the_graph_wins() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("foreign.onnx");
    std::fs::write(&path, with_keys(encoder(8), [("background", "0.25")]).to_bytes())
        .expect("a writable folder");
    let side = "kind = \"mf-pifu.encoder\"\nimage_size = 8\nmean = [0.5, 0.5, 0.25]\nstd = \"0.5,0.5,1\"\nbackground = 9\n";
    std::fs::write(path.with_extension("toml"), side).expect("a writable folder");
    let graph = Graph::load(&path, Kind::MfPifuEncoder, &Settings::default()).expect("a complete contract");
    let normalization = Normalization { mean: [0.5, 0.5, 0.25], std: [0.5, 0.5, 1.0], background: 0.25 };
    let expected =
        Contract::MfPifuEncoder { image: ImageInput { size: 8, normalization }, channels: vec![3] };
    assert_eq!(graph.contract, expected);

    let message =
        Graph::load(&path, Kind::VsrEncoder, &Settings::default()).expect_err("another kind").to_string();
    assert!(message.contains("expected \"vsr.encoder\", found \"mf-pifu.encoder\""), "{message}");

    std::fs::write(path.with_extension("toml"), "kind = [").expect("a writable folder");
    let message =
        Graph::load(&path, Kind::MfPifuEncoder, &Settings::default()).expect_err("no TOML").to_string();
    assert!(message.contains("foreign.toml: it is not TOML"), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
}

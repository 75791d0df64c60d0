//! `audit`: clean graphs, planted faults, what cannot be compared and what is refused, with their exit status.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;
use vitruvian_conformance::onnx::builder::GraphBuilder;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named};

use crate::command::{Outcome, files, folder, models, vitruvian, word};

/// y = relu(x w + b) and the tensors that a right engine makes of one x.
struct Scene {
    folder: TempDir,
}

const X: [f32; 8] = [0.5, -1.25, 2.0, 0.75, 1.5, -0.125, 0.25, -2.5];

impl Scene {
    fn new() -> Scene {
        let scene = Scene { folder: folder() };
        fs::write(scene.path("net.onnx"), net("MatMul").to_bytes()).expect("a writable folder");
        scene.dump("right.npz", |_| {});
        scene
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes what an engine computes, after `spoil` of the sums.
    fn dump(&self, name: &str, spoil: impl Fn(&mut Vec<f32>)) {
        let products: Vec<f32> = (0..2)
            .flat_map(|row| {
                (0..64).map(move |column| (0..4).map(|k| X[4 * row + k] * weight(k, column)).sum())
            })
            .collect();
        let mut sums: Vec<f32> =
            products.iter().enumerate().map(|(at, product)| product + bias(at % 64)).collect();
        spoil(&mut sums);
        let y: Vec<f32> = sums.iter().map(|sum| sum.max(0.0)).collect();
        let wide: &[usize] = &[2, 64];
        let array = |name, shape, values| Named { name, shape, values: Values::F32(values) };
        let arrays = [
            array("x", &[2, 4], &X),
            array("product", wide, &products),
            array("sum", wide, &sums),
            array("y", wide, &y),
        ];
        npz::write(&self.path(name), &arrays).expect("a writable folder");
    }

    /// Runs with these words, in which @ stands for the scene's folder.
    fn run(&self, words: &[&str]) -> Outcome {
        let root = word(self.folder.path());
        let words: Vec<String> = words.iter().map(|w| w.replace('@', root)).collect();
        vitruvian(&[&["audit".to_owned()], &words[..]].concat())
    }

    /// Runs and checks the refusal: one line, nothing written.
    fn refused(&self, status: i32, words: &[&str], expected: &[&str]) {
        let before = files(self.folder.path());
        let run = self.run(words);
        assert_eq!(run.status, status, "{run:?}");
        assert_eq!(run.err.lines().count(), 1, "one line: {}", run.err);
        for words in expected {
            assert!(run.err.contains(words), "{words:?} in {}", run.err);
        }
        assert!(run.out.is_empty(), "{run:?}");
        assert_eq!(files(self.folder.path()), before, "nothing is left behind");
    }
}

fn weight(k: usize, column: usize) -> f32 {
    ((k * 64 + column) as f32 * 0.37).sin()
}

fn bias(column: usize) -> f32 {
    (column as f32 * 0.11).cos()
}

/// The net with this operator in the product's place.
fn net(product: &str) -> GraphBuilder {
    let weights: Vec<f32> = (0..4).flat_map(|k| (0..64).map(move |column| weight(k, column))).collect();
    let biases: Vec<f32> = (0..64).map(bias).collect();
    GraphBuilder::new(20)
        .input("x", &[2, 4])
        .constant("w", &[4, 64], &weights)
        .constant("b", &[64], &biases)
        .node(product, &["x", "w"], &["product"], vec![])
        .node("Add", &["product", "b"], &["sum"], vec![])
        .node("Relu", &["sum"], &["y"], vec![])
        .output("y")
}

/// The name that the audit gives to the node of an operator, which the builder leaves unnamed.
fn node_of(report: &serde_json::Value, op: &str) -> serde_json::Value {
    let nodes = report["nodes"].as_array().expect("nodes");
    nodes.iter().find(|node| node["op"] == op).expect("the operator")["name"].clone()
}

#[test]
fn a_committed_graph_is_ordinary_rounding_by_onnx_runtime() {
    let graph = models().join("mf_pifu_query.onnx");
    let run = vitruvian(&["audit", word(&graph), "--dim", "N=4", "--dim", "P=50", "--json", "-"]);
    assert_eq!(run.status, 0, "{run:?}");
    let report = run.json();
    assert!(report["verdict"] == "G1" || report["verdict"] == "G0", "{}", report["verdict"]);
    assert!(report["first_outside"].is_null());
    assert_eq!(report["coverage"]["compared"], report["coverage"]["nodes"], "every node is compared");
    assert!(run.err.contains("Is anything outside rounding?"), "the words make way for the JSON");
}

#[test]
fn a_right_dump_is_ordinary_rounding_without_onnx_runtime() {
    let scene = Scene::new();
    let run = Command::new(env!("CARGO_BIN_EXE_vitruvian"))
        .args(["audit", word(&scene.path("net.onnx")), "--runtime"])
        .arg(format!("npz:{}", scene.path("right.npz").display()))
        .env("ORT_DYLIB_PATH", "/nowhere")
        .output()
        .expect("the built command starts");
    let out = String::from_utf8(run.stdout).expect("UTF-8");
    assert_eq!(run.status.code(), Some(0), "{out}{}", String::from_utf8_lossy(&run.stderr));
    for words in
        ["Is anything outside rounding?\n  No", "Where does it start, and why?\n  Nowhere", "3 of 3 nodes"]
    {
        assert!(out.contains(words), "{words:?} in {out}");
    }
    assert!(!out.contains('\u{1b}'), "no colours where there is no terminal");
}

#[test]
fn a_missing_onnx_runtime_is_a_missing_component() {
    let scene = Scene::new();
    let run = Command::new(env!("CARGO_BIN_EXE_vitruvian"))
        .args(["audit", word(&scene.path("net.onnx"))])
        .env("ORT_DYLIB_PATH", "/nowhere")
        .output()
        .expect("the built command starts");
    assert_eq!(run.status.code(), Some(3), "{run:?}");
    let err = String::from_utf8(run.stderr).expect("UTF-8");
    assert!(err.starts_with("error: ONNX Runtime is missing"), "{err}");
}

#[test]
fn a_planted_fault_is_found_at_its_node_in_every_form() {
    let scene = Scene::new();
    scene.dump("scaled.npz", |sums| sums.iter_mut().for_each(|sum| *sum *= 1.001));
    let words = ["@/net.onnx", "--runtime", "npz:@/scaled.npz", "--json", "@/a.json", "--junit", "@/a.xml"];
    let run = scene.run(&[&words[..], &["--html", "@/a.html", "--reproduction", "@/alone"]].concat());
    assert_eq!(run.status, 4, "{run:?}");
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(scene.path("a.json")).expect("a.json")).expect("JSON");
    let node = node_of(&report, "Add");
    assert_eq!(report["schema"], "vitruvian.audit/1");
    assert_eq!(report["verdict"], "G3");
    assert_eq!(report["first_outside"]["node"], node);
    assert_eq!(report["first_outside"]["op"], "Add");
    let verdict = |op: &str| {
        let nodes = report["nodes"].as_array().expect("nodes");
        nodes.iter().find(|node| node["op"] == op).expect("the operator")["verdict"].clone()
    };
    assert_eq!(verdict("Add"), "G3");
    assert_ne!(verdict("Relu"), "G3", "the fault counts where it is made, not where it flows");

    let name = node.as_str().expect("a name");
    assert!(run.out.contains(&format!("At {name} (Add, node 2 of 3)")), "{}", run.out);
    assert!(run.err.lines().any(|line| line.starts_with("error: ") && line.contains(name)), "{}", run.err);

    let alone = report["first_outside"]["reproduction"].as_str().expect("a folder");
    let model = Path::new(alone).join("model.onnx");
    assert!(model.starts_with(scene.path("alone")) && model.is_file(), "{alone}");

    let xml = fs::read_to_string(scene.path("a.xml")).expect("a.xml");
    let xml = roxmltree::Document::parse(&xml).expect("well-formed XML");
    let failed: Vec<_> = xml.descendants().filter(|element| element.has_tag_name("failure")).collect();
    assert_eq!(failed.iter().filter(|failure| failure.attribute("type") == Some("G3")).count(), 1);
    assert_eq!(failed[0].parent().expect("a case").attribute("name"), Some(name));
    let page = fs::read_to_string(scene.path("a.html")).expect("a.html");
    assert!(page.contains("\"verdict\":\"G3\"") && !page.contains("src="));

    let blame = scene.run(&["blame", "@/a.json"]).done();
    assert!(blame.out.starts_with(&format!("{name} (Add): G3")), "{}", blame.out);
    let relu = node_of(&report, "Relu");
    let blame = scene.run(&["blame", "@/a.json", "--node", relu.as_str().expect("a name")]).done();
    assert!(blame.out.contains("(Relu)"), "{}", blame.out);
}

#[test]
fn an_operator_that_nobody_knows_is_not_comparable() {
    let scene = Scene::new();
    fs::write(scene.path("wild.onnx"), net("WildProduct").to_bytes()).expect("writable");
    let run = scene.run(&["@/wild.onnx", "--runtime", "npz:@/right.npz", "--json", "-"]);
    assert_eq!(run.status, 5, "{run:?}");
    let report = run.json();
    assert_eq!(report["verdict"], "not-comparable");
    assert_eq!(report["coverage"]["unsupported"][0]["op"], "WildProduct");
    assert_eq!(report["coverage"]["unsupported"][0]["count"], 1);
    assert!(report["first_outside"].is_null());
    assert!(run.err.contains("WildProduct"), "{}", run.err);
}

#[test]
fn graphs_dumps_and_reports_that_cannot_be_read() {
    let scene = Scene::new();
    let graph = fs::read(scene.path("net.onnx")).expect("the graph");
    fs::write(scene.path("short.onnx"), &graph[..graph.len() / 2]).expect("writable");
    fs::write(scene.path("text.onnx"), "not a graph").expect("writable");
    fs::write(scene.path("text.npz"), "not an archive").expect("writable");
    fs::write(scene.path("text.json"), "{}").expect("writable");
    let dump = ["--runtime", "npz:@/right.npz"];
    scene.refused(2, &[&["@/absent.onnx"], &dump[..]].concat(), &["absent.onnx"]);
    scene.refused(2, &[&["@/short.onnx"], &dump[..]].concat(), &["short.onnx"]);
    scene.refused(2, &[&["@/text.onnx"], &dump[..]].concat(), &["text.onnx"]);
    scene.refused(2, &["@/net.onnx", "--runtime", "npz:@/text.npz"], &["text.npz"]);
    scene.refused(2, &["@/net.onnx", "--runtime", "npz:@/absent.npz"], &["absent.npz"]);
    scene.refused(2, &["@/net.onnx", "--inputs", "@/text.npz"], &["text.npz"]);
    scene.refused(2, &["blame", "@/text.json"], &["text.json", "is not an audit's JSON"]);
    scene.refused(2, &["blame", "@/absent.json"], &["absent.json"]);
}

#[test]
fn files_that_cannot_be_written_are_refused_before_the_work() {
    let scene = Scene::new();
    let dump = ["@/net.onnx", "--runtime", "npz:@/right.npz"];
    let with = |more: &[&'static str]| [&dump[..], more].concat();
    scene.refused(2, &with(&["--html", "@/absent/a.html"]), &["absent", "does not exist"]);
    scene.refused(2, &with(&["--json", "@"]), &["is a folder"]);
    scene.refused(2, &with(&["--junit", "-"]), &["only --json"]);
}

#[test]
fn words_that_make_no_sense_are_usage() {
    let scene = Scene::new();
    for words in [
        &[][..],
        &["@/net.onnx", "--runtime", "abacus"],
        &["@/net.onnx", "--dim", "N"],
        &["@/net.onnx", "diff"],
    ] {
        let run = scene.run(words);
        assert_eq!(run.status, 2, "{words:?}: {run:?}");
    }
}

#[test]
fn a_graph_of_open_lengths_says_what_to_give() {
    let graph: &Path = &models().join("mf_pifu_query.onnx");
    let run = vitruvian(&["audit", word(graph)]);
    assert_eq!(run.status, 2, "{run:?}");
    assert!(run.err.contains("--dim "), "{}", run.err);
}

//! Whole graphs: clean ones, and faults planted in what a second party left.

use std::collections::BTreeMap;
use std::path::Path;

use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named};

use super::*;
use crate::onnx::builder::{GraphBuilder, float, int, ints};
use crate::onnx::typed_tensor::Elements;
use report::{Grade, NodeReport};

type Named32 = BTreeMap<String, TypedTensor>;

fn exported(name: &str) -> Model {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/exported");
    Model::read(&folder.join(name)).expect("a committed graph")
}

fn drawn(model: &Model, dimensions: &[(&str, usize)]) -> Named32 {
    let dimensions = dimensions.iter().map(|&(symbol, length)| (symbol.to_owned(), length)).collect();
    inputs::draw(model, 1, &dimensions).expect("inputs").0
}

fn run(model: &Model, inputs: &Named32, party: &mut dyn Party) -> Audit {
    audit(model, inputs, party, &Options::default(), &mut |_, _, _| ()).expect("an audit")
}

fn outside(audit: &Audit) -> String {
    let lines =
        audit.nodes.iter().filter(|node| node.verdict > Grade::G1).map(|node| {
            format!("{} {} {:?} {:?}\n", node.name, node.verdict, node.why, node.tensors.first())
        });
    lines.collect()
}

/// What another engine left, in memory.
struct Left(Named32);

impl Party for Left {
    fn describe(&self) -> String {
        "what was left".into()
    }

    fn segment(&mut self, model: &Model, first: usize, _: &Tensors) -> Result<Segment> {
        let mut segment = Segment { nodes: first..model.nodes().len(), ..Segment::default() };
        for name in model.intermediates() {
            match self.0.get(name) {
                Some(tensor) => segment.tensors.insert(name.to_owned(), tensor.clone()).is_none(),
                None => segment.missing.insert(name.to_owned(), "it was not left".into()).is_none(),
            };
        }
        Ok(segment)
    }
}

/// Everything that ONNX Runtime computes.
fn recorded(model: &Model, inputs: &Named32) -> Named32 {
    let mut held = given(model, inputs).expect("inputs");
    let mut tensors = Named32::new();
    let mut party = OnnxRuntime::default();
    let mut next = 0;
    while next < model.nodes().len() {
        let segment = party.segment(model, next, &held).expect("ONNX Runtime");
        next = segment.nodes.end;
        for (name, tensor) in segment.tensors {
            held.insert(name.clone(), Held::Given(Arc::new(tensor.clone())));
            tensors.insert(name, tensor);
        }
    }
    tensors
}

fn f32s<'a>(tensors: &'a mut Named32, name: &str) -> &'a mut Vec<f32> {
    match &mut tensors.get_mut(name).expect("a tensor").elements {
        Elements::F32(v) => v,
        other => panic!("{other:?} is not f32"),
    }
}

/// Conv → Relu → Conv → MaxPool → Conv, with waves for weights.
fn network() -> Model {
    let wave = |count: usize, phase: f32| -> Vec<f32> {
        (0..count).map(|i| ((i as f32 + phase) * 12.9898).sin() / 4.0).collect()
    };
    let pads = || vec![ints("pads", &[1, 1, 1, 1])];
    let bytes = GraphBuilder::new(20)
        .input("x", &[1, 4, 24, 24])
        .constant("w1", &[8, 4, 3, 3], &wave(288, 1.0))
        .constant("b1", &[8], &wave(8, 2.0))
        .constant("w2", &[32, 8, 3, 3], &wave(2304, 3.0))
        .constant("w3", &[8, 32, 3, 3], &wave(2304, 4.0))
        .node("Conv", &["x", "w1", "b1"], &["c1"], pads())
        .node("Relu", &["c1"], &["r1"], vec![])
        .node("Conv", &["r1", "w2"], &["c2"], pads())
        .node("MaxPool", &["c2"], &["m2"], vec![ints("kernel_shape", &[2, 2]), ints("strides", &[2, 2])])
        .node("Conv", &["m2", "w3"], &["y"], pads())
        .output("y")
        .to_bytes();
    Model::from_bytes("network", bytes).expect("a model")
}

fn node<'a>(audit: &'a Audit, output: &str) -> &'a NodeReport {
    audit.nodes.iter().find(|node| node.outputs[0] == output).expect("a node")
}

#[test]
fn the_committed_graphs_are_within_rounding() {
    let sides: [(&str, &[(&str, usize)]); 5] = [
        ("mf_pifu_encoder.onnx", &[("N", 1)]),
        ("mf_pifu_query.onnx", &[("N", 2), ("P", 50)]),
        ("vsr_encoder.onnx", &[("D", 16)]),
        ("vsr_query.onnx", &[("D", 16), ("P", 100)]),
        ("regressor.onnx", &[("N", 1)]),
    ];
    for (name, dimensions) in sides {
        let model = exported(name);
        let inputs = drawn(&model, dimensions);
        let options = Options { effort: 2e8, chain: 1e7, ..Options::default() };
        let audit = audit(&model, &inputs, &mut OnnxRuntime::default(), &options, &mut |_, _, _| ());
        let audit = audit.expect("an audit");
        println!("{name}: {} {:?} {:.1} s", audit.verdict, audit.coverage, audit.seconds);
        assert!(audit.verdict <= Grade::G1, "{name}: {}", outside(&audit));
        assert_eq!(audit.coverage.compared, audit.coverage.nodes, "{name}");
        assert_eq!(audit.first_outside, None, "{name}");
    }
}

#[test]
fn a_factor_is_found_at_its_node_however_small() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let clean = recorded(&model, &inputs);
    let audit = run(&model, &inputs, &mut Left(clean.clone()));
    assert!(audit.verdict <= Grade::G1, "{}", outside(&audit));
    for (factor, tensor) in [(1.0005, "c1"), (1.000_001, "c2"), (1.0005, "y"), (1.000_001, "r1")] {
        let mut faulty = clean.clone();
        f32s(&mut faulty, tensor).iter_mut().for_each(|x| *x = (f64::from(*x) * factor) as f32);
        let audit = run(&model, &inputs, &mut Left(faulty));
        assert!(node(&audit, tensor).verdict >= Grade::G2, "{tensor} × {factor}: {:?}", node(&audit, tensor));
        let first = audit.first_outside.clone().expect("a node outside");
        if node_is_different(&audit.nodes, tensor) {
            assert_eq!(first.outputs, [tensor], "× {factor}");
        }
    }
}

fn node_is_different(nodes: &[NodeReport], output: &str) -> bool {
    nodes.iter().any(|node| node.outputs[0] == output && node.verdict == Grade::G3)
}

#[test]
fn the_first_nan_counts() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let mut faulty = recorded(&model, &inputs);
    f32s(&mut faulty, "c2")[100] = f32::NAN;
    let audit = run(&model, &inputs, &mut Left(faulty));
    assert_eq!(audit.verdict, Grade::G3);
    let first = audit.first_outside.clone().expect("a node outside");
    assert_eq!((first.outputs, &first.worst[0].index[..]), (vec!["c2".to_owned()], &[0, 0, 4, 4][..]));
    assert_eq!(node(&audit, "c2").tensors[0].special.nan_found, 1);
}

#[test]
fn a_tensor_of_another_shape_is_different_and_nothing_else_stops() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let mut faulty = recorded(&model, &inputs);
    let c2 = &faulty["c2"];
    let narrow = TypedTensor { shape: vec![1, 32, 24, 12], elements: Elements::F32(vec![0.0; 32 * 24 * 12]) };
    assert_ne!(c2.shape, narrow.shape);
    faulty.insert("c2".into(), narrow);
    let audit = run(&model, &inputs, &mut Left(faulty));
    let node = node(&audit, "c2");
    assert_eq!((node.verdict, node.tensors[0].csu_max), (Grade::G3, None));
    assert!(node.why.as_ref().is_some_and(|why| why.contains("expected [1, 32, 24, 24]")), "{:?}", node.why);
    assert_eq!(audit.nodes.len(), 5, "the nodes after it are judged too");
}

#[test]
fn nodes_whose_tensors_are_missing_are_judged_with_the_next() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let mut sparse = recorded(&model, &inputs);
    sparse.remove("r1");
    let audit = run(&model, &inputs, &mut Left(sparse.clone()));
    assert!(audit.verdict <= Grade::G1, "{}", outside(&audit));
    assert_eq!(audit.coverage.missing, ["r1"]);
    assert_eq!(node(&audit, "r1").why.as_deref(), Some("judged together with Conv_2"));

    f32s(&mut sparse, "c2")[7] += 0.01;
    let audit = run(&model, &inputs, &mut Left(sparse));
    assert_eq!(
        audit.first_outside.clone().expect("a node outside").outputs,
        ["c2"],
        "a fault behind a missing tensor"
    );
    assert_eq!(node_verdict(&audit.nodes, "r1"), Grade::NotComparable, "nobody knows which of the two");
}

#[test]
fn an_operand_that_does_not_fit_is_said_of_a_large_node_too() {
    let operand = |name: &str, shape: &[usize]| cases_for_tests::numbers(name, shape);
    let mut case = cases_for_tests::case(
        "InstanceNormalization",
        vec![operand("x", &[1, 4, 160, 160]), operand("scale", &[4]), operand("bias", &[4])],
        vec![],
    );
    assert!(judge(&case, 1e9).verdict <= Grade::G1, "right");
    case.operands[1] = operand("none", &[0]);
    let judgement = judge(&case, 1e9);
    assert_eq!(judgement.verdict, Grade::NotComparable);
    assert!(judgement.why.as_ref().is_some_and(|why| why.contains("shape [0]")), "{:?}", judgement.why);
}

/// Eight layers of Conv → InstanceNormalization → Relu and a Softmax: deep enough that no bound reaches its end. An attribute
/// of the fourth normalisation, and of it alone, may be another; and the end may be multiplied.
fn deep(epsilon: f32, factor: Option<f32>) -> Model {
    let wave = |count: usize, phase: f32| -> Vec<f32> {
        (0..count).map(|i| ((i as f32 + phase) * 12.9898).sin() / 4.0).collect()
    };
    let mut graph = GraphBuilder::new(20)
        .input("x", &[1, 8, 16, 16])
        .constant("scale", &[8], &[1.0; 8])
        .constant("bias", &[8], &wave(8, 5.0))
        .constant("factor", &[], &[factor.unwrap_or(1.0)]);
    for layer in 0..8 {
        let name = |what: &str| format!("{what}{layer}");
        let from = if layer == 0 { "x".to_owned() } else { format!("r{}", layer - 1) };
        let epsilon = if layer == 3 { epsilon } else { 1e-5 };
        graph = graph
            .constant(&name("w"), &[8, 8, 3, 3], &wave(576, layer as f32))
            .node("Conv", &[&from, &name("w")], &[&name("c")], vec![ints("pads", &[1, 1, 1, 1])])
            .node(
                "InstanceNormalization",
                &[&name("c"), "scale", "bias"],
                &[&name("n")],
                vec![float("epsilon", epsilon)],
            )
            .node("Relu", &[&name("n")], &[&name("r")], vec![]);
    }
    let end = if factor.is_some() { "s" } else { "y" };
    graph = graph.node("Softmax", &["r7"], &[end], vec![int("axis", 1)]);
    if factor.is_some() {
        graph = graph.node("Mul", &["s", "factor"], &["y"], vec![]);
    }
    Model::from_bytes("deep", graph.output("y").to_bytes()).expect("a model")
}

#[test]
fn a_graph_of_which_only_the_output_was_kept_is_judged_by_drawn_roundings() {
    let model = deep(1e-5, None);
    let inputs = drawn(&model, &[]);
    let only_output = |engine: &Model| {
        let mut left = recorded(engine, &inputs);
        left.retain(|name, _| name == "y");
        run(&model, &inputs, &mut Left(left))
    };
    let clean = only_output(&model);
    assert_eq!((clean.verdict, clean.coverage.compared), (Grade::G1, 25), "{}", outside(&clean));
    assert!(clean.notes.iter().any(|note| note.contains("evidence, not proof")), "{:?}", clean.notes);

    // The normalisation behind it takes most of a wrong epsilon away again.
    let epsilon = only_output(&deep(1e-3, None));
    assert_eq!(epsilon.verdict, Grade::G2, "{}", outside(&epsilon));
    let factor = only_output(&deep(1e-5, Some(1.001)));
    assert_eq!((factor.verdict, factor.coverage.compared), (Grade::G3, 1), "{}", outside(&factor));
    for audit in [epsilon, factor] {
        assert_eq!(audit.first_outside.expect("a node outside").outputs, ["y"], "where it was seen");
    }
}

fn node_verdict(nodes: &[NodeReport], output: &str) -> Grade {
    nodes.iter().find(|node| node.outputs[0] == output).expect("a node").verdict
}

#[test]
fn the_end_of_a_graph_that_was_not_kept_is_not_comparable() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let mut sparse = recorded(&model, &inputs);
    sparse.remove("y");
    let audit = run(&model, &inputs, &mut Left(sparse));
    assert_eq!(audit.verdict, Grade::NotComparable);
    assert_eq!((audit.coverage.nodes, audit.coverage.compared), (5, 4));
}

#[test]
fn chains_of_f16_may_keep_what_they_round_only_at_the_end() {
    let bytes = GraphBuilder::new(20)
        .input("x", &[1, 4000])
        .input("z", &[1, 4000])
        .node("Cast", &["x"], &["a"], vec![int("to", 10)])
        .node("Cast", &["z"], &["b"], vec![int("to", 10)])
        .node("Mul", &["a", "b"], &["c"], vec![])
        .node("Add", &["c", "b"], &["d"], vec![])
        .node("Tanh", &["d"], &["e"], vec![])
        .node("Cast", &["e"], &["y"], vec![int("to", 1)])
        .output("y")
        .to_bytes();
    let model = Model::from_bytes("half", bytes).expect("a model");
    let inputs = drawn(&model, &[]);
    let audit = run(&model, &inputs, &mut OnnxRuntime::default());
    assert!(audit.verdict <= Grade::G1, "{}", outside(&audit));
    assert_eq!(node(&audit, "d").tensors[0].element, "f16");

    let mut faulty = recorded(&model, &inputs);
    let Elements::F16(d) = &mut faulty.get_mut("d").expect("a tensor").elements else { panic!("f16") };
    d[9] = half::f16::from_f32(d[9].to_f32() * 1.01 + 0.01);
    let audit = run(&model, &inputs, &mut Left(faulty));
    assert_eq!(audit.first_outside.clone().expect("a node outside").outputs, ["d"]);
}

#[test]
fn a_sample_of_a_convolution_finds_a_fault_at_the_border_alone() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let clean = recorded(&model, &inputs);
    let case = |c2: &TypedTensor| Case {
        node: model.nodes()[2].clone(),
        opset: 20,
        name: "Conv_2".into(),
        operands: vec![Some(clean["r1"].clone()), Some(model.constants().expect("constants")["w2"].clone())],
        found: vec![Some(c2.clone())],
    };
    let effort = 200_000.0;
    let judgement = judge(&case(&clean["c2"]), effort);
    let report = &judgement.tensors[0];
    assert!(judgement.verdict <= Grade::G1, "{report:?}");
    assert!(report.compared < report.elements, "a sample: {} of {}", report.compared, report.elements);
    let sample = report.sample.as_ref().expect("a sample is stated");
    assert!(sample.contains("corners") && sample.contains("escapes with probability"), "{sample}");

    let mut faulty = clean["c2"].clone();
    let Elements::F32(v) = &mut faulty.elements else { panic!("f32") };
    // The first row of every channel, as another kind of padding would leave it.
    v.chunks_mut(24 * 24).for_each(|channel| channel[..24].iter_mut().for_each(|x| *x += 0.125));
    let judgement = judge(&case(&faulty), effort);
    assert_eq!(judgement.verdict, Grade::G3, "{:?}", judgement.tensors[0]);
    assert_eq!(judgement.worst[0].index[2], 0, "in the first row");
}

#[test]
fn a_dump_is_read_by_the_names_of_the_tensors() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let mut tensors = recorded(&model, &inputs);
    tensors.extend(inputs.clone());
    let folder = std::env::temp_dir().join(format!("vitruvian-dump-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("dump.npz");
    let write = |tensors: &Named32| {
        let arrays: Vec<Named> = tensors
            .iter()
            .map(|(name, tensor)| {
                let Elements::F32(v) = &tensor.elements else { panic!("f32") };
                Named { name, shape: &tensor.shape, values: Values::F32(v) }
            })
            .collect();
        npz::write(&path, &arrays).expect("a file");
    };
    let stray = TypedTensor { shape: vec![1], elements: Elements::F32(vec![1.0]) };
    tensors.insert("stray".into(), stray);
    write(&tensors);
    let mut dump = Dump::open(&path, &model).expect("a dump");
    let given = dump.inputs(&model).expect("inputs");
    assert_eq!(given, inputs, "the inputs are in the dump");
    let audit = run(&model, &given, &mut dump);
    assert!(audit.verdict <= Grade::G1, "{}", outside(&audit));
    assert_eq!(audit.coverage.unmatched, ["stray"]);
    assert!(audit.runtime.starts_with("npz:"), "{}", audit.runtime);

    f32s(&mut tensors, "m2")[3] += 1.0;
    write(&tensors);
    let audit = run(&model, &inputs, &mut Dump::open(&path, &model).expect("a dump"));
    assert_eq!(audit.first_outside.clone().expect("a node outside").outputs, ["m2"]);
    std::fs::remove_dir_all(&folder).expect("the folder");
}

#[test]
fn the_chain_states_what_came_together_on_the_way() {
    let model = network();
    let inputs = drawn(&model, &[]);
    let audit = run(&model, &inputs, &mut OnnxRuntime::default());
    let output = &audit.outputs[0];
    let (cumulative, floor) = (output.cumulative_rms.expect("a chain"), output.noise_floor.expect("a chain"));
    assert!(cumulative > 0.0 && cumulative < 10.0 * floor, "{output:?}");
    let y = &node(&audit, "y").tensors[0];
    assert!(y.propagated.is_some() && y.amplification.is_some(), "{y:?}");
    let short = Options { chain: 0.0, ..Options::default() };
    let audit = super::audit(&model, &inputs, &mut OnnxRuntime::default(), &short, &mut |_, _, _| ());
    let audit = audit.expect("an audit");
    assert_eq!(audit.outputs[0].cumulative, None);
    assert!(audit.notes.iter().any(|note| note.contains("end to end")), "{:?}", audit.notes);
}

#[test]
fn an_input_that_is_missing_or_unknown_is_named() {
    let model = network();
    let none = BTreeMap::new();
    let refused = |inputs: &Named32| {
        let outcome =
            audit(&model, inputs, &mut Left(Named32::new()), &Options::default(), &mut |_, _, _| ());
        outcome.expect_err("refused").to_string()
    };
    assert!(refused(&none).contains("input \"x\": is not given"), "{}", refused(&none));
    let mut more = drawn(&model, &[]);
    more.insert("image".into(), more["x"].clone());
    assert!(refused(&more).contains("input \"image\""), "{}", refused(&more));
    let open =
        inputs::draw(&exported("vsr_query.onnx"), 1, &BTreeMap::new()).expect_err("refused").to_string();
    assert!(open.contains("--dim D=1") && open.contains("--dim P=1"), "{open}");
}

#[test]
fn the_thesis_size_encoders_are_judged_by_a_stated_sample() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/exported/thesis/random");
    if std::env::var_os("VITRUVIAN_THESIS").is_none() || !folder.is_dir() {
        eprintln!("not judged: set VITRUVIAN_THESIS=1 after `make thesis`; it takes a minute and 2.5 GB");
        return;
    }
    let sides: [(&str, &[(&str, usize)]); 2] =
        [("mf_pifu_encoder.onnx", &[("N", 4)]), ("vsr_encoder.onnx", &[("D", 128)])];
    for (name, dimensions) in sides {
        let model = Model::read(&folder.join(name)).expect("a graph");
        let audit = run(&model, &drawn(&model, dimensions), &mut OnnxRuntime::default());
        let judging: f64 = audit.nodes.iter().map(|node| node.seconds).sum();
        println!("{name}: {} {:?}", audit.verdict, audit.coverage);
        println!("{:.1} s, of which {judging:.1} s of cores in judging; {:?}", audit.seconds, audit.notes);
        let mut slowest: Vec<&NodeReport> = audit.nodes.iter().collect();
        slowest.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
        for node in &slowest[..8] {
            let tensor = &node.tensors[0];
            println!(
                "{} {:.2} s {:?} {} of {}",
                node.op, node.seconds, tensor.shape, tensor.compared, tensor.elements
            );
        }
        assert!(audit.verdict <= Grade::G1, "{name}: {}", outside(&audit));
    }
}

//! Whole graphs: clean ones, and faults planted in what a second party left.

use std::path::Path;

use super::*;
use report::Grade;

fn exported(name: &str) -> Model {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/exported");
    Model::read(&folder.join(name)).expect("a committed graph")
}

fn drawn(model: &Model, dimensions: &[(&str, usize)]) -> BTreeMap<String, TypedTensor> {
    let dimensions = dimensions.iter().map(|&(symbol, length)| (symbol.to_owned(), length)).collect();
    inputs::draw(model, 1, &dimensions).expect("inputs").0
}

fn run(model: &Model, inputs: &BTreeMap<String, TypedTensor>, party: &mut dyn Party) -> Audit {
    audit(model, inputs, party, &Options::default(), &mut |_, _, _| ()).expect("an audit")
}

fn outside(audit: &Audit) -> String {
    let lines = audit.nodes.iter().filter(|node| node.verdict > Grade::G1).map(|node| {
        let tensor = node.tensors.first();
        format!("{} {} {:?} {:?}\n", node.name, node.verdict, node.why, tensor)
    });
    lines.collect()
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
        let audit = run(&model, &inputs, &mut OnnxRuntime::default());
        println!("{name}: {} {:?} {:.1} s", audit.verdict, audit.coverage, audit.seconds);
        assert!(audit.verdict <= Grade::G1, "{name}: {}", outside(&audit));
        assert_eq!(audit.coverage.compared, audit.coverage.nodes, "{name}");
    }
}

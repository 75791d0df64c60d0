//! Sessions that are fused, changed, and right.

use super::*;
use crate::onnx::builder::{GraphBuilder, int, ints};
use crate::onnx::external::scattered;
use crate::onnx::typed_tensor::Elements;
use crate::problem::values::Values;

fn inputs(shape: &[usize]) -> BTreeMap<String, TypedTensor> {
    let x = Values::ordinary(7).fill(shape);
    let tensor = TypedTensor::new(shape, Elements::F32(x.values)).expect("a tensor");
    BTreeMap::from([("x".to_owned(), tensor)])
}

/// y = Relu(Conv(x)) + 1, which ONNX Runtime fuses, with an Identity that it removes.
fn fused() -> Model {
    let w = Values::ordinary(1).fill(&[16, 16, 3, 3]);
    let bytes = GraphBuilder::new(17)
        .input("x", &[1, 16, 6, 6])
        .constant("w", &[16, 16, 3, 3], &w.values)
        .constant("one", &[1], &[1.0])
        .node("Identity", &["x"], &["same"], vec![])
        .node("Conv", &["same", "w"], &["c"], vec![ints("pads", &[1, 1, 1, 1]), int("group", 1)])
        .node("Relu", &["c"], &["r"], vec![])
        .node("Add", &["r", "one"], &["y"], vec![])
        .output("y")
        .to_bytes();
    Model::from_bytes("fused.onnx", bytes).expect("a model")
}

fn audited(model: &Model, inputs: &BTreeMap<String, TypedTensor>) -> ShippedReport {
    let mut party = super::super::OnnxRuntime { threads: 1, ..Default::default() };
    let audit = audit(model, inputs, &mut party, &Options::default(), &mut |_, _, _| ()).expect("an audit");
    audit.shipped.expect("the session as shipped")
}

#[test]
fn weights_may_lie_beside_the_graph() {
    let folder = tempfile::tempdir().expect("a folder");
    let scattered = Model::read(&scattered(fused().bytes(), folder.path())).expect("a model");
    let inputs = inputs(&[1, 16, 6, 6]);
    assert_eq!(audited(&scattered, &inputs), audited(&fused(), &inputs));
}

#[test]
fn what_is_fused_is_judged_through_the_tensors_that_survive() {
    let report = audited(&fused(), &inputs(&[1, 16, 6, 6]));
    assert!(report.verdict <= Grade::G1, "{report:?}");
    assert!(report.nodes.1 < report.nodes.0 || !report.operators.is_empty(), "{report:?}");
    let names: Vec<&str> = report.tensors.iter().map(|tensor| tensor.name.as_str()).collect();
    assert!(names.contains(&"y") && !names.contains(&"same"), "{names:?}");
    for tensor in report.tensors.iter().filter(|tensor| !tensor.identical) {
        assert!(tensor.changed_at.is_some(), "{tensor:?}");
    }
    for operator in &report.operators {
        assert!(operator.meaning.is_some(), "{operator:?}");
    }
    assert!(report.notes.is_empty(), "{:?}", report.notes);
}

#[test]
fn a_graph_that_nothing_changes_keeps_the_verdicts_of_the_first_audit() {
    let bytes = GraphBuilder::new(17).input("x", &[2, 3]).node("Neg", &["x"], &["y"], vec![]).output("y");
    let model = Model::from_bytes("neg.onnx", bytes.to_bytes()).expect("a model");
    let report = audited(&model, &inputs(&[2, 3]));
    let [tensor] = &report.tensors[..] else { panic!("{report:?}") };
    assert!(tensor.identical && tensor.verdict == Grade::G0 && tensor.changed_at.is_none(), "{tensor:?}");
}

#[test]
fn a_stale_tensor_of_the_optimiser_is_outside_rounding() {
    let (model, inputs) = (fused(), inputs(&[1, 16, 6, 6]));
    let held = Inputs::new(&inputs).expect("inputs");
    let (mut outputs, _) = ship(&model, &held, Optimization::All, 1).expect("a session");
    let Some(Elements::F32(y)) = outputs.get_mut("y").map(|y| &mut y.elements) else { panic!("f32") };
    y.iter_mut().for_each(|y| *y *= 1.001);
    let mut tensors = vec![ShippedTensor {
        name: "y".into(),
        identical: false,
        abs_max: None,
        verdict: Grade::NotComparable,
        changed_at: None,
        why: None,
    }];
    judge(&model, &inputs, &[], outputs, &mut tensors, &mut Vec::new()).expect("judged");
    assert_eq!(tensors[0].verdict, Grade::G3, "three nodes together, and still seen");
}

#[test]
fn a_difference_that_is_no_number_is_none() {
    let tensor = |values: &[f32]| TypedTensor::new(&[values.len()], Elements::F32(values.to_vec()));
    let difference = |a: &[f32], b: &[f32]| {
        largest_difference(&tensor(a).expect("a tensor"), &tensor(b).expect("a tensor"))
    };
    assert_eq!(difference(&[1.0, f32::INFINITY], &[1.5, f32::INFINITY]), Some(0.5));
    assert_eq!(difference(&[1.0], &[f32::NAN]), None);
    assert_eq!(difference(&[1.0], &[1.0, 2.0]), None, "shapes");
}

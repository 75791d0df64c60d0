//! A graph is run by name; whatever does not fit it is refused with its name and the tensor's.

use super::*;
use crate::test_graph::{Element, GraphBuilder, Side};
use ndarray::{Array1, Array2, array};

/// sum [N, 2] = a + b, with N free, and index i64[1], which is passed through.
fn adder() -> Vec<u8> {
    let n = || Side::Free("N");
    GraphBuilder::default()
        .metadata("vitruvian.kind", "adder")
        .input("a", Element::F32, &[n(), Side::Fixed(2)])
        .input("b", Element::F32, &[n(), Side::Fixed(2)])
        .input("index", Element::I64, &[Side::Fixed(1)])
        .node("Add", &["a", "b"], &["sum"], &[])
        .node("Identity", &["index"], &["same"], &[])
        .output("sum", Element::F32, &[n(), Side::Fixed(2)])
        .output("same", Element::I64, &[Side::Fixed(1)])
        .to_bytes()
}

fn load(bytes: &[u8]) -> Session {
    Session::from_bytes("adder.onnx", bytes, &Settings::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// The message of the error that giving these inputs raises.
fn complaint(inputs: &[(&str, Input)], outputs: &[&str]) -> String {
    load(&adder()).run(inputs, outputs).expect_err("a wrong call").to_string()
}

#[test]
fn a_graph_tells_its_tensors_and_metadata() {
    let session = load(&adder());
    let signatures: Vec<_> = session.inputs().iter().map(|info| (&*info.name, info.signature())).collect();
    let expected = [("a", "f32[N, 2]"), ("b", "f32[N, 2]"), ("index", "i64[1]")];
    assert_eq!(signatures, expected.map(|(name, signature)| (name, signature.to_string())));
    assert_eq!(session.metadata()["vitruvian.kind"], "adder");
}

#[test]
fn outputs_come_in_the_order_asked_for_and_feed_the_next_run() {
    let mut session = load(&adder());
    let (a, b, index) =
        (array![[1.0_f32, 2.0], [3.0, 4.0]], array![[10.0_f32, 20.0], [30.0, 40.0]], array![7_i64]);
    let inputs = [("index", (&index).into()), ("b", (&b).into()), ("a", (&a).into())];
    let values = session.run(&inputs, &["same", "sum"]).expect("valid inputs");
    assert_eq!(values[0].i64().expect("i64"), index.view().into_dyn());
    assert_eq!(values[1].f32().expect("f32"), (&a + &b).view().into_dyn());
    assert!(values[0].f32().is_err(), "i64 is not read as f32");

    let again = session
        .run(&[("a", (&values[1]).into()), ("b", (&b).into()), ("index", (&values[0]).into())], &["sum"]);
    assert_eq!(again.expect("valid inputs")[0].f32().expect("f32"), (&a + &b + &b).view().into_dyn());
}

#[test]
fn every_element_type_goes_in_and_comes_out() {
    fn passes<T: Number + PartialEq>(numbers: Vec<T>) {
        let value = Value::new("given", &[numbers.len()], numbers.clone()).expect("a tensor");
        let back: Vec<T> = value.numbers::<T>().expect("its own type").iter().cloned().collect();
        assert_eq!(back, numbers, "{}", value.element());
    }
    passes(vec![half::f16::from_f32(0.5), half::f16::INFINITY]);
    passes(vec![half::bf16::from_f32(-3.0)]);
    passes(vec![1.5_f64]);
    passes(vec![-7_i8]);
    passes(vec![u64::MAX]);
    passes(vec![true, false]);
    passes(Vec::<f32>::new());
    assert!(Value::new("given", &[3], vec![1_i32]).is_err(), "a shape that does not fit");
    assert!(Value::new("given", &[1], vec![1_i32]).expect("a tensor").f32().is_err(), "another type");
}

#[test]
fn an_array_in_another_memory_order_is_read_by_its_indices() {
    let a = array![[1.0_f32, 3.0], [2.0, 4.0]].reversed_axes();
    let zero = Array2::<f32>::zeros((2, 2));
    let index = array![0_i64];
    let inputs = [("a", (&a).into()), ("b", (&zero).into()), ("index", (&index).into())];
    assert_eq!(
        load(&adder()).run(&inputs, &["sum"]).expect("valid inputs")[0].f32().expect("f32"),
        a.view().into_dyn()
    );
}

#[test]
fn a_wrong_call_names_the_graph_and_the_tensor() {
    let (good, index) = (Array2::<f32>::zeros((3, 2)), array![0_i64]);
    let (narrow, flat) = (Array2::<f32>::zeros((3, 1)), Array1::<f32>::zeros(1));
    let a = || ("a", Input::from(&good));
    let i = || ("index", Input::from(&index));
    let expected = "adder.onnx: input \"b\": expected f32[N, 2], found f32[3, 1]";
    assert_eq!(complaint(&[a(), ("b", (&narrow).into()), i()], &["sum"]), expected);
    let expected = "adder.onnx: input \"index\": expected i64[1], found f32[1]";
    assert_eq!(complaint(&[a(), ("index", (&flat).into())], &["sum"]), expected);
    assert_eq!(complaint(&[a(), i()], &["sum"]), "adder.onnx: input \"b\": it is not given");
    assert!(complaint(&[a(), a()], &["sum"]).contains("given twice"));
    assert!(complaint(&[("c", (&good).into())], &["sum"]).contains("it has \"a\", \"b\", \"index\""));
    assert!(complaint(&[a(), ("b", (&good).into()), i()], &["total"]).contains("output \"total\""));
}

#[test]
fn a_rewritten_graph_is_written_and_an_optimiser_can_be_left_out() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let written = |without: &[&str], name: &str| {
        let path = folder.path().join(name);
        let settings = Settings { optimization: Optimization::Basic, threads: 1 };
        let rewriting = Rewriting { without, saved: Some(&path) };
        Session::rewritten("turn.onnx", &turned(), &settings, rewriting).expect("a graph");
        std::fs::read(path).expect("a rewritten graph").len()
    };
    assert!(written(&[], "less.onnx") < written(&["EliminateIdentity", "NoSuchPass"], "more.onnx"));
}

/// y = −(the same as x).
fn turned() -> Vec<u8> {
    GraphBuilder::default()
        .input("x", Element::F32, &[Side::Fixed(2)])
        .node("Identity", &["x"], &["the_same_as_x"], &[])
        .node("Neg", &["the_same_as_x"], &["y"], &[])
        .output("y", Element::F32, &[Side::Fixed(2)])
        .to_bytes()
}

#[test]
fn lengths_that_do_not_fit_each_other_are_an_error_of_the_run() {
    let (three, four, index) = (Array2::<f32>::zeros((3, 2)), Array2::<f32>::zeros((4, 2)), array![0_i64]);
    let message =
        complaint(&[("a", (&three).into()), ("b", (&four).into()), ("index", (&index).into())], &["sum"]);
    assert!(message.starts_with("adder.onnx: run: "), "{message}");
}

#[test]
fn what_is_no_graph_is_refused_with_its_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let complaint = |name: &str, content: Option<&[u8]>| {
        let path = folder.path().join(name);
        if let Some(content) = content {
            std::fs::write(&path, content).expect("a writable folder");
        }
        let message = Session::load(&path, &Settings::default()).expect_err("no graph").to_string();
        assert!(message.starts_with(&path.display().to_string()), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        message
    };
    complaint("absent.onnx", None);
    assert!(complaint("empty.onnx", Some(b"")).contains("it is empty"));
    assert!(complaint("text.onnx", Some(b"not a graph at all")).contains("cannot load it as a graph"));
    let whole = adder();
    for length in [1, whole.len() / 2, whole.len() - 1] {
        assert!(
            complaint("cut.onnx", Some(&whole[..length])).contains("cannot load it as a graph"),
            "{length} bytes"
        );
    }
    assert!(complaint(".", None).contains("it is a folder"));
}

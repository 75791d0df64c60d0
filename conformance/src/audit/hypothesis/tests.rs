//! What is named, and what is not.

use super::*;
use crate::audit::cases_for_tests::{byte, case, drawn_bytes, list, numbers, one, output};
use crate::onnx::builder::{float, int, ints, text};
use crate::onnx::message::AttributeProto;
use crate::onnx::typed_tensor::Elements;

static NOTHING: BTreeMap<String, Arc<TypedTensor>> = BTreeMap::new();
static NONE: BTreeSet<String> = BTreeSet::new();

/// No other tensors.
const ALONE: Others = of(&NOTHING);

const fn of(tensors: &BTreeMap<String, Arc<TypedTensor>>) -> Others<'_> {
    Others { tensors, later: &NONE }
}

/// What is named when the node was computed with other attributes.
fn misread(right: &Case, attributes: &[AttributeProto]) -> Option<Hypothesis> {
    let wrong = Case { node: change::with_attributes(&right.node, attributes), ..right.clone() };
    let case = Case { found: vec![output(&wrong)], ..right.clone() };
    explain(&case, None, ALONE)
}

fn name(hypothesis: Option<Hypothesis>) -> String {
    hypothesis.map_or_else(|| "nothing".to_owned(), |hypothesis| hypothesis.name)
}

#[test]
fn paddings_of_the_other_side_are_named_by_the_attribute_that_asks_for_them() {
    let operands = || vec![numbers("x", &[2, 4, 9, 9]), numbers("w", &[4, 4, 2, 2])];
    let lower = [text("auto_pad", "NOTSET"), ints("pads", &[1, 1, 0, 0])];
    let same = case("Conv", operands(), vec![text("auto_pad", "SAME_UPPER"), ints("strides", &[2, 2])]);
    assert_eq!(name(misread(&same, &lower)), "auto_pad", "asked for");
    let given = case("Conv", operands(), vec![ints("pads", &[0, 0, 1, 1]), ints("strides", &[2, 2])]);
    assert_eq!(name(misread(&given, &lower)), "pads", "given");
}

#[test]
fn a_node_within_rounding_is_not_explained() {
    let conv = case("Conv", vec![numbers("x", &[1, 4, 9, 9]), numbers("w", &[4, 4, 3, 3])], vec![]);
    assert_eq!(explain(&conv, None, ALONE), None, "nothing is outside");
    // Corners do not matter where all points are the centre.
    let centre = TypedTensor::new(&[1, 3, 3, 2], Elements::F32(vec![0.0; 18])).ok();
    let sampled =
        case("GridSample", vec![numbers("x", &[1, 2, 5, 5]), centre], vec![int("align_corners", 0)]);
    assert_eq!(misread(&sampled, &[int("align_corners", 1)]), None, "a mistake that changes nothing");
}

#[test]
fn the_closest_mistake_is_named_before_a_fitted_number() {
    // With one channel an ε cannot be told from a factor of the scale; the attribute is the closer mistake.
    let one = |name: &str| numbers(name, &[1]);
    let right = case(
        "InstanceNormalization",
        vec![numbers("x", &[1, 1, 6, 6]), one("scale"), one("shift")],
        vec![float("epsilon", 1e-5)],
    );
    assert_eq!(name(misread(&right, &[float("epsilon", 1e-3)])), "epsilon", "not a factor");
    let fitted = misread(&right, &[float("epsilon", 0.037)]).expect("a hypothesis");
    assert_eq!(fitted.name, "epsilon", "a value that nobody lists");
    assert!(fitted.detail.contains("3.7e-2 explains"), "{}", fitted.detail);
}

#[test]
fn what_no_mistake_makes_has_no_name() {
    let right = case("ReduceSum", vec![numbers("x", &[64, 9]), list(&[1])], vec![]);
    let mut case = right.clone();
    // Right and wrong in turn, each wrong one by another amount.
    let found = case.found[0].as_mut().expect("an output");
    if let Elements::F32(values) = &mut found.elements {
        for (i, y) in values.iter_mut().enumerate().filter(|(i, _)| i % 2 == 0) {
            *y += ((i * i) as f32).sin();
        }
    }
    assert_eq!(explain(&case, None, ALONE), None, "noise has no cause");
}

#[test]
fn numbers_of_another_tensor_are_found_among_the_others() {
    let right = case("Mul", vec![numbers("x", &[4, 9]), numbers("w", &[4, 9])], vec![]);
    let other = numbers("another", &[4, 9]).expect("a tensor");
    let others = BTreeMap::from([("earlier".to_owned(), Arc::new(other.clone()))]);
    let case = Case { found: vec![Some(other.clone())], ..right.clone() };
    let hypothesis = explain(&case, None, of(&others)).expect("a hypothesis");
    assert_eq!(hypothesis.name, "stale", "{}", hypothesis.detail);
    assert!(hypothesis.detail.contains("\"earlier\", bit for bit"), "{}", hypothesis.detail);
    let read = Case { operands: vec![Some(other), right.operands[1].clone()], ..right.clone() };
    let case = Case { found: vec![output(&read)], ..right };
    let hypothesis = explain(&case, None, of(&others)).expect("a hypothesis");
    assert_eq!(hypothesis.name, "stale", "{}", hypothesis.detail);
    assert!(hypothesis.detail.contains("\"earlier\" for operand 0"), "{}", hypothesis.detail);
}

#[test]
fn a_factor_that_an_engine_kept_in_f32_is_a_scale() {
    // One weight a row, as skinning has: a product of one rounding, in which that of the factor itself shows.
    let weights = (0..96 * 24).map(|i| if i % 24 == (i / 24) % 24 { 1.0 } else { 0.0 }).collect();
    let weights = TypedTensor::new(&[96, 24], Elements::F32(weights)).ok();
    let mut case = case("MatMul", vec![weights, numbers("transforms", &[24, 12])], vec![]);
    let Some(TypedTensor { elements: Elements::F32(found), .. }) = &mut case.found[0] else { panic!("f32") };
    found.iter_mut().for_each(|y| *y *= 1.0005);
    let hypothesis = explain(&case, None, ALONE).expect("a hypothesis");
    assert_eq!(hypothesis.name, "scale", "{}", hypothesis.detail);
    assert!(hypothesis.detail.contains("1.0005 times"), "{}", hypothesis.detail);
}

#[test]
fn one_of_a_batch_that_is_another_is_named_in_a_large_node_too() {
    let operands = vec![numbers("x", &[3, 4, 96, 96]), numbers("w", &[16, 4, 3, 3])];
    let mut case = case("Conv", operands, vec![ints("pads", &[1, 1, 1, 1])]);
    let Some(TypedTensor { elements: Elements::F32(found), .. }) = &mut case.found[0] else { panic!("f32") };
    let slice = found.len() / 3;
    found.copy_within(2 * slice.., 0);
    let hypothesis = explain(&case, None, ALONE).expect("a hypothesis");
    assert_eq!(hypothesis.name, "batch-order", "{}", hypothesis.detail);
    assert!(hypothesis.detail.contains("slices 0 and 2 along axis 0"), "{}", hypothesis.detail);
}

#[test]
fn a_tensor_that_is_computed_from_the_output_is_no_stale_operand() {
    let right = case("QuantizeLinear", vec![numbers("x", &[12, 12]), one(0.02), byte(120)], vec![]);
    let mut case = right.clone();
    let Some(TypedTensor { elements: Elements::U8(found), .. }) = &mut case.found[0] else { panic!("u8") };
    found.iter_mut().enumerate().for_each(|(i, y)| *y ^= (i * i % 7) as u8);
    // What was found, as numbers again, gives what was found.
    let again = found.iter().map(|&y| 0.02 * (f32::from(y) - 120.0)).collect();
    let again = TypedTensor::new(&[12, 12], Elements::F32(again)).expect("as many");
    let others = BTreeMap::from([("again".to_owned(), Arc::new(again))]);
    assert_eq!(name(explain(&case, None, of(&others))), "stale", "where it could have been read");
    let later = BTreeSet::from(["again".to_owned()]);
    let hypothesis = explain(&case, None, Others { tensors: &others, later: &later });
    assert_eq!(hypothesis, None, "noise has no cause");
}

#[test]
fn mistakes_in_a_large_quantised_convolution_are_named_from_a_part_of_it() {
    let operands = |x: u8, y: u8, scale: f32, bias: i32| {
        vec![
            drawn_bytes("x", &[1, 16, 44, 41], false),
            one(scale),
            byte(x),
            drawn_bytes("w", &[24, 16, 3, 3], true),
            TypedTensor::new(&[24], Elements::F32((1_u8..=24).map(|c| 1e-3 * f32::from(c)).collect())).ok(),
            byte_with_sign(-3),
            one(0.05),
            byte(y),
            TypedTensor::new(&[24], Elements::I32((1..=24).map(|c| bias * (c - 12)).collect())).ok(),
        ]
    };
    let pads = || vec![ints("pads", &[1, 1, 1, 1])];
    let right = case("QLinearConv", operands(120, 90, 0.012, 300), pads());
    assert!(Trial::of(&right, None).is_none(), "nothing is wrong");
    for (wrong, expected, detail) in [
        (operands(120, 91, 0.012, 300), "zero-point", "the output was +1"),
        (operands(117, 90, 0.012, 300), "zero-point", "operand 2 (\"B\") was -3"),
        (operands(120, 90, 0.012 * 1.02, 300), "scale", "1.02 times"),
        (operands(120, 90, 0.012, 0), "bias-missing", "left out"),
        (operands(120, 90, 0.012, -300), "bias-sign", "subtracted"),
    ] {
        let wrong = case("QLinearConv", wrong, pads());
        let case = Case { found: wrong.found, ..right.clone() };
        let hypothesis = explain(&case, Some(&[0, 7, 20, 20]), ALONE).expect(expected);
        assert_eq!(hypothesis.name, expected, "{}", hypothesis.detail);
        assert!(hypothesis.detail.contains(detail), "{}", hypothesis.detail);
    }
}

fn byte_with_sign(byte: i8) -> Option<TypedTensor> {
    TypedTensor::new(&[], Elements::I8(vec![byte])).ok()
}

#[test]
fn mistakes_in_quantised_operators_of_onnx_runtime_are_named() {
    let added = |z: u8, y: u8| {
        let operands = vec![
            drawn_bytes("a", &[4, 60], false),
            one(0.0231),
            byte(z),
            drawn_bytes("b", &[4, 60], false),
            one(0.0171),
            byte(131),
            one(0.0313),
            byte(y),
        ];
        let mut case = case("Identity", vec![operands[0].clone()], vec![]);
        case.node.op_type = Some("QLinearAdd".into());
        case.node.domain = Some("com.microsoft".into());
        case.operands = operands;
        case.found = vec![output(&case)];
        case
    };
    let right = added(117, 120);
    for (wrong, expected, detail) in [
        (added(119, 120), "zero-point", "in operand 2 (\"\") was +2"),
        (added(0, 120), "zero-point", "in operand 2 (\"\") was ignored"),
        (added(117, 121), "zero-point", "of the output was +1"),
    ] {
        let hypothesis = explain(&Case { found: wrong.found, ..right.clone() }, None, ALONE).expect(expected);
        assert_eq!(hypothesis.name, expected, "{}", hypothesis.detail);
        assert!(hypothesis.detail.contains(detail), "{}", hypothesis.detail);
    }
}

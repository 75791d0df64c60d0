//! A piece of an output is that piece of the whole output, for every node that is cut.

use super::*;
use crate::audit::case::Case;
use crate::audit::sample::Plan;
use crate::onnx::builder::{float, int, ints, text};
use crate::onnx::value::Value;
use crate::onnx::walk;

struct Problem {
    operator: &'static str,
    opset: i64,
    attributes: Vec<AttributeProto>,
    operands: Vec<TypedTensor>,
    /// Axes of the output that may be cut.
    cut: &'static str,
}

fn numbers(shape: &[usize]) -> TypedTensor {
    let wave = |i: usize| ((i as f32 + shape.len() as f32) * 12.9898).sin() + 0.1;
    TypedTensor {
        shape: shape.to_vec(),
        elements: Elements::F32((0..shape.iter().product()).map(wave).collect()),
    }
}

fn positive(shape: &[usize]) -> TypedTensor {
    let Elements::F32(v) = numbers(shape).elements else { unreachable!("numbers are f32") };
    TypedTensor {
        shape: shape.to_vec(),
        elements: Elements::F32(v.into_iter().map(|x| x.abs() + 0.5).collect()),
    }
}

fn problem(
    operator: &'static str,
    attributes: Vec<AttributeProto>,
    operands: Vec<TypedTensor>,
    cut: &'static str,
) -> Problem {
    Problem { operator, opset: 20, attributes, operands, cut }
}

fn signed(name: &str, values: &[i64]) -> AttributeProto {
    let mut node = NodeProto::default();
    set_ints(&mut node, name, values.to_vec());
    node.attribute.swap_remove(0)
}

/// One problem per rule, with uneven strides, paddings, dilations and groups.
fn problems() -> Vec<Problem> {
    let n = numbers;
    let i = |values: &[i64]| list(values.to_vec());
    vec![
        problem("Relu", vec![], vec![n(&[2, 3, 5])], "yyy"),
        problem("Add", vec![], vec![n(&[2, 3, 5]), n(&[3, 1])], "yyy"),
        problem("Mul", vec![], vec![n(&[4, 1]), n(&[1, 7])], "yy"),
        problem("Clip", vec![], vec![n(&[6, 4]), n(&[]), positive(&[])], "yy"),
        problem("PRelu", vec![], vec![n(&[2, 3, 4]), n(&[3, 1])], "yyy"),
        problem("Cast", vec![int("to", 10)], vec![n(&[5, 6])], "yy"),
        problem("Transpose", vec![ints("perm", &[2, 0, 1])], vec![n(&[3, 4, 5])], "yyy"),
        problem("Concat", vec![int("axis", 1)], vec![n(&[2, 3, 4]), n(&[2, 1, 4]), n(&[2, 5, 4])], "yyy"),
        problem("Slice", vec![], vec![n(&[4, 9]), i(&[-3, 2]), i(&[100, -1]), i(&[0, 1])], "yy"),
        problem("Expand", vec![], vec![n(&[3, 1, 4]), i(&[2, 1, 5, 1])], "yyyy"),
        problem(
            "Pad",
            vec![text("mode", "edge")],
            vec![n(&[2, 3, 4, 5]), i(&[0, 0, 1, 2, 0, 0, 0, 1])],
            "yynn",
        ),
        problem("Shape", vec![], vec![n(&[3, 4, 5])], "n"),
        problem("MatMul", vec![], vec![n(&[2, 1, 3, 4]), n(&[5, 4, 6])], "yyyy"),
        problem(
            "Gemm",
            vec![int("transA", 1), float("alpha", 0.5)],
            vec![n(&[4, 5]), n(&[4, 6]), n(&[6])],
            "yy",
        ),
        problem("Gemm", vec![int("transB", 1)], vec![n(&[5, 4]), n(&[6, 4]), n(&[5, 1])], "yy"),
        problem(
            "BatchNormalization",
            vec![],
            vec![n(&[2, 3, 4, 5]), n(&[3]), n(&[3]), n(&[3]), positive(&[3])],
            "yyyy",
        ),
        problem("InstanceNormalization", vec![], vec![n(&[2, 3, 4, 5]), n(&[3]), n(&[3])], "yynn"),
        problem("Softmax", vec![int("axis", 1)], vec![n(&[3, 4, 5])], "yny"),
        problem("ReduceMean", vec![int("keepdims", 0)], vec![n(&[3, 4, 5]), i(&[1])], "yy"),
        problem("ReduceSum", vec![], vec![n(&[3, 4, 5]), i(&[0, -1])], "nyn"),
        problem("GlobalAveragePool", vec![], vec![n(&[2, 3, 4, 5])], "yynn"),
        problem(
            "MaxPool",
            vec![ints("kernel_shape", &[2, 3]), ints("pads", &[0, 1, 1, 1])],
            vec![n(&[2, 3, 5, 6])],
            "yynn",
        ),
        problem("GridSample", vec![text("mode", "linear")], vec![n(&[2, 3, 4, 5]), n(&[2, 3, 6, 2])], "yyyy"),
        problem(
            "Conv",
            vec![ints("strides", &[2, 1]), ints("pads", &[2, 0, 1, 3]), ints("dilations", &[1, 2])],
            vec![n(&[2, 3, 7, 8]), n(&[5, 3, 3, 2]), n(&[5])],
            "yyyy",
        ),
        problem(
            "Conv",
            vec![int("group", 2), ints("pads", &[3, 3])],
            vec![n(&[1, 4, 6]), n(&[6, 2, 3])],
            "yyy",
        ),
        problem("Conv", vec![ints("pads", &[1; 6])], vec![n(&[1, 2, 3, 4, 3]), n(&[3, 2, 3, 3, 3])], "yyyyy"),
        problem(
            "ConvTranspose",
            vec![ints("strides", &[2, 3]), ints("pads", &[1, 0, 0, 2]), ints("output_padding", &[1, 0])],
            vec![n(&[2, 3, 4, 3]), n(&[3, 5, 3, 4]), n(&[5])],
            "yyyy",
        ),
        problem(
            "ConvTranspose",
            vec![int("group", 2), ints("strides", &[2]), ints("dilations", &[2])],
            vec![n(&[1, 4, 5]), n(&[4, 3, 3])],
            "yyy",
        ),
        problem(
            "ConvTranspose",
            vec![ints("strides", &[2; 3])],
            vec![n(&[1, 2, 2, 3, 2]), n(&[2, 2, 2, 2, 2])],
            "yyyyy",
        ),
        Problem { opset: 12, ..problem("Softmax", vec![int("axis", 1)], vec![n(&[3, 4, 5])], "ynn") },
        Problem {
            opset: 12,
            ..problem("ReduceMax", vec![signed("axes", &[-1])], vec![n(&[3, 4, 5])], "yyn")
        },
    ]
}

fn evaluated(case: &Case) -> Option<Value<f64>> {
    let values: Vec<Option<Value<f64>>> = case
        .operands
        .iter()
        .map(|operand| operand.as_ref().map(|t| Value::of(t).expect("a value")))
        .collect();
    let borrowed: Vec<_> = values.iter().map(Option::as_ref).collect();
    walk::evaluate(&case.node, case.opset, &borrowed).unwrap_or_else(|why| panic!("{why}"))[0].clone()
}

fn as_numbers(value: &Value<f64>) -> Vec<f64> {
    match value.integers() {
        Ok(integers) => integers.data.iter().map(|&i| i as f64).collect(),
        Err(_) => value.numbers().expect("numbers or integers").data.clone(),
    }
}

#[test]
fn a_piece_is_that_piece_of_the_whole() {
    for Problem { operator, opset, attributes, operands, cut } in problems() {
        let node = NodeProto {
            op_type: Some(operator.to_owned()),
            input: (0..operands.len()).map(|k| format!("x{k}")).collect(),
            output: vec!["y".to_owned()],
            attribute: attributes,
            ..NodeProto::default()
        };
        let operands = operands.into_iter().map(Some).collect();
        let mut case = Case { node, opset, name: operator.to_owned(), operands, found: vec![None] };
        let whole = evaluated(&case).expect("an output");
        let shape = whole.shape().to_vec();
        let values = as_numbers(&whole);
        // The numbers of the pieces are compared as f64, so a stand-in of the right shape serves as what was found.
        let stand_in = Elements::F64(values.clone());
        case.found = vec![Some(TypedTensor { shape: shape.clone(), elements: stand_in })];
        let view = case.view();
        let division = Division::of(&view, 0).unwrap_or_else(|| panic!("{operator} is cut"));
        assert_eq!(division.shape, shape, "{operator}: shape");
        let axes: String = division.axes.iter().map(|&cut| if cut { 'y' } else { 'n' }).collect();
        assert_eq!(axes, cut, "{operator}: axes");

        let mut boxes = Plan::of(&division, f64::INFINITY, 1).boxes;
        let covered: usize = boxes.iter().map(Region::len).sum();
        assert_eq!(covered, values.len(), "{operator}: the boxes cover the output");
        boxes.extend(Plan::drawn(&division, 40, 7).boxes);
        for region in boxes {
            let piece = case.piece(0, &region).unwrap_or_else(|| panic!("{operator} at {region:?}"));
            let answer = evaluated(&piece).expect("an output");
            assert_eq!(answer.shape(), region.shape(), "{operator} at {region:?}");
            for (place, found) in as_numbers(&answer).into_iter().enumerate() {
                let expected = values[region.offset(place, &shape)];
                let near = (found - expected).abs() <= 1e-12 * (1.0 + expected.abs());
                assert!(near, "{operator} at {region:?}: {found}, expected {expected}");
            }
        }
    }
}

#[test]
fn a_box_beyond_the_output_is_none() {
    let case = Case {
        node: NodeProto {
            op_type: Some("Relu".into()),
            input: vec!["x".into()],
            output: vec!["y".into()],
            ..NodeProto::default()
        },
        opset: 20,
        name: "Relu".into(),
        operands: vec![Some(numbers(&[2, 3]))],
        found: vec![Some(numbers(&[2, 3]))],
    };
    assert!(case.piece(0, &Region(vec![0..2, 0..3])).is_some(), "the whole");
    assert!(case.piece(0, &Region(vec![0..2, 1..4])).is_none(), "beyond the end");
    let larger = Case { found: vec![Some(numbers(&[2, 4]))], ..case };
    assert!(larger.piece(0, &Region(vec![0..2, 0..3])).is_none(), "of another shape");
}

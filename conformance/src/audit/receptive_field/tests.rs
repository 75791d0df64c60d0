//! What lies outside a field changes nothing, and what lies inside does.

use super::*;
use crate::audit::cases_for_tests::{case, given, list, numbers, output};
use crate::onnx::builder::{float, int, ints, text as string};
use crate::onnx::typed_tensor::Elements;
use crate::suite::audit_faults::scenes::drawn;

/// The case with every float inside the fields, or every one outside, replaced by other numbers.
fn disturbed(case: &Case, fields: &[Option<Field>], inside: bool) -> Case {
    let mut case = case.clone();
    for (i, operand) in case.operands.iter_mut().enumerate() {
        let Some(TypedTensor { shape, elements: Elements::F32(values) }) = operand else { continue };
        let other = drawn("other", shape);
        for (place, value) in values.iter_mut().enumerate() {
            let index = crate::audit::region::unravel(place, shape);
            let within = fields[i]
                .as_ref()
                .is_some_and(|field| field.iter().zip(&index).all(|(range, i)| range.contains(i)));
            if within == inside {
                // Of the sign that it had: a variance stays one.
                *value = (other[place].abs() + 3.0).copysign(*value);
            }
        }
    }
    case
}

fn at(tensor: &TypedTensor, index: &[usize]) -> f64 {
    let place = tensor.shape.iter().zip(index).fold(0, |place, (side, i)| place * side + i);
    tensor.to_f64().expect("floats")[place]
}

/// First, last and some elements between.
fn some_elements(shape: &[usize]) -> Vec<Vec<usize>> {
    let count: usize = shape.iter().product();
    let step = (count / 7).max(1);
    (0..count)
        .step_by(step)
        .chain([count - 1])
        .map(|place| crate::audit::region::unravel(place, shape))
        .collect()
}

#[test]
fn nothing_outside_a_field_changes_its_element_and_something_inside_does() {
    let window = || vec![ints("pads", &[1, 0, 2, 1]), ints("strides", &[2, 1]), ints("dilations", &[1, 2])];
    let pool = || [window(), vec![ints("kernel_shape", &[3, 2])]].concat();
    let cases = [
        case("Conv", vec![numbers("x", &[2, 4, 7, 6]), numbers("w", &[6, 2, 3, 2]), numbers("b", &[6])], {
            let mut attributes = window();
            attributes.push(int("group", 2));
            attributes
        }),
        case(
            "Conv",
            vec![numbers("x", &[1, 2, 8, 7]), numbers("w", &[3, 2, 3, 3])],
            vec![string("auto_pad", "SAME_LOWER"), ints("strides", &[2, 2])],
        ),
        case(
            "ConvTranspose",
            vec![numbers("x", &[1, 4, 5, 4]), numbers("w", &[4, 3, 3, 2]), numbers("b", &[6])],
            vec![
                ints("strides", &[2, 3]),
                ints("pads", &[1, 0, 0, 1]),
                ints("output_padding", &[1, 0]),
                int("group", 2),
            ],
        ),
        case("AveragePool", vec![numbers("x", &[2, 3, 7, 6])], pool()),
        case("Gemm", vec![numbers("a", &[4, 3]), numbers("b", &[3, 5]), numbers("c", &[5])], vec![]),
        case(
            "Gemm",
            vec![numbers("a", &[3, 4]), numbers("b", &[5, 3])],
            vec![int("transA", 1), int("transB", 1)],
        ),
        case("MatMul", vec![numbers("a", &[2, 1, 3, 4]), numbers("b", &[5, 4, 2])], vec![]),
        case("MatMul", vec![numbers("a", &[2, 3, 4]), numbers("b", &[4])], vec![]),
        case("MatMul", vec![numbers("a", &[4]), numbers("b", &[2, 4, 3])], vec![]),
        case("Add", vec![numbers("a", &[2, 1, 4]), numbers("b", &[3, 1])], vec![]),
        case(
            "InstanceNormalization",
            vec![numbers("x", &[2, 3, 4, 2]), numbers("s", &[3]), numbers("b", &[3])],
            vec![],
        ),
        case(
            "GroupNormalization",
            vec![numbers("x", &[2, 6, 3]), numbers("s", &[6]), numbers("b", &[6])],
            vec![int("num_groups", 3)],
        ),
        case(
            "LayerNormalization",
            vec![numbers("x", &[2, 3, 4]), numbers("s", &[3, 4])],
            vec![int("axis", 1)],
        ),
        case("Softmax", vec![numbers("x", &[2, 3, 4])], vec![int("axis", 1)]),
        case("ReduceMean", vec![numbers("x", &[2, 3, 4]), list(&[0, -1])], vec![int("keepdims", 0)]),
        case("GlobalAveragePool", vec![numbers("x", &[2, 3, 4, 2])], vec![]),
        case(
            "Einsum",
            vec![numbers("a", &[2, 3, 4]), numbers("b", &[4, 3])],
            vec![string("equation", "bij,jk->bk")],
        ),
        case(
            "Resize",
            vec![numbers("x", &[1, 2, 7, 5]), None, given(&[1.0, 1.0, 1.6, 0.7])],
            vec![string("mode", "cubic"), float("cubic_coeff_a", -0.5)],
        ),
        case(
            "GridSample",
            vec![numbers("x", &[2, 3, 6, 5]), numbers("g", &[2, 4, 3, 2])],
            vec![string("mode", "linear"), string("padding_mode", "border"), int("align_corners", 1)],
        ),
        case("Concat", vec![numbers("a", &[2, 3]), numbers("b", &[2, 4])], vec![int("axis", 1)]),
        case("Transpose", vec![numbers("x", &[2, 3, 4])], vec![ints("perm", &[2, 0, 1])]),
        case("Gather", vec![numbers("x", &[5, 3]), list(&[4, -1, 0])], vec![]),
        case("Slice", vec![numbers("x", &[9, 3]), list(&[7]), list(&[1]), list(&[0]), list(&[-2])], vec![]),
        case("Reshape", vec![numbers("x", &[4, 6]), list(&[3, 8])], vec![]),
    ];
    for case in cases {
        let y = case.found[0].clone().expect("an output");
        let operator = &case.name;
        for index in some_elements(&y.shape) {
            let fields = receptive_field(&case, 0, &index);
            let outside = output(&disturbed(&case, &fields, false)).expect("an output");
            assert_eq!(at(&outside, &index), at(&y, &index), "{operator} {index:?}: outside {fields:?}");
            let inside = output(&disturbed(&case, &fields, true)).expect("an output");
            // Softmax of what is moved together, and a linear mean of a symmetric window, may stay; none of these does.
            assert_ne!(at(&inside, &index), at(&y, &index), "{operator} {index:?}: inside {fields:?}");
        }
    }
}

#[test]
fn a_field_is_told_as_a_slice_of_the_operand() {
    let conv = case(
        "Conv",
        vec![numbers("x", &[1, 64, 9, 12]), numbers("w", &[8, 64, 3, 3]), numbers("b", &[8])],
        vec![ints("pads", &[1, 1, 1, 1])],
    );
    let fields = receptive_field(&conv, 0, &[0, 5, 4, 8]);
    assert_eq!(text(&conv, &fields), ["X[0, 0:64, 3:6, 7:10]", "W[5, 0:64, 0:3, 0:3]", "B[5]"], "inside");
    let corner = receptive_field(&conv, 0, &[0, 0, 0, 11]);
    assert_eq!(text(&conv, &corner)[0], "X[0, 0:64, 0:2, 10:12]", "clipped to the operand");
}

#[test]
fn an_element_of_a_padding_comes_from_nowhere() {
    let pad = case("Pad", vec![numbers("x", &[2, 3]), list(&[1, 0, 0, 2])], vec![]);
    assert_eq!(receptive_field(&pad, 0, &[0, 1])[0], None, "a padding");
    assert_eq!(receptive_field(&pad, 0, &[1, 2])[0], Some(vec![0..1, 2..3]), "an element");
    let unknown = case("Add", vec![numbers("a", &[2]), numbers("b", &[2])], vec![]);
    let unknown = Case { node: NodeProto { op_type: Some("Unheard".into()), ..unknown.node }, ..unknown };
    assert_eq!(receptive_field(&unknown, 0, &[1])[1], Some(vec![0..2]), "all that may be");
}

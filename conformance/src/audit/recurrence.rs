//! Recurrent layers, step by step: each step from the state that the second party itself had arrived at.
//!
//! The bound of a chain of steps grows with each of them as errors through the recurrence may, and after some dozens it
//! promises nothing. But the second party shows its states: y holds h after every step. So a step starts from the h that was
//! found before it, as every node starts from the operands that were found. The cell of an LSTM is nowhere shown; it is the
//! reference's own from the first step on, and its bound goes on growing, though more slowly.

use vitruvian_reference::nn::{Rounded, Scalar as _, Tensor};

use super::case::View;
use super::compare::numbers;
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::Value;
use crate::onnx::walk;

/// Places of operands.
const X: usize = 0;
const R: usize = 2;
const LENGTHS: usize = 4;
const H: usize = 5;
const C: usize = 6;

/// The states of a recurrent layer that shows them.
pub(super) fn shown<'a>(view: &View<'a>) -> Option<&'a TypedTensor> {
    let batch_first = |attribute: &crate::onnx::message::AttributeProto| {
        attribute.name.as_deref() == Some("layout") && attribute.i.unwrap_or(0) != 0
    };
    let steps =
        matches!(view.operator(), "GRU" | "LSTM" | "RNN") && !view.node.attribute.iter().any(batch_first);
    view.found.first().copied().flatten().filter(|_| steps)
}

/// The outputs of a recurrent layer whose every step starts from the state in `found` before it.
///
/// # Errors
/// As [`walk::evaluate`].
pub(super) fn step_by_step(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<&Value<Rounded>>],
    found: &TypedTensor,
) -> Result<Vec<Option<Value<Rounded>>>, String> {
    let operand = |place: usize| operands.get(place).copied().flatten();
    let (Some(x), Some(r)) = (operand(X), operand(R)) else { return walk::evaluate(node, opset, operands) };
    let ([steps, samples, features], [directions, _, hidden]) = (x.shape(), r.shape()) else {
        return walk::evaluate(node, opset, operands);
    };
    let [steps, samples, features, directions, hidden] = [*steps, *samples, *features, *directions, *hidden];
    let state = [directions, samples, hidden];
    let fits = |place: usize| operand(place).is_none_or(|value| value.shape() == state);
    if found.shape != [steps, directions, samples, hidden] || !fits(H) || !fits(C) {
        return walk::evaluate(node, opset, operands);
    }
    let start = |place: usize| match operand(place) {
        Some(value) => value.numbers().cloned(),
        None => Ok(Tensor::zeros(&state)),
    };
    let lengths = match operand(LENGTHS) {
        Some(lengths) => lengths.integers()?.data.clone(),
        None => vec![steps as i64; samples],
    };
    if lengths.len() != samples {
        return walk::evaluate(node, opset, operands);
    }
    let has_cell = node.op_type.as_deref() == Some("LSTM");
    let names = if has_cell { vec!["y", "h", "c"] } else { vec!["y", "h"] };
    let one_step = NodeProto { output: names.into_iter().map(str::to_owned).collect(), ..node.clone() };
    let (input, shown) = (x.numbers()?, numbers(found));
    let (mut from, mut h, mut c) =
        (start(H)?, start(H)?, if has_cell { start(C)? } else { Tensor::zeros(&[]) });
    let mut y = Tensor::zeros(&found.shape);
    let value = |tensor: Tensor<Rounded>| Value::from_numbers(x.element, tensor);
    for (step, direction) in order(node, steps, directions) {
        let of_step = input.data[step * samples * features..][..samples * features].to_vec();
        let of_step = value(Tensor::new(&[1, samples, features], of_step));
        let goes_on: Vec<i64> = lengths.iter().map(|&length| i64::from((step as i64) < length)).collect();
        let goes_on_now = Value::from_integers(ElementType::I32, Tensor::new(&[samples], goes_on.clone()))?;
        let (h_before, c_before) = (value(from.clone()), value(c.clone()));
        let mut own = operands.to_vec();
        own.resize(own.len().max(if has_cell { C } else { H } + 1), None);
        (own[X], own[LENGTHS], own[H]) = (Some(&of_step), Some(&goes_on_now), Some(&h_before));
        if has_cell {
            own[C] = Some(&c_before);
        }
        let outputs = walk::evaluate(&one_step, opset, &own)?;
        let output =
            |k: usize| outputs.get(k).and_then(Option::as_ref).ok_or("has no such output")?.numbers();
        for sample in (0..samples).filter(|&sample| goes_on[sample] == 1) {
            let at = (direction * samples + sample) * hidden;
            let place = step * directions * samples * hidden + at;
            let made = &output(0)?.data[at..at + hidden];
            y.data[place..place + hidden].copy_from_slice(made);
            h.data[at..at + hidden].copy_from_slice(made);
            for k in 0..hidden {
                from.data[at + k] = Rounded::exact(shown[place + k]);
            }
            if has_cell {
                c.data[at..at + hidden].copy_from_slice(&output(2)?.data[at..at + hidden]);
            }
        }
    }
    let mut outputs = vec![Some(value(y)), Some(value(h))];
    if has_cell {
        outputs.push(Some(value(c)));
    }
    outputs.truncate(node.output.len());
    Ok(outputs)
}

/// The steps in the order in which each direction takes them.
fn order(node: &NodeProto, steps: usize, directions: usize) -> Vec<(usize, usize)> {
    let is_reverse = |attribute: &crate::onnx::message::AttributeProto| {
        attribute.name.as_deref() == Some("direction") && attribute.s.as_deref() == Some(b"reverse")
    };
    let reverse = node.attribute.iter().any(is_reverse);
    let backwards = |direction: usize| direction == 1 || reverse;
    (0..directions)
        .flat_map(|d| (0..steps).map(move |step| (if backwards(d) { steps - 1 - step } else { step }, d)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::cases_for_tests::{case, list, numbers as drawn};
    use crate::audit::report::Grade;
    use crate::audit::{Case, judge};
    use crate::certificate::UNIT_ROUNDOFF;
    use crate::onnx::builder::text;
    use crate::onnx::typed_tensor::Elements;

    const STEPS: usize = 60;

    /// A layer whose second sample ends early.
    fn layer(operator: &str, gates: usize, direction: &str) -> Case {
        let directions = if direction == "bidirectional" { 2 } else { 1 };
        let times = |tensor: Option<TypedTensor>, factor: f32| {
            let TypedTensor { shape, elements: Elements::F32(v) } = tensor? else { return None };
            TypedTensor::new(&shape, Elements::F32(v.into_iter().map(|x| x * factor).collect())).ok()
        };
        let lengths = list(&[STEPS as i64, 17]).map(|lengths| {
            let Elements::I64(v) = &lengths.elements else { panic!("i64") };
            TypedTensor::new(&[2], Elements::I32(v.iter().map(|&n| n as i32).collect())).expect("lengths")
        });
        let operands = vec![
            drawn("x", &[STEPS, 2, 3]),
            times(drawn("w", &[directions, gates * 6, 3]), 0.7),
            times(drawn("r", &[directions, gates * 6, 6]), 0.7),
            drawn("b", &[directions, 2 * gates * 6]),
            lengths,
        ];
        case(operator, operands, vec![text("direction", direction)])
    }

    fn outputs(case: &Case, stepwise: bool) -> Vec<Option<Value<Rounded>>> {
        let values: Vec<Option<Value<Rounded>>> =
            case.operands.iter().map(|o| o.as_ref().map(|o| Value::of(o).expect("a value"))).collect();
        let operands: Vec<_> = values.iter().map(Option::as_ref).collect();
        let outputs = match stepwise {
            true => step_by_step(&case.node, 21, &operands, case.found[0].as_ref().expect("y")),
            false => walk::evaluate(&case.node, 21, &operands),
        };
        outputs.unwrap_or_else(|why| panic!("{why}"))
    }

    #[test]
    fn steps_from_the_layer_s_own_states_are_the_layer() {
        for (operator, gates) in [("RNN", 1), ("GRU", 3), ("LSTM", 4)] {
            for direction in ["forward", "reverse", "bidirectional"] {
                let case = layer(operator, gates, direction);
                let (whole, steps) = (outputs(&case, false), outputs(&case, true));
                // Of sixty steps. A cell that is not shown remembers all of them: there the layer's own bound is the limit.
                let limit =
                    |whole: Rounded| if operator == "LSTM" { whole.bound(UNIT_ROUNDOFF) } else { 1e-4 };
                assert_eq!(whole.len(), steps.len(), "{operator}");
                for (whole, steps) in whole.iter().flatten().zip(steps.iter().flatten()) {
                    let (whole, steps) =
                        (whole.numbers().expect("numbers"), steps.numbers().expect("numbers"));
                    assert_eq!(whole.shape, steps.shape, "{operator} {direction}");
                    for (a, b) in whole.data.iter().zip(&steps.data) {
                        assert!(
                            (a.value - b.value).abs() < 1e-4,
                            "{operator} {direction}: {} {}",
                            a.value,
                            b.value
                        );
                        assert!(b.bound(UNIT_ROUNDOFF) <= limit(*a), "{operator} {direction}: {b:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn long_layers_are_judged_and_a_wrong_step_is_seen() {
        for (operator, gates) in [("RNN", 1), ("GRU", 3), ("LSTM", 4)] {
            let mut case = layer(operator, gates, "forward");
            let right = judge(&case, 1e9);
            assert!(right.verdict <= Grade::G1, "{operator}: {:?}", right.tensors);
            let Some(TypedTensor { elements: Elements::F32(y), .. }) = &mut case.found[0] else {
                panic!("f32")
            };
            y[12 * 40] += 1e-3;
            let wrong = judge(&case, 1e9);
            assert_eq!((wrong.verdict, &wrong.worst[0].index[..1]), (Grade::G3, &[40][..]), "{operator}");
        }
    }
}

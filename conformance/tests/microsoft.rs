//! Operators of ONNX Runtime's domain `com.microsoft`, on random problems.

use vitruvian_conformance::problem::microsoft::{QUANTIZED, REAL};
use vitruvian_conformance::suite::microsoft::{judge_mistakes, judge_problems, judge_steps};
use vitruvian_conformance::suite::operators::Draw;

#[test]
fn onnx_runtime_and_reference_agree_on_the_operators_of_its_own_domain() {
    let draw = Draw::from_environment(60);
    let mut disagreements = Vec::new();
    for operator in QUANTIZED.into_iter().chain(REAL) {
        match judge_problems(operator, draw) {
            Ok(tally) => println!("{operator}: {tally:?}"),
            Err(found) => disagreements.push(found.to_string()),
        }
    }
    assert!(disagreements.is_empty(), "{}", disagreements.join("\n\n"));
}

#[test]
fn an_engine_that_reads_any_operand_as_another_is_told() {
    for operator in QUANTIZED.into_iter().chain(REAL) {
        let outcome = judge_mistakes(operator, 0..8).expect("ONNX Runtime");
        println!("{operator}: {} mistakes, {} missed", outcome.planted, outcome.missed.len());
        assert!(outcome.planted >= 8, "{operator}: {} mistakes change an output", outcome.planted);
        assert!(outcome.missed.is_empty(), "{operator}: {}", outcome.missed.join("\n"));
    }
}

#[test]
fn an_integer_that_is_one_level_off_is_wrong_but_on_the_other_side_of_a_tie() {
    for operator in QUANTIZED {
        let steps = judge_steps(operator, 0..40).expect("ONNX Runtime");
        println!("{operator}: {steps:?}");
        // As far as the bound of a level reaches towards the next one: nowhere, but where up to 6561 exponentials are added up.
        let share = if operator == "QLinearSoftmax" { 0.02 } else { 0.002 };
        let accepted = steps.accepted as f64 / steps.moved as f64;
        assert!(steps.moved > 200 && accepted < share, "{operator}: {steps:?}");
    }
}

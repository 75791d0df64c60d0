//! Operators of ONNX Runtime's domain `com.microsoft`, on random problems.

use vitruvian_conformance::problem::microsoft::{QUANTIZED, REAL};
use vitruvian_conformance::suite::microsoft::judge_problems;
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

//! Every operator, on random problems, within the bound derived from rounding.

use vitruvian_conformance::suite::operators::{Draw, JUDGES};

#[test]
fn runtime_and_reference_agree_within_rounding_on_random_problems() {
    let draw = Draw::from_environment(120);
    let disagreements: Vec<String> =
        JUDGES.iter().filter_map(|judge| judge.run(draw).err()).map(|found| found.to_string()).collect();
    assert!(disagreements.is_empty(), "{}", disagreements.join("\n\n"));
}

//! Planted faults: every one must be seen in every problem.

use vitruvian_conformance::suite::faults::FAULTS;
use vitruvian_conformance::suite::operators::Draw;

#[test]
fn every_planted_fault_is_seen_in_every_problem() {
    let draw = Draw { cases: 100, ..Draw::from_environment(100) };
    println!("| fault | problems | seen by the bound | seen by the slope | seen |\n|---|---|---|---|---|");
    let mut missed = Vec::new();
    for fault in FAULTS {
        let seen = fault.plant(draw);
        println!(
            "| {} | {} | {} | {} | {} |",
            fault.name, seen.cases, seen.by_bound, seen.by_slope, seen.by_either
        );
        if seen.by_either < seen.cases {
            missed.push(format!("{}: seen in {} of {}", fault.name, seen.by_either, seen.cases));
        }
    }
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

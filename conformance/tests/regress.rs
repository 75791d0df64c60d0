//! What stands around a regressor, against the reference.

use std::cell::Cell;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use vitruvian_conformance::suite::regress::faults::FAULTS;
use vitruvian_conformance::suite::regress::{Problem, RUNTIME, problems};
use vitruvian_reference::linalg::vector::norm;

/// Deterministic: the same problems in every run.
fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(20_210_615),
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(4000))]

    #[test]
    fn rotations_and_cameras_differ_by_rounding_alone(problem in problems()) {
        problem.judge(&RUNTIME).map_err(TestCaseError::fail)?;
    }
}

/// Problems in which every planted fault changes something: turns that are neither none nor half, noise above rounding.
fn ordinary() -> impl Strategy<Value = Problem> {
    problems().prop_filter("an ordinary one", |problem| {
        let turn = norm(problem.axis_angle);
        let noise = problem.noise.as_flattened().iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        (0.1..3.0).contains(&turn) && noise > 1e-10
    })
}

#[test]
fn every_planted_fault_is_seen_in_every_problem() {
    let mut missed = Vec::new();
    for fault in FAULTS {
        let (cases, seen) = (Cell::new(0), Cell::new(0));
        let outcome = TestRunner::new(config(100)).run(&ordinary(), |problem| {
            problem.judge(&RUNTIME).map_err(TestCaseError::fail)?;
            cases.set(cases.get() + 1);
            seen.set(seen.get() + u32::from(problem.judge(&fault.subject).is_err()));
            Ok(())
        });
        outcome.expect("healthy problems agree");
        println!("| {} | {} | {} |", fault.name, cases.get(), seen.get());
        if seen.get() < cases.get() {
            missed.push(format!("{}: seen in {} of {}", fault.name, seen.get(), cases.get()));
        }
    }
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

//! The runtime's skinning against the reference.

use std::cell::Cell;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use vitruvian_conformance::suite::body::Skinning;
use vitruvian_conformance::suite::body::faults::FAULTS;
use vitruvian_conformance::suite::body::problems::{human_frames, ordinary, skinning};
use vitruvian_conformance::{convert, tolerance};
use vitruvian_reference::body::mannequin;
use vitruvian_runtime::file::body;

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
    #![proptest_config(config(400))]

    #[test]
    fn random_bodies_differ_by_rounding_alone(problem in skinning()) {
        problem.judge().map_err(TestCaseError::fail)?;
    }
}

fn judge_human(body: vitruvian_reference::body::BodyModel) {
    let frames = human_frames(&body, 40);
    let agreement = Skinning { body, frames }.judge().expect("rounding alone");
    println!("{agreement:?}");
    let allowed = tolerance::skinning().allowed;
    assert!(agreement.worst_m <= allowed, "{agreement:?}, {allowed:e} m allowed");
}

#[test]
fn the_mannequin_is_posed_within_the_measured_tolerance() {
    judge_human(mannequin());
}

/// `../shared/bodies/mh24.npz`, or the body that VITRUVIAN_BODY names; no part of this repository.
#[test]
fn a_real_body_is_posed_within_the_measured_tolerance_where_one_is_at_hand() {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/bodies/mh24.npz");
    let path = std::env::var_os("VITRUVIAN_BODY").map_or(beside, PathBuf::from);
    if !path.is_file() {
        eprintln!("not judged, {} is missing: name a body in VITRUVIAN_BODY", path.display());
        return;
    }
    judge_human(convert::body_to_reference(body::read(&path).expect("a body")));
}

#[test]
fn every_planted_fault_is_seen_in_every_problem() {
    let mut missed = Vec::new();
    for fault in FAULTS {
        let (cases, seen) = (Cell::new(0), Cell::new(0));
        let outcome = TestRunner::new(config(50)).run(&ordinary(), |healthy| {
            healthy.judge().map_err(TestCaseError::fail)?;
            let mut faulty = healthy.clone();
            (fault.plant)(&mut faulty);
            cases.set(cases.get() + 1);
            seen.set(seen.get() + u32::from(healthy.judge_against(&faulty).is_err()));
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

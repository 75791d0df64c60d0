//! The official ONNX backend tests, where `make node-tests` has written them.

use std::path::Path;

use vitruvian_conformance::audit::report::Grade;
use vitruvian_conformance::node_tests::{audits::audits, row, witness};

/// The reference computes at least as many cases.
const COMPUTED: usize = 1690;

/// The audit compares every node of at least as many cases.
const AUDITED: usize = 1620;

/// The folder of the cases, where they have been written.
fn written() -> Option<&'static Path> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/node_tests/generated"));
    if folder.join("VERSION").is_file() {
        return Some(folder);
    }
    println!("not run: {} is missing; `make node-tests` writes it", folder.display());
    None
}

#[test]
fn the_audit_raises_no_false_alarm_on_any_official_case() {
    let Some(folder) = written() else { return };
    let audits = audits(folder).expect("readable folders and ONNX Runtime");
    let compared = audits.iter().filter(|audit| audit.verdict != Grade::NotComparable).count();
    assert!(compared >= AUDITED, "{compared} cases are audited, at least {AUDITED} were expected");
    let outside = audits.iter().filter(|audit| matches!(audit.verdict, Grade::G2 | Grade::G3));
    let unknown: Vec<_> =
        outside.filter(|audit| witness::departure(&audit.name, "ONNX Runtime").is_none()).collect();
    assert!(
        unknown.is_empty(),
        "ONNX Runtime departs from the definition, or the audit cries wolf: {unknown:?}"
    );
}

#[test]
fn every_official_case_that_is_computed_is_met() {
    let Some(folder) = written() else { return };
    let rows = row::run(folder, &mut [], |_, _| ()).expect("readable folders");
    let judged = |row: &&row::Row| row.reference.is_ok();
    assert!(rows.iter().filter(judged).count() >= COMPUTED, "at least {COMPUTED} cases are computed");
    let mut wrong = Vec::new();
    for row in &rows {
        let Ok(judged) = &row.reference else { continue };
        match (judged.is_outside(), witness::reason(&row.name)) {
            (true, None) => wrong.push(format!("{}: {:?}", row.name, judged.distance)),
            (false, Some(reason)) => wrong.push(format!("{} is met, although: {reason}", row.name)),
            _ => {}
        }
    }
    for case in witness::cases() {
        if rows.iter().all(|row| row.name != case) {
            wrong.push(format!("{case} is listed, but there is no such case"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

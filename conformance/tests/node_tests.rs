//! The official ONNX backend tests, where `make node-tests` has written them.

use std::path::Path;

use vitruvian_conformance::node_tests::{table, witness};

/// No case fewer than this is computed by the reference.
const COMPUTED: usize = 1690;

#[test]
fn every_official_case_that_is_computed_is_met() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/node_tests/generated"));
    if !folder.join("VERSION").is_file() {
        println!("not run: {} is missing; `make node-tests` writes it", folder.display());
        return;
    }
    let rows = table::run(folder, &mut [], |_, _| ()).expect("readable folders");
    let judged = |row: &&table::Row| row.reference.is_ok();
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

//! The acceptance bounds on a real human surface, where one is at hand: `../shared/bodies/mh24.npz`, or VITRUVIAN_BODY.

use std::path::{Path, PathBuf};

use crate::command::{folder, vitruvian, word};

/// The body's file. It is not part of this repository; where it is missing the test says so and has nothing to judge.
fn body() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/bodies/mh24.npz");
    let path = std::env::var_os("VITRUVIAN_BODY").map_or(beside, PathBuf::from);
    if path.is_file() {
        return Some(path);
    }
    eprintln!("real_body: not judged, {} is missing: name a body in VITRUVIAN_BODY", path.display());
    None
}

#[test]
fn unseen_captures_of_a_real_body_are_reconstructed_within_the_acceptance_bounds() {
    let Some(body) = body() else { return };
    let folder = folder();
    let [captures, out] = ["captures", "out"].map(|name| folder.path().join(name));
    let people = ["--count", "3", "--seed", "3003", "--body", word(&body)];
    vitruvian(&[&["synthesize", "-o", word(&captures)], &people[..]].concat()).done();
    vitruvian(&["reconstruct", word(&captures), "-o", word(&out), "--resolution", "128"]).done();
    let words =
        ["evaluate", word(&out), word(&captures), "--json", "--min-iou", "0.72", "--max-p2s-cm", "1.5"];
    let mean = &vitruvian(&words).done().json()["mean"];
    let measure = |stage: &str, name: &str| mean[stage][name].as_f64().expect("a measure");
    assert!(measure("refined", "iou") > measure("coarse", "iou"), "{mean}");
    assert!(measure("refined", "p2s_cm") < measure("coarse", "p2s_cm"), "{mean}");
}

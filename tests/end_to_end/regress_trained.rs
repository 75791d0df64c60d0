//! The committed regressor on made-up people.

use crate::command::{folder, models, vitruvian, word};
use crate::regress::Answer;

#[test]
fn the_committed_regressor_sees_poses_and_not_the_mean_body() {
    let folder = folder();
    let captures = folder.path().join("captures");
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "3", "--seed", "4711"]).done();
    let upright = Answer::upright().write(folder.path());
    let graphs = [models().join("regressor.onnx"), upright];
    let errors = graphs.map(|graph| {
        let out = folder.path().join("out");
        vitruvian(&["regress", word(&captures), "-o", word(&out), "--graph", word(&graph)]).done();
        let of = |name: &str| {
            let report = std::fs::read(out.join(name).join("report.json")).expect("a report");
            let report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
            report["truth"]["pa_mpjpe_mm"].as_f64().expect("an error")
        };
        ["0000", "0001", "0002"].map(of).iter().sum::<f64>() / 3.0
    });
    let [found, standing] = errors;
    // Measured: 77 mm.
    assert!(
        found < 100.0 && found < 0.75 * standing,
        "{found} mm; a body that stands straight: {standing} mm"
    );
}

//! `audit diff` and `audit plan`: budgets kept and not, files written, and what is refused, with their exit status.

use std::fs;

use serde_json::Value;
use tempfile::TempDir;

use crate::command::{Outcome, folder, models, vitruvian, word};

/// Runs with these words, in which @ stands for a folder and % for that of the exported graphs.
fn audit(folder: &TempDir, words: &[&str]) -> Outcome {
    let (here, graphs) = (word(folder.path()).to_owned(), models());
    let words: Vec<String> =
        words.iter().map(|w| w.replace('@', &here).replace('%', word(&graphs))).collect();
    vitruvian(&[&["audit".to_owned()], &words[..]].concat())
}

fn json(folder: &TempDir, name: &str) -> Value {
    let text = fs::read_to_string(folder.path().join(name)).expect("the report");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn a_regressor_differs_from_itself_by_nothing() {
    let folder = folder();
    let words = [
        "diff",
        "%/regressor.onnx",
        "%/regressor.onnx",
        "--draws",
        "1",
        "--budget-mm",
        "0",
        "--json",
        "@/diff.json",
        "--html",
        "@/diff.html",
    ];
    let outcome = audit(&folder, &words);
    assert_eq!(outcome.status, 0, "{}", outcome.err);
    let report = json(&folder, "diff.json");
    assert_eq!((&report["schema"], &report["pass"]), (&"vitruvian.audit.diff/1".into(), &true.into()));
    assert_eq!((&report["geometry"]["kind"], &report["millimetres"]), (&"body".into(), &0.0.into()));
    assert_eq!(report["attribution"]["costs"], Value::Array(Vec::new()));
    let page = fs::read_to_string(folder.path().join("diff.html")).expect("the page");
    assert!(page.contains("PA-MPJPE") && page.contains("\"millimetres\""), "the measures and the mesh");
}

#[test]
fn a_plan_s_graph_is_compared_and_a_budget_that_it_does_not_keep_ends_with_one() {
    let folder = folder();
    let plan = [
        "plan",
        "%/regressor.onnx",
        "--to",
        "f16",
        "--budget-mm",
        "100",
        "--draws",
        "1",
        "--write",
        "@/half.onnx",
        "--list",
        "@/keep.txt",
    ];
    let outcome = audit(&folder, &plan);
    assert_eq!(outcome.status, 0, "{}", outcome.err);
    assert_eq!(
        fs::read_to_string(folder.path().join("keep.txt")).expect("the list"),
        "",
        "100 mm keep nothing"
    );
    let outcome = audit(
        &folder,
        &[
            "diff",
            "%/regressor.onnx",
            "@/half.onnx",
            "--draws",
            "1",
            "--budget-mm",
            "0.001",
            "--no-attribution",
            "--junit",
            "@/diff.xml",
        ],
    );
    assert_eq!(outcome.status, 1, "{}", outcome.out);
    assert!(outcome.err.contains("0.001 mm are allowed"), "{}", outcome.err);
    assert!(outcome.out.contains("exceeded"), "{}", outcome.out);
    let xml = fs::read_to_string(folder.path().join("diff.xml")).expect("the test cases");
    let document = roxmltree::Document::parse(&xml).expect("XML");
    let failures: Vec<_> = document
        .descendants()
        .filter(|element| element.has_tag_name("failure"))
        .map(|failure| failure.parent_element().and_then(|case| case.attribute("name")))
        .collect();
    assert_eq!(failures, [Some("millimetres")], "{xml}");
}

#[test]
fn what_cannot_be_compared_is_refused_in_one_line() {
    let folder = folder();
    let refused = |words: &[&str], status: i32, why: &str| {
        let outcome = audit(&folder, words);
        assert_eq!(outcome.status, status, "{}", outcome.err);
        assert!(outcome.err.contains(why) && outcome.err.trim().lines().count() == 1, "{}", outcome.err);
    };
    refused(&["diff", "%/regressor.onnx", "%/vsr_query.onnx"], 2, "cannot be paired");
    refused(&["diff", "%/vsr_query.onnx", "%/vsr_query.onnx"], 2, "--encoder");
    refused(&["diff", "%/regressor.onnx", "@/absent.onnx"], 2, "absent.onnx");
    refused(&["diff", "%/regressor.onnx", "%/regressor.onnx", "--budget-mm=-1"], 2, "--budget-mm");
}

//! All cases on all parties, as a Markdown file.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::audits::Audited;
use super::expected::Distance;
use super::row::{Judged, Row};
use super::witness;
use crate::audit::report::Grade;

/// What one party did over several cases.
#[derive(Default)]
struct Tally {
    computed: usize,
    within: usize,
    official: usize,
    csu: f64,
    ulp: u64,
}

impl Tally {
    fn add(&mut self, judged: &Result<Judged, String>) {
        let Ok(judged) = judged else { return };
        self.computed += 1;
        self.official += usize::from(judged.official);
        if let Some(Ok(distance)) = &judged.distance {
            self.within += usize::from(distance.within);
            self.csu = self.csu.max(distance.csu);
            self.ulp = self.ulp.max(distance.ulp);
        }
    }
}

/// The file: a summary, a line for each operator, and by name all that does not simply pass.
pub fn markdown(version: &str, engines: &[&str], rows: &[Row], audits: &[Audited]) -> String {
    let mut text = String::new();
    let mut write = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    write("# The official ONNX backend tests".into());
    write(String::new());
    write(format!(
        "{} cases of {}. `make node-tests` writes them and this file.",
        rows.len(),
        version.trim()
    ));
    write(HOW.into());
    summary(engines, rows, &mut write);
    operators(engines, rows, &mut write);
    witnesses(rows, &mut write);
    near_zero(rows, &mut write);
    disagreements(engines, rows, &mut write);
    audited(audits, &mut write);
    write("\n## Cases that the reference does not compute\n".into());
    grouped(
        rows.iter().filter_map(|row| Some((&row.name[..], &row.reference.as_ref().err()?[..]))),
        &mut write,
    );
    for (k, engine) in engines.iter().enumerate() {
        write(format!("\n## Other cases that {engine} does not run\n"));
        let others = rows.iter().filter(|row| row.reference.is_ok());
        grouped(
            others.filter_map(|row| Some((&row.name[..], &row.engines[k].as_ref().err()?[..]))),
            &mut write,
        );
    }
    text
}

const HOW: &str = "
How to read it: the reference computes every case in f64 and derives, for every element, how far an answer in the graph's
own precision may be off; *within* counts the cases whose every element stays inside (integers and truths exactly).
Element type and shape must be the same in any case. *csu* is the largest error in units of one rounding of what the
operator handled there, *ulp* the largest distance in numbers of the element type, both measured from the reference.
The stored expectation is judged like any party; it was computed by NumPy. *Official* counts what meets the stored
expectation by ONNX's own rule, 10⁻⁷ + 10⁻³·|expected|.
";

fn summary(engines: &[&str], rows: &[Row], write: &mut impl FnMut(String)) {
    write("## Summary\n".into());
    let columns: Vec<String> =
        engines.iter().map(|name| format!("{name} runs | of which judged | within | official")).collect();
    write(format!(
        "| kind | cases | reference computes | stored within | official | {} |",
        columns.join(" | ")
    ));
    write(format!("|---|{}", "---|".repeat(4 + 4 * engines.len())));
    let mut kinds: Vec<&str> = rows.iter().map(|row| row.kind.as_str()).collect();
    kinds.dedup();
    kinds.push("all");
    for kind in kinds {
        let chosen: Vec<&Row> = rows.iter().filter(|row| kind == "all" || row.kind == kind).collect();
        let own = tally(chosen.iter().map(|row| &row.reference));
        let mut line =
            format!("| {kind} | {} | {} | {} | {} |", chosen.len(), own.computed, own.within, own.official);
        for k in 0..engines.len() {
            let tally = tally(chosen.iter().map(|row| &row.engines[k]));
            let judged = |row: &&&Row| row.engines[k].as_ref().is_ok_and(|judged| judged.distance.is_some());
            let judged = chosen.iter().filter(judged).count();
            let _ = write!(line, " {} | {judged} | {} | {} |", tally.computed, tally.within, tally.official);
        }
        write(line);
    }
}

fn tally<'a>(all: impl Iterator<Item = &'a Result<Judged, String>>) -> Tally {
    let mut tally = Tally::default();
    all.for_each(|judged| tally.add(judged));
    tally
}

fn operators(engines: &[&str], rows: &[Row], write: &mut impl FnMut(String)) {
    write("\n## By operator\n".into());
    let columns: Vec<String> =
        engines.iter().map(|name| format!("{name}: runs | within | csu | ulp | official")).collect();
    write(format!(
        "| operator | cases | reference computes | stored: within | csu | ulp | official | {} |",
        columns.join(" | ")
    ));
    write(format!("|---|{}", "---|".repeat(6 + 5 * engines.len())));
    let mut groups: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    for row in rows {
        groups.entry(&row.operator).or_default().push(row);
    }
    for (operator, rows) in groups {
        let own = tally(rows.iter().map(|row| &row.reference));
        let mut line = format!("| {operator} | {} | {} |", rows.len(), own.computed);
        let mut cells = |tally: &Tally| {
            let _ = write!(
                line,
                " {} | {} | {} | {} |",
                tally.within,
                number(tally.csu),
                steps(tally.ulp),
                tally.official
            );
        };
        cells(&own);
        for k in 0..engines.len() {
            let tally = tally(rows.iter().map(|row| &row.engines[k]));
            let _ = write!(line, " {} |", tally.computed);
            let _ = write!(
                line,
                " {} | {} | {} | {} |",
                tally.within,
                number(tally.csu),
                steps(tally.ulp),
                tally.official
            );
        }
        write(line);
    }
}

fn number(csu: f64) -> String {
    match csu {
        0.0 => "0".into(),
        0.1..1000.0 => format!("{csu:.1}"),
        _ => format!("{csu:.0e}"),
    }
}

fn steps(ulp: u64) -> String {
    if ulp > 1_000_000_000 { "> 10⁹".into() } else { ulp.to_string() }
}

fn witnesses(rows: &[Row], write: &mut impl FnMut(String)) {
    write("\n## Stored expectations outside of rounding\n".into());
    write("| case | csu | ulp | largest error | why |\n|---|---|---|---|---|".into());
    for row in rows {
        let Ok(judged) = &row.reference else { continue };
        let why = witness::reason(&row.name).unwrap_or("**not explained**");
        match &judged.distance {
            Some(Ok(Distance { within: false, csu, ulp, error })) => {
                write(format!("| {} | {} | {} | {error:.1e} | {why} |", row.name, number(*csu), steps(*ulp)))
            }
            Some(Err(mismatch)) => write(format!("| {} | | | {mismatch} | {why} |", row.name)),
            _ => {}
        }
    }
}

/// Where the official rule calls the reference wrong although the stored expectation lies within rounding of it.
fn near_zero(rows: &[Row], write: &mut impl FnMut(String)) {
    write("\n## Within rounding, but not by the official rule\n".into());
    write(
        "The sums of these cases cancel: 10⁻³ of what is left is less than what rounding leaves behind.\n"
            .into(),
    );
    write("| case | csu | ulp | largest error |\n|---|---|---|---|".into());
    for row in rows {
        let Ok(Judged { distance: Some(Ok(distance)), official: false }) = &row.reference else { continue };
        if distance.within {
            let Distance { csu, ulp, error, .. } = *distance;
            write(format!("| {} | {} | {} | {error:.1e} |", row.name, number(csu), steps(ulp)));
        }
    }
}

fn disagreements(engines: &[&str], rows: &[Row], write: &mut impl FnMut(String)) {
    write("\n## Where the engines disagree with the reference\n".into());
    write(
        "| case | engine | csu | ulp | largest error | meets the stored expectation officially | why |"
            .into(),
    );
    write("|---|---|---|---|---|---|---|".into());
    for row in rows {
        for (engine, judged) in engines.iter().zip(&row.engines) {
            let Ok(judged) = judged else { continue };
            let official = if judged.official { "yes" } else { "no" };
            let why = witness::departure(&row.name, engine).unwrap_or_default();
            match &judged.distance {
                Some(Ok(Distance { within: false, csu, ulp, error })) => write(format!(
                    "| {} | {engine} | {} | {} | {error:.1e} | {official} | {why} |",
                    row.name,
                    number(*csu),
                    steps(*ulp)
                )),
                Some(Err(mismatch)) => {
                    write(format!("| {} | {engine} | | | {mismatch} | {official} | {why} |", row.name));
                }
                _ => {}
            }
        }
    }
}

/// What the audit, which judges each node from the engine's own operands, says of each case.
fn audited(audits: &[Audited], write: &mut impl FnMut(String)) {
    write("\n## Audits of ONNX Runtime on these cases\n".into());
    write("| verdict | cases |\n|---|---|".into());
    let mut verdicts: Vec<Grade> = audits.iter().map(|audit| audit.verdict).collect();
    verdicts.sort_unstable();
    for same in verdicts.chunk_by(|a, b| a == b) {
        write(format!("| {} | {} |", same[0], same.len()));
    }
    write("\n| outside rounding | verdict | first at |\n|---|---|---|".into());
    for audit in audits.iter().filter(|audit| matches!(audit.verdict, Grade::G2 | Grade::G3)) {
        let at = audit.first_outside.as_deref().unwrap_or_default();
        write(format!("| {} | {} | {at} |", audit.name, audit.verdict));
    }
}

/// Cases by the reason why they were not computed.
fn grouped<'a>(refused: impl Iterator<Item = (&'a str, &'a str)>, write: &mut impl FnMut(String)) {
    let mut reasons: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (case, why) in refused {
        // The case is named anyway, and which of its files it was does not matter.
        let why = why.strip_prefix(&format!("{case}: ")).unwrap_or(why);
        let why = why.split_once(".pb: ").map_or(why, |(_, why)| why).replace('|', "\\|");
        reasons.entry(why).or_default().push(case);
    }
    write("| why | number | cases |\n|---|---|---|".into());
    for (why, cases) in reasons {
        write(format!("| {why} | {} | {} |", cases.len(), cases.join(", ")));
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use prost::Message as _;

    use super::super::case::Case;
    use super::super::engine::Engine;
    use super::super::row::run;
    use super::*;
    use crate::onnx::builder::GraphBuilder;
    use crate::onnx::message::TensorProto;
    use crate::onnx::typed_tensor::{Elements, TypedTensor};

    fn file(path: &Path, values: &[f32]) {
        let tensor = TensorProto {
            dims: vec![values.len() as i64],
            data_type: Some(1),
            float_data: values.to_vec(),
            ..TensorProto::default()
        };
        std::fs::write(path, tensor.encode_to_vec()).expect("a file");
    }

    /// A folder with one case: x + x, and what is expected of it.
    fn case(operator: &str, expected: &[f32]) -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("a folder");
        let data = root.path().join("node/test_it/test_data_set_0");
        std::fs::create_dir_all(&data).expect("a folder");
        let graph =
            GraphBuilder::new(21).input("x", &[2]).node(operator, &["x", "x"], &["y"], vec![]).output("y");
        std::fs::write(root.path().join("node/test_it/model.onnx"), graph.to_bytes()).expect("a file");
        file(&data.join("input_0.pb"), &[1.0, 0.1]);
        file(&data.join("output_0.pb"), expected);
        root
    }

    /// An engine that answers what it is told.
    struct Parrot(Vec<f32>);

    impl Engine for Parrot {
        fn name(&self) -> &'static str {
            "parrot"
        }

        fn run(&mut self, _: &Case) -> Result<Vec<TypedTensor>, String> {
            Ok(vec![TypedTensor::new(&[self.0.len()], Elements::F32(self.0.clone()))?])
        }
    }

    fn one(root: &tempfile::TempDir, answer: &[f32]) -> Row {
        let mut engines: Vec<Box<dyn Engine>> = vec![Box::new(Parrot(answer.to_vec()))];
        run(root.path(), &mut engines, |_, _| ()).expect("a readable folder").remove(0)
    }

    #[test]
    fn a_right_answer_is_within_and_a_wrong_one_is_named() {
        let root = case("Add", &[2.0, 0.2]);
        let right = one(&root, &[2.0, 0.2]);
        assert_eq!((&right.operator[..], &right.name[..]), ("Add", "test_it"));
        assert!(!right.reference.as_ref().expect("computed").is_outside(), "2x");
        assert!(!right.engines[0].as_ref().expect("run").is_outside(), "2x");
        for wrong in [&[2.0, 0.200_01][..], &[2.0, f32::NAN], &[2.0]] {
            let row = one(&root, wrong);
            assert!(row.engines[0].as_ref().expect("run").is_outside(), "{wrong:?} for 2x");
            let text = markdown("a test", &["parrot"], &[row], &[]);
            let lines = text.lines().skip_while(|line| !line.contains("engines disagree"));
            assert!(
                lines.take_while(|line| !line.contains("does not compute")).any(|l| l.contains("test_it"))
            );
        }
        let row = one(&root, &[2.0, 0.200_1]);
        assert!(row.engines[0].as_ref().expect("run").official, "ONNX's rule lets half a thousandth pass");
    }

    #[test]
    fn a_wrong_expectation_is_seen_and_so_is_what_is_not_computed() {
        let row = one(&case("Add", &[2.0, 0.3]), &[2.0, 0.2]);
        assert!(row.reference.as_ref().expect("computed").is_outside(), "0.3 for 0.2");
        assert!(!row.engines[0].as_ref().expect("run").is_outside(), "the engine is right");
        let text = markdown("a test", &["parrot"], &[row], &[]);
        assert!(text.contains("| test_it |") && text.contains("not explained"), "{text}");
        let foreign = one(&case("Frobnicate", &[2.0, 0.2]), &[2.0, 0.2]);
        assert!(foreign.reference.as_ref().expect_err("refused").contains("Frobnicate"), "by name");
        assert!(markdown("a test", &["parrot"], &[foreign], &[]).contains("| Frobnicate: "), "listed");
    }
}

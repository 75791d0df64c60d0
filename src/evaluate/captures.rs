//! Reconstructions against the captures that they were made from.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Map, Value, json};
use vitruvian_runtime::error::Error;

use super::surfaces::{self, Measures, Sampling};
use super::{Findings, sides};
use crate::failure::{Failure, Result};
use crate::{progress, table};

/// The surfaces that a reconstruction writes, in the order of its stages.
const STAGES: [&str; 2] = ["coarse", "refined"];

/// Formats in which they may have been written.
const EXTENSIONS: [&str; 2] = ["ply", "obj"];

/// A result's folder and the truth that belongs to it.
struct Case {
    name: String,
    /// One per stage.
    predicted: [Option<PathBuf>; 2],
    truth: PathBuf,
}

/// Compares a result with its capture, or every result in a folder with the capture of its name.
pub fn evaluate(predicted: &Path, truth: &Path, sampling: &Sampling) -> Result<Findings> {
    let cases = find(predicted, truth)?;
    let bar = progress::bar("evaluate", cases.len() as u64);
    let rows: Vec<[Option<Measures>; 2]> = cases
        .par_iter()
        .map(|case| {
            let measured = measure(case, sampling);
            bar.inc(1);
            measured
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();

    let of_stage = |stage: usize| rows.iter().filter_map(|row| row[stage]).collect::<Vec<_>>();
    let means = [0, 1].map(|stage| Measures::mean(&of_stage(stage)));
    let last = means[1].or(means[0]);
    let json_of = |row: &[Option<Measures>; 2]| -> Value {
        STAGES.iter().zip(row).map(|(stage, m)| ((*stage).to_owned(), json!(m))).collect::<Map<_, _>>().into()
    };
    let captures: Map<String, Value> =
        cases.iter().zip(&rows).map(|(case, row)| (case.name.clone(), json_of(row))).collect();
    let json = json!({
        "files": sides(predicted, truth),
        "captures": captures,
        "mean": json_of(&means),
        "sampling": sampling.json(),
    });
    Ok(Findings {
        iou: last.and_then(|m| m.iou),
        p2s_cm: last.map(|m| m.p2s_cm),
        ..Findings::new(text(&cases, &rows, &means, sampling), json)
    })
}

fn text(
    cases: &[Case],
    rows: &[[Option<Measures>; 2]],
    means: &[Option<Measures>; 2],
    sampling: &Sampling,
) -> String {
    let mut head = vec!["capture", "surface"];
    head.extend(Measures::HEAD);
    head.push("pieces");
    let named = cases.iter().map(|case| case.name.as_str()).zip(rows);
    let mean = (rows.len() > 1).then_some(("mean", means));
    let lines: Vec<Vec<String>> = named
        .chain(mean)
        .flat_map(|(name, row)| {
            STAGES.iter().zip(row).filter_map(move |(stage, measures)| {
                let measures = measures.as_ref()?;
                let mut line = vec![name.to_owned(), (*stage).to_owned()];
                line.extend(measures.cells());
                line.push(measures.pieces.to_string());
                Some(line)
            })
        })
        .collect();
    format!("{}\n{}", table::aligned(&head, &lines), sampling.words())
}

fn measure(case: &Case, sampling: &Sampling) -> Result<[Option<Measures>; 2]> {
    let truth = surfaces::read(&case.truth)?;
    let mut row = [None; 2];
    for (measures, path) in row.iter_mut().zip(&case.predicted) {
        let Some(path) = path else { continue };
        let found = surfaces::measure(&surfaces::read(path)?, &truth, sampling);
        *measures = Some(found.ok_or_else(|| surfaces::without_area(path, &case.truth))?);
    }
    Ok(row)
}

fn find(predicted: &Path, truth: &Path) -> Result<Vec<Case>> {
    if let Some(case) = case(predicted, truth)? {
        return Ok(vec![case]);
    }
    let mut cases = Vec::new();
    let entries = std::fs::read_dir(predicted).map_err(|e| Error::io(predicted, e))?;
    for folder in entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()) {
        let Some(name) = folder.file_name() else { continue };
        cases.extend(case(&folder, &truth.join(name))?);
    }
    if cases.is_empty() {
        return Err(Failure::Usage(format!(
            "{}: holds no coarse or refined mesh (.ply, .obj), nor folders with them: run `vitruvian reconstruct` first",
            predicted.display()
        )));
    }
    cases.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(cases)
}

/// The case of one folder; `None` if it holds no surface.
fn case(predicted: &Path, capture: &Path) -> Result<Option<Case>> {
    let surface = |stage: &str| {
        EXTENSIONS.iter().map(|e| predicted.join(format!("{stage}.{e}"))).find(|path| path.is_file())
    };
    let found = STAGES.map(surface);
    if found.iter().all(Option::is_none) {
        return Ok(None);
    }
    let truth = capture.join("mesh.obj");
    if !truth.is_file() {
        return Err(Failure::Usage(format!(
            "{}: there is no such file: {} needs the capture's true surface to be judged by",
            truth.display(),
            predicted.display()
        )));
    }
    let name = predicted.file_name().unwrap_or(predicted.as_os_str());
    Ok(Some(Case { name: name.to_string_lossy().into_owned(), predicted: found, truth }))
}

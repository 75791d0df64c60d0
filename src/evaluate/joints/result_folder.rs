//! Results of `fit` and `regress` against the captures that they were made from.
//!
//! A fit has its joints in the world of the capture, one body for all views, and is compared there. A regression has one body
//! for each view, in that camera's axes; the truth is turned into them, X_c = R X + t. With `--per-view` so are fits, each by
//! the cameras that it found.

use std::path::{Path, PathBuf};

use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_runtime::capture::Extrinsics;
use vitruvian_runtime::error::Error;

use super::Evaluation;
use super::arguments::Choices;
use super::array::{Sequence, Side};
use super::measures::{Errors, Row, Rows};
use super::pairing::{Description, Pair};
use super::views::Views;
use crate::failure::{Failure, Result};
use crate::progress;

/// Whether a folder is a result with joints.
pub fn is_result(path: &Path) -> bool {
    path.join("joints.npz").is_file()
}

/// Whether a folder holds such folders.
pub fn holds_results(path: &Path) -> bool {
    folders(path).is_ok_and(|found| found.iter().any(|folder| is_result(folder)))
}

/// Whether a folder is a capture with a true body.
pub fn is_truth(path: &Path) -> bool {
    path.join("body.npz").is_file()
}

/// The folders in a folder, by name.
fn folders(path: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
    let mut found: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    found.sort();
    Ok(found)
}

/// Compares a result with its capture, or every result in a folder with the capture of its name.
pub fn evaluate(predicted: &Path, truth: &Path, label: &str, choices: &Choices) -> Result<Evaluation> {
    let evaluation = |errors, pair, rows| Evaluation {
        label: label.to_owned(),
        predicted: predicted.to_owned(),
        truth: truth.to_owned(),
        errors,
        pair,
        rows,
    };
    if is_truth(truth) || predicted.is_file() {
        let (errors, pair, views) = one(predicted, truth, choices)?;
        return Ok(evaluation(errors, pair, Rows::Views(views).unless_single()));
    }
    let results: Vec<PathBuf> = folders(predicted)?.into_iter().filter(|folder| is_result(folder)).collect();
    if results.is_empty() {
        return Err(Failure::Usage(format!(
            "{}: there is no such file: the joints of {} need a true body to be judged by",
            truth.join("body.npz").display(),
            predicted.display()
        )));
    }
    let name_of = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let bar = progress::bar("evaluate", results.len() as u64);
    let mut captures = Vec::new();
    let mut description: Option<Description> = None;
    for result in &results {
        let name = name_of(result);
        let (errors, pair, _) = one(result, &truth.join(&name), choices)?;
        let first = description.get_or_insert_with(|| pair.clone());
        if *first != pair {
            let message =
                format!("has other joints ({}) than the results before it ({})", pair.sets, first.sets);
            return Err(Error::file(result, message).into());
        }
        captures.push((name, errors));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let missing = folders(truth)?
        .into_iter()
        .filter(|folder| is_truth(folder))
        .map(|folder| name_of(&folder))
        .filter(|name| captures.iter().all(|(found, _)| found != name))
        .collect();
    let errors = Errors::concatenated(captures.iter().map(|(_, errors)| errors));
    let pair = description.expect("there is at least one result");
    Ok(evaluation(errors, pair, Rows::Captures(captures, missing)))
}

impl Rows {
    /// A body in the world is one row, which is the total.
    fn unless_single(self) -> Rows {
        match self {
            Rows::Views(views) if views.is_empty() => Rows::None,
            rows => rows,
        }
    }
}

/// The errors of one result: of all frames, and of each view where it has views.
fn one(result: &Path, capture: &Path, choices: &Choices) -> Result<(Errors, Description, Vec<Row>)> {
    let (file, parameters) = match result.is_dir() {
        true => (result.join(choices.file_of_result()), result.join("params.npz")),
        false => (result.to_owned(), result.to_owned()),
    };
    let body = capture.join("body.npz");
    if !body.is_file() {
        return Err(Failure::Usage(format!(
            "{}: there is no such file: {} needs the capture's true body to be judged by",
            body.display(),
            result.display()
        )));
    }
    let found = choices.read(&file, Side::Predicted)?;
    let truth = choices.read(&body, Side::Truth)?;
    let Some(views) = Views::read(&parameters, capture, choices.per_view)? else {
        let pair = Pair::new(&found, &truth, choices)?;
        return Ok((Errors::of(&pair), pair.description, Vec::new()));
    };
    let found = match views.found {
        None => found,
        Some(cameras) => turned(found, &cameras)?,
    };
    if found.frames.len() != views.names.len() {
        let message = format!(
            "holds {} frames, but {} names {} images",
            found.frames.len(),
            parameters.display(),
            views.names.len()
        );
        return Err(Error::file(&file, message).into());
    }
    let pair = Pair::new(&found, &turned(truth, &views.cameras)?, choices)?;
    let of_view = |view: usize| {
        let only = |[a, b]: &[Vec<Vec<Vector3>>; 2]| [vec![a[view].clone()], vec![b[view].clone()]];
        let (raw, relative) = (only(&pair.raw), only(&pair.relative));
        Errors::of(&Pair { raw, relative, description: pair.description.clone() })
    };
    let rows = views.names.into_iter().enumerate().map(|(view, name)| (name, of_view(view))).collect();
    Ok((Errors::of(&pair), pair.description, rows))
}

/// The one body of a file in the axes of each camera.
fn turned(body: Sequence, cameras: &[Extrinsics]) -> Result<Sequence> {
    let [joints] = &body.frames[..] else {
        let message =
            format!("holds {} frames; expected one body, to be seen from each camera", body.frames.len());
        return Err(Error::file(&body.path, message).into());
    };
    let from = |camera: &Extrinsics| joints.iter().map(|&joint| camera.to_camera(joint)).collect();
    Ok(Sequence { frames: cameras.iter().map(from).collect(), ..body })
}

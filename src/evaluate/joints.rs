//! Joints in 3-D: the error of Li 2021 eq. 2.7, MPJPE, PCK and AUC, as they stand and after Procrustes alignment.

mod arguments;
mod array;
mod measures;
mod pairing;
mod pck_chart;
mod posed;
mod report;
mod result_folder;
mod views;

use std::path::{Path, PathBuf};

pub use self::arguments::Arguments;
use self::arguments::Choices;
use self::array::Side;
use self::measures::{Errors, Rows};
use self::pairing::Pair;
use super::Findings;
use crate::failure::{Failure, Result};

/// How far one prediction is from the truth.
struct Evaluation {
    /// Its name beside others.
    label: String,
    predicted: PathBuf,
    truth: PathBuf,
    /// The errors of all its frames.
    errors: Errors,
    /// The joints that were compared, and what they are relative to.
    pair: pairing::Description,
    /// The parts that have a row of their own.
    rows: Rows,
}

/// Whether the pair is one of joints: files of joints or parameters, or folders with results of `fit` or `regress`.
pub fn are_joints(predicted: &Path, truth: &Path) -> bool {
    let is_file = |path: &Path| path.is_file() && array::is_readable(path);
    match (is_file(predicted), is_file(truth)) {
        (true, true) => true,
        (true, false) => result_folder::is_truth(truth),
        (false, true) => false,
        (false, false) => result_folder::is_result(predicted) || result_folder::holds_results(predicted),
    }
}

/// Compares each of `predicted` with `truth`.
pub fn evaluate(
    predicted: &[PathBuf],
    truth: &Path,
    body: Option<&Path>,
    arguments: &Arguments,
) -> Result<Findings> {
    let choices = Choices::new(body, arguments, predicted)?;
    let labelled = predicted.iter().zip(&choices.labels);
    let evaluations =
        labelled.map(|(path, label)| one(path, truth, label, &choices)).collect::<Result<Vec<_>>>()?;
    if let Some(path) = &arguments.curve {
        pck_chart::draw(path, &evaluations)?;
    }
    Ok(report::findings(&evaluations, truth, arguments.per_joint))
}

fn one(predicted: &Path, truth: &Path, label: &str, choices: &Choices) -> Result<Evaluation> {
    if truth.is_dir() {
        return result_folder::evaluate(predicted, truth, label, choices);
    }
    if predicted.is_dir() {
        return Err(Failure::Usage(format!(
            "{} is a folder and {} a file: give the capture's folder as the truth",
            predicted.display(),
            truth.display()
        )));
    }
    let found = choices.read(predicted, Side::Predicted)?;
    let pair = Pair::new(&found, &choices.read(truth, Side::Truth)?, choices)?;
    Ok(Evaluation {
        label: label.to_owned(),
        predicted: predicted.to_owned(),
        truth: truth.to_owned(),
        errors: Errors::of(&pair),
        pair: pair.description,
        rows: Rows::None,
    })
}

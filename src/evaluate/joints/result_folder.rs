//! Results of `fit` and `regress` against the captures that they were made from.
//!
//! A fit has its joints in the world of the capture, one body for all views, and is compared there. A regression has one body
//! for each view, in that camera's axes; the truth is turned into them, X_c = R X + t. With `--per-view` so are fits, each by
//! the cameras that it found.

use std::path::{Path, PathBuf};

use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_runtime::capture::{self, Camera, Extrinsics};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npz::Npz;

use super::Evaluation;
use super::arguments::Choices;
use super::array::{Sequence, Side};
use super::measures::{Errors, Row, Rows};
use super::pairing::{Description, Pair};
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
    let pair = description.unwrap_or_else(|| unreachable!("there is at least one result"));
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

/// The views that a result has a body for.
struct Views {
    names: Vec<String>,
    /// The capture's cameras of these names.
    cameras: Vec<Extrinsics>,
    /// Those that a fit found; a regression is in their axes already.
    found: Option<Vec<Extrinsics>>,
}

impl Views {
    /// What a result's parameters say of its views; `None` for a body in the world.
    fn read(parameters: &Path, capture: &Path, per_view: bool) -> Result<Option<Views>> {
        let is_npz =
            parameters.is_file() && parameters.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        let mut npz = if is_npz { Some(Npz::open(parameters)?) } else { None };
        let (names, found) = match &mut npz {
            Some(npz) if npz.contains("names") => (npz.texts("names")?, None),
            Some(npz) if per_view => {
                let rotations = npz.shaped::<f64>("R", &[None, Some(3), Some(3)])?;
                let n = rotations.shape[0];
                let translations = npz.shaped::<f64>("t", &[Some(n), Some(3)])?;
                let rows =
                    |values: &[f64]| values.chunks_exact(3).map(|r| [r[0], r[1], r[2]]).collect::<Vec<_>>();
                let turns = rows(&rotations.values);
                let found = turns.chunks_exact(3).zip(rows(&translations.values));
                let found = found.map(|(r, t)| Extrinsics { r: [r[0], r[1], r[2]], t }).collect();
                let names = npz.texts("camera_names")?;
                if names.len() != n {
                    let message =
                        format!("array \"camera_names\" holds {} names for {n} cameras", names.len());
                    return Err(Error::file(parameters, message).into());
                }
                (names, Some(found))
            }
            _ if per_view => {
                let message = "is not there; --per-view needs the cameras in it".to_owned();
                return Err(Error::file(parameters, message).into());
            }
            _ => return Ok(None),
        };
        let all = capture::read_cameras(capture)?;
        let camera = |name: &String| camera_of(&all, name, capture, parameters);
        let cameras = names.iter().map(camera).collect::<Result<_>>()?;
        Ok(Some(Views { names, cameras, found }))
    }
}

/// Where the camera of an image's name stands; the name may have a folder and an extension.
fn camera_of(cameras: &[Camera], name: &str, capture: &Path, parameters: &Path) -> Result<Extrinsics> {
    let stem = Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let camera = cameras
        .iter()
        .find(|camera| camera.name == name)
        .or_else(|| cameras.iter().find(|camera| Some(&camera.name) == stem.as_ref()));
    let Some(camera) = camera else {
        let known: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
        let message =
            format!("is of the image {name}, but {} has the cameras {}", capture.display(), known.join(", "));
        return Err(Error::file(parameters, message).into());
    };
    camera.extrinsics.ok_or_else(|| {
        let message = "has no R and t, so that the truth cannot be seen from it".to_owned();
        Error::camera(capture, name, message).into()
    })
}

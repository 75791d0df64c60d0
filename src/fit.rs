//! `vitruvian fit`: pose, shape and cameras of the person that a capture shows.

mod batch;
pub mod fitted;
mod joint_fit;
mod marks;
mod mixture;
mod mv_smplify;
mod observed;
pub mod overlay;
mod report;
mod sequence;
mod settings;
mod view_starts;
mod write;

use std::path::{Path, PathBuf};

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::Parameters;
use vitruvian_runtime::error::Error;

use self::fitted::Fitted;
use self::observed::Observed;
use self::settings::{Choices, Settings};
use crate::captures::{self, Job};
use crate::failure::{Failure, Result};
use crate::output_folder::OutputFolder;
use crate::{body, progress};

/// Fit a body to a capture: joints of several views (chapter 2), then silhouettes (chapter 3), or from a network (chapter 4)
///
/// Writes params.npz (poses, betas, trans, cameras), body.ply, joints.npz, report.json and overlay_NAME.png into OUT. A
/// folder of captures is a sequence of one person: each frame starts from the one before, results go to a folder for each,
/// and all frames together to OUT/params.npz, joints.npz and report.json (offsets, and cameras that were found, stay with
/// their frames). Exit status 1: a body was found and written, but the report says why it is not to be trusted.
///
/// A file BATCH.npz of many scenes is for --method mv-smplify in a training loop: OUT is then a file as well.
#[derive(clap::Args)]
pub struct Arguments {
    /// Capture (a folder with cameras.json and keypoints/, or masks/ as well), or a folder of captures, or BATCH.npz
    capture: PathBuf,
    /// Folder for the results; a file for those of a batch
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    choices: Choices,
    /// Fit every capture of a folder by itself
    #[arg(long)]
    independent: bool,
    /// Go on after the last frame that an interrupted run finished
    #[arg(long)]
    resume: bool,
}

/// Fits one capture, every capture of a folder, or every scene of a batch.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.capture.is_file() {
        return batch::run(arguments);
    }
    OutputFolder::check(&arguments.out)?;
    let body = body::load(arguments.choices.body.as_deref())?;
    let settings = Settings::new(&arguments.choices, &body)?;
    let jobs = captures::jobs(&arguments.capture, &arguments.out)?;
    let is_sequence = captures::is_sequence(&arguments.capture, &jobs);
    let bar = progress::bar("fit", jobs.len() as u64);
    let (mut failures, mut placed, mut resumed) = (Vec::new(), Vec::new(), 0);
    let mut before = None;
    for job in &jobs {
        let Job { capture, out } = job;
        let start = before.take().filter(|_| !arguments.independent);
        if arguments.resume && sequence::is_finished(job, &settings)? {
            before = sequence::parameters(job, &settings)?;
            placed.push(job);
            resumed += 1;
            bar.inc(1);
            continue;
        }
        let warn = |words: &str| bar.suspend(|| eprintln!("warning: {words}"));
        let failure = match one(capture, out, &settings, start.as_ref(), &warn) {
            Ok((fitted, why)) => {
                placed.push(job);
                if why.is_none() {
                    bar.suspend(|| eprintln!("{}: {}", out.display(), fitted.words()));
                    before = Some(fitted.parameters);
                }
                why.map(|why| Failure::Negative(format!("{}: {why}", capture.display())))
            }
            Err(failure) => Some(failure),
        };
        if let Some(failure) = failure {
            if is_sequence {
                bar.suspend(|| eprintln!("error: {failure}"));
            }
            failures.push(failure);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if resumed > 0 {
        eprintln!("{resumed} of {} captures were done already", jobs.len());
    }
    if is_sequence {
        sequence::join(&placed, &arguments.out, &settings)?;
    }
    verdict(failures, jobs.len(), is_sequence)
}

/// Fits `body` to the joints and masks of one capture, pose included, and writes the results into the folder `out`.
pub fn to_joints_and_masks(capture: &Path, body: &BodyModel, out: &Path) -> Result<Fitted> {
    let choices = Choices { refine_pose: true, ..Choices::default() };
    let settings = Settings::new(&choices, body)?;
    Ok(one(capture, out, &settings, None, &|words| eprintln!("warning: {words}"))?.0)
}

/// Reads, fits and writes one capture; with why the answer is not to be trusted, if it is not.
fn one(
    capture: &Path,
    out: &Path,
    settings: &Settings,
    before: Option<&Parameters>,
    warn: &dyn Fn(&str),
) -> Result<(Fitted, Option<String>)> {
    let observed = Observed::read(capture, settings)?;
    observed.warnings.iter().for_each(|words| warn(words));
    let fitted = Fitted::of(&observed, settings, before)?;
    fitted.warnings(&observed, settings).iter().for_each(|words| warn(words));
    let folder = OutputFolder::begin(out)?;
    write::write(&folder, &observed, &fitted, settings)?;
    folder.place(&write::stale(settings))?;
    let why = fitted.distrust(&observed);
    Ok((fitted, why))
}

/// The exit of the run: one capture's own failure, or how many of a sequence failed; a frame without a body (status 2)
/// weighs more than one that is not to be trusted (status 1).
fn verdict(mut failures: Vec<Failure>, all: usize, is_sequence: bool) -> Result<()> {
    if failures.is_empty() {
        return Ok(());
    }
    if !is_sequence {
        return Err(failures.remove(0));
    }
    let words = format!("{} of {all} captures failed, see above", failures.len());
    let negative_only = failures.iter().all(|f| matches!(f, Failure::Negative(_)));
    Err(if negative_only { Failure::Negative(words) } else { Failure::Usage(words) })
}

/// A usage error about a file.
fn refuse(path: &Path, message: impl Into<String>) -> Failure {
    Error::file(path, message.into()).into()
}

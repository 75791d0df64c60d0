//! Many frames of one person: going on after an interruption, and the files of all frames together.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::Parameters;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npz::Npz;
use vitruvian_runtime::file::params::{self, Counts};
use vitruvian_runtime::file::{atomic, read_text};

use super::settings::Settings;
use super::{refuse, write};
use crate::captures::Job;
use crate::failure::{Failure, Result};
use crate::output_folder::OutputFolder;

/// A frame's report is far smaller.
const MAX_REPORT_BYTES: u64 = 16 << 20;

/// Whether an earlier run with the same settings has finished this frame.
pub fn is_finished(job: &Job, settings: &Settings) -> Result<bool> {
    let path = report_of(job);
    if !path.is_file() {
        return Ok(false);
    }
    let (found, wanted) = (&read_report(&path)?["options"], settings.json());
    if *found != wanted {
        let message = format!(
            "was fitted with other options ({found}, now {wanted}): use the same, or another --out, or leave --resume away"
        );
        return Err(refuse(&path, message));
    }
    Ok(true)
}

fn report_of(job: &Job) -> PathBuf {
    job.out.join("report.json")
}

/// The parameters that a finished frame was left with, if it was to be trusted: where the next frame begins.
pub fn parameters(job: &Job, settings: &Settings) -> Result<Option<Parameters>> {
    if read_report(&report_of(job))?["success"] != json!(true) {
        return Ok(None);
    }
    let found = read_frame(job, settings)?;
    let camera = |view: &params::View| {
        let [[fx, _, cx], [_, fy, cy], _] = view.k;
        Pinhole {
            focal_px: [fx, fy],
            principal_px: [cx, cy],
            distortion: [0.0; 5],
            rotation: view.extrinsics.r,
            translation: view.extrinsics.t,
        }
    };
    let mut betas = found.betas_of(0).to_vec();
    betas.resize(settings.body.beta_count(), 0.0);
    Ok(Some(Parameters {
        pose: found.poses[0].clone(),
        betas,
        trans: found.trans[0],
        cameras: found.views.iter().map(camera).collect(),
    }))
}

/// Writes params.npz, joints.npz and report.json of all frames that have a body, in their order, into `out`.
///
/// Cameras that all frames share go with them; those that were found anew for each frame stay with it.
pub fn join(jobs: &[&Job], out: &Path, settings: &Settings) -> Result<()> {
    let mut all = params::Parameters {
        poses: Vec::new(),
        betas: Vec::new(),
        trans: Vec::new(),
        offsets: Vec::new(),
        views: Vec::new(),
    };
    let (mut joints, mut frames, mut views) = (Vec::new(), Vec::new(), Vec::new());
    for job in jobs {
        let found = read_frame(job, settings)?;
        all.poses.extend_from_slice(&found.poses);
        all.betas.push(found.betas_of(0).to_vec());
        all.trans.extend_from_slice(&found.trans);
        let mut npz = Npz::open(&job.out.join("joints.npz"))?;
        let array = npz.shaped::<f64>("joints", &[Some(1), Some(settings.body.joint_count()), Some(3)])?;
        joints.push(array.values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect());
        frames.push(summary(&read_report(&report_of(job))?));
        views.push(found.views);
    }
    if frames.is_empty() {
        return Ok(());
    }
    if views.windows(2).all(|pair| pair[0] == pair[1]) {
        all.views = views.swap_remove(0);
    }
    let folder = OutputFolder::begin(out)?;
    params::write(&folder.file("params.npz"), &all)?;
    write::joints(&folder.file("joints.npz"), &joints)?;
    let report = json!({ "options": settings.json(), "frames": frames });
    atomic::write(&folder.file("report.json"), format!("{report:#}\n").as_bytes())?;
    folder.place(&[])
}

/// What the sequence's report says of a frame.
fn summary(report: &Value) -> Value {
    json!({
        "capture": report["capture"],
        "success": report["success"],
        "verdict": report["verdict"],
        "energy_px2": report["joints"]["energy_px2"],
        "noise_px": report["joints"]["noise_px"],
        "mean_iou": report["mean_iou"],
    })
}

fn read_frame(job: &Job, settings: &Settings) -> Result<params::Parameters> {
    params::read(&job.out.join("params.npz"), &counts(settings.body)).map_err(|error| damaged(job, &error))
}

/// A result of an earlier run that cannot be gone on from.
fn damaged(job: &Job, error: &Error) -> Failure {
    Failure::Usage(format!("{error}; remove {} to fit this frame again", job.out.display()))
}

fn counts(body: &BodyModel) -> Counts {
    Counts { vertices: body.vertex_count(), joints: body.joint_count(), betas: body.beta_count() }
}

fn read_report(path: &Path) -> Result<Value> {
    let text = read_text(path, MAX_REPORT_BYTES)?;
    let fault = |e| refuse(path, format!("is no report: {e}; remove its folder to fit this frame again"));
    serde_json::from_str(&text).map_err(fault)
}

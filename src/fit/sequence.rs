//! Many frames of one person: going on after an interruption, and the files of all frames together.

use std::path::Path;

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
use crate::failure::Result;
use crate::output_folder::OutputFolder;

/// A frame's report is far smaller.
const MAX_REPORT_BYTES: u64 = 16 << 20;

/// How many frames an interrupted run with the same settings has finished: the first that has no report stops the count.
pub fn finished(jobs: &[Job], settings: &Settings) -> Result<usize> {
    let wanted = settings.json();
    for (number, job) in jobs.iter().enumerate() {
        let path = job.out.join("report.json");
        if !path.is_file() {
            return Ok(number);
        }
        let found = &read_report(&path)?["options"];
        if *found != wanted {
            return Err(refuse(
                &path,
                format!(
                    "was fitted with other options ({found}, now {wanted}): use the same, or another --out, or leave --resume away"
                ),
            ));
        }
    }
    Ok(jobs.len())
}

/// The parameters that a finished frame was left with, if it was to be trusted: where the next frame begins.
pub fn parameters(job: &Job, settings: &Settings) -> Result<Option<Parameters>> {
    if read_report(&job.out.join("report.json"))?["success"] != json!(true) {
        return Ok(None);
    }
    let found = params::read(&job.out.join("params.npz"), &counts(settings.body))?;
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
pub fn join(jobs: &[Job], out: &Path, settings: &Settings) -> Result<()> {
    let mut all = params::Parameters {
        poses: Vec::new(),
        betas: Vec::new(),
        trans: Vec::new(),
        offsets: Vec::new(),
        views: Vec::new(),
    };
    let (mut joints, mut frames) = (Vec::new(), Vec::new());
    for job in jobs.iter().filter(|job| job.out.join("report.json").is_file()) {
        let found = params::read(&job.out.join("params.npz"), &counts(settings.body))?;
        all.poses.extend_from_slice(&found.poses);
        all.betas.push(found.betas_of(0).to_vec());
        all.trans.extend_from_slice(&found.trans);
        let mut npz = Npz::open(&job.out.join("joints.npz"))?;
        let array = npz.shaped::<f64>("joints", &[Some(1), Some(settings.body.joint_count()), Some(3)])?;
        joints.push(array.values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect());
        frames.push(summary(&read_report(&job.out.join("report.json"))?));
    }
    if frames.is_empty() {
        return Ok(());
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

fn counts(body: &BodyModel) -> Counts {
    Counts { vertices: body.vertex_count(), joints: body.joint_count(), betas: body.beta_count() }
}

fn read_report(path: &Path) -> Result<Value> {
    let text = read_text(path, MAX_REPORT_BYTES)?;
    serde_json::from_str(&text).map_err(|e| Error::file(path, format!("is no report: {e}")).into())
}

//! `vitruvian evaluate`: how far a result is from the truth.

mod captures;
mod joints;
mod largest_piece;
mod masks;
pub mod surfaces;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::failure::{Failure, Result};
use crate::table;

/// Measure a result against the truth: meshes, masks, joints, or folders of them
///
/// Two meshes (.ply, .obj): P2S and completeness in cm, Chamfer-L2 in 10⁻² m², IoU of the volumes.
/// Two masks (.png), or two folders of masks: IoU.
/// Two files of joints in metres (.npz, .npy: [F, J, 3], [J, 3], [F, 3J]; arrays named joints, S, pred_joints, gt_joints and the
/// like), or of parameters as `pose` reads them (AMASS, 3DPW, SPIN, HMR): joint errors in mm, PCK@150 and AUC in %.
/// A folder that `reconstruct`, `fit` or `regress` wrote and its capture, or folders of them and of captures: a row per capture,
/// means and, of joints, medians. Results of `regress` are compared in the axes of each camera.
///
/// Several PREDICTED are compared with one TRUTH if they are joints.
#[derive(clap::Args)]
pub struct Arguments {
    /// What is judged; several of joints
    #[arg(required = true)]
    predicted: Vec<PathBuf>,
    /// What it is judged by
    truth: PathBuf,
    /// Write the result to standard output as JSON
    #[arg(long)]
    json: bool,
    /// Exit with status 1 if the IoU (mean, of refined meshes where there are any) is below this
    #[arg(long)]
    min_iou: Option<f64>,
    /// Exit with status 1 if the P2S in cm (mean, of refined meshes where there are any) is above this
    #[arg(long)]
    max_p2s_cm: Option<f64>,
    /// Exit with status 1 if the MPJPE in mm (mean over captures, the worst PREDICTED) is above this
    #[arg(long)]
    max_mpjpe_mm: Option<f64>,
    /// Exit with status 1 if the PA-MPJPE in mm is above this
    #[arg(long)]
    max_pa_mpjpe_mm: Option<f64>,
    /// Body model that poses are given to where there are no joints; the built-in mannequin without it
    #[arg(long)]
    body: Option<PathBuf>,
    #[command(flatten)]
    sampling: surfaces::Sampling,
    #[command(flatten)]
    joints: joints::Arguments,
}

/// What an evaluation found: for people, for machines, and for the bounds.
pub struct Findings {
    /// The table.
    pub text: String,
    /// The same as JSON.
    pub json: Value,
    /// What `--min-iou` judges; `None` where it was not measured.
    pub iou: Option<f64>,
    /// What `--max-p2s-cm` judges; `None` where it was not measured.
    pub p2s_cm: Option<f64>,
    /// What `--max-mpjpe-mm` judges; `None` where it was not measured.
    pub mpjpe_mm: Option<f64>,
    /// What `--max-pa-mpjpe-mm` judges; `None` where it was not measured.
    pub pa_mpjpe_mm: Option<f64>,
}

impl Findings {
    /// Findings that no bound can judge.
    fn new(text: String, json: Value) -> Findings {
        Findings { text, json, iou: None, p2s_cm: None, mpjpe_mm: None, pa_mpjpe_mm: None }
    }
}

/// The kinds of things that can be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Mesh,
    Mask,
    Joints,
    Folder,
}

impl Kind {
    fn of(path: &Path) -> Result<Kind> {
        if path.is_dir() {
            return Ok(Kind::Folder);
        }
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        match extension.as_str() {
            "obj" | "ply" | "glb" => Ok(Kind::Mesh),
            "png" => Ok(Kind::Mask),
            "npz" | "npy" => Ok(Kind::Joints),
            _ => Err(Failure::Usage(format!(
                "{}: expected a folder, a mesh (.ply, .obj), a mask (.png) or joints (.npz, .npy)",
                path.display()
            ))),
        }
    }
}

/// Measures, prints, and judges the bounds.
pub fn run(arguments: &Arguments) -> Result<()> {
    let findings = measure(arguments)?;
    table::say(&if arguments.json { findings.json.to_string() } else { findings.text.clone() });
    judge(arguments, &findings)
}

fn measure(arguments: &Arguments) -> Result<Findings> {
    let Arguments { predicted: all, truth, body, .. } = arguments;
    let truth_kind = Kind::of(truth)?;
    let kinds = all.iter().map(|path| Kind::of(path)).collect::<Result<Vec<_>>>()?;
    if all.iter().all(|predicted| joints::are_joints(predicted, truth)) {
        return joints::evaluate(all, truth, body.as_deref(), &arguments.joints);
    }
    let ([predicted], [kind]) = (&all[..], &kinds[..]) else {
        let message = format!("{} predictions: several are compared only if all are joints", all.len());
        return Err(Failure::Usage(message));
    };
    match (kind, truth_kind) {
        (Kind::Mesh, Kind::Mesh) => surfaces::evaluate(predicted, truth, &arguments.sampling),
        (Kind::Mask, Kind::Mask) => masks::evaluate(predicted, truth),
        (Kind::Folder, Kind::Folder) if masks::is_folder_of_masks(predicted) => {
            masks::evaluate_folders(predicted, truth)
        }
        (Kind::Folder, Kind::Folder) => captures::evaluate(predicted, truth, &arguments.sampling),
        (kind, truth_kind) => Err(Failure::Usage(format!(
            "{} is a {} and {} is a {}: give two of a kind",
            predicted.display(),
            kind.name(),
            truth.display(),
            truth_kind.name()
        ))),
    }
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Mesh => "mesh",
            Kind::Mask => "mask",
            Kind::Joints => "file of joints",
            Kind::Folder => "folder",
        }
    }
}

fn judge(arguments: &Arguments, findings: &Findings) -> Result<()> {
    let unmeasured =
        |option: &str, what: &str| Failure::Usage(format!("{option}: no {what} was measured here"));
    if let Some(bound) = arguments.min_iou {
        let iou = findings.iou.ok_or_else(|| unmeasured("--min-iou", "IoU"))?;
        if iou < bound || iou.is_nan() {
            return Err(Failure::Negative(format!("IoU {iou:.4} is below the bound {bound}")));
        }
    }
    if let Some(bound) = arguments.max_p2s_cm {
        let p2s = findings.p2s_cm.ok_or_else(|| unmeasured("--max-p2s-cm", "P2S"))?;
        if p2s > bound || p2s.is_nan() {
            return Err(Failure::Negative(format!("P2S {p2s:.4} cm is above the bound {bound} cm")));
        }
    }
    let of_joints = [
        ("MPJPE", "--max-mpjpe-mm", arguments.max_mpjpe_mm, findings.mpjpe_mm),
        ("PA-MPJPE", "--max-pa-mpjpe-mm", arguments.max_pa_mpjpe_mm, findings.pa_mpjpe_mm),
    ];
    for (name, option, bound, found) in of_joints {
        let Some(bound) = bound else { continue };
        let error = found.ok_or_else(|| unmeasured(option, name))?;
        if error > bound || error.is_nan() {
            return Err(Failure::Negative(format!("{name} {error:.2} mm is above the bound {bound} mm")));
        }
    }
    Ok(())
}

/// Names the two sides in a JSON result.
fn sides(predicted: &Path, truth: &Path) -> Value {
    json!({ "predicted": predicted.display().to_string(), "truth": truth.display().to_string() })
}

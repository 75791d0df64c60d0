//! Joints in 3-D: the error of Li 2021 eq. 2.7, MPJPE, PCK and AUC, raw and after Procrustes alignment.

use std::path::Path;

use serde::Serialize;
use serde_json::json;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::linalg::vector::{Vector3, add};
use vitruvian_reference::metric::joints::{
    joint_errors, mean_joint_error, mpjpe, pa_mpjpe, procrustes_aligned, root_relative,
};
use vitruvian_reference::metric::pck::{PCK_THRESHOLD_M, auc, pck};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npz::Npz;
use vitruvian_runtime::file::params::{self, Counts};

use super::{Findings, sides};
use crate::body;
use crate::failure::Result;

/// The joint that the others are seen from: the pelvis.
const ROOT: usize = 0;

/// Means over frames and joints.
#[derive(Debug, Serialize)]
struct Measures {
    frames: usize,
    joints: usize,
    /// Eq. 2.7, without any alignment.
    error_mm: f64,
    mpjpe_mm: f64,
    pa_mpjpe_mm: f64,
    pck_150: f64,
    auc: f64,
    pa_pck_150: f64,
    pa_auc: f64,
}

/// Compares two files of joints, or of parameters that are posed first.
pub fn evaluate(predicted: &Path, truth: &Path, body: Option<&Path>) -> Result<Findings> {
    let found = frames(predicted, body)?;
    let expected = frames(truth, body)?;
    let shape = |frames: &[Vec<Vector3>]| (frames.len(), frames.first().map_or(0, Vec::len));
    let ((f, j), (tf, tj)) = (shape(&found), shape(&expected));
    if (f, j) != (tf, tj) || f == 0 || j == 0 {
        let message = format!("holds {f} frames of {j} joints, but {} holds {tf} of {tj}", truth.display());
        return Err(Error::file(predicted, message).into());
    }
    let measures = measure(&found, &expected);
    let lines = [
        ("error (eq. 2.7)", format!("{:.1} mm", measures.error_mm)),
        ("MPJPE", format!("{:.1} mm", measures.mpjpe_mm)),
        ("PA-MPJPE", format!("{:.1} mm", measures.pa_mpjpe_mm)),
        ("PCK@150", format!("{:.1} %", measures.pck_150)),
        ("AUC", format!("{:.1} %", measures.auc)),
        ("PA PCK@150", format!("{:.1} %", measures.pa_pck_150)),
        ("PA AUC", format!("{:.1} %", measures.pa_auc)),
    ];
    let mut text: Vec<String> = lines.iter().map(|(name, value)| format!("{name:<16}{value:>10}")).collect();
    text.push(format!("{f} frames of {j} joints"));
    Ok(Findings {
        text: text.join("\n"),
        json: json!({ "files": sides(predicted, truth), "measures": measures }),
        iou: None,
        p2s_cm: None,
    })
}

fn measure(found: &[Vec<Vector3>], expected: &[Vec<Vector3>]) -> Measures {
    let pairs = || found.iter().zip(expected);
    let frames = found.len();
    let mean_mm = |of: fn(&[Vector3], &[Vector3]) -> f64| {
        1000.0 * pairs().map(|(a, b)| of(a, b)).sum::<f64>() / frames as f64
    };
    let relative: Vec<f64> =
        pairs().flat_map(|(a, b)| joint_errors(&root_relative(a, ROOT), &root_relative(b, ROOT))).collect();
    let aligned: Vec<f64> = pairs().flat_map(|(a, b)| joint_errors(&procrustes_aligned(a, b), b)).collect();
    Measures {
        frames,
        joints: found[0].len(),
        error_mm: mean_mm(mean_joint_error),
        mpjpe_mm: mean_mm(|a, b| mpjpe(a, b, ROOT)),
        pa_mpjpe_mm: mean_mm(pa_mpjpe),
        pck_150: pck(&relative, PCK_THRESHOLD_M),
        auc: auc(&relative),
        pa_pck_150: pck(&aligned, PCK_THRESHOLD_M),
        pa_auc: auc(&aligned),
    }
}

/// The joints of every frame: as they stand in the file, or posed from its parameters.
fn frames(path: &Path, body: Option<&Path>) -> Result<Vec<Vec<Vector3>>> {
    let mut npz = Npz::open(path)?;
    if !npz.contains("joints") {
        return posed(path, &body::load(body)?);
    }
    let array = npz.array::<f64>("joints")?;
    if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
        let message = format!("array \"joints\" holds {} at {i}; expected finite numbers", array.values[i]);
        return Err(Error::file(path, message).into());
    }
    let joints = match array.shape[..] {
        [j, 3] | [_, j, 3] if j > 0 => j,
        _ => {
            let message =
                format!("array \"joints\" has the shape {:?}, expected [J, 3] or [F, J, 3]", array.shape);
            return Err(Error::file(path, message).into());
        }
    };
    let rows: Vec<Vector3> = array.values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    Ok(rows.chunks_exact(joints).map(<[Vector3]>::to_vec).collect())
}

fn posed(path: &Path, body: &BodyModel) -> Result<Vec<Vec<Vector3>>> {
    let counts =
        Counts { vertices: body.vertex_count(), joints: body.joint_count(), betas: body.beta_count() };
    let parameters = params::read(path, &counts)?;
    let skeleton = body.skeleton();
    let frames = parameters.poses.iter().zip(&parameters.trans).enumerate();
    Ok(frames
        .map(|(f, (pose, trans))| {
            let joints = skeleton.posed_joints(pose, parameters.betas_of(f));
            joints.into_iter().map(|joint| add(joint, *trans)).collect()
        })
        .collect())
}

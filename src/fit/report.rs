//! `report.json`: what was fitted, how each stage ended, and how well the answer explains what was seen.

use serde_json::{Map, Value, json};
use vitruvian_reference::fitting::Extrinsics;
use vitruvian_reference::fitting::silhouette::{SilhouetteFit, SilhouetteStage, StageKind};
use vitruvian_reference::linalg::vector::norm;

use super::fitted::Fitted;
use super::observed::Observed;
use super::settings::Settings;

/// The report of one capture.
pub fn report(observed: &Observed, fitted: &Fitted, settings: &Settings) -> Value {
    let joints = &fitted.joints;
    let set = observed.observation.keypoint_set;
    let views: Map<String, Value> = joints
        .views()
        .iter()
        .enumerate()
        .map(|(i, view)| {
            let residual = json!({
                "keypoints": view.count,
                "mean_px": view.mean_px,
                "median_px": view.median_px,
                "rms_px": view.rms_px,
                "max_px": view.max_px,
            });
            (observed.name(i).to_owned(), json!({ "residual": residual, "iou": fitted.iou[i] }))
        })
        .collect();
    let seconds: Map<String, Value> =
        fitted.seconds.iter().map(|(stage, seconds)| ((*stage).to_owned(), json!(seconds))).collect();
    json!({
        "capture": observed.path.display().to_string(),
        "options": settings.json(),
        "success": fitted.distrust(observed).is_none(),
        "verdict": joints.verdict(),
        "why": fitted.distrust(observed),
        "extrinsics": match observed.observation.extrinsics {
            Extrinsics::Known => "known",
            Extrinsics::Unknown => "unknown",
        },
        "joints": joints.json(set),
        "silhouettes": fitted.silhouettes.as_ref().map(|fit| silhouettes(fit, observed)),
        "views": views,
        "mean_iou": fitted.mean_iou(),
        "seconds": seconds,
    })
}

fn silhouettes(fit: &SilhouetteFit, observed: &Observed) -> Value {
    let by_view = |iou: &[f64]| -> Map<String, Value> {
        iou.iter().enumerate().map(|(view, iou)| (observed.name(view).to_owned(), json!(iou))).collect()
    };
    let stage = |stage: &SilhouetteStage| {
        json!({
            "stage": match stage.kind {
                StageKind::Pose => "pose".to_owned(),
                StageKind::Shape(k) => format!("shape {}", k + 1),
            },
            "energy_before": stage.energy_before,
            "energy": stage.energy,
            "iterations": stage.iterations,
            "evaluations": stage.evaluations,
            "ending": stage.termination.to_string(),
            "correspondences": stage.correspondences,
            "iou": by_view(&stage.iou),
            "offsets_smoothed": stage.damping.repair_rounds,
            "offsets_scaled": stage.damping.scale,
            "undone": stage.reverted,
        })
    };
    let longest = fit.offsets.iter().map(|&d| norm(d)).fold(0.0, f64::max);
    json!({
        "iou_before": by_view(&fit.iou_before),
        "mean_iou_before": fit.mean_iou()[0],
        "stages": fit.stages.iter().map(stage).collect::<Vec<_>>(),
        "mask_bias_px": fit.mask_bias_px,
        "largest_offset_m": longest,
    })
}

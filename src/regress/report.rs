//! `report.json`: what was looked at, by what, under which conventions, and what was found.

use serde_json::{Map, Value, json};
use vitruvian_runtime::contract::PoseForm;
use vitruvian_runtime::library;
use vitruvian_runtime::regress::camera::CONVENTION;

use super::Setting;
use super::people::{Errors, Found, People};
use super::photograph::Source;

/// The report of one source.
pub fn report(source: &Source, people: &People, setting: &Setting, seconds: f64) -> Value {
    let photographs: Map<String, Value> =
        people.found.iter().map(|one| (one.name.clone(), photograph(one))).collect();
    json!({
        "capture": match source {
            Source::Capture(path, _) => Some(path.display().to_string()),
            Source::Photographs(_) => None,
        },
        "body": setting.body.as_ref().map(|path| path.display().to_string()),
        "graph": setting.graph,
        "pose_form": match setting.regressor.pose_form() {
            PoseForm::Matrices => "rotation matrices",
            PoseForm::SixD => "six numbers a joint",
            PoseForm::AxisAngle => "axis-angle",
        },
        "image_size": setting.regressor.image_size(),
        "focal_length_px": setting.regressor.focal_length_px(),
        "onnx_runtime": library::loaded().map(|r| json!({ "version": r.version, "build": r.build })),
        "conventions": {
            "camera": "(s, t_x, t_y): (x, y) of the body is at s (x + t_x), s (y + t_y) from the crop's middle, in halves of its side",
            "trans": CONVENTION,
            "pose": "axis-angle, radians; the root in the photograph's camera axes, the others relative to their parents",
        },
        "photographs": photographs,
        "truth": people.mean_errors().map(errors),
        "seconds": seconds,
    })
}

fn photograph(one: &Found) -> Value {
    let (person, person_from) = &one.person;
    let (k, k_from) = &one.k;
    let [u, v, side] = one.crop;
    json!({
        "file": one.place,
        "person": { "from": person_from, "center_px": person.center_px, "side_px": person.side_px },
        "crop": { "origin_px": [u, v], "side_px": side },
        "camera": one.camera,
        "K": k,
        "K_from": k_from,
        "trans": one.trans,
        "betas": one.betas,
        "truth": one.errors.map(errors),
    })
}

fn errors(errors: Errors) -> Value {
    json!({ "mpjpe_mm": errors.mpjpe_mm, "pa_mpjpe_mm": errors.pa_mpjpe_mm })
}

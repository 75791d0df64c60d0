//! `report.json`: what was done, with what, at which cost, and how good it is where the truth is known.

use std::path::Path;

use serde_json::{Map, Value, json};
use vitruvian_conformance::convert;
use vitruvian_reference::surface::topology::Topology;
use vitruvian_runtime::implicit_field::Mode;
use vitruvian_runtime::library;
use vitruvian_runtime::reconstruct::{Options, Surface};

use super::body_capture::BodyCapture;
use crate::evaluate::surfaces::Sampling;

/// The report of one capture; `graphs` are those of [`super::models::describe`].
pub fn report(path: &Path, done: &BodyCapture, options: &Options, graphs: &[Value]) -> Value {
    let surfaces: Map<String, Value> =
        done.surfaces().map(|(name, surface)| (name.to_owned(), describe(surface))).collect();
    let mut seconds = Map::from_iter([("read".to_owned(), json!(done.seconds_to_read))]);
    seconds.extend(done.found.seconds.iter().filter_map(|(stage, seconds)| {
        let name = serde_json::to_value(stage).ok()?.as_str()?.to_owned();
        Some((name, json!(seconds)))
    }));
    let truth = done.truth.as_ref().map(|_| {
        seconds.insert("measure".to_owned(), json!(done.seconds_to_measure));
        json!({
            "coarse": done.measures[0],
            "refined": done.measures[1],
            "sampling": Sampling::default().json(),
        })
    });
    let runtime = library::loaded();
    json!({
        "capture": path.display().to_string(),
        "views": done.views.iter().map(|view| view.camera.name.as_str()).collect::<Vec<_>>(),
        "options": {
            "resolution": options.resolution,
            "dense": options.mode == Mode::Dense,
            "refine": done.found.refined.is_some(),
        },
        "onnx_runtime": runtime.map(|r| json!({ "version": r.version, "build": r.build })),
        "graphs": graphs,
        "body": { "centre": done.region.centre, "origin": done.region.origin, "side": done.region.side },
        "surfaces": surfaces,
        "open_columns": done.found.open_columns,
        "truth": truth,
        "seconds": seconds,
    })
}

fn describe(surface: &Surface) -> Value {
    let mesh = convert::mesh_to_reference(&surface.mesh);
    let topology = Topology::of(&mesh);
    let field = &surface.field;
    json!({
        "vertices": mesh.vertices.len(),
        "faces": mesh.faces.len(),
        "components": topology.components,
        "closed": topology.is_closed(),
        "volume_m3": mesh.signed_volume(),
        "cube": { "origin": surface.cube.origin, "side": surface.cube.side },
        "field": {
            "resolution": field.resolution,
            "coarse_resolution": field.coarse_resolution,
            "dense_points": field.points,
            "asked": field.asked,
            "outside": field.outside,
            "dense_over_asked": field.points as f64 / field.asked.max(1) as f64,
            "cells": field.cells,
        },
    })
}

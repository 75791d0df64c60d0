//! The files of one fitted capture.

use vitruvian_conformance::convert;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_runtime::capture::{Camera, Extrinsics, picture};
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::{self, atomic, npz, params};

use super::fitted::Fitted;
use super::observed::Observed;
use super::overlay::{self, Shown};
use super::settings::Settings;
use super::{marks, report};
use crate::failure::Result;
use crate::output_folder::OutputFolder;

/// Writes params.npz, joints.npz, the body, report.json and an overlay for each view.
pub fn write(folder: &OutputFolder, observed: &Observed, fitted: &Fitted, settings: &Settings) -> Result<()> {
    let cameras: Vec<Camera> = observed
        .capture
        .views
        .iter()
        .zip(&fitted.parameters.cameras)
        .map(|(view, found)| placed(&view.camera, found))
        .collect();
    params::write(&folder.file("params.npz"), &parameters(fitted, &cameras))?;
    joints(&folder.file("joints.npz"), std::slice::from_ref(&fitted.posed.joints))?;

    let body = Mesh::new(fitted.posed.vertices.clone(), settings.body.faces.clone());
    let body = convert::mesh_to_runtime(&body);
    let format = settings.format.format();
    file::mesh::write(&folder.file(&format!("body.{}", format.extension())), format, &body, None)?;

    for (index, (view, camera)) in observed.capture.views.iter().zip(&cameras).enumerate() {
        let marks = marks::of_view(observed, fitted, settings.body, index);
        let shown =
            Shown { camera, photograph: view.image.as_ref(), mask: view.mask.as_ref(), marks: &marks };
        let name = format!("overlay_{}.png", camera.name);
        picture::write_rgb(&folder.file(&name), &overlay::draw(&body, &shown))?;
    }
    let report = report::report(observed, fitted, settings);
    atomic::write(&folder.file("report.json"), format!("{report:#}\n").as_bytes())?;
    Ok(())
}

/// Bodies in other formats that an earlier run left.
pub fn stale(settings: &Settings) -> Vec<&'static str> {
    let extension = settings.format.format().extension();
    ["body.ply", "body.obj", "body.glb"].into_iter().filter(|name| !name.ends_with(extension)).collect()
}

/// Writes joints \[F,J,3\], metres, world frame.
pub fn joints(path: &std::path::Path, frames: &[Vec<Vector3>]) -> Result<()> {
    let per_frame = frames.first().map_or(0, Vec::len);
    let flat: Vec<f64> = frames.iter().flatten().flatten().copied().collect();
    let shape = [frames.len(), per_frame, 3];
    npz::write(path, &[npz::Named { name: "joints", shape: &shape, values: Values::F64(&flat) }])?;
    Ok(())
}

fn parameters(fitted: &Fitted, cameras: &[Camera]) -> params::Parameters {
    let found = &fitted.parameters;
    let view = |camera: &Camera| {
        Some(params::View { name: camera.name.clone(), k: camera.k, extrinsics: camera.extrinsics? })
    };
    params::Parameters {
        poses: vec![found.pose.clone()],
        betas: vec![found.betas.clone()],
        trans: vec![found.trans],
        offsets: fitted.offsets().map(<[Vector3]>::to_vec).unwrap_or_default(),
        views: cameras.iter().filter_map(view).collect(),
    }
}

/// A camera of the capture where the fit put it.
fn placed(camera: &Camera, found: &Pinhole) -> Camera {
    let extrinsics = Extrinsics { r: found.rotation, t: found.translation };
    Camera { extrinsics: Some(extrinsics), ..camera.clone() }
}

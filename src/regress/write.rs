//! The files of one source: a mesh and a picture for each photograph, and tables of all.

use serde_json::Value;
use vitruvian_runtime::capture::{Camera, Extrinsics, picture};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named};
use vitruvian_runtime::file::{self, atomic};
use vitruvian_runtime::mesh::Mesh;

use super::Setting;
use super::people::{Found, People};
use super::photograph::Photograph;
use crate::failure::Result;
use crate::fit::overlay::{self, Shown};
use crate::output_folder::OutputFolder;

/// A camera at the world's origin: bodies stand in its own axes.
const IN_PLACE: Extrinsics =
    Extrinsics { r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], t: [0.0; 3] };

/// Writes body_NAME and overlay_NAME.png of the portion that begins with the person `first`.
pub fn pictures(
    folder: &OutputFolder,
    photographs: &[Photograph],
    people: &People,
    first: usize,
    setting: &Setting,
) -> Result<()> {
    let format = setting.format.format();
    for ((photograph, found), body) in photographs.iter().zip(&people.found[first..]).zip(&people.bodies) {
        let vertices = body.vertices.iter().map(|v| v.map(|x| x as f32)).collect();
        let mesh = Mesh { vertices, faces: setting.faces.clone() };
        mesh.check().map_err(|message| Error::file(found.place.as_ref(), message))?;
        file::mesh::write(&folder.file(&mesh_name(found, format.extension())), format, &mesh, None)?;

        let camera = Camera {
            name: found.name.clone(),
            width: photograph.image.width(),
            height: photograph.image.height(),
            k: found.k.0,
            extrinsics: Some(IN_PLACE),
            distortion: [0.0; 5],
        };
        let shown = Shown { camera: &camera, photograph: Some(&photograph.image), mask: None, marks: &[] };
        let [u, v, side] = found.crop;
        let image = overlay::draw_framed(&mesh, &shown, [u, v], [u + side, v + side]);
        picture::write_rgb(&folder.file(&format!("overlay_{}.png", found.name)), &image)?;
    }
    Ok(())
}

/// Writes params.npz and joints.npz.
pub fn tables(folder: &OutputFolder, people: &People) -> Result<()> {
    let found = &people.found;
    let flat = |of: &dyn Fn(&Found) -> Vec<f64>| found.iter().flat_map(of).collect::<Vec<f64>>();
    let names: Vec<String> = found.iter().map(|one| one.name.clone()).collect();
    let count = found.len();
    let width = |values: &[f64]| values.len() / count.max(1);
    let poses = flat(&|one| one.pose.clone());
    let betas = flat(&|one| one.betas.clone());
    let trans = flat(&|one| one.trans.to_vec());
    let camera = flat(&|one| one.camera.to_vec());
    let crop = flat(&|one| one.crop.to_vec());
    let k = flat(&|one| one.k.0.as_flattened().to_vec());
    let joints = flat(&|one| one.joints.as_flattened().to_vec());
    let numbers = |name, shape, values| Named { name, shape, values: Values::F64(values) };
    let shape = |width| [count, width];
    let (of_poses, of_betas) = (shape(width(&poses)), shape(width(&betas)));
    let (threes, matrices) = (shape(3), [count, 3, 3]);
    npz::write(
        &folder.file("params.npz"),
        &[
            numbers("poses", &of_poses, &poses),
            numbers("betas", &of_betas, &betas),
            numbers("trans", &threes, &trans),
            numbers("camera", &threes, &camera),
            numbers("crop", &threes, &crop),
            numbers("K", &matrices, &k),
            Named { name: "names", shape: &[count], values: Values::Text(&names) },
        ],
    )?;
    let shape = [count, width(&joints) / 3, 3];
    npz::write(&folder.file("joints.npz"), &[numbers("joints", &shape, &joints)])?;
    Ok(())
}

/// Writes report.json.
pub fn report(folder: &OutputFolder, report: &Value) -> Result<()> {
    Ok(atomic::write(&folder.file("report.json"), format!("{report:#}\n").as_bytes())?)
}

/// Meshes in other formats that an earlier run left.
pub fn stale(people: &People, setting: &Setting) -> Vec<String> {
    let extension = setting.format.format().extension();
    let others = || ["ply", "obj", "glb"].into_iter().filter(move |other| *other != extension);
    people.found.iter().flat_map(|one| others().map(|other| mesh_name(one, other))).collect()
}

fn mesh_name(found: &Found, extension: &str) -> String {
    format!("body_{}.{extension}", found.name)
}

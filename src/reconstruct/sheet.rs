//! The contact sheet: what the cameras saw, and the surfaces seen from the same places.

use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use vitruvian_conformance::convert;
use vitruvian_reference::surface::aabb_tree::AabbTree;
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::image_input::NetworkView;
use vitruvian_runtime::mesh::Mesh;
use vitruvian_runtime::render::{CLAY, Light, Row, color_bar, contact_sheet, heat, render};

use super::body_capture::BodyCapture;

/// Side of a picture on the sheet, in pixels.
const TILE: u32 = 280;

/// More views than this are left off the sheet.
const COLUMNS: usize = 6;

/// The distance at the bright end of the heat map, in centimetres: twice what a good reconstruction errs.
const HEAT_CM: f32 = 3.0;

/// Rows: input views, coarse, refined, and where the truth is known the truth and the refined surface coloured by its
/// distance from it.
pub fn sheet(done: &BodyCapture) -> RgbImage {
    let shown = done.views.len().min(COLUMNS);
    let views = &done.views[..shown];
    let columns: Vec<&str> = views.iter().map(|view| view.camera.name.as_str()).collect();
    let photographs = done.images.iter().zip(views).map(|(image, view)| Some(crop(image, view)));
    let mut rows = vec![Row { caption: "input views".into(), pictures: photographs.collect() }];
    for ((name, surface), measures) in done.surfaces().zip(&done.measures) {
        let errors = measures.map_or(String::new(), |m| {
            let iou = m.iou.map_or(String::new(), |iou| format!(", IoU {iou:.3}"));
            format!(": P2S {:.2} cm{iou}", m.p2s_cm)
        });
        let clay = vec![CLAY; surface.mesh.vertices.len()];
        rows.push(Row {
            caption: format!("{name}{errors}"),
            pictures: pictures(&surface.mesh, &clay, views),
        });
    }
    if let Some(truth) = &done.truth {
        let mesh = convert::mesh_to_runtime(truth);
        let clay = vec![CLAY; mesh.vertices.len()];
        rows.push(Row { caption: "truth".into(), pictures: pictures(&mesh, &clay, views) });
        if let (Some((name, surface)), Some(tree)) = (done.surfaces().last(), AabbTree::new(truth)) {
            let distance_cm = |v: &[f32; 3]| (100.0 * tree.closest(v.map(f64::from)).distance()) as f32;
            let errors: Vec<f32> = surface.mesh.vertices.iter().map(distance_cm).collect();
            let mut row = pictures(&surface.mesh, &heat(&errors, HEAT_CM), views);
            row.push(Some(color_bar(TILE / 4, TILE, HEAT_CM, "cm")));
            rows.push(Row { caption: format!("{name}: distance from the truth"), pictures: row });
        }
    }
    contact_sheet(&columns, &rows)
}

/// The mesh as the views' crops see it.
fn pictures(mesh: &Mesh, colours: &[[f32; 3]], views: &[NetworkView]) -> Vec<Option<RgbImage>> {
    let normals = mesh.vertex_normals();
    let picture = |view: &NetworkView| {
        let camera = scaled(&view.camera);
        let light = Light { towards_lamp: above_left_of(&camera), ..Light::default() };
        Some(render(mesh, &normals, colours, &camera, &light).image)
    };
    views.iter().map(picture).collect()
}

/// Where the lamp stands for a camera, so that every side of the body is lit alike.
fn above_left_of(camera: &Camera) -> [f32; 3] {
    let Some(extrinsics) = camera.extrinsics else { return Light::default().towards_lamp };
    let [right, down, forward] = extrinsics.r;
    std::array::from_fn(|axis| (-0.4 * right[axis] - 0.7 * down[axis] - 0.59 * forward[axis]) as f32)
}

/// The crop's camera at the size of a tile.
fn scaled(camera: &Camera) -> Camera {
    let k = f64::from(TILE) / f64::from(camera.width);
    let mut scaled = Camera { width: TILE, height: TILE, ..camera.clone() };
    for row in &mut scaled.k[..2] {
        row.iter_mut().for_each(|entry| *entry *= k);
    }
    scaled
}

/// The part of the photograph that the network saw; white beyond its border.
fn crop(image: &RgbImage, view: &NetworkView) -> RgbImage {
    let side = view.crop.high[0] - view.crop.low[0];
    // Whole pixels are cut out; the tile is a picture to look at, not an input.
    let pixels = (side.round() as u32).clamp(1, 4 * image.width().max(image.height()));
    let mut square = RgbImage::from_pixel(pixels, pixels, Rgb([255; 3]));
    let [x, y] = view.crop.low.map(|low| -(low.round() as i64));
    imageops::overlay(&mut square, image, x, y);
    imageops::resize(&square, TILE, TILE, FilterType::Triangle)
}

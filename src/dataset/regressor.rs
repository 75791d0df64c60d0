//! Scenes for the regressor: crops of people among things, keypoints, and the bodies' parameters.

use std::path::Path;

use image::imageops::{self, FilterType};
use image::{GrayImage, Luma, RgbImage};
use rand::Rng;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::linalg::vector::sub;
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named};
use vitruvian_runtime::person_crop::{self, Crop, PersonBox};

use crate::failure::Result;
use crate::synthesis::surroundings::Wanted;
use crate::synthesis::{Scene, Settings, Surroundings, scene_rng};

/// Side of the pictures in pixels, before they are widened.
pub const PICTURE_PX: u32 = 256;

/// Side of the crops in pixels: the network's 128 and a quarter more, for moving and scaling the box in training.
const CROP_PX: u32 = 160;

/// The crop's box over the person's.
const BOX_SCALE: f64 = 1.25;

/// Most of the scenes stand somewhere; the rest keep the plain background of captures that were made without.
const WANTED: Wanted = Wanted { backgrounds: 0.8, occlusion: 0.3 };

/// Pixels that a picture gains on every side, at most: then the crop does not reach beyond it.
const WIDENED_PX: u32 = 48;

/// Sets this module's random numbers apart from the scene's.
const EXAMPLES: u64 = 0x7265_6772_6573;

/// Betas in the files, whatever the body has.
const BETAS: usize = 10;

/// Where the joints of a body are at rest: J(β) = `template` + Σ `shapedirs`ₖ βₖ, metres.
pub struct Skeleton {
    /// J·3 coordinates.
    template: Vec<f32>,
    /// J·3·10 coordinates per unit of β, zero beyond the body's betas.
    shapedirs: Vec<f32>,
}

impl Skeleton {
    /// The rest joints of a body and their changes with each beta, which are linear.
    pub fn of(body: &BodyModel) -> Skeleton {
        let at = |betas: &[f64]| body.pose(&vec![0.0; 3 * body.joint_count()], betas, [0.0; 3]).joints;
        let template = at(&[]);
        let mut shapedirs = vec![0.0; 3 * template.len() * BETAS];
        for k in 0..body.beta_count().min(BETAS) {
            let mut betas = vec![0.0; k + 1];
            betas[k] = 1.0;
            for (j, (&changed, &rest)) in at(&betas).iter().zip(&template).enumerate() {
                for (axis, difference) in sub(changed, rest).into_iter().enumerate() {
                    shapedirs[(3 * j + axis) * BETAS + k] = difference as f32;
                }
            }
        }
        Skeleton { template: template.iter().flatten().map(|&x| x as f32).collect(), shapedirs }
    }
}

/// A scene and its crops, one for each camera.
pub struct Example {
    scene: Scene,
    views: Vec<View>,
}

/// One camera's crop.
struct View {
    image: RgbImage,
    mask: GrayImage,
    /// From the camera's frame (metres) to crop pixels.
    k: [[f64; 3]; 3],
    /// (u', v') in crop pixels and a confidence: 0 behind furniture, else 1.
    keypoints: Vec<[f64; 3]>,
}

impl Example {
    /// Draws scene `index` of a run, photographs it and cuts out the person.
    pub fn random(body: &BodyModel, settings: &Settings, index: u64) -> Result<Example> {
        let mut rng = scene_rng(settings.seed ^ EXAMPLES, index);
        let mut scene = Scene::random(body, settings, index);
        let wider = if rng.random_bool(0.3) { 0 } else { rng.random_range(0..=WIDENED_PX) };
        scene.cameras.iter_mut().for_each(|camera| widen(camera, wider));
        let surroundings = Surroundings::random(&scene, settings, &WANTED, index);
        let shots = surroundings.photograph(&scene);
        let views = scene.cameras.iter().zip(shots).map(|(camera, shot)| {
            let person = PersonBox::of_mask(&shot.whole_mask)
                .ok_or_else(|| {
                    Error::Unanswerable(format!("scene {index}: camera \"{}\" sees nobody", camera.name))
                })?
                .scaled(BOX_SCALE);
            let crop = person_crop::crop(&shot.image, &person, CROP_PX)?;
            let see = |(&joint, &hidden): (_, &bool)| {
                let confidence = if hidden { 0.0 } else { 1.0 };
                let seen = camera.project(joint).map(|(pixel, _)| crop.from_photograph(pixel));
                seen.map_or([0.0; 3], |[u, v]| [u, v, confidence])
            };
            let keypoints = scene.joints.iter().zip(&shot.joint_hidden).map(see).collect();
            Ok(View {
                mask: cut_mask(&shot.mask, &crop),
                k: crop.intrinsics(camera.k),
                keypoints,
                image: crop.image,
            })
        });
        let views = views.collect::<Result<_>>()?;
        Ok(Example { scene, views })
    }
}

/// Adds `margin` pixels to every side of a camera's picture.
fn widen(camera: &mut Camera, margin: u32) {
    camera.width += 2 * margin;
    camera.height += 2 * margin;
    camera.k[0][2] += f64::from(margin);
    camera.k[1][2] += f64::from(margin);
}

/// The part of a mask that a crop holds: 255 where at least half of a crop pixel is body.
fn cut_mask(mask: &GrayImage, crop: &Crop) -> GrayImage {
    let [u, v] = crop.origin_px;
    let mut cut = GrayImage::new(crop.side_px, crop.side_px);
    imageops::replace(&mut cut, mask, -u, -v);
    let mut small = imageops::resize(&cut, CROP_PX, CROP_PX, FilterType::Triangle);
    small.pixels_mut().for_each(|Luma([value])| *value = if *value >= 128 { 255 } else { 0 });
    small
}

/// Writes one scene: N views of 24 joints, crops of S = 160 pixels.
///
/// `images` u8 [N,3,S,S], `masks` u8 [N,S,S] (255 where the person is seen), `keypoints` [N,24,3] (crop pixels, corner
/// origin, and confidence), `joints_camera` [N,24,3] (metres, each camera's axes), `K` [N,3,3] of the crop, `R` [N,3,3],
/// `t` [N,3], `poses` [72], `betas` [10], `trans` [3], `J_template` [24,3], `J_shapedirs` [24,3,10]; all f32.
pub fn write(path: &Path, example: &Example, skeleton: &Skeleton) -> Result<()> {
    let Example { scene, views } = example;
    let (n, s, joints) = (views.len(), CROP_PX as usize, scene.joints.len());
    // One plane after another, as networks take them.
    let plane =
        |v: &'_ View, c: usize| v.image.as_raw().iter().copied().skip(c).step_by(3).collect::<Vec<u8>>();
    let images: Vec<u8> = views.iter().flat_map(|v| (0..3).flat_map(|c| plane(v, c))).collect();
    let masks: Vec<u8> = views.iter().flat_map(|v| v.mask.as_raw()).copied().collect();
    let keypoints = single(views.iter().flat_map(|v| v.keypoints.as_flattened()));
    let k = single(views.iter().flat_map(|v| v.k.as_flattened()));
    let extrinsics: Vec<_> = scene.cameras.iter().filter_map(|c| c.extrinsics).collect();
    let r = single(extrinsics.iter().flat_map(|e| e.r.as_flattened()));
    let t = single(extrinsics.iter().flat_map(|e| &e.t));
    let in_cameras: Vec<[f64; 3]> =
        extrinsics.iter().flat_map(|e| scene.joints.iter().map(|&joint| e.to_camera(joint))).collect();
    let joints_camera = single(in_cameras.as_flattened());
    let poses = single(&scene.pose);
    let mut betas = single(&scene.betas);
    betas.resize(BETAS, 0.0);
    let trans = single(&scene.trans);
    npz::write(
        path,
        &[
            Named { name: "images", shape: &[n, 3, s, s], values: Values::U8(&images) },
            Named { name: "masks", shape: &[n, s, s], values: Values::U8(&masks) },
            Named { name: "keypoints", shape: &[n, joints, 3], values: Values::F32(&keypoints) },
            Named { name: "joints_camera", shape: &[n, joints, 3], values: Values::F32(&joints_camera) },
            Named { name: "K", shape: &[n, 3, 3], values: Values::F32(&k) },
            Named { name: "R", shape: &[n, 3, 3], values: Values::F32(&r) },
            Named { name: "t", shape: &[n, 3], values: Values::F32(&t) },
            Named { name: "poses", shape: &[3 * joints], values: Values::F32(&poses) },
            Named { name: "betas", shape: &[BETAS], values: Values::F32(&betas) },
            Named { name: "trans", shape: &[3], values: Values::F32(&trans) },
            Named { name: "J_template", shape: &[joints, 3], values: Values::F32(&skeleton.template) },
            Named {
                name: "J_shapedirs",
                shape: &[joints, 3, BETAS],
                values: Values::F32(&skeleton.shapedirs),
            },
        ],
    )?;
    Ok(())
}

fn single<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<f32> {
    values.into_iter().map(|&x| x as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::body::mannequin;
    use vitruvian_runtime::file::npz::Npz;

    const SETTINGS: Settings = Settings { seed: 5, views: 3, size_px: PICTURE_PX };

    /// A scene, written and opened again.
    fn written(body: &BodyModel, path: &Path, index: u64) -> Npz {
        let example = Example::random(body, &SETTINGS, index).unwrap();
        write(path, &example, &Skeleton::of(body)).unwrap();
        Npz::open(path).unwrap()
    }

    fn numbers(npz: &mut Npz, name: &str, shape: &[usize]) -> Vec<f64> {
        let shape: Vec<_> = shape.iter().map(|&n| Some(n)).collect();
        npz.shaped::<f64>(name, &shape).unwrap().values
    }

    #[test]
    fn keypoints_are_the_projections_of_the_posed_joints() {
        let body = mannequin();
        let folder = tempfile::tempdir().unwrap();
        for index in 0..3 {
            let mut npz = written(&body, &folder.path().join("scene.npz"), index);
            let pose = numbers(&mut npz, "poses", &[72]);
            let betas = numbers(&mut npz, "betas", &[10]);
            let trans = numbers(&mut npz, "trans", &[3]);
            let joints =
                body.pose(&pose, &betas[..body.beta_count().min(10)], [trans[0], trans[1], trans[2]]).joints;
            let [r, k] = ["R", "K"].map(|name| numbers(&mut npz, name, &[3, 3, 3]));
            let t = numbers(&mut npz, "t", &[3, 3]);
            let in_camera = numbers(&mut npz, "joints_camera", &[3, 24, 3]);
            let keypoints = numbers(&mut npz, "keypoints", &[3, 24, 3]);
            for (view, j) in (0..3).flat_map(|view| (0..24).map(move |j| (view, j))) {
                let row = |m: &[f64], i: usize, x: [f64; 3]| {
                    (0..3).map(|c| m[9 * view + 3 * i + c] * x[c]).sum::<f64>()
                };
                let at: [f64; 3] = std::array::from_fn(|i| row(&r, i, joints[j]) + t[3 * view + i]);
                let first = 3 * (24 * view + j);
                for i in 0..3 {
                    assert!(
                        (at[i] - in_camera[first + i]).abs() < 1e-5,
                        "scene {index} view {view} joint {j}"
                    );
                }
                let [u, v, w] = [0, 1, 2].map(|i| row(&k, i, at));
                let error = (u / w - keypoints[first]).hypot(v / w - keypoints[first + 1]);
                assert!(error < 1e-3, "scene {index} view {view} joint {j}: {error} px from its projection");
                assert!([0.0, 1.0].contains(&keypoints[first + 2]), "confidence {}", keypoints[first + 2]);
            }
        }
    }

    #[test]
    fn rest_joints_are_linear_in_the_betas() {
        let body = mannequin();
        let skeleton = Skeleton::of(&body);
        let betas: Vec<f64> = (0..body.beta_count().min(BETAS)).map(|k| 1.5 - 0.4 * k as f64).collect();
        let joints = body.pose(&vec![0.0; 72], &betas, [0.0; 3]).joints;
        for (k, &expected) in joints.as_flattened().iter().enumerate() {
            let changes = betas.iter().zip(&skeleton.shapedirs[k * BETAS..]);
            let found =
                f64::from(skeleton.template[k]) + changes.map(|(b, &d)| b * f64::from(d)).sum::<f64>();
            assert!((found - expected).abs() < 1e-6, "coordinate {k}: {found} for {expected}");
        }
    }

    #[test]
    fn same_seed_and_number_write_the_same_bytes() {
        let body = mannequin();
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a", "b"].map(|name| folder.path().join(name));
        let [a, b] = [&paths[0], &paths[1]].map(|path| {
            written(&body, path, 4);
            std::fs::read(path).unwrap()
        });
        assert!(a == b, "two runs differ");
    }

    #[test]
    fn person_fills_the_middle_of_the_crop() {
        // The box is 1.2 · 1.25 = 1.5 times the person's longer side, so the visible person lies in the middle two thirds.
        for index in 0..2 {
            for view in Example::random(&mannequin(), &SETTINGS, index).unwrap().views {
                let seen: Vec<_> = view.mask.enumerate_pixels().filter(|(_, _, p)| p.0[0] == 255).collect();
                assert!(seen.len() > 1000, "{} pixels of body", seen.len());
                let edge = CROP_PX as f64 / 6.0;
                for (u, v, _) in seen {
                    let far = [u, v].map(|x| (f64::from(x) + 0.5 - 80.0).abs());
                    assert!(far.iter().all(|&x| x < 80.0 - edge + 2.0), "body at ({u}, {v})");
                }
            }
        }
    }
}

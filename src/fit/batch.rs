//! Many scenes in one file: what a training loop hands over and takes back (Li 2021, fig. 4.1).
//!
//! | in | shape | |
//! |---|---|---|
//! | poses | \[S,N,72\] | axis–angle; the root in the axes of each view's camera |
//! | betas | \[S,N,B\] | |
//! | trans | \[S,N,3\] | metres, in each camera's frame |
//! | keypoints | \[S,N,24,3\] | u, v in pixels and confidence of SMPL's joints |
//! | K | \[S,N,3,3\] | pixels |
//! | J_template, J_shapedirs | \[S,24,3\], \[S,24,3,B\] | the skeleton of each scene: J(β) = J_template + J_shapedirs β |
//!
//! | out | shape | |
//! |---|---|---|
//! | poses | \[S,N,72\] | root of each view, body pose of the scene |
//! | betas | \[S,B\] | |
//! | trans | \[S,N,3\] | |
//! | loss | \[S,24\] | of each joint, views summed, at 224 pixels |
//! | valid | \[S\] | whether the fit is to be learnt from |
//!
//! A view that says too little (a person hidden by others) is left out: its root and translation stay where they began, and the
//! other views say the body. A scene without a view that says enough is no reason to stop a training either: its answer is where
//! it began, its loss infinite, and it is not valid. A scene that is no data (NaN, no camera) is.

use std::path::Path;

use rayon::prelude::*;
use vitruvian_reference::body::Skeleton;
use vitruvian_reference::body::mannequin::PARENTS;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::mv_smplify::{MvFit, MvSmplify, MvSmplifyOptions, ViewStart};
use vitruvian_reference::fitting::observation::{LEAST_KEYPOINTS, MOST_CONFIDENCE};
use vitruvian_reference::fitting::{Keypoint, KeypointSet, Refusal, View};
use vitruvian_runtime::file::npy::{Array, Values};
use vitruvian_runtime::file::npz::{self, Named, Npz};

use super::settings::Method;
use super::{Arguments, mv_smplify, refuse};
use crate::failure::{Failure, Result};

/// SMPL's joints.
const J: usize = 24;

/// Fits the scenes of a file, in parallel, and writes the fits to a file. No body is made for it and no network is asked.
pub fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.capture;
    check(arguments)?;
    let options = mv_smplify::options(&arguments.choices)?;
    let batch = Batch::read(path)?;
    let fits: Vec<SceneFit> =
        (0..batch.scenes).into_par_iter().map(|s| batch.fit(s, &options)).collect::<Result<_>>()?;
    for (scene, fit) in fits.iter().enumerate() {
        if let Some(words) = fit.warning() {
            eprintln!("warning: {}: scene {scene}{words}", path.display());
        }
    }
    write(&arguments.out, &batch, &fits)
}

/// Refuses what cannot be meant for a batch.
fn check(arguments: &Arguments) -> Result<()> {
    let Arguments { capture, out, choices, independent, resume } = arguments;
    let usage = |message: String| Err(Failure::Usage(format!("{}: {message}", capture.display())));
    if choices.method != Some(Method::MvSmplify) {
        return usage(
            "is a file; expected a capture's folder, or, for a batch of scenes in one file, --method mv-smplify".into(),
        );
    }
    let given = [
        ("--body", choices.body.is_some()),
        ("--cameras", choices.cameras.is_some()),
        ("--start", choices.start.is_some()),
        ("--models", choices.models.is_some()),
        ("--refine-pose", choices.refine_pose),
        ("--independent", *independent),
        ("--resume", *resume),
    ];
    if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given) {
        return usage(format!(
            "is a batch, which holds its own skeletons, cameras and start: {option} is for captures"
        ));
    }
    if out.is_dir() {
        return usage(format!("the fits of a batch go to one file, but --out {} is a folder", out.display()));
    }
    Ok(())
}

/// The arrays of a batch, C order.
struct Batch<'a> {
    path: &'a Path,
    scenes: usize,
    views: usize,
    beta_count: usize,
    poses: Vec<f64>,
    betas: Vec<f64>,
    trans: Vec<f64>,
    keypoints: Vec<f64>,
    intrinsics: Vec<f64>,
    template: Vec<f64>,
    shapedirs: Vec<f64>,
}

/// The answer for one scene.
struct SceneFit {
    poses: Vec<f64>,
    betas: Vec<f64>,
    trans: Vec<f64>,
    loss: Vec<f64>,
    valid: bool,
    left_out: Vec<usize>,
    refused: Option<Refusal>,
}

impl Batch<'_> {
    fn read(path: &Path) -> Result<Batch<'_>> {
        let mut npz = Npz::open(path)?;
        let betas = npz.shaped::<f64>("betas", &[None, None, None])?;
        let (s, n, b) = (betas.shape[0], betas.shape[1], betas.shape[2]);
        if s == 0 || n == 0 {
            return Err(refuse(
                path,
                format!("array \"betas\" has the shape {:?}: there is nothing to fit", betas.shape),
            ));
        }
        let mut read = |name: &str, shape: &[usize]| -> Result<Vec<f64>> {
            let expected: Vec<_> = shape.iter().map(|&axis| Some(axis)).collect();
            let array = npz.shaped::<f64>(name, &expected)?;
            // What stands beside a confidence of zero may be anything.
            let counts =
                |at: usize| name != "keypoints" || at % 3 == 2 || array.values[at / 3 * 3 + 2] != 0.0;
            all_finite(path, name, &array, n, counts)?;
            Ok(array.values)
        };
        Ok(Batch {
            path,
            scenes: s,
            views: n,
            beta_count: b,
            poses: read("poses", &[s, n, 3 * J])?,
            betas: read("betas", &[s, n, b])?,
            trans: read("trans", &[s, n, 3])?,
            keypoints: read("keypoints", &[s, n, J, 3])?,
            intrinsics: read("K", &[s, n, 3, 3])?,
            template: read("J_template", &[s, J, 3])?,
            shapedirs: read("J_shapedirs", &[s, J, 3, b])?,
        })
    }

    fn skeleton(&self, scene: usize) -> Skeleton {
        Skeleton {
            template: of(&self.template, scene, 3 * J).chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
            shapedirs: of(&self.shapedirs, scene, 3 * J * self.beta_count).to_vec(),
            parents: PARENTS.to_vec(),
        }
    }

    fn view(&self, scene: usize, view: usize) -> Result<View> {
        let at = scene * self.views + view;
        let k = of(&self.intrinsics, at, 9);
        let (fx, fy) = (k[0], k[4]);
        let is_camera = fx > 0.0 && fy > 0.0 && [k[1], k[3], k[6], k[7], k[8]] == [0.0, 0.0, 0.0, 0.0, 1.0];
        if !is_camera {
            let message = format!(
                "array \"K\" scene {scene}, view {view} is {k:?} row by row; expected fx, 0, cx, 0, fy, cy, 0, 0, 1 with fx and fy \
                 above zero"
            );
            return Err(refuse(self.path, message));
        }
        let keypoints = of(&self.keypoints, at, 3 * J).chunks_exact(3).enumerate().map(|(joint, p)| {
            if !(0.0..=MOST_CONFIDENCE).contains(&p[2]) {
                let place = format!("scene {scene}, view {view}, joint {joint}");
                let message = format!(
                    "array \"keypoints\" {place} has the confidence {}; expected 0 to {MOST_CONFIDENCE}",
                    p[2]
                );
                return Err(refuse(self.path, message));
            }
            let pixel_px = if p[2] == 0.0 { [0.0; 2] } else { [p[0], p[1]] };
            Ok(Keypoint { pixel_px, confidence: p[2] })
        });
        let camera = Pinhole { focal_px: [fx, fy], ..Pinhole::ideal(fx, [k[2], k[5]]) };
        Ok(View { camera, keypoints: keypoints.collect::<Result<_>>()? })
    }

    fn start(&self, scene: usize, view: usize) -> ViewStart {
        let at = scene * self.views + view;
        let pose = of(&self.poses, at, 3 * J);
        let trans = of(&self.trans, at, 3);
        ViewStart {
            root: [pose[0], pose[1], pose[2]],
            translation: [trans[0], trans[1], trans[2]],
            body_pose: pose[3..].to_vec(),
            betas: of(&self.betas, at, self.beta_count).to_vec(),
            side_px: None,
        }
    }

    fn fit(&self, scene: usize, options: &MvSmplifyOptions) -> Result<SceneFit> {
        let mut views = (0..self.views).map(|view| self.view(scene, view)).collect::<Result<Vec<_>>>()?;
        let mut start: Vec<_> = (0..self.views).map(|view| self.start(scene, view)).collect();
        let fitter = match MvSmplify::of_skeleton(self.skeleton(scene), KeypointSet::Smpl24) {
            Ok(fitter) => fitter,
            Err(why) => return Ok(self.unfitted(scene, why)),
        };
        let mut kept: Vec<usize> = (0..self.views).collect();
        loop {
            match fitter.fit(&views, &start, options) {
                Ok(found) => return Ok(self.fitted(scene, &found, &kept)),
                Err(Refusal::TooFewKeypointsInView { view, .. }) if views.len() > 1 => {
                    views.remove(view);
                    start.remove(view);
                    kept.remove(view);
                }
                Err(Refusal::BadStart { view, fault }) => {
                    return Ok(self.unfitted(scene, Refusal::BadStart { view: kept[view], fault }));
                }
                Err(why) => return Ok(self.unfitted(scene, why)),
            }
        }
    }

    /// What was found from the views that were `kept`; in the others the body stands where it began.
    fn fitted(&self, scene: usize, found: &MvFit, kept: &[usize]) -> SceneFit {
        let mut roots: Vec<_> = (0..self.views).map(|view| self.start(scene, view).root).collect();
        let mut trans = of(&self.trans, scene, self.views * 3).to_vec();
        for (i, &view) in kept.iter().enumerate() {
            roots[view] = found.roots[i];
            trans[3 * view..3 * view + 3].copy_from_slice(&found.translations[i]);
        }
        SceneFit {
            poses: roots.iter().flat_map(|root| root.iter().chain(&found.body_pose)).copied().collect(),
            betas: found.betas.clone(),
            trans,
            loss: found.keypoint_losses.clone(),
            valid: found.valid,
            left_out: (0..self.views).filter(|view| !kept.contains(view)).collect(),
            refused: None,
        }
    }

    /// The start, as the answer for a scene that could not be fitted.
    fn unfitted(&self, scene: usize, why: Refusal) -> SceneFit {
        SceneFit {
            poses: of(&self.poses, scene, self.views * 3 * J).to_vec(),
            betas: of(&self.betas, scene * self.views, self.beta_count).to_vec(),
            trans: of(&self.trans, scene, self.views * 3).to_vec(),
            loss: vec![f64::INFINITY; J],
            valid: false,
            left_out: Vec::new(),
            refused: Some(why),
        }
    }
}

impl SceneFit {
    /// What is to be said of it after its number, if anything is.
    fn warning(&self) -> Option<String> {
        if let Some(why) = &self.refused {
            return Some(format!(" is left as it was: {why}"));
        }
        let views: Vec<String> = self.left_out.iter().map(usize::to_string).collect();
        (!views.is_empty()).then(|| {
            format!(
                ", view {}: fewer than {LEAST_KEYPOINTS} usable keypoints; the body is fitted to the other views, and its place \
                 here is left as it was",
                views.join(", ")
            )
        })
    }
}

/// The `index`th of the blocks of `size` numbers that `values` consists of.
fn of(values: &[f64], index: usize, size: usize) -> &[f64] {
    &values[index * size..(index + 1) * size]
}

/// Names the array, scene and view of the first number that is NaN or infinite where it `counts`.
fn all_finite(
    path: &Path,
    name: &str,
    array: &Array<f64>,
    views: usize,
    counts: impl Fn(usize) -> bool,
) -> Result<()> {
    let Some(at) = (0..array.values.len()).find(|&at| !array.values[at].is_finite() && counts(at)) else {
        return Ok(());
    };
    let scene_size = array.values.len() / array.shape[0];
    let mut place = format!("scene {}", at / scene_size);
    if !name.starts_with("J_") {
        place += &format!(", view {}", at % scene_size / (scene_size / views));
    }
    let message = format!("array \"{name}\" {place} holds {}; expected finite numbers", array.values[at]);
    Err(refuse(path, message))
}

fn write(out: &Path, batch: &Batch, fits: &[SceneFit]) -> Result<()> {
    let (s, n, b) = (batch.scenes, batch.views, batch.beta_count);
    let flat = |numbers: fn(&SceneFit) -> &Vec<f64>| -> Vec<f64> {
        fits.iter().flat_map(numbers).copied().collect()
    };
    let valid: Vec<bool> = fits.iter().map(|fit| fit.valid).collect();
    npz::write(
        out,
        &[
            Named { name: "poses", shape: &[s, n, 3 * J], values: Values::F64(&flat(|f| &f.poses)) },
            Named { name: "betas", shape: &[s, b], values: Values::F64(&flat(|f| &f.betas)) },
            Named { name: "trans", shape: &[s, n, 3], values: Values::F64(&flat(|f| &f.trans)) },
            Named { name: "loss", shape: &[s, J], values: Values::F64(&flat(|f| &f.loss)) },
            Named { name: "valid", shape: &[s], values: Values::Bool(&valid) },
        ],
    )?;
    Ok(())
}

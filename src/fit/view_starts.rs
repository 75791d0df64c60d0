//! Where `mv-smplify` starts: what is known of the person in each view alone.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::mv_smplify::ViewStart;
use vitruvian_runtime::capture::View;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npz::Npz;
use vitruvian_runtime::file::params::{self, Counts};
use vitruvian_runtime::person_crop::{Crop, PersonBox, crop};
use vitruvian_runtime::regress::{Regressor, full_image_translation};
use vitruvian_runtime::session;

use super::observed::Observed;
use super::refuse;
use super::settings::{Choices, StartMode};
use crate::failure::{Failure, Result};
use crate::reconstruct::models;
use crate::regress::GRAPH;

/// Where the starts come from.
pub enum ViewStarts {
    /// A network looks at the person in each picture.
    Regressor { regressor: Box<RefCell<Regressor>>, path: PathBuf },
    /// A file of parameters with a frame for each view, or a folder with such files.
    Given(PathBuf),
}

impl ViewStarts {
    /// What the choices name; a network is loaded and checked against the body.
    pub fn new(choices: &Choices, body: &BodyModel) -> Result<ViewStarts> {
        match &choices.start {
            Some(StartMode::Given(_)) if choices.models.is_some() => {
                Err(Failure::Usage("--start and --models: start from a file or from the regressor".into()))
            }
            Some(StartMode::Given(path)) => Ok(ViewStarts::Given(path.clone())),
            Some(_) => Err(Failure::Usage(
                "--start robust and identity are for chapters 2 and 3: --method mv-smplify starts from the regressor, or from \
                 --start PARAMS.npz"
                    .into(),
            )),
            None => {
                let path = models::find(choices.models.as_deref())?.join(GRAPH);
                let regressor = Regressor::load(&path, &session::Settings::default())?;
                if let Some(betas) = regressor.beta_count().filter(|&betas| betas > body.beta_count()) {
                    let message = format!(
                        "gives {betas} betas, the body has {}: give a body with as many",
                        body.beta_count()
                    );
                    return Err(refuse(&path, message));
                }
                Ok(ViewStarts::Regressor { regressor: Box::new(RefCell::new(regressor)), path })
            }
        }
    }

    /// For reports: the graph or the file.
    pub fn name(&self) -> String {
        match self {
            ViewStarts::Regressor { path, .. } | ViewStarts::Given(path) => path.display().to_string(),
        }
    }

    /// Whether the pictures are looked at.
    pub fn needs_images(&self) -> bool {
        matches!(self, ViewStarts::Regressor { .. })
    }

    /// A start for each view of a capture.
    pub fn of(&self, observed: &Observed, body: &BodyModel) -> Result<Vec<ViewStart>> {
        match self {
            ViewStarts::Regressor { regressor, .. } => regressed(&mut regressor.borrow_mut(), observed),
            ViewStarts::Given(path) => read(&file_for(path, observed), observed, body),
        }
    }
}

/// What the regressor makes of each picture.
fn regressed(regressor: &mut Regressor, observed: &Observed) -> Result<Vec<ViewStart>> {
    let size = regressor.image_size();
    let crops = observed.capture.views.iter().map(|view| -> Result<(String, Crop)> {
        let place = format!("{}: camera \"{}\"", observed.path.display(), view.camera.name);
        let fail = |message: &str| Error::camera(&observed.path, &view.camera.name, message);
        let image = view.image.as_ref().ok_or_else(|| fail("its picture was not read"))?;
        let person = person(view).ok_or_else(|| fail("shows nobody: neither a mask nor two keypoints"))?;
        let crop = crop(image, &person, size).map_err(|error| fail(&error.to_string()))?;
        Ok((place, crop))
    });
    let crops = crops.collect::<Result<Vec<_>>>()?;
    let named: Vec<(&str, &Crop)> = crops.iter().map(|(place, crop)| (place.as_str(), crop)).collect();
    let found = regressor.regress_named(&named)?;
    let views = found.iter().zip(&crops).zip(&observed.capture.views);
    let starts = views.map(|((found, (_, crop)), view)| {
        let pose = found.pose();
        ViewStart {
            root: [pose[0], pose[1], pose[2]],
            translation: full_image_translation(found.camera, crop, &view.camera.k),
            body_pose: pose[3..].to_vec(),
            betas: found.betas.clone(),
            side_px: Some(f64::from(crop.side_px)),
        }
    });
    Ok(starts.collect())
}

/// Around the mask; without one around the keypoints.
fn person(view: &View) -> Option<PersonBox> {
    if let Some(mask) = &view.mask {
        return PersonBox::of_mask(mask);
    }
    let points = view.keypoints.as_ref()?.points.iter().filter(|point| point[2] > 0.0);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in points {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    (low[0] < high[0] || low[1] < high[1]).then(|| PersonBox::around(low, high))
}

/// The file itself, or params.npz in the folder, or in the folder that is named like the capture in the folder.
fn file_for(given: &Path, observed: &Observed) -> PathBuf {
    if !given.is_dir() {
        return given.to_owned();
    }
    let of_capture = observed.path.file_name().map(|name| given.join(name).join("params.npz"));
    of_capture.filter(|path| path.is_file()).unwrap_or_else(|| given.join("params.npz"))
}

/// The frames of a file: `poses` with the root in the axes of each view's camera, `betas`, `trans` in its frame.
fn read(path: &Path, observed: &Observed, body: &BodyModel) -> Result<Vec<ViewStart>> {
    let counts =
        Counts { vertices: body.vertex_count(), joints: body.joint_count(), betas: body.beta_count() };
    let found = params::read(path, &counts)?;
    let views = &observed.capture.views;
    if found.frame_count() != views.len() {
        let message = format!(
            "holds {} frames; {} has {} views and needs one for each",
            found.frame_count(),
            observed.path.display(),
            views.len()
        );
        return Err(refuse(path, message));
    }
    let mut npz = Npz::open(path)?;
    if npz.contains("names") {
        let names = npz.texts("names")?;
        let cameras: Vec<&str> = views.iter().map(|view| view.camera.name.as_str()).collect();
        if names != cameras {
            let message = format!(
                "is of the views {}; {} has {}",
                names.join(", "),
                observed.path.display(),
                cameras.join(", ")
            );
            return Err(refuse(path, message));
        }
    }
    let start = |frame: usize| {
        let pose = &found.poses[frame];
        ViewStart {
            root: [pose[0], pose[1], pose[2]],
            translation: found.trans[frame],
            body_pose: pose[3..].to_vec(),
            betas: found.betas_of(frame).to_vec(),
            side_px: None,
        }
    };
    Ok((0..views.len()).map(start).collect())
}

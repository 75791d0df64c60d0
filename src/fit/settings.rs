//! What the arguments of `fit` ask for, checked before anything is fitted.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::multiview_smplify::MultiviewSmplify;
use vitruvian_reference::fitting::silhouette::{Schedule, Unknowns};
use vitruvian_reference::fitting::{Options, PosePrior, Preset, Start};

use super::mv_smplify::Collaborative;
use super::{mixture, refuse};
use crate::failure::{Failure, Result};
use crate::mesh_format::MeshFormat;

/// The methods of chapters 2 to 4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Joints of the first view: the baseline
    Smplify,
    /// Joints of all views
    MultiviewSmplify,
    /// Joints of all views, then their masks
    Silhouette,
    /// Joints of all views, from what the regressor makes of each image; or many such scenes in one .npz
    MvSmplify,
}

/// Whether the cameras' places are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Cameras {
    /// R and t of cameras.json are data
    Known,
    /// They are found; the world is then the first camera's frame
    Unknown,
}

/// Where the fit to the joints begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StartMode {
    /// From the geometry of the views.
    Robust,
    /// As the thesis: rest pose, all cameras alike.
    Identity,
    /// From parameters for each view in a file.
    Given(PathBuf),
}

impl From<OsString> for StartMode {
    fn from(word: OsString) -> StartMode {
        match word.to_str() {
            Some("robust") => StartMode::Robust,
            Some("identity") => StartMode::Identity,
            _ => StartMode::Given(word.into()),
        }
    }
}

/// What the silhouettes change of the shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Shape {
    /// β and an offset of every vertex
    #[default]
    Offsets,
    /// β alone
    Betas,
}

/// The σ of Table 3.1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Sigmas {
    /// 5, 3, 1 cm
    #[default]
    Synthetic,
    /// 8, 4, 3 cm
    Real,
}

/// How captures are fitted.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Choices {
    /// Body model (.npz in SMPL's arrays); the built-in mannequin without it
    #[arg(long)]
    pub body: Option<PathBuf>,
    /// What is fitted [default: silhouette with --refine-pose, else multiview-smplify]
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// Whether the cameras' places are given [default: known where all cameras have R and t]
    #[arg(long, value_enum)]
    pub cameras: Option<Cameras>,
    /// Weights and stages of the fit to the joints: smplify, ch2, ch3, empirical-bayes [default: empirical-bayes; smplify
    /// for --method smplify]; for mv-smplify thesis, released, refined [default: refined]
    #[arg(long)]
    pub preset: Option<String>,
    /// Where the fit to the joints begins: robust (geometry of the views), identity (rest pose, as the thesis); for mv-smplify
    /// params.npz of `regress`, a frame for each view, or its folder [default: robust; for mv-smplify the regressor]
    #[arg(long, value_name = "robust|identity|FILE")]
    pub start: Option<StartMode>,
    /// Gaussian mixture as prior on the pose (.npz with means, covariances, weights), for the thesis' presets and mv-smplify
    #[arg(long)]
    pub prior: Option<PathBuf>,
    /// What the silhouettes change of the shape
    #[arg(long, value_enum, default_value_t)]
    pub shape: Shape,
    /// Table 3.1's σ for clean or for real masks
    #[arg(long, value_enum, default_value_t)]
    pub schedule: Sigmas,
    /// Folder of the exported graphs, for the regressor of mv-smplify; models/exported here, above, or beside the executable
    /// without it
    #[arg(long)]
    pub models: Option<PathBuf>,
    /// Let the silhouettes move the pose as well (not in the thesis)
    #[arg(long)]
    pub refine_pose: bool,
    /// Format of the mesh
    #[arg(long, value_enum, default_value_t)]
    pub format: MeshFormat,
}

/// The fit to the joints, made ready for the body.
pub enum Fitter<'a> {
    /// Chapters 2 and 3: an energy of all unknowns, by dogleg.
    Energy { fitter: Box<MultiviewSmplify<'a>>, preset: Preset, options: Box<Options> },
    /// Chapter 4: from regressed parameters, by Adam.
    Collaborative(Box<Collaborative<'a>>),
}

/// What a run does to every capture.
pub struct Settings<'a> {
    pub body: &'a BodyModel,
    pub fitter: Fitter<'a>,
    pub method: Method,
    pub cameras: Option<Cameras>,
    pub unknowns: Unknowns,
    pub schedule: Schedule,
    pub refine_pose: bool,
    pub format: MeshFormat,
    body_name: String,
    prior_name: Option<String>,
}

impl<'a> Settings<'a> {
    /// Checks the choices against each other and reads what they name.
    pub fn new(choices: &Choices, body: &'a BodyModel) -> Result<Settings<'a>> {
        let default = if choices.refine_pose { Method::Silhouette } else { Method::MultiviewSmplify };
        let method = choices.method.unwrap_or(default);
        if choices.refine_pose && method != Method::Silhouette {
            return Err(Failure::Usage(
                "--refine-pose moves the pose by the masks: use it with --method silhouette".into(),
            ));
        }
        let name = |path: &Path| path.display().to_string();
        let body_name = choices.body.as_deref().map_or("mannequin".into(), name);
        let fitter = match method {
            Method::MvSmplify => Fitter::Collaborative(Box::new(Collaborative::new(choices, body)?)),
            _ => energy(choices, method, body, &body_name)?,
        };
        Ok(Settings {
            body,
            fitter,
            method,
            cameras: choices.cameras,
            unknowns: match choices.shape {
                Shape::Offsets => Unknowns::BetasAndOffsets,
                Shape::Betas => Unknowns::Betas,
            },
            schedule: match choices.schedule {
                Sigmas::Synthetic => Schedule::Synthetic,
                Sigmas::Real => Schedule::Real,
            },
            refine_pose: choices.refine_pose,
            format: choices.format,
            body_name,
            prior_name: choices.prior.as_deref().map(name),
        })
    }

    /// Whether the fit looks at the pictures.
    pub fn needs_images(&self) -> bool {
        matches!(&self.fitter, Fitter::Collaborative(fitter) if fitter.needs_images())
    }

    /// For reports, and for telling whether an interrupted run asked for the same.
    pub fn json(&self) -> Value {
        let word = |value: &dyn std::fmt::Debug| kebab(&format!("{value:?}"));
        let silhouette = (self.method == Method::Silhouette).then(|| {
            json!({
                "shape": word(&self.unknowns), "schedule": word(&self.schedule), "refine_pose": self.refine_pose,
            })
        });
        let (preset, start) = match &self.fitter {
            Fitter::Energy { preset, options, .. } => (preset.name(), word(&options.start)),
            Fitter::Collaborative(fitter) => (fitter.preset_name(), fitter.start_name()),
        };
        json!({
            "body": self.body_name,
            "method": word(&self.method),
            "cameras": self.cameras.map(|c| word(&c)),
            "preset": preset,
            "start": start,
            "prior": self.prior_name,
            "silhouette": silhouette,
            "format": word(&self.format),
        })
    }
}

/// The fit of chapters 2 and 3 as the choices have it.
fn energy<'a>(choices: &Choices, method: Method, body: &'a BodyModel, body_name: &str) -> Result<Fitter<'a>> {
    let preset = match &choices.preset {
        Some(name) => preset(name)?,
        None if method == Method::Smplify => Preset::Smplify,
        None => Preset::default(),
    };
    let mut options = preset.options();
    options.start = match &choices.start {
        None | Some(StartMode::Robust) => Start::Robust,
        Some(StartMode::Identity) => Start::Identity,
        Some(StartMode::Given(path)) => {
            return Err(Failure::Usage(format!(
                "--start {}: expected robust or identity; parameters to start from are for --method mv-smplify",
                path.display()
            )));
        }
    };
    if choices.models.is_some() {
        return Err(Failure::Usage("--models: only --method mv-smplify asks a network".into()));
    }
    if let Some(path) = &choices.prior {
        if preset == Preset::EmpiricalBayes {
            return Err(Failure::Usage(
                "--prior is for the thesis' presets: choose --preset smplify, ch2 or ch3".into(),
            ));
        }
        options.pose_prior = PosePrior::Mixture(mixture::read(path)?);
    }
    let fitter =
        MultiviewSmplify::new(body).map_err(|refusal| refuse(Path::new(body_name), refusal.to_string()))?;
    Ok(Fitter::Energy { fitter: Box::new(fitter), preset, options: Box::new(options) })
}

/// `MultiviewSmplify` as the command line spells it.
fn kebab(name: &str) -> String {
    let mut words = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !words.is_empty() {
            words.push('-');
        }
        words.extend(letter.to_lowercase());
    }
    words
}

fn preset(name: &str) -> Result<Preset> {
    Preset::ALL.into_iter().find(|p| p.name() == name).ok_or_else(|| {
        let names = Preset::ALL.map(Preset::name).join(", ");
        Failure::Usage(format!("--preset {name}: there is no such preset; choose {names}"))
    })
}

//! `--method mv-smplify`: one body for all views, from what was regressed of each alone (Li 2021, ch. 4 §3.3).
//!
//! The method knows nothing of where the cameras stand: each view has its own turn and place of the body, which are told as
//! cameras around one body, the world being the first camera's frame.

use serde_json::{Map, Value, json};
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::figure::Figure;
use vitruvian_reference::fitting::keypoint_residuals::Detection;
use vitruvian_reference::fitting::mv_smplify::{
    MvFit, MvPreset, MvSmplify, MvSmplifyOptions, VALID_BELOW, ViewStart,
};
use vitruvian_reference::fitting::verdict::view_residuals;
use vitruvian_reference::fitting::{KeypointSet, Observation, Parameters, Refusal, ViewResidual};
use vitruvian_reference::linalg::matrix::{IDENTITY, Matrix3, apply, mul, transpose};
use vitruvian_reference::linalg::vector::{Vector3, add, sub};
use vitruvian_reference::rotation::rodrigues;

use super::mixture;
use super::observed::Observed;
use super::settings::{Cameras, Choices};
use super::view_starts::ViewStarts;
use crate::failure::{Failure, Result};

/// The fit, ready for a body, and what it starts from.
pub struct Collaborative<'a> {
    body: &'a BodyModel,
    preset: MvPreset,
    options: MvSmplifyOptions,
    starts: ViewStarts,
}

/// A fit, as one body in one world.
pub struct CollaborativeFit {
    /// The answer as the method gives it.
    pub fit: MvFit,
    /// The same in one world.
    pub parameters: Parameters,
    /// The distances in each view.
    pub views: Vec<ViewResidual>,
}

impl<'a> Collaborative<'a> {
    /// Checks the choices and reads what they name.
    pub fn new(choices: &Choices, body: &'a BodyModel) -> Result<Collaborative<'a>> {
        if choices.cameras == Some(Cameras::Known) {
            return Err(Failure::Usage(
                "--cameras known: --method mv-smplify finds their places itself; use unknown or leave it away".into(),
            ));
        }
        let (preset, options) = (preset(choices)?, options(choices)?);
        Ok(Collaborative { body, preset, options, starts: ViewStarts::new(choices, body)? })
    }

    /// The name of its preset.
    pub fn preset_name(&self) -> &'static str {
        self.preset.name()
    }

    /// What it starts from, in words.
    pub fn start_name(&self) -> String {
        self.starts.name()
    }

    /// Where it starts in each view.
    pub fn start(&self, observed: &Observed) -> Result<Vec<ViewStart>> {
        self.starts.of(observed, self.body)
    }

    /// Whether it needs the pictures.
    pub fn needs_images(&self) -> bool {
        self.starts.needs_images()
    }

    /// Fits the body to the keypoints of all views.
    pub fn fit(
        &self,
        observation: &Observation,
        start: &[ViewStart],
    ) -> std::result::Result<CollaborativeFit, Refusal> {
        let fitter = MvSmplify::new(self.body, observation.keypoint_set)?;
        let fit = fitter.fit(&observation.views, start, &self.options)?;
        let parameters = in_one_world(&fit, observation, self.body.skeleton().rest_joints(&fit.betas)[0]);
        let views = residuals(self.body, observation, &parameters);
        Ok(CollaborativeFit { fit, parameters, views })
    }
}

/// The preset that the choices name, with their mixture.
pub fn options(choices: &Choices) -> Result<MvSmplifyOptions> {
    let mixture = choices.prior.as_deref().map(mixture::read).transpose()?;
    Ok(MvSmplifyOptions { mixture, ..preset(choices)?.options() })
}

fn preset(choices: &Choices) -> Result<MvPreset> {
    let Some(name) = &choices.preset else { return Ok(MvPreset::default()) };
    MvPreset::ALL.into_iter().find(|p| p.name() == name).ok_or_else(|| {
        let names = MvPreset::ALL.map(MvPreset::name).join(", ");
        Failure::Usage(format!("--preset {name}: mv-smplify has no such preset; choose {names}"))
    })
}

impl CollaborativeFit {
    /// Why the answer is not to be trusted, if it is not.
    pub fn distrust(&self) -> Option<String> {
        (!self.fit.valid).then(|| {
            format!(
                "the body lies far from the keypoints (mean loss {:.0} px², views summed, at 224 px a person; trusted below \
                 {VALID_BELOW}): are the views of one person and moment, and does the start belong to them?",
                self.fit.mean_loss
            )
        })
    }

    /// For the report.
    pub fn json(&self, set: KeypointSet) -> Value {
        let losses: Map<String, Value> = self
            .fit
            .keypoint_losses
            .iter()
            .enumerate()
            .map(|(k, loss)| (set.name(k).to_owned(), json!(loss)))
            .collect();
        json!({
            "valid": self.fit.valid,
            "mean_loss_px2": self.fit.mean_loss,
            "loss_px2": losses,
        })
    }
}

/// One body and N cameras around it, in the first camera's frame.
///
/// In view i's frame the body is X_i = E_i (x − J_0) + J_0 + τ_i, with E_i = exp(root_i), so that X_i = R_i X_0 + t_i with
/// R_i = E_i E_0ᵀ and t_i = (J_0 + τ_i) − R_i (J_0 + τ_0).
fn in_one_world(fit: &MvFit, observation: &Observation, pelvis: Vector3) -> Parameters {
    let turns: Vec<Matrix3> = fit.roots.iter().map(|&root| rodrigues(root)).collect();
    let places: Vec<Vector3> = fit.translations.iter().map(|&translation| add(pelvis, translation)).collect();
    let camera = |(i, view): (usize, &vitruvian_reference::fitting::View)| {
        // The first is the world itself, without the rounding of a product.
        let rotation = if i == 0 { IDENTITY } else { mul(&turns[i], &transpose(&turns[0])) };
        Pinhole { rotation, translation: sub(places[i], apply(&rotation, places[0])), ..view.camera }
    };
    Parameters {
        pose: fit.pose(0),
        betas: fit.betas.clone(),
        trans: fit.translations[0],
        cameras: observation.views.iter().enumerate().map(camera).collect(),
    }
}

/// How far the marks of each view are from the body.
fn residuals(body: &BodyModel, observation: &Observation, found: &Parameters) -> Vec<ViewResidual> {
    let skeleton = body.skeleton();
    let figure = Figure::new(body, &skeleton, observation.keypoint_set);
    let points = figure.points(&found.pose, &found.betas);
    let (mut marks, mut errors) = (Vec::new(), Vec::new());
    for (view, (seen, camera)) in observation.views.iter().zip(&found.cameras).enumerate() {
        for (k, (keypoint, on_body)) in seen.keypoints.iter().zip(figure.keypoints()).enumerate() {
            let weight = on_body.as_ref().map_or(0.0, |on_body| on_body.base_weight * keypoint.confidence);
            let Some([u, v]) = camera.project(add(points[k], found.trans)).filter(|_| weight > 0.0) else {
                continue;
            };
            let [x, y] = keypoint.pixel_px;
            marks.push(Detection { view, keypoint: k, pixel_px: keypoint.pixel_px, weight });
            errors.push([u - x, v - y]);
        }
    }
    view_residuals(&marks, &errors, observation.views.len())
}

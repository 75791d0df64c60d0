//! One capture fitted: to its joints, then to its masks where the method says so.

use std::time::Instant;

use vitruvian_reference::body::Posed;
use vitruvian_reference::fitting::silhouette::{
    PoseRefinement, SilhouetteFit, SilhouetteOptions, SilhouetteRefusal, Warning, fit_silhouettes,
};
use vitruvian_reference::fitting::{Parameters, Refusal};
use vitruvian_reference::linalg::vector::{Vector3, ZERO};
use vitruvian_reference::metric::silhouette::mask_iou;
use vitruvian_reference::silhouette::raster::Raster;
use vitruvian_runtime::error::Error;

use super::joint_fit::JointFit;
use super::observed::Observed;
use super::settings::{Fitter, Method, Settings};
use super::{marks, refuse};
use crate::failure::{Failure, Result};

/// Keypoints are not trusted beyond this against the masks' outlines, pixels.
const LEAST_NOISE_PX: f64 = 0.1;

/// A mask that the fitted body overlaps less with shows something else. Fits to clean masks end above 0.9; the thesis' on real
/// ones at 0.65 to 0.79 with the pose of the joints.
const LEAST_IOU: f64 = 0.6;

/// Keypoints this many times the noise away from the body are named, and not below the other bound, pixels.
const FAR_IN_NOISE: f64 = 6.0;
const LEAST_FAR_PX: f64 = 3.0;

/// What was found of one capture.
pub struct Fitted {
    /// The fit to the joints.
    pub joints: JointFit,
    /// The fit to the masks.
    pub silhouettes: Option<SilhouetteFit>,
    /// The answer: that of the last of the two.
    pub parameters: Parameters,
    /// The body of the answer, world frame.
    pub posed: Posed,
    /// The overlap of body and mask in each view that has a mask.
    pub iou: Vec<Option<f64>>,
    /// Stage and seconds.
    pub seconds: Vec<(&'static str, f64)>,
}

impl Fitted {
    /// Fits the body to a capture, from `before` where that is the person a moment ago.
    pub fn of(observed: &Observed, settings: &Settings, before: Option<&Parameters>) -> Result<Fitted> {
        let clock = Instant::now();
        let joints = match &settings.fitter {
            Fitter::Energy { fitter, options, .. } => {
                fitter.fit(&observed.observation, options, before).map(JointFit::Energy)
            }
            Fitter::Collaborative(fitter) => {
                let start = fitter.start(observed)?;
                fitter.fit(&observed.observation, &start).map(JointFit::Collaborative)
            }
        };
        let joints = joints.map_err(|refusal| named(observed, &refusal))?;
        let mut seconds = vec![("joints", clock.elapsed().as_secs_f64())];
        let mut silhouettes = None;
        if settings.method == Method::Silhouette {
            let clock = Instant::now();
            silhouettes = Some(to_masks(observed, settings, &joints)?);
            seconds.push(("silhouettes", clock.elapsed().as_secs_f64()));
        }
        let (parameters, posed) = match &silhouettes {
            Some(fit) => {
                let posed = Posed { vertices: fit.vertices.clone(), joints: fit.joints.clone() };
                (fit.parameters.clone(), posed)
            }
            None => {
                let found = joints.parameters().clone();
                let posed = settings.body.pose(&found.pose, &found.betas, found.trans);
                (found, posed)
            }
        };
        let views = parameters.cameras.iter().zip(&observed.masks);
        let iou = views
            .map(|(camera, mask)| {
                let mask = mask.as_ref()?;
                let seen =
                    Raster::of(&posed.vertices, &settings.body.faces, camera, mask.width, mask.height).mask;
                mask_iou(&seen.inside, &mask.inside)
            })
            .collect();
        Ok(Fitted { joints, silhouettes, parameters, posed, iou, seconds })
    }

    /// The mean overlap over the views that have masks.
    pub fn mean_iou(&self) -> Option<f64> {
        let known: Vec<f64> = self.iou.iter().flatten().copied().collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// D, the offsets of the shaped rest mesh in metres, where the masks were asked for them.
    pub fn offsets(&self) -> Option<&[Vector3]> {
        let fit = self.silhouettes.as_ref()?;
        fit.offsets.iter().any(|d| *d != ZERO).then_some(&fit.offsets)
    }

    /// Why the answer is not to be trusted, if it is not.
    pub fn distrust(&self, observed: &Observed) -> Option<String> {
        self.joints.distrust(observed).or_else(|| self.distrust_of_masks(observed))
    }

    fn distrust_of_masks(&self, observed: &Observed) -> Option<String> {
        let fit = self.silhouettes.as_ref()?;
        if let Some(stage) = fit.stages.iter().find(|stage| !stage.termination.was_successful()) {
            return Some(format!("the fit to the masks did not converge: {}", stage.termination));
        }
        let apart: Vec<String> = (0..fit.iou.len())
            .filter(|&view| fit.iou[view] < LEAST_IOU)
            .map(|view| format!("\"{}\" {:.2}", observed.name(view), fit.iou[view]))
            .collect();
        (!apart.is_empty()).then(|| {
            format!(
                "the body that fits the keypoints and the masks overlaps little with the mask of camera {}: is it of the same \
                 person and moment, and nothing but the person?",
                apart.join(", ")
            )
        })
    }

    /// What the user should know beside the verdict: keypoints that were hardly believed, masks at the border.
    pub fn warnings(&self, observed: &Observed, settings: &Settings) -> Vec<String> {
        let about = |view: usize| format!("{}: camera \"{}\"", observed.path.display(), observed.name(view));
        let far_px = FAR_IN_NOISE * self.joints.noise_px().unwrap_or(0.0).max(LEAST_FAR_PX / FAR_IN_NOISE);
        let far = (0..observed.observation.views.len()).filter_map(|view| {
            let far: Vec<String> = marks::of_view(observed, self, settings.body, view)
                .iter()
                .filter_map(|mark| Some((mark.name, mark.distance_px().filter(|px| *px > far_px)?)))
                .map(|(name, px)| match px {
                    px if px < 1e5 => format!("{name} ({px:.0} px)"),
                    px => format!("{name} ({px:.0e} px)"),
                })
                .collect();
            (!far.is_empty()).then(|| {
                format!(
                    "{}: keypoints far from the fitted body, which hardly counted: {}",
                    about(view),
                    far.join(", ")
                )
            })
        });
        // Without the polishing stage no noise is known that would tell an outlier.
        let far = far.filter(|_| self.joints.noise_px().is_some());
        let masks = self.silhouettes.iter().flat_map(|fit| &fit.warnings);
        let masks = masks.map(|Warning::MaskTouchesBorder { view }| {
            format!(
                "{}: its mask reaches the image's border, which is not taken for the body's outline",
                about(*view)
            )
        });
        far.chain(masks).collect()
    }

    /// One line for the terminal.
    pub fn words(&self) -> String {
        let points: usize = self.joints.views().iter().map(|view| view.count).sum();
        let square: f64 = self.joints.views().iter().map(|v| v.count as f64 * v.rms_px * v.rms_px).sum();
        let mut words = format!("keypoints {:.2} px rms", (square / points.max(1) as f64).sqrt());
        if let Some(iou) = self.mean_iou() {
            words += &format!(", IoU {iou:.3}");
        }
        let seconds: f64 = self.seconds.iter().map(|(_, seconds)| seconds).sum();
        words + &format!(", {seconds:.2} s")
    }
}

/// Goes on from the joints to the masks.
fn to_masks(observed: &Observed, settings: &Settings, joints: &JointFit) -> Result<SilhouetteFit> {
    let masks: Vec<_> = observed.masks.iter().flatten().cloned().collect();
    let noise_px =
        joints.noise_px().map_or(PoseRefinement::default().keypoint_sigma_px, |s| s.max(LEAST_NOISE_PX));
    let refine_pose = settings
        .refine_pose
        .then(|| PoseRefinement { keypoint_sigma_px: noise_px, ..PoseRefinement::default() });
    let options = SilhouetteOptions {
        stages: settings.schedule.stages().to_vec(),
        unknowns: settings.unknowns,
        refine_pose,
        ..SilhouetteOptions::default()
    };
    let keypoints = Some(&observed.observation);
    fit_silhouettes(settings.body, joints.parameters(), &masks, keypoints, &options).map_err(|refusal| {
        let view = match refusal {
            SilhouetteRefusal::EmptyMask { view }
            | SilhouetteRefusal::FullMask { view }
            | SilhouetteRefusal::MaskDisagrees { view, .. } => view,
            _ => return refuse(&observed.path, refusal.to_string()),
        };
        Error::camera(&observed.path, observed.name(view), refusal.to_string()).into()
    })
}

/// A refusal with the camera's name in place of its number.
fn named(observed: &Observed, refusal: &Refusal) -> Failure {
    let view = match refusal {
        Refusal::KeypointCount { view, .. }
        | Refusal::BadKeypoint { view, .. }
        | Refusal::BadCamera { view, .. }
        | Refusal::BadStart { view, .. }
        | Refusal::TooFewKeypointsInView { view, .. } => *view,
        other => return refuse(&observed.path, other.to_string()),
    };
    Error::camera(&observed.path, observed.name(view), refusal.to_string()).into()
}

//! The fit of chapter 2: what is taken in, and what the answer is worth; `stages.rs` is the way down.

use super::figure::Figure;
use super::keypoint_residuals::Detection;
use super::keypoint_set::has_smpl_tree;
use super::observation::{Extrinsics, Observation, Refusal};
use super::polish::Model;
use super::presets::{Options, PosePrior, Start};
use super::result::{Fit, Parameters, Verdict};
use super::stages::Run;
use super::start::Evidence;
use crate::body::{BodyModel, Hinge, Skeleton};
use crate::linalg::matrix::IDENTITY;
use crate::linalg::vector::ZERO;

/// A body less likely than this is looked at again with left and right exchanged; poses of every day stay below.
const SUSPICIOUS: f64 = 60.0;
/// The exchange counts if it leaves less than this of the unlikeliness.
const HARDLY: f64 = 0.4;

/// Fits one body model to observations.
///
/// ```
/// use vitruvian_reference::body::mannequin;
/// use vitruvian_reference::camera::Pinhole;
/// use vitruvian_reference::fitting::{Extrinsics, Keypoint, KeypointSet, MultiviewSmplify, Observation, Options, View};
/// use vitruvian_reference::linalg::{matrix::mul, vector::distance};
/// use vitruvian_reference::rotation::rodrigues;
///
/// // A person with a raised arm, seen from the front and from the side, 4 m away.
/// let body = mannequin();
/// let mut pose = [0.0; 72];
/// pose[3 * 16 + 2] = 0.9;
/// let truth = body.pose(&pose, &[1.0], [0.0; 3]).joints;
/// let upright = rodrigues([std::f64::consts::PI, 0.0, 0.0]);
/// let views = [0.0, 1.5].map(|yaw| {
///     let camera = Pinhole {
///         rotation: mul(&upright, &rodrigues([0.0, yaw, 0.0])),
///         translation: [0.0, 0.0, 4.0],
///         ..Pinhole::ideal(400.0, [160.0, 120.0])
///     };
///     let see = |joint| Keypoint { pixel_px: camera.project(joint).unwrap(), confidence: 1.0 };
///     View { camera, keypoints: truth.iter().copied().map(see).collect() }
/// });
/// let observation =
///     Observation { views: views.to_vec(), keypoint_set: KeypointSet::Smpl24, extrinsics: Extrinsics::Known };
///
/// let fit = MultiviewSmplify::new(&body)?.fit(&observation, &Options::default(), None)?;
/// assert!(fit.verdict.is_success());
/// assert!(fit.joints.iter().zip(&truth).all(|(a, b)| distance(*a, *b) < 1e-5));
/// # Ok::<(), vitruvian_reference::fitting::Refusal>(())
/// ```
#[derive(Clone, Debug)]
pub struct MultiviewSmplify<'a> {
    body: &'a BodyModel,
    skeleton: Skeleton,
    hinges: Vec<Hinge>,
}

impl<'a> MultiviewSmplify<'a> {
    /// Prepares `body`: its joints are regressed and its elbows and knees understood once, for all fits.
    ///
    /// # Errors
    /// [`Refusal::ForeignTree`] if the first joints are not SMPL's.
    ///
    /// # Panics
    /// If the model is not consistent.
    pub fn new(body: &'a BodyModel) -> Result<MultiviewSmplify<'a>, Refusal> {
        if !has_smpl_tree(&body.parents) {
            return Err(Refusal::ForeignTree { joints: body.joint_count() });
        }
        let skeleton = body.skeleton();
        let hinges = skeleton.hinges().into_iter().flatten().collect();
        Ok(MultiviewSmplify { body, skeleton, hinges })
    }

    /// The body's joints without its mesh.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// The body that the marks of `observation` show.
    ///
    /// With `initial`, such as the answer for the frame before, the descent begins there, unless a start from this
    /// observation alone turns out to be better. [`Start::Identity`] makes no such comparison.
    ///
    /// # Errors
    /// A [`Refusal`] for data that no fit can start from. What can be fitted but not be trusted is a fit with a
    /// [verdict](Fit::verdict).
    pub fn fit(
        &self,
        observation: &Observation,
        options: &Options,
        initial: Option<&Parameters>,
    ) -> Result<Fit, Refusal> {
        let mut fit = self.fit_as_marked(observation, options, initial)?;
        if fit.verdict.is_success() && unlikeliness(&fit.parameters) > SUSPICIOUS {
            let polished = if options.polish.is_some() { Some(&fit) } else { None };
            if self.sides_are_exchanged(observation, polished) {
                fit.verdict = Verdict::SidesExchanged;
            }
        }
        Ok(fit)
    }

    /// Whether the marks with left and right exchanged show a far likelier body that lies on them as well.
    ///
    /// Both are fitted with the default options; `fit` is that of the marks as they are, if it is at hand. The thesis' bend
    /// prior may prefer unlikely turns by itself.
    fn sides_are_exchanged(&self, observation: &Observation, fit: Option<&Fit>) -> bool {
        let mut exchanged = observation.clone();
        for (view, marked) in exchanged.views.iter_mut().zip(&observation.views) {
            for (k, keypoint) in view.keypoints.iter_mut().enumerate() {
                *keypoint = marked.keypoints[observation.keypoint_set.mirrored(k)];
            }
        }
        let default = |observation| self.fit_as_marked(observation, &Options::default(), None).ok();
        let own;
        let fit = match fit {
            Some(fit) => fit,
            None => {
                own = default(observation);
                let Some(own) = &own else { return false };
                own
            }
        };
        default(&exchanged).is_some_and(|other| {
            other.verdict.is_success()
                && unlikeliness(&other.parameters) < HARDLY * unlikeliness(&fit.parameters)
                && total_px(&other) <= 1.2 * total_px(fit) + 1.0
        })
    }

    /// The fit, with the labels taken at their word.
    fn fit_as_marked(
        &self,
        observation: &Observation,
        options: &Options,
        initial: Option<&Parameters>,
    ) -> Result<Fit, Refusal> {
        let figure = Figure::new(self.body, &self.skeleton, observation.keypoint_set);
        let detections = detections(observation, &figure)?;
        self.check(observation, options, initial)?;
        let evidence = Evidence::new(&figure, observation, &self.hinges);

        let mut starts: Vec<Parameters> = initial.map(|p| self.initial(p, observation)).into_iter().collect();
        match options.start {
            Start::Identity if initial.is_none() => starts.extend(evidence.identity()),
            Start::Identity => {}
            // Beside a start that is likely to be right, one other is enough to notice that it is wrong.
            Start::Robust => {
                let cold = evidence.robust();
                let enough = if initial.is_some() { 1 } else { cold.len() };
                starts.extend(cold.into_iter().take(enough));
            }
        }
        if observation.extrinsics == Extrinsics::Unknown {
            for camera in starts.iter_mut().filter_map(|start| start.cameras.first_mut()) {
                // The gauge, free of rounding.
                (camera.rotation, camera.translation) = (IDENTITY, ZERO);
            }
        }

        let run = Run {
            skeleton: &self.skeleton,
            hinges: &self.hinges,
            observation,
            options,
            figure: &figure,
            detections: &detections,
        };
        let chosen = run.choose(starts).ok_or(Refusal::NoStart)?;
        run.descend(chosen)
    }

    /// # Errors
    /// [`Refusal::PriorSize`] and [`Refusal::BadInitial`].
    fn check(
        &self,
        observation: &Observation,
        options: &Options,
        initial: Option<&Parameters>,
    ) -> Result<(), Refusal> {
        let pose = 3 * self.skeleton.joint_count();
        if let PosePrior::Mixture(mixture) = &options.pose_prior
            && mixture.dimension() != pose - 3
        {
            return Err(Refusal::PriorSize { found: mixture.dimension(), expected: pose - 3 });
        }
        let Some(initial) = initial else { return Ok(()) };
        let fault = if initial.pose.len() != pose {
            "has a pose of another length than this body's"
        } else if initial.betas.len() > self.skeleton.beta_count() {
            "has more betas than this body"
        } else if initial.cameras.len() != observation.views.len() {
            "has another number of cameras than there are views"
        } else if !initial.pose.iter().chain(&initial.betas).chain(&initial.trans).all(|x| x.is_finite()) {
            "holds a number that is not finite"
        } else {
            return Ok(());
        };
        Err(Refusal::BadInitial { fault })
    }

    /// A start that was handed in, with all betas and the intrinsics (and known extrinsics) of this observation.
    fn initial(&self, initial: &Parameters, observation: &Observation) -> Parameters {
        let mut start = initial.clone();
        start.betas.resize(self.skeleton.beta_count(), 0.0);
        for (camera, view) in start.cameras.iter_mut().zip(&observation.views) {
            let (rotation, translation) = (camera.rotation, camera.translation);
            *camera = view.camera;
            if observation.extrinsics == Extrinsics::Unknown {
                (camera.rotation, camera.translation) = (rotation, translation);
            }
        }
        start
    }
}

/// −2 ln of a body's probability under the polishing stage's first beliefs, without constants.
fn unlikeliness(parameters: &Parameters) -> f64 {
    let model = Model::initial(1.0);
    let turns = parameters.pose.chunks_exact(3).enumerate().skip(1);
    let pose: f64 =
        turns.map(|(j, t)| t.iter().map(|x| x * x).sum::<f64>() / model.deviation_rad(j).powi(2)).sum();
    pose + parameters.betas.iter().map(|b| b * b).sum::<f64>()
}

/// The sum of the views' mean distances.
fn total_px(fit: &Fit) -> f64 {
    fit.views.iter().map(|v| v.mean_px).sum()
}

/// The marks that count, with weights relative to the heaviest.
///
/// # Errors
/// The refusals of [`Observation`].
fn detections(observation: &Observation, figure: &Figure) -> Result<Vec<Detection>, Refusal> {
    let weights = observation.checked_weights(figure.keypoints())?;
    let mut detections = Vec::new();
    for (view, (v, weights)) in observation.views.iter().zip(&weights).enumerate() {
        for (keypoint, (k, &weight)) in v.keypoints.iter().zip(weights).enumerate() {
            if weight > 0.0 {
                detections.push(Detection { view, keypoint, pixel_px: k.pixel_px, weight });
            }
        }
    }
    Ok(detections)
}

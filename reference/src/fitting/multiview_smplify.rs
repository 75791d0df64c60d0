//! The fit of chapter 2: start, stages, polish, verdict.

use super::depth_flip::depth_flips;
use super::energy::{BendTerm, Energy};
use super::figure::Figure;
use super::keypoint_residuals::{Detection, KeypointResiduals};
use super::keypoint_set::has_smpl_tree;
use super::layout::Layout;
use super::observation::{Extrinsics, Observation, Refusal};
use super::polish::{Case, Model, Polished, polish};
use super::presets::{Options, PosePrior, Stage, Start, Translations};
use super::result::{Fit, Parameters, StageReport, Verdict};
use super::start::Evidence;
use super::verdict::{given_up, sizes_px, verdict, view_residuals};
use crate::body::{BodyModel, Hinge, Skeleton};
use crate::least_squares::{Dogleg, Problem, Solution, Termination};
use crate::linalg::matrix::IDENTITY;
use crate::linalg::vector::{ZERO, add, norm};
use crate::rotation::{logarithm, rodrigues};

/// Accepted steps after which starts are compared.
const TRIAL_ITERATIONS: usize = 16;
/// A body less likely than this is looked at again with left and right exchanged; poses of every day stay below.
const SUSPICIOUS: f64 = 60.0;
/// The exchange counts if it leaves less than this of the unlikeliness.
const HARDLY: f64 = 0.4;
/// Energies that differ by less than this fraction belong to one minimum.
const SAME_ENERGY: f64 = 0.005;
/// Marks that are met to this noise are met exactly, and no other start can do better, pixels.
const EXACT_PX: f64 = 0.02;
/// Noise between these two is less than any detector's and more than rounding: exact marks, and a minimum beside the answer.
const NEARLY_EXACT_PX: f64 = 0.1;
/// Accepted steps from each of the starts that are tried then.
const RETRY_ITERATIONS: usize = 40;
/// Noise that is believed at first is the median error of the start times this, within these bounds, pixels.
const NOISE_OF_MEDIAN: f64 = 1.5;
const FIRST_NOISE_PX: [f64; 2] = [0.5, 50.0];

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

        let run = Run { fitter: self, observation, options, figure: &figure, detections: &detections };
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

/// One fit under way.
struct Run<'r> {
    fitter: &'r MultiviewSmplify<'r>,
    observation: &'r Observation,
    options: &'r Options,
    figure: &'r Figure<'r>,
    detections: &'r [Detection],
}

/// A start that was chosen, and how far the comparison took it.
struct Chosen {
    start: Parameters,
    trial: Option<Polished>,
}

impl Run<'_> {
    fn layout(&self, translations: Translations) -> Layout {
        Layout::new(
            self.fitter.skeleton.joint_count(),
            self.fitter.skeleton.beta_count(),
            self.observation.views.len(),
            self.observation.extrinsics,
            translations,
        )
    }

    fn keypoints(&self, sigma_px: f64) -> KeypointResiduals<'_> {
        KeypointResiduals {
            figure: self.figure,
            detections: self.detections,
            sigma_px,
            loss: self.options.loss,
        }
    }

    fn case<'c>(
        &'c self,
        layout: &'c Layout,
        fixed: &'c Parameters,
        detections: &'c [Detection],
    ) -> Case<'c> {
        Case {
            figure: self.figure,
            detections,
            layout,
            hinges: &self.fitter.hinges,
            fixed,
            loss: self.options.loss,
        }
    }

    /// Weights relative to the heaviest: what the polishing stage means by noise at weight 1.
    fn relative_detections(&self) -> Vec<Detection> {
        let heaviest = self.detections.iter().map(|d| d.weight).fold(f64::MIN_POSITIVE, f64::max);
        self.detections.iter().map(|d| Detection { weight: d.weight / heaviest, ..*d }).collect()
    }

    /// The noise that a start suggests; `None` if it puts a point behind a camera.
    fn first_noise_px(&self, start: &Parameters) -> Option<f64> {
        let mut errors: Vec<f64> =
            self.keypoints(self.options.sigma_px).errors(start)?.iter().map(|e| e[0].hypot(e[1])).collect();
        errors.sort_by(f64::total_cmp);
        let [least, most] = FIRST_NOISE_PX;
        Some((NOISE_OF_MEDIAN * errors[errors.len() / 2]).clamp(least, most))
    }

    /// The best of several starts, after a short descent from each under the polishing stage's model.
    ///
    /// To compare them their energies are taken under one model: the least noise that any of them found. The search ends when
    /// a descent meets the marks exactly, or when two descents from different starts meet at the best energy so far, unless the
    /// best has given up a limb: an arm that lies wrong in two views looks like six outliers.
    fn choose(&self, starts: Vec<Parameters>) -> Option<Chosen> {
        let mut starts: Vec<(Parameters, f64)> = starts
            .into_iter()
            .filter_map(|start| {
                let noise_px = self.first_noise_px(&start)?;
                Some((start, noise_px))
            })
            .collect();
        if starts.len() < 2 {
            return starts.pop().map(|(start, _)| Chosen { start, trial: None });
        }
        let (layout, detections) = (self.layout(Translations::Free), self.relative_detections());
        let mut trials: Vec<(Parameters, Polished)> = Vec::new();
        let mut energies: Vec<f64> = Vec::new();
        for (start, noise_px) in starts {
            let case = self.case(&layout, &start, &detections);
            let trial = polish(&case, Model::initial(noise_px), &layout.pack(&start), TRIAL_ITERATIONS);
            trials.push((start, trial));
            let least = trials.iter().map(|(_, t)| t.model.noise_px).fold(f64::INFINITY, f64::min);
            let common = Model::initial(least);
            let energy = |(start, trial): &(Parameters, Polished)| {
                let case = self.case(&layout, start, &detections);
                let residuals = case.energy(&common, &case.damping(&common)).residuals(&trial.solution.x);
                residuals.map_or(f64::INFINITY, |r| r.iter().map(|r| r * r).sum())
            };
            energies = trials.iter().map(energy).collect();
            let (best, &energy) = energies.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
            let together = energies.iter().filter(|&&e| e <= (1.0 + SAME_ENERGY) * energy).count();
            if (least < EXACT_PX || together > 1) && self.holds_every_limb(&layout, &trials[best]) {
                break;
            }
        }
        let ((start, trial), _) = trials.into_iter().zip(energies).min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Chosen { start, trial: Some(trial) })
    }

    /// Whether every keypoint is met in some view.
    fn holds_every_limb(&self, layout: &Layout, (start, trial): &(Parameters, Polished)) -> bool {
        let found = layout.unpack(&trial.solution.x, start);
        let errors = self.keypoints(self.options.sigma_px).errors(&found);
        let sizes_px = sizes_px(self.figure, &found);
        errors.is_some_and(|errors| given_up(self.detections, &errors, &sizes_px).is_empty())
    }

    /// Stages and polish from a start to the answer.
    fn descend(&self, chosen: Chosen) -> Result<Fit, Refusal> {
        let layout = self.layout(self.options.translations);
        let mut at = chosen.start;
        let mut stages = Vec::new();
        for stage in &self.options.stages {
            let solution = self.stage(stage, &layout, &at);
            at = layout.unpack(&solution.x, &at);
            stages.push(report(&solution));
        }
        let mut noise_px = None;
        if let Some(limits) = &self.options.polish {
            let detections = self.relative_detections();
            // Without stages in between the trial's way is not gone twice.
            let trial = chosen.trial.filter(|_| stages.is_empty());
            if let Some(trial) = &trial {
                at = self.layout(Translations::Free).unpack(&trial.solution.x, &at);
            }
            let (first, gone) = match trial {
                Some(Polished { model, solution }) => (model, [solution.iterations, solution.evaluations]),
                None => (Model::initial(self.first_noise_px(&at).ok_or(Refusal::NoStart)?), [0; 2]),
            };
            let case = self.case(&layout, &at, &detections);
            let mut polished = polish(&case, first, &layout.pack(&at), limits.max_iterations);
            // Of three views not all rays are parallel.
            let nearly_exact =
                polished.model.noise_px > EXACT_PX && polished.model.noise_px < NEARLY_EXACT_PX;
            if nearly_exact && self.observation.views.len() == 2 {
                let ended = layout.unpack(&polished.solution.x, &at);
                let (model, most) = (polished.model, limits.max_iterations);
                let other = depth_flips(&self.fitter.skeleton, &ended).into_iter().find_map(|start| {
                    let other = polish(&case, model, &layout.pack(&start), most.min(RETRY_ITERATIONS));
                    (other.model.noise_px < EXACT_PX).then_some(other)
                });
                if let Some(mut other) = other {
                    other.solution.iterations += polished.solution.iterations;
                    other.solution.evaluations += polished.solution.evaluations;
                    polished = other;
                }
            }
            polished.solution.iterations += gone[0];
            polished.solution.evaluations += gone[1];
            noise_px = Some(polished.model.noise_px);
            stages.push(report(&polished.solution));
            at = layout.unpack(&polished.solution.x, &at);
        }
        self.conclude(at, stages, noise_px)
    }

    /// One stage of the annealing.
    fn stage(&self, stage: &Stage, layout: &Layout, at: &Parameters) -> Solution {
        let weak = match self.options.pose_prior {
            PosePrior::L2(relative) => relative * stage.pose_weight,
            PosePrior::None | PosePrior::Mixture(_) => 0.0,
        };
        let pose = (layout.pose.start + 3..layout.pose.end).map(|c| (c, weak)).filter(|(_, w)| *w > 0.0);
        let damping: Vec<(usize, f64)> =
            pose.chain(layout.betas.clone().map(|c| (c, stage.shape_weight))).collect();
        let energy = Energy {
            keypoints: self.keypoints(self.options.sigma_px),
            layout,
            fixed: at,
            damping: &damping,
            hinges: &self.fitter.hinges,
            bend: BendTerm::Exponential { factor: stage.pose_weight * self.options.bend_factor },
            mixture: match &self.options.pose_prior {
                PosePrior::Mixture(mixture) => Some((stage.pose_weight, mixture)),
                PosePrior::None | PosePrior::L2(_) => None,
            },
        };
        let dogleg = Dogleg {
            max_iterations: stage.max_iterations,
            improvement_tolerance: stage.improvement_tolerance,
            ..Dogleg::default()
        };
        dogleg.minimize(&energy, &layout.pack(at))
    }

    fn conclude(
        &self,
        mut parameters: Parameters,
        stages: Vec<StageReport>,
        noise_px: Option<f64>,
    ) -> Result<Fit, Refusal> {
        // The bend prior has no bottom: it may have wound a knee up by a full turn, which is no turn.
        for theta in parameters.pose.chunks_exact_mut(3) {
            let turn = [theta[0], theta[1], theta[2]];
            if norm(turn) > std::f64::consts::PI {
                theta.copy_from_slice(&logarithm(&rodrigues(turn)));
            }
        }
        let errors = self.keypoints(self.options.sigma_px).errors(&parameters).ok_or(Refusal::NoStart)?;
        let views = view_residuals(self.detections, &errors, self.observation.views.len());
        let last = stages.last().copied();
        let termination = last.map_or(Termination::SmallGradient, |s| s.termination);
        let skeleton = &self.fitter.skeleton;
        let joints = skeleton.posed_joints(&parameters.pose, &parameters.betas);
        let missing = |(k, keypoint): (usize, &Option<_>)| keypoint.is_none().then_some(k);
        Ok(Fit {
            joints: joints.into_iter().map(|p| add(p, parameters.trans)).collect(),
            verdict: verdict(
                self.figure,
                &self.fitter.hinges,
                &parameters,
                self.detections,
                &errors,
                &views,
                termination,
            ),
            energy: last.map_or(f64::NAN, |s| s.energy),
            left_out: self.figure.keypoints().iter().enumerate().filter_map(missing).collect(),
            parameters,
            stages,
            views,
            noise_px,
        })
    }
}

fn report(solution: &Solution) -> StageReport {
    StageReport {
        energy: solution.energy,
        iterations: solution.iterations,
        evaluations: solution.evaluations,
        termination: solution.termination,
    }
}

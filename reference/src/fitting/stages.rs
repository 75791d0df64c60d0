//! The way down: of several starts the best, the stages of the annealing, the polish, the verdict.

use super::depth_flip::depth_flips;
use super::energy::{BendTerm, Energy};
use super::figure::Figure;
use super::keypoint_residuals::{Detection, KeypointResiduals};
use super::layout::Layout;
use super::observation::{Observation, Refusal};
use super::polish::{Case, Model, Polished, polish};
use super::presets::{Options, PosePrior, Stage, Translations};
use super::result::{Fit, Parameters, StageReport};
use super::verdict::{given_up, sizes_px, verdict, view_residuals};
use crate::body::{Hinge, Skeleton};
use crate::least_squares::{Dogleg, Problem, Solution, Termination};
use crate::linalg::vector::{add, norm};
use crate::rotation::{logarithm, rodrigues};

/// Accepted steps after which starts are compared.
const TRIAL_ITERATIONS: usize = 16;
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

/// One fit under way: what it is given.
pub(super) struct Run<'r> {
    pub skeleton: &'r Skeleton,
    pub hinges: &'r [Hinge],
    pub observation: &'r Observation,
    pub options: &'r Options,
    pub figure: &'r Figure<'r>,
    pub detections: &'r [Detection],
}

/// A start that was chosen, and how far the comparison took it.
pub(super) struct Chosen {
    start: Parameters,
    trial: Option<Polished>,
}

impl Run<'_> {
    fn layout(&self, translations: Translations) -> Layout {
        Layout::new(
            self.skeleton.joint_count(),
            self.skeleton.beta_count(),
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
        Case { figure: self.figure, detections, layout, hinges: self.hinges, fixed, loss: self.options.loss }
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
    pub fn choose(&self, starts: Vec<Parameters>) -> Option<Chosen> {
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
    pub fn descend(&self, chosen: Chosen) -> Result<Fit, Refusal> {
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
                let other = depth_flips(self.skeleton, &ended).into_iter().find_map(|start| {
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
            hinges: self.hinges,
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

    /// The answer with its verdict.
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
        let joints = self.skeleton.posed_joints(&parameters.pose, &parameters.betas);
        let missing = |(k, keypoint): (usize, &Option<_>)| keypoint.is_none().then_some(k);
        Ok(Fit {
            joints: joints.into_iter().map(|p| add(p, parameters.trans)).collect(),
            verdict: verdict(
                self.figure,
                self.hinges,
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

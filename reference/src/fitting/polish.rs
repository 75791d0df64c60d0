//! The polishing stage: priors whose weight the data decide (empirical Bayes).
//!
//! With fixed weights a prior either biases exact joints or lets noise through. Here the weights are what a Gaussian model
//! of the case says: marks have noise of s pixels, shapes are N(0, 1), the turns of trunk and limbs have deviations
//! τ_trunk and τ_limbs, and the most probable body minimises
//!
//! ```text
//! Σ w² ρ(e) + s² ( ‖β‖² + Σ_j ‖θ_j‖²/τ_g(j)² + max(0, −φ)²/τ_bend² ).
//! ```
//!
//! s and τ are unknown too. At a minimum with H = JᵀJ, each prior number c of weight w_c is determined by its prior to the
//! fraction w_c² (H⁻¹)_cc and by the data to the rest, γ_c. The marks then determine γ = n − Σ_c w_c²(H⁻¹)_cc of the n
//! unknowns, and the evidence has its maximum where
//!
//! ```text
//! s² = Σ v w² e² / (Σ v − γ),      τ_g² = Σ_{c ∈ g} θ_c² / Σ_{c ∈ g} γ_c.
//! ```
//!
//! with v the loss' own weight, near 1 for inliers and 0 for outliers. Descent and re-estimation alternate. Exact marks give s → 0: the priors fade to a tie-break in directions that the data
//! leave open. Noisy marks give the maximum a posteriori. The loss is made for outliers, so its σ follows the noise as 5 s.
//!
//! # References
//! MacKay 1992, "Bayesian interpolation", for the fixed point; the stage itself is not in the thesis, whose priors bias
//! exact joints.

use super::energy::{BendTerm, Energy};
use super::figure::Figure;
use super::keypoint_residuals::{Detection, KeypointResiduals};
use super::layout::Layout;
use super::presets::LossForm;
use super::result::Parameters;
use crate::body::Hinge;
use crate::least_squares::{Dogleg, Problem, Solution, Termination};
use crate::linalg::cholesky::Cholesky;
use crate::linalg::dense::Dense;
use crate::robust_loss::weight;

/// Joints of the trunk in SMPL's tree: spine, neck, collars.
pub(super) const TRUNK: [usize; 6] = [3, 6, 9, 12, 13, 14];

/// What the polishing stage believes before it has seen this case, and how strongly (in numbers of θ).
const TRUNK_DEVIATION_RAD: f64 = 0.15;
const LIMB_DEVIATION_RAD: f64 = 0.4;
const DEVIATION_STRENGTH: f64 = 4.0;
/// A limb this far beyond straight is as unlikely as a deviation.
const BACKWARD_BEND_RAD: f64 = 0.1;
/// σ of the loss in units of the noise, and at least, pixels: rounding and lenses are never below.
const SIGMA_OF_NOISE: f64 = 5.0;
const LEAST_SIGMA_PX: f64 = 1.0;
/// Exact data would drive s to 0 and the normal equations to singularity. At 10⁻³ px the priors move joints by less than
/// 10⁻⁶ m.
const LEAST_NOISE_PX: f64 = 1e-3;
/// The same where residuals are fewer than unknowns and can all vanish without being exact.
const LEAST_NOISE_UNDERDETERMINED_PX: f64 = 0.5;

/// The model of a case: noise and deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// s, pixels per coordinate at weight 1.
    pub noise_px: f64,
    /// τ_trunk, radians.
    pub trunk_rad: f64,
    /// τ_limbs, radians.
    pub limbs_rad: f64,
    /// σ of the loss, pixels.
    pub sigma_px: f64,
}

impl Model {
    /// What is believed at first; `noise_px` for want of better.
    pub fn initial(noise_px: f64) -> Model {
        Model {
            noise_px,
            trunk_rad: TRUNK_DEVIATION_RAD,
            limbs_rad: LIMB_DEVIATION_RAD,
            sigma_px: (SIGMA_OF_NOISE * noise_px).max(LEAST_SIGMA_PX),
        }
    }

    /// τ of a joint, radians per component.
    pub fn deviation_rad(&self, joint: usize) -> f64 {
        if TRUNK.contains(&joint) { self.trunk_rad } else { self.limbs_rad }
    }
}

/// Steps between two estimates of the model, and the fraction by which its numbers may still change at the end.
const ROUND_ITERATIONS: usize = 4;
const SETTLED: f64 = 0.02;
/// Descents between estimates, and the last one, stop when the energy falls by less than these fractions.
const ROUND_IMPROVEMENT: f64 = 1e-2;
const LAST_IMPROVEMENT: f64 = 1e-4;

/// What stays the same while a case is polished.
#[derive(Clone, Copy, Debug)]
pub struct Case<'a> {
    /// The body.
    pub figure: &'a Figure<'a>,
    /// The marks.
    pub detections: &'a [Detection],
    /// The unknowns.
    pub layout: &'a Layout,
    /// Elbows and knees.
    pub hinges: &'a [Hinge],
    /// Values of what is not unknown.
    pub fixed: &'a Parameters,
    /// How the loss takes a 2-D error.
    pub loss: LossForm,
}

impl Case<'_> {
    /// (column, weight) of every Gaussian prior of the model.
    pub fn damping(&self, model: &Model) -> Vec<(usize, f64)> {
        let shape = self.layout.betas.clone().map(|c| (c, model.noise_px));
        let pose = (3..self.layout.pose.len())
            .map(|n| (self.layout.pose.start + n, model.noise_px / model.deviation_rad(n / 3)));
        pose.chain(shape).collect()
    }

    /// The energy of a model.
    pub fn energy<'e>(&'e self, model: &Model, damping: &'e [(usize, f64)]) -> Energy<'e> {
        Energy {
            keypoints: KeypointResiduals {
                figure: self.figure,
                detections: self.detections,
                sigma_px: model.sigma_px,
                loss: self.loss,
            },
            layout: self.layout,
            fixed: self.fixed,
            damping,
            hinges: self.hinges,
            bend: BendTerm::OneSided { weight: model.noise_px / BACKWARD_BEND_RAD },
            mixture: None,
        }
    }

    /// Descends from x under a model held fixed.
    pub fn descend(
        &self,
        model: &Model,
        x: &[f64],
        max_iterations: usize,
        improvement_tolerance: f64,
    ) -> Solution {
        let damping = self.damping(model);
        let dogleg =
            Dogleg { max_iterations, improvement_tolerance, step_tolerance: 1e-12, ..Dogleg::default() };
        dogleg.minimize(&self.energy(model, &damping), x)
    }

    /// The model that the evidence prefers at x, given the one that led there; `None` if H is singular.
    pub fn re_estimate(&self, model: &Model, x: &[f64]) -> Option<Model> {
        let damping = self.damping(model);
        let energy = self.energy(model, &damping);
        let jacobian = energy.jacobian(x);
        let undetermined = inverse_diagonal(&Cholesky::factor(&jacobian.gram())?);

        let mut gamma = self.layout.len as f64;
        // Σθ² and Σγ of trunk and limbs.
        let mut groups = [[0.0; 2]; 2];
        for &(c, w) in &damping {
            let by_prior = (w * w * undetermined[c]).min(1.0);
            gamma -= by_prior;
            if self.layout.pose.contains(&c) {
                let group = &mut groups[usize::from(!TRUNK.contains(&(c / 3)))];
                group[0] += x[c] * x[c];
                group[1] += 1.0 - by_prior;
            }
        }
        let deviation = |[squares, count]: [f64; 2], believed: f64| {
            ((squares + DEVIATION_STRENGTH * believed * believed) / (count + DEVIATION_STRENGTH)).sqrt()
        };

        let parameters = self.layout.unpack(x, self.fixed);
        let errors = energy.keypoints.errors(&parameters)?;
        let (mut squares, mut count) = (0.0, 0.0);
        for (e, d) in errors.iter().flatten().zip(self.detections.iter().flat_map(|d| [d, d])) {
            // An outlier carries no information about the noise of the others.
            let inlier = weight(*e, model.sigma_px);
            squares += inlier * (d.weight * e).powi(2);
            count += inlier;
        }
        let spare = count - gamma;
        let least = if self.layout.len > 2 * self.detections.len() {
            LEAST_NOISE_UNDERDETERMINED_PX
        } else {
            LEAST_NOISE_PX
        };
        let found = if spare > 1.0 { (squares / spare).sqrt() } else { model.noise_px };
        let noise_px = found.max(least);
        Some(Model {
            noise_px,
            trunk_rad: deviation(groups[0], TRUNK_DEVIATION_RAD),
            limbs_rad: deviation(groups[1], LIMB_DEVIATION_RAD),
            sigma_px: (SIGMA_OF_NOISE * noise_px).max(LEAST_SIGMA_PX).min(model.sigma_px),
        })
    }
}

/// The diagonal of (L Lᵀ)⁻¹: Σ_i (L⁻¹)_ic².
fn inverse_diagonal(cholesky: &Cholesky) -> Vec<f64> {
    let lower = cholesky.lower();
    let n = lower.rows();
    // Column c of L⁻¹ is row c here, zero before c.
    let mut diagonal = vec![0.0; n];
    let mut inverse = Dense::zeros(n, n);
    for i in 0..n {
        let row = lower.row(i);
        for c in 0..=i {
            let known: f64 = row[c..i].iter().zip(&inverse.row(c)[c..i]).map(|(l, x)| l * x).sum();
            let value = (if i == c { 1.0 } else { 0.0 } - known) / row[i];
            inverse.row_mut(c)[i] = value;
            diagonal[c] += value * value;
        }
    }
    diagonal
}

/// A polished x with its model.
#[derive(Clone, Debug)]
pub struct Polished {
    /// Where it ended.
    pub solution: Solution,
    /// The model there.
    pub model: Model,
}

/// Alternates descent and re-estimation until the model stays, then descends to the end; at most `max_iterations` accepted
/// steps in all.
pub fn polish(case: &Case, start: Model, x: &[f64], max_iterations: usize) -> Polished {
    let (mut iterations, mut evaluations) = (0, 0);
    let mut model = start;
    let mut x = x.to_vec();
    while iterations < max_iterations {
        let round =
            case.descend(&model, &x, ROUND_ITERATIONS.min(max_iterations - iterations), ROUND_IMPROVEMENT);
        iterations += round.iterations;
        evaluations += round.evaluations;
        x = round.x;
        if round.termination == Termination::NotFinite {
            break;
        }
        let Some(next) = case.re_estimate(&model, &x) else { break };
        let numbers = |m: &Model| [m.noise_px, m.trunk_rad, m.limbs_rad];
        let settled =
            numbers(&next).iter().zip(numbers(&model)).all(|(new, old)| (new / old - 1.0).abs() < SETTLED);
        model = next;
        if settled {
            break;
        }
    }
    let last = case.descend(&model, &x, max_iterations.saturating_sub(iterations).max(1), LAST_IMPROVEMENT);
    Polished {
        solution: Solution {
            iterations: iterations + last.iterations,
            evaluations: evaluations + last.evaluations,
            ..last
        },
        model,
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{add_noise, body, observe, person, ring};
    use super::super::{Extrinsics, KeypointSet, Observation, Translations};
    use super::*;

    #[test]
    fn inverse_diagonal_by_hand() {
        // [4, 2; 2, 3]⁻¹ = [3, −2; −2, 4]/8.
        let cholesky =
            Cholesky::factor(&Dense::new(2, 2, vec![4.0, 2.0, 2.0, 3.0])).expect("positive definite");
        let diagonal = inverse_diagonal(&cholesky);
        assert!((diagonal[0] - 0.375).abs() < 1e-15 && (diagonal[1] - 0.5).abs() < 1e-15, "{diagonal:?}");
    }

    /// The model found from the truth as the start.
    fn model_of(noise_px: f64, outliers: usize) -> Model {
        let person = person(4);
        let mut observation: Observation = observe(&person, &ring(4), Extrinsics::Known);
        add_noise(&mut observation, noise_px, 11);
        for k in 0..outliers {
            observation.views[k % 4].keypoints[5 * k % 24].pixel_px[0] += 80.0;
        }
        let skeleton = body().skeleton();
        let figure = Figure::new(body(), &skeleton, KeypointSet::Smpl24);
        let hinges: Vec<Hinge> = skeleton.hinges().into_iter().flatten().collect();
        let layout = Layout::new(24, 10, 4, Extrinsics::Known, Translations::Free);
        let fixed = Parameters {
            pose: person.pose,
            betas: person.betas,
            trans: person.trans,
            cameras: observation.views.iter().map(|v| v.camera).collect(),
        };
        let mut detections = Vec::new();
        for (view, v) in observation.views.iter().enumerate() {
            for (keypoint, k) in v.keypoints.iter().enumerate() {
                detections.push(Detection { view, keypoint, pixel_px: k.pixel_px, weight: 1.0 });
            }
        }
        let case = Case {
            figure: &figure,
            detections: &detections,
            layout: &layout,
            hinges: &hinges,
            fixed: &fixed,
            loss: LossForm::PerCoordinate,
        };
        polish(&case, Model::initial(3.0), &layout.pack(&fixed), 100).model
    }

    #[test]
    fn noise_is_found_whatever_it_is() {
        assert_eq!(model_of(0.0, 0).noise_px, LEAST_NOISE_PX);
        for noise_px in [0.1, 1.0, 5.0] {
            let found = model_of(noise_px, 0).noise_px;
            // 192 residuals, some 60 of them spent: one part in sixteen.
            assert!((found / noise_px - 1.0).abs() < 0.2, "{found} px for {noise_px}");
        }
    }

    #[test]
    fn outliers_do_not_pass_for_noise() {
        let found = model_of(1.0, 4).noise_px;
        assert!((found - 1.0).abs() < 0.35, "{found} px");
    }

    #[test]
    fn deviations_stay_between_belief_and_data() {
        let model = model_of(0.5, 0);
        assert!(model.trunk_rad < TRUNK_DEVIATION_RAD && model.trunk_rad > 0.05, "{model:?}");
        assert!(model.limbs_rad > 0.15 && model.limbs_rad < 0.6, "{model:?}");
    }
}

//! How a fit is run: weights, stages and free variables, and the named presets.

use super::prior::GaussianMixture;

/// Where the descent begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Rest pose, R_i = I, translation from the torso's similar triangles: the thesis. Views from the side or behind begin in
    /// a wrong basin.
    Identity,
    /// Several starts from the geometry of the views (triangulated joints, relative poses of two views, yaw search with
    /// front/back flip); the one of lowest energy is kept.
    Robust,
}

/// One stage of the annealing: weights on *residuals*, so they enter the energy squared (erratum E5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// λ_θ, on the bend prior and on the pose prior.
    pub pose_weight: f64,
    /// λ_β, on β.
    pub shape_weight: f64,
    /// Accepted steps at most.
    pub max_iterations: usize,
    /// Stop when the energy falls by less than this fraction (the dogleg's e_3).
    pub improvement_tolerance: f64,
}

/// The prior on the pose without its root, beside the bend prior.
#[derive(Clone, Debug, PartialEq)]
pub enum PosePrior {
    /// The bend prior alone.
    None,
    /// λ_θ · this weight · θ.
    L2(f64),
    /// λ_θ · the mixture's residuals.
    Mixture(GaussianMixture),
}

/// How the loss sees a 2-D error (erratum E3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LossForm {
    /// ρ(Δu) + ρ(Δv).
    PerCoordinate,
    /// ρ(‖(Δu, Δv)‖).
    Radial,
}

/// What happens to translations after the camera step when extrinsics are unknown (erratum E8).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Translations {
    /// t_i and `trans` stay as the torso gave them: eq. 2.2 optimises θ, β, R.
    Fixed,
    /// They are variables of every stage: eq. 3.1.
    Free,
}

/// How a fit is run.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Where it begins.
    pub start: Start,
    /// The annealing, in order.
    pub stages: Vec<Stage>,
    /// σ of the Geman–McClure loss in the stages, pixels.
    pub sigma_px: f64,
    /// Per coordinate or radial.
    pub loss: LossForm,
    /// What the bend prior's exponentials are multiplied by beside λ_θ: 0.317 · α.
    pub bend_factor: f64,
    /// The prior on the pose.
    pub pose_prior: PosePrior,
    /// Whether translations are optimised with unknown extrinsics.
    pub translations: Translations,
    /// The stage after the annealing whose priors fade to what the data leave undetermined.
    pub polish: Option<Polish>,
}

/// The polishing stage: empirical Bayes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polish {
    /// Accepted steps at most, over all rounds.
    pub max_iterations: usize,
}

/// The named ways to run a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Preset {
    /// SMPLify (Bogo et al. 2016): stages (404, 100), (404, 50), (57.4, 10), (4.78, 5), translation fixed. With one view the
    /// baseline of the thesis' tables.
    Smplify,
    /// Li 2021, ch. 2: stages (404, 100), (404, 50), (58, 5), (4.78, 1), translations fixed.
    Ch2,
    /// Li 2021, Table 3.1, pose: stages (91, 100), (91, 50), (47.4, 10), (4.78, 5), translations free.
    Ch3,
    /// Robust start, a short descent, then empirical Bayes: exact data are met exactly, noisy data give the maximum a
    /// posteriori.
    #[default]
    EmpiricalBayes,
}

/// 0.317 · α of SMPLify, with α = 10 (erratum E4).
const BEND_FACTOR: f64 = 3.17;

/// The relative weight of θ that keeps the thesis' stages regular where no mixture is given: 15 directions move no joint.
const WEAK_L2: f64 = 0.01;

impl Preset {
    /// All presets.
    pub const ALL: [Preset; 4] = [Preset::Smplify, Preset::Ch2, Preset::Ch3, Preset::EmpiricalBayes];

    /// The name that commands and reports use.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Smplify => "smplify",
            Preset::Ch2 => "ch2",
            Preset::Ch3 => "ch3",
            Preset::EmpiricalBayes => "empirical-bayes",
        }
    }

    /// What the preset stands for, with the robust start.
    ///
    /// # Conventions
    /// The thesis gives "100 iterations" and "error of the energy < 10⁻³" (erratum E13): read as accepted steps and as the
    /// relative improvement. Whether it kept SMPLify's mixture prior is open; without one a weak θ² takes its place.
    pub fn options(self) -> Options {
        let stages = |weights: [(f64, f64); 4], improvement_tolerance| {
            weights
                .map(|(pose_weight, shape_weight)| Stage {
                    pose_weight,
                    shape_weight,
                    max_iterations: 100,
                    improvement_tolerance,
                })
                .to_vec()
        };
        let thesis = Options {
            start: Start::Robust,
            stages: Vec::new(),
            sigma_px: 100.0,
            loss: LossForm::PerCoordinate,
            bend_factor: BEND_FACTOR,
            pose_prior: PosePrior::L2(WEAK_L2),
            translations: Translations::Fixed,
            polish: None,
        };
        match self {
            Preset::Smplify => Options {
                stages: stages([(404.0, 100.0), (404.0, 50.0), (57.4, 10.0), (4.78, 5.0)], 1e-4),
                ..thesis
            },
            Preset::Ch2 => Options {
                stages: stages([(404.0, 100.0), (404.0, 50.0), (58.0, 5.0), (4.78, 1.0)], 1e-3),
                ..thesis
            },
            Preset::Ch3 => Options {
                stages: stages([(91.0, 100.0), (91.0, 50.0), (47.4, 10.0), (4.78, 5.0)], 1e-3),
                translations: Translations::Free,
                ..thesis
            },
            Preset::EmpiricalBayes => Options {
                stages: Vec::new(),
                translations: Translations::Free,
                polish: Some(Polish { max_iterations: 400 }),
                ..thesis
            },
        }
    }
}

impl Default for Options {
    /// [`Preset::EmpiricalBayes`].
    fn default() -> Options {
        Preset::default().options()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_differ_where_the_texts_do() {
        let weights = |preset: Preset| {
            preset.options().stages.iter().map(|s| (s.pose_weight, s.shape_weight)).collect::<Vec<_>>()
        };
        assert_eq!(weights(Preset::Smplify)[2..], [(57.4, 10.0), (4.78, 5.0)]);
        assert_eq!(weights(Preset::Ch2)[2..], [(58.0, 5.0), (4.78, 1.0)]);
        assert_eq!(weights(Preset::Ch3), [(91.0, 100.0), (91.0, 50.0), (47.4, 10.0), (4.78, 5.0)]);
        assert_eq!(Preset::Ch3.options().translations, Translations::Free);
        assert!(Preset::ALL.iter().filter(|p| p.options().polish.is_some()).eq([&Preset::EmpiricalBayes]));
    }
}

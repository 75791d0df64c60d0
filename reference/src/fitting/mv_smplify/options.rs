//! How a collaborative fit is run: weights, steps, and the named presets.

use super::descent::Descent;
use crate::fitting::presets::Translations;
use crate::fitting::prior::GaussianMixture;

/// How the shared pose begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeanPose {
    /// The [chordal mean](crate::rotation::mean) of every joint's rotations.
    Chordal,
    /// The [arithmetic mean](crate::rotation::arithmetic_mean) of their axis–angle vectors: the thesis (erratum E46).
    AxisAngle,
}

/// Where the translation of a view begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartingTranslation {
    /// Where the regressor puts it: the thesis.
    Given,
    /// Where the regressor's body fits the marks best, by [least squares](crate::fitting::camera_translation).
    LeastSquares,
}

/// How a fit is run. All pixels are those of a person crop of [`MvSmplifyOptions::crop_side_px`].
#[derive(Clone, Debug, PartialEq)]
pub struct MvSmplifyOptions {
    /// The side of the crop to whose pixels errors are scaled: 224. Weights and σ then mean the same at any resolution.
    pub crop_side_px: f64,
    /// How the shared pose begins.
    pub mean_pose: MeanPose,
    /// Where translations begin.
    pub starting_translation: StartingTranslation,
    /// Stage 1.
    pub torso: Descent,
    /// λ_z of stage 1, pixels per metre: 100.
    pub depth_weight: f64,
    /// Stage 2.
    pub shared: Descent,
    /// A second descent of stage 2, with priors no stronger than the noise that the first one left asks for
    /// ([`noise`](super::noise)).
    pub settling: Option<Descent>,
    /// Whether stage 2 moves the translations (erratum E45).
    pub translations: Translations,
    /// σ of the Geman–McClure loss in stage 2, pixels: 100.
    pub sigma_px: f64,
    /// λ_a on exp(−φ) of elbows and knees: 15.2.
    pub bend_weight: f64,
    /// λ_β: 5.
    pub shape_weight: f64,
    /// λ_s on θ̃ − θ̃_start, pixels per radian: what the regressor is trusted to know of the pose. 0 in the thesis, whose mixture
    /// keeps poses likely.
    pub start_weight: f64,
    /// λ_θ of the mixture, if there is one: 4.78.
    pub mixture_weight: f64,
    /// The mixture over the pose without its root.
    pub mixture: Option<GaussianMixture>,
    /// Whether views that would fit far better facing elsewhere are tried there as well, and the better fit is kept.
    pub reseat: bool,
}

/// The named ways to run a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum MvPreset {
    /// Li 2021, ch. 4 §3.3, to the letter: 100 + 100 steps of 10⁻², axis–angle mean, translations fixed in stage 2.
    Thesis,
    /// The same numbers as the released code runs them: translations move in stage 2 as well.
    Released,
    /// What serves a user without a mixture of poses: translations move, the pose keeps near what the regressor said, and in a
    /// second descent all priors are as strong as the noise of the marks asks for.
    #[default]
    Refined,
}

impl MvPreset {
    /// All presets.
    pub const ALL: [MvPreset; 3] = [MvPreset::Thesis, MvPreset::Released, MvPreset::Refined];

    /// The name that commands and reports use.
    pub fn name(self) -> &'static str {
        match self {
            MvPreset::Thesis => "thesis",
            MvPreset::Released => "released",
            MvPreset::Refined => "refined",
        }
    }

    /// What the preset stands for; without a mixture, which is data of others.
    ///
    /// [`MvPreset::Refined`] takes the regressor's errors to be 0.2 rad in each component: λ_s = 5 px / 0.2 rad, as λ_β = 5 px
    /// for betas of deviation 1 ([`noise`](super::noise)). Its steps are as long as the first descent needs to cross 0.5 rad, and
    /// fall until what Adam leaves undecided is less than the noise.
    pub fn options(self) -> MvSmplifyOptions {
        let thesis = MvSmplifyOptions {
            crop_side_px: 224.0,
            mean_pose: MeanPose::AxisAngle,
            starting_translation: StartingTranslation::Given,
            torso: Descent::constant(100, 1e-2),
            depth_weight: 100.0,
            shared: Descent::constant(100, 1e-2),
            settling: None,
            translations: Translations::Fixed,
            sigma_px: 100.0,
            bend_weight: 15.2,
            shape_weight: 5.0,
            start_weight: 0.0,
            mixture_weight: 4.78,
            mixture: None,
            reseat: false,
        };
        match self {
            MvPreset::Thesis => thesis,
            MvPreset::Released => MvSmplifyOptions { translations: Translations::Free, ..thesis },
            MvPreset::Refined => MvSmplifyOptions {
                mean_pose: MeanPose::Chordal,
                translations: Translations::Free,
                shared: Descent { steps: 100, learning_rate: 3e-2, final_learning_rate: 1e-2 },
                start_weight: 25.0,
                settling: Some(Descent { steps: 150, learning_rate: 2e-2, final_learning_rate: 2e-3 }),
                reseat: true,
                ..thesis
            },
        }
    }
}

impl Default for MvSmplifyOptions {
    /// [`MvPreset::Refined`].
    fn default() -> MvSmplifyOptions {
        MvPreset::default().options()
    }
}

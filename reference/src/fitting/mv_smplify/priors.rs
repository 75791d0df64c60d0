//! What the shared stage knows before it sees a mark: bends, shape, where it started, and a mixture of poses if there is one.
//!
//! ```text
//!     E_prior = λ_a² Σ_hinges exp(−2φ) + λ_β² ‖β‖² + λ_s² ‖θ̃ − θ̃_start‖²
//!             + λ_θ² min_k [½ (θ̃ − μ_k)ᵀ Σ_k⁻¹ (θ̃ − μ_k) − ln w_k]
//! ```
//!
//! φ is the flexion of an elbow or knee. On SMPL's own skeleton exp(−φ) is exp(±θ) of components 52, 55, 9, 12 of θ̃ with signs
//! +, −, −, −; on one that rests with bent elbows it is the turn about the elbow's own axis, beyond the bend at rest
//! ([`crate::body::hinge`]).

use crate::body::Hinge;
use crate::fitting::prior::{GaussianMixture, bend_residual};

/// The priors with their weights on residuals.
#[derive(Clone, Copy, Debug)]
pub(super) struct Priors<'a> {
    pub hinges: &'a [Hinge],
    /// λ_a.
    pub bend_weight: f64,
    /// λ_β.
    pub shape_weight: f64,
    /// λ_s.
    pub start_weight: f64,
    /// θ̃_start.
    pub start: &'a [f64],
    /// λ_θ and the mixture.
    pub mixture: Option<(f64, &'a GaussianMixture)>,
}

impl<'a> Priors<'a> {
    /// The same with all weights times `factor`.
    pub(super) fn weakened(&self, factor: f64) -> Priors<'a> {
        Priors {
            hinges: self.hinges,
            bend_weight: factor * self.bend_weight,
            shape_weight: factor * self.shape_weight,
            start_weight: factor * self.start_weight,
            start: self.start,
            mixture: self.mixture.map(|(weight, mixture)| (factor * weight, mixture)),
        }
    }

    /// E_prior at θ̃ and β; adds its derivatives.
    pub(super) fn value_and_slope(
        &self,
        body_pose: &[f64],
        betas: &[f64],
        by_pose: &mut [f64],
        by_betas: &mut [f64],
    ) -> f64 {
        let mut value = 0.0;
        for hinge in self.hinges {
            // θ̃ begins with joint 1.
            let first = 3 * (hinge.joint - 1);
            let turn: f64 = hinge.axis.iter().zip(&body_pose[first..first + 3]).map(|(a, t)| a * t).sum();
            let (r, slope) = bend_residual(hinge.rest_flexion_rad + turn, self.bend_weight);
            value += r * r;
            for (c, a) in hinge.axis.iter().enumerate() {
                by_pose[first + c] += 2.0 * r * slope * a;
            }
        }
        let strength = self.shape_weight * self.shape_weight;
        for (beta, by_beta) in betas.iter().zip(by_betas) {
            value += strength * beta * beta;
            *by_beta += 2.0 * strength * beta;
        }
        let strength = self.start_weight * self.start_weight;
        for ((theta, start), by_theta) in body_pose.iter().zip(self.start).zip(&mut *by_pose) {
            value += strength * (theta - start) * (theta - start);
            *by_theta += 2.0 * strength * (theta - start);
        }
        if let Some((weight, mixture)) = self.mixture {
            let residuals = mixture.residuals(body_pose);
            let strength = weight * weight;
            value += strength * residuals.iter().map(|r| r * r).sum::<f64>();
            let slope = mixture.derivative(body_pose).apply_transposed(&residuals);
            for (sum, slope) in by_pose.iter_mut().zip(slope) {
                *sum += 2.0 * strength * slope;
            }
        }
        value
    }
}

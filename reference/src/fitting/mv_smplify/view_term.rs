//! What one view's marks cost, and how that changes with the points, the root's turn and the translation.
//!
//! With X_k = R q_k + J_0 + t and e_k = s (Π(X_k) − y_k), s from pixels of the photograph to pixels of the crop:
//!
//! ```text
//!     E_i = Σ_k w_k (ℓ(e_kx) + ℓ(e_ky)),        g_k = ∂E_i/∂X_k = w_k s Π′ᵀ ℓ′(e_k),
//!     ∂E_i/∂q_k = Rᵀ g_k,   ∂E_i/∂t = ∂E_i/∂J_0 = Σ g_k,   ∂E_i/∂r = J_l(r)ᵀ Σ (R q_k) × g_k.
//! ```
//!
//! ℓ is x² on the torso and Geman–McClure's ρ in the shared stage. A point that is not in front of its camera has no pixel; under
//! ρ it costs what the farthest mark costs, 2σ², and pulls nowhere.

use crate::camera::Pinhole;
use crate::linalg::matrix::{apply, apply_transposed};
use crate::linalg::vector::{Vector3, ZERO, add, cross};
use crate::robust_loss::{influence, rho};
use crate::rotation::{left_jacobian, rodrigues};

/// A keypoint that counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mark {
    /// Its number in the set.
    pub keypoint: usize,
    /// Where it was seen, pixels of the photograph.
    pub pixel_px: [f64; 2],
    /// Factor on its loss: the square of the factor on its error.
    pub weight: f64,
}

/// The loss of one coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Loss {
    /// x².
    Square,
    /// ρ(x) with this σ, pixels of the crop.
    GemanMcClure(f64),
}

impl Loss {
    /// The loss and its derivative.
    fn at(self, x: f64) -> [f64; 2] {
        match self {
            Loss::Square => [x * x, 2.0 * x],
            Loss::GemanMcClure(sigma) => [rho(x, sigma), 2.0 * influence(x, sigma)],
        }
    }

    /// The loss of a keypoint without a pixel.
    fn behind(self) -> f64 {
        match self {
            // Nothing bounds a square; a start that puts the torso behind the camera is not taken (see `start`).
            Loss::Square => 0.0,
            Loss::GemanMcClure(sigma) => 2.0 * sigma * sigma,
        }
    }
}

/// The marks of one view.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ViewTerm {
    /// R = I, t = 0.
    pub camera: Pinhole,
    /// s, pixels of the crop per pixel of the photograph.
    pub crop_scale: f64,
    pub marks: Vec<Mark>,
    pub loss: Loss,
}

/// Where a view's camera sees the body: r_i and t_i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    pub root: Vector3,
    pub translation: Vector3,
}

/// Derivatives of a view's loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PlacementSlope {
    pub by_root: Vector3,
    pub by_translation: Vector3,
}

impl ViewTerm {
    /// The loss; adds ∂/∂q_k to `by_points`, K of them. `points` are q_k, relative to `pelvis`.
    pub(super) fn value_and_slope(
        &self,
        at: &Placement,
        points: &[Vector3],
        pelvis: Vector3,
        by_points: &mut [Vector3],
    ) -> (f64, PlacementSlope) {
        let turn = rodrigues(at.root);
        let shift = add(pelvis, at.translation);
        let (mut value, mut force, mut torque) = (0.0, ZERO, ZERO);
        for mark in &self.marks {
            let turned = apply(&turn, points[mark.keypoint]);
            let Some((pixel, slope)) = self.camera.project_with_derivative(add(turned, shift)) else {
                value += mark.weight * self.loss.behind();
                continue;
            };
            let mut pull = ZERO;
            for i in 0..2 {
                let [loss, by_error] = self.loss.at(self.crop_scale * (pixel[i] - mark.pixel_px[i]));
                value += mark.weight * loss;
                let by_pixel = mark.weight * self.crop_scale * by_error;
                for c in 0..3 {
                    pull[c] += by_pixel * slope[i][c];
                }
            }
            force = add(force, pull);
            torque = add(torque, cross(turned, pull));
            by_points[mark.keypoint] = add(by_points[mark.keypoint], apply_transposed(&turn, pull));
        }
        let by_root = apply_transposed(&left_jacobian(at.root), torque);
        (value, PlacementSlope { by_root, by_translation: force })
    }

    /// The weighted loss of every mark, in their order.
    pub(super) fn losses(&self, at: &Placement, points: &[Vector3], pelvis: Vector3) -> Vec<f64> {
        let turn = rodrigues(at.root);
        let shift = add(pelvis, at.translation);
        let loss = |mark: &Mark| {
            let point = add(apply(&turn, points[mark.keypoint]), shift);
            let Some(pixel) = self.camera.project(point) else { return mark.weight * self.loss.behind() };
            let error = |i: usize| self.crop_scale * (pixel[i] - mark.pixel_px[i]);
            mark.weight * (self.loss.at(error(0))[0] + self.loss.at(error(1))[0])
        };
        self.marks.iter().map(loss).collect()
    }
}

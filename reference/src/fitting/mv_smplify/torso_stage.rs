//! Stage 1: where the person stands and faces in each view, from the torso.
//!
//! The body is held as the regressor gave it for that view; root orientation and translation move, each view for itself:
//!
//! ```text
//!     E_i(r, t) = Σ_torso ‖e_k‖² + λ_z² (t_z − t_z,start)²,      λ_z = 100 px/m.
//! ```
//!
//! Four points hardly see depth: a torso turned sideways looks like one farther away. The anchor keeps the regressor's.
//!
//! # Conventions
//! The thesis (ch. 4 §3.3) fixes pose and shape and speaks of similar triangles; the released code has this descent and no
//! triangles (erratum E44). λ_z is per metre: with the regressor's own camera (f = 5000 px, some 45 m away) it all but fixes the
//! distance; at 4 m a centimetre costs one squared pixel.

use super::descent::Descent;
use super::view_term::{Placement, ViewTerm};
use crate::linalg::vector::{Vector3, ZERO};

/// One view's problem.
#[derive(Clone, Debug)]
pub(super) struct TorsoStage<'a> {
    /// The torso's marks with weight 1 and the plain square.
    pub term: &'a ViewTerm,
    /// q_k of the body that the regressor gave for this view.
    pub points: &'a [Vector3],
    /// Its J_0.
    pub pelvis: Vector3,
    /// λ_z, pixels of the crop per metre.
    pub depth_weight: f64,
    /// t_z,start, metres.
    pub depth_m: f64,
}

impl TorsoStage<'_> {
    /// E_i at x = (r, t) and its gradient; `by_points` is room for K points.
    pub(super) fn value_and_gradient(
        &self,
        x: &[f64],
        gradient: &mut [f64],
        by_points: &mut [Vector3],
    ) -> f64 {
        let at = placement(x);
        by_points.fill(ZERO);
        let (value, slope) = self.term.value_and_slope(&at, self.points, self.pelvis, by_points);
        gradient[..3].copy_from_slice(&slope.by_root);
        gradient[3..].copy_from_slice(&slope.by_translation);
        let off = at.translation[2] - self.depth_m;
        let strength = self.depth_weight * self.depth_weight;
        gradient[5] += 2.0 * strength * off;
        value + strength * off * off
    }

    /// Where the descent from `start` ends.
    pub(super) fn run(&self, start: &Placement, descent: &Descent) -> Placement {
        let mut x = [start.root, start.translation].concat();
        let mut by_points = vec![ZERO; self.points.len()];
        descent.run(&mut x, |x, gradient| {
            self.value_and_gradient(x, gradient, &mut by_points);
        });
        placement(&x)
    }
}

fn placement(x: &[f64]) -> Placement {
    Placement { root: [x[0], x[1], x[2]], translation: [x[3], x[4], x[5]] }
}

#[cfg(test)]
mod tests {
    use super::super::test_views::{figure_of, marked_views, start_near};
    use super::super::view_term::Loss;
    use super::*;
    use crate::fitting::KeypointSet;
    use crate::fitting::test_scene::body;

    #[test]
    fn gradient_is_its_central_difference() {
        let skeleton = body().skeleton();
        let figure = figure_of(&skeleton, None, KeypointSet::Smpl24);
        for seed in 0..4 {
            let (terms, shared) = marked_views(&figure, 1, seed);
            let mut pose = figure.room();
            figure.pose(&shared.body_pose, &shared.betas, &mut pose);
            let term = ViewTerm { loss: Loss::Square, ..terms[0].clone() };
            let stage = TorsoStage {
                term: &term,
                points: &pose.points,
                pelvis: pose.pelvis,
                depth_weight: 100.0,
                depth_m: 3.9,
            };
            let at = start_near(&shared.placements[0], seed);
            let x = [at.root, at.translation].concat();
            let (mut gradient, mut unused) = ([0.0; 6], [0.0; 6]);
            let mut room = vec![ZERO; 24];
            stage.value_and_gradient(&x, &mut gradient, &mut room);
            for c in 0..6 {
                let mut moved = |step: f64| {
                    let mut x = x.clone();
                    x[c] += step;
                    stage.value_and_gradient(&x, &mut unused, &mut room)
                };
                let numeric = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                // Values of 10⁵ px² keep 10⁻¹¹ of themselves; divided by the step that is 0.1, relative to slopes of 10⁶.
                assert!(
                    (gradient[c] - numeric).abs() < 1e-6 * (1e4 + numeric.abs()),
                    "{seed} {c}: {gradient:?} {numeric}"
                );
            }
        }
    }
}

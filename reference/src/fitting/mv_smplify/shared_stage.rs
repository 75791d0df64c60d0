//! Stage 2: one pose and one shape for all views.
//!
//! ```text
//!     E(θ̃, β, r_i, t_i) = Σ_i Σ_k c_ik² (ρ(e_ikx) + ρ(e_iky)) + E_prior(θ̃, β)
//! ```
//!
//! c is the detector's confidence, times the keypoint's base weight. θ̃ and β are shared; every view keeps its root orientation
//! r_i and, if translations are free, t_i. Nothing ties the r_i together: the views are not calibrated to each other.
//!
//! # Conventions
//! The thesis fixes the translations in this stage, the released code moves them (erratum E45).

use super::descent::Descent;
use super::noise::prior_factor;
use super::priors::Priors;
use super::unrooted::{Unrooted, UnrootedPose};
use super::view_term::{Placement, ViewTerm};
use crate::fitting::presets::Translations;
use crate::linalg::vector::{Vector3, ZERO, add};

/// The problem.
#[derive(Clone, Debug)]
pub(super) struct SharedStage<'a> {
    pub figure: &'a Unrooted<'a>,
    pub views: &'a [ViewTerm],
    pub priors: Priors<'a>,
    pub translations: Translations,
}

/// The unknowns of all views.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shared {
    /// θ̃.
    pub body_pose: Vec<f64>,
    pub betas: Vec<f64>,
    /// N.
    pub placements: Vec<Placement>,
}

impl Shared {
    /// Whether every unknown is a number.
    pub(super) fn is_finite(&self) -> bool {
        let placed = self.placements.iter().flat_map(|p| p.root.iter().chain(&p.translation));
        self.body_pose.iter().chain(&self.betas).chain(placed).all(|x| x.is_finite())
    }
}

/// Room for one evaluation.
#[derive(Clone, Debug)]
pub(super) struct Room {
    pose: UnrootedPose,
    by_points: Vec<Vector3>,
}

impl SharedStage<'_> {
    pub(super) fn room(&self) -> Room {
        let pose = self.figure.room();
        Room { by_points: vec![ZERO; pose.points.len()], pose }
    }

    /// x = (θ̃, β, r_0, …, r_{N−1}\[, t_0, …, t_{N−1}\]).
    pub(super) fn pack(&self, shared: &Shared) -> Vec<f64> {
        let mut x = [&shared.body_pose[..], &shared.betas[..]].concat();
        x.extend(shared.placements.iter().flat_map(|p| p.root));
        if self.translations == Translations::Free {
            x.extend(shared.placements.iter().flat_map(|p| p.translation));
        }
        x
    }

    /// The unknowns that x stands for; translations that are not in x stay.
    pub(super) fn unpack(&self, x: &[f64], into: &mut Shared) {
        let [pose, betas] = self.lengths();
        into.body_pose.copy_from_slice(&x[..pose]);
        into.betas.copy_from_slice(&x[pose..pose + betas]);
        let (n, first) = (into.placements.len(), pose + betas);
        let get = |at: usize| -> Vector3 { [x[at], x[at + 1], x[at + 2]] };
        for (i, placement) in into.placements.iter_mut().enumerate() {
            placement.root = get(first + 3 * i);
            if self.translations == Translations::Free {
                placement.translation = get(first + 3 * (n + i));
            }
        }
    }

    fn lengths(&self) -> [usize; 2] {
        [self.figure.pose_len(), self.figure.beta_count()]
    }

    /// E and its gradient by x, at the unknowns that x stands for.
    pub(super) fn value_and_gradient(&self, at: &Shared, gradient: &mut [f64], room: &mut Room) -> f64 {
        let [pose, betas] = self.lengths();
        let n = at.placements.len();
        gradient.fill(0.0);
        self.figure.pose(&at.body_pose, &at.betas, &mut room.pose);
        room.by_points.fill(ZERO);
        let (mut value, mut by_pelvis) = (0.0, ZERO);
        for (i, (view, placement)) in self.views.iter().zip(&at.placements).enumerate() {
            let (loss, slope) =
                view.value_and_slope(placement, &room.pose.points, room.pose.pelvis, &mut room.by_points);
            value += loss;
            by_pelvis = add(by_pelvis, slope.by_translation);
            let first = pose + betas + 3 * i;
            gradient[first..first + 3].copy_from_slice(&slope.by_root);
            if self.translations == Translations::Free {
                let first = pose + betas + 3 * (n + i);
                gradient[first..first + 3].copy_from_slice(&slope.by_translation);
            }
        }
        let (by_pose, rest) = gradient.split_at_mut(pose);
        let by_betas = &mut rest[..betas];
        self.figure.pull_back(&room.by_points, by_pelvis, &mut room.pose, by_pose, by_betas);
        value + self.priors.value_and_slope(&at.body_pose, &at.betas, by_pose, by_betas)
    }

    /// The weighted loss of every mark of every view.
    pub(super) fn losses(&self, at: &Shared) -> Vec<Vec<f64>> {
        let mut pose = self.figure.room();
        self.figure.pose(&at.body_pose, &at.betas, &mut pose);
        let views = self.views.iter().zip(&at.placements);
        views.map(|(view, placement)| view.losses(placement, &pose.points, pose.pelvis)).collect()
    }

    /// By how much the marks, as `at` leaves them, allow the priors to be weaker.
    pub(super) fn prior_factor(&self, at: &Shared) -> f64 {
        let loss = self.losses(at).iter().flatten().sum();
        let marks = self.views.iter().map(|view| view.marks.len()).sum();
        prior_factor(loss, marks, self.pack(at).len())
    }

    /// Where the descent from `shared` ends.
    pub(super) fn run(&self, mut shared: Shared, descent: &Descent) -> Shared {
        let mut room = self.room();
        let mut x = self.pack(&shared);
        descent.run(&mut x, |x, gradient| {
            self.unpack(x, &mut shared);
            self.value_and_gradient(&shared, gradient, &mut room);
        });
        self.unpack(&x, &mut shared);
        shared
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_views::{figure_of, marked_views};
    use super::*;
    use crate::body::{BodyModel, Hinge};
    use crate::fitting::KeypointSet;
    use crate::fitting::prior::GaussianMixture;
    use crate::fitting::test_scene::{body, body_of_smpl_size};
    use crate::linalg::matrix::apply;
    use crate::rotation::rodrigues;

    fn mixture() -> GaussianMixture {
        let n = 69;
        let mut covariance = vec![0.0; n * n];
        for i in 0..n {
            covariance[i * n + i] = 0.2 + 0.01 * i as f64;
            if i > 0 {
                covariance[i * n + i - 1] = 0.05;
                covariance[(i - 1) * n + i] = 0.05;
            }
        }
        GaussianMixture::new(vec![vec![0.1; n]], &[covariance], &[1.0]).expect("a mixture")
    }

    /// The largest difference between the gradient and central differences, relative to the largest slope.
    fn worst(stage: &SharedStage, at: &Shared) -> f64 {
        let x = stage.pack(at);
        let mut room = stage.room();
        let (mut gradient, mut unused) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        stage.value_and_gradient(at, &mut gradient, &mut room);
        let size = gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        let mut worst: f64 = 0.0;
        for c in 0..x.len() {
            let mut moved = |step: f64| {
                let (mut x, mut at) = (x.clone(), at.clone());
                x[c] += step;
                stage.unpack(&x, &mut at);
                stage.value_and_gradient(&at, &mut unused, &mut room)
            };
            let numeric = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            worst = worst.max((gradient[c] - numeric).abs() / size);
        }
        worst
    }

    fn check(
        body: &BodyModel,
        set: KeypointSet,
        views: usize,
        change: impl Fn(&mut Vec<ViewTerm>, &mut Shared),
    ) {
        let skeleton = body.skeleton();
        let hinges: Vec<Hinge> = skeleton.hinges().into_iter().flatten().collect();
        let mixture = mixture();
        let figure = figure_of(&skeleton, Some(body), set);
        for translations in [Translations::Fixed, Translations::Free] {
            let (mut terms, mut at) = marked_views(&figure, views, 5);
            change(&mut terms, &mut at);
            let stage = SharedStage {
                figure: &figure,
                views: &terms,
                priors: Priors {
                    hinges: &hinges,
                    bend_weight: 15.2,
                    shape_weight: 5.0,
                    start_weight: 25.0,
                    start: &[0.1; 69],
                    mixture: Some((4.78, &mixture)),
                },
                translations,
            };
            // Rounding 10⁻¹⁶·10⁶/10⁻⁵ relative to slopes of 10⁴ and more, and the third derivative's h².
            let error = worst(&stage, &at);
            assert!(error < 1e-7, "{set:?} {views} {translations:?}: {error:e}");
        }
    }

    #[test]
    fn gradient_is_its_central_difference_in_one_view_and_in_many() {
        for views in [1, 2, 4] {
            check(body(), KeypointSet::Smpl24, views, |_, _| {});
        }
    }

    #[test]
    fn gradient_holds_at_rest_and_towards_half_turns() {
        for size in [0.0, 1e-7, 3.1, std::f64::consts::PI, 5.0] {
            check(body(), KeypointSet::Smpl24, 2, |_, at| {
                for (n, joint) in at.body_pose.chunks_exact_mut(3).enumerate() {
                    joint.fill(0.0);
                    joint[n % 3] = size;
                }
                // Elbows and knees keep to where their priors are not e⁵.
                for joint in [4, 5, 18, 19] {
                    at.body_pose[3 * (joint - 1)..3 * joint].fill(1e-7);
                }
            });
        }
    }

    #[test]
    fn gradient_holds_with_hidden_marks() {
        check(body(), KeypointSet::Smpl24, 3, |terms, _| {
            terms[0].marks.retain(|m| m.keypoint % 3 == 0);
            terms[2].marks.clear();
        });
    }

    #[test]
    fn gradient_holds_for_marks_on_the_skin_and_between_joints() {
        let small = body_of_smpl_size();
        for set in [KeypointSet::Body25, KeypointSet::Coco18] {
            check(&small, set, 2, |_, _| {});
        }
    }

    #[test]
    fn exact_marks_are_met_by_the_truth_where_nothing_pulls() {
        let skeleton = body().skeleton();
        let figure = figure_of(&skeleton, None, KeypointSet::Smpl24);
        let (mut terms, at) = marked_views(&figure, 3, 2);
        let mut pose = figure.room();
        figure.pose(&at.body_pose, &at.betas, &mut pose);
        for (term, placement) in terms.iter_mut().zip(&at.placements) {
            let (turn, camera) = (rodrigues(placement.root), term.camera);
            for mark in &mut term.marks {
                let turned = apply(&turn, pose.points[mark.keypoint]);
                let point = add(turned, add(pose.pelvis, placement.translation));
                mark.pixel_px = camera.project(point).expect("in front");
            }
        }
        let priors = Priors {
            hinges: &[],
            bend_weight: 0.0,
            shape_weight: 0.0,
            start_weight: 25.0,
            start: &at.body_pose,
            mixture: None,
        };
        let stage = SharedStage { figure: &figure, views: &terms, priors, translations: Translations::Free };
        let mut gradient = stage.pack(&at);
        let value = stage.value_and_gradient(&at, &mut gradient, &mut stage.room());
        // Rounding of pixels, 10⁻¹³, times slopes of a thousand pixels per radian.
        assert!(value < 1e-20 && gradient.iter().all(|g| g.abs() < 1e-8), "{value} {gradient:?}");
    }

    #[test]
    fn a_point_behind_its_camera_pulls_nowhere() {
        let skeleton = body().skeleton();
        let figure = figure_of(&skeleton, None, KeypointSet::Smpl24);
        let (terms, mut at) = marked_views(&figure, 1, 1);
        at.placements[0].translation[2] = -4.0;
        let priors = Priors {
            hinges: &[],
            bend_weight: 0.0,
            shape_weight: 0.0,
            start_weight: 0.0,
            start: &[],
            mixture: None,
        };
        let stage = SharedStage { figure: &figure, views: &terms, priors, translations: Translations::Free };
        let mut gradient = stage.pack(&at);
        let value = stage.value_and_gradient(&at, &mut gradient, &mut stage.room());
        assert!(gradient.iter().all(|g| *g == 0.0), "{gradient:?}");
        let most: f64 = terms[0].marks.iter().map(|m| m.weight * 2.0 * 100.0 * 100.0).sum();
        assert!((value - most).abs() < 1e-9 * most, "{value} {most}");
    }
}

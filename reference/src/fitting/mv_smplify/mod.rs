//! MV-SMPLify: one body for all views, from what a regressor says of each.
pub mod descent;
pub mod noise;
pub mod options;
mod priors;
mod reseat;
pub mod result;
mod shared_stage;
pub mod start;
#[cfg(test)]
mod test_views;
mod torso_stage;
mod unrooted;
mod view_term;

pub use descent::Descent;
pub use options::{MeanPose, MvPreset, MvSmplifyOptions, StartingTranslation};
pub use result::{MvFit, VALID_BELOW};
pub use start::ViewStart;

use super::KeypointSet;
use super::keypoint_set::{BodyKeypoint, has_smpl_tree};
use super::observation::{Extrinsics, Observation, Refusal, View};
use crate::body::{BodyModel, Hinge, Skeleton};
use crate::camera::Pinhole;
use crate::linalg::matrix::IDENTITY;
use crate::linalg::vector::ZERO;
use priors::Priors;
use shared_stage::{Shared, SharedStage};
use torso_stage::TorsoStage;
use unrooted::Unrooted;
use view_term::{Loss, Mark, ViewTerm};

/// A person's crop is this much larger than the box around the marks.
const CROP_MARGIN: f64 = 1.2;

/// Fits one body model, or a bare skeleton, to views of a person.
#[derive(Clone, Debug)]
pub struct MvSmplify<'a> {
    body: Option<&'a BodyModel>,
    skeleton: Skeleton,
    hinges: Vec<Hinge>,
    set: KeypointSet,
    keypoints: Vec<Option<BodyKeypoint>>,
}

impl<'a> MvSmplify<'a> {
    /// Prepares `body` for marks of `set`.
    ///
    /// # Errors
    /// [`Refusal::ForeignTree`] if the first joints are not SMPL's.
    ///
    /// # Panics
    /// If the model is not consistent.
    pub fn new(body: &'a BodyModel, set: KeypointSet) -> Result<MvSmplify<'a>, Refusal> {
        let keypoints = set.on_body(body);
        let mut fitter = Self::prepared(body.skeleton(), set, keypoints)?;
        fitter.body = Some(body);
        Ok(fitter)
    }

    /// Prepares a body of which only the skeleton is there, for marks of `set`; keypoints on the skin then do not count.
    ///
    /// # Errors
    /// [`Refusal::ForeignTree`] if the first joints are not SMPL's.
    pub fn of_skeleton(skeleton: Skeleton, set: KeypointSet) -> Result<MvSmplify<'static>, Refusal> {
        let keypoints = set.on_skeleton(&skeleton);
        MvSmplify::prepared(skeleton, set, keypoints)
    }

    fn prepared(
        skeleton: Skeleton,
        set: KeypointSet,
        keypoints: Vec<Option<BodyKeypoint>>,
    ) -> Result<MvSmplify<'a>, Refusal> {
        if !has_smpl_tree(&skeleton.parents) {
            return Err(Refusal::ForeignTree { joints: skeleton.joint_count() });
        }
        let hinges = skeleton.hinges().into_iter().flatten().collect();
        Ok(MvSmplify { body: None, skeleton, hinges, set, keypoints })
    }

    /// The body's joints without its mesh.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// The body that the marks of all `views` show, from one start for each.
    ///
    /// Of the cameras focal length, principal point and lens are read; R and t are not.
    ///
    /// # Errors
    /// A [`Refusal`] for data that no fit can start from: no view, numbers that are not finite, a view with fewer than four
    /// usable marks, starts of the wrong sizes. What can be fitted but not be trusted is a fit that is not
    /// [valid](MvFit::valid).
    pub fn fit(
        &self,
        views: &[View],
        starts: &[ViewStart],
        options: &MvSmplifyOptions,
    ) -> Result<MvFit, Refusal> {
        let figure = Unrooted::new(&self.skeleton, self.body, &self.keypoints);
        let weights = self.weights(views)?;
        start::check(starts, views.len(), figure.pose_len(), figure.beta_count())?;
        if let Some(mixture) = &options.mixture
            && mixture.dimension() != figure.pose_len()
        {
            return Err(Refusal::PriorSize { found: mixture.dimension(), expected: figure.pose_len() });
        }
        let term = |((view, weights), start): ((&View, &Vec<f64>), &ViewStart)| {
            let side_px = start.side_px.unwrap_or_else(|| person_side_px(view));
            self.shared_term(view, weights, side_px, options)
        };
        let shared_terms: Vec<ViewTerm> = views.iter().zip(&weights).zip(starts).map(term).collect();
        let mut placements = Vec::with_capacity(views.len());
        let mut pose = figure.room();
        for ((view, start), (weights, shared)) in
            views.iter().zip(starts).zip(weights.iter().zip(&shared_terms))
        {
            let mut betas = start.betas.clone();
            betas.resize(figure.beta_count(), 0.0);
            figure.pose(&start.body_pose, &betas, &mut pose);
            let placed = start::placement(start, view, &pose.points, pose.pelvis, weights, options)
                .ok_or(Refusal::NoStart)?;
            let stage = TorsoStage {
                term: &self.torso_term(view, shared),
                points: &pose.points,
                pelvis: pose.pelvis,
                depth_weight: options.depth_weight,
                depth_m: placed.translation[2],
            };
            placements.push(stage.run(&placed, &options.torso));
        }
        let begin = Shared {
            body_pose: start::mean_pose(starts, options.mean_pose),
            betas: start::mean_betas(starts, figure.beta_count()),
            placements,
        };
        let stage = SharedStage {
            figure: &figure,
            views: &shared_terms,
            priors: Priors {
                hinges: &self.hinges,
                bend_weight: options.bend_weight,
                shape_weight: options.shape_weight,
                start_weight: options.start_weight,
                start: &begin.body_pose,
                mixture: options.mixture.as_ref().map(|mixture| (options.mixture_weight, mixture)),
            },
            translations: options.translations,
        };
        let fit = self.descend(&stage, begin.clone(), options);
        if fit.valid || !options.retry {
            return Ok(fit);
        }
        let Some(reseated) = reseat::reseated(&stage, &begin, options.sigma_px) else { return Ok(fit) };
        let again = self.descend(&stage, reseated, options);
        Ok(if again.mean_loss < fit.mean_loss { again } else { fit })
    }

    /// Base weight times confidence, N×K.
    fn weights(&self, views: &[View]) -> Result<Vec<Vec<f64>>, Refusal> {
        let observation =
            Observation { views: views.to_vec(), keypoint_set: self.set, extrinsics: Extrinsics::Unknown };
        observation.checked_weights(&self.keypoints)
    }

    fn shared_term(
        &self,
        view: &View,
        weights: &[f64],
        side_px: f64,
        options: &MvSmplifyOptions,
    ) -> ViewTerm {
        let marks = view
            .keypoints
            .iter()
            .zip(weights)
            .enumerate()
            .filter(|(_, (_, weight))| **weight > 0.0)
            .map(|(keypoint, (k, weight))| Mark { keypoint, pixel_px: k.pixel_px, weight: weight * weight })
            .collect();
        ViewTerm {
            camera: Pinhole { rotation: IDENTITY, translation: ZERO, ..view.camera },
            crop_scale: options.crop_side_px / side_px,
            marks,
            loss: Loss::GemanMcClure(options.sigma_px),
        }
    }

    /// The four marks of the torso, or all that count if one of the four was not seen.
    fn torso_term(&self, view: &View, shared: &ViewTerm) -> ViewTerm {
        let torso = self.set.torso();
        let seen = |k: usize| view.keypoints[k].confidence > 0.0 && self.keypoints[k].is_some();
        let mark =
            |keypoint: usize| Mark { keypoint, pixel_px: view.keypoints[keypoint].pixel_px, weight: 1.0 };
        let marks = if torso.iter().all(|&k| seen(k)) {
            torso.map(mark).to_vec()
        } else {
            shared.marks.iter().map(|m| mark(m.keypoint)).collect()
        };
        ViewTerm { marks, loss: Loss::Square, ..shared.clone() }
    }

    /// Stage 2 from `begin`.
    fn descend(&self, stage: &SharedStage, begin: Shared, options: &MvSmplifyOptions) -> MvFit {
        let mut shared = stage.run(begin, &options.shared);
        if let Some(settling) = &options.settling {
            let factor = stage.prior_factor(&shared);
            shared =
                SharedStage { priors: stage.priors.weakened(factor), ..stage.clone() }.run(shared, settling);
        }
        self.report(stage, shared)
    }

    fn report(&self, stage: &SharedStage, shared: Shared) -> MvFit {
        let mut pose = stage.figure.room();
        stage.figure.pose(&shared.body_pose, &shared.betas, &mut pose);
        let mut keypoint_losses = vec![0.0; self.keypoints.len()];
        let mut counted = vec![false; self.keypoints.len()];
        let mut view_losses = Vec::with_capacity(stage.views.len());
        for (view, placement) in stage.views.iter().zip(&shared.placements) {
            let losses = view.losses(placement, &pose.points, pose.pelvis);
            for (mark, loss) in view.marks.iter().zip(&losses) {
                keypoint_losses[mark.keypoint] += loss;
                counted[mark.keypoint] = true;
            }
            view_losses.push(losses.iter().sum::<f64>() / losses.len() as f64);
        }
        let count = counted.iter().filter(|c| **c).count();
        let mean_loss = keypoint_losses.iter().sum::<f64>() / count as f64;
        MvFit {
            roots: shared.placements.iter().map(|p| p.root).collect(),
            body_pose: shared.body_pose,
            betas: shared.betas,
            translations: shared.placements.iter().map(|p| p.translation).collect(),
            keypoint_losses,
            view_losses,
            mean_loss,
            valid: mean_loss < VALID_BELOW,
        }
    }
}

/// The side of the square crop around the marks of a view, pixels of the photograph: 1.2 times the longer side of their box.
fn person_side_px(view: &View) -> f64 {
    let side = |axis: usize| {
        let seen = || view.keypoints.iter().filter(|k| k.confidence > 0.0).map(|k| k.pixel_px[axis]);
        seen().fold(f64::NEG_INFINITY, f64::max) - seen().fold(f64::INFINITY, f64::min)
    };
    CROP_MARGIN * side(0).max(side(1))
}

//! The fit of chapter 4: starts, torso, shared body, and once more where a view faced the wrong way.

use super::options::MvSmplifyOptions;
use super::priors::Priors;
use super::result::MvFit;
use super::shared_stage::{Shared, SharedStage};
use super::start::{ViewStart, check, mean_betas, mean_pose, placement};
use super::torso_stage::TorsoStage;
use super::unrooted::Unrooted;
use super::view_term::{Placement, ViewTerm};
use super::{marks, reseat};
use crate::body::{BodyModel, Hinge, Skeleton};
use crate::fitting::KeypointSet;
use crate::fitting::keypoint_set::{BodyKeypoint, has_smpl_tree};
use crate::fitting::observation::{Refusal, View};

/// Fits one body model, or a bare skeleton, to views of a person.
///
/// ```
/// use vitruvian_reference::body::mannequin;
/// use vitruvian_reference::camera::Pinhole;
/// use vitruvian_reference::fitting::{Keypoint, KeypointSet, MvSmplify, MvSmplifyOptions, View, ViewStart};
/// use vitruvian_reference::linalg::matrix::mul;
/// use vitruvian_reference::rotation::{logarithm, rodrigues};
///
/// // A person with a raised arm, seen from four sides, 4 m away; the pose as each view's camera has it.
/// let body = mannequin();
/// let mut body_pose = vec![0.0; 69];
/// body_pose[3 * 15 + 2] = 0.9;
/// let upright = rodrigues([std::f64::consts::PI, 0.0, 0.0]);
/// let camera = Pinhole::ideal(900.0, [256.0, 256.0]);
/// let (mut views, mut starts) = (Vec::new(), Vec::new());
/// for k in 0..4 {
///     let root = logarithm(&mul(&upright, &rodrigues([0.0, 1.57 * f64::from(k), 0.0])));
///     let joints = body.pose(&[&root[..], &body_pose].concat(), &[0.5], [0.0, 0.0, 4.0]).joints;
///     let see = |&joint| Keypoint { pixel_px: camera.project(joint).unwrap(), confidence: 1.0 };
///     views.push(View { camera, keypoints: joints.iter().map(see).collect() });
///     // The regressor missed the arm, and half of the distance's decimals.
///     starts.push(ViewStart {
///         root,
///         translation: [0.02, 0.0, 4.1],
///         body_pose: vec![0.0; 69],
///         betas: vec![0.0; 10],
///         side_px: None,
///     });
/// }
/// let fitter = MvSmplify::new(&body, KeypointSet::Smpl24)?;
/// let fit = fitter.fit(&views, &starts, &MvSmplifyOptions::default())?;
/// assert!(fit.valid);
/// // The same body but for its size, which cameras of unknown distance do not tell.
/// let joints = |pose: &[f64], betas: &[f64]| body.pose(pose, betas, [0.0; 3]).joints;
/// let truth = joints(&[&starts[0].root[..], &body_pose].concat(), &[0.5]);
/// let error = vitruvian_reference::metric::joints::pa_mpjpe(&joints(&fit.pose(0), &fit.betas), &truth);
/// assert!(error < 0.01);
/// # Ok::<(), vitruvian_reference::fitting::Refusal>(())
/// ```
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
        MvSmplify::prepared(Some(body), body.skeleton(), set, set.on_body(body))
    }

    /// Prepares a body of which only the skeleton is there, for marks of `set`; keypoints on the skin then do not count.
    ///
    /// # Errors
    /// [`Refusal::ForeignTree`] if the first joints are not SMPL's.
    pub fn of_skeleton(skeleton: Skeleton, set: KeypointSet) -> Result<MvSmplify<'static>, Refusal> {
        let keypoints = set.on_skeleton(&skeleton);
        MvSmplify::prepared(None, skeleton, set, keypoints)
    }

    fn prepared(
        body: Option<&'a BodyModel>,
        skeleton: Skeleton,
        set: KeypointSet,
        keypoints: Vec<Option<BodyKeypoint>>,
    ) -> Result<MvSmplify<'a>, Refusal> {
        if !has_smpl_tree(&skeleton.parents) {
            return Err(Refusal::ForeignTree { joints: skeleton.joint_count() });
        }
        let hinges = skeleton.hinges().into_iter().flatten().collect();
        Ok(MvSmplify { body, skeleton, hinges, set, keypoints })
    }

    /// The body's joints without its mesh.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// The body that the marks of all `views` show, from one start for each; N ≥ 1.
    ///
    /// Of the cameras focal length, principal point and lens are read; R and t are not.
    ///
    /// # Errors
    /// A [`Refusal`] for data that no fit can start from: no view, numbers that are not finite, a view with fewer than four
    /// usable marks, starts of the wrong sizes; and [`Refusal::Overflow`] if what it ends with is not finite. What can be fitted but not be trusted is a fit that is not
    /// [valid](MvFit::valid).
    ///
    /// # Panics
    /// If a descent of the options has a learning rate that is not a positive number.
    pub fn fit(
        &self,
        views: &[View],
        starts: &[ViewStart],
        options: &MvSmplifyOptions,
    ) -> Result<MvFit, Refusal> {
        let figure = Unrooted::new(&self.skeleton, self.body, &self.keypoints);
        let weights = marks::weights(views, self.set, &self.keypoints)?;
        check(starts, views.len(), figure.pose_len(), figure.beta_count())?;
        if let Some(mixture) = &options.mixture
            && mixture.dimension() != figure.pose_len()
        {
            return Err(Refusal::PriorSize { found: mixture.dimension(), expected: figure.pose_len() });
        }
        let terms: Vec<ViewTerm> = views
            .iter()
            .zip(&weights)
            .zip(starts)
            .map(|((view, weights), start)| {
                let side_px = start.side_px.unwrap_or_else(|| marks::person_side_px(view));
                marks::shared_term(view, weights, options.crop_side_px / side_px, options.sigma_px)
            })
            .collect();
        let begin = Shared {
            body_pose: mean_pose(starts, options.mean_pose),
            betas: mean_betas(starts, figure.beta_count()),
            placements: self.placed_by_torso(&figure, views, starts, &terms, options)?,
        };
        if !begin.is_finite() {
            return Err(Refusal::Overflow);
        }
        let stage = SharedStage {
            figure: &figure,
            views: &terms,
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
        let descend = |begin: Shared| {
            let mut shared = stage.run(begin, &options.shared);
            if let Some(settling) = &options.settling {
                let priors = stage.priors.weakened(stage.prior_factor(&shared));
                shared = SharedStage { priors, ..stage.clone() }.run(shared, settling);
            }
            MvFit::of(&stage, shared)
        };
        let mut fit = descend(begin.clone());
        if options.reseat
            && let Some(reseated) = reseat::reseated(&stage, &begin, options.sigma_px)
        {
            let again = descend(reseated);
            if again.mean_loss < fit.mean_loss {
                fit = again;
            }
        }
        if fit.is_finite() { Ok(fit) } else { Err(Refusal::Overflow) }
    }

    /// Stage 1 of every view, with the body that its start says.
    fn placed_by_torso(
        &self,
        figure: &Unrooted,
        views: &[View],
        starts: &[ViewStart],
        terms: &[ViewTerm],
        options: &MvSmplifyOptions,
    ) -> Result<Vec<Placement>, Refusal> {
        let mut pose = figure.room();
        let mut placements = Vec::with_capacity(views.len());
        for (view, ((seen, start), term)) in views.iter().zip(starts).zip(terms).enumerate() {
            let mut betas = start.betas.clone();
            betas.resize(figure.beta_count(), 0.0);
            figure.pose(&start.body_pose, &betas, &mut pose);
            let how = options.starting_translation;
            let placed = placement(start, term, &pose.points, pose.pelvis, how).ok_or(Refusal::BadStart {
                view,
                fault: "puts the body behind the camera, and no translation puts it onto the marks",
            })?;
            let stage = TorsoStage {
                term: &marks::torso_term(seen, self.set.torso(), &self.keypoints, term),
                points: &pose.points,
                pelvis: pose.pelvis,
                depth_weight: options.depth_weight,
                depth_m: placed.translation[2],
            };
            placements.push(stage.run(&placed, &options.torso));
        }
        Ok(placements)
    }
}

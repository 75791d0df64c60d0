//! What a fit gives back, and how it ended.

use crate::camera::Pinhole;
use crate::least_squares::Termination;
use crate::linalg::vector::Vector3;
use std::fmt;

/// The unknowns of a fit with their values; also what a fit can be started from.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// θ: J axis–angle vectors, 3J numbers, radians.
    pub pose: Vec<f64>,
    /// β, B numbers, standard deviations.
    pub betas: Vec<f64>,
    /// The body's translation in the world, metres.
    pub trans: Vector3,
    /// The cameras of the N views in the same world; with known extrinsics those that were given.
    pub cameras: Vec<Pinhole>,
}

/// What a stage did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageReport {
    /// Its energy at the end: ‖r‖² with this stage's own weights, px².
    pub energy: f64,
    /// Accepted steps.
    pub iterations: usize,
    /// Evaluations of the residuals.
    pub evaluations: usize,
    /// How it ended.
    pub termination: Termination,
}

/// How far a view's keypoints are from the fitted body's, pixels; over keypoints of positive weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewResidual {
    /// Keypoints of positive weight.
    pub count: usize,
    /// The mean distance.
    pub mean_px: f64,
    /// The median distance, which a few wrong detections do not move.
    pub median_px: f64,
    /// A quarter of the distances are above.
    pub upper_quartile_px: f64,
    /// The root mean square distance.
    pub rms_px: f64,
    /// The largest distance.
    pub max_px: f64,
}

/// Whether the answer can be used.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The descent ended at a minimum whose body is plausible and lies on the keypoints.
    Success,
    /// The descent was cut off by its limits.
    NotConverged,
    /// The keypoints of these views lie far from the fitted body, for its size in the picture: other people, wrong cameras, or
    /// keypoints of something else.
    ViewsDisagree {
        /// The views, ascending.
        views: Vec<usize>,
    },
    /// The body on the keypoints is nobody's: a β beyond ±5 standard deviations.
    ImplausibleBody {
        /// Which beta.
        beta: usize,
        /// Its value.
        value: f64,
    },
    /// With the keypoints of left and right exchanged the person would stand far more like a person: the labels are those of
    /// a mirror image.
    SidesExchanged,
    /// The body on the keypoints is in nobody's pose: a joint bent backwards or turned too far.
    ImplausiblePose {
        /// Which joint.
        joint: usize,
        /// How far it is turned, radians; negative for a limb that is bent backwards.
        angle_rad: f64,
    },
}

impl Verdict {
    /// Whether it is [`Verdict::Success`].
    pub fn is_success(&self) -> bool {
        *self == Verdict::Success
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Verdict::Success => write!(f, "success"),
            Verdict::NotConverged => write!(f, "not converged: the limit of iterations cut the descent off"),
            Verdict::ViewsDisagree { views } => {
                let list: Vec<String> = views.iter().map(usize::to_string).collect();
                let (noun, verb) = if views.len() == 1 { ("view", "lies") } else { ("views", "lie") };
                write!(f, "{noun} {} {verb} far from the body that fits the rest", list.join(", "))
            }
            Verdict::SidesExchanged => write!(f, "left and right seem to be exchanged in the keypoints"),
            Verdict::ImplausiblePose { joint, angle_rad } => {
                write!(f, "implausible pose: joint {joint} is turned by {:.0}°", angle_rad.to_degrees())
            }
            Verdict::ImplausibleBody { beta, value } => {
                write!(f, "implausible body: beta {beta} is {value:.1} standard deviations")
            }
        }
    }
}

/// A fitted body.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The answer.
    pub parameters: Parameters,
    /// The posed joints in the world, J×3 metres.
    pub joints: Vec<Vector3>,
    /// One report for each stage, the polishing stage last.
    pub stages: Vec<StageReport>,
    /// The energy of the last stage.
    pub energy: f64,
    /// The distances in each view.
    pub views: Vec<ViewResidual>,
    /// The noise of the keypoints that the polishing stage found, pixels per coordinate at weight 1.
    pub noise_px: Option<f64>,
    /// Keypoints of the set that have no point on this body.
    pub left_out: Vec<usize>,
    /// Whether the answer can be used.
    pub verdict: Verdict,
}

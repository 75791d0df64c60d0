//! What the silhouette fit gives back, and what it refuses.

use super::unfold::Damping;
use crate::fitting::Parameters;
use crate::least_squares::Termination;
use crate::linalg::vector::Vector3;
use std::fmt;

/// Which part of the fit a report is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageKind {
    /// Pose, shape and translation to outlines and keypoints.
    Pose,
    /// β, or β and offsets: the k-th row of the schedule, from 0.
    Shape(usize),
}

/// What a stage did.
#[derive(Clone, Debug, PartialEq)]
pub struct SilhouetteStage {
    /// Which.
    pub kind: StageKind,
    /// ‖r‖² with the stage's own weights and correspondences at its start (of a pose stage: of its last round).
    pub energy_before: f64,
    /// The same at its end.
    pub energy: f64,
    /// Accepted steps.
    pub iterations: usize,
    /// Evaluations of the residuals.
    pub evaluations: usize,
    /// How the dogleg ended (in a pose stage: in its last round).
    pub termination: Termination,
    /// Pairs of an outline point and a point of the body.
    pub correspondences: usize,
    /// The overlap of rendered and given mask in every view, after the stage.
    pub iou: Vec<f64>,
    /// What had to be done to the offsets to keep the surface.
    pub damping: Damping,
    /// Whether the stage was undone because it lowered the mean overlap; only pose stages are.
    pub reverted: bool,
}

/// Something that the caller should know about the masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Warning {
    /// The body reaches the border of this view's image and may be cut off there; the border is not taken for its outline.
    MaskTouchesBorder {
        /// The view.
        view: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Warning::MaskTouchesBorder { view } = self;
        write!(f, "the mask of view {view} touches the image border: the body may be cut off there")
    }
}

/// A body fitted to silhouettes.
#[derive(Clone, Debug, PartialEq)]
pub struct SilhouetteFit {
    /// θ, β, trans and the cameras: as given, unless their extrinsics are unknown and the pose was refined.
    pub parameters: Parameters,
    /// D, V×3 metres in the zero pose; zeros if they were not unknowns.
    pub offsets: Vec<Vector3>,
    /// The posed vertices in the world, offsets included, V×3.
    pub vertices: Vec<Vector3>,
    /// The posed joints in the world, J×3.
    pub joints: Vec<Vector3>,
    /// The overlap of rendered and given mask in every view at the start.
    pub iou_before: Vec<f64>,
    /// The same at the end.
    pub iou: Vec<f64>,
    /// By how many pixels the masks were found to be larger all round than the body of θ and β: clothes, or a generous
    /// segmentation; 0 unless the pose was refined.
    pub mask_bias_px: f64,
    /// One report for each stage.
    pub stages: Vec<SilhouetteStage>,
    /// What the caller should know about the masks.
    pub warnings: Vec<Warning>,
}

impl SilhouetteFit {
    /// The mean overlap over the views, before and after.
    pub fn mean_iou(&self) -> [f64; 2] {
        [&self.iou_before, &self.iou].map(|iou| iou.iter().sum::<f64>() / iou.len() as f64)
    }

    /// Whether every stage ended at a minimum rather than at a limit, or at a number that is not finite.
    pub fn was_successful(&self) -> bool {
        self.stages.iter().all(|stage| stage.termination.was_successful())
    }
}

/// Why a silhouette fit did not start.
#[derive(Clone, Debug, PartialEq)]
pub enum SilhouetteRefusal {
    /// There is no view.
    NoViews,
    /// There are more or fewer masks than cameras.
    MaskCount {
        /// Cameras of the start.
        cameras: usize,
        /// Masks given.
        masks: usize,
    },
    /// A parameter or a camera of the start is not finite, β has more numbers than the model, θ not 3J, or the keypoints not
    /// one view for each camera.
    BadStart {
        /// What it is.
        what: &'static str,
    },
    /// No pixel of the mask shows a body.
    EmptyMask {
        /// The view.
        view: usize,
    },
    /// Every pixel of the mask shows a body: there is no outline.
    FullMask {
        /// The view.
        view: usize,
    },
    /// The mask shows something else than the start: a fit would pull the body onto it for nothing.
    MaskDisagrees {
        /// The view.
        view: usize,
        /// The overlap of the rendered start and the mask.
        iou: f64,
        /// How many of the start's joints project outside of the mask.
        joints_outside: usize,
        /// Of how many.
        joints: usize,
    },
}

impl fmt::Display for SilhouetteRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SilhouetteRefusal::NoViews => write!(f, "no view"),
            SilhouetteRefusal::MaskCount { cameras, masks } => {
                write!(f, "{masks} masks for {cameras} cameras")
            }
            SilhouetteRefusal::BadStart { what } => write!(f, "the start's {what}"),
            SilhouetteRefusal::EmptyMask { view } => write!(f, "the mask of view {view} is empty"),
            SilhouetteRefusal::FullMask { view } => {
                write!(f, "the mask of view {view} covers the whole image: it has no outline")
            }
            SilhouetteRefusal::MaskDisagrees { view, iou, joints_outside, joints } => write!(
                f,
                "the mask of view {view} disagrees with the pose: overlap {iou:.2}, {joints_outside} of {joints} joints \
                 outside of it"
            ),
        }
    }
}

impl std::error::Error for SilhouetteRefusal {}

//! What a fit to the joints gave, whichever method it was.

use serde_json::{Value, json};
use vitruvian_reference::fitting::{Fit, KeypointSet, Parameters, StageReport, Verdict, ViewResidual};

use super::mv_smplify::CollaborativeFit;
use super::observed::Observed;

/// A fit to the joints.
pub enum JointFit {
    /// Chapters 2 and 3.
    Energy(Fit),
    /// Chapter 4.
    Collaborative(CollaborativeFit),
}

impl JointFit {
    /// Pose, shape, and cameras.
    pub fn parameters(&self) -> &Parameters {
        match self {
            JointFit::Energy(fit) => &fit.parameters,
            JointFit::Collaborative(fit) => &fit.parameters,
        }
    }

    /// The distances in each view.
    pub fn views(&self) -> &[ViewResidual] {
        match self {
            JointFit::Energy(fit) => &fit.views,
            JointFit::Collaborative(fit) => &fit.views,
        }
    }

    /// The noise of the keypoints, pixels, where the method finds it.
    pub fn noise_px(&self) -> Option<f64> {
        match self {
            JointFit::Energy(fit) => fit.noise_px,
            JointFit::Collaborative(_) => None,
        }
    }

    /// Why the answer is not to be trusted, if it is not.
    pub fn distrust(&self, observed: &Observed) -> Option<String> {
        match self {
            JointFit::Energy(fit) => distrust(fit, observed),
            JointFit::Collaborative(fit) => fit.distrust(),
        }
    }

    /// The verdict in one word.
    pub fn verdict(&self) -> &'static str {
        match self {
            JointFit::Energy(fit) => word(&fit.verdict),
            JointFit::Collaborative(fit) if fit.distrust().is_none() => "success",
            JointFit::Collaborative(_) => "far-from-keypoints",
        }
    }

    /// For the report.
    pub fn json(&self, set: KeypointSet) -> Value {
        match self {
            JointFit::Energy(fit) => json!({
                "energy_px2": fit.energy,
                "noise_px": fit.noise_px,
                "left_out": fit.left_out.iter().map(|&k| set.name(k)).collect::<Vec<_>>(),
                "stages": fit.stages.iter().map(stage).collect::<Vec<_>>(),
            }),
            JointFit::Collaborative(fit) => fit.json(set),
        }
    }
}

fn distrust(fit: &Fit, observed: &Observed) -> Option<String> {
    match &fit.verdict {
        Verdict::Success => None,
        Verdict::ViewsDisagree { views } => {
            let names: Vec<&str> = views.iter().map(|&view| observed.name(view)).collect();
            let worst = views.iter().map(|&v| fit.views[v].max_px).fold(0.0, f64::max);
            Some(format!(
                "camera {}: no body of this shape lies on the keypoints of all views (errors up to {worst:.0} px): are they of the \
                 same person and moment, left and right as on the person, and the cameras right?",
                names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
            ))
        }
        verdict => Some(verdict.to_string()),
    }
}

fn stage(stage: &StageReport) -> Value {
    json!({
        "energy": stage.energy,
        "iterations": stage.iterations,
        "evaluations": stage.evaluations,
        "ending": stage.termination.to_string(),
    })
}

fn word(verdict: &Verdict) -> &'static str {
    match verdict {
        Verdict::Success => "success",
        Verdict::NotConverged => "not-converged",
        Verdict::ViewsDisagree { .. } => "views-disagree",
        Verdict::ImplausibleBody { .. } => "implausible-body",
        Verdict::ImplausiblePose { .. } => "implausible-pose",
        Verdict::SidesExchanged => "sides-exchanged",
    }
}

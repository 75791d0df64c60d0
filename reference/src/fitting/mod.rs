//! Chapter 2: a body from the 2-D joints of several views.
//!
//! N cameras see one person, and a detector has marked joints in every picture. Sought are pose θ, shape β and, unless the
//! rig is calibrated, the cameras' rotations R_i and translations t_i, such that the joints of the body, projected, lie on
//! the marks, while limbs bend as limbs do and the shape is one of a person's:
//!
//! ```text
//! E(θ, β, R, t) = Σ_i Σ_k ρ(w_k (Π_i(J_k(θ, β)) − J2d_k⁽ⁱ⁾)) + λ_θ² E_θ(θ) + λ_β² ‖β‖²        (eq. 2.1–2.6)
//! ```
//!
//! # Reading order
//! What is given and asked: [`keypoint_set`] (what a mark means on a body), [`observation`] (and what is refused),
//! [`presets`] (the weights of the thesis), [`result`] and the [`verdict`](mod@verdict) on it.
//!
//! The energy: [`figure`] (the body's points and how they move), [`layout`] (the vector of unknowns),
//! [`keypoint_residuals`] (E_J; [`robust_loss`](crate::robust_loss) is ρ), [`prior`] (E_θ and others), [`energy`] (all stacked).
//!
//! The way down: [`start`] with its geometry ([`camera_init`], [`triangulation`], [`relative_pose`], [`eight_point`], [`resection`],
//! [`inverse_kinematics`]); [`multiview_smplify`] runs them and the stages (`stages.rs`); [`polish`] ends them by empirical Bayes,
//! from [`depth_flip`]s too where exact marks are nearly met.
//!
//! # Other chapters
//! [`silhouette`]: shape from masks (chapter 3). [`mv_smplify`]: one body from what a regressor says of each view (chapter 4), with
//! [`camera_translation`] where a camera is to be found from joints alone.
//!
//! # References
//! Li 2021, ch. 2 and ch. 3 §3.2; Bogo, Kanazawa, Lassner, Gehler, Romero, Black 2016, "Keep it SMPL".

pub mod camera_init;
pub mod camera_translation;
pub mod coherence;
pub mod depth_flip;
pub mod eight_point;
pub mod energy;
pub mod figure;
pub mod inverse_kinematics;
pub mod keypoint_residuals;
pub mod keypoint_set;
pub mod layout;
pub mod multiview_smplify;
pub mod mv_smplify;
pub mod observation;
pub mod polish;
pub mod presets;
pub mod prior;
pub mod relative_pose;
pub mod resection;
pub mod result;
pub mod silhouette;
mod stages;
pub mod start;
pub mod triangulation;
pub mod verdict;

#[cfg(test)]
mod test_scene;
#[cfg(test)]
mod tests;

pub use keypoint_set::KeypointSet;
pub use multiview_smplify::MultiviewSmplify;
pub use mv_smplify::{MvFit, MvPreset, MvSmplify, MvSmplifyOptions, ViewStart};
pub use observation::{Extrinsics, Keypoint, Observation, Refusal, View};
pub use presets::{LossForm, Options, Polish, PosePrior, Preset, Stage, Start, Translations};
pub use result::{Fit, Parameters, StageReport, Verdict, ViewResidual};

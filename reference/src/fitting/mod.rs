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
//! [`keypoint_set`]: what a mark means on a body. [`observation`]: what is given, and what is refused. [`prior`]: E_θ and the
//! other priors; [`robust_loss`](crate::robust_loss) is ρ. [`presets`]: the weights of the thesis. [`result`]: what comes
//! back and the verdict on it.
//!
//! # References
//! Li 2021, ch. 2 and ch. 3 §3.2; Bogo, Kanazawa, Lassner, Gehler, Romero, Black 2016, "Keep it SMPL".

pub mod keypoint_set;
pub mod observation;
pub mod presets;
pub mod prior;
pub mod result;
pub mod silhouette;

pub use keypoint_set::KeypointSet;
pub use observation::{Extrinsics, Keypoint, Observation, Refusal, View};
pub use presets::{LossForm, Options, Polish, PosePrior, Preset, Stage, Start, Translations};
pub use result::{Fit, Parameters, StageReport, Verdict, ViewResidual};

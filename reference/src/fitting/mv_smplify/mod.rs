//! MV-SMPLify (chapter 4): one body for all views, from what a regressor says of each.
//!
//! A network has looked at N pictures of a person, one by one, and said for each a pose θ, a shape β and where the camera is. The
//! answers differ; the person does not. Sought are one body pose θ̃ and one β, and for each view a root orientation r_i and a
//! translation t_i, under which the body's joints lie on the marks of a detector. The cameras need no calibration to each other:
//! of K, R, t only each one's K is read.
//!
//! ```text
//!     X_ik = exp(r_i) q_k(θ̃, β) + J_0(β) + t_i                                 unrooted
//!     e_ik = s_i (Π_i(X_ik) − y_ik)                                            view_term, marks
//!
//!     start    θ̃ = mean_i θ̃_i,   β = mean_i β_i                                start
//!     stage 1  E_i(r_i, t_i) = Σ_torso ‖e_ik‖² + λ_z² (t_z − t_z,start)²        torso_stage
//!     stage 2  E(θ̃, β, r, t) = Σ_i Σ_k c_ik² (ρ(e_ikx) + ρ(e_iky)) + E_prior   shared_stage
//!              E_prior = λ_a² Σ exp(−2φ) + λ_β² ‖β‖² + …                        priors
//! ```
//!
//! Both stages are [descents](descent) by Adam. s_i scales the photograph's pixels to those of a 224-pixel crop of the person, so that
//! σ = 100 px, the weights and the threshold of [validity](MvFit::valid) mean the same at any resolution.
//!
//! # Reading order
//! [`start`] (what is given), [`options`] (weights and presets), [`fit`](MvSmplify::fit) in `collaborative_fit` (the stages in order);
//! `unrooted` (the body, and its derivatives by reverse accumulation along the tree), `marks` and `view_term` (a view's loss),
//! `torso_stage`, `shared_stage` with `priors`; [`noise`] (how strong priors may be), `reseat` (views in which the regressor
//! was wrong about where the person faces), [`result`].
//!
//! | Li 2021, ch. 4 §3.3 | here |
//! |---|---|
//! | "mean of θ̃_reg" (erratum E46) | [`MeanPose`] |
//! | "camera translations and orientation estimated by similar triangles" (erratum E44) | `torso_stage` |
//! | translations fixed in the second stage (erratum E45) | [`MvSmplifyOptions::translations`] |
//! | single-view fit of table 4.8 (erratum E51) | the same with N = 1 |
//!
//! # Which marks count
//! A mark's error weighs its confidence times the base weight of the [keypoint set](super::keypoint_set): 0 for the neck and hips
//! of detectors, which lie elsewhere than the body's. SMPL-24's joints are the skeleton's own, none of them is left out.
//!
//! # What the released code does otherwise
//! It moves the translations in stage 2 ([`MvPreset::Released`]), never zeroes the weights of the keypoints that it calls ignored, and
//! reports vertices, joints and losses of the regressor's separate bodies instead of the shared one. The last two are mistakes and
//! not repeated.
//!
//! # What the presets reach
//! People of 24 joints in four views 4 m away at 512 px, marks with 2 px of noise, starts 56 mm off after alignment (joints
//! by 0.16 rad, a root by 0.2 rad, depths by 4 %): [`MvPreset::Thesis`] comes to 14 mm, [`MvPreset::Released`] to 10 mm,
//! [`MvPreset::Refined`] to 6 mm. Depths that are off by 15 % cost the thesis' fixed translations 33 mm, and one root in seven half a turn off
//! 36 mm. In one view the three come to 43, 35 and 22 mm: without a mixture of poses only the pull towards the start says
//! anything about depth.
//!
//! # References
//! Li 2021, ch. 4 §3.3; Kolotouros, Pavlakos, Black, Daniilidis 2019, "Learning to Reconstruct 3D Human Pose and Shape via
//! Model-fitting in the Loop" (SPIN), whose fit of one view this extends; Bogo et al. 2016, "Keep it SMPL".

mod collaborative_fit;
pub mod descent;
mod marks;
pub mod noise;
pub mod options;
mod priors;
mod reseat;
pub mod result;
mod shared_stage;
pub mod start;
mod torso_stage;
mod unrooted;
mod view_term;

#[cfg(test)]
mod test_views;
#[cfg(test)]
mod tests;

pub use collaborative_fit::MvSmplify;
pub use descent::Descent;
pub use options::{MeanPose, MvPreset, MvSmplifyOptions, StartingTranslation};
pub use result::{MvFit, VALID_BELOW};
pub use start::ViewStart;

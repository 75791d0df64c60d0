//! How far an estimate is from the truth: joints, silhouettes and surfaces.
//!
//! | module | quantity | in Li 2021 |
//! |---|---|---|
//! | [`joints`] | joint error, MPJPE, PA-MPJPE of a pose | eq. 2.7, ch. 4 |
//! | [`joint_errors`] | the same over frames, per joint | tables 4.1–4.8 |
//! | [`joint_set`] | the orders of joints that evaluations use, and maps between them | ch. 4 |
//! | [`pck`] | PCK, its curve, AUC | tables 4.3, 4.8; figure 4.8 |
//! | [`procrustes`] | the similarity that brings one point set closest to another | ch. 4 ("reconstruction error") |
//! | [`silhouette`] | intersection over union of masks | ch. 3 |
//! | [`surface`] | P2S, Chamfer-L2, intersection over union of volumes | ch. 5 and 6 |
//!
//! Lengths are in metres throughout; what tables print in millimetres or centimetres is scaled where it is
//! printed.

pub mod joint_errors;
pub mod joint_set;
pub mod joints;
pub mod pck;
pub mod procrustes;
pub mod silhouette;
pub mod surface;

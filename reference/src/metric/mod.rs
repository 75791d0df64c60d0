//! How far an estimate is from the truth: joints, silhouettes and surfaces.
//!
//! | module | quantity | in Li 2021 |
//! |---|---|---|
//! | [`joints`] | joint error, MPJPE, PA-MPJPE, PCK, AUC | eq. 2.7, ch. 4 |
//! | [`procrustes`] | the similarity that brings one point set closest to another | ch. 4 ("reconstruction error") |
//! | [`silhouette`] | intersection over union of masks | ch. 3 |
//! | [`surface`] | P2S, Chamfer-L2, intersection over union of volumes | ch. 5 and 6 |
//!
//! Lengths are in metres throughout; what tables print in millimetres or centimetres is scaled where it is
//! printed.

pub mod joints;
pub mod procrustes;
pub mod silhouette;
pub mod surface;

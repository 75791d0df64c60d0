//! Every tolerance that is measured and not derived, in one table.
//!
//! Single operators have none: their bounds follow from rounding. A whole network multiplies the bounds of its layers
//! into something that promises nothing, so what correct runs were seen to do is recorded here instead, with a
//! stated factor above it. A figure that is exceeded is investigated node by node
//! ([`judge_nodes`](crate::suite::networks::judge_nodes) names the first node that cannot be rounding) before it is raised.

use crate::error::{Error, Result};
use crate::onnx::model::Model;

/// What a graph computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Images to features.
    MfPifuEncoder,
    /// Features and points to occupancy.
    MfPifuQuery,
    /// Voxels to features.
    VsrEncoder,
    /// Features and points to occupancy.
    VsrQuery,
}

impl Kind {
    /// What a graph declares by its property `vitruvian.kind`.
    ///
    /// # Errors
    /// When it declares nothing, or a kind that is not judged.
    pub fn of(model: &Model) -> Result<Self> {
        match model.property("vitruvian.kind") {
            Some("mf-pifu.encoder") => Ok(Self::MfPifuEncoder),
            Some("mf-pifu.query") => Ok(Self::MfPifuQuery),
            Some("vsr.encoder") => Ok(Self::VsrEncoder),
            Some("vsr.query") => Ok(Self::VsrQuery),
            found => Err(Error::Onnx {
                graph: model.name().to_owned(),
                item: "metadata \"vitruvian.kind\"".into(),
                message: format!(
                    "{found:?}; mf-pifu.encoder, mf-pifu.query, vsr.encoder or vsr.query was expected"
                ),
            }),
        }
    }
}

/// How wide a network is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// The committed networks.
    Small,
    /// The widths of the thesis.
    Thesis,
}

/// A measured tolerance, relative to the largest value of the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// The largest error seen: |ŷ − y| over the largest |y|.
    pub measured: f64,
    /// What is accepted.
    pub allowed: f64,
    /// Why this much.
    pub reason: &'static str,
}

/// How far a whole graph's outputs may be from the reference's forward pass.
///
/// Measured on ONNX Runtime 1.32's CPU kernels with optimisation off and on, on the inputs of `tests/networks.rs`.
pub fn whole_graph(kind: Kind, size: Size) -> Tolerance {
    let sixteen = |measured: f64, reason| Tolerance { measured, allowed: 16.0 * measured, reason };
    match (kind, size) {
        (Kind::MfPifuEncoder, Size::Small) => sixteen(
            1e-6,
            "17 normalised layers; retraining moves the condition of the normalisations, hence 16 times",
        ),
        (Kind::MfPifuEncoder, Size::Thesis) => sixteen(
            1e-6,
            "as the small one with sums sixteen times as long, whose roundings grow as their root",
        ),
        (Kind::MfPifuQuery, _) => sixteen(1e-6, "four layers; the sigmoid divides errors by at least four"),
        (Kind::VsrEncoder, _) => sixteen(1e-6, "nine convolutions, no statistics"),
        (Kind::VsrQuery, _) => sixteen(1e-6, "four layers; the sigmoid divides errors by at least four"),
    }
}

/// How far the occupancies of a widened network may be from those of the small one that it pads.
///
/// Both compute the same sums, one with zeros between the terms, which blocks them differently.
pub fn widened() -> Tolerance {
    Tolerance {
        measured: 1e-6,
        allowed: 16e-6,
        reason: "the same exact function twice in f32: at most the sum of both whole-graph errors",
    }
}

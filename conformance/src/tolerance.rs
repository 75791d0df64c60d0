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

/// What is allowed above what was seen.
///
/// Other processors sum in another order, other inputs round otherwise, and retraining moves the condition of the layers: each was
/// seen to change the error by less than 2. A wrong weight, axis, padding or ε errs by a thousand times more.
const MARGIN: f64 = 16.0;

fn seen(measured: f64, reason: &'static str) -> Tolerance {
    Tolerance { measured, allowed: MARGIN * measured, reason }
}

/// How far a whole graph's outputs may be from the reference's forward pass.
///
/// Measured on ONNX Runtime 1.32's CPU kernels, random weights, with optimisation off and on, on the inputs of
/// `tests/networks.rs`.
pub fn whole_graph(kind: Kind, size: Size) -> Tolerance {
    match (kind, size) {
        (Kind::MfPifuEncoder, Size::Small) => {
            seen(6.3e-7, "17 layers, each normalised, so errors do not grow")
        }
        (Kind::MfPifuEncoder, Size::Thesis) => {
            seen(6.3e-7, "sums are longer, but √n of them cancels in the mean")
        }
        (Kind::MfPifuQuery, Size::Small) => {
            seen(1.2e-6, "four layers; sampling rounds coordinates of 128 pixels")
        }
        (Kind::MfPifuQuery, Size::Thesis) => seen(1.8e-6, "as the small one, with up to 2049 products a sum"),
        (Kind::VsrEncoder, Size::Small) => {
            seen(5.0e-7, "nine convolutions of 27 to 864 products, no statistics")
        }
        (Kind::VsrEncoder, Size::Thesis) => {
            seen(5.0e-7, "nine convolutions of 27 to 3456 products, no statistics")
        }
        (Kind::VsrQuery, Size::Small) => {
            seen(4.1e-7, "four layers; the sigmoid divides errors by at least four")
        }
        (Kind::VsrQuery, Size::Thesis) => {
            seen(4.1e-7, "four layers; the sigmoid divides errors by at least four")
        }
    }
}

/// How far the occupancies of a widened network may be from those of the small one that it pads, absolutely.
///
/// Both compute the same function in f32, one with zeros between the terms of its sums, which blocks them differently.
pub fn widened() -> Tolerance {
    seen(4.8e-7, "each agrees with the same exact function, as recorded above; an occupancy is at most 1")
}

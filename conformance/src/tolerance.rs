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
    /// An image of a person to pose, betas and camera.
    Regressor,
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
            Some("regressor") => Ok(Self::Regressor),
            Some("vsr.encoder") => Ok(Self::VsrEncoder),
            Some("vsr.query") => Ok(Self::VsrQuery),
            found => Err(Error::Onnx {
                graph: model.name().to_owned(),
                item: "metadata \"vitruvian.kind\"".into(),
                message: format!(
                    "{found:?}; mf-pifu.encoder, mf-pifu.query, regressor, vsr.encoder or vsr.query was expected"
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

/// A measured tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// The largest error seen.
    pub measured: f64,
    /// What is accepted.
    pub allowed: f64,
    /// Why this much.
    pub reason: &'static str,
}

/// What is allowed above what was seen.
///
/// Other processors sum in another order and other inputs round otherwise; in units of the noise floor, which
/// follows the weights, no two sizes or fillings differed by more than 3.
const MARGIN: f64 = 4.0;

fn seen(measured: f64, reason: &'static str) -> Tolerance {
    Tolerance { measured, allowed: MARGIN * measured, reason }
}

/// How far a whole graph's outputs may be from the reference's forward pass, in units of each stage's
/// [noise floor](crate::suite::networks::Reference::noise_floor).
///
/// Measured on ONNX Runtime 1.32's CPU kernels, with optimisation off and on, random, trained and widened weights, on the
/// inputs of `tests/networks.rs`. The floor follows from the weights, so these figures survive a retraining.
pub fn whole_graph(kind: Kind, size: Size) -> Tolerance {
    match (kind, size) {
        (Kind::MfPifuEncoder, Size::Small) => {
            seen(5.5, "the floor has a rounding per product, f32 one per addition too")
        }
        (Kind::MfPifuEncoder, Size::Thesis) => seen(6.6, "as the small one; longer sums round more often"),
        (Kind::MfPifuQuery, Size::Small) => {
            seen(1.0, "coordinates dominate, and the floor has their rounding")
        }
        (Kind::MfPifuQuery, Size::Thesis) => {
            seen(1.0, "coordinates dominate, and the floor has their rounding")
        }
        (Kind::Regressor, Size::Small) => seen(
            7.3,
            "the floor has a rounding per product, f32 one per addition too; the stem's maxima show it most",
        ),
        (Kind::Regressor, Size::Thesis) => seen(6.4, "as the small one: the stem sums the same 147 products"),
        (Kind::VsrEncoder, Size::Small) => {
            seen(6.7, "the floor has a rounding per product, f32 one per addition too")
        }
        (Kind::VsrEncoder, Size::Thesis) => seen(7.7, "as the small one; longer sums round more often"),
        (Kind::VsrQuery, Size::Small) => seen(1.8, "as for the images; coarser volumes have gentler slopes"),
        (Kind::VsrQuery, Size::Thesis) => seen(1.8, "as for the images; coarser volumes have gentler slopes"),
    }
}

/// How far the occupancies of a widened network may be from those of the small one that it pads, in units of the small
/// one's noise floor.
///
/// Both compute the same function in f32, one with zeros between the terms of its sums, which blocks them differently.
pub fn widened() -> Tolerance {
    seen(1.8, "each agrees with the same exact function")
}

/// How far a vertex of a posed body of human size may be from the reference's, in metres.
///
/// The contract of `vitruvian pose` is 2·10⁻⁵ m. What rounding can do at most is derived vertex by vertex
/// ([`suite::body`](crate::suite::body)); where 207 correctives act on a vertex that bound is itself about 2·10⁻⁵ m, which no run comes near,
/// because the roundings of a sum hardly ever point the same way.
pub fn skinning() -> Tolerance {
    seen(
        4.5e-7,
        "a body of two metres seen from its pelvis has an f32 spacing of 1.2e-7 m; half of it is lost three or four times",
    )
}

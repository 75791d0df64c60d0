//! The noise that a fit leaves, and how strong priors may be beside it.
//!
//! A residual λ·β beside errors in pixels says that β has the deviation σ_px/λ, σ_px the noise of a mark. λ_β = 5 for a β of
//! deviation 1 therefore believes in marks of 5 px of the crop, which is what detectors and the difference between their joints and
//! the body's amount to. Where the marks turn out to be better, all priors are weakened together:
//!
//! ```text
//!     σ̂² = Σ loss / (2·marks − unknowns),        λ ← λ · min(1, σ̂ / 5 px).
//! ```
//!
//! With as many unknowns as coordinates, as in one view, the marks say nothing of their noise, and the priors stay.

/// The noise for which the printed weights are right, pixels of the crop.
pub const BELIEVED_NOISE_PX: f64 = 5.0;

/// σ̂, pixels of the crop, from the summed loss of `marks` marks under a fit with `unknowns` unknowns; `None` if these explain
/// any marks.
pub fn noise_px(loss: f64, marks: usize, unknowns: usize) -> Option<f64> {
    let left = (2 * marks).checked_sub(unknowns).filter(|left| *left > 0)?;
    Some((loss / left as f64).sqrt())
}

/// The factor on the weights of all priors: min(1, σ̂ / [`BELIEVED_NOISE_PX`]), and 1 where the noise is not known.
///
/// ```
/// use vitruvian_reference::fitting::mv_smplify::noise::prior_factor;
/// // 96 marks of four views, 1 px off in each coordinate; 69 + 10 + 6·4 unknowns have taken up half of it.
/// assert!((prior_factor(89.0, 96, 103) - 0.2).abs() < 1e-15);
/// assert_eq!(prior_factor(1.0, 24, 85), 1.0); // one view
/// ```
pub fn prior_factor(loss: f64, marks: usize, unknowns: usize) -> f64 {
    noise_px(loss, marks, unknowns).map_or(1.0, |noise| (noise / BELIEVED_NOISE_PX).min(1.0))
}

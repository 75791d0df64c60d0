//! What keeps the weak-perspective scale positive.

use super::Loss;

/// How steeply the penalty rises towards s = 0.
const STEEPNESS: f64 = 10.0;

/// L_c = (1/N) Σ exp(−10 s)² over the scales of N cameras (s, t_x, t_y),  ∂L/∂s = −(20/N) exp(−20 s).
///
/// A scale of 0 costs 1, one of ½ 5·10⁻⁵; a negative one would put the person behind the camera. It is not in the
/// thesis, but in the code that its numbers come from (erratum E41). Without cameras it is 0.
pub fn camera_loss(scales: &[f64]) -> Loss {
    let share = 1.0 / scales.len().max(1) as f64;
    let penalty = |s: f64| (-STEEPNESS * s).exp().powi(2) * share;
    Loss {
        value: scales.iter().map(|&s| penalty(s)).sum(),
        gradient: scales.iter().map(|&s| -2.0 * STEEPNESS * penalty(s)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::super::tests::{assert_slopes, check_loss};
    use super::*;
    use crate::nn::goldens::pattern;

    #[test]
    fn a_person_at_the_camera_costs_one() {
        assert_eq!(camera_loss(&[0.0]), Loss { value: 1.0, gradient: vec![-20.0] });
        assert!(camera_loss(&[0.9]).value < 1e-7, "the usual scale costs nothing");
    }

    #[test]
    fn agrees_with_pytorch_and_its_slope() {
        let scales: Vec<f64> = pattern(&[5], 1).data.iter().map(|s| s / 4.0).collect();
        check_loss(&camera_loss(&scales), &goldens::CAMERA_LOSS);
        assert_slopes(camera_loss, &scales);
    }
}

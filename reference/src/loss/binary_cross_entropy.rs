//! The cross-entropy of a predicted occupancy, from its logit.

use super::{Loss, mean};
use crate::nn::transcendental::{sigmoid_value, softplus_value};

/// L = −(1/P) Σ [o ln σ(z) + (1 − o) ln(1 − σ(z))] = (1/P) Σ [ln(1 + eᶻ) − z·o],  ∂L/∂z = (σ(z) − o)/P.
///
/// The second form needs no logarithm of a vanishing probability: with ln(1 + eᶻ) = max(z, 0) + ln(1 + e^{−|z|}) it is
/// finite for every finite logit.
///
/// # Panics
/// If the numbers of logits and labels differ or are zero.
///
/// # References
/// Li 2021, eq. 6.10.
pub fn binary_cross_entropy(logits: &[f64], labels: &[f64]) -> Loss {
    mean("binary_cross_entropy", logits, labels, |z, o| (softplus_value(z) - z * o, sigmoid_value(z) - o))
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_gradient_is_the_slope;
    use super::*;

    #[test]
    fn a_coin_toss_costs_one_bit() {
        assert!((binary_cross_entropy(&[0.0, 0.0], &[0.0, 1.0]).value - 2f64.ln()).abs() < 1e-15);
    }

    #[test]
    fn certainty_costs_nothing_when_right_and_its_logit_when_wrong() {
        assert_eq!(binary_cross_entropy(&[800.0, -800.0], &[1.0, 0.0]).value, 0.0);
        assert_eq!(binary_cross_entropy(&[800.0, -800.0], &[0.0, 1.0]).value, 800.0);
    }

    #[test]
    fn the_definition_and_the_stable_form_agree() {
        for (z, o) in [(-2.0, 0.0), (0.3, 1.0), (1.5, 0.25)] {
            let p = sigmoid_value(z);
            let definition = -(o * f64::ln(p) + (1.0 - o) * f64::ln(1.0 - p));
            assert!((binary_cross_entropy(&[z], &[o]).value - definition).abs() < 1e-14, "at {z}");
        }
    }

    #[test]
    fn the_gradient_is_the_slope() {
        assert_gradient_is_the_slope(binary_cross_entropy);
    }
}

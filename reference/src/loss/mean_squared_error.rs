//! The squared error of a predicted occupancy.

use super::{Loss, mean};
use crate::nn::transcendental::sigmoid_value;

/// L = (1/P) Σ (σ(z) − o)²,  ∂L/∂z = (2/P)(σ(z) − o)·σ(z)(1 − σ(z)).
///
/// The thesis prints a norm and a sum over points and views (erratum E27); the views are joined inside the network
/// (erratum E20), and the mean only scales the sum.
///
/// # Panics
/// If the numbers of logits and labels differ or are zero.
///
/// # References
/// Li 2021, eq. 5.4 and 6.6.
pub fn mean_squared_error(logits: &[f64], labels: &[f64]) -> Loss {
    mean("mean_squared_error", logits, labels, |z, o| {
        let p = sigmoid_value(z);
        ((p - o).powi(2), 2.0 * (p - o) * p * (1.0 - p))
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_gradient_is_the_slope;
    use super::*;

    #[test]
    fn a_coin_toss_costs_a_quarter_and_the_truth_nothing() {
        assert_eq!(mean_squared_error(&[0.0, 0.0], &[0.0, 1.0]).value, 0.25);
        assert_eq!(
            mean_squared_error(&[800.0, -800.0], &[1.0, 0.0]),
            Loss { value: 0.0, gradient: vec![0.0, 0.0] }
        );
    }

    #[test]
    fn the_gradient_is_the_slope() {
        assert_gradient_is_the_slope(mean_squared_error);
    }
}

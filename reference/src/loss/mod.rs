//! Losses: what training minimises, as a value and its gradient.
//!
//! | function | thesis | network |
//! |---|---|---|
//! | [`keypoint_loss`] | eq. 4.1 | regressor |
//! | [`pose_loss`], [`betas_loss`] | eq. 4.3 | regressor |
//! | [`vertex_loss`] | eq. 4.4 | regressor |
//! | [`joint_loss`] | eq. 4.5 | regressor |
//! | [`camera_loss`] | – | regressor |
//! | [`regressor_loss`] | eq. 4.6 | regressor |
//! | [`sum_of_norms`] | eq. 4.1, 4.3, 4.5 as printed | – |
//! | [`mean_squared_error`] | eq. 5.4, 6.6 | MF-PIFu |
//! | [`binary_cross_entropy`] | eq. 6.10 | VSR |
//!
//! The losses of the regressor compare what it predicts with keypoints, joints and the fitted body. Those of chapters 5 and 6
//! take logits z and labels o (1 inside, 0 outside; erratum E17). Each is a mean, but for [`sum_of_norms`].

mod binary_cross_entropy;
mod body;
mod camera;
mod joints;
mod keypoints;
mod mean_squared_error;
mod norms;
mod regressor;

#[cfg(test)]
mod goldens;

pub use binary_cross_entropy::binary_cross_entropy;
pub use body::{betas_loss, pose_loss, vertex_loss};
pub use camera::camera_loss;
pub use joints::joint_loss;
pub use keypoints::keypoint_loss;
pub use mean_squared_error::mean_squared_error;
pub use norms::sum_of_norms;
pub use regressor::{REGRESSOR_WEIGHTS, RegressorTerms, regressor_loss};

/// The value of a loss and its gradient.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loss {
    /// L.
    pub value: f64,
    /// ∂L/∂z of every number that was predicted, in the order in which they were given.
    pub gradient: Vec<f64>,
}

fn assert_pairs(name: &str, predicted: usize, truth: usize) {
    assert!(predicted == truth, "{name}: {predicted} predicted and {truth} true must be the same number");
}

/// (1/DP) Σ w ‖e‖² of P weighted differences in D coordinates, and (2w/DP) e.
fn mean_squares<const D: usize>(differences: &[(f64, [f64; D])]) -> Loss {
    let share = 1.0 / (D * differences.len()).max(1) as f64;
    let squares = differences.iter().map(|(w, e)| w * e.iter().map(|x| x * x).sum::<f64>());
    Loss {
        value: squares.sum::<f64>() * share,
        gradient: differences.iter().flat_map(|(w, e)| e.map(|x| 2.0 * w * x * share)).collect(),
    }
}

/// The mean of a per-point loss given as (value, derivative).
fn mean(name: &str, logits: &[f64], labels: &[f64], point: impl Fn(f64, f64) -> (f64, f64)) -> Loss {
    assert!(
        logits.len() == labels.len() && !logits.is_empty(),
        "{name}: {} logits and {} labels must be the same number of points, at least one",
        logits.len(),
        labels.len()
    );
    let points = logits.len() as f64;
    let (values, gradient): (Vec<f64>, Vec<f64>) = logits
        .iter()
        .zip(labels)
        .map(|(&z, &o)| {
            let (value, derivative) = point(z, o);
            (value / points, derivative / points)
        })
        .unzip();
    Loss { value: values.iter().sum(), gradient }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::Tensor;
    use crate::nn::goldens::{Golden, check, pattern};

    /// What was predicted and what is true, by the seeds of the golden losses.
    pub(super) fn golden_inputs(shape: &[usize]) -> [Vec<f64>; 2] {
        [1, 2].map(|seed| pattern(shape, seed).data)
    }

    /// A golden loss: its value and its gradient.
    pub(super) fn check_loss(loss: &Loss, [value, gradient]: &[Golden; 2]) {
        check(&Tensor::new(&[], vec![loss.value]), value);
        check(&Tensor::new(gradient.shape, loss.gradient.clone()), gradient);
    }

    /// The gradient of a loss is its central difference in every coordinate.
    pub(super) fn assert_slopes(loss: impl Fn(&[f64]) -> Loss, at: &[f64]) {
        const STEP: f64 = 1e-6;
        let gradient = loss(at).gradient;
        assert_eq!(gradient.len(), at.len(), "one slope for every number");
        for k in 0..at.len() {
            let moved = |step: f64| {
                let mut x = at.to_vec();
                x[k] += step;
                loss(&x).value
            };
            let slope = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
            // Rounding of the value over the step, and the third derivative times its square.
            let tolerance = 1e-9 * (1.0 + loss(at).value);
            assert!(
                (slope - gradient[k]).abs() < tolerance,
                "number {k}: slope {slope}, gradient {}",
                gradient[k]
            );
        }
    }

    /// Central differences of a loss at (z, o).
    pub(super) fn assert_gradient_is_the_slope(loss: impl Fn(&[f64], &[f64]) -> Loss) {
        let (z, o) = ([-30.0, -2.0, -0.1, 0.0, 0.7, 3.0, 25.0], [0.0, 1.0, 0.0, 1.0, 0.3, 1.0, 0.0]);
        let gradient = loss(&z, &o).gradient;
        for k in 0..z.len() {
            let moved = |step: f64| {
                let mut z = z;
                z[k] += step;
                loss(&z, &o).value
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((slope - gradient[k]).abs() < 1e-9, "point {k}: slope {slope}, gradient {}", gradient[k]);
        }
    }

    #[test]
    #[should_panic(expected = "2 logits and 1 labels")]
    fn every_logit_needs_a_label() {
        mean_squared_error(&[0.0, 1.0], &[1.0]);
    }
}

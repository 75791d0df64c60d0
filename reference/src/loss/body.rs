//! The distances between the regressed body and the fitted one: pose, betas, vertices.
//!
//! All average over what they are given. Only bodies whose fit is valid are compared; with none the loss is 0 and has no
//! gradient.

use super::{Loss, assert_pairs, mean_squares};
use crate::linalg::matrix::Matrix3;
use crate::linalg::vector::{Vector3, sub};

/// L_θ = (1/9K) Σ ‖R̂ − R‖² (Frobenius) over K rotations,  ∂L/∂R̂ = (2/9K)(R̂ − R), row by row.
///
/// # Conventions
/// The thesis prints ‖Θ̂ − Θ‖ of axis–angle vectors, for which the two names v and v − 2πv/‖v‖ of one rotation are a whole turn
/// apart; of matrices ‖R̂ − R‖ = 2√2 sin(α/2) for an angle of α between them (erratum E43).
///
/// # Panics
/// If the numbers of rotations differ.
///
/// # References
/// Li 2021, eq. 4.3.
pub fn pose_loss(predicted: &[Matrix3], fitted: &[Matrix3]) -> Loss {
    assert_pairs("pose_loss", predicted.len(), fitted.len());
    betas_loss(predicted.as_flattened().as_flattened(), fitted.as_flattened().as_flattened())
}

/// L_β = (1/K) Σ (β̂ − β)² over the K betas of all bodies,  ∂L/∂β̂ = (2/K)(β̂ − β).
///
/// # Conventions
/// The thesis prints the norm (erratum E42), and gives its weight 0.001 to the mesh (erratum E41).
///
/// # Panics
/// If the numbers of betas differ.
///
/// # References
/// Li 2021, eq. 4.3.
pub fn betas_loss(predicted: &[f64], fitted: &[f64]) -> Loss {
    assert_pairs("betas_loss", predicted.len(), fitted.len());
    let differences: Vec<(f64, [f64; 1])> =
        predicted.iter().zip(fitted).map(|(p, f)| (1.0, [p - f])).collect();
    mean_squares(&differences)
}

/// L_M = (1/3V) Σ |v̂ − v| over the coordinates of V vertices (m),  ∂L/∂v̂ = sign(v̂ − v)/3V, 0 where they are equal.
///
/// # Panics
/// If the numbers of vertices differ.
///
/// # References
/// Li 2021, eq. 4.4, with the mean of absolute differences for the printed norm (erratum E42).
pub fn vertex_loss(predicted: &[Vector3], fitted: &[Vector3]) -> Loss {
    assert_pairs("vertex_loss", predicted.len(), fitted.len());
    let share = 1.0 / (3 * predicted.len()).max(1) as f64;
    let differences = predicted.iter().zip(fitted).flat_map(|(p, f)| sub(*p, *f));
    let (values, gradient): (Vec<f64>, Vec<f64>) =
        differences.map(|d| (d.abs() * share, if d == 0.0 { 0.0 } else { d.signum() * share })).unzip();
    Loss { value: values.iter().sum(), gradient }
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::super::tests::{assert_slopes, check_loss, golden_inputs};
    use super::*;
    use crate::linalg::vector::{distance, norm, scale};
    use crate::rotation::rodrigues;
    use std::f64::consts::PI;

    #[test]
    fn two_names_of_one_rotation_cost_nothing_as_matrices() {
        let v = [0.0, 3.0, 0.0];
        let same = scale(v, 1.0 - 2.0 * PI / norm(v));
        assert!(distance(v, same) > 6.0, "as vectors they are a whole turn apart");
        assert!(pose_loss(&[rodrigues(v)], &[rodrigues(same)]).value < 1e-30);
    }

    #[test]
    fn the_pose_loss_is_the_sine_of_half_the_angle() {
        for angle in [1e-3, 0.5, 2.0, PI] {
            let loss = pose_loss(&[rodrigues([angle, 0.0, 0.0])], &[rodrigues([0.0; 3])]);
            assert!((loss.value - 8.0 * (0.5 * angle).sin().powi(2) / 9.0).abs() < 1e-15, "{angle}");
        }
    }

    #[test]
    fn without_a_valid_fit_nothing_is_learned() {
        for loss in [pose_loss(&[], &[]), betas_loss(&[], &[]), vertex_loss(&[], &[])] {
            assert_eq!(loss, Loss { value: 0.0, gradient: vec![] });
        }
    }

    #[test]
    fn agree_with_pytorch_and_their_slopes() {
        fn matrices(flat: &[f64]) -> &[Matrix3] {
            flat.as_chunks().0.as_chunks().0
        }
        let [p, f] = golden_inputs(&[2, 24, 3, 3]);
        let loss = |p: &[f64]| pose_loss(matrices(p), matrices(&f));
        check_loss(&loss(&p), &goldens::POSE_LOSS);
        assert_slopes(loss, &p);

        let [p, f] = golden_inputs(&[2, 10]);
        let loss = |p: &[f64]| betas_loss(p, &f);
        check_loss(&loss(&p), &goldens::BETAS_LOSS);
        assert_slopes(loss, &p);

        let [p, f] = golden_inputs(&[2, 7, 3]);
        let loss = |p: &[f64]| vertex_loss(p.as_chunks().0, f.as_chunks().0);
        check_loss(&loss(&p), &goldens::VERTEX_LOSS);
        assert_slopes(loss, &p);
    }

    #[test]
    #[should_panic(expected = "pose_loss: 1 predicted and 0 true")]
    fn every_rotation_needs_a_fit() {
        pose_loss(&[rodrigues([0.0; 3])], &[]);
    }
}

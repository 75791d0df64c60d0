//! The reprojection error of regressed joints.

use super::{Loss, assert_pairs, mean_squares};

/// L_2D = (1/2P) Σ_p c_p ‖k̂_p − k_p‖²,  ∂L/∂k̂_p = (c_p/P)(k̂_p − k_p).
///
/// `predicted` k̂ and `keypoints` k are P points in any unit, as training has them in −1…1 over the crop; `confidence`
/// c ≥ 0 weights each. Without points it is 0.
///
/// # Conventions
/// The thesis prints the sum of norms over the views ([`sum_of_norms`](super::sum_of_norms)); trained is the mean of squares
/// (erratum E42), over the points of all images and both coordinates.
///
/// # Panics
/// If the numbers of points differ.
///
/// # References
/// Li 2021, eq. 4.1.
pub fn keypoint_loss(predicted: &[[f64; 2]], keypoints: &[[f64; 2]], confidence: &[f64]) -> Loss {
    assert_pairs("keypoint_loss", predicted.len(), keypoints.len());
    assert_pairs("keypoint_loss (confidence)", predicted.len(), confidence.len());
    let differences: Vec<(f64, [f64; 2])> = predicted
        .iter()
        .zip(keypoints)
        .zip(confidence)
        .map(|((p, k), &c)| (c, [p[0] - k[0], p[1] - k[1]]))
        .collect();
    mean_squares(&differences)
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::super::tests::{assert_slopes, check_loss, golden_inputs};
    use super::*;

    #[test]
    fn one_point_a_pixel_off_by_hand() {
        let loss = keypoint_loss(&[[3.0, 4.0], [0.0, 0.0]], &[[0.0, 0.0], [9.0, 9.0]], &[0.5, 0.0]);
        assert_eq!(loss, Loss { value: 0.5 * 25.0 / 4.0, gradient: vec![0.75, 1.0, 0.0, 0.0] });
        assert_eq!(keypoint_loss(&[], &[], &[]), Loss { value: 0.0, gradient: vec![] });
    }

    #[test]
    fn agrees_with_pytorch_and_its_slope() {
        let [p, k] = golden_inputs(&[2, 24, 2]);
        let confidence: Vec<f64> =
            crate::nn::goldens::pattern(&[48], 3).data.iter().map(|c| c.abs()).collect();
        let loss = |p: &[f64]| keypoint_loss(p.as_chunks().0, k.as_chunks().0, &confidence);
        check_loss(&loss(&p), &goldens::KEYPOINT_LOSS);
        assert_slopes(loss, &p);
    }

    #[test]
    #[should_panic(expected = "keypoint_loss: 1 predicted and 2 true")]
    fn every_point_needs_a_truth() {
        keypoint_loss(&[[0.0; 2]], &[[0.0; 2]; 2], &[1.0]);
    }
}

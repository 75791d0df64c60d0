//! The sum of unsquared norms: eq. 4.1 and 4.3–4.5 as they are printed.

use super::{Loss, assert_pairs};

/// L = Σ ‖p̂ − p‖,  ∂L/∂p̂ = (p̂ − p)/‖p̂ − p‖, and 0 where they coincide.
///
/// This is what Li 2021 prints for keypoints (D = 2), joints and axis–angle vectors (D = 3); what was trained are means of
/// squares (erratum E42). The difference is in the gradient: here it has length 1 for every point however near it is, so that a
/// step that would land on the truth overshoots it, and the sum grows with the number of points and views, so that
/// the weights of eq. 4.6 mean something else for every data set.
///
/// # Panics
/// If the numbers of points differ.
///
/// # References
/// Li 2021, eq. 4.1, 4.3, 4.5, taken literally.
pub fn sum_of_norms<const D: usize>(predicted: &[[f64; D]], truth: &[[f64; D]]) -> Loss {
    assert_pairs("sum_of_norms", predicted.len(), truth.len());
    let mut loss = Loss { value: 0.0, gradient: Vec::with_capacity(D * predicted.len()) };
    for (p, t) in predicted.iter().zip(truth) {
        let difference: [f64; D] = std::array::from_fn(|axis| p[axis] - t[axis]);
        let norm = difference.iter().map(|d| d * d).sum::<f64>().sqrt();
        loss.value += norm;
        loss.gradient.extend(difference.map(|d| if norm > 0.0 { d / norm } else { 0.0 }));
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::super::keypoint_loss;
    use super::super::tests::{assert_slopes, check_loss, golden_inputs};
    use super::*;

    #[test]
    fn a_near_point_pulls_as_hard_as_a_far_one() {
        let pull = |x: f64| sum_of_norms(&[[x, 0.0]], &[[0.0; 2]]).gradient[0];
        assert_eq!((pull(1e-9), pull(5.0), pull(0.0)), (1.0, 1.0, 0.0));
        let squared = |x: f64| keypoint_loss(&[[x, 0.0]], &[[0.0; 2]], &[1.0]).gradient[0];
        assert_eq!((squared(1e-9), squared(5.0)), (1e-9, 5.0), "the mean of squares pulls less and less");
    }

    #[test]
    fn agrees_with_pytorch_and_its_slope() {
        let [p, t] = golden_inputs(&[2, 24, 2]);
        let loss = |p: &[f64]| sum_of_norms::<2>(p.as_chunks().0, t.as_chunks().0);
        check_loss(&loss(&p), &goldens::SUM_OF_NORMS);
        assert_slopes(loss, &p);
    }
}

//! The error of regressed joints in space, relative to the hips.

use super::{Loss, assert_pairs, mean_squares};
use crate::linalg::vector::{Vector3, add, scale, sub};

/// Joints of SMPL's 24.
const JOINTS: usize = 24;

/// The hips among SMPL's 24 joints, left and right.
const HIPS: [usize; 2] = [1, 2];

/// L_3D = (1/72N) Σ c ‖(x̂ − ĥ) − (x − h)‖² over N bodies' 24 joints (m), ĥ and h midway between each body's hips.
///
/// With e_j = (x̂_j − ĥ) − (x_j − h): ∂L/∂x̂_j = (c_j/36N) e_j, and each hip carries in addition minus half of the sum of
/// these over its body, because it moves ĥ. So the gradient of a body sums to zero: where it stands does not matter.
/// Without bodies it is 0.
///
/// # Conventions
/// Eq. 4.5 as printed compares the true joints with those of the *fit*, which no weight of the network moves; compared are
/// the regressed ones, by squares (erratum E42).
///
/// # Panics
/// If the numbers of bodies differ.
///
/// # References
/// Li 2021, eq. 4.5.
pub fn joint_loss(
    predicted: &[[Vector3; JOINTS]],
    joints: &[[Vector3; JOINTS]],
    confidence: &[[f64; JOINTS]],
) -> Loss {
    assert_pairs("joint_loss", predicted.len(), joints.len());
    assert_pairs("joint_loss (confidence)", predicted.len(), confidence.len());
    let differences: Vec<(f64, Vector3)> = predicted
        .iter()
        .zip(joints)
        .zip(confidence)
        .flat_map(|((predicted, joints), confidence)| {
            let (here, there) = (mid_hip(predicted), mid_hip(joints));
            let centred = |j: usize| sub(sub(predicted[j], here), sub(joints[j], there));
            std::array::from_fn::<_, JOINTS, _>(|j| (confidence[j], centred(j)))
        })
        .collect();
    let mut loss = mean_squares(&differences);
    for body in loss.gradient.chunks_exact_mut(3 * JOINTS) {
        for axis in 0..3 {
            let sum: f64 = (0..JOINTS).map(|j| body[3 * j + axis]).sum();
            for hip in HIPS {
                body[3 * hip + axis] -= 0.5 * sum;
            }
        }
    }
    loss
}

/// The point midway between the hips.
fn mid_hip(joints: &[Vector3; JOINTS]) -> Vector3 {
    scale(add(joints[HIPS[0]], joints[HIPS[1]]), 0.5)
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::super::tests::{assert_slopes, check_loss, golden_inputs};
    use super::*;

    fn bodies(flat: &[f64]) -> Vec<[Vector3; JOINTS]> {
        let points: &[Vector3] = flat.as_chunks().0;
        points.as_chunks().0.to_vec()
    }

    #[test]
    fn moving_a_whole_body_costs_nothing() {
        let [p, x] = golden_inputs(&[2, 24, 3]);
        let (p, x, c) = (bodies(&p), bodies(&x), [[1.0; JOINTS]; 2]);
        let moved = [p[0], p[1].map(|joint| add(joint, [5.0, -2.0, 1.0]))];
        let (here, there) = (joint_loss(&p, &x, &c), joint_loss(&moved, &x, &c));
        assert!((here.value - there.value).abs() < 1e-14, "{} and {}", here.value, there.value);
        for axis in 0..3 {
            let sum: f64 = here.gradient[..72].iter().skip(axis).step_by(3).sum();
            assert!(sum.abs() < 1e-16, "the gradient pushes the body by {sum}");
        }
    }

    #[test]
    fn one_hand_a_metre_off_by_hand() {
        let mut p = [[0.0; 3]; JOINTS];
        p[22] = [0.0, 0.0, 1.0];
        let loss = joint_loss(&[p], &[[[0.0; 3]; JOINTS]], &[[1.0; JOINTS]]);
        assert_eq!(loss.value, 1.0 / 72.0);
        assert_eq!((loss.gradient[3 * 22 + 2], loss.gradient[3 + 2]), (1.0 / 36.0, -0.5 / 36.0));
    }

    #[test]
    fn agrees_with_pytorch_and_its_slope() {
        let [p, x] = golden_inputs(&[2, 24, 3]);
        let c: Vec<f64> = crate::nn::goldens::pattern(&[48], 3).data.iter().map(|c| c.abs()).collect();
        let loss = |p: &[f64]| joint_loss(&bodies(p), &bodies(&x), c.as_chunks().0);
        check_loss(&loss(&p), &goldens::JOINT_LOSS);
        assert_slopes(loss, &p);
    }
}

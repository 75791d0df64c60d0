//! The weighted sum that the regressor is trained on.

use super::Loss;

/// One thing for each term of the regressor's loss.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegressorTerms<T> {
    /// [`keypoint_loss`](super::keypoint_loss), in −1…1 over the crop.
    pub keypoints: T,
    /// [`joint_loss`](super::joint_loss).
    pub joints: T,
    /// [`pose_loss`](super::pose_loss).
    pub pose: T,
    /// [`betas_loss`](super::betas_loss).
    pub betas: T,
    /// [`vertex_loss`](super::vertex_loss).
    pub vertices: T,
    /// [`camera_loss`](super::camera_loss).
    pub camera: T,
}

impl<T> RegressorTerms<T> {
    /// The terms in the order of their fields.
    pub fn each_ref(&self) -> [&T; 6] {
        let Self { keypoints, joints, pose, betas, vertices, camera } = self;
        [keypoints, joints, pose, betas, vertices, camera]
    }
}

/// The weights ω of eq. 4.6, each times 60.
///
/// The thesis gives (5, 5, 1, 0.001) to (2-D, 3-D, pose, mesh); in the code that its numbers come from 0.001 is the
/// weight of the betas, that of the mesh is 0, and the camera's scale has a term of its own (erratum E41).
pub const REGRESSOR_WEIGHTS: RegressorTerms<f64> =
    RegressorTerms { keypoints: 300.0, joints: 300.0, pose: 60.0, betas: 0.06, vertices: 0.0, camera: 60.0 };

/// L = Σ ω_t L_t and its gradient with respect to what each term compares, ω_t ∂L_t.
///
/// # References
/// Li 2021, eq. 4.6.
pub fn regressor_loss(
    weights: &RegressorTerms<f64>,
    terms: &RegressorTerms<Loss>,
) -> (f64, RegressorTerms<Vec<f64>>) {
    let value = weights.each_ref().into_iter().zip(terms.each_ref()).map(|(w, term)| w * term.value).sum();
    let scaled = |weight: f64, term: &Loss| term.gradient.iter().map(|g| weight * g).collect();
    let gradient = RegressorTerms {
        keypoints: scaled(weights.keypoints, &terms.keypoints),
        joints: scaled(weights.joints, &terms.joints),
        pose: scaled(weights.pose, &terms.pose),
        betas: scaled(weights.betas, &terms.betas),
        vertices: scaled(weights.vertices, &terms.vertices),
        camera: scaled(weights.camera, &terms.camera),
    };
    (value, gradient)
}

#[cfg(test)]
mod tests {
    use super::super::tests::golden_inputs;
    use super::super::{betas_loss, camera_loss, goldens, joint_loss, keypoint_loss, pose_loss, vertex_loss};
    use super::*;
    use crate::nn::Tensor;
    use crate::nn::goldens::check;

    #[test]
    fn agrees_with_pytorch() {
        let ([k, k0], [x, x0], [b, b0], [v, v0]) = (
            golden_inputs(&[2, 24, 2]),
            golden_inputs(&[2, 24, 3]),
            golden_inputs(&[2, 10]),
            golden_inputs(&[2, 7, 3]),
        );
        let [r, r0] = golden_inputs(&[2, 24, 3, 3]);
        let joints = |flat: &[f64]| flat.as_chunks().0.as_chunks().0.to_vec();
        let terms = RegressorTerms {
            keypoints: keypoint_loss(k.as_chunks().0, k0.as_chunks().0, &[1.0; 48]),
            joints: joint_loss(&joints(&x), &joints(&x0), &[[1.0; 24]; 2]),
            pose: pose_loss(r.as_chunks().0.as_chunks().0, r0.as_chunks().0.as_chunks().0),
            betas: betas_loss(&b, &b0),
            vertices: vertex_loss(v.as_chunks().0, v0.as_chunks().0),
            camera: camera_loss(&[0.1, 0.9]),
        };
        let (value, gradient) = regressor_loss(&REGRESSOR_WEIGHTS, &terms);
        check(&Tensor::new(&[], vec![value]), &goldens::REGRESSOR_LOSS[0]);
        for (found, golden) in gradient.each_ref().into_iter().zip(&goldens::REGRESSOR_LOSS[1..]) {
            check(&Tensor::new(golden.shape, found.clone()), golden);
        }
    }

    #[test]
    fn a_term_without_weight_moves_nothing() {
        let term = Loss { value: 2.0, gradient: vec![3.0] };
        let terms = RegressorTerms { vertices: term.clone(), pose: term, ..RegressorTerms::default() };
        let (value, gradient) = regressor_loss(&REGRESSOR_WEIGHTS, &terms);
        assert_eq!((value, gradient.vertices, gradient.pose), (120.0, vec![0.0], vec![180.0]));
    }
}

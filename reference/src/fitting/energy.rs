//! The energy of a stage as residuals: the data term and its priors, stacked.
//!
//! ```text
//! r = ( w f(e)        two for each mark           keypoint_residuals
//!       w_c x_c       for each damped number of x  β, and a weak θ
//!       bend          one for each elbow and knee
//!       mixture       n + 1, if there is one )
//! ```

use super::keypoint_residuals::KeypointResiduals;
use super::layout::Layout;
use super::prior::{GaussianMixture, bend_residual};
use super::result::Parameters;
use crate::body::Hinge;
use crate::least_squares::Problem;
use crate::linalg::dense::Dense;

/// What keeps elbows and knees from bending backwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BendTerm {
    /// factor · exp(−φ), eq. 2.5: it also pushes limbs that bend naturally.
    Exponential {
        /// λ_θ · 0.317 α.
        factor: f64,
    },
    /// weight · max(0, −φ): nothing unless a limb is bent backwards.
    OneSided {
        /// Per radian.
        weight: f64,
    },
}

impl BendTerm {
    /// The residual at a flexion φ (radians) and its derivative.
    pub fn residual(self, flexion_rad: f64) -> (f64, f64) {
        match self {
            BendTerm::Exponential { factor } => bend_residual(flexion_rad, factor),
            BendTerm::OneSided { weight } if flexion_rad < 0.0 => (-weight * flexion_rad, -weight),
            BendTerm::OneSided { .. } => (0.0, 0.0),
        }
    }
}

/// The residuals of a stage as a function of x.
#[derive(Clone, Copy, Debug)]
pub struct Energy<'a> {
    /// The data.
    pub keypoints: KeypointResiduals<'a>,
    /// What x is.
    pub layout: &'a Layout,
    /// The values of what is not in x.
    pub fixed: &'a Parameters,
    /// Residuals w·x_c for each (c, w): Gaussian priors of mean 0.
    pub damping: &'a [(usize, f64)],
    /// Elbows and knees.
    pub hinges: &'a [Hinge],
    /// Their term.
    pub bend: BendTerm,
    /// λ_θ and the mixture over the pose without its root.
    pub mixture: Option<(f64, &'a GaussianMixture)>,
}

impl Energy<'_> {
    /// The number of residuals.
    pub fn count(&self) -> usize {
        let mixture = self.mixture.map_or(0, |(_, mixture)| mixture.dimension() + 1);
        self.keypoints.count() + self.damping.len() + self.hinges.len() + mixture
    }

    fn body_pose<'x>(&self, x: &'x [f64]) -> &'x [f64] {
        &x[self.layout.pose.start + 3..self.layout.pose.end]
    }
}

impl Problem for Energy<'_> {
    type Jacobian = Dense;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        let mut r = Vec::with_capacity(self.count());
        self.keypoints.residuals(&self.layout.unpack(x, self.fixed), &mut r)?;
        r.extend(self.damping.iter().map(|&(c, w)| w * x[c]));
        let pose = &x[self.layout.pose.clone()];
        r.extend(self.hinges.iter().map(|hinge| self.bend.residual(hinge.flexion_rad(pose)).0));
        if let Some((weight, mixture)) = self.mixture {
            r.extend(mixture.residuals(self.body_pose(x)).iter().map(|m| weight * m));
        }
        Some(r)
    }

    fn jacobian(&self, x: &[f64]) -> Dense {
        let mut jacobian = Dense::zeros(self.count(), self.layout.len);
        self.keypoints.write_jacobian(x, &self.layout.unpack(x, self.fixed), self.layout, &mut jacobian, 0);
        let mut row = self.keypoints.count();
        for &(c, w) in self.damping {
            jacobian[(row, c)] = w;
            row += 1;
        }
        let pose = &x[self.layout.pose.clone()];
        for hinge in self.hinges {
            let (_, slope) = self.bend.residual(hinge.flexion_rad(pose));
            for (c, a) in hinge.axis.iter().enumerate() {
                jacobian[(row, self.layout.pose.start + 3 * hinge.joint + c)] = slope * a;
            }
            row += 1;
        }
        if let Some((weight, mixture)) = self.mixture {
            let derivative = mixture.derivative(self.body_pose(x));
            let first = self.layout.pose.start + 3;
            for m in 0..derivative.rows() {
                for (c, d) in derivative.row(m).iter().enumerate() {
                    jacobian[(row + m, first + c)] = weight * d;
                }
            }
        }
        jacobian
    }
}

#[cfg(test)]
mod tests {
    use super::super::figure::Figure;
    use super::super::keypoint_residuals::Detection;
    use super::super::test_scene::{body, person, ring};
    use super::super::{Extrinsics, KeypointSet, LossForm, Translations};
    use super::*;

    #[test]
    fn jacobian_of_all_terms_is_its_central_difference() {
        const STEP: f64 = 1e-5;
        let skeleton = body().skeleton();
        let figure = Figure::new(body(), &skeleton, KeypointSet::Smpl24);
        let hinges: Vec<Hinge> = skeleton.hinges().into_iter().flatten().collect();
        let mut person = person(2);
        // One knee is bent backwards.
        person.pose[12] = -0.4;
        let at = Parameters { pose: person.pose, betas: person.betas, trans: person.trans, cameras: ring(2) };
        let detections = [7, 20].map(|keypoint| Detection {
            view: keypoint % 2,
            keypoint,
            pixel_px: [150.0, 100.0],
            weight: 0.7,
        });
        let n = 69;
        let mut covariance = vec![0.0; n * n];
        for i in 0..n {
            covariance[i * n + i] = 0.2 + 0.01 * i as f64;
            if i > 0 {
                covariance[i * n + i - 1] = 0.05;
                covariance[(i - 1) * n + i] = 0.05;
            }
        }
        let mixture = GaussianMixture::new(vec![vec![0.1; n]], &[covariance], &[1.0]).expect("a mixture");
        let layout = Layout::new(24, 10, 2, Extrinsics::Unknown, Translations::Fixed);
        let damping: Vec<(usize, f64)> = layout.betas.clone().map(|c| (c, 2.5)).chain([(5, 0.3)]).collect();
        for bend in [BendTerm::Exponential { factor: 3.0 }, BendTerm::OneSided { weight: 4.0 }] {
            let energy = Energy {
                keypoints: KeypointResiduals {
                    figure: &figure,
                    detections: &detections,
                    sigma_px: 80.0,
                    loss: LossForm::PerCoordinate,
                },
                layout: &layout,
                fixed: &at,
                damping: &damping,
                hinges: &hinges,
                bend,
                mixture: Some((1.5, &mixture)),
            };
            let x = layout.pack(&at);
            let jacobian = energy.jacobian(&x);
            assert_eq!((jacobian.rows(), energy.count()), (4 + 11 + 4 + 70, 4 + 11 + 4 + 70));
            for c in 0..layout.len {
                let moved = |step: f64| {
                    let mut x = x.clone();
                    x[c] += step;
                    energy.residuals(&x).expect("in front")
                };
                for (row, (above, below)) in moved(STEP).iter().zip(moved(-STEP)).enumerate() {
                    let error = (jacobian[(row, c)] - (above - below) / (2.0 * STEP)).abs();
                    assert!(error < 1e-5, "{bend:?}: row {row}, column {c}: {error}");
                }
            }
        }
    }
}

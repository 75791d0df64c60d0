//! Which number of the vector x that a solver moves is which unknown of the fit.
//!
//! ```text
//! x = (θ, β, trans, r_1, t_1, …, r_{N−1}, t_{N−1})
//! ```
//!
//! θ and β are always there. With known cameras `trans` follows and that is all. With unknown ones view 0 fixes the world
//! (R_0 = I, t_0 = 0; the thesis' t_0 is `trans`), and every other view has an axis–angle vector r_i and a translation
//! t_i: without that gauge, turning body and cameras together would leave JᵀJ with a null space (erratum E14b).
//! Translations held at what the torso gave have no numbers in x (erratum E8).

use super::observation::Extrinsics;
use super::presets::Translations;
use super::result::Parameters;
use crate::linalg::vector::Vector3;
use crate::rotation::{logarithm, rodrigues};
use std::ops::Range;

/// Where x has the unknowns of one view's camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CameraColumns {
    /// The first of the three numbers of r_i.
    pub rotation: Option<usize>,
    /// The first of the three numbers of t_i.
    pub translation: Option<usize>,
}

/// Where x has what.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// θ, 3J numbers from 0.
    pub pose: Range<usize>,
    /// β.
    pub betas: Range<usize>,
    /// The first of the three numbers of `trans`.
    pub trans: Option<usize>,
    /// The cameras of the N views.
    pub cameras: Vec<CameraColumns>,
    /// The length of x.
    pub len: usize,
}

impl Layout {
    /// The unknowns of J joints, B betas and N views.
    ///
    /// With known extrinsics `translations` has no say: there is only the body's own, which no camera step could fix.
    pub fn new(
        joints: usize,
        betas: usize,
        views: usize,
        extrinsics: Extrinsics,
        translations: Translations,
    ) -> Layout {
        let mut len = 3 * joints + betas;
        let mut three = |wanted: bool| {
            wanted.then(|| {
                len += 3;
                len - 3
            })
        };
        let known = extrinsics == Extrinsics::Known;
        let moves = known || translations == Translations::Free;
        let trans = three(moves);
        let cameras = (0..views)
            .map(|i| CameraColumns {
                rotation: three(!known && i > 0),
                translation: three(!known && i > 0 && moves),
            })
            .collect();
        Layout { pose: 0..3 * joints, betas: 3 * joints..3 * joints + betas, trans, cameras, len }
    }

    /// x of given values.
    pub fn pack(&self, parameters: &Parameters) -> Vec<f64> {
        let mut x = vec![0.0; self.len];
        x[self.pose.clone()].copy_from_slice(&parameters.pose);
        x[self.betas.clone()].copy_from_slice(&parameters.betas);
        let mut put = |at: Option<usize>, v: Vector3| {
            if let Some(at) = at {
                x[at..at + 3].copy_from_slice(&v);
            }
        };
        put(self.trans, parameters.trans);
        for (columns, camera) in self.cameras.iter().zip(&parameters.cameras) {
            put(columns.rotation, columns.rotation.map_or([0.0; 3], |_| logarithm(&camera.rotation)));
            put(columns.translation, camera.translation);
        }
        x
    }

    /// The values that x stands for; what is not in x is taken from `fixed`.
    pub fn unpack(&self, x: &[f64], fixed: &Parameters) -> Parameters {
        let get = |at: usize| -> Vector3 { [x[at], x[at + 1], x[at + 2]] };
        let mut cameras = fixed.cameras.clone();
        for (columns, camera) in self.cameras.iter().zip(&mut cameras) {
            camera.rotation = columns.rotation.map_or(camera.rotation, |at| rodrigues(get(at)));
            camera.translation = columns.translation.map_or(camera.translation, get);
        }
        Parameters {
            pose: x[self.pose.clone()].to_vec(),
            betas: x[self.betas.clone()].to_vec(),
            trans: self.trans.map_or(fixed.trans, get),
            cameras,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pinhole;

    #[test]
    fn four_views_have_as_many_unknowns_as_the_thesis() {
        let count = |extrinsics, translations| Layout::new(24, 10, 4, extrinsics, translations).len;
        // θ and β, three rotations, four translations.
        assert_eq!(count(Extrinsics::Unknown, Translations::Free), 72 + 10 + 9 + 12);
        assert_eq!(count(Extrinsics::Unknown, Translations::Fixed), 72 + 10 + 9);
        assert_eq!(count(Extrinsics::Known, Translations::Fixed), 72 + 10 + 3);
    }

    #[test]
    fn unpacking_gives_back_what_was_packed() {
        let camera = |k: f64| Pinhole {
            rotation: rodrigues([0.1 * k, 2.0 - k, 0.3]),
            translation: [k, 0.0, 4.0],
            ..Pinhole::ideal(500.0, [160.0, 120.0])
        };
        let parameters = Parameters {
            pose: (0..72).map(f64::from).collect(),
            betas: vec![0.5; 10],
            trans: [1.0, 2.0, 3.0],
            cameras: vec![camera(0.0), camera(1.0), camera(2.0)],
        };
        for extrinsics in [Extrinsics::Known, Extrinsics::Unknown] {
            for translations in [Translations::Free, Translations::Fixed] {
                let layout = Layout::new(24, 10, 3, extrinsics, translations);
                let back = layout.unpack(&layout.pack(&parameters), &parameters);
                assert_eq!(layout.pack(&back), layout.pack(&parameters));
                for (a, b) in back.cameras.iter().zip(&parameters.cameras) {
                    let difference = crate::linalg::matrix::sub(&a.rotation, &b.rotation);
                    assert!(crate::linalg::matrix::max_abs(&difference) < 1e-14);
                    assert_eq!(a.translation, b.translation);
                }
            }
        }
    }
}

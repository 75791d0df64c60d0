//! Un-posing: where a point of the world would be if the body were at rest.
//!
//! A ray of sight that touches the posed body at vertex i is carried back into the frame of the rest pose, where the
//! vertex t̄_i + B_S(β)_i + D_i is linear in what a shape fit looks for.

use super::posed_body::PosedBody;
use super::skinning::Affine;
use crate::linalg::vector::sub;

impl PosedBody<'_> {
    /// The map p ↦ V_i⁻¹ p − B_P(θ)_i of points that are matched with vertex `i`, or `None` where the vertex' blended
    /// transform has collapsed ([`Affine::inverse`]).
    ///
    /// It takes [`PosedBody::position`] to [`PosedBody::shaped`]. Apply it to *two* points of a ray and rebuild the line from
    /// the results: its direction is turned and stretched by V_i⁻¹ alone, its moment changes with B_P as well.
    ///
    /// # Conventions
    /// The thesis applies the inverse skinning to the ray's direction and subtracts B_P, a displacement, from it, which is
    /// wrong by dimension (erratum E10). Only B_P is subtracted, not B_S or D: those are what is being fitted.
    ///
    /// # Panics
    /// If there is no such vertex.
    ///
    /// # References
    /// Li 2021, eq. 3.6; Alldieck, Magnor, Xu, Theobalt, Pons-Moll 2018, "Video Based Reconstruction of 3D People Models".
    ///
    /// ```
    /// use vitruvian_reference::{body::mannequin, linalg::vector::distance};
    ///
    /// let body = mannequin();
    /// let skeleton = body.skeleton();
    /// let held = body.at_pose(&skeleton, &[0.2; 72], &[1.0], &[], [0.0, 1.0, 3.0]);
    /// let unpose = held.unposing(100).expect("an ordinary pose");
    /// assert!(distance(unpose.apply(held.position(100)), held.shaped(100)) < 1e-12);
    /// ```
    pub fn unposing(&self, i: usize) -> Option<Affine> {
        let mut inverse = self.blended_transform(i).inverse()?;
        inverse.translation = sub(inverse.translation, self.pose_corrective(i));
        Some(inverse)
    }
}

#[cfg(test)]
mod tests {
    use crate::body::mannequin;
    use crate::linalg::matrix::apply;
    use crate::linalg::vector::{ZERO, add, cross, distance, norm, normalize, sub};
    use std::f64::consts::PI;

    #[test]
    fn line_through_a_posed_vertex_is_unposed_to_a_line_through_the_rest_vertex() {
        let body = mannequin();
        let skeleton = body.skeleton();
        let pose: Vec<f64> = (0..72).map(|n| 0.6 * (1.9 * f64::from(n)).sin()).collect();
        let held = body.at_pose(&skeleton, &pose, &[0.5, -1.0], &[], [0.1, 1.0, 3.0]);
        let direction = [0.1, -0.2, 1.0];
        for i in (0..body.vertex_count()).step_by(97) {
            let unpose = held.unposing(i).expect("no joint is folded");
            let (near, far) = (sub(held.position(i), direction), add(held.position(i), direction));
            let (p0, p1) = (unpose.apply(near), unpose.apply(far));
            let n = normalize(sub(p1, p0));
            assert!(norm(sub(cross(held.shaped(i), n), cross(p0, n))) < 1e-12, "vertex {i}");
            // The corrective moves both points alike.
            assert!(distance(sub(p1, p0), apply(&unpose.linear, sub(far, near))) < 1e-13);
        }
    }

    #[test]
    fn collapsed_vertices_cannot_be_unposed() {
        let mut body = mannequin();
        let skeleton = body.skeleton();
        let shared = &mut body.lbs_weights[..24];
        shared.fill(0.0);
        (shared[18], shared[20]) = (0.5, 0.5);
        let mut pose = [0.0; 72];
        pose[60] = PI;
        assert_eq!(body.at_pose(&skeleton, &pose, &[], &[], ZERO).unposing(0), None);
    }
}

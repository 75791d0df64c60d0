//! The mannequin: a complete body model made by arithmetic alone.
//!
//! 24 joints in SMPL's order and tree, ten shape directions with a meaning ([`BETA_NAMES`]), pose correctives, and one
//! closed skin of genus 0. No data file and no licence stands behind it; the same bytes come out on every machine
//! with IEEE arithmetic and the same elementary functions.
//!
//! How it is made: a smooth union of lofted parts (`flesh`), meshed by surface nets and relaxed (`skin`); weights from
//! the nearest bone, spread over the surface (`weights`); joints as convex combinations of the skin around them
//! (`regressor`); shapes from deformation fields of the rest pose (`shapes`); correctives from what linear blending
//! loses at a bend (`correctives`).

mod correctives;
mod flesh;
mod regressor;
mod shapes;
mod skeleton;
mod skin;
mod surface_nets;
mod weights;

pub use shapes::{BETA_COUNT, BETA_NAMES};
pub use skeleton::{JOINT_NAMES, MIRRORED_JOINT, PARENTS};

use super::BodyModel;

/// The built-in body: 24 joints, B = 10, 8798 vertices, closed, outward-wound, mirror-symmetric.
///
/// # Conventions
/// Metres; +Y up, faces +Z, its left is +X; T-pose, palms down; 1.72 m tall; the pelvis is the origin.
///
/// ```
/// let body = vitruvian_reference::body::mannequin();
/// assert_eq!((body.joint_count(), body.beta_count()), (24, 10));
/// ```
pub fn mannequin() -> BodyModel {
    let mesh = skin::skin(&flesh::Flesh::new());
    let lbs_weights = weights::weights(&mesh);
    BodyModel {
        shapedirs: shapes::shapedirs(&mesh.vertices),
        posedirs: correctives::posedirs(&mesh.vertices, &lbs_weights),
        j_regressor: regressor::j_regressor(&mesh),
        lbs_weights,
        parents: PARENTS.to_vec(),
        v_template: mesh.vertices,
        faces: mesh.faces,
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::{Vector3, distance};
    use crate::surface::inside::Inside;
    use crate::surface::mesh::Mesh;
    use crate::surface::topology::Topology;
    use std::collections::HashMap;
    use std::sync::OnceLock;

    /// Building takes a tenth of a second: the tests share one.
    fn body() -> &'static BodyModel {
        static BODY: OnceLock<BodyModel> = OnceLock::new();
        BODY.get_or_init(mannequin)
    }

    fn skin(vertices: Vec<Vector3>) -> Mesh {
        Mesh::new(vertices, body().faces.clone())
    }

    #[test]
    fn skin_is_one_closed_outward_surface_of_genus_zero() {
        let mesh = skin(body().v_template.clone());
        let topology = Topology::of(&mesh);
        assert!(topology.is_closed_surface(), "{topology:?}");
        assert_eq!(topology.euler_characteristic(), 2);
        // A person of this height displaces about 65 litres; the sign says that normals point outwards.
        assert!((0.05..0.08).contains(&mesh.signed_volume()), "{} m³", mesh.signed_volume());
    }

    #[test]
    fn mannequin_has_the_stature_of_an_adult() {
        let heights = body().v_template.iter().map(|v| v[1]);
        let (low, high) =
            (heights.clone().fold(f64::INFINITY, f64::min), heights.fold(f64::NEG_INFINITY, f64::max));
        assert!((1.68..1.76).contains(&(high - low)), "{} m", high - low);
    }

    #[test]
    fn regressed_joints_are_the_skeleton_and_lie_inside_the_skin() {
        let mesh = skin(body().v_template.clone());
        let inside = Inside::new(&mesh);
        for ((name, joint), designed) in
            JOINT_NAMES.iter().zip(body().rest_joints(&[])).zip(skeleton::rest_joints())
        {
            assert!(distance(joint, designed) < 1e-12, "{name}: {joint:?}, designed {designed:?}");
            assert!(inside.contains(joint), "{name} at {joint:?} is outside");
        }
    }

    #[test]
    fn joints_stay_inside_at_the_ends_of_every_shape() {
        for l in 0..BETA_COUNT {
            for end in [-2.5, 2.5] {
                let mut betas = [0.0; BETA_COUNT];
                betas[l] = end;
                let posed = body().pose(&[0.0; 72], &betas, [0.0; 3]);
                let mesh = skin(posed.vertices);
                let inside = Inside::new(&mesh);
                for (name, joint) in JOINT_NAMES.iter().zip(posed.joints) {
                    assert!(inside.contains(joint), "{name} leaves the skin at {} {end}", BETA_NAMES[l]);
                }
            }
        }
    }

    #[test]
    fn regressor_rows_are_convex_combinations() {
        for (row, name) in body().j_regressor.chunks_exact(body().vertex_count()).zip(JOINT_NAMES) {
            assert!(row.iter().all(|&w| w >= 0.0), "{name}");
            assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{name}");
        }
    }

    #[test]
    fn weights_are_convex_and_at_most_four() {
        for (v, row) in body().lbs_weights.chunks_exact(24).enumerate() {
            assert!(
                row.iter().all(|&w| w >= 0.0) && (row.iter().sum::<f64>() - 1.0).abs() < 1e-12,
                "vertex {v}: {row:?}"
            );
            assert!(row.iter().filter(|&&w| w > 0.0).count() <= 4, "vertex {v}: {row:?}");
        }
    }

    #[test]
    fn zero_pose_is_the_template() {
        let posed = body().pose(&[0.0; 72], &[0.0; 10], [0.0; 3]);
        for (v, t) in posed.vertices.iter().zip(&body().v_template) {
            assert!(distance(*v, *t) < 1e-14, "{v:?} {t:?}");
        }
    }

    #[test]
    fn every_array_is_mirror_symmetric() {
        let body = body();
        let key = |v: Vector3| [v[0] + 0.0, v[1], v[2]].map(f64::to_bits);
        let index: HashMap<_, _> = body.v_template.iter().enumerate().map(|(i, v)| (key(*v), i)).collect();
        for (i, v) in body.v_template.iter().enumerate() {
            let m = *index
                .get(&key(skeleton::mirrored(*v)))
                .unwrap_or_else(|| panic!("{v:?} has no mirror image"));
            for j in 0..24 {
                let (here, there) =
                    (body.lbs_weights[24 * i + j], body.lbs_weights[24 * m + MIRRORED_JOINT[j]]);
                assert!((here - there).abs() < 1e-12, "weights of vertex {i} and {m}");
                let count = body.vertex_count();
                let there = body.j_regressor[MIRRORED_JOINT[j] * count + m];
                assert!(
                    (body.j_regressor[j * count + i] - there).abs() < 1e-12,
                    "regressor of vertex {i} and {m}"
                );
            }
            for l in 0..BETA_COUNT {
                let d = |v: usize, axis: usize| body.shapedirs[(3 * v + axis) * BETA_COUNT + l];
                assert!(
                    (d(i, 0), d(i, 1), d(i, 2)) == (-d(m, 0), d(m, 1), d(m, 2)),
                    "shape {l} of vertex {i}"
                );
            }
        }
    }

    #[test]
    fn triangles_are_well_shaped() {
        // 4√3·area/Σ edges² is 1 for the equilateral triangle and 0 for a needle.
        let mesh = skin(body().v_template.clone());
        let quality = |[a, b, c]: [Vector3; 3], area_vector: Vector3| {
            let edges = distance(a, b).powi(2) + distance(b, c).powi(2) + distance(c, a).powi(2);
            2.0 * 3f64.sqrt() * crate::linalg::vector::norm(area_vector) / edges
        };
        for (triangle, double_area) in mesh.triangles().zip(double_areas(&mesh)) {
            assert!(quality(triangle, double_area) > 0.3, "{triangle:?}");
        }
    }

    /// (b − a) × (c − a) of every face.
    fn double_areas(mesh: &Mesh) -> Vec<Vector3> {
        use crate::linalg::vector::{cross, sub};
        mesh.triangles().map(|[a, b, c]| cross(sub(b, a), sub(c, a))).collect()
    }

    #[test]
    fn correctives_give_a_bent_elbow_some_of_its_volume_back() {
        let mut bent = [0.0; 72];
        bent[3 * 18 + 1] = -std::f64::consts::FRAC_PI_2;
        let bare = BodyModel { posedirs: vec![0.0; body().posedirs.len()], ..body().clone() };
        let volume = |model: &BodyModel| skin(model.pose(&bent, &[], [0.0; 3]).vertices).signed_volume();
        let rest = skin(body().v_template.clone()).signed_volume();
        let (with, without) = (volume(body()), volume(&bare));
        assert!(
            without < with && with < rest + (rest - without),
            "rest {rest}, with {with}, without {without}"
        );
    }
}

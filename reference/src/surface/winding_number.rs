//! The generalised winding number: the definition of inside, one solid angle a triangle.

use super::mesh::Mesh;
use crate::linalg::vector::{Vector3, cross, dot, norm, sub};
use std::f64::consts::PI;

/// w(p) = (1/4π) Σ Ω over the faces, Ω the signed solid angle under which p sees the face.
///
/// For a closed mesh w is an integer off the surface: 1 inside, 0 outside, −1 inside a mesh that is inside out,
/// 2 where two pieces overlap. For a mesh with holes it varies smoothly, and w > ½ is a sensible inside. With
/// a, b, c the corners seen from p,
///
/// tan(Ω/2) = a·(b × c) / (|a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b|).
///
/// Takes time proportional to the number of faces; [`Inside`](super::inside::Inside) is the fast exact way for
/// closed meshes.
///
/// # References
///
/// Van Oosterom and Strackee 1983, "The solid angle of a plane triangle"; Jacobson, Kavan and Sorkine-Hornung
/// 2013, "Robust inside-outside segmentation using generalized winding numbers".
pub fn winding_number(mesh: &Mesh, point: Vector3) -> f64 {
    let solid_angles = mesh.triangles().map(|corners| {
        let [a, b, c] = corners.map(|corner| sub(corner, point));
        let lengths = [norm(a), norm(b), norm(c)];
        let denominator = lengths[0] * lengths[1] * lengths[2]
            + dot(a, b) * lengths[2]
            + dot(b, c) * lengths[0]
            + dot(c, a) * lengths[1];
        2.0 * dot(a, cross(b, c)).atan2(denominator)
    });
    solid_angles.sum::<f64>() / (4.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn one_inside_and_nothing_outside() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        assert!((winding_number(&mesh, [0.2, 0.3, 0.9]) - 1.0).abs() < 1e-14);
        assert!(winding_number(&mesh, [0.2, 0.3, 1.1]).abs() < 1e-14);
    }

    #[test]
    fn a_lid_seen_from_the_centre_of_its_cube_fills_a_sixth() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        let open = Mesh { faces: mesh.faces[2..].to_vec(), ..mesh };
        assert!((winding_number(&open, [0.5; 3]) - 5.0 / 6.0).abs() < 1e-14);
    }

    #[test]
    fn overlap_counts_twice_and_inside_out_counts_negative() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        let mut twice = mesh.clone();
        twice.faces.extend(mesh.faces.iter());
        assert!((winding_number(&twice, [0.5; 3]) - 2.0).abs() < 1e-14);
        let reversed = Mesh { faces: mesh.faces.iter().map(|&[a, b, c]| [a, c, b]).collect(), ..mesh };
        assert!((winding_number(&reversed, [0.5; 3]) + 1.0).abs() < 1e-14);
    }
}

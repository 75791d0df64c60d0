//! The cotangent Laplacian of a triangle mesh.
//!
//! (L x)_i = Σ_j w_ij (x_j − x_i) over the neighbours j of vertex i, with w_ij = ½ (cot α + cot β), α and β the angles
//! opposite to the edge ij in its two faces. Applied to the positions it gives the mean curvature normal times the area
//! around the vertex; applied to a field of offsets, how much they differ from their neighbours'.
//!
//! # Conventions
//! Rows sum to 0, off-diagonal entries are mostly positive and the diagonal negative: −L is the stiffness matrix of linear
//! finite elements. It is *not* divided by the area around the vertex, as in Li 2021 (eq. 3.9) and the code he follows.
//!
//! # References
//! Pinkall, Polthier 1993, "Computing Discrete Minimal Surfaces and Their Conjugates", eq. 8; Li 2021, eq. 3.9.

use crate::linalg::vector::{Vector3, cross, dot, norm, sub};

/// The largest |cot| that an angle contributes: that of about 1°. An angle of a needle says nothing about the surface, and
/// of a face without area it is 0/0; its cotangent counts as 0.
pub const LARGEST_COTANGENT: f64 = 57.0;

/// The entries (row, column, value) of L for V vertices, sorted by row, then column, each pair once; every vertex has a
/// diagonal entry.
///
/// # Panics
/// If a face names a vertex that is not there.
///
/// ```
/// use vitruvian_reference::surface::laplacian::cotangent_laplacian;
/// // Two right triangles: their diagonal lies opposite to two right angles, whose cotangent is 0.
/// let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let entries = cotangent_laplacian(&square, &[[0, 1, 2], [0, 2, 3]]);
/// assert!(entries.contains(&(0, 1, 0.5)) && entries.iter().any(|&(i, j, w)| (i, j) == (0, 0) && w == -1.0));
/// ```
pub fn cotangent_laplacian(vertices: &[Vector3], faces: &[[u32; 3]]) -> Vec<(usize, usize, f64)> {
    let mut entries: Vec<(usize, usize, f64)> = (0..vertices.len()).map(|i| (i, i, 0.0)).collect();
    entries.reserve(12 * faces.len());
    for face in faces {
        for corner in 0..3 {
            let [at, i, j] = [0, 1, 2].map(|n| face[(corner + n) % 3] as usize);
            let half = 0.5 * cotangent(sub(vertices[i], vertices[at]), sub(vertices[j], vertices[at]));
            entries.extend([(i, j, half), (j, i, half), (i, i, -half), (j, j, -half)]);
        }
    }
    entries.sort_by_key(|&(row, column, _)| (row, column));
    entries.dedup_by(|next, kept| {
        let same = (next.0, next.1) == (kept.0, kept.1);
        if same {
            kept.2 += next.2;
        }
        same
    });
    entries
}

/// cot ∠(a, b) = a·b / ‖a × b‖, within ±[`LARGEST_COTANGENT`].
fn cotangent(a: Vector3, b: Vector3) -> f64 {
    let cotangent = dot(a, b) / norm(cross(a, b));
    if cotangent.is_finite() { cotangent.clamp(-LARGEST_COTANGENT, LARGEST_COTANGENT) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::{ZERO, add_scaled, distance, scale};
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn equilateral_triangle_by_hand() {
        // cot 60° = 1/√3, halved, one face a side.
        let vertices = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 3f64.sqrt(), 0.0]];
        let side = 0.5 / 3f64.sqrt();
        let entries = cotangent_laplacian(&vertices, &[[0, 1, 2]]);
        assert_eq!(entries.len(), 9);
        for (i, j, w) in entries {
            let expected = if i == j { -2.0 * side } else { side };
            assert!((w - expected).abs() < 1e-15, "({i}, {j}): {w}");
        }
    }

    #[test]
    fn laplacian_of_positions_is_the_curvature_normal() {
        // At a corner of a cube the three sides pull inwards alike.
        let cube = cuboid([1.0; 3]);
        let mut sums = [ZERO; 8];
        for (i, j, w) in cotangent_laplacian(&cube.vertices, &cube.faces) {
            sums[i] = add_scaled(sums[i], cube.vertices[j], w);
        }
        for (sum, vertex) in sums.iter().zip(&cube.vertices) {
            let inwards = [0, 1, 2].map(|axis| 0.5 - vertex[axis]);
            assert!(distance(*sum, scale(inwards, 2.0)) < 1e-14, "{sum:?} at {vertex:?}");
        }
    }

    #[test]
    fn needles_and_faces_without_area_stay_finite() {
        let vertices = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 1e-9, 0.0], [0.0; 3]];
        for (_, _, w) in cotangent_laplacian(&vertices, &[[0, 1, 2], [0, 3, 1], [0, 3, 3]]) {
            assert!(w.abs() <= 4.0 * LARGEST_COTANGENT, "{w}");
        }
    }
}

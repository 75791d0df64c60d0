//! The mannequin's rest mesh: the net, relaxed until its triangles are even and its vertices lie on the flesh.

use super::flesh::Flesh;
use super::surface_nets::{self, SymmetricMesh};
use crate::linalg::vector::{Vector3, add, add_scaled, dot, norm_squared, scale, sub};

/// Lattice spacing, metres: it gives 8798 vertices, and two cells across a finger-thick hand.
const SPACING: f64 = 0.0165;

/// Rounds of relaxation; more change nothing visible.
const ROUNDS: usize = 4;

/// The rest mesh.
pub(super) fn skin(flesh: &Flesh) -> SymmetricMesh {
    let mut net = surface_nets::mesh(flesh, SPACING);
    let neighbours = net.neighbours();
    for round in 0..=ROUNDS {
        let relaxed: Vec<Vector3> = (0..net.vertices.len())
            .map(|v| {
                let here = net.vertices[v];
                // The last round only projects.
                let moved =
                    if round < ROUNDS { slide(flesh, here, &net.vertices, &neighbours[v]) } else { here };
                project(flesh, moved)
            })
            .collect();
        net.vertices = relaxed;
        net.symmetrise();
    }
    net
}

/// `here` moved half of the way to the mean of its neighbours, within the tangent plane of the field.
fn slide(flesh: &Flesh, here: Vector3, vertices: &[Vector3], neighbours: &[usize]) -> Vector3 {
    let sum = neighbours.iter().fold([0.0; 3], |sum, &w| add(sum, vertices[w]));
    let step = scale(sub(scale(sum, 1.0 / neighbours.len() as f64), here), 0.5);
    let (_, gradient) = flesh.value_and_gradient(here);
    let along = dot(step, gradient) / norm_squared(gradient).max(1e-12);
    add(here, add_scaled(step, gradient, -along))
}

/// One Newton step towards the zero level: x − f g/‖g‖².
fn project(flesh: &Flesh, p: Vector3) -> Vector3 {
    let (value, gradient) = flesh.value_and_gradient(p);
    // A step longer than half a cell would leave the neighbourhood in which the first order is right.
    let step = (value / norm_squared(gradient).max(0.04)).clamp(-0.5 * SPACING, 0.5 * SPACING);
    add_scaled(p, gradient, -step)
}

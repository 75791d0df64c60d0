//! Skinning weights: the nearest bone, spread over the surface.

use super::skeleton::{BONES, JOINT_COUNT, MIRRORED_JOINT, distance_to_segment, mirrored};
use super::surface_nets::SymmetricMesh;
use crate::linalg::vector::Vector3;

/// Rounds of averaging: the transition between two bones is about ± spacing·√ROUNDS·0.8 ≈ ±5 cm wide.
const ROUNDS: usize = 14;

/// Non-zeros per vertex, as graphics hardware and SMPL have them.
const MAX_INFLUENCES: usize = 4;

/// V×24 row-major; rows sum to 1 and have at most four non-zeros.
///
/// Averaging over the surface, not through space, keeps a thigh from pulling at the other one.
pub(super) fn weights(mesh: &SymmetricMesh) -> Vec<f64> {
    let neighbours = mesh.neighbours();
    let count = mesh.vertices.len();
    let mut weights = vec![[0.0; JOINT_COUNT]; count];
    for (row, &p) in weights.iter_mut().zip(&mesh.vertices) {
        row[nearest_joint(p)] = 1.0;
    }
    for _ in 0..ROUNDS {
        weights = (0..count)
            .map(|v| {
                let share = 0.5 / neighbours[v].len() as f64;
                std::array::from_fn(|j| {
                    0.5 * weights[v][j] + share * neighbours[v].iter().map(|&w| weights[w][j]).sum::<f64>()
                })
            })
            .collect();
    }
    for row in &mut weights {
        keep_largest(row);
    }
    for v in 0..count {
        let m = mesh.mirror[v];
        if m == v {
            // On the seam a limb of one side counts as much as the same limb of the other.
            let row = weights[v];
            weights[v] = std::array::from_fn(|j| 0.5 * (row[j] + row[MIRRORED_JOINT[j]]));
            keep_largest(&mut weights[v]);
        } else if mesh.vertices[v][0] > 0.0 {
            let row = weights[v];
            weights[m] = std::array::from_fn(|j| row[MIRRORED_JOINT[j]]);
        }
    }
    weights.into_flattened()
}

/// The joint whose bone is nearest to `p`.
fn nearest_joint(p: Vector3) -> usize {
    let left = if p[0] < 0.0 { mirrored(p) } else { p };
    let (joint, _) = BONES
        .iter()
        .map(|&(joint, a, b)| (joint, distance_to_segment(left, a, b)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .expect("the table of bones is not empty");
    if p[0] < 0.0 { MIRRORED_JOINT[joint] } else { joint }
}

/// Zeroes all but the largest entries and makes the rest sum to 1.
///
/// Pairs of mirrored joints with equal weight stay or go together, so that the seam stays symmetric.
fn keep_largest(row: &mut [f64; JOINT_COUNT]) {
    let mut order: Vec<usize> = (0..JOINT_COUNT).filter(|&j| row[j] > 1e-3).collect();
    order.sort_by(|&a, &b| row[b].total_cmp(&row[a]));
    if order.len() > MAX_INFLUENCES {
        let cut_splits_a_pair = row[order[MAX_INFLUENCES - 1]] == row[order[MAX_INFLUENCES]];
        order.truncate(if cut_splits_a_pair { MAX_INFLUENCES - 1 } else { MAX_INFLUENCES });
    }
    let sum: f64 = order.iter().map(|&j| row[j]).sum();
    let mut kept = [0.0; JOINT_COUNT];
    for j in order {
        kept[j] = row[j] / sum;
    }
    *row = kept;
}

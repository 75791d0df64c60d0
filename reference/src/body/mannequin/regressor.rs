//! The mannequin's joint regressor: every joint as a convex combination of the skin around it.

use super::skeleton::{JOINT_COUNT, MIRRORED_JOINT, rest_joints};
use super::surface_nets::SymmetricMesh;
use crate::linalg::vector::{Vector3, distance, sub};

/// How many of the nearest vertices take part at first; joints deep in the body need more to be surrounded.
const NEAREST: usize = 100;

/// The fewest vertices that a joint may hang on: with fewer, one vertex that shape moves would drag the joint along.
const FEWEST: usize = 40;

/// J×V row-major: non-negative, rows sum to 1, and J_regressor · v_template are the rest joints.
pub(super) fn j_regressor(mesh: &SymmetricMesh) -> Vec<f64> {
    let count = mesh.vertices.len();
    let joints = rest_joints();
    let mut regressor = vec![0.0; JOINT_COUNT * count];
    for j in 0..JOINT_COUNT {
        let side = joints[j][0];
        if side < 0.0 {
            continue;
        }
        for (v, weight) in convex_combination(&mesh.vertices, joints[j]) {
            if side == 0.0 {
                regressor[j * count + v] += 0.5 * weight;
                regressor[j * count + mesh.mirror[v]] += 0.5 * weight;
            } else {
                regressor[j * count + v] = weight;
                regressor[MIRRORED_JOINT[j] * count + mesh.mirror[v]] = weight;
            }
        }
    }
    regressor
}

/// The most even weights w ≥ 0 over the nearest vertices with Σ w = 1 and Σ w v = `target`.
///
/// The neighbourhood grows by halves until the target lies well within its hull.
///
/// # Panics
/// If the target is not inside the skin at all.
fn convex_combination(vertices: &[Vector3], target: Vector3) -> Vec<(usize, f64)> {
    let mut order: Vec<usize> = (0..vertices.len()).collect();
    order.sort_by(|&a, &b| distance(vertices[a], target).total_cmp(&distance(vertices[b], target)));
    let mut nearest = NEAREST;
    while nearest <= order.len() {
        let weights = least_norm_weights(vertices, target, order[..nearest].to_vec());
        if weights.len() >= FEWEST {
            return weights;
        }
        nearest += nearest / 2;
    }
    panic!("convex_combination: {target:?} is not inside the skin");
}

/// Least norm under four linear conditions: w = A (AᵀA)⁻¹ e₁ with rows (1, v − target) in A.
///
/// Vertices that would get a negative weight are left out and the rest solved again, which ends because the set only
/// shrinks; it is empty where the target is outside of the hull.
fn least_norm_weights(vertices: &[Vector3], target: Vector3, mut active: Vec<usize>) -> Vec<(usize, f64)> {
    while active.len() >= FEWEST {
        let rows: Vec<[f64; 4]> = active
            .iter()
            .map(|&v| {
                let d = sub(vertices[v], target);
                [1.0, d[0], d[1], d[2]]
            })
            .collect();
        let multipliers = solve_normal_equations(&rows);
        let weights: Vec<f64> =
            rows.iter().map(|row| (0..4).map(|k| row[k] * multipliers[k]).sum::<f64>()).collect();
        if weights.iter().all(|&w| w >= 0.0) {
            return active.into_iter().zip(weights).collect();
        }
        active = active.into_iter().zip(&weights).filter(|(_, w)| **w >= 0.0).map(|(v, _)| v).collect();
    }
    Vec::new()
}

/// (Σ row rowᵀ)⁻¹ e₁ by Gauss–Jordan elimination with pivoting.
fn solve_normal_equations(rows: &[[f64; 4]]) -> [f64; 4] {
    let mut m = [[0.0; 5]; 4];
    for row in rows {
        for r in 0..4 {
            for c in 0..4 {
                m[r][c] += row[r] * row[c];
            }
        }
    }
    m[0][4] = 1.0;
    for k in 0..4 {
        let pivot = (k..4).max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs())).expect("four rows");
        m.swap(k, pivot);
        let lead = m[k][k];
        for r in 0..4 {
            if r != k {
                let factor = m[r][k] / lead;
                for c in k..5 {
                    m[r][c] -= factor * m[k][c];
                }
            }
        }
    }
    std::array::from_fn(|k| m[k][4] / m[k][k])
}

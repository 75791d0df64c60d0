//! The relative pose of two cameras by eight points: no start needed, exact for exact points off a critical surface.
//!
//! x_bᵀ E x_a = 0 is linear in E = \[t\]× R. The least-squares E of unit norm is the eigenvector of Σ w a aᵀ with the least
//! eigenvalue, a = x_b ⊗ x_a. The points are centred and scaled first, so that all nine entries weigh alike. The singular
//! value decomposition E = U S Vᵀ then gives R = ±U W Vᵀ and t = ±u₃, where W turns by 90° about z: the nearest essential
//! matrix has S = diag(1, 1, 0), and four poses share it. Points near a plane leave E open; any answer is then as good as
//! another, and it is for the caller to find a better one.
//!
//! # References
//! Longuet-Higgins 1981; Hartley 1997, "In defense of the eight-point algorithm".

use super::relative_pose::Match;
use crate::linalg::cholesky::Cholesky;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, column, determinant, mul, scaled, transpose};
use crate::linalg::svd::svd3;
use crate::linalg::vector::Vector3;

/// E has eight degrees of freedom in this form.
pub const LEAST_MATCHES: usize = 8;

/// Added to the normal matrix in units of its trace, so that it can be factored although exact points make it singular.
const SHIFT: f64 = 1e-13;
/// Inverse iterations: exact points need two, noisy ones come near enough for a descent.
const ITERATIONS: usize = 8;

/// One of the four poses (R, t) with ‖t‖ = 1 that share the essential matrix; `None` for fewer than [`LEAST_MATCHES`] or for
/// points that coincide or lie on a line in either picture.
pub fn eight_point(matches: &[Match]) -> Option<(Matrix3, Vector3)> {
    if matches.len() < LEAST_MATCHES {
        return None;
    }
    let (to_a, to_b) = (normalization(matches, |m| m.a)?, normalization(matches, |m| m.b)?);
    let moved = |t: &Matrix3, [x, y]: [f64; 2]| [t[0][0] * x + t[0][2], t[1][1] * y + t[1][2], 1.0];
    let mut normal = Dense::zeros(9, 9);
    for m in matches {
        let (a, b) = (moved(&to_a, m.a), moved(&to_b, m.b));
        let row: [f64; 9] = std::array::from_fn(|i| b[i / 3] * a[i % 3]);
        for i in 0..9 {
            for j in 0..=i {
                normal[(i, j)] += m.weight * row[i] * row[j];
            }
        }
    }
    let trace: f64 = (0..9).map(|i| normal[(i, i)]).sum();
    (0..9).for_each(|i| normal[(i, i)] += SHIFT * trace);
    let factor = Cholesky::factor(&normal)?;
    // No entry is special: a start orthogonal to the answer is as unlikely as can be.
    let mut e: Vec<f64> = (0..9).map(|i| (1.3 * i as f64 + 0.5).cos()).collect();
    for _ in 0..ITERATIONS {
        e = factor.solve(&e);
        let length = e.iter().map(|x| x * x).sum::<f64>().sqrt();
        e.iter_mut().for_each(|x| *x /= length);
    }
    if !e.iter().all(|x| x.is_finite()) {
        return None;
    }
    let essential = mul(&transpose(&to_b), &mul(&[0, 3, 6].map(|i| [e[i], e[i + 1], e[i + 2]]), &to_a));
    let svd = svd3(&essential);
    if svd.singular_values[1] <= 1e-6 * svd.singular_values[0] {
        return None;
    }
    const W: Matrix3 = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let rotation = mul(&svd.u, &mul(&W, &transpose(&svd.v)));
    Some((scaled(&rotation, determinant(&rotation).signum()), column(&svd.u, 2)))
}

/// The affine map that centres the points and gives each coordinate unit deviation; `None` if they do not spread.
fn normalization(matches: &[Match], of: fn(&Match) -> [f64; 2]) -> Option<Matrix3> {
    /// Points that spread less than this, in units of the focal length, are one.
    const LEAST_SIZE: f64 = 1e-4;
    let total: f64 = matches.iter().map(|m| m.weight).sum();
    let mean: [f64; 2] =
        std::array::from_fn(|i| matches.iter().map(|m| m.weight * of(m)[i]).sum::<f64>() / total);
    let deviation = |i: usize| {
        (matches.iter().map(|m| m.weight * (of(m)[i] - mean[i]).powi(2)).sum::<f64>() / total).sqrt()
    };
    let [sx, sy] = [deviation(0), deviation(1)];
    (sx > LEAST_SIZE && sy > LEAST_SIZE)
        .then(|| [[1.0 / sx, 0.0, -mean[0] / sx], [0.0, 1.0 / sy, -mean[1] / sy], [0.0, 0.0, 1.0]])
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{joints, person};
    use super::*;
    use crate::linalg::matrix::apply;
    use crate::linalg::vector::{add, distance, dot, normalize, scale};
    use crate::rotation::{angle_between, rodrigues};
    use std::f64::consts::{FRAC_PI_2, PI};

    /// Matches of points given in the first camera.
    fn matches(points: &[Vector3], rotation: &Matrix3, t: Vector3) -> Vec<Match> {
        let see = |[x, y, z]: Vector3| [x / z, y / z];
        let seen = |&p: &Vector3| Match { a: see(p), b: see(add(apply(rotation, p), t)), weight: 1.0 };
        points.iter().map(seen).collect()
    }

    /// A person who lies across the picture, 4 m away.
    fn lying() -> Vec<Vector3> {
        let turn = mul(&rodrigues([0.0, 0.0, FRAC_PI_2]), &rodrigues([PI, 0.0, 0.0]));
        joints(&person(2)).into_iter().map(|p| add(apply(&turn, p), [0.1, -0.1, 4.0])).collect()
    }

    /// The second camera looks at (0, 0, 4) from the same distance, `yaw` around and then `roll` about its axis.
    fn around(yaw: f64, roll: f64) -> (Matrix3, Vector3) {
        let rotation = mul(&rodrigues([0.0, 0.0, roll]), &rodrigues([0.2, yaw, 0.1]));
        let t = add([0.0, 0.0, 4.2], scale(apply(&rotation, [0.0, 0.0, 4.0]), -1.0));
        (rotation, t)
    }

    #[test]
    fn exact_matches_give_the_pose_whatever_the_roll() {
        for roll in [0.0, FRAC_PI_2, PI, -2.0] {
            let (rotation, t) = around(1.0, roll);
            let (found, direction) =
                eight_point(&matches(&lying(), &rotation, t)).expect("a person has depth");
            let twisted = mul(&rodrigues(scale(direction, PI)), &found);
            let error = angle_between(&found, &rotation).min(angle_between(&twisted, &rotation));
            assert!(error < 1e-5, "roll {roll}: {error} rad");
            assert!((dot(direction, normalize(t)).abs() - 1.0).abs() < 1e-9, "roll {roll}");
        }
    }

    #[test]
    fn the_pose_of_rolled_cameras_is_found_among_all() {
        for roll in [FRAC_PI_2, PI, -2.0] {
            let (rotation, t) = around(1.0, roll);
            let best = super::super::relative_pose::relative_poses(&matches(&lying(), &rotation, t), 1)[0];
            assert!(angle_between(&best.rotation, &rotation) < 1e-5, "roll {roll}");
            assert!(distance(best.translation, normalize(t)) < 1e-5, "roll {roll}");
        }
    }

    #[test]
    fn points_of_a_plane_a_line_or_one_place_do_no_harm() {
        let (rotation, t) = around(0.7, 0.0);
        let flat: Vec<Vector3> = lying().iter().map(|p| [p[0], p[1], 4.0 + 0.1 * p[0]]).collect();
        let flat = matches(&flat, &rotation, t);
        if let Some((found, direction)) = eight_point(&flat) {
            assert!(
                (determinant(&found) - 1.0).abs() < 1e-9 && (dot(direction, direction) - 1.0).abs() < 1e-9
            );
        }
        // A plane leaves two poses, which the other starts find, the truth among them, though descent is slow there.
        let poses = super::super::relative_pose::relative_poses(&flat, 4);
        let nearest =
            poses.iter().map(|p| angle_between(&p.rotation, &rotation)).fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.1 && poses[0].error < 1e-6, "{nearest} rad, {poses:?}");

        let line: Vec<Vector3> = lying().iter().map(|p| [p[0], 0.0, 4.0]).collect();
        assert!(eight_point(&matches(&line, &rodrigues([0.0, 0.5, 0.0]), [-2.0, 0.0, 0.5])).is_none());
        assert!(eight_point(&[Match { a: [0.1, 0.2], b: [0.0, 0.1], weight: 1.0 }; 9]).is_none());
        assert!(eight_point(&flat[..7]).is_none());
    }
}

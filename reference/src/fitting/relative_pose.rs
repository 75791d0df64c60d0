//! Two cameras from what both saw: rotation and direction of translation between them.
//!
//! A point at x_a in one camera and x_b in the other (normalised, depth 1) satisfies Longuet-Higgins' x_bᵀ \[t\]× R x_a = 0
//! for X_b = R X_a + t. The five unknowns are found by descent on Sampson's error from three kinds of starts, each of which
//! does what the others cannot:
//!
//! - a search over yaw: cameras around a person mostly stand upright at about one height and look at them, so that yaw and
//!   the person's place in both pictures fix R and t roughly;
//! - the most promising of a search over yaw and the quarter turns of both pictures, for rolled cameras;
//! - the direct solution by [eight points](eight_point), for any cameras at all, unless outliers decide or the points lie near
//!   a plane, as those of a person with spread arms do.
//!
//! What a plane leaves ambiguous comes out as two minima, both of which are reported.
//!
//! # References
//! Longuet-Higgins 1981; Sampson 1982; Hartley, Zisserman, "Multiple View Geometry in Computer Vision", ch. 9 and 11.

use super::eight_point::eight_point;
use crate::linalg::cholesky::Cholesky;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, apply, mul, transpose};
use crate::linalg::vector::{Vector3, add, cross, dot, norm, normalize, scale, sub};
use crate::robust_loss::{rho, weight};
use crate::rotation::{angle_between, rodrigues};
use std::f64::consts::{PI, TAU};

/// A point seen in both cameras.
#[derive(Clone, Copy, Debug)]
pub struct Match {
    /// Normalised coordinates in the first camera.
    pub a: [f64; 2],
    /// And in the second.
    pub b: [f64; 2],
    /// How much it counts.
    pub weight: f64,
}

/// X_b = R X_a + t with ‖t‖ = 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativePose {
    /// R.
    pub rotation: Matrix3,
    /// t, of length 1.
    pub translation: Vector3,
    /// Σ w ρ(Sampson's error).
    pub error: f64,
}

/// The least number of matches: five unknowns and one to tell good from bad.
pub const LEAST_MATCHES: usize = 6;

/// σ of the loss, in units of the focal length: 8 px at f = 400 px.
const SIGMA: f64 = 0.02;
/// Starts of the search over yaw.
const YAWS: usize = 12;
/// Rolled starts from which to descend: those of least error.
const ROLLED: usize = 8;
const MAX_ITERATIONS: usize = 12;
/// Points that spread less than this, in units of the focal length, are one.
const LEAST_SIZE: f64 = 1e-4;
/// Two answers closer than this are one.
const SAME_RAD: f64 = 0.1;

/// The relative poses that explain the matches, best first; at most `limit`, and none for fewer than [`LEAST_MATCHES`].
pub fn relative_poses(matches: &[Match], limit: usize) -> Vec<RelativePose> {
    if matches.len() < LEAST_MATCHES {
        return Vec::new();
    }
    let mut found: Vec<RelativePose> = Vec::new();
    for start in starts(matches) {
        let pose = in_front(matches, descend(matches, start));
        let same = |other: &&mut RelativePose| {
            angle_between(&other.rotation, &pose.rotation) < SAME_RAD
                && dot(other.translation, pose.translation) > SAME_RAD.cos()
        };
        match found.iter_mut().find(same) {
            Some(other) if other.error <= pose.error => {}
            Some(other) => *other = pose,
            None => found.push(pose),
        }
    }
    found.retain(|pose| pose.error.is_finite());
    found.sort_by(|a, b| a.error.total_cmp(&b.error));
    found.truncate(limit);
    found
}

/// The depths of a match in both cameras, in units of ‖t‖: the ends of the shortest segment between the rays; `None` if they
/// are parallel.
pub fn depths(pose: &RelativePose, m: &Match) -> Option<[f64; 2]> {
    let ray_a = apply(&pose.rotation, [m.a[0], m.a[1], 1.0]);
    let ray_b = [m.b[0], m.b[1], 1.0];
    // λ_b ray_b − λ_a ray_a = t in least squares.
    let (aa, bb, ab) = (dot(ray_a, ray_a), dot(ray_b, ray_b), dot(ray_a, ray_b));
    let determinant = aa * bb - ab * ab;
    if determinant <= 1e-9 * aa * bb {
        return None;
    }
    let (at, bt) = (dot(ray_a, pose.translation), dot(ray_b, pose.translation));
    Some([(ab * bt - bb * at) / determinant, (aa * bt - ab * at) / determinant])
}

/// Upright cameras, the best rolled ones, and the solution by eight points.
fn starts(matches: &[Match]) -> Vec<RelativePose> {
    let (a, b) = (Extent::of(matches, |m| m.a), Extent::of(matches, |m| m.b));
    let yaw = |n: usize| rodrigues([0.0, TAU * n as f64 / YAWS as f64, 0.0]);
    let mut starts: Vec<RelativePose> = (1..YAWS)
        .filter_map(|n| looking_at_the_same(yaw(n), (a.middle, a.size[1]), (b.middle, b.size[1])))
        .collect();

    // Quarter turns, written out so that they are free of rounding.
    let roll = |n: usize| {
        let [cos, sin] = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]][n];
        [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
    };
    let (size_a, size_b) = (a.size[0].hypot(a.size[1]), b.size[0].hypot(b.size[1]));
    let mut rolled: Vec<RelativePose> = (0..16 * YAWS)
        .filter_map(|n| {
            let rotation = mul(&roll(n % 4), &mul(&yaw(n / 16), &roll(n / 4 % 4)));
            let start = looking_at_the_same(rotation, (a.middle, size_a), (b.middle, size_b))?;
            let error = total_error(&start.rotation, start.translation, matches);
            Some(RelativePose { error, ..start })
        })
        .collect();
    rolled.sort_by(|p, q| p.error.total_cmp(&q.error));
    rolled.truncate(ROLLED);
    starts.extend(rolled);

    let direct = eight_point(matches);
    starts.extend(direct.map(|(rotation, translation)| RelativePose {
        rotation,
        translation,
        error: f64::INFINITY,
    }));
    starts
}

/// Where points are in a picture, and how far they spread across and down.
struct Extent {
    middle: [f64; 2],
    size: [f64; 2],
}

impl Extent {
    fn of(matches: &[Match], at: fn(&Match) -> [f64; 2]) -> Extent {
        let total: f64 = matches.iter().map(|m| m.weight).sum();
        let middle: [f64; 2] =
            std::array::from_fn(|i| matches.iter().map(|m| m.weight * at(m)[i]).sum::<f64>() / total);
        let square =
            |i: usize| matches.iter().map(|m| m.weight * (at(m)[i] - middle[i]).powi(2)).sum::<f64>();
        Extent { middle, size: std::array::from_fn(|i| (square(i) / total).sqrt()) }
    }
}

/// Cameras turned against each other, with the middle of the points where both see it (`middle`, `size`); distances are
/// inverse to the size.
fn looking_at_the_same(
    rotation: Matrix3,
    (a, size_a): ([f64; 2], f64),
    (b, size_b): ([f64; 2], f64),
) -> Option<RelativePose> {
    if size_a.is_nan() || size_b.is_nan() || size_a < LEAST_SIZE || size_b < LEAST_SIZE {
        return None;
    }
    let at = |[x, y]: [f64; 2], size: f64| scale([x, y, 1.0], 1.0 / size);
    let translation = sub(at(b, size_b), apply(&rotation, at(a, size_a)));
    (norm(translation) > 0.0).then(|| RelativePose {
        rotation,
        translation: normalize(translation),
        error: f64::INFINITY,
    })
}

/// x_bᵀ \[t\]× R x_a over the length of its gradient by the four coordinates; with R x_a and that length.
fn sampson(rotation: &Matrix3, translation: Vector3, m: &Match) -> (f64, Vector3, f64) {
    let turned = apply(rotation, [m.a[0], m.a[1], 1.0]);
    let x_b = [m.b[0], m.b[1], 1.0];
    let line_b = cross(translation, turned);
    let line_a = apply(&transpose(rotation), cross(x_b, translation));
    let length =
        (line_b[0].powi(2) + line_b[1].powi(2) + line_a[0].powi(2) + line_a[1].powi(2)).sqrt().max(1e-12);
    (dot(x_b, line_b) / length, turned, length)
}

fn total_error(rotation: &Matrix3, translation: Vector3, matches: &[Match]) -> f64 {
    matches.iter().map(|m| m.weight * rho(sampson(rotation, translation, m).0, SIGMA)).sum()
}

/// Levenberg–Marquardt on Σ w ρ(error) over exp(ω) R and t on the unit sphere.
fn descend(matches: &[Match], start: RelativePose) -> RelativePose {
    let RelativePose { mut rotation, mut translation, .. } = start;
    let mut least = total_error(&rotation, translation, matches);
    let mut damping = 1e-3;
    for _ in 0..MAX_ITERATIONS {
        let across = tangents(translation);
        let mut gram = Dense::zeros(5, 5);
        let mut gradient = [0.0; 5];
        for m in matches {
            let (e, turned, length) = sampson(&rotation, translation, m);
            let x_b = [m.b[0], m.b[1], 1.0];
            // The length is held: its change matters little near a solution.
            let by_t = cross(turned, x_b);
            // x_b · (t × (ω × turned)) = ω · (turned × (x_b × t)).
            let by_turn = cross(turned, cross(x_b, translation));
            let row = [by_turn[0], by_turn[1], by_turn[2], dot(across[0], by_t), dot(across[1], by_t)];
            let w = m.weight * weight(e, SIGMA);
            for i in 0..5 {
                gradient[i] += w * e * row[i] / length;
                for j in 0..=i {
                    gram[(i, j)] += w * row[i] * row[j] / (length * length);
                }
            }
        }
        for i in 0..5 {
            gram[(i, i)] *= 1.0 + damping;
            gram[(i, i)] += 1e-12;
        }
        let Some(step) = Cholesky::factor(&gram).map(|c| c.solve(&gradient)) else { break };
        let turn = rodrigues([-step[0], -step[1], -step[2]]);
        let moved = add(translation, add(scale(across[0], -step[3]), scale(across[1], -step[4])));
        let (new_rotation, new_translation) = (mul(&turn, &rotation), normalize(moved));
        let error = total_error(&new_rotation, new_translation, matches);
        if error < least {
            let settled = least - error < 1e-6 * least;
            (rotation, translation, least) = (new_rotation, new_translation, error);
            damping *= 0.2;
            if settled {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    RelativePose { rotation, translation, error: least }
}

/// Two unit vectors orthogonal to a unit vector and to each other.
fn tangents(t: Vector3) -> [Vector3; 2] {
    let other = if t[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let first = normalize(cross(t, other));
    [first, cross(t, first)]
}

/// Of the four poses that share an essential matrix (t or −t, R or R turned by π about t) the one with most points in front of
/// both cameras.
fn in_front(matches: &[Match], pose: RelativePose) -> RelativePose {
    let twisted = mul(&rodrigues(scale(pose.translation, PI)), &pose.rotation);
    let mut best = (0.0, pose);
    for rotation in [pose.rotation, twisted] {
        for translation in [pose.translation, scale(pose.translation, -1.0)] {
            let candidate = RelativePose { rotation, translation, ..pose };
            let in_front = |m: &&Match| depths(&candidate, m).is_some_and(|d| d[0] > 0.0 && d[1] > 0.0);
            let count: f64 = matches.iter().filter(in_front).map(|m| m.weight).sum();
            if count > best.0 {
                best = (count, candidate);
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{joints, joints_in_view_0, person, ring};
    use super::*;
    use crate::linalg::vector::distance;

    /// Two cameras of the ring, what they see of a person, and the truth between them.
    fn planted(seed: u32, other: usize) -> (Vec<Match>, Matrix3, Vector3) {
        let (person, cameras) = (person(seed), ring(other + 1));
        let see = |i: usize, p: Vector3| {
            let [x, y, z] = cameras[i].to_camera(p);
            [x / z, y / z]
        };
        let matches = joints(&person)
            .into_iter()
            .map(|p| Match { a: see(0, p), b: see(other, p), weight: 1.0 })
            .collect();
        let rotation = mul(&cameras[other].rotation, &transpose(&cameras[0].rotation));
        let t = sub(cameras[other].translation, apply(&rotation, cameras[0].translation));
        (matches, rotation, t)
    }

    #[test]
    fn exact_matches_give_the_pose_and_the_depths() {
        for seed in 0..4 {
            for other in 1..4 {
                let (matches, rotation, t) = planted(seed, other);
                let best = relative_poses(&matches, 3)[0];
                assert!(angle_between(&best.rotation, &rotation) < 1e-5, "person {seed}, camera {other}");
                assert!(distance(best.translation, normalize(t)) < 1e-5, "person {seed}, camera {other}");
                let points = joints_in_view_0(&person(seed), &ring(1));
                for (m, p) in matches.iter().zip(points) {
                    let [depth, _] = depths(&best, m).expect("a baseline");
                    assert!((depth * norm(t) - p[2]).abs() < 1e-3, "{depth} for {}", p[2]);
                }
            }
        }
    }

    #[test]
    fn a_wrong_match_does_not_decide() {
        let (mut matches, rotation, _) = planted(1, 1);
        matches[5].b[1] += 0.3;
        let best = relative_poses(&matches, 1)[0];
        let error = angle_between(&best.rotation, &rotation);
        assert!(error < 0.1, "{error} rad");
    }

    #[test]
    fn too_few_or_coincident_matches_have_no_pose() {
        let (matches, ..) = planted(0, 1);
        assert!(relative_poses(&matches[..5], 3).is_empty());
        assert!(relative_poses(&[Match { a: [0.1, 0.2], b: [0.0, 0.1], weight: 1.0 }; 8], 3).is_empty());
    }
}

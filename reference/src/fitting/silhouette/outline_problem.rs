//! Pose, shape and translation from outlines and keypoints: one round of our extension of chapter 3.
//!
//! ```text
//! E(θ, β, t, b) = Σ ρ(n·(Π(s(θ, β, t)) − c) + b)/σ_c² + Σ w² ρ(Π(J(θ, β, t)) − k)/σ_k² + ‖θ − θ₀‖²/σ_θ² + ‖β‖² + b²/σ_b²
//! ```
//!
//! c is a point of a mask's outline with the normal n, s the point of the body's outline that belongs to it, k a keypoint.
//! Every term is in standard deviations, so that E is twice the negative logarithm of a probability. Only the distance
//! *along the normal* counts: where along the outline a vertex lies is not in the picture. Keypoints alone leave the turn of
//! limbs about their axes and much of the shape open; seven hundred outline points a view, each good to half a pixel, do not.
//!
//! b is how many pixels the masks are too large all round: segmentations usually are too large or too small by a pixel, and a
//! body cannot explain that but by growing fat. That heads, hands and limbs all grow alike is what tells b from β.
//!
//! If the cameras' extrinsics are not known, those of all views but the first are unknowns too: the joint fit that they come
//! from knew two dozen points a view.
//!
//! s lies on an edge of the body's outline, at a fixed fraction between its ends within the round; both ends move exactly.

use crate::body::BodyModel;
use crate::body::skeleton::Skeleton;
use crate::camera::{Matrix2x3, Pinhole, PixelDerivative};
use crate::fitting::keypoint_set::BodyPoint;
use crate::least_squares::Problem;
use crate::linalg::dense::Dense;
use crate::linalg::matrix::{Matrix3, apply_transposed, mul};
use crate::linalg::vector::{Vector3, ZERO, add, add_scaled};
use crate::robust_loss;
use crate::rotation::{left_jacobian, rodrigues};

/// A point of the body's outline and the point of the mask's outline that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlinePair {
    /// The view.
    pub view: usize,
    /// The ends of the edge.
    pub vertices: [u32; 2],
    /// How far from the first to the second, 0…1.
    pub fraction: f64,
    /// c.
    pub pixel_px: [f64; 2],
    /// n.
    pub normal: [f64; 2],
    /// How many contour points it counts for, squared residuals.
    pub count: f64,
    /// σ of ρ, pixels: contour points further off lose their say.
    pub robust_px: f64,
}

/// A keypoint in a view.
#[derive(Clone, Debug, PartialEq)]
pub struct KeypointPair {
    /// The view.
    pub view: usize,
    /// Where it lies on the body.
    pub point: BodyPoint,
    /// k.
    pub pixel_px: [f64; 2],
    /// w: base weight times confidence.
    pub weight: f64,
}

/// The standard deviations of the terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigmas {
    /// σ_c, pixels.
    pub contour_px: f64,
    /// σ_k, pixels.
    pub keypoint_px: f64,
    /// σ_θ, radians; the root is free.
    pub pose_rad: f64,
    /// σ_b, pixels; 0: b is 0.
    pub mask_bias_px: f64,
}

impl Sigmas {
    /// Where a keypoint's error begins to count as a wrong detection rather than noise: five standard deviations.
    fn keypoint_robust_px(&self) -> f64 {
        5.0 * self.keypoint_px
    }
}

/// One round's problem; x is θ (3J), β (B), t (3), b, and, if cameras are free, for each view but the first a turn δ
/// (axis–angle, exp(δ)·R) and a shift τ (t + τ).
pub struct OutlineProblem<'a> {
    /// The body.
    pub body: &'a BodyModel,
    /// Its skeleton.
    pub skeleton: &'a Skeleton,
    /// The cameras of the views, at the start of the round.
    pub cameras: &'a [Pinhole],
    /// Whether those of the views from the second on are unknowns.
    pub cameras_free: bool,
    /// The offsets, which stay.
    pub offsets: &'a [Vector3],
    /// The outline pairs.
    pub outline: &'a [OutlinePair],
    /// The keypoints.
    pub keypoints: &'a [KeypointPair],
    /// θ₀.
    pub prior_pose: &'a [f64],
    /// The standard deviations.
    pub sigmas: Sigmas,
    /// The vertices in use, ascending, and the place of every vertex among them.
    chosen: Vec<u32>,
    slots: Vec<u32>,
}

impl<'a> OutlineProblem<'a> {
    /// The problem of these pairs.
    pub fn new(
        body: &'a BodyModel,
        skeleton: &'a Skeleton,
        cameras: &'a [Pinhole],
        cameras_free: bool,
        offsets: &'a [Vector3],
        outline: &'a [OutlinePair],
        keypoints: &'a [KeypointPair],
        prior_pose: &'a [f64],
        sigmas: Sigmas,
    ) -> OutlineProblem<'a> {
        let mut slots = vec![u32::MAX; body.vertex_count()];
        let mut chosen: Vec<u32> = outline.iter().flat_map(|pair| pair.vertices).collect();
        chosen.extend(keypoints.iter().filter_map(|pair| match pair.point {
            BodyPoint::Vertex(vertex) => Some(vertex as u32),
            BodyPoint::Joints(_) => None,
        }));
        chosen.sort_unstable();
        chosen.dedup();
        for (slot, vertex) in chosen.iter().enumerate() {
            slots[*vertex as usize] = slot as u32;
        }
        OutlineProblem {
            body,
            skeleton,
            cameras,
            cameras_free,
            offsets,
            outline,
            keypoints,
            prior_pose,
            sigmas,
            chosen,
            slots,
        }
    }

    /// θ, β, t, b and the cameras' changes, of an x.
    fn split<'x>(&self, x: &'x [f64]) -> (&'x [f64], &'x [f64], Vector3, f64, &'x [f64]) {
        let (pose, rest) = x.split_at(self.prior_pose.len());
        let (betas, rest) = rest.split_at(rest.len() - 4 - self.camera_unknowns());
        (pose, betas, [rest[0], rest[1], rest[2]], rest[3], &rest[4..])
    }

    fn camera_unknowns(&self) -> usize {
        if self.cameras_free { 6 * (self.cameras.len() - 1) } else { 0 }
    }

    /// x at the start of a round.
    pub fn start(&self, pose: &[f64], betas: &[f64], trans: Vector3, mask_bias_px: f64) -> Vec<f64> {
        let still = vec![0.0; self.camera_unknowns()];
        [pose, betas, &trans, &[mask_bias_px], &still].concat()
    }

    /// θ, β, t, b and the cameras of an x.
    pub fn finish(&self, x: &[f64]) -> (Vec<f64>, Vec<f64>, Vector3, f64, Vec<Pinhole>) {
        let (pose, betas, trans, bias, changes) = self.split(x);
        (pose.to_vec(), betas.to_vec(), trans, bias, self.cameras_at(changes))
    }

    /// 1/σ_b; where b is not sought its residual is b itself, and nothing else depends on it.
    fn bias_slope(&self) -> f64 {
        if self.sigmas.mask_bias_px > 0.0 { 1.0 / self.sigmas.mask_bias_px } else { 1.0 }
    }

    fn cameras_at(&self, changes: &[f64]) -> Vec<Pinhole> {
        let mut cameras = self.cameras.to_vec();
        for (camera, d) in cameras[1..].iter_mut().zip(changes.chunks_exact(6)) {
            camera.rotation = mul(&rodrigues([d[0], d[1], d[2]]), &camera.rotation);
            camera.translation = add(camera.translation, [d[3], d[4], d[5]]);
        }
        cameras
    }

    fn slot(&self, vertex: u32) -> usize {
        self.slots[vertex as usize] as usize
    }

    /// n·(Π(s) − c) + b, pixels.
    fn miss(&self, pair: &OutlinePair, camera: &Pinhole, places: &[Vector3], bias: f64) -> Option<f64> {
        let [a, b] = pair.vertices.map(|vertex| camera.project(places[self.slot(vertex)]));
        let (a, b) = (a?, b?);
        let along =
            |axis: usize| (1.0 - pair.fraction) * a[axis] + pair.fraction * b[axis] - pair.pixel_px[axis];
        Some(pair.normal[0] * along(0) + pair.normal[1] * along(1) + bias)
    }

    fn keypoint(&self, point: &BodyPoint, joints: &[Vector3], places: &[Vector3]) -> Vector3 {
        match point {
            BodyPoint::Joints(weights) => {
                weights.iter().fold(ZERO, |sum, (j, w)| add_scaled(sum, joints[*j], *w))
            }
            BodyPoint::Vertex(vertex) => places[self.slot(*vertex as u32)],
        }
    }

    /// Every chosen vertex: its place, and its derivative by x, 3×n.
    fn places_by_body(&self, x: &[f64]) -> (Vec<Vector3>, Vec<f64>) {
        let (pose, betas, trans, ..) = self.split(x);
        let posed = self.body.at_pose(self.skeleton, pose, betas, self.offsets, trans);
        let (p, b, n) = (pose.len(), betas.len(), x.len());
        let mut derivatives = vec![0.0; 3 * n * self.chosen.len()];
        let (mut by_pose, mut by_betas) = (vec![0.0; 3 * p], vec![0.0; 3 * b]);
        for (&vertex, into) in self.chosen.iter().zip(derivatives.chunks_exact_mut(3 * n)) {
            posed.by_pose(vertex as usize, &mut by_pose);
            posed.by_betas(vertex as usize, &mut by_betas);
            for axis in 0..3 {
                let row = &mut into[axis * n..(axis + 1) * n];
                row[..p].copy_from_slice(&by_pose[axis * p..(axis + 1) * p]);
                row[p..p + b].copy_from_slice(&by_betas[axis * b..(axis + 1) * b]);
                row[p + b + axis] = 1.0;
            }
        }
        (self.chosen.iter().map(|&vertex| posed.position(vertex as usize)).collect(), derivatives)
    }

    fn joints(&self, pose: &[f64], betas: &[f64], trans: Vector3) -> Vec<Vector3> {
        self.skeleton.posed_joints(pose, betas).into_iter().map(|joint| add(joint, trans)).collect()
    }
}

impl Problem for OutlineProblem<'_> {
    type Jacobian = Dense;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        let (pose, betas, trans, bias, changes) = self.split(x);
        let cameras = self.cameras_at(changes);
        let posed = self.body.at_pose(self.skeleton, pose, betas, self.offsets, trans);
        let places: Vec<Vector3> = self.chosen.iter().map(|&v| posed.position(v as usize)).collect();
        let joints = self.joints(pose, betas, trans);
        let mut r = Vec::with_capacity(self.outline.len() + 2 * self.keypoints.len() + x.len());
        for pair in self.outline {
            let miss =
                robust_loss::residual(self.miss(pair, &cameras[pair.view], &places, bias)?, pair.robust_px);
            r.push(pair.count.sqrt() / self.sigmas.contour_px * miss);
        }
        for pair in self.keypoints {
            let [u, v] = cameras[pair.view].project(self.keypoint(&pair.point, &joints, &places))?;
            let weight = pair.weight / self.sigmas.keypoint_px;
            let robust = |miss: f64| weight * robust_loss::residual(miss, self.sigmas.keypoint_robust_px());
            r.extend([robust(u - pair.pixel_px[0]), robust(v - pair.pixel_px[1])]);
        }
        r.extend(pose.iter().zip(self.prior_pose).skip(3).map(|(t, t0)| (t - t0) / self.sigmas.pose_rad));
        r.extend(betas);
        r.push(self.bias_slope() * bias);
        Some(r)
    }

    fn jacobian(&self, x: &[f64]) -> Dense {
        let (pose, betas, trans, bias, changes) = self.split(x);
        let cameras = self.cameras_at(changes);
        let turns: Vec<Matrix3> =
            changes.chunks_exact(6).map(|d| left_jacobian([d[0], d[1], d[2]])).collect();
        let (p, b, n) = (pose.len(), betas.len(), x.len());
        let (places, derivatives) = self.places_by_body(x);
        let joints = self.joints(pose, betas, trans);
        let of_joints = self.skeleton.joint_derivatives(pose, betas);
        // Σ_c g_c ∂pixel_c/∂(camera), into the columns of the view.
        let add_camera = |row: &mut [f64], view: usize, pixel: &PixelDerivative, g: [f64; 2]| {
            if !self.cameras_free || view == 0 {
                return;
            }
            let along = |m: &Matrix2x3| [0, 1, 2].map(|axis| g[0] * m[0][axis] + g[1] * m[1][axis]);
            let turned = apply_transposed(&turns[view - 1], along(&pixel.rotation));
            let at = p + b + 4 + 6 * (view - 1);
            add_row(&mut row[at..at + 3], &turned, 1.0);
            add_row(&mut row[at + 3..at + 6], &along(&pixel.translation), 1.0);
        };

        let rows = self.outline.len() + 2 * self.keypoints.len() + (p - 3) + b + 1;
        let mut jacobian = vec![0.0; rows * n];
        let mut next = jacobian.chunks_exact_mut(n);
        for pair in self.outline {
            let row = next.next().expect("a row for every pair");
            let camera = &cameras[pair.view];
            let Some(miss) = self.miss(pair, camera, &places, bias) else { continue };
            let slope = pair.count.sqrt() / self.sigmas.contour_px
                * robust_loss::residual_derivative(miss, pair.robust_px);
            if self.sigmas.mask_bias_px > 0.0 {
                row[p + b + 3] = slope;
            }
            for (end, share) in [1.0 - pair.fraction, pair.fraction].into_iter().enumerate() {
                let slot = self.slot(pair.vertices[end]);
                let Some(pixel) = camera.project_derivative(places[slot]) else { continue };
                let g = pair.normal.map(|n| slope * share * n);
                for axis in 0..3 {
                    let along = g[0] * pixel.point[0][axis] + g[1] * pixel.point[1][axis];
                    add_row(row, &derivatives[(3 * slot + axis) * n..(3 * slot + axis + 1) * n], along);
                }
                add_camera(row, pair.view, &pixel, g);
            }
        }
        for pair in self.keypoints {
            let rows = [(); 2].map(|()| next.next().expect("two rows for every keypoint"));
            let place = self.keypoint(&pair.point, &joints, &places);
            let camera = &cameras[pair.view];
            let (Some(at), Some(pixel)) = (camera.project(place), camera.project_derivative(place)) else {
                continue;
            };
            for (c, row) in rows.into_iter().enumerate() {
                let robust_px = self.sigmas.keypoint_robust_px();
                let slope = pair.weight / self.sigmas.keypoint_px
                    * robust_loss::residual_derivative(at[c] - pair.pixel_px[c], robust_px);
                for axis in 0..3 {
                    let along = slope * pixel.point[c][axis];
                    match &pair.point {
                        BodyPoint::Vertex(vertex) => {
                            let at = 3 * self.slot(*vertex as u32) + axis;
                            add_row(row, &derivatives[at * n..(at + 1) * n], along);
                        }
                        BodyPoint::Joints(weights) => {
                            for &(j, w) in weights {
                                add_row(&mut row[..p], of_joints.by_pose.row(3 * j + axis), along * w);
                                add_row(&mut row[p..p + b], of_joints.by_betas.row(3 * j + axis), along * w);
                            }
                            row[p + b + axis] += along;
                        }
                    }
                }
                add_camera(row, pair.view, &pixel, if c == 0 { [slope, 0.0] } else { [0.0, slope] });
            }
        }
        for k in 3..p {
            next.next().expect("a row for every angle")[k] = 1.0 / self.sigmas.pose_rad;
        }
        for l in 0..b {
            next.next().expect("a row for every beta")[p + l] = 1.0;
        }
        next.next().expect("a row for the bias")[p + b + 3] = self.bias_slope();
        Dense::new(rows, n, jacobian)
    }
}

/// `row` += `factor` · `from`.
fn add_row(row: &mut [f64], from: &[f64], factor: f64) {
    for (sum, x) in row.iter_mut().zip(from) {
        *sum += factor * x;
    }
}

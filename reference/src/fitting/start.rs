//! Where a fit begins: one start as the thesis has it, or several from the geometry of the views.
//!
//! | views | cameras | starts |
//! |---|---|---|
//! | any | any | [`identity`](Evidence::identity): rest pose, facing view 0, R_i = I, translations from the torso |
//! | ≥ 2 | known | [`triangulated`](Evidence::triangulated): joints in space, then inverse kinematics |
//! | ≥ 2 | unknown | [`structures`](Evidence::structures): two views give points, the points give the other views, then as above |
//! | any | any | [`templates`](Evidence::templates): the rest torso seen from several yaws, front and back |
//!
//! Several starts are a search over basins, not over answers: the fit descends a little from each and keeps the best.

use super::camera_init::Torso;
use super::figure::Figure;
use super::inverse_kinematics::{Placed, TORSO, bone_lengths, inverse_kinematics};
use super::keypoint_set::BodyPoint;
use super::observation::{Extrinsics, Observation};
use super::relative_pose::{Match, RelativePose, depths, relative_poses};
use super::resection::{LEAST_LANDMARKS, Landmark, Resected, resect};
use super::result::Parameters;
use super::triangulation::{Sighting, triangulate};
use crate::body::Hinge;
use crate::camera::Pinhole;
use crate::linalg::matrix::{IDENTITY, Matrix3, apply, apply_transposed, mul, transpose};
use crate::linalg::vector::{Vector3, ZERO, add, scale, sub};
use crate::rotation::{angle_between, logarithm, rodrigues};
use std::f64::consts::PI;

/// Lengths of bones between triangulated joints are trusted to this, metres.
const BONE_DEVIATION_M: f64 = 0.02;
/// Structures that are refined into bodies.
const MOST_STRUCTURES: usize = 4;
/// Candidates of one pair of views.
const POSES_OF_A_PAIR: usize = 2;
/// Combinations of templates that are refined.
const MOST_TEMPLATES: usize = 4;
/// σ of the loss while cameras are sought, in units of the focal length: of exact points, and of a torso at rest.
const POINT_SIGMA: f64 = 0.02;
const TEMPLATE_SIGMA: f64 = 0.1;
/// Rotations closer than this belong to one basin.
const SAME_RAD: f64 = 0.25;

/// What the starts are made from.
#[derive(Clone, Debug)]
pub struct Evidence<'a> {
    figure: &'a Figure<'a>,
    observation: &'a Observation,
    hinges: &'a [Hinge],
    /// The mark of every joint in every view, N×J; a keypoint between joints marks the first of them.
    marks: Vec<Vec<Option<Mark>>>,
}

#[derive(Clone, Copy, Debug)]
struct Mark {
    pixel_px: [f64; 2],
    normalized: [f64; 2],
    weight: f64,
}

/// Cameras and points of one frame and unit.
struct Structure {
    cameras: Vec<(Matrix3, Vector3)>,
    error: f64,
}

impl<'a> Evidence<'a> {
    /// Reads the marks. Base weights do not count here: hips that detectors place elsewhere still say where the torso is.
    pub fn new(figure: &'a Figure<'a>, observation: &'a Observation, hinges: &'a [Hinge]) -> Evidence<'a> {
        let joints = figure.skeleton().joint_count();
        let marks = observation
            .views
            .iter()
            .map(|view| {
                let mut marks = vec![None; joints];
                for (keypoint, on_body) in view.keypoints.iter().zip(figure.keypoints()) {
                    let Some(BodyPoint::Joints(from)) = on_body.as_ref().map(|b| &b.point) else { continue };
                    if keypoint.confidence > 0.0
                        && let Some(normalized) = view.camera.normalized(keypoint.pixel_px)
                    {
                        let (pixel_px, weight) = (keypoint.pixel_px, keypoint.confidence);
                        marks[from[0].0] = Some(Mark { pixel_px, normalized, weight });
                    }
                }
                marks
            })
            .collect();
        Evidence { figure, observation, hinges, marks }
    }

    /// All starts of the robust mode, the likeliest first.
    pub fn robust(&self) -> Vec<Parameters> {
        match self.observation.extrinsics {
            Extrinsics::Known => {
                let found = self.triangulated(&self.given_cameras(), 1.0);
                if found.is_some() { found.into_iter().collect() } else { self.templates() }
            }
            Extrinsics::Unknown => {
                // In turns: the two kinds fail for different reasons, so that their agreement means something.
                let (mut structures, mut templates) =
                    (self.structures().into_iter(), self.templates().into_iter());
                let mut starts = Vec::new();
                loop {
                    let before = starts.len();
                    starts.extend(structures.next());
                    starts.extend(templates.next());
                    if starts.len() == before {
                        return starts;
                    }
                }
            }
        }
    }

    fn given_cameras(&self) -> Vec<Pinhole> {
        self.observation.views.iter().map(|v| v.camera).collect()
    }

    /// The rest pose, facing view 0, with R_i = I for unknown cameras: the thesis' start, translations by the camera step.
    ///
    /// A view without torso keeps its distance from similar triangles of all its marks. `None` if view 0 says nothing.
    pub fn identity(&self) -> Option<Parameters> {
        let skeleton = self.figure.skeleton();
        let betas = vec![0.0; skeleton.beta_count()];
        let facing = rodrigues([PI, 0.0, 0.0]);
        let at_rest = skeleton.rest_joints(&betas);
        let mut cameras = self.given_cameras();
        if self.observation.extrinsics == Extrinsics::Known {
            let seen = (0..cameras.len()).find_map(|i| Some((i, self.torso_camera(i, &at_rest, &facing)?)));
            let (view, seen) = seen?;
            let placed = self.placed_in_view(view, &(seen.rotation, seen.translation), &cameras);
            return Some(Parameters { pose: placed.pose, betas, trans: placed.trans, cameras });
        }
        // Camera i sees the body as (R_i′, t_i′) from its own frame; the world is view 0's.
        let seen: Vec<Pinhole> =
            (0..cameras.len()).map(|i| self.torso_camera(i, &at_rest, &facing)).collect::<Option<_>>()?;
        let placed = self.placed(&(seen[0].rotation, seen[0].translation));
        for (camera, own) in cameras.iter_mut().zip(&seen) {
            let relative =
                relative_to(&(own.rotation, own.translation), &(seen[0].rotation, seen[0].translation));
            (camera.rotation, camera.translation) = relative;
        }
        Some(Parameters { pose: placed.pose, betas, trans: placed.trans, cameras })
    }

    /// The camera step of view i on the rest torso, from a body that faces it.
    fn torso_camera(&self, i: usize, at_rest: &[Vector3], facing: &Matrix3) -> Option<Pinhole> {
        let camera = &self.observation.views[i].camera;
        let corners = [16, 17, 1, 2];
        let pixels = corners.map(|j| self.marks[i][j].map(|m| m.pixel_px));
        if let [Some(a), Some(b), Some(c), Some(d)] = pixels {
            let torso = Torso { points: corners.map(|j| at_rest[j]), pixels_px: [a, b, c, d] };
            if let Some(found) = torso.camera(camera, facing) {
                return Some(found);
            }
        }
        let found = resect(&self.landmarks(i, at_rest), facing, TEMPLATE_SIGMA, usize::MAX);
        let nearest = found.into_iter().min_by(|a, b| {
            angle_between(&a.rotation, facing).total_cmp(&angle_between(&b.rotation, facing))
        })?;
        Some(Pinhole { rotation: nearest.rotation, translation: nearest.translation, ..*camera })
    }

    /// Joints in space from cameras that are known up to the unit of length, and the body that reaches them.
    ///
    /// `unit_m` is that unit, or 0 if it is to be found from the length of bones.
    pub fn triangulated(&self, cameras: &[Pinhole], unit_m: f64) -> Option<Parameters> {
        let skeleton = self.figure.skeleton();
        let mut targets: Vec<Option<Vector3>> = (0..skeleton.joint_count())
            .map(|j| {
                let sightings: Vec<Sighting> = cameras
                    .iter()
                    .zip(&self.marks)
                    .filter_map(|(camera, marks)| {
                        marks[j].map(|m| Sighting { camera, pixel_px: m.pixel_px, weight: m.weight })
                    })
                    .collect();
                triangulate(&sightings)
            })
            .collect();
        let mut cameras = cameras.to_vec();
        let (betas, found_unit) = bone_lengths(skeleton, &targets, BONE_DEVIATION_M, unit_m == 0.0);
        if unit_m == 0.0 {
            targets.iter_mut().flatten().for_each(|x| *x = scale(*x, found_unit));
            cameras.iter_mut().for_each(|c| c.translation = scale(c.translation, found_unit));
        }
        let Placed { pose, trans } = inverse_kinematics(skeleton, &betas, &targets, self.hinges)?;
        Some(Parameters { pose, betas, trans, cameras })
    }

    /// Unknown cameras: for every pair of views the relative poses that explain what both saw, the points that follow, and
    /// the other views from those points; the best few, as bodies in the frame of view 0.
    pub fn structures(&self) -> Vec<Parameters> {
        let mut found = Vec::new();
        for b in 1..self.marks.len() {
            for a in 0..b {
                for pose in relative_poses(&self.matches(a, b), POSES_OF_A_PAIR) {
                    found.extend(self.structure(a, b, &pose));
                }
            }
        }
        found.sort_by(|s: &Structure, t| s.error.total_cmp(&t.error));
        let mut distinct: Vec<Structure> = Vec::new();
        for structure in found {
            let same = |other: &Structure| {
                other
                    .cameras
                    .iter()
                    .zip(&structure.cameras)
                    .all(|(p, q)| angle_between(&p.0, &q.0) < SAME_RAD)
            };
            if distinct.len() < MOST_STRUCTURES && !distinct.iter().any(same) {
                distinct.push(structure);
            }
        }
        distinct
            .iter()
            .filter_map(|structure| {
                let mut cameras = self.given_cameras();
                for (camera, pose) in cameras.iter_mut().zip(&structure.cameras) {
                    (camera.rotation, camera.translation) = *pose;
                }
                self.triangulated(&cameras, 0.0)
            })
            .collect()
    }

    fn matches(&self, a: usize, b: usize) -> Vec<Match> {
        let pair = |(p, q): (&Option<Mark>, &Option<Mark>)| {
            let (p, q) = ((*p)?, (*q)?);
            Some(Match { a: p.normalized, b: q.normalized, weight: p.weight.min(q.weight) })
        };
        self.marks[a].iter().zip(&self.marks[b]).filter_map(pair).collect()
    }

    /// All cameras in the frame of view 0 from the relative pose of views a and b; `None` if another view sees too few of the
    /// points.
    fn structure(&self, a: usize, b: usize, pose: &RelativePose) -> Option<Structure> {
        let points: Vec<Option<Vector3>> = self.marks[a]
            .iter()
            .zip(&self.marks[b])
            .map(|(p, q)| {
                let (p, q) = ((*p)?, (*q)?);
                let [depth, other] = depths(pose, &Match { a: p.normalized, b: q.normalized, weight: 1.0 })?;
                (depth > 0.0 && other > 0.0).then(|| scale([p.normalized[0], p.normalized[1], 1.0], depth))
            })
            .collect();
        let mut error = pose.error;
        let mut cameras = Vec::with_capacity(self.marks.len());
        for (i, marks) in self.marks.iter().enumerate() {
            cameras.push(if i == a {
                (IDENTITY, ZERO)
            } else if i == b {
                (pose.rotation, pose.translation)
            } else {
                let landmarks: Vec<Landmark> = points
                    .iter()
                    .zip(marks)
                    .filter_map(|(point, mark)| {
                        let mark = (*mark)?;
                        Some(Landmark { point: (*point)?, seen: mark.normalized, weight: mark.weight })
                    })
                    .collect();
                let camera = resect(&landmarks, &IDENTITY, POINT_SIGMA, 1).into_iter().next()?;
                error += camera.error;
                (camera.rotation, camera.translation)
            });
        }
        let first = cameras[0];
        cameras.iter_mut().for_each(|camera| *camera = relative_to(camera, &first));
        Some(Structure { cameras, error })
    }

    /// The rest torso as each view sees it, from a search over yaw: the likeliest combinations over the views.
    pub fn templates(&self) -> Vec<Parameters> {
        let skeleton = self.figure.skeleton();
        let betas = vec![0.0; skeleton.beta_count()];
        let at_rest = skeleton.rest_joints(&betas);
        let upright = rodrigues([PI, 0.0, 0.0]);
        let seen_from =
            |i: usize| resect(&self.landmarks(i, &at_rest), &upright, TEMPLATE_SIGMA, MOST_TEMPLATES);
        let parameters = |placed: Placed, cameras: Vec<Pinhole>| Parameters {
            pose: placed.pose,
            betas: betas.clone(),
            trans: placed.trans,
            cameras,
        };
        let cameras = self.given_cameras();
        if self.observation.extrinsics == Extrinsics::Known {
            let torso_marks = |i: &usize| TORSO.iter().filter(|&&j| self.marks[*i][j].is_some()).count();
            let Some(view) = (0..cameras.len()).rev().max_by_key(torso_marks) else { return Vec::new() };
            return seen_from(view)
                .iter()
                .map(|r| {
                    let placed = self.placed_in_view(view, &(r.rotation, r.translation), &cameras);
                    parameters(placed, cameras.clone())
                })
                .collect();
        }
        let views: Vec<Vec<Resected>> = (0..cameras.len()).map(seen_from).collect();
        if views.iter().any(Vec::is_empty) {
            return Vec::new();
        }
        // The best of each view, then one view at a time by its second, third, …
        let mut combinations = vec![vec![0; views.len()]];
        for rank in 1..MOST_TEMPLATES {
            for (i, candidates) in views.iter().enumerate() {
                if candidates.len() > rank {
                    let mut combination = vec![0; views.len()];
                    combination[i] = rank;
                    combinations.push(combination);
                }
            }
        }
        combinations.truncate(MOST_TEMPLATES);
        combinations
            .iter()
            .map(|combination| {
                let seen =
                    |i: usize| (views[i][combination[i]].rotation, views[i][combination[i]].translation);
                let mut cameras = cameras.clone();
                for (i, camera) in cameras.iter_mut().enumerate() {
                    (camera.rotation, camera.translation) = relative_to(&seen(i), &seen(0));
                }
                parameters(self.placed(&seen(0)), cameras)
            })
            .collect()
    }

    /// The rest joints that view i has marked: those of the torso, or all if too few of them are.
    fn landmarks(&self, i: usize, at_rest: &[Vector3]) -> Vec<Landmark> {
        let landmark = |j: usize| {
            let mark = self.marks[i][j]?;
            Some(Landmark { point: at_rest[j], seen: mark.normalized, weight: mark.weight })
        };
        let torso: Vec<Landmark> = TORSO.iter().filter_map(|&j| landmark(j)).collect();
        if torso.len() >= LEAST_LANDMARKS { torso } else { (0..at_rest.len()).filter_map(landmark).collect() }
    }

    /// The rest pose where a camera at the world's origin sees it by X_c = R X + t.
    fn placed(&self, (rotation, translation): &(Matrix3, Vector3)) -> Placed {
        let root = self.figure.skeleton().template[0];
        let mut pose = vec![0.0; 3 * self.figure.skeleton().joint_count()];
        pose[..3].copy_from_slice(&logarithm(rotation));
        // The root turns about its own joint.
        Placed { pose, trans: sub(add(apply(rotation, root), *translation), root) }
    }

    /// The same where the camera of view i stands somewhere in the world.
    fn placed_in_view(&self, i: usize, seen: &(Matrix3, Vector3), cameras: &[Pinhole]) -> Placed {
        let camera = &cameras[i];
        let rotation = mul(&transpose(&camera.rotation), &seen.0);
        let translation = apply_transposed(&camera.rotation, sub(seen.1, camera.translation));
        self.placed(&(rotation, translation))
    }
}

/// A camera's pose by the frame of `first`'s camera instead of the frame in which both are given: R R_0ᵀ, t − R R_0ᵀ t_0.
fn relative_to(camera: &(Matrix3, Vector3), first: &(Matrix3, Vector3)) -> (Matrix3, Vector3) {
    let rotation = mul(&camera.0, &transpose(&first.0));
    (rotation, sub(camera.1, apply(&rotation, first.1)))
}

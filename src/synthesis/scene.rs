//! One synthetic scene: a person with parameters, a surface, a rig, and pictures of it.

use rand::Rng;
use vitruvian_conformance::convert;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::linalg::vector::{Vector3, add_scaled};
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::render::{Light, Picture, render};

use super::appearance::{Colour, random_colours};
use super::clothing::random_wardrobe;
use super::pose::{limbs_are_apart, random_pose};
use super::{normal, rig, scene_rng};

/// Head joint in SMPL's order.
const HEAD: usize = 15;

/// How a run's scenes are made.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The run's seed.
    pub seed: u64,
    /// Cameras on the ring.
    pub views: usize,
    /// Side of the square pictures in pixels.
    pub size_px: u32,
}

/// The truth of a scene and what its pictures need.
pub struct Scene {
    /// θ \[72\], axis-angle, radians.
    pub pose: Vec<f64>,
    /// β [≤ 10].
    pub betas: Vec<f64>,
    /// Translation in metres.
    pub trans: Vector3,
    /// The 24 posed joints in metres, world frame.
    pub joints: Vec<Vector3>,
    /// The dressed surface in metres, world frame.
    pub surface: Mesh,
    /// A colour for each vertex.
    pub colours: Vec<Colour>,
    /// The rig.
    pub cameras: Vec<Camera>,
    /// Light and background.
    pub light: Light,
}

impl Scene {
    /// Draws scene `index` of a run.
    pub fn random(body: &BodyModel, settings: &Settings, index: u64) -> Scene {
        let mut rng = scene_rng(settings.seed, index);
        let betas: Vec<f64> = (0..body.beta_count().min(10)).map(|_| normal(&mut rng, 2.2)).collect();
        let rest = body.pose(&vec![0.0; 3 * body.joint_count()], &betas, [0.0; 3]);
        let height = extent(&rest.vertices, 1);
        let gap = 0.1 * height;
        let skeleton = Skeleton { body, rest: &rest.joints };
        let pose = random_pose(&mut rng, &rest.joints, |pose| limbs_are_apart(&skeleton.joints(pose), gap));
        let trans = std::array::from_fn(|_| 0.08 * normal(&mut rng, 2.0));
        let posed = body.pose(&pose, &betas, trans);

        let wardrobe = random_wardrobe(&mut rng, &body.lbs_weights, body.joint_count());
        let skin = Mesh::new(posed.vertices, body.faces.clone());
        let normals = skin.vertex_normals();
        let dressed = skin.vertices.iter().zip(&normals).enumerate().map(|(i, (&v, &n))| {
            let offset: f64 = wardrobe.iter().map(|g| g.offset(i, rest.vertices[i])).fold(0.0, f64::max);
            add_scaled(v, n, offset)
        });
        let surface = Mesh::new(dressed.collect(), skin.faces.clone());
        let head: Vec<f64> = body.lbs_weights.chunks_exact(body.joint_count()).map(|row| row[HEAD]).collect();
        let colours = random_colours(&mut rng, &rest.vertices, &head, &wardrobe);

        let middle = std::array::from_fn(|axis| {
            let (low, high) = bounds(&surface.vertices, axis);
            0.5 * (low + high)
        });
        let cameras = rig::random_rig(&mut rng, settings.views, settings.size_px, middle, &surface.vertices);
        let light = random_light(&mut rng);
        Scene { pose, betas, trans, joints: posed.joints, surface, colours, cameras, light }
    }

    /// What each camera sees.
    pub fn photograph(&self) -> Vec<Picture> {
        let mesh = convert::mesh_to_runtime(&self.surface);
        let normals = mesh.vertex_normals();
        self.cameras
            .iter()
            .map(|camera| render(&mesh, &normals, &self.colours, camera, &self.light))
            .collect()
    }
}

/// Joints without the skin, for trying many poses.
struct Skeleton<'a> {
    body: &'a BodyModel,
    rest: &'a [Vector3],
}

impl Skeleton<'_> {
    fn joints(&self, pose: &[f64]) -> Vec<Vector3> {
        use vitruvian_reference::body::kinematic_tree::global_transforms;
        use vitruvian_reference::rotation::rodrigues;
        let rotations: Vec<_> = pose.chunks_exact(3).map(|v| rodrigues([v[0], v[1], v[2]])).collect();
        global_transforms(&rotations, self.rest, &self.body.parents).iter().map(|g| g.translation).collect()
    }
}

fn random_light(rng: &mut impl Rng) -> Light {
    let heading = rng.random_range(0.0..std::f32::consts::TAU);
    let height = rng.random_range(0.1f32..0.95);
    let across = (1.0 - height * height).sqrt();
    Light {
        ambient: rng.random_range(0.30..0.50),
        towards_lamp: [across * heading.sin(), height, across * heading.cos()],
        lamp: rng.random_range(0.25..0.55),
        headlight: rng.random_range(0.15..0.35),
        background: std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(0.2..0.9))),
    }
}

fn extent(points: &[Vector3], axis: usize) -> f64 {
    let (low, high) = bounds(points, axis);
    high - low
}

fn bounds(points: &[Vector3], axis: usize) -> (f64, f64) {
    points
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p[axis]), high.max(p[axis])))
}

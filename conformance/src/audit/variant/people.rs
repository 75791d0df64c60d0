//! Inputs that mean something: a person drawn from a seed, as voxels, in pictures, or as parameters.
//!
//! The person is the mannequin in a random pose and shape, in the middle of the cube −1 … 1 m. Cameras stand around it on a
//! circle of `DISTANCE_M` at its height, each with the cube's middle plane filling its square picture from edge to edge.

use rand::Rng as _;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use vitruvian_reference::body::mannequin;
use vitruvian_runtime::capture::{Camera, look_at};
use vitruvian_runtime::contract::ImageInput;
use vitruvian_runtime::mesh::Mesh;
use vitruvian_runtime::render::{Light, Picture, render};
use vitruvian_runtime::voxelize::{Cube, voxelize};

use crate::array::Array;
use crate::error::Result;

/// Where cameras stand: far enough that a body is all but flat.
const DISTANCE_M: f64 = 20.0;

/// Radians (standard deviation) by which joints turn about each axis.
const TURN_RAD: f64 = 0.2;

/// The cube that holds the person, metres.
pub const CUBE: Cube = Cube { origin: [-1.0; 3], side: 2.0 };

/// A drawn person.
pub struct Person {
    mesh: Mesh,
}

/// Numbers of the standard normal distribution, by Box and Muller.
pub struct Normal(ChaCha8Rng);

impl Normal {
    /// The same seed gives the same numbers.
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// The next number.
    pub fn draw(&mut self) -> f64 {
        let (u, v): (f64, f64) = (self.0.random(), self.0.random());
        // 1 − u is in (0, 1]: its logarithm is finite.
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    /// An array of them, times `scale`.
    pub fn array(&mut self, shape: &[usize], scale: f64) -> Array {
        let values = (0..shape.iter().product()).map(|_| (scale * self.draw()) as f32).collect();
        Array::new(shape, values)
    }
}

impl Person {
    /// The person of a seed.
    pub fn new(seed: u64) -> Self {
        let (body, mut normal) = (mannequin(), Normal::new(seed));
        let pose: Vec<f64> = (0..3 * body.joint_count()).map(|_| TURN_RAD * normal.draw()).collect();
        let betas: Vec<f64> = (0..body.beta_count()).map(|_| normal.draw()).collect();
        let posed = body.pose(&pose, &betas, [0.0; 3]);
        let middle: [f64; 3] = std::array::from_fn(|axis| {
            let along = || posed.vertices.iter().map(|v| v[axis]);
            0.5 * (along().fold(f64::INFINITY, f64::min) + along().fold(f64::NEG_INFINITY, f64::max))
        });
        let vertices = posed
            .vertices
            .iter()
            .map(|v| std::array::from_fn(|axis| (v[axis] - middle[axis]) as f32))
            .collect();
        Self { mesh: Mesh { vertices, faces: body.faces } }
    }

    /// `[1, 1, D, D, D]` solid voxels of [`CUBE`], as a VSR encoder takes them.
    ///
    /// # Errors
    /// When the resolution is 0 or too fine.
    pub fn voxels(&self, resolution: usize) -> Result<Array> {
        let tensor = voxelize(&self.mesh, &CUBE, resolution)?.to_tensor();
        Ok(Array::new(tensor.shape(), tensor.iter().copied().collect()))
    }

    /// The person's picture.
    fn picture(&self, camera: &Camera) -> Picture {
        let light = Light { background: [[0.0; 3]; 2], ..Light::default() };
        let colours = vec![[0.8, 0.6, 0.5]; self.mesh.vertices.len()];
        render(&self.mesh, &self.mesh.vertex_normals(), &colours, camera, &light)
    }

    /// `[N, 3, S, S]` pictures as a network takes them, (x/255 − mean)/std on the person and `background` beside it, and which
    /// pixels of each show the person.
    pub fn images(&self, views: &[Camera], image: &ImageInput) -> (Array, Vec<Vec<bool>>) {
        let size = image.size;
        let colours = image.normalization;
        let mut values = Vec::with_capacity(views.len() * 3 * size * size);
        let mut masks = Vec::new();
        for camera in views {
            let picture = self.picture(camera);
            let mask: Vec<bool> = picture.mask.pixels().map(|p| p.0[0] > 0).collect();
            for channel in 0..3 {
                values.extend(picture.image.pixels().zip(&mask).map(|(pixel, &shown)| {
                    if shown {
                        (f32::from(pixel.0[channel]) / 255.0 - colours.mean[channel]) / colours.std[channel]
                    } else {
                        colours.background
                    }
                }));
            }
            masks.push(mask);
        }
        (Array::new(&[views.len(), 3, size, size], values), masks)
    }
}

/// Cameras around the cube, the first in front of it, with pictures of S × S pixels.
pub fn cameras(count: usize, size: usize) -> Vec<Camera> {
    let side = size as f64;
    let focal = 0.5 * side * DISTANCE_M / (0.5 * CUBE.side);
    (0..count)
        .map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / count as f64;
            let eye = [DISTANCE_M * angle.sin(), 0.0, DISTANCE_M * angle.cos()];
            Camera {
                name: format!("view {i}"),
                width: size as u32,
                height: size as u32,
                k: [[focal, 0.0, 0.5 * side], [0.0, focal, 0.5 * side], [0.0, 0.0, 1.0]],
                extrinsics: look_at(eye, [0.0; 3]),
                distortion: [0.0; 5],
            }
        })
        .collect()
}

/// The depth of the cube's middle in every camera.
pub const MIDDLE_DEPTH_M: f64 = DISTANCE_M;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_person_is_wholly_in_the_cube_and_in_every_picture() {
        let person = Person::new(1);
        let voxels = person.voxels(32).expect("voxels");
        let solid = voxels.values.iter().filter(|&&v| v == 1.0).count() as f64 / 32_f64.powi(3);
        // A person of 65 litres in a cube of 8 m³.
        assert!((0.004..0.016).contains(&solid), "{solid}");
        let image = ImageInput { size: 64, normalization: Default::default() };
        let (images, masks) = person.images(&cameras(4, 64), &image);
        assert_eq!(images.shape, [4, 3, 64, 64]);
        for mask in masks {
            // A silhouette of 0.1 to 1 m² in a picture of 4 m².
            let share = mask.iter().filter(|&&shown| shown).count() as f64 / 4096.0;
            assert!((0.025..0.25).contains(&share), "{share} of the picture");
            let shown = |row: usize| mask[row * 64..(row + 1) * 64].contains(&true);
            let rows = (0..64).filter(|&row| shown(row)).count();
            assert!(
                rows > 32 && !shown(0) && !shown(63),
                "more than half of the picture, and all of the person: {rows} rows"
            );
        }
    }

    #[test]
    fn a_point_of_the_cube_is_where_the_camera_says() {
        for camera in cameras(4, 256) {
            let (pixel, depth) = camera.project([0.0; 3]).expect("before the camera");
            assert!((pixel[0] - 128.0).abs() < 1e-9 && (depth - MIDDLE_DEPTH_M).abs() < 1e-9);
            let (top, _) = camera.project([0.0, 1.0, 0.0]).expect("before the camera");
            assert!(top[1].abs() < 1e-9, "one metre up is the picture's upper edge");
        }
    }

    #[test]
    fn the_same_seed_draws_the_same_numbers_with_unit_variance() {
        let draw = |seed| Normal::new(seed).array(&[4000], 1.0);
        assert_eq!(draw(3), draw(3));
        assert_ne!(draw(3), draw(4));
        let square = draw(3).values.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>() / 4000.0;
        // Five standard deviations of the mean of χ²: 5·√(2/4000).
        assert!((square - 1.0).abs() < 0.12, "{square}");
    }
}

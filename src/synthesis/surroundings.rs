//! Where a scene's person stands: what is behind, what is before, how it is lit and with what it is photographed.
//!
//! Surroundings have their own random numbers, so that they never change the person, the rig or the plain pictures of a
//! scene.

use image::{GrayImage, RgbImage};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use vitruvian_conformance::convert;
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::render::{Light, Picture, render, render_before};

use super::backdrop::random_backdrop;
use super::furniture::Furniture;
use super::sensor::Sensor;
use super::{Scene, Settings, scene_rng};

/// Largest share of a person's pixels that furniture hides in any picture.
pub const MOST_HIDDEN: f64 = 0.35;

/// A piece that hides less than this of the person is drawn again: it would hide nothing.
const LEAST_HIDDEN: f64 = 0.03;

/// How often a piece is drawn before a view goes without.
const ATTEMPTS: usize = 8;

/// Sets the surroundings' random numbers apart from the scene's.
const SURROUNDINGS: u64 = 0x706c_6163_6573;

/// What a run puts around its people.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted {
    /// Probability that a scene has backdrops, varied light and a camera's noise in place of a plain background.
    pub backgrounds: f64,
    /// Probability, for each view, that a piece of furniture stands in its way.
    pub occlusion: f64,
}

/// What is around one scene's person.
pub struct Surroundings {
    light: Light,
    /// One for each camera, or none.
    places: Vec<(RgbImage, Sensor)>,
    furniture: Furniture,
    rng: ChaCha8Rng,
}

/// A picture and what is known about it.
pub struct Shot {
    /// The picture.
    pub image: RgbImage,
    /// 255 where the person is seen.
    pub mask: GrayImage,
    /// 255 where the person is or would be seen without the furniture.
    pub whole_mask: GrayImage,
    /// For each joint of the scene, whether furniture is before it.
    pub joint_hidden: Vec<bool>,
}

impl Surroundings {
    /// Draws the surroundings of scene `index` of a run.
    pub fn random(scene: &Scene, settings: &Settings, wanted: &Wanted, index: u64) -> Surroundings {
        let mut rng = scene_rng(settings.seed ^ SURROUNDINGS, index);
        let mut light = scene.light;
        let mut places = Vec::new();
        if rng.random_bool(wanted.backgrounds) {
            light = harsh_light(&mut rng);
            let place = |c: &Camera| (random_backdrop(&mut rng, c.width, c.height), Sensor::random(&mut rng));
            places = scene.cameras.iter().map(place).collect();
        }
        let furniture = random_furniture(&mut rng, scene, wanted.occlusion);
        Surroundings { light, places, furniture, rng }
    }

    /// What each camera sees.
    pub fn photograph(&self, scene: &Scene) -> Vec<Shot> {
        let mut rng = self.rng.clone();
        let person = convert::mesh_to_runtime(&scene.surface);
        let normals = person.vertex_normals();
        let mut all =
            Furniture { mesh: person.clone(), normals: normals.clone(), colours: scene.colours.clone() };
        all.extend(&self.furniture);
        let shot = |(k, camera): (usize, &Camera)| {
            let place = self.places.get(k);
            let draw = |things: &Furniture| {
                let Furniture { mesh, normals, colours } = things;
                match place {
                    Some((backdrop, _)) => {
                        render_before(mesh, normals, colours, camera, &self.light, backdrop)
                    }
                    None => render(mesh, normals, colours, camera, &self.light),
                }
            };
            let Picture { mut image, mask: mut seen, depth_m } = draw(&all);
            let mut whole_mask = seen.clone();
            let mut joint_hidden = vec![false; scene.joints.len()];
            if !self.furniture.mesh.faces.is_empty() {
                let alone = render(&person, &normals, &scene.colours, camera, &self.light);
                let before = draw(&self.furniture);
                // The nearest surface is the person's where it is as near with the furniture as without.
                for ((pixel, &with), &without) in seen.pixels_mut().zip(&depth_m).zip(&alone.depth_m) {
                    pixel.0[0] = if without.is_finite() && with == without { 255 } else { 0 };
                }
                whole_mask = alone.mask;
                joint_hidden = scene.joints.iter().map(|&joint| is_hidden(camera, &before, joint)).collect();
            }
            if let Some((_, sensor)) = place {
                sensor.expose(&mut image, &mut rng);
            }
            Shot { image, mask: seen, whole_mask, joint_hidden }
        };
        scene.cameras.iter().enumerate().map(shot).collect()
    }
}

/// Whether something in a picture is before a point.
fn is_hidden(camera: &Camera, picture: &Picture, point: Vector3) -> bool {
    let Some(([u, v], depth)) = camera.project(point) else { return false };
    let inside = u >= 0.0 && v >= 0.0 && u < f64::from(camera.width) && v < f64::from(camera.height);
    inside && f64::from(picture.depth_m[v as usize * camera.width as usize + u as usize]) < depth
}

/// For each view with the given probability a piece between its camera and the person; all cameras see all pieces, and
/// none of them loses more than [`MOST_HIDDEN`] of the person.
fn random_furniture(rng: &mut impl Rng, scene: &Scene, probability: f64) -> Furniture {
    let mut furniture = Furniture::default();
    let blocked: Vec<usize> = (0..scene.cameras.len()).filter(|_| rng.random_bool(probability)).collect();
    if blocked.is_empty() {
        return furniture;
    }
    let person: Vec<Picture> = scene.photograph();
    let hidden = |view: usize, by: &Furniture| hidden_share(&person[view], &scene.cameras[view], by);
    for view in blocked {
        for _ in 0..ATTEMPTS {
            let Some(piece) = random_piece(rng, scene, &scene.cameras[view]) else { continue };
            let mut more = furniture.clone();
            more.extend(&piece);
            let gained = hidden(view, &piece) >= LEAST_HIDDEN;
            if gained && (0..scene.cameras.len()).all(|view| hidden(view, &more) <= MOST_HIDDEN) {
                furniture = more;
                break;
            }
        }
    }
    furniture
}

/// A piece on the floor between a camera and the person, clear of both; none if there is no room for it.
fn random_piece(rng: &mut impl Rng, scene: &Scene, camera: &Camera) -> Option<Furniture> {
    let piece = Furniture::random(rng);
    let heading = rng.random_range(0.0..std::f32::consts::TAU);
    let [across, along]: [f64; 2] = [super::normal(rng, 2.5), rng.random()];
    let eye = camera.extrinsics?.centre();
    let points = &scene.surface.vertices;
    let middle = [0, 2].map(|a| points.iter().map(|p| p[a]).sum::<f64>() / points.len() as f64);
    let towards = [eye[0] - middle[0], eye[2] - middle[1]];
    let distance = towards[0].hypot(towards[1]);
    let [x, z] = towards.map(|t| t / distance);
    let reach = points.iter().map(|p| (p[0] - middle[0]) * x + (p[2] - middle[1]) * z).fold(0.0, f64::max);
    let floor = points.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    let radius = f64::from(piece.radius());
    let (nearest, farthest) = (reach + radius + 0.03, (distance - radius - 0.8).min(reach + radius + 1.2));
    if nearest > farthest {
        return None;
    }
    let (out, aside) = (nearest + along * (farthest - nearest), 0.22 * across);
    let place = [middle[0] + out * x - aside * z, floor, middle[1] + out * z + aside * x];
    Some(piece.placed(heading, place.map(|c| c as f32)))
}

/// The share of the person's pixels in a camera's picture that furniture is before.
fn hidden_share(person: &Picture, camera: &Camera, furniture: &Furniture) -> f64 {
    let Furniture { mesh, normals, colours } = furniture;
    let before = render(mesh, normals, colours, camera, &Light::default());
    let (mut seen, mut hidden) = (0usize, 0usize);
    for (&body, &thing) in person.depth_m.iter().zip(&before.depth_m) {
        seen += usize::from(body.is_finite());
        hidden += usize::from(body.is_finite() && thing < body);
    }
    hidden as f64 / seen.max(1) as f64
}

/// Light from soft to harsh, from any side, much or hardly any at the camera.
fn harsh_light(rng: &mut impl Rng) -> Light {
    let heading = rng.random_range(0.0..std::f32::consts::TAU);
    let height = rng.random_range(-0.1f32..0.98);
    let across = (1.0 - height * height).sqrt();
    Light {
        ambient: rng.random_range(0.25..0.6),
        towards_lamp: [across * heading.sin(), height, across * heading.cos()],
        lamp: rng.random_range(0.2..0.9),
        headlight: rng.random_range(0.05..0.35),
        ..Light::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::body::mannequin;

    const SETTINGS: Settings = Settings { seed: 8, views: 4, size_px: 96 };

    fn shots(index: u64, wanted: Wanted) -> (Scene, Vec<Shot>) {
        let scene = Scene::random(&mannequin(), &SETTINGS, index);
        let shots = Surroundings::random(&scene, &SETTINGS, &wanted, index).photograph(&scene);
        (scene, shots)
    }

    #[test]
    fn nothing_wanted_gives_the_plain_pictures() {
        let (scene, found) = shots(0, Wanted::default());
        for (shot, plain) in found.iter().zip(scene.photograph()) {
            assert!(shot.image == plain.image && shot.mask == plain.mask && shot.whole_mask == plain.mask);
            assert!(shot.joint_hidden.iter().all(|hidden| !hidden));
        }
    }

    #[test]
    fn backgrounds_change_pictures_but_not_masks() {
        let (scene, found) = shots(1, Wanted { backgrounds: 1.0, occlusion: 0.0 });
        for (shot, plain) in found.iter().zip(scene.photograph()) {
            assert!(shot.image != plain.image, "the picture is still plain");
            assert!(shot.mask == plain.mask, "the mask changed");
        }
    }

    #[test]
    fn furniture_hides_something_but_never_more_than_its_limit() {
        let (mut hidden_joints, mut hidden_views) = (0, 0);
        for index in 0..6 {
            let (scene, found) = shots(index, Wanted { backgrounds: 0.0, occlusion: 1.0 });
            for (shot, plain) in found.iter().zip(scene.photograph()) {
                assert!(
                    shot.whole_mask == plain.mask,
                    "scene {index}: furniture changed where the person is"
                );
                let body = |mask: &GrayImage| mask.pixels().filter(|p| p.0[0] == 255).count() as f64;
                let share = 1.0 - body(&shot.mask) / body(&shot.whole_mask);
                assert!(
                    (0.0..=MOST_HIDDEN).contains(&share),
                    "scene {index}: {share} of the person is hidden"
                );
                hidden_views += usize::from(share >= LEAST_HIDDEN);
                hidden_joints += shot.joint_hidden.iter().filter(|&&hidden| hidden).count();
            }
        }
        assert!(hidden_views >= 12, "{hidden_views} of 24 views lose anything");
        assert!(hidden_joints >= 12, "{hidden_joints} joints are hidden");
    }

    #[test]
    fn joint_is_hidden_where_its_place_in_the_mask_is() {
        for index in 0..4 {
            let (scene, found) = shots(index, Wanted { backgrounds: 0.0, occlusion: 1.0 });
            for (camera, shot) in scene.cameras.iter().zip(&found) {
                for (&joint, &hidden) in scene.joints.iter().zip(&shot.joint_hidden) {
                    let ([u, v], _) = camera.project(joint).unwrap();
                    let (u, v) = (u as u32, v as u32);
                    let of_body = shot.whole_mask.get_pixel(u, v).0[0] == 255;
                    assert!(
                        !of_body || hidden == (shot.mask.get_pixel(u, v).0[0] == 0),
                        "scene {index} ({u}, {v})"
                    );
                }
            }
        }
    }
}

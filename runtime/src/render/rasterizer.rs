//! A z-buffer rasteriser: a mesh, a pinhole camera and some light in, a picture, a mask and a depth map out.
//!
//! Every pixel is sampled on a 3×3 lattice, so that the middle sample is the pixel's centre: the mask is what covers
//! the centre, the colour the mean of the nine.

use image::{GrayImage, Luma, Rgb, RgbImage};

use crate::capture::Camera;
use crate::mesh::Mesh;

/// Samples along each side of a pixel; odd, so that one falls on the centre.
const SAMPLES: usize = 3;

/// Surfaces nearer than this to the camera's plane are clipped (metres).
const NEAR_M: f64 = 0.05;

/// Light and background. Intensities add up: colour · (ambient + lamp · max(0, n·l) + headlight · |n·v|).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Share of light from everywhere.
    pub ambient: f32,
    /// Unit vector towards the lamp, world frame.
    pub towards_lamp: [f32; 3],
    /// Strength of the lamp.
    pub lamp: f32,
    /// Strength of the light at the camera.
    pub headlight: f32,
    /// Background colours (0..1) at the top and the bottom row.
    pub background: [[f32; 3]; 2],
}

impl Default for Light {
    /// Soft light from above the camera's left on white.
    fn default() -> Light {
        Light {
            ambient: 0.35,
            towards_lamp: [0.4, 0.8, 0.45],
            lamp: 0.35,
            headlight: 0.35,
            background: [[1.0; 3]; 2],
        }
    }
}

/// What a camera sees of a mesh.
pub struct Picture {
    /// The shaded picture.
    pub image: RgbImage,
    /// 255 where the surface covers the pixel's centre, else 0.
    pub mask: GrayImage,
    /// Depth Z_c in metres at the pixel's centre, row-major; infinite where nothing is seen.
    pub depth_m: Vec<f32>,
}

/// A vertex on its way to the screen: camera coordinates, then what is interpolated across the triangle.
#[derive(Clone, Copy)]
struct Corner {
    position: [f64; 3],
    normal: [f32; 3],
    colour: [f32; 3],
}

/// Renders `mesh` with one normal (unit, world frame) and one colour (0..1) per vertex, seen by `camera`.
///
/// Distortion is not applied: the picture is that of [`Camera::pinhole`]. Without extrinsics the camera's frame is the
/// world's. Back faces are drawn too.
///
/// # Panics
/// If there are not as many normals and colours as vertices.
pub fn render(
    mesh: &Mesh,
    normals: &[[f32; 3]],
    colours: &[[f32; 3]],
    camera: &Camera,
    light: &Light,
) -> Picture {
    let steps = f32::max(camera.height.saturating_sub(1) as f32, 1.0);
    draw(mesh, normals, colours, camera, light).develop(|_, row| {
        let t = row as f32 / steps;
        let [top, bottom] = light.background;
        std::array::from_fn(|i| byte(top[i] + t * (bottom[i] - top[i])))
    })
}

/// [`render`] before a picture of the camera's size in place of the light's two background colours.
///
/// # Panics
/// As [`render`], or if the backdrop has not the camera's width and height.
pub fn render_before(
    mesh: &Mesh,
    normals: &[[f32; 3]],
    colours: &[[f32; 3]],
    camera: &Camera,
    light: &Light,
    backdrop: &RgbImage,
) -> Picture {
    assert_eq!(
        backdrop.dimensions(),
        (camera.width, camera.height),
        "render_before: width and height of the backdrop, and of the camera"
    );
    draw(mesh, normals, colours, camera, light).develop(|column, row| backdrop.get_pixel(column, row).0)
}

/// Everything but the background.
fn draw<'a>(
    mesh: &Mesh,
    normals: &[[f32; 3]],
    colours: &[[f32; 3]],
    camera: &'a Camera,
    light: &Light,
) -> Canvas<'a> {
    assert!(
        normals.len() == mesh.vertices.len() && colours.len() == mesh.vertices.len(),
        "render: {} normals and {} colours for {} vertices",
        normals.len(),
        colours.len(),
        mesh.vertices.len()
    );
    let corners: Vec<Corner> = (0..mesh.vertices.len())
        .map(|i| {
            let world = mesh.vertices[i].map(f64::from);
            let position = camera.extrinsics.map_or(world, |e| e.to_camera(world));
            Corner { position, normal: normals[i], colour: colours[i] }
        })
        .collect();
    let mut canvas = Canvas::new(camera);
    for face in &mesh.faces {
        let triangle = face.map(|i| corners[i as usize]);
        if triangle.iter().all(|c| c.position[2] >= NEAR_M) {
            canvas.draw(&triangle, light);
        } else {
            clip_near(&triangle).for_each(|piece| canvas.draw(&piece, light));
        }
    }
    canvas
}

/// The part with Z_c ≥ [`NEAR_M`] of a triangle that crosses that plane, as zero, one or two triangles.
fn clip_near(triangle: &[Corner; 3]) -> impl Iterator<Item = [Corner; 3]> {
    let inside = |c: &Corner| c.position[2] >= NEAR_M;
    let mut polygon: Vec<Corner> = Vec::new();
    if triangle.iter().any(inside) {
        for k in 0..3 {
            let (a, b) = (&triangle[k], &triangle[(k + 1) % 3]);
            if inside(a) {
                polygon.push(*a);
            }
            if inside(a) != inside(b) {
                let t = (NEAR_M - a.position[2]) / (b.position[2] - a.position[2]);
                polygon.push(Corner {
                    position: std::array::from_fn(|i| a.position[i] + t * (b.position[i] - a.position[i])),
                    normal: std::array::from_fn(|i| a.normal[i] + t as f32 * (b.normal[i] - a.normal[i])),
                    colour: std::array::from_fn(|i| a.colour[i] + t as f32 * (b.colour[i] - a.colour[i])),
                });
            }
        }
    }
    (2..polygon.len()).map(move |k| [polygon[0], polygon[k - 1], polygon[k]])
}

struct Canvas<'a> {
    camera: &'a Camera,
    /// Towards the camera in the world frame needs R; its rows are the camera's axes.
    rotation: [[f64; 3]; 3],
    width: usize,
    height: usize,
    /// 1/Z of the nearest surface at each sample; 0 where there is none.
    nearness: Vec<f32>,
    colour: Vec<[u8; 3]>,
}

impl<'a> Canvas<'a> {
    fn new(camera: &'a Camera) -> Canvas<'a> {
        let (width, height) = (camera.width as usize * SAMPLES, camera.height as usize * SAMPLES);
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let rotation = camera.extrinsics.map_or(identity, |e| e.r);
        let (nearness, colour) = (vec![0.0; width * height], vec![[0; 3]; width * height]);
        Canvas { camera, rotation, width, height, nearness, colour }
    }

    fn draw(&mut self, triangle: &[Corner; 3], light: &Light) {
        // Sample (row, column) lies at ((column + ½)/3, (row + ½)/3) pixels.
        let screen = triangle.map(|c| {
            let uv = self.camera.to_pixel([c.position[0] / c.position[2], c.position[1] / c.position[2]]);
            uv.map(|p| p * SAMPLES as f64 - 0.5)
        });
        let [a, b, c] = screen;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let range = |axis: usize, size: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0);
            let high = a[axis].max(b[axis]).max(c[axis]).floor().min(size as f64 - 1.0);
            (low <= high).then_some((low as usize, high as usize))
        };
        let (Some((x0, x1)), Some((y0, y1))) = (range(0, self.width), range(1, self.height)) else { return };
        let inverse_depth = triangle.map(|c| 1.0 / c.position[2]);
        let per_area = 1.0 / area;
        for y in y0..=y1 {
            for x in x0..=x1 {
                let p = [x as f64, y as f64];
                let edge = |s: [f64; 2], e: [f64; 2]| {
                    ((e[0] - s[0]) * (p[1] - s[1]) - (e[1] - s[1]) * (p[0] - s[0])) * per_area
                };
                // Barycentric on the screen; a sample on a shared edge may be drawn twice, the nearer stays.
                let weights = [edge(b, c), edge(c, a), edge(a, b)];
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let nearness: f64 = (0..3).map(|k| weights[k] * inverse_depth[k]).sum();
                let sample = y * self.width + x;
                if nearness as f32 <= self.nearness[sample] {
                    continue;
                }
                self.nearness[sample] = nearness as f32;
                // Perspective-correct: attributes are linear in space, so their quotient by Z is linear on the screen.
                let weights = [0, 1, 2].map(|k| (weights[k] * inverse_depth[k] / nearness) as f32);
                self.colour[sample] = self.shade(triangle, weights, light);
            }
        }
    }

    fn shade(&self, triangle: &[Corner; 3], weights: [f32; 3], light: &Light) -> [u8; 3] {
        let blend = |of: fn(&Corner) -> [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| (0..3).map(|k| weights[k] * of(&triangle[k])[i]).sum())
        };
        let normal = blend(|c| c.normal);
        let colour = blend(|c| c.colour);
        let length = normal.iter().map(|n| n * n).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        let along = |direction: [f32; 3]| (0..3).map(|i| normal[i] * direction[i]).sum::<f32>() / length;
        let facing = along(self.rotation[2].map(|r| -r as f32)).abs();
        let strength =
            light.ambient + light.lamp * along(light.towards_lamp).max(0.0) + light.headlight * facing;
        colour.map(|c| byte(c * strength))
    }

    fn develop(self, background: impl Fn(u32, u32) -> [u8; 3]) -> Picture {
        let (width, height) = (self.camera.width, self.camera.height);
        let mut image = RgbImage::new(width, height);
        let mut mask = GrayImage::new(width, height);
        let mut depth_m = Vec::with_capacity(width as usize * height as usize);
        for row in 0..height {
            let first_line = row as usize * SAMPLES * self.width;
            let lines = &self.nearness[first_line..first_line + SAMPLES * self.width];
            if lines.iter().all(|&n| n == 0.0) {
                for column in 0..width {
                    image.put_pixel(column, row, Rgb(background(column, row)));
                }
                depth_m.extend(std::iter::repeat_n(f32::INFINITY, width as usize));
                continue;
            }
            for column in 0..width {
                let background = background(column, row);
                let first = row as usize * SAMPLES * self.width + column as usize * SAMPLES;
                let mut sum = [0u32; 3];
                for s in (0..SAMPLES).flat_map(|y| (0..SAMPLES).map(move |x| first + y * self.width + x)) {
                    let colour = if self.nearness[s] > 0.0 { self.colour[s] } else { background };
                    (0..3).for_each(|i| sum[i] += u32::from(colour[i]));
                }
                let count = (SAMPLES * SAMPLES) as u32;
                image.put_pixel(column, row, Rgb(sum.map(|s| ((s + count / 2) / count) as u8)));
                let centre = self.nearness[first + SAMPLES / 2 * (self.width + 1)];
                mask.put_pixel(column, row, Luma([if centre > 0.0 { 255 } else { 0 }]));
                depth_m.push(if centre > 0.0 { 1.0 / centre } else { f32::INFINITY });
            }
        }
        Picture { image, mask, depth_m }
    }
}

/// A colour component 0..1 as a byte, limited.
fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Extrinsics;

    fn camera() -> Camera {
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Camera {
            name: "test".into(),
            width: 40,
            height: 30,
            k: [[20.0, 0.0, 20.0], [0.0, 20.0, 15.0], [0.0, 0.0, 1.0]],
            extrinsics: Some(Extrinsics { r: identity, t: [0.0; 3] }),
            distortion: [0.0; 5],
        }
    }

    fn draw(vertices: Vec<[f32; 3]>, faces: Vec<[u32; 3]>) -> Picture {
        let count = vertices.len();
        let mesh = Mesh { vertices, faces };
        render(&mesh, &vec![[0.0, 0.0, -1.0]; count], &vec![[0.5; 3]; count], &camera(), &Light::default())
    }

    #[test]
    fn mask_is_what_covers_pixel_centres() {
        // A square from (10, 10) to (20, 18) pixels at depth 2: u = 10 x + 20.
        let at = |u: f32, v: f32| [(u - 20.0) / 10.0, (v - 15.0) / 10.0, 2.0];
        let picture = draw(
            vec![at(10.0, 10.0), at(20.0, 10.0), at(20.0, 18.0), at(10.0, 18.0)],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        for (column, row, pixel) in picture.mask.enumerate_pixels() {
            let inside = (10..20).contains(&column) && (10..18).contains(&row);
            assert_eq!(pixel.0[0] == 255, inside, "({column}, {row})");
            let depth = picture.depth_m[(row * 40 + column) as usize];
            assert!(if inside { (depth - 2.0).abs() < 1e-6 } else { depth.is_infinite() }, "{depth}");
        }
    }

    #[test]
    fn nearer_surface_hides_the_farther() {
        let wall = |z: f32| [[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 9.0, z]];
        let vertices = [wall(3.0), wall(2.0), wall(4.0)].concat();
        let picture = draw(vertices, vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
        assert!((picture.depth_m[15 * 40 + 20] - 2.0).abs() < 1e-6, "{}", picture.depth_m[15 * 40 + 20]);
    }

    #[test]
    fn triangle_through_the_camera_plane_is_clipped_not_dropped() {
        let picture = draw(vec![[-5.0, 1.0, 4.0], [5.0, 1.0, 4.0], [0.0, 1.0, -4.0]], vec![[0, 1, 2]]);
        assert_eq!(picture.mask.get_pixel(20, 29).0[0], 255, "the floor before the camera is drawn");
        assert_eq!(picture.mask.get_pixel(20, 2).0[0], 0, "nothing above the horizon");
    }

    #[test]
    fn depth_is_perspective_correct_on_a_slanted_plane() {
        // The plane Z = 2 + X/2: at u = 20 + 20 X/Z the depth is 2 / (1 − (u − 20)/40).
        let at = |x: f32, y: f32| [x, y, 2.0 + 0.5 * x];
        let picture = draw(
            vec![at(-2.0, -9.0), at(2.0, -9.0), at(2.0, 9.0), at(-2.0, 9.0)],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        for column in 8..30 {
            let u = column as f64 + 0.5;
            let expected = 2.0 / (1.0 - (u - 20.0) / 40.0);
            let found = f64::from(picture.depth_m[15 * 40 + column]);
            assert!((found - expected).abs() < 1e-5 * expected, "column {column}: {found} for {expected}");
        }
    }
}

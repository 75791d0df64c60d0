//! Previews: a mesh seen from around, framed so that it fills the picture.

use image::RgbImage;

use super::{Light, render};
use crate::capture::{Camera, look_at};
use crate::mesh::Mesh;

/// Vertical opening of the preview camera: narrow enough that near limbs are not blown up.
const OPENING_RAD: f64 = 0.5;

/// The share of the picture that the framed box may fill.
const FILL: f64 = 0.92;

/// A camera that circles a box at a fixed distance, so that meshes framed by one turntable can be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turntable {
    centre: [f64; 3],
    distance: f64,
    width: u32,
    height: u32,
}

impl Turntable {
    /// A turntable whose pictures of `width` × `height` pixels show all of `mesh` from any side.
    ///
    /// `None` for a mesh without vertices or an empty picture.
    pub fn around(mesh: &Mesh, width: u32, height: u32) -> Option<Turntable> {
        let (low, high) = mesh.bounds()?;
        if width == 0 || height == 0 || !low.iter().chain(&high).all(|x| x.is_finite()) {
            return None;
        }
        let centre: [f64; 3] = std::array::from_fn(|a| 0.5 * (f64::from(low[a]) + f64::from(high[a])));
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * (f64::from(high[a]) - f64::from(low[a])));
        // Turned by any angle the box stays in the cylinder around it; its near edge is the largest on the screen.
        let radius = half[0].hypot(half[2]);
        let up = (0.5 * OPENING_RAD).tan() * FILL;
        let across = up * f64::from(width) / f64::from(height);
        let distance = radius + (half[1] / up).max(radius / across).max(1e-3);
        Some(Turntable { centre, distance, width, height })
    }

    /// The camera after turning by `yaw` radians: 0 sees the body's front (+Z), π/2 its left (+X).
    pub fn camera(&self, yaw: f64) -> Camera {
        let (sine, cosine) = yaw.sin_cos();
        let [x, y, z] = self.centre;
        let eye = [x + self.distance * sine, y, z + self.distance * cosine];
        let f = 0.5 * f64::from(self.height) / (0.5 * OPENING_RAD).tan();
        Camera {
            name: format!("turntable {:.0}", yaw.to_degrees()),
            width: self.width,
            height: self.height,
            k: [
                [f, 0.0, 0.5 * f64::from(self.width)],
                [0.0, f, 0.5 * f64::from(self.height)],
                [0.0, 0.0, 1.0],
            ],
            extrinsics: look_at(eye, self.centre),
            distortion: [0.0; 5],
        }
    }

    /// The mesh from one side, with one colour (0..1) per vertex, on white.
    ///
    /// # Panics
    /// If there are not as many colours as vertices, or a face names no vertex.
    pub fn picture(&self, mesh: &Mesh, colors: &[[f32; 3]], yaw: f64) -> RgbImage {
        // The lamp turns with the camera, so that no side is in the dark.
        let light = Light::default();
        let [x, y, z] = light.towards_lamp;
        let (sine, cosine) = (yaw as f32).sin_cos();
        let light = Light { towards_lamp: [cosine * x + sine * z, y, cosine * z - sine * x], ..light };
        render(mesh, &mesh.vertex_normals(), colors, &self.camera(yaw), &light).image
    }
}

/// A mesh in clay from `count` sides, evenly around, the front first; empty for a mesh without vertices.
pub fn preview(mesh: &Mesh, count: usize, width: u32, height: u32) -> Vec<RgbImage> {
    let Some(table) = Turntable::around(mesh, width, height) else { return Vec::new() };
    let colors = vec![CLAY; mesh.vertices.len()];
    let yaw = |i: usize| i as f64 / count as f64 * std::f64::consts::TAU;
    (0..count).map(|i| table.picture(mesh, &colors, yaw(i))).collect()
}

/// A warm light grey on which shading reads well.
pub const CLAY: [f32; 3] = [0.86, 0.80, 0.74];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::sphere;

    fn stretched() -> Mesh {
        let mut mesh = sphere(0.9, [5.0, -3.0, 2.0], 16);
        for v in &mut mesh.vertices {
            v[0] = 5.0 + 0.5 * (v[0] - 5.0);
        }
        mesh
    }

    #[test]
    fn all_of_the_mesh_is_seen_from_every_side_and_fills_much_of_the_picture() {
        for (width, height) in [(120, 200), (200, 120)] {
            let mesh = stretched();
            let table = Turntable::around(&mesh, width, height).unwrap();
            for i in 0..8 {
                let camera = table.camera(f64::from(i) * 0.785);
                let seen: Vec<[f64; 2]> =
                    mesh.vertices.iter().map(|v| camera.project(v.map(f64::from)).unwrap().0).collect();
                assert!(seen.iter().all(|p| p[0] > 0.0 && p[1] > 0.0));
                assert!(seen.iter().all(|p| p[0] < f64::from(width) && p[1] < f64::from(height)));
                let rows = |f: fn(f64, f64) -> f64, start| seen.iter().map(|p| p[1]).fold(start, f);
                let filled = rows(f64::max, 0.0) - rows(f64::min, 1e9);
                assert!(filled > 0.35 * f64::from(height), "{filled} of {height} rows");
            }
        }
    }

    #[test]
    fn the_front_is_seen_first_and_then_the_left() {
        let table = Turntable::around(&stretched(), 100, 100).unwrap();
        let depth = |yaw: f64, offset: [f64; 3]| {
            table.camera(yaw).project([5.0 + offset[0], -3.0, 2.0 + offset[2]]).unwrap().1
        };
        assert!(depth(0.0, [0.0, 0.0, 0.3]) < depth(0.0, [0.0; 3]));
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!(depth(quarter, [0.3, 0.0, 0.0]) < depth(quarter, [0.0; 3]));
    }

    #[test]
    fn pictures_show_the_mesh_and_nothing_gives_none() {
        let pictures = preview(&sphere(0.9, [5.0, -3.0, 2.0], 16), 3, 40, 60);
        assert_eq!(pictures.len(), 3);
        let middle = pictures.iter().map(|p| p.get_pixel(20, 30).0).collect::<Vec<_>>();
        assert!(pictures.iter().all(|p| p.dimensions() == (40, 60)) && middle.iter().all(|m| *m != [255; 3]));
        assert!(
            middle.iter().all(|m| m[0].abs_diff(middle[0][0]) < 12),
            "every side is lit alike: {middle:?}"
        );
        assert!(preview(&Mesh::default(), 3, 40, 60).is_empty());
        assert_eq!(Turntable::around(&stretched(), 0, 10), None);
    }
}

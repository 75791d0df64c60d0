//! `overlay_NAME.png`: a body over what the camera saw, with the joints that were detected and that were found.

use image::imageops::{self, FilterType};
use image::{GrayImage, Rgb, RgbImage};
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::mesh::Mesh;
use vitruvian_runtime::render::{CLAY, Light, overlay, render};

use super::marks::Mark;

/// Pictures narrower than this are enlarged by a whole factor, so that the marks can be told apart.
const LEAST_WIDTH: u32 = 640;

/// How much of the body covers the photograph.
const OPACITY: f32 = 0.6;

const DETECTED: Rgb<u8> = Rgb([230, 60, 40]);
const FOUND: Rgb<u8> = Rgb([30, 90, 230]);
/// Around where the person was looked for.
const FRAME: Rgb<u8> = Rgb([240, 200, 40]);
/// The mask where there is no photograph, and the ground beside it.
const MASK: Rgb<u8> = Rgb([205, 205, 205]);
const GROUND: Rgb<u8> = Rgb([245, 245, 245]);

/// What is drawn of one view.
pub struct Shown<'a> {
    /// With the extrinsics that were given or found.
    pub camera: &'a Camera,
    pub photograph: Option<&'a RgbImage>,
    pub mask: Option<&'a GrayImage>,
    pub marks: &'a [Mark],
}

/// Draws `body` (metres, world frame) into one view: red discs are detections, blue crosses the fitted joints, a line joins
/// the two.
pub fn draw(body: &Mesh, shown: &Shown) -> RgbImage {
    let factor = LEAST_WIDTH.div_ceil(shown.camera.width).max(1);
    let camera = enlarged(shown.camera, factor);
    let (width, height) = (camera.width, camera.height);
    let below = match (shown.photograph, shown.mask) {
        (Some(photograph), _) => imageops::resize(photograph, width, height, FilterType::Triangle),
        (None, Some(mask)) => RgbImage::from_fn(width, height, |x, y| {
            if mask.get_pixel(x / factor, y / factor).0[0] >= 128 { MASK } else { GROUND }
        }),
        (None, None) => RgbImage::from_pixel(width, height, GROUND),
    };
    let colours = vec![CLAY; body.vertices.len()];
    let light = Light { towards_lamp: above(&camera), ..Light::default() };
    let picture = render(body, &body.vertex_normals(), &colours, &camera, &light);
    let mut image = overlay(&below, &picture, OPACITY);
    for mark in shown.marks {
        let detected = mark.detected_px.map(|x| x * f64::from(factor));
        if let Some(found) = mark.found_px.map(|p| p.map(|x| x * f64::from(factor))) {
            line(&mut image, detected, found, FOUND);
            for (dx, dy) in [(3.0, 3.0), (3.0, -3.0)] {
                line(&mut image, [found[0] - dx, found[1] - dy], [found[0] + dx, found[1] + dy], FOUND);
            }
        }
        disc(&mut image, detected, 2.5, DETECTED);
    }
    image
}

/// As [`draw`], with the rectangle from `low` to `high` (photograph pixels) framed: where the person was looked for.
pub fn draw_framed(body: &Mesh, shown: &Shown, low: [f64; 2], high: [f64; 2]) -> RgbImage {
    let mut image = draw(body, shown);
    let factor = f64::from(image.width()) / f64::from(shown.camera.width);
    // A frame at the border is drawn on its outermost pixels.
    let size = [image.width(), image.height()].map(f64::from);
    let [[u0, v0], [u1, v1]] =
        [low, high].map(|corner| [0, 1].map(|axis| (factor * corner[axis]).clamp(0.0, size[axis] - 1.0)));
    for (a, b) in [([u0, v0], [u1, v0]), ([u1, v0], [u1, v1]), ([u1, v1], [u0, v1]), ([u0, v1], [u0, v0])] {
        line(&mut image, a, b, FRAME);
    }
    image
}

/// The camera of the picture enlarged by `factor`.
fn enlarged(camera: &Camera, factor: u32) -> Camera {
    let mut enlarged =
        Camera { width: camera.width * factor, height: camera.height * factor, ..camera.clone() };
    for row in &mut enlarged.k[..2] {
        row.iter_mut().for_each(|entry| *entry *= f64::from(factor));
    }
    enlarged
}

/// A lamp above the camera's left shoulder.
fn above(camera: &Camera) -> [f32; 3] {
    let r = camera.extrinsics.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], |e| e.r);
    std::array::from_fn(|axis| (-0.4 * r[0][axis] - 0.7 * r[1][axis] - 0.59 * r[2][axis]) as f32)
}

fn disc(image: &mut RgbImage, [u, v]: [f64; 2], radius: f64, colour: Rgb<u8>) {
    let reach = radius.ceil() as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            if ((dx * dx + dy * dy) as f64) <= radius * radius {
                put(image, u + dx as f64, v + dy as f64, colour);
            }
        }
    }
}

fn line(image: &mut RgbImage, a: [f64; 2], b: [f64; 2], colour: Rgb<u8>) {
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    // A detection far outside the picture would make an endless line.
    let longest = f64::from(image.width() + image.height());
    if !length.is_finite() || length > longest {
        return;
    }
    let steps = length.ceil() as usize + 1;
    for k in 0..=steps {
        let t = k as f64 / steps as f64;
        put(image, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), colour);
    }
}

/// Colours the pixel that holds the point, if there is one.
fn put(image: &mut RgbImage, u: f64, v: f64, colour: Rgb<u8>) {
    let inside = u >= 0.0 && v >= 0.0 && u < f64::from(image.width()) && v < f64::from(image.height());
    if inside {
        image.put_pixel(u as u32, v as u32, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            name: "front".into(),
            width: 320,
            height: 240,
            k: [[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]],
            extrinsics: None,
            distortion: [0.0; 5],
        }
    }

    #[test]
    fn marks_stand_where_the_enlarged_picture_has_them() {
        let body = Mesh { vertices: Vec::new(), faces: Vec::new() };
        let mark = |detected_px, found_px| Mark { name: "", detected_px, found_px };
        let marks = [mark([100.0, 50.0], Some([100.0, 80.0])), mark([1e9, f64::NAN], None)];
        let shown = Shown { camera: &camera(), photograph: None, mask: None, marks: &marks };
        let image = draw(&body, &shown);
        assert_eq!(image.dimensions(), (640, 480));
        assert_eq!(*image.get_pixel(200, 100), DETECTED, "the detection");
        assert_eq!(*image.get_pixel(200, 160), FOUND, "the joint");
        assert_eq!(*image.get_pixel(200, 130), FOUND, "the line between them");
        assert_eq!(*image.get_pixel(10, 10), GROUND, "nothing else");
    }

    #[test]
    fn a_mask_stands_in_for_a_missing_photograph() {
        let mask = GrayImage::from_fn(320, 240, |x, _| image::Luma([if x < 160 { 255 } else { 0 }]));
        let body = Mesh { vertices: Vec::new(), faces: Vec::new() };
        let shown = Shown { camera: &camera(), photograph: None, mask: Some(&mask), marks: &[] };
        let image = draw(&body, &shown);
        assert_eq!((*image.get_pixel(319, 5), *image.get_pixel(320, 5)), (MASK, GROUND));
    }
}

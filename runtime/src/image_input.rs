//! From a photograph, its mask and its camera to what an implicit network takes: crop, colours, coordinates.
//!
//! Nothing but the capture is used: the crop is the mask's, the body's centre is where the rays through the masks'
//! centres meet, and the query cube holds what projects into every mask's rectangle.

use std::path::Path;

use image::{GrayImage, RgbImage};

use crate::capture::geometry::solve;
use crate::capture::{Camera, View};
use crate::error::{Error, Result};

/// Mask values from here on are body.
const BODY: u8 = 128;

/// The crop's side over the longer side of the mask's rectangle: 5 % of margin all around.
const CROP_MARGIN: f64 = 1.1;

/// How far outside the silhouette a point may project and still be asked for, in crop pixels: about a centimetre and a half.
const SILHOUETTE_MARGIN: usize = 2;

/// Bodies of fewer pixels than this along the longer side hold nothing to reconstruct from: specks, not people.
const LEAST_BODY_PX: f64 = 8.0;

/// Rays that differ by less than 10° (this is its sine) do not tell how far away the point is where they meet.
const LEAST_RAY_SINE: f64 = 0.1736;

/// Height that stands for every body's when the views alone cannot tell how far away it is (metres).
const ASSUMED_HEIGHT_M: f64 = 1.7;

/// Colours as a network wants them: (x/255 − mean)/std inside the mask, `background` elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalization {
    /// Mean of red, green, blue.
    pub mean: [f32; 3],
    /// Deviation of red, green, blue.
    pub std: [f32; 3],
    /// The value of every channel outside the mask, after normalisation (methods of PIFu: 0, mid-grey).
    pub background: f32,
}

impl Default for Normalization {
    fn default() -> Normalization {
        Normalization { mean: [0.5; 3], std: [0.5; 3], background: 0.0 }
    }
}

/// A rectangle in pixels, corner origin: u in [low_u, high_u), v in [low_v, high_v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Smallest u and v.
    pub low: [f64; 2],
    /// Largest u and v.
    pub high: [f64; 2],
}

impl Rectangle {
    fn centre(&self) -> [f64; 2] {
        [0, 1].map(|a| 0.5 * (self.low[a] + self.high[a]))
    }

    fn longer_side(&self) -> f64 {
        (self.high[0] - self.low[0]).max(self.high[1] - self.low[1])
    }

    fn contains(&self, p: [f64; 2], margin: f64) -> bool {
        (0..2).all(|a| p[a] >= self.low[a] - margin && p[a] <= self.high[a] + margin)
    }
}

/// One view as a network sees it.
#[derive(Clone, Debug)]
pub struct NetworkView {
    /// Normalised colours \[3,S,S\], red first.
    pub pixels: Vec<f32>,
    /// S.
    pub size: usize,
    /// The camera of the crop: S×S pixels, K' = A K with A = `[[k,0,−k·x0],[0,k,−k·y0],[0,0,1]]` and k = S/side.
    pub camera: Camera,
    /// The mask's rectangle in the photograph.
    pub body: Rectangle,
    /// The crop in the photograph: a square around the mask's rectangle.
    pub crop: Rectangle,
    /// Whether the mask reaches the photograph's border, so that part of the body may be missing.
    pub cut_off: bool,
    /// The crop's pixels [S,S] on or within [`SILHOUETTE_MARGIN`] pixels of the body.
    silhouette: Vec<bool>,
}

impl NetworkView {
    /// [`NetworkView::new`] of a view as a capture holds it.
    ///
    /// # Errors
    /// As [`NetworkView::new`], or the view was read without its image or mask.
    pub fn of(
        capture: &Path,
        view: &View,
        size: usize,
        normalization: &Normalization,
    ) -> Result<NetworkView> {
        let absent = |what: &str| Error::Camera {
            path: capture.into(),
            camera: view.camera.name.clone(),
            message: format!("it has no {what}, which the network needs"),
        };
        let image = view.image.as_ref().ok_or_else(|| absent("image"))?;
        let mask = view.mask.as_ref().ok_or_else(|| absent("mask"))?;
        NetworkView::new(capture, &view.camera, image, mask, size, normalization)
    }

    /// Crops and normalises one view to `size`×`size` pixels.
    ///
    /// The crop is the square around the centre of the mask's rectangle with 1.1 times its longer side; it may reach
    /// beyond the photograph. Each crop pixel is the mean of the photograph's *body* pixels under a triangle filter of
    /// radius max(1, side/S), so that neither aliasing nor background colour enters; where less than half of the
    /// filter's weight is body, the pixel is background.
    ///
    /// # Errors
    /// If the image and the mask differ in size, or the mask is empty, full or of a speck; `capture` and the camera
    /// are named.
    pub fn new(
        capture: &Path,
        camera: &Camera,
        image: &RgbImage,
        mask: &GrayImage,
        size: usize,
        normalization: &Normalization,
    ) -> Result<NetworkView> {
        let refuse =
            |message: String| Error::Camera { path: capture.into(), camera: camera.name.clone(), message };
        if image.dimensions() != mask.dimensions() {
            let ((w, h), (mw, mh)) = (image.dimensions(), mask.dimensions());
            return Err(refuse(format!(
                "the image is {w} × {h} pixels and its mask {mw} × {mh}: make them the same size"
            )));
        }
        let body = body_rectangle(mask)
            .ok_or_else(|| refuse("its mask is empty: mark the body with values of 128 and more".into()))?;
        if mask.pixels().all(|p| p.0[0] >= BODY) {
            return Err(refuse("its mask is full: mark the background with values below 128".into()));
        }
        if body.longer_side() < LEAST_BODY_PX {
            return Err(refuse(format!(
                "its mask marks only {} × {} pixels, expected a body of at least {LEAST_BODY_PX}: remove specks",
                body.high[0] - body.low[0],
                body.high[1] - body.low[1]
            )));
        }
        let whole = [f64::from(mask.width()), f64::from(mask.height())];
        let cut_off = (0..2).any(|a| body.low[a] <= 0.0 || body.high[a] >= whole[a]);
        let side = CROP_MARGIN * body.longer_side();
        let low = body.centre().map(|c| c - 0.5 * side);
        let crop = Rectangle { low, high: low.map(|l| l + side) };
        let (pixels, covered) = resample(image, mask, &crop, size, normalization);
        let silhouette = dilate(&covered, size);
        Ok(NetworkView {
            pixels,
            size,
            camera: crop_camera(camera, &crop, size),
            body,
            crop,
            cut_off,
            silhouette,
        })
    }

    /// grid_sample coordinates (−1..1, edge to edge of the crop) and depth Z_c in metres of a world point.
    ///
    /// u = 2u'/S − 1 with u' in crop pixels from the corner, which is align_corners = false. `None` behind the camera.
    pub fn uv_depth(&self, point: [f64; 3]) -> Option<([f64; 2], f64)> {
        let (pixel, depth) = self.camera.project(point)?;
        Some((pixel.map(|p| 2.0 * p / self.size as f64 - 1.0), depth))
    }

    /// Whether a world point projects onto the body's silhouette or within a margin of two crop pixels around it.
    ///
    /// A point that some view does not see so is outside the body: the visual hull holds every body whose masks are
    /// whole. The margin is for masks that are a pixel tight.
    pub fn sees(&self, point: [f64; 3]) -> bool {
        let index = |p: f64| (p >= 0.0 && p < self.size as f64).then_some(p as usize);
        let pixel = |[u, v]: [f64; 2]| Some(index(v)? * self.size + index(u)?);
        let found = self.camera.project(point).and_then(|(position, _)| pixel(position));
        found.is_some_and(|pixel| self.silhouette[pixel])
    }

    /// Half the crop's width in metres at depth `depth_m`: (S/2)·Z/f'.
    pub fn crop_half_width(&self, depth_m: f64) -> f64 {
        0.5 * self.size as f64 * depth_m / self.camera.focal_length_px()
    }

    /// K'[R|t] of the crop, row-major 3×4: world metres to homogeneous crop pixels; the third number is the depth.
    pub fn projection(&self) -> [[f64; 4]; 3] {
        let k = &self.camera.k;
        let (r, t) = self
            .camera
            .extrinsics
            .map_or(([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]), |e| (e.r, e.t));
        std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..3).map(|m| k[i][m] * if j < 3 { r[m][j] } else { t[m] }).sum())
        })
    }
}

/// Where the body is, from the masks and cameras alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyRegion {
    /// The point nearest to the rays through the centres of the masks' rectangles, world frame, metres.
    pub centre: [f64; 3],
    /// Lowest corner of the query cube.
    pub origin: [f64; 3],
    /// Side of the query cube in metres.
    pub side: f64,
}

impl BodyRegion {
    /// Finds the body's centre and the cube that holds what projects into every mask's rectangle.
    ///
    /// With one view, or views along one line, the depth is that at which the mask's rectangle is 1.7 m high.
    ///
    /// # Errors
    /// If a camera's extrinsics are unknown, the rays do not meet before every camera, or no point projects into all
    /// the rectangles.
    pub fn find(capture: &Path, views: &[NetworkView]) -> Result<BodyRegion> {
        let centre = body_centre(capture, views)?;
        let mut reach = 0.0f64;
        for view in views {
            let (_, depth) = view.camera.project(centre).ok_or_else(|| Error::Camera {
                path: capture.into(),
                camera: view.camera.name.clone(),
                message:
                    "the point where the views' bodies meet lies behind it: check R and t (X_c = R X + t)"
                        .into(),
            })?;
            reach = reach.max(view.crop_half_width(depth) * 1.2);
        }
        let (low, high) = visible_bounds(views, centre, reach).ok_or_else(|| {
            Error::Unanswerable(format!(
                "{}: no point projects into every mask: check that K, R and t of the {} cameras belong to these images",
                capture.display(),
                views.len()
            ))
        })?;
        let side = (0..3).map(|a| high[a] - low[a]).fold(0.0, f64::max);
        let origin = std::array::from_fn(|a| 0.5 * (low[a] + high[a]) - 0.5 * side);
        Ok(BodyRegion { centre, origin, side })
    }
}

/// Solves Σ (I − d dᵀ)(X − o) = 0 over the rays (o, d) through the rectangles' centres.
///
/// One ray, or rays within 10° of each other's lines (two cameras face to face), leave X undetermined along them: then
/// X is the mean of the points on the rays at which each rectangle is 1.7 m high.
fn body_centre(capture: &Path, views: &[NetworkView]) -> Result<[f64; 3]> {
    let (mut normal, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
    let mut directions: Vec<[f64; 3]> = Vec::with_capacity(views.len());
    let mut by_height = [0.0; 3];
    for view in views {
        let pixel = [0, 1]
            .map(|a| (view.body.centre()[a] - view.crop.low[a]) * view.size as f64 / view.crop.longer_side());
        let depth = ASSUMED_HEIGHT_M * view.camera.focal_length_px() / scaled_height(view);
        let seen = view.camera.ray(pixel).zip(view.camera.back_project(pixel, depth));
        let (ray, point) = seen.ok_or_else(|| Error::Camera {
            path: capture.into(),
            camera: view.camera.name.clone(),
            message: "it has no R and t: reconstruction needs a calibrated rig; add \"R\" and \"t\"".into(),
        })?;
        for i in 0..3 {
            by_height[i] += point[i] / views.len() as f64;
            for j in 0..3 {
                let m = f64::from(u8::from(i == j)) - ray.direction[i] * ray.direction[j];
                normal[i][j] += m;
                right[i] += m * ray.origin[j];
            }
        }
        directions.push(ray.direction);
    }
    let crossing = |a: &[f64; 3], b: &[f64; 3]| {
        let cosine: f64 = (0..3).map(|k| a[k] * b[k]).sum();
        1.0 - cosine * cosine > LEAST_RAY_SINE * LEAST_RAY_SINE
    };
    let meet = directions.iter().enumerate().any(|(i, a)| directions[..i].iter().any(|b| crossing(a, b)));
    Ok(if meet { solve(&normal, right).unwrap_or(by_height) } else { by_height })
}

/// Height of the mask's rectangle in crop pixels.
fn scaled_height(view: &NetworkView) -> f64 {
    (view.body.high[1] - view.body.low[1]) * view.size as f64 / view.crop.longer_side()
}

/// Bounds of the points around `centre` that project into every mask's rectangle, found on 96³ samples.
///
/// One sample's spacing is added on every side, and 3 % of each rectangle, so that nothing of the body is cut.
fn visible_bounds(views: &[NetworkView], centre: [f64; 3], reach: f64) -> Option<([f64; 3], [f64; 3])> {
    const STEPS: usize = 96;
    let spacing = 2.0 * reach / (STEPS - 1) as f64;
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let rectangles: Vec<Rectangle> = views
        .iter()
        .map(|v| {
            let k = v.size as f64 / v.crop.longer_side();
            let to_crop = |p: [f64; 2]| [0, 1].map(|a| (p[a] - v.crop.low[a]) * k);
            Rectangle { low: to_crop(v.body.low), high: to_crop(v.body.high) }
        })
        .collect();
    for index in 0..STEPS.pow(3) {
        let cell = [index / (STEPS * STEPS), index / STEPS % STEPS, index % STEPS];
        let point = [0, 1, 2].map(|a| centre[a] - reach + spacing * cell[a] as f64);
        let seen = views.iter().zip(&rectangles).all(|(view, rectangle)| {
            view.camera
                .project(point)
                .is_some_and(|(p, _)| rectangle.contains(p, 0.03 * rectangle.longer_side()))
        });
        if seen {
            for a in 0..3 {
                low[a] = low[a].min(point[a] - spacing);
                high[a] = high[a].max(point[a] + spacing);
            }
        }
    }
    (low[0] <= high[0]).then_some((low, high))
}

/// The rectangle of body pixels, or `None` if there are none.
fn body_rectangle(mask: &GrayImage) -> Option<Rectangle> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (x, y, pixel) in mask.enumerate_pixels() {
        if pixel.0[0] >= BODY {
            for (a, p) in [x, y].into_iter().enumerate() {
                low[a] = low[a].min(f64::from(p));
                high[a] = high[a].max(f64::from(p) + 1.0);
            }
        }
    }
    (low[0] < high[0]).then_some(Rectangle { low, high })
}

fn crop_camera(camera: &Camera, crop: &Rectangle, size: usize) -> Camera {
    let k = size as f64 / crop.longer_side();
    let scaled = |a: usize| [0, 1, 2].map(|j| k * (camera.k[a][j] - crop.low[a] * camera.k[2][j]));
    Camera {
        width: size as u32,
        height: size as u32,
        k: [scaled(0), scaled(1), camera.k[2]],
        ..camera.clone()
    }
}

/// Pixels [S,S] with a set pixel within [`SILHOUETTE_MARGIN`] columns and rows.
fn dilate(covered: &[bool], size: usize) -> Vec<bool> {
    let near = |at: usize| at.saturating_sub(SILHOUETTE_MARGIN)..(at + SILHOUETTE_MARGIN + 1).min(size);
    let columns: Vec<bool> = (0..size * size)
        .map(|pixel| near(pixel % size).any(|column| covered[pixel / size * size + column]))
        .collect();
    (0..size * size).map(|pixel| near(pixel / size).any(|row| columns[row * size + pixel % size])).collect()
}

/// The taps of a triangle filter: for each crop pixel, the first source pixel and the weights (sum 1).
fn taps(low: f64, side: f64, size: usize) -> Vec<(i64, Vec<f32>)> {
    let step = side / size as f64;
    let radius = step.max(1.0);
    (0..size)
        .map(|j| {
            let centre = low + (j as f64 + 0.5) * step;
            let first = (centre - radius - 0.5).ceil() as i64;
            let last = (centre + radius - 0.5).floor() as i64;
            let weight = |i: i64| (1.0 - (i as f64 + 0.5 - centre).abs() / radius).max(0.0);
            let sum: f64 = (first..=last).map(weight).sum();
            (first, (first..=last).map(|i| (weight(i) / sum) as f32).collect())
        })
        .collect()
}

/// [3,S,S] normalised colours of the crop, and which of its pixels [S,S] are body; see [`NetworkView::new`].
fn resample(
    image: &RgbImage,
    mask: &GrayImage,
    crop: &Rectangle,
    size: usize,
    to: &Normalization,
) -> (Vec<f32>, Vec<bool>) {
    let (width, height) = (i64::from(image.width()), i64::from(image.height()));
    let side = crop.longer_side();
    let (columns, rows) = (taps(crop.low[0], side, size), taps(crop.low[1], side, size));
    let mut pixels = vec![to.background; 3 * size * size];
    let mut covered = vec![false; size * size];
    // Rows of the photograph, resampled along x once: red, green, blue times body, and body.
    let along_x = |y: i64| -> Vec<[f32; 4]> {
        let pixel = |x: i64| {
            let inside = x >= 0 && x < width && mask.get_pixel(x as u32, y as u32).0[0] >= BODY;
            inside.then(|| image.get_pixel(x as u32, y as u32).0.map(f32::from))
        };
        columns
            .iter()
            .map(|(first, weights)| {
                let mut sum = [0.0f32; 4];
                for (i, &w) in weights.iter().enumerate() {
                    if let Some([r, g, b]) = pixel(first + i as i64) {
                        for (s, v) in sum.iter_mut().zip([r, g, b, 1.0]) {
                            *s += w * v;
                        }
                    }
                }
                sum
            })
            .collect()
    };
    let mut lines: std::collections::BTreeMap<i64, Vec<[f32; 4]>> = std::collections::BTreeMap::new();
    for (row, (first, weights)) in rows.iter().enumerate() {
        lines.retain(|&y, _| y >= *first);
        let mut sums = vec![[0.0f32; 4]; size];
        for (i, &w) in weights.iter().enumerate() {
            let y = first + i as i64;
            if y < 0 || y >= height {
                continue;
            }
            for (sum, value) in sums.iter_mut().zip(lines.entry(y).or_insert_with(|| along_x(y)).iter()) {
                (0..4).for_each(|c| sum[c] += w * value[c]);
            }
        }
        for (column, [r, g, b, body]) in sums.into_iter().enumerate() {
            if body >= 0.5 {
                covered[row * size + column] = true;
                for (channel, value) in [r, g, b].into_iter().enumerate() {
                    let normalised = (value / body / 255.0 - to.mean[channel]) / to.std[channel];
                    pixels[(channel * size + row) * size + column] = normalised;
                }
            }
        }
    }
    (pixels, covered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Extrinsics, look_at};
    use image::{Luma, Rgb};

    fn camera(name: &str, eye: [f64; 3]) -> Camera {
        Camera {
            name: name.into(),
            width: 200,
            height: 160,
            k: [[220.0, 0.0, 100.0], [0.0, 220.0, 80.0], [0.0, 0.0, 1.0]],
            extrinsics: Some(look_at(eye, [0.0; 3]).expect("the eye is not above its target")),
            distortion: [0.0; 5],
        }
    }

    /// A picture whose red is 2·column and green 2·row, with a body rectangle.
    fn ramp(body: [u32; 4]) -> (RgbImage, GrayImage) {
        let image = RgbImage::from_fn(200, 160, |x, y| Rgb([x as u8, y as u8, 50]));
        let inside = |x: u32, y: u32| x >= body[0] && x < body[1] && y >= body[2] && y < body[3];
        (image, GrayImage::from_fn(200, 160, |x, y| Luma([if inside(x, y) { 255 } else { 0 }])))
    }

    fn view(camera: &Camera, body: [u32; 4]) -> NetworkView {
        let (image, mask) = ramp(body);
        NetworkView::new(Path::new("capture"), camera, &image, &mask, 64, &Normalization::default())
            .expect("a usable view")
    }

    #[test]
    fn crop_pixels_hold_the_colours_that_its_camera_says() {
        let camera = camera("a", [0.0, 0.0, 4.0]);
        let (image, mask) = ramp([40, 140, 50, 110]);
        // 1.1 · 100 pixels on 55: a triangle filter of a whole number of pixels keeps a ramp exactly.
        let view =
            NetworkView::new(Path::new("capture"), &camera, &image, &mask, 55, &Normalization::default())
                .expect("a usable view");
        // A world point and its colour in the photograph, read back from the crop where the crop's camera sees it.
        for point in [[0.1, 0.2, 0.0], [-0.5, 0.1, 0.3], [0.3, -0.3, -0.2]] {
            let (photo, _) = camera.project(point).expect("before the camera");
            let (uv, _) = view.uv_depth(point).expect("before the camera");
            let [column, row] = uv.map(|c| (c + 1.0) * 27.5 - 0.5);
            let at = |channel: usize, r: f64, c: f64| {
                f64::from(view.pixels[(channel * 55 + r as usize) * 55 + c as usize]) * 127.5 + 127.5
            };
            for (channel, expected) in photo.iter().map(|p| p - 0.5).enumerate() {
                let (r, c) = (row.floor(), column.floor());
                let (fr, fc) = (row - r, column - c);
                let found = (1.0 - fr) * ((1.0 - fc) * at(channel, r, c) + fc * at(channel, r, c + 1.0))
                    + fr * ((1.0 - fc) * at(channel, r + 1.0, c) + fc * at(channel, r + 1.0, c + 1.0));
                // f32 colours of up to 255 carry 2⁻¹⁶.
                assert!((found - expected).abs() < 1e-3, "channel {channel}: {found} for {expected}");
            }
        }
    }

    #[test]
    fn only_points_at_the_silhouette_are_seen() {
        // The body covers [40, 140) × [50, 110) pixels; the crop's pixels are 110/64 of the photograph's.
        let camera = camera("a", [0.0, 0.0, 4.0]);
        let view = view(&camera, [40, 140, 50, 110]);
        let at = |uv: [f64; 2]| camera.back_project(uv, 4.0).expect("a calibrated camera");
        for inside in [[41.0, 51.0], [139.0, 109.0], [90.0, 80.0], [38.0, 80.0], [90.0, 111.0]] {
            assert!(view.sees(at(inside)), "{inside:?}");
        }
        for outside in [[33.0, 80.0], [90.0, 117.0], [10.0, 80.0], [90.0, 150.0]] {
            assert!(!view.sees(at(outside)), "{outside:?}");
        }
        assert!(!view.sees([0.0, 0.0, 9.0]), "behind the camera");
    }

    #[test]
    fn background_is_exactly_its_value_and_does_not_leak() {
        let (mut image, mask) = ramp([40, 140, 50, 110]);
        let camera = camera("a", [0.0, 0.0, 4.0]);
        let make = |image: &RgbImage| {
            NetworkView::new(Path::new("capture"), &camera, image, &mask, 64, &Normalization::default())
                .expect("usable")
                .pixels
        };
        let before = make(&image);
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            if mask.get_pixel(x, y).0[0] == 0 {
                *pixel = Rgb([255, 0, 255]);
            }
        }
        assert_eq!(before, make(&image));
        assert_eq!(before[0], 0.0);
    }

    #[test]
    fn centre_and_cube_hold_a_ball_seen_from_all_sides() {
        let views: Vec<NetworkView> = [[0.0, 0.0, 4.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0], [-4.0, 0.0, 0.0]]
            .iter()
            .enumerate()
            .map(|(i, &eye)| {
                // A ball of radius 0.5 at the origin spans ± 220·tan(asin(0.125)) = ± 27.7 pixels.
                view(&camera(&format!("{i}"), eye), [72, 128, 52, 108])
            })
            .collect();
        let region = BodyRegion::find(Path::new("capture"), &views).expect("a body");
        assert!(region.centre.iter().all(|c| c.abs() < 1e-9), "{:?}", region.centre);
        for a in 0..3 {
            assert!(region.origin[a] < -0.5 && region.origin[a] + region.side > 0.5);
        }
        assert!(region.side < 1.5, "{}", region.side);
    }

    #[test]
    fn one_view_takes_its_depth_from_the_assumed_height() {
        let views = [view(&camera("only", [0.0, 0.0, 4.0]), [80, 120, 30, 130])];
        let region = BodyRegion::find(Path::new("capture"), &views).expect("a body");
        // 100 pixels high at f = 220: Z = 1.7·220/100 = 3.74 m from the camera at z = 4.
        assert!((region.centre[2] - (4.0 - 3.74)).abs() < 1e-9, "{:?}", region.centre);
    }

    #[test]
    fn cameras_face_to_face_find_the_body_between_them() {
        // The second view is a pixel off, which puts the rays' nearest point far away from the body.
        let views = [
            view(&camera("front", [0.0, 0.0, 4.0]), [80, 120, 36, 124]),
            view(&camera("back", [0.0, 0.0, -4.0]), [81, 121, 36, 124]),
        ];
        let region = BodyRegion::find(Path::new("capture"), &views).expect("a body");
        assert!(region.centre.iter().all(|c| c.abs() < 0.05), "{:?}", region.centre);
    }

    #[test]
    fn a_body_at_the_border_is_reported_as_cut_off() {
        let camera = camera("a", [0.0, 0.0, 4.0]);
        assert!(view(&camera, [0, 100, 40, 110]).cut_off && view(&camera, [100, 200, 40, 110]).cut_off);
        assert!(!view(&camera, [1, 199, 1, 159]).cut_off);
    }

    #[test]
    fn unusable_views_are_named() {
        let camera = camera("north", [0.0, 0.0, 4.0]);
        let (image, mask) = ramp([0, 0, 0, 0]);
        let new = |mask: &GrayImage| {
            NetworkView::new(Path::new("cap"), &camera, &image, mask, 64, &Normalization::default())
                .map(|_| ())
                .unwrap_err()
                .to_string()
        };
        assert!(new(&mask).contains("north") && new(&mask).contains("empty"), "{}", new(&mask));
        assert!(new(&GrayImage::from_pixel(200, 160, Luma([255]))).contains("full"));
        assert!(new(&GrayImage::new(10, 10)).contains("10 × 10"));
        assert!(new(&ramp([50, 53, 40, 42]).1).contains("only 3 × 2 pixels"));
        let unknown = Camera { extrinsics: None::<Extrinsics>, ..camera.clone() };
        let error = BodyRegion::find(Path::new("cap"), &[view(&unknown, [40, 140, 50, 110])])
            .unwrap_err()
            .to_string();
        assert!(error.contains("no R and t"), "{error}");
    }
}

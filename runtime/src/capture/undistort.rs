//! Pictures of a distorting lens resampled as a pinhole with the same K and size would have taken them.

use image::{GrayImage, RgbImage};

use super::camera::{Camera, distort, fold_radius_squared};

/// For each pixel centre of the pinhole picture, where it lies in the distorted one; `None` beyond the lens' fold.
fn source(camera: &Camera, fold: f64, column: u32, row: u32) -> Option<[f64; 2]> {
    let pinhole_y = (f64::from(row) + 0.5 - camera.k[1][2]) / camera.k[1][1];
    let pinhole_x = (f64::from(column) + 0.5 - camera.k[0][2] - camera.k[0][1] * pinhole_y) / camera.k[0][0];
    let inside = pinhole_x * pinhole_x + pinhole_y * pinhole_y < fold;
    inside.then(|| camera.to_pixel(distort([pinhole_x, pinhole_y], &camera.distortion)))
}

/// Bilinear between pixel centres; what lies outside the picture counts as zero.
fn bilinear(at: [f64; 2], width: u32, height: u32, value: impl Fn(u32, u32) -> f64) -> f64 {
    let (x, y) = (at[0] - 0.5, at[1] - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let mut sum = 0.0;
    for (cx, wx) in [(x0, x0 + 1.0 - x), (x0 + 1.0, x - x0)] {
        for (cy, wy) in [(y0, y0 + 1.0 - y), (y0 + 1.0, y - y0)] {
            if cx >= 0.0 && cy >= 0.0 && cx < f64::from(width) && cy < f64::from(height) {
                sum += wx * wy * value(cx as u32, cy as u32);
            }
        }
    }
    sum
}

/// The picture without distortion; black where the lens saw nothing.
pub(crate) fn rgb(image: &RgbImage, camera: &Camera) -> RgbImage {
    let fold = fold_radius_squared(&camera.distortion);
    let (w, h) = image.dimensions();
    RgbImage::from_fn(w, h, |column, row| {
        let at = source(camera, fold, column, row);
        image::Rgb(std::array::from_fn(|c| {
            at.map_or(0, |at| bilinear(at, w, h, |x, y| f64::from(image.get_pixel(x, y).0[c])).round() as u8)
        }))
    })
}

/// The mask without distortion: interpolated as the picture is, then cut at ½.
pub(crate) fn mask(mask: &GrayImage, camera: &Camera) -> GrayImage {
    let fold = fold_radius_squared(&camera.distortion);
    let (w, h) = mask.dimensions();
    GrayImage::from_fn(w, h, |column, row| {
        let body = source(camera, fold, column, row)
            .is_some_and(|at| bilinear(at, w, h, |x, y| f64::from(mask.get_pixel(x, y).0[0])) >= 127.5);
        image::Luma([if body { 255 } else { 0 }])
    })
}

#[cfg(test)]
mod tests {
    use super::super::camera::tests::camera;
    use super::*;

    #[test]
    fn a_smooth_picture_of_the_undistorted_position_is_restored() {
        let c = Camera { distortion: [-0.2, 0.05, 0.002, -0.001, 0.0], ..camera([0.0, 0.9, 3.0]) };
        // The scene's colour is its position in the pinhole picture; the lens shows it displaced.
        let color = |[u, v]: [f64; 2]| [(u / 2.0) as u8, v as u8, 77];
        let seen = RgbImage::from_fn(c.width, c.height, |x, y| {
            image::Rgb(color(c.undistort([f64::from(x) + 0.5, f64::from(y) + 0.5]).unwrap()))
        });
        let restored = rgb(&seen, &c);
        // A margin of 16 pixels is where the lens may not have looked.
        for y in 16..c.height - 16 {
            for x in 16..c.width - 16 {
                let expected = color([f64::from(x) + 0.5, f64::from(y) + 0.5]);
                let found = restored.get_pixel(x, y).0;
                assert!(
                    found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1),
                    "{x} {y}: {found:?} {expected:?}"
                );
            }
        }
    }

    #[test]
    fn without_distortion_nothing_changes() {
        let c = camera([0.0, 0.9, 3.0]);
        let m = GrayImage::from_fn(c.width, c.height, |x, y| {
            image::Luma([if (x / 7 + y / 5) % 2 == 0 { 255 } else { 0 }])
        });
        assert_eq!(mask(&m, &c), m);
    }
}

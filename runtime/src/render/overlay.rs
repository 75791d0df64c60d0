//! A rendered body laid over the photograph that it was fitted to.

use image::{Rgb, RgbImage};

use super::Picture;

/// `photograph` with `picture` over it where its mask is set: (1 − opacity) · photograph + opacity · picture.
///
/// # Panics
/// If the two differ in size.
pub fn overlay(photograph: &RgbImage, picture: &Picture, opacity: f32) -> RgbImage {
    let (a, b) = (photograph.dimensions(), picture.image.dimensions());
    assert_eq!(a, b, "overlay: a photograph of {a:?} pixels under a picture of {b:?}");
    RgbImage::from_fn(a.0, a.1, |x, y| {
        let below = photograph.get_pixel(x, y).0;
        if picture.mask.get_pixel(x, y).0[0] == 0 {
            return Rgb(below);
        }
        let above = picture.image.get_pixel(x, y).0;
        let mix = |c: usize| f32::from(below[c]) * (1.0 - opacity) + f32::from(above[c]) * opacity;
        Rgb([0, 1, 2].map(|c| mix(c).round() as u8))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, Luma};

    #[test]
    fn only_the_body_is_mixed_in() {
        let photograph = RgbImage::from_pixel(2, 1, Rgb([100, 0, 50]));
        let picture = Picture {
            image: RgbImage::from_pixel(2, 1, Rgb([200, 100, 50])),
            mask: GrayImage::from_fn(2, 1, |x, _| Luma([255 * x as u8])),
            depth_m: vec![1.0; 2],
        };
        assert_eq!(overlay(&photograph, &picture, 0.5).into_raw(), [100, 0, 50, 150, 50, 50]);
    }
}

//! The square around a person, cut out of a photograph and brought to the size that a regressor takes.
//!
//! The corners of the square are rounded as the released code of SPIN and of Li 2021 (chapter 4) rounds them, so that
//! networks trained with that code see what they were trained on.

use image::imageops::{FilterType, resize};
use image::{GenericImageView, GrayImage, Rgb, RgbImage};

use crate::error::{Error, Result};

#[cfg(test)]
pub(crate) mod goldens;
#[cfg(test)]
pub(crate) mod tests;

/// The box's side over the longer side of the person's rectangle.
const MARGIN: f64 = 1.2;

/// Mask values from here on are body.
const BODY: u8 = 128;

/// Shortest side of a square that is cut, in photograph pixels: fewer show nobody, and a network answers all the same.
const LEAST_SIDE_PX: f64 = 8.0;

/// Longest side of a square that is cut, in photograph pixels; more would only be border and cost memory.
const LARGEST_SIDE_PX: u32 = 16_384;

/// Longest side of a crop, in its own pixels.
const LARGEST_SIZE: u32 = 2_048;

/// Where a person is: a square in photograph pixels, corner origin (the first pixel's centre is (½, ½)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonBox {
    /// The square's middle.
    pub center_px: [f64; 2],
    /// The square's side.
    pub side_px: f64,
}

impl PersonBox {
    /// The square around the rectangle from `low` to `high` with 1.2 times its longer side.
    pub fn around(low: [f64; 2], high: [f64; 2]) -> PersonBox {
        let longer = (high[0] - low[0]).max(high[1] - low[1]);
        PersonBox { center_px: [0, 1].map(|a| 0.5 * (low[a] + high[a])), side_px: MARGIN * longer }
    }

    /// [`PersonBox::around`] the pixels that a mask marks as body (128 and more); none if it marks none.
    pub fn of_mask(mask: &GrayImage) -> Option<PersonBox> {
        let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
        for (u, v, pixel) in mask.enumerate_pixels() {
            if pixel.0[0] >= BODY {
                low = [low[0].min(u), low[1].min(v)];
                high = [high[0].max(u + 1), high[1].max(v + 1)];
            }
        }
        (low[0] < high[0]).then(|| PersonBox::around(low.map(f64::from), high.map(f64::from)))
    }

    /// The smallest square that holds a photograph of `width` × `height` pixels, without a margin.
    pub fn whole(width: u32, height: u32) -> PersonBox {
        let size = [width, height].map(f64::from);
        PersonBox { center_px: size.map(|s| 0.5 * s), side_px: size[0].max(size[1]) }
    }

    /// The square with the same middle and `factor` times the side.
    pub fn scaled(self, factor: f64) -> PersonBox {
        PersonBox { side_px: factor * self.side_px, ..self }
    }
}

/// A person's square, S×S pixels, and where in the photograph it was.
///
/// Both pictures have their origin at the first pixel's corner: what is at (u, v) in the photograph is at
/// ((u, v) − `origin_px`)·S/`side_px` in the crop.
#[derive(Clone, Debug, PartialEq)]
pub struct Crop {
    /// The crop.
    pub image: RgbImage,
    /// Corner of the square in the photograph; negative where the square reaches beyond it.
    pub origin_px: [i64; 2],
    /// Side of the square in the photograph.
    pub side_px: u32,
}

impl Crop {
    /// Where a point of the photograph is in the crop; both in pixels, corner origin.
    pub fn from_photograph(&self, pixel_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|a| (pixel_px[a] - self.origin_px[a] as f64) * self.scale())
    }

    /// K' = A K: the intrinsics of the crop for those of the photograph, A = `[[k,0,−k·u₀],[0,k,−k·v₀],[0,0,1]]` with
    /// k = S/`side_px` and (u₀, v₀) = `origin_px`.
    pub fn intrinsics(&self, k: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
        let row = |a: usize| [0, 1, 2].map(|c| (k[a][c] - self.origin_px[a] as f64 * k[2][c]) * self.scale());
        [row(0), row(1), k[2]]
    }

    /// Crop pixels per pixel of the photograph, S/`side_px`.
    fn scale(&self) -> f64 {
        f64::from(self.image.width()) / f64::from(self.side_px)
    }
}

/// Cuts `person` out of `image` and resizes it to `size` × `size` pixels.
///
/// The square runs from trunc(c − side/2) to trunc(c + side/2) on each axis, where trunc drops the fraction (towards
/// zero, as NumPy's conversion to integers). Beyond the photograph it is black. It is resized with the triangle filter
/// of radius max(1, side/S) around each crop pixel's centre, which is what Pillow calls bilinear.
///
/// # Conventions
/// - The released code works with pixels counted from 1: it subtracts 1, maps, truncates and adds 1, and then takes 1
///   away for the array index. The ones cancel, and what is above remains.
/// - There both corners are truncated on their own, so that a box whose side is not whole can give a rectangle one
///   pixel wider than high. Here the cut is always square, with the longer of the two sides; boxes with a whole side
///   that do not straddle zero are cut alike.
/// - There, too, SciPy's `imresize` stretches the contrast of the cut to 0..255 before it resizes; that is a side effect
///   of its conversion of floating-point pictures, and it is not done here.
/// - Pillow rounds to bytes between its two passes and this does not: no value differs by more than 1 (of 255) from
///   Pillow's, checked up and down in scale and beyond the border.
///
/// # Errors
/// The box is not finite, its side less than 8 or more than 16384 pixels, or does not touch the photograph; `size` is
/// 0 or greater than 2048.
///
/// # References
/// Kolotouros et al. 2019, SPIN, `utils/imutils.py` (`crop`, `transform`).
///
/// ```
/// use image::RgbImage;
/// use vitruvian_runtime::person_crop::{PersonBox, crop};
///
/// let photograph = RgbImage::new(640, 480);
/// let crop = crop(&photograph, &PersonBox::around([200.0, 40.0], [300.0, 440.0]), 128)?;
/// assert_eq!(crop.image.dimensions(), (128, 128));
/// assert_eq!((crop.origin_px, crop.side_px), ([10, 0], 480));
/// # Ok::<(), vitruvian_runtime::error::Error>(())
/// ```
pub fn crop(image: &RgbImage, person: &PersonBox, size: u32) -> Result<Crop> {
    let (origin_px, side_px) = square(image.dimensions(), person)?;
    if !(1..=LARGEST_SIZE).contains(&size) {
        return Err(refuse(
            person,
            format!("a crop of {size} × {size} pixels was asked for: 1 to {LARGEST_SIZE}"),
        ));
    }
    let cut = Cut { photograph: image, origin_px, side_px };
    Ok(Crop { image: resize(&cut, size, size, FilterType::Triangle), origin_px, side_px })
}

/// The whole pixels of a box: the corner and the side.
fn square((width, height): (u32, u32), person: &PersonBox) -> Result<([i64; 2], u32)> {
    let half = 0.5 * person.side_px;
    let low = person.center_px.map(|c| (c - half).trunc());
    let high = person.center_px.map(|c| (c + half).trunc());
    if !low.iter().chain(&high).all(|x| x.is_finite()) {
        return Err(refuse(person, "give finite numbers"));
    }
    let side = (high[0] - low[0]).max(high[1] - low[1]);
    if person.side_px < LEAST_SIDE_PX {
        return Err(refuse(
            person,
            format!("its side is less than the {LEAST_SIDE_PX} pixels that show a person: give a larger one"),
        ));
    }
    if side > f64::from(LARGEST_SIDE_PX) {
        return Err(refuse(
            person,
            format!("its side is more than {LARGEST_SIDE_PX} pixels: give a smaller one"),
        ));
    }
    let size = [width, height].map(f64::from);
    if (0..2).any(|a| low[a] >= size[a] || low[a] + side <= 0.0) {
        return Err(refuse(person, format!("it lies outside the photograph of {width} × {height} pixels")));
    }
    Ok((low.map(|x| x as i64), side as u32))
}

fn refuse(person: &PersonBox, why: impl Into<String>) -> Error {
    let PersonBox { center_px: [u, v], side_px } = *person;
    Error::PersonBox { center_px: [u, v], side_px, message: why.into() }
}

/// A square of a photograph, black beyond the border, read in place: a box far larger than the photograph costs nothing.
struct Cut<'a> {
    photograph: &'a RgbImage,
    origin_px: [i64; 2],
    side_px: u32,
}

impl GenericImageView for Cut<'_> {
    type Pixel = Rgb<u8>;

    fn dimensions(&self) -> (u32, u32) {
        (self.side_px, self.side_px)
    }

    fn get_pixel(&self, x: u32, y: u32) -> Rgb<u8> {
        let (u, v) = (self.origin_px[0] + i64::from(x), self.origin_px[1] + i64::from(y));
        match (u32::try_from(u), u32::try_from(v)) {
            (Ok(u), Ok(v)) => self.photograph.get_pixel_checked(u, v).copied().unwrap_or(Rgb([0; 3])),
            _ => Rgb([0; 3]),
        }
    }
}

//! A picture that plotters draws on, with the renderer's bitmap font: no font files are needed.

use std::convert::Infallible;

use image::{Rgb, RgbImage};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontTransform,
};
use vitruvian_runtime::render::text;

/// An RGB picture, white at first.
pub struct Canvas {
    image: RgbImage,
}

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

impl Canvas {
    /// A white picture.
    pub fn new(width: u32, height: u32) -> Canvas {
        Canvas { image: RgbImage::from_pixel(width, height, Rgb([255; 3])) }
    }

    /// What was drawn.
    pub fn into_image(self) -> RgbImage {
        self.image
    }
}

/// Pixels for each dot of the bitmap font, whose capitals are 7 of nominally 10 dots high.
fn dot(size: f64) -> u32 {
    (size / 10.0).floor().max(1.0) as u32
}

impl DrawingBackend for &mut Canvas {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.image.dimensions()
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Drawn {
        let inside = u32::try_from(x).ok().zip(u32::try_from(y).ok());
        if let Some(pixel) = inside.and_then(|(x, y)| self.image.get_pixel_mut_checked(x, y)) {
            let (r, g, b) = color.rgb;
            for (below, above) in pixel.0.iter_mut().zip([r, g, b]) {
                let mixed = f64::from(*below) * (1.0 - color.alpha) + f64::from(above) * color.alpha;
                *below = mixed.round() as u8;
            }
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, words: &str, style: &S, at: BackendCoord) -> Drawn {
        let (width, height) = self.estimate_text_size(words, style)?;
        let mut line = RgbImage::new(width, height);
        text::draw(&mut line, 0, 0, words, dot(style.size()), [255; 3]);
        let (width, height) = (width as i32, height as i32);
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Right => -width,
            HPos::Center => -width / 2,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Bottom => -height,
            VPos::Center => -height / 2,
        };
        let transform: FontTransform = style.transform();
        for (x, y, dot) in line.enumerate_pixels() {
            if dot.0[0] == 255 {
                let (dx, dy) = transform.transform(x as i32 + left, y as i32 + top);
                self.draw_pixel((at.0 + dx, at.1 + dy), style.color())?;
            }
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        words: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let dot = dot(style.size());
        Ok((text::width(words, dot), text::HEIGHT * dot))
    }
}

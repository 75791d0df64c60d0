//! Where an output pixel of a resized axis looks in the input.

use super::super::Scalar;
use super::{CoordinateTransformation, ResizedAxis};

impl ResizedAxis {
    /// The place, in pixels of an axis of `length`, that output pixel j is read from.
    ///
    /// With s the scale, n the input's length, m the output's and w = s·n the output's length before it was made whole:
    ///
    /// | transformation | p(j) |
    /// |---|---|
    /// | half_pixel | (j + ½)/s − ½ |
    /// | half_pixel_symmetric | (n/2)(1 − m/w) + (j + ½)/s − ½ |
    /// | pytorch_half_pixel | (j + ½)/s − ½; 0 where m = 1 |
    /// | align_corners | j·(n − 1)/(w − 1); 0 where w = 1 |
    /// | asymmetric | j/s |
    /// | tf_half_pixel_for_nn | (j + ½)/s |
    /// | tf_crop_and_resize | start·(n − 1) + j·(end − start)(n − 1)/(w − 1); ½(start + end)(n − 1) where w = 1 |
    ///
    /// A scale that is a power of two rounds nothing: j + ½ has few bits, and multiplying by 1/s is as exact as dividing
    /// by s.
    pub(super) fn coordinate<T: Scalar>(
        &self,
        transformation: CoordinateTransformation,
        length: usize,
        j: usize,
    ) -> T {
        let number = |value: f64| T::exact(value);
        let (n, m, j) = (length as f64, self.output as f64, j as f64);
        let [over, under] = self.scale;
        let scale = if under == 1.0 { number(over) } else { number(over) / number(under) };
        let width = if under == n {
            number(over)
        } else if under == 1.0 {
            number(over) * number(n)
        } else {
            scale * number(n)
        };
        let half_pixel = || number(j + 0.5) / scale - number(0.5);
        let p = match transformation {
            CoordinateTransformation::PytorchHalfPixel if self.output == 1 => number(0.0),
            CoordinateTransformation::HalfPixel | CoordinateTransformation::PytorchHalfPixel => half_pixel(),
            CoordinateTransformation::HalfPixelSymmetric if width.value() == m => half_pixel(),
            CoordinateTransformation::HalfPixelSymmetric => {
                number(n / 2.0) * (number(1.0) - number(m) / width) + half_pixel()
            }
            CoordinateTransformation::AlignCorners if width.value() == 1.0 || j == 0.0 => number(0.0),
            CoordinateTransformation::AlignCorners => number(j * (n - 1.0)) / (width - number(1.0)),
            CoordinateTransformation::Asymmetric => number(j) / scale,
            CoordinateTransformation::TfHalfPixelForNn => number(j + 0.5) / scale,
            CoordinateTransformation::TfCropAndResize => {
                let [start, end] = self.roi.map(number);
                if width.value() == 1.0 {
                    number(0.5 * (n - 1.0)) * (start + end)
                } else {
                    start * number(n - 1.0) + (end - start) * (number(j * (n - 1.0)) / (width - number(1.0)))
                }
            }
        };
        let step = match transformation {
            CoordinateTransformation::AlignCorners if width.terms() == 0.0 => {
                (n - 1.0) / (width.value() - 1.0)
            }
            CoordinateTransformation::AlignCorners
            | CoordinateTransformation::TfCropAndResize
            | CoordinateTransformation::HalfPixelSymmetric => f64::NAN,
            _ => under / over,
        };
        if is_power_of_two(step) { number(p.value()) } else { p }
    }
}

fn is_power_of_two(step: f64) -> bool {
    step > 0.0 && step.is_finite() && step.log2().fract() == 0.0
}

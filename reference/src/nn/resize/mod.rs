//! Resizing: a map read at other places than its pixels', axis by axis.
//!
//! Output pixel j of an axis looks at p(j) of the input ([`CoordinateTransformation`]) and takes the nearest pixel or a blend of
//! the pixels around ([`Interpolation`]); outside the image its border pixels go on for ever. Several axes are resized one after the
//! other, which is the product of their weights.
//!
//! # What is contested?
//! * *Which scale?* p is computed from the scale as it is given, also where the output's length is not scale times the
//!   input's, because lengths are whole: an image of 4 pixels times 0.6 has 2 pixels, 1/0.6 apart and not 2 apart.
//! * *align_corners with such a scale.* The specification's text divides by length_resized − 1, its node tests by
//!   scale·length_original − 1, which is not whole (`resize_downsample_scales_linear_align_corners`). This is the tests'.
//!   ONNX Runtime and PyTorch follow the text. They agree where the scale gives whole lengths.
//! * *Antialiasing at the border.* The stretched kernel sees the border pixels repeated, as ONNX's tests have it; Pillow and
//!   PyTorch leave out what lies outside (here `exclude_outside`).
//! * *pytorch_half_pixel with one output pixel* looks at p = 0, as the text says; ONNX's evaluator looks at −½, which is the
//!   same pixel in linear and nearest mode.
//!
//! # Rounding
//! See `interpolation`: the arithmetic of weights and sums, and the coordinate's own error times the local
//! slope. Where the nearest pixel is taken nothing is rounded, but a coordinate that lies within its rounding of a tie may fall to
//! either side: [`resize_alternatives`] gives what else is right then.

mod coordinate;

use super::interpolation::{Kernel, Stencil};
use super::{Rounded, Scalar, Tensor, gamma};

/// How a pixel of the output is mapped to a place in the input: ONNX's `coordinate_transformation_mode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoordinateTransformation {
    /// Both images cover the same area: p = (j + ½)/s − ½.
    HalfPixel,
    /// As `HalfPixel`, about the centre, where the scale does not give whole lengths.
    HalfPixelSymmetric,
    /// As `HalfPixel`; a single output pixel looks at pixel 0.
    PytorchHalfPixel,
    /// The centres of the corner pixels coincide: p = j·(n − 1)/(m − 1).
    AlignCorners,
    /// The first pixels coincide: p = j/s.
    Asymmetric,
    /// TensorFlow's old nearest neighbour, opset 11 alone: p = (j + ½)/s.
    TfHalfPixelForNn,
    /// A part of the image, `roi`, whose ends are pixel centres; outside the image is the extrapolation value.
    TfCropAndResize,
}

/// Which pixel is the nearest: ONNX's `nearest_mode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NearestMode {
    /// ⌈p − ½⌉: half way, the lower one.
    RoundPreferFloor,
    /// ⌊p + ½⌋: half way, the upper one.
    RoundPreferCeil,
    /// ⌊p⌋.
    Floor,
    /// ⌈p⌉.
    Ceil,
}

/// What is made of the pixels around a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Interpolation {
    /// The nearest one.
    Nearest(NearestMode),
    /// A blend of the two around.
    Linear {
        /// Whether the kernel is stretched where the image shrinks.
        antialias: bool,
    },
    /// A blend of the four around by Keys' kernel.
    Cubic {
        /// The kernel's parameter, −¾ by default.
        a: f64,
        /// Whether the kernel is stretched where the image shrinks.
        antialias: bool,
    },
}

/// One axis that is resized.
#[derive(Clone, Debug, PartialEq)]
pub struct ResizedAxis {
    /// Which.
    pub axis: usize,
    /// Its length afterwards.
    pub output: usize,
    /// Pixels of the output per pixel of the input, as a quotient: a scale that is given is s over 1, and a length
    /// that is asked for is m over n.
    pub scale: [f64; 2],
    /// The part of the input that is read by `TfCropAndResize`: 0 is its first pixel, 1 its last.
    pub roi: [f64; 2],
}

/// How a tensor is resized.
#[derive(Clone, Debug, PartialEq)]
pub struct Resize {
    /// The axes that change.
    pub axes: Vec<ResizedAxis>,
    /// Where an output pixel looks.
    pub transformation: CoordinateTransformation,
    /// What it takes there.
    pub interpolation: Interpolation,
    /// Whether pixels outside the image weigh nothing, the others making up for it.
    pub exclude_outside: bool,
    /// What lies outside the image for `TfCropAndResize`.
    pub extrapolation_value: f64,
}

/// The tensor with some axes resized.
///
/// # Panics
/// If an axis does not exist or is empty, or a scale is not positive.
///
/// # References
/// ONNX operator Resize (versions 10, 11, 13, 18 and 19) and Upsample (7, 9).
pub fn resize<T: Scalar>(x: &Tensor<T>, params: &Resize) -> Tensor<T> {
    resize_shifted(x, params, &vec![0.0; params.axes.len()])
}

/// What [`resize`] may also give where a coordinate lies within its rounding of a decision: of the nearest pixel, or of the end
/// of the image for `TfCropAndResize`.
///
/// Each element of an implementation with this unit roundoff is right if it is that of one of these tensors, or of
/// [`resize`]. There is one tensor for each way in which the undecided axes can fall, and none where no axis is undecided.
///
/// # Panics
/// As [`resize`].
pub fn resize_alternatives<T: Scalar>(x: &Tensor<T>, params: &Resize, unit_roundoff: f64) -> Vec<Tensor<T>> {
    let undecided: Vec<bool> =
        params.axes.iter().map(|axis| params.is_undecided(axis, x.shape[axis.axis], unit_roundoff)).collect();
    let count = undecided.iter().filter(|&&axis| axis).count();
    if count == 0 {
        return Vec::new();
    }
    (0..1_usize << count)
        .map(|choice| {
            let mut bit = 0;
            let shifts: Vec<f64> = undecided
                .iter()
                .map(|&undecided| {
                    if !undecided {
                        return 0.0;
                    }
                    bit += 1;
                    if choice >> (bit - 1) & 1 == 0 { -unit_roundoff } else { unit_roundoff }
                })
                .collect();
            resize_shifted(x, params, &shifts)
        })
        .collect()
}

/// [`resize`] with every coordinate of an axis moved by as much as arithmetic of this unit roundoff may move it; the sign says where to.
fn resize_shifted<T: Scalar>(x: &Tensor<T>, params: &Resize, unit_roundoffs: &[f64]) -> Tensor<T> {
    let mut y = x.clone();
    // How many numbers are summed so far: implementations of two axes and more blend one that keeps its length too, out of two
    // halves of its one pixel.
    let mut sums = if matches!(params.interpolation, Interpolation::Linear { .. }) { 2.0 } else { 1.0 };
    let mut outside: Vec<(usize, Vec<bool>)> = Vec::new();
    for (resized, &unit_roundoff) in params.axes.iter().zip(unit_roundoffs) {
        let axis = resized.axis;
        assert!(axis < x.rank(), "resize: axis {axis} does not lie in shape {:?}", x.shape);
        let length = x.shape[axis];
        let [over, under] = resized.scale;
        assert!(
            over / under > 0.0 && (length > 0 || resized.output == 0),
            "resize: axis {axis} of shape {:?} cannot be scaled by {over}/{under} to {}",
            x.shape,
            resized.output
        );
        if params.transformation == CoordinateTransformation::TfCropAndResize {
            outside.push((
                axis,
                (0..resized.output).map(|j| params.is_outside(resized, length, j, unit_roundoff)).collect(),
            ));
        }
        match params.interpolation {
            Interpolation::Nearest(mode) => {
                let places: Vec<usize> = (0..resized.output)
                    .map(|j| nearest(params.shifted(resized, length, j, unit_roundoff), mode, length))
                    .collect();
                y = chosen(&y, axis, &places);
            }
            Interpolation::Linear { antialias } => {
                y = params.blended(&y, resized, Kernel::Linear, antialias, &mut sums);
            }
            Interpolation::Cubic { a, antialias } => {
                y = params.blended(&y, resized, Kernel::Cubic(a), antialias, &mut sums);
            }
        }
    }
    let beyond = T::exact(params.extrapolation_value);
    for (axis, outside) in outside {
        let inner: usize = y.shape[axis + 1..].iter().product();
        for (i, y) in y.data.iter_mut().enumerate() {
            if outside[i / inner % outside.len()] {
                *y = beyond;
            }
        }
    }
    y
}

impl Resize {
    /// p(j) moved to one end of what arithmetic with this unit roundoff may make of it.
    fn shifted(&self, axis: &ResizedAxis, length: usize, j: usize, unit_roundoff: f64) -> f64 {
        let p: Rounded = axis.coordinate(self.transformation, length, j);
        if p.terms == 0.0 || unit_roundoff == 0.0 {
            return p.value;
        }
        // Two more roundings: a reciprocal instead of a division, and the half of the decision itself.
        p.value + unit_roundoff.signum() * gamma(p.terms + 2.0, unit_roundoff.abs()) * p.magnitude
    }

    /// Whether output pixel j of an axis looks outside the image.
    fn is_outside(&self, axis: &ResizedAxis, length: usize, j: usize, unit_roundoff: f64) -> bool {
        let p = self.shifted(axis, length, j, unit_roundoff);
        !(0.0..=length as f64 - 1.0).contains(&p)
    }

    /// Whether a decision along this axis may fall either way.
    fn is_undecided(&self, axis: &ResizedAxis, length: usize, unit_roundoff: f64) -> bool {
        let decision = |j: usize, unit_roundoff: f64| {
            let pixel = match self.interpolation {
                Interpolation::Nearest(mode) => {
                    nearest(self.shifted(axis, length, j, unit_roundoff), mode, length)
                }
                _ => 0,
            };
            let outside = self.transformation == CoordinateTransformation::TfCropAndResize
                && self.is_outside(axis, length, j, unit_roundoff);
            (pixel, outside)
        };
        (0..axis.output).any(|j| decision(j, -unit_roundoff) != decision(j, unit_roundoff))
    }

    /// One axis blended.
    fn blended<T: Scalar>(
        &self,
        x: &Tensor<T>,
        resized: &ResizedAxis,
        kernel: Kernel,
        antialias: bool,
        sums: &mut f64,
    ) -> Tensor<T> {
        let (axis, length) = (resized.axis, x.shape[resized.axis]);
        let scale = resized.scale[0] / resized.scale[1];
        let stencils: Vec<(Stencil<T>, Vec<usize>)> = (0..resized.output)
            .map(|j| {
                let p = resized.coordinate(self.transformation, length, j);
                let stencil = if antialias && scale < 1.0 {
                    Stencil::antialiased(kernel, p, scale)
                } else {
                    Stencil::new(kernel, p)
                };
                let stencil = if self.exclude_outside { stencil.inside(length) } else { stencil };
                let pixels = stencil.pixels(length).collect();
                (stencil, pixels)
            })
            .collect();
        // The taps of the kernel: of the four pixels that a linear stencil holds, two, also where one pixel is both.
        let taps = stencils
            .iter()
            .map(|(stencil, _)| stencil.weights.iter().filter(|w| w.magnitude() != 0.0).count())
            .max()
            .unwrap_or(1)
            .max(2) as f64;
        let additions = *sums * (taps - 1.0);
        *sums *= taps;
        let mut shape = x.shape.clone();
        shape[axis] = resized.output;
        let inner: usize = shape[axis + 1..].iter().product();
        let mut data = Vec::with_capacity(shape.iter().product());
        let mut values = Vec::new();
        for image in x.data.chunks_exact((length * inner).max(1)) {
            for (stencil, pixels) in &stencils {
                for column in 0..inner {
                    values.clear();
                    values.extend(pixels.iter().map(|pixel| image[pixel * inner + column]));
                    data.push(stencil.blend(&values, additions));
                }
            }
        }
        Tensor::new(&shape, data)
    }
}

/// The pixel of an image of this length that is the nearest to p.
fn nearest(p: f64, mode: NearestMode, length: usize) -> usize {
    let pixel = match mode {
        NearestMode::RoundPreferFloor => (p - 0.5).ceil(),
        NearestMode::RoundPreferCeil => (p + 0.5).floor(),
        NearestMode::Floor => p.floor(),
        NearestMode::Ceil => p.ceil(),
    };
    pixel.clamp(0.0, length as f64 - 1.0) as usize
}

/// The tensor made of these places of one axis.
fn chosen<T: Copy>(x: &Tensor<T>, axis: usize, places: &[usize]) -> Tensor<T> {
    super::gather(x, &Tensor::new(&[places.len()], places.to_vec()), axis)
}

#[cfg(test)]
mod tests;

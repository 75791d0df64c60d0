//! Grid sampling: an image read at points between its pixels: the nearest pixel, or a linear or cubic blend along each axis.
//!
//! # Conventions
//! A grid point is (x, y) or (x, y, z): its *first* coordinate runs along the *last* axis of the image (W, then H, then D).
//! Coordinates −1 and 1 are the two ends of the image, and pixels are counted from 0 at their centres. What the ends are:
//!
//! ```text
//! align_corners = false: the outer edges of the border pixels         align_corners = true: their centres
//!      −1                    1                                           −1              1
//!       |  0  |  1  |  2  |  3  |                                         0     1     2     3
//!     −½    ½    1½   2½   W−½    pixel p                                 0               W−1   pixel p
//!
//! −1 ↦ −½, 1 ↦ W − ½, linear:                                          −1 ↦ 0, 1 ↦ W − 1, linear:
//! p = ((x + 1)·W − 1)/2                                                 p = (x + 1)·(W − 1)/2
//! ```
//!
//! With `align_corners = false` cells of every level of a pyramid share their edges, so levels register.
//! Where p lies outside, `padding` decides: zeros; the nearest border pixel; or the image reflected at its ends
//! (edges or centres, by the same rule) as often as needed.
//!
//! Half way between two pixels the nearest is the even one. The cubic kernel is Keys' with a = −¾; a point beyond the ends
//! is moved onto the border pixel or reflected *before* its four neighbours are looked up, as ONNX's evaluator and ONNX
//! Runtime do. PyTorch moves each neighbour instead: its cubic blend differs from this one beyond the ends of
//! `PaddingMode::Border`, and nowhere else.
//!
//! # Rounding
//! Linear: with p = i + f, i = ⌊p⌋, the answer is y = Σ over the 2^d corners of Π (f or 1 − f)·v: of d roundings for the 1 − f, d for the
//! products, 2^d − 1 for the sum, on m = Σ w·|v|. But p itself is rounded: with |x| + 1 in place of x + 1 every way to evaluate it
//! stays within γ_5·((|x| + 1)·W + 1)/2 of the true p (four operations and the subtraction of i), *absolutely*: coordinates
//! near the middle of a large image keep few digits of f. That moves y by the local slope times as much. y is
//! continuous and piecewise linear along an axis, so the slope is at most the largest difference of neighbouring pixels
//! about the point; the 4^d pixels around the cell are searched, since the error may carry the point over a cell's border.
//! Cubic: see `interpolation`. Nearest: nothing is rounded, but a point within its rounding of the
//! middle between two pixels may fall to either: sample again with the grid moved by as much.

use super::interpolation::{Kernel, Stencil};
use super::{Scalar, Tensor};

/// What is made of the pixels around a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleMode {
    /// A blend of the two pixels along each axis.
    Linear,
    /// The nearest pixel, the even one half way.
    Nearest,
    /// A blend of four pixels along each axis by Keys' kernel with a = −¾.
    Cubic,
}

/// What lies outside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaddingMode {
    /// Zero.
    Zeros,
    /// The nearest pixel of the border.
    Border,
    /// The image reflected at its ends.
    Reflection,
}

/// How a grid addresses an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridSample {
    /// What is made of the pixels around a point.
    pub mode: SampleMode,
    /// What lies outside the image.
    pub padding: PaddingMode,
    /// Whether −1 and 1 are the centres of the border pixels (true) or the outer edges of the image (false).
    pub align_corners: bool,
}

/// x \[N,C,H,W\] at grid \[N,h,w,2\] → \[N,C,h,w\], or x \[N,C,D,H,W\] at grid \[N,d,h,w,3\] → \[N,C,d,h,w\].
///
/// # Panics
/// If the grid's rank, number of samples or last axis does not fit x.
///
/// # References
/// ONNX operator GridSample (versions 16, 20 and 22); PyTorch's grid_sample.
pub fn grid_sample<T: Scalar>(x: &Tensor<T>, grid: &Tensor<T>, params: GridSample) -> Tensor<T> {
    let spatial = x.rank().saturating_sub(2);
    assert!(
        spatial > 0
            && grid.rank() == x.rank()
            && grid.shape[0] == x.shape[0]
            && grid.shape[spatial + 1] == spatial,
        "grid_sample: x {:?} must be [N,C,spatial…] and grid {:?} [N,outputs…,spatial axes]",
        x.shape,
        grid.shape
    );
    let (samples, channels) = (x.shape[0], x.shape[1]);
    let size = &x.shape[2..];
    let pixels: usize = size.iter().product();
    let outputs = &grid.shape[1..=spatial];
    let points: usize = outputs.iter().product();
    let mut y = Tensor::zeros(&[&[samples, channels], outputs].concat());
    for n in 0..samples {
        for p in 0..points {
            let point = &grid.data[(n * points + p) * spatial..][..spatial];
            // The grid's first coordinate belongs to the last axis of the image.
            let places: Vec<T> =
                (0..spatial).map(|a| place(point[spatial - 1 - a], size[a], params)).collect();
            let reader = Reader::new(&places, size, params);
            for c in 0..channels {
                let image = &x.data[(n * channels + c) * pixels..][..pixels];
                y.data[(n * channels + c) * points + p] = reader.read(image);
            }
        }
    }
    y
}

/// The place p, in pixels of an axis, of a coordinate.
fn place<T: Scalar>(x: T, size: usize, params: GridSample) -> T {
    let (one, n) = (T::exact(1.0), T::exact(size as f64));
    if params.align_corners {
        x.plus(one) * (n - one) * T::exact(0.5)
    } else {
        (x.plus(one) * n).plus(-one) * T::exact(0.5)
    }
}

/// The ends of the image: the outer edges of its border pixels or their centres.
fn ends(size: usize, params: GridSample) -> [f64; 2] {
    let last = size as f64 - 1.0;
    if params.align_corners { [0.0, last] } else { [-0.5, last + 0.5] }
}

/// Whether a place lies beyond the ends of the image.
fn beyond(p: f64, size: usize, params: GridSample) -> bool {
    let [first, last] = ends(size, params);
    p < first || p > last
}

/// What reads one point from any image of the same size.
pub(super) enum Reader<T> {
    /// A blend of the corners of the cell; see [`sample`].
    Linear { axes: Vec<Coordinate>, corners: Vec<(f64, usize)>, around: Vec<Option<usize>> },
    /// One pixel, if it is not a zero.
    Nearest(Option<usize>),
    /// A blend along each axis, and the 4^d pixels that it reads, the last axis fastest.
    Cubic { stencils: Vec<Stencil<T>>, pixels: Vec<Option<usize>> },
}

impl<T: Scalar> Reader<T> {
    /// At a place along each axis, in pixels.
    pub fn new(places: &[T], size: &[usize], params: GridSample) -> Reader<T> {
        match params.mode {
            SampleMode::Linear => {
                let axes: Vec<Coordinate> =
                    places.iter().zip(size).map(|(&p, &size)| Coordinate::new(p, size, params)).collect();
                let corners = corners(&axes, size);
                let around = if T::TRACKS_ROUNDING { neighbourhood(&axes, size) } else { Vec::new() };
                Reader::Linear { axes, corners, around }
            }
            SampleMode::Nearest => {
                Reader::Nearest(places.iter().zip(size).try_fold(0, |offset, (p, &size)| {
                    Some(offset * size + pixel(p.value().round_ties_even(), size, params)?)
                }))
            }
            SampleMode::Cubic => Self::cubic(places, size, params),
        }
    }

    fn cubic(places: &[T], size: &[usize], params: GridSample) -> Reader<T> {
        if places.iter().any(|p| !p.value().is_finite()) {
            return Reader::Nearest(None);
        }
        let stencils: Vec<Stencil<T>> = places
            .iter()
            .zip(size)
            .map(|(&p, &size)| Stencil::new(Kernel::Cubic(-0.75), returned(p, size, params)))
            .collect();
        let pixels = (0..1_usize << (2 * size.len()))
            .map(|place| {
                stencils.iter().zip(size).enumerate().try_fold(0, |offset, (a, (stencil, &size))| {
                    let k = place >> (2 * (stencils.len() - 1 - a)) & 3;
                    Some(offset * size + pixel(stencil.first as f64 + k as f64, size, params)?)
                })
            })
            .collect();
        Reader::Cubic { stencils, pixels }
    }

    /// The image at that place.
    pub fn read(&self, image: &[T]) -> T {
        match self {
            Reader::Linear { axes, corners, around } => sample(image, corners, around, axes),
            Reader::Nearest(pixel) => pixel.map_or(T::ZERO, |at| image[at]),
            Reader::Cubic { stencils, pixels } => {
                let mut values: Vec<T> =
                    pixels.iter().map(|pixel| pixel.map_or(T::ZERO, |at| image[at])).collect();
                let mut additions = 3.0;
                for stencil in stencils.iter().rev() {
                    values = values.chunks_exact(4).map(|row| stencil.blend(row, additions)).collect();
                    additions *= 4.0;
                }
                values[0]
            }
        }
    }
}

/// A place beyond the ends of the image moved onto the border pixel or reflected; zeros leave it where it is.
fn returned<T: Scalar>(p: T, size: usize, params: GridSample) -> T {
    if !beyond(p.value(), size, params) {
        return p;
    }
    match params.padding {
        PaddingMode::Zeros => p,
        PaddingMode::Border => T::exact(p.value().clamp(0.0, size as f64 - 1.0)),
        PaddingMode::Reflection => {
            let [first, last] = ends(size, params);
            let length = last - first;
            let folded = if length > 0.0 { (p.value() - first).rem_euclid(2.0 * length) } else { 0.0 };
            T::within(first + folded.min(2.0 * length - folded), p.magnitude(), p.terms())
        }
    }
}

/// Where a point lies along one axis.
pub(super) struct Coordinate {
    /// f in [0, 1): the fraction of the way from pixel i to i + 1.
    fraction: f64,
    /// The pixels that stand at i − 1, i, i + 1, i + 2; `None` is a zero.
    pixels: [Option<usize>; 4],
    /// Magnitude and terms of the rounding of p − i.
    magnitude: f64,
    terms: f64,
}

impl Coordinate {
    fn new<T: Scalar>(p: T, size: usize, params: GridSample) -> Coordinate {
        let i = p.value().floor();
        let pixels = std::array::from_fn(|k| pixel(i + k as f64 - 1.0, size, params));
        Coordinate { fraction: p.value() - i, pixels, magnitude: p.magnitude(), terms: p.terms() + 1.0 }
    }
}

/// The pixel of an axis of `size` pixels that stands at a whole coordinate, inside or outside the image.
///
/// Outside, border and reflection give the neighbours of a point the same two pixels, and so the same value, as moving the
/// point itself into the image would. A coordinate that is no number stands nowhere.
fn pixel(at: f64, size: usize, params: GridSample) -> Option<usize> {
    let last = size as f64 - 1.0;
    if (0.0..=last).contains(&at) {
        return Some(at as usize);
    }
    if size == 0 || !at.is_finite() {
        return None;
    }
    match params.padding {
        PaddingMode::Zeros => None,
        PaddingMode::Border => Some(at.clamp(0.0, last) as usize),
        PaddingMode::Reflection if params.align_corners => {
            // Mirrors at 0 and W − 1: period 2(W − 1).
            let folded = if size == 1 { 0.0 } else { at.rem_euclid(2.0 * last) };
            Some(folded.min(2.0 * last - folded) as usize)
        }
        PaddingMode::Reflection => {
            // Mirrors at −½ and W − ½: period 2W.
            let folded = at.rem_euclid(2.0 * size as f64);
            Some(folded.min(2.0 * size as f64 - 1.0 - folded) as usize)
        }
    }
}

/// The offset of one pixel given by its place along each axis; `None` if it is a zero.
fn offset(axes: &[Coordinate], size: &[usize], place: impl Fn(usize) -> usize) -> Option<usize> {
    axes.iter().enumerate().try_fold(0, |offset, (a, axis)| Some(offset * size[a] + axis.pixels[place(a)]?))
}

/// Weight and offset of the corners of the cell around a point; zeros are left out.
fn corners(axes: &[Coordinate], size: &[usize]) -> Vec<(f64, usize)> {
    (0..1usize << axes.len())
        .filter_map(|corner| {
            let upper = |a: usize| corner >> a & 1;
            let weight = axes.iter().enumerate().map(|(a, axis)| match upper(a) {
                0 => 1.0 - axis.fraction,
                _ => axis.fraction,
            });
            Some((weight.product(), offset(axes, size, |a| 1 + upper(a))?))
        })
        .collect()
}

/// Offsets of the 4^d pixels around a point; place a has digit a in base four.
fn neighbourhood(axes: &[Coordinate], size: &[usize]) -> Vec<Option<usize>> {
    (0..1usize << (2 * axes.len())).map(|place| offset(axes, size, |a| place >> (2 * a) & 3)).collect()
}

/// One output: the interpolated value, and its rounding where that is wanted.
fn sample<T: Scalar>(
    image: &[T],
    corners: &[(f64, usize)],
    around: &[Option<usize>],
    axes: &[Coordinate],
) -> T {
    let value = corners.iter().map(|&(weight, at)| weight * image[at].value()).sum();
    if !T::TRACKS_ROUNDING {
        return T::exact(value);
    }
    let arithmetic: f64 = corners.iter().map(|&(weight, at)| weight * image[at].magnitude()).sum();
    let pixel_terms = corners.iter().map(|&(_, at)| image[at].terms()).fold(0.0, f64::max);
    let dimensions = axes.len();
    let mut terms = pixel_terms + (2 * dimensions + (1 << dimensions) - 1) as f64;
    let mut magnitude = arithmetic;
    for (a, axis) in axes.iter().enumerate() {
        let step = 1 << (2 * a);
        let value = |place: usize| around[place].map_or(0.0, |at| image[at].value());
        let slope = (0..around.len())
            .filter(|place| place / step % 4 < 3)
            .map(|place| (value(place + step) - value(place)).abs())
            .fold(0.0, f64::max);
        magnitude += slope * axis.magnitude;
        if slope > 0.0 {
            terms = terms.max(axis.terms);
        }
    }
    T::within(value, magnitude, terms)
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::*;

    const EDGES: GridSample =
        GridSample { mode: SampleMode::Linear, padding: PaddingMode::Zeros, align_corners: false };
    const CENTRES: GridSample = GridSample { align_corners: true, ..EDGES };

    /// A row of four pixels read at one x.
    fn at(x: f64, params: GridSample) -> f64 {
        let image = Tensor::new(&[1, 1, 1, 4], vec![10.0, 20.0, 40.0, 80.0]);
        grid_sample(&image, &Tensor::new(&[1, 1, 1, 2], vec![x, 0.0]), params).data[0]
    }

    #[test]
    fn the_ends_are_edges_or_centres() {
        assert_eq!(at(-0.75, EDGES), 10.0, "the centre of pixel 0 is half a pixel from the edge");
        assert_eq!(at(-1.0, EDGES), 5.0, "at the edge half of the weight is outside");
        assert_eq!(at(0.0, EDGES), 30.0, "the middle is between pixels 1 and 2");
        assert_eq!((at(-1.0, CENTRES), at(1.0, CENTRES)), (10.0, 80.0));
        assert_eq!(at(1.0 / 3.0, CENTRES), 40.0);
    }

    #[test]
    fn outside_is_zero_or_the_border_or_the_reflection() {
        let with = |padding, x| at(x, GridSample { padding, ..EDGES });
        assert_eq!(with(PaddingMode::Zeros, 1.5), 0.0);
        assert_eq!((with(PaddingMode::Border, 1.0), with(PaddingMode::Border, 9.0)), (80.0, 80.0));
        assert_eq!(with(PaddingMode::Reflection, 1.25), with(PaddingMode::Reflection, 0.75));
        assert_eq!(
            with(PaddingMode::Reflection, -3.25),
            with(PaddingMode::Reflection, 0.75),
            "a full period of 4"
        );
        let centred = GridSample { padding: PaddingMode::Reflection, ..CENTRES };
        assert_eq!(at(-1.5, centred), at(-0.5, centred));
    }

    #[test]
    fn the_first_coordinate_runs_along_the_last_axis() {
        let image = Tensor::from_fn(&[1, 1, 2, 3, 4], |i| (100 * i[2] + 10 * i[3] + i[4]) as f64);
        let grid = Tensor::new(&[1, 1, 1, 1, 3], vec![1.0, 0.0, -1.0]);
        assert_eq!(
            grid_sample(&image, &grid, CENTRES).data,
            [13.0],
            "x = last column, y = middle row, z = first slice"
        );
    }

    #[test]
    fn agrees_with_pytorch_in_every_mode() {
        let image = pattern(&[2, 2, 3, 4], 1);
        let grid = pattern(&[2, 3, 2, 2], 2).map(|v| 1.6 * v);
        let volume = pattern(&[1, 2, 2, 3, 4], 3);
        let points = pattern(&[1, 1, 1, 5, 3], 4).map(|v| 1.6 * v);
        for (k, (padding, align_corners)) in [
            (PaddingMode::Zeros, false),
            (PaddingMode::Border, false),
            (PaddingMode::Reflection, false),
            (PaddingMode::Zeros, true),
            (PaddingMode::Border, true),
            (PaddingMode::Reflection, true),
        ]
        .into_iter()
        .enumerate()
        {
            let params = GridSample { mode: SampleMode::Linear, padding, align_corners };
            check(&grid_sample(&image, &grid, params), &goldens::GRID_SAMPLE_2D[k]);
            check(&grid_sample(&volume, &points, params), &goldens::GRID_SAMPLE_3D[k]);
            let nearest = GridSample { mode: SampleMode::Nearest, ..params };
            check(&grid_sample(&image, &grid, nearest), &goldens::GRID_SAMPLE_NEAREST_2D[k]);
            check(&grid_sample(&volume, &points, nearest), &goldens::GRID_SAMPLE_NEAREST_3D[k]);
            let cubic = GridSample { mode: SampleMode::Cubic, ..params };
            if padding != PaddingMode::Border {
                check(&grid_sample(&image, &grid, cubic), &goldens::GRID_SAMPLE_CUBIC_2D[k]);
            }
        }
    }

    #[test]
    fn a_cubic_blend_of_a_product_is_the_product_of_the_blends() {
        let cubic = GridSample { mode: SampleMode::Cubic, ..CENTRES };
        let rows = [1, 2, 3].map(|seed| pattern(&[1, 1, 1, 5], seed));
        let place = [0.1, -0.2, 0.65];
        let blends = [0, 1, 2]
            .map(|a| grid_sample(&rows[a], &Tensor::new(&[1, 1, 1, 2], vec![place[a], 0.0]), cubic).data[0]);
        let volume = Tensor::from_fn(&[1, 1, 5, 5, 5], |i| (0..3).map(|a| rows[a].data[i[a + 2]]).product());
        let point = Tensor::new(&[1, 1, 1, 1, 3], vec![place[2], place[1], place[0]]);
        let (found, expected) = (grid_sample(&volume, &point, cubic).data[0], blends.iter().product::<f64>());
        assert!((found - expected).abs() < 1e-15, "{found} for {expected}");
    }

    #[test]
    fn beyond_the_ends_a_cubic_blend_reads_the_border_pixel_alone() {
        let cubic = |x| at(x, GridSample { mode: SampleMode::Cubic, padding: PaddingMode::Border, ..EDGES });
        assert_eq!((cubic(-1.2), cubic(1.3)), (10.0, 80.0));
        assert_ne!(cubic(-1.0), 10.0, "the edge itself is inside, and overshoots");
    }

    #[test]
    fn half_way_the_nearest_pixel_is_even() {
        let nearest = GridSample { mode: SampleMode::Nearest, ..EDGES };
        assert_eq!([-0.5, 0.0, 0.5].map(|x| at(x, nearest)), [10.0, 40.0, 40.0], "½, 1½, 2½");
    }

    #[test]
    fn a_constant_image_has_no_coordinate_error() {
        let image = Tensor::filled(&[1, 1, 64, 64], 3.0).rounded();
        let grid = Tensor::new(&[1, 1, 1, 2], vec![0.1, -0.3]).rounded();
        let y = grid_sample(&image, &grid, EDGES).data[0];
        assert!((y.magnitude - 3.0).abs() < 1e-12, "{y:?}");
        assert_eq!(y.terms, 7.0);
    }

    #[test]
    fn the_bound_covers_f32_and_most_of_it_is_the_coordinate() {
        let width = 128;
        let image = pattern(&[1, 1, 1, width], 1).map(|v| f64::from(v as f32));
        let row: Vec<f32> = image.data.iter().map(|&v| v as f32).collect();
        let mut worst: f64 = 0.0;
        for k in 0..400 {
            let x = (k as f32 * 0.7391).sin();
            let p = ((x + 1.0) * width as f32 - 1.0) / 2.0;
            let (i, f) = (p.floor(), p - p.floor());
            let pixel = |i: f32| if (0.0..width as f32).contains(&i) { row[i as usize] } else { 0.0 };
            let f32 = (1.0 - f) * pixel(i) + f * pixel(i + 1.0);
            let grid = Tensor::new(&[1, 1, 1, 2], vec![f64::from(x), 0.0]).rounded();
            let y = grid_sample(&image.rounded(), &grid, EDGES).data[0];
            let bound = y.bound(super::super::UNIT_ROUNDOFF_F32);
            let error = (f64::from(f32) - y.value).abs();
            assert!(error <= bound, "x = {x}: error {error:e} exceeds {bound:e}");
            worst = worst.max(error);
        }
        assert!(worst > 10.0 * super::super::UNIT_ROUNDOFF_F32, "the coordinate error shows: {worst:e}");
    }

    #[test]
    fn no_number_is_no_place() {
        assert_eq!(pixel(f64::NAN, 4, EDGES), None);
        assert_eq!(pixel(f64::INFINITY, 4, GridSample { padding: PaddingMode::Border, ..EDGES }), None);
        let nan = Tensor::new(&[1, 1, 1, 2], vec![f64::NAN, 0.0]);
        let image = Tensor::filled(&[1, 1, 2, 2], 7.0);
        for mode in [SampleMode::Linear, SampleMode::Nearest, SampleMode::Cubic] {
            assert_eq!(grid_sample(&image, &nan, GridSample { mode, ..EDGES }).data, [0.0], "{mode:?}");
        }
    }

    #[test]
    #[should_panic(expected = "grid [1, 1, 1, 3]")]
    fn a_grid_must_have_a_coordinate_per_axis() {
        grid_sample(&Tensor::<f64>::zeros(&[1, 1, 2, 2]), &Tensor::zeros(&[1, 1, 1, 3]), EDGES);
    }
}

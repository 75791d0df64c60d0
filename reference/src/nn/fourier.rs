//! The discrete Fourier transform, its short-time form, and windows.
//!
//! Yₖ = Σₙ xₙ·e^{−2πikn/N}, inverse xₙ = 1/N·Σₖ Yₖ·e^{2πikn/N}. The last axis holds real and imaginary parts, or a real part alone.
//!
//! Rounding: the sum of N products, with factors that are known to 4u of 1 (a kernel may compute its angles in its own
//! precision). A fast transform does not compute this sum: it lets every number of the line meet every output, also where
//! the factor is zero, and errs by at most O(log₂N·√N·u)·‖x‖₂. So the magnitude of each output is Σ|x| over both parts of
//! the line, the same for all of them.
//!
//! # References
//! ONNX operators DFT (versions 17 and 20), STFT, HannWindow, HammingWindow and BlackmanWindow (version 17).

use super::movement::transpose;
use super::transcendental::Elementary;
use super::{Scalar, Tensor};
use std::f64::consts::PI;

/// A complex number.
type Complex<T> = (T, T);

/// Which transform, and of what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fourier {
    /// N: the signal is cut off or continued by zeros.
    pub length: usize,
    /// From the spectrum back to the signal, divided by N.
    pub inverse: bool,
    /// The spectrum of a real signal, which repeats itself conjugated, is given up to ⌊N/2⌋ only. The inverse takes such a half and
    /// gives a real signal.
    pub onesided: bool,
}

/// The transform along an axis of x [..,1] or [..,2] → [..,2], or [..,1] for the inverse of a half.
///
/// # Panics
/// If the last axis is not of length one or two, or the axis is the last or none of x.
pub fn dft<T: Scalar>(x: &Tensor<T>, axis: usize, params: Fourier) -> Tensor<T> {
    let rank = x.rank();
    assert!(
        axis + 1 < rank && matches!(x.shape[rank - 1], 1 | 2),
        "dft: x must be [..,1] or [..,2] with axis {axis} before the last, found shape {:?}",
        x.shape
    );
    // The axis next to the complex parts.
    let mut order: Vec<usize> = (0..rank - 1).filter(|&a| a != axis).collect();
    order.extend([axis, rank - 1]);
    let turned = transpose(x, &order);
    let parts = x.shape[rank - 1];
    let mut shape = turned.shape.clone();
    let mut data = Vec::new();
    let lines = shape[..rank - 2].iter().product::<usize>();
    let count = x.shape[axis] * parts;
    for line in 0..lines {
        let line = &turned.data[line * count..(line + 1) * count];
        let line: Vec<Complex<T>> =
            line.chunks_exact(parts).map(|c| (c[0], if parts == 2 { c[1] } else { T::ZERO })).collect();
        data.extend(dft_line(&line, params));
    }
    let real = params.inverse && params.onesided;
    shape[rank - 2] = if params.onesided && !params.inverse { params.length / 2 + 1 } else { params.length };
    shape[rank - 1] = if real { 1 } else { 2 };
    let back: Vec<usize> = (0..rank).map(|a| order.iter().position(|&b| a == b).expect("an order")).collect();
    transpose(&Tensor::new(&shape, data), &back)
}

/// The transform of one line, real and imaginary parts alternating (or real parts alone).
fn dft_line<T: Scalar>(x: &[Complex<T>], Fourier { length: n, inverse, onesided }: Fourier) -> Vec<T> {
    let mut x: Vec<Complex<T>> = x.to_vec();
    if inverse && onesided {
        x.resize(n / 2 + 1, (T::ZERO, T::ZERO));
        for k in n / 2 + 1..n {
            let (re, im) = x[n - k];
            x.push((re, -im));
        }
    }
    x.resize(n, (T::ZERO, T::ZERO));
    let outputs = if onesided && !inverse { n / 2 + 1 } else { n };
    let magnitude: f64 = x.iter().map(|(re, im)| re.magnitude() + im.magnitude()).sum();
    let given = x.iter().fold(0.0_f64, |most, (re, im)| most.max(re.terms()).max(im.terms()));
    // 4 of a factor, one of its product, and 2N additions.
    let terms = given + 5.0 + 2.0 * n as f64;
    let size: f64 = x.iter().map(|(re, im)| re.magnitude() + im.magnitude()).sum();
    let mut y = Vec::with_capacity(2 * outputs);
    for k in 0..outputs {
        let mut sum = (T::ZERO, T::ZERO);
        for (j, &(re, im)) in x.iter().enumerate() {
            // The angle's whole turns are left out before it is rounded.
            let angle = 2.0 * PI * ((k * j) % n) as f64 / n as f64;
            let (sin, cos) = if inverse { angle.sin_cos() } else { (-angle).sin_cos() };
            let factor = |value: f64| {
                // The quarters of a turn are exact.
                match (4 * k * j).is_multiple_of(n) {
                    true => T::exact(value.round()),
                    false => T::within(value, 1.0, 4.0),
                }
            };
            let (cos, sin) = (factor(cos), factor(sin));
            sum.0 = sum.0.plus_product(re, cos).plus(-(im * sin));
            sum.1 = sum.1.plus_product(re, sin).plus_product(im, cos);
        }
        let spread = |sum: T| match T::TRACKS_ROUNDING && n > 1 {
            true => T::within(sum.value(), magnitude, terms),
            false => sum,
        };
        sum = (spread(sum.0), spread(sum.1));
        let scaled = |sum: T| {
            // Each of the 2N products and additions counts, whatever of them vanishes here.
            let sum = T::within(sum.value(), size, sum.terms().max((2 * n + 4) as f64));
            if inverse { sum / T::exact(n as f64) } else { sum }
        };
        y.push(scaled(sum.0));
        if !(inverse && onesided) {
            y.push(scaled(sum.1));
        }
    }
    y
}

/// The transforms of the pieces of a signal [N,L,1|2] that start every `step` elements, each multiplied by a window \[W\] → \[N,F,K,2\].
///
/// F = 1 + ⌊(L − W)/step⌋ whole pieces fit; K = W, or ⌊W/2⌋ + 1 for a half.
///
/// # Panics
/// If x is not [N,L,1|2], the step is zero, or the window longer than the signal.
pub fn stft<T: Scalar>(x: &Tensor<T>, step: usize, window: &Tensor<T>, onesided: bool) -> Tensor<T> {
    let length = window.data.len();
    assert!(
        x.rank() == 3 && window.rank() == 1 && step > 0 && length > 0 && length <= x.shape[1],
        "stft: x {:?} must be [N,L,1|2] with a window {:?} no longer than L, and the step {step} positive",
        x.shape,
        window.shape
    );
    let frames = 1 + (x.shape[1] - length) / step;
    let pieces = Tensor::from_fn(&[x.shape[0], frames, length, x.shape[2]], |i| {
        let weight = window.data[i[2]];
        let value = x.at(&[i[0], i[1] * step + i[2], i[3]]);
        if weight == T::exact(1.0) { value } else { value * weight }
    });
    dft(&pieces, 2, Fourier { length, inverse: false, onesided })
}

/// A window w(n) = Σⱼ (−1)ʲ·aⱼ·cos(2πjn/N), which sinks towards both ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Window {
    /// a = ½, ½.
    Hann,
    /// a = 25/46, 21/46.
    Hamming,
    /// a = 0.42, 0.5, 0.08.
    Blackman,
}

impl Window {
    /// The window of so many elements: N of the formula is `size`, for a period, or `size` − 1, for symmetry.
    ///
    /// # Conventions
    /// ONNX's Hamming window has a₀ = 25/46 = 0.543…; PyTorch's and NumPy's 0.54.
    pub fn of<T: Scalar>(self, size: usize, periodic: bool) -> Tensor<T> {
        let coefficients: &[f64] = match self {
            Window::Hann => &[0.5, 0.5],
            Window::Hamming => &[25.0 / 46.0, 21.0 / 46.0],
            Window::Blackman => &[0.42, 0.5, 0.08],
        };
        let period = if periodic { size } else { size - usize::from(size > 0) } as f64;
        Tensor::from_fn(&[size], |i| {
            coefficients.iter().enumerate().fold(T::ZERO, |sum, (j, &a)| {
                let a = T::within(if j % 2 == 0 { a } else { -a }, a, 1.0);
                // π, two products and a quotient are rounded.
                let angle = 2.0 * PI * (j * i[0]) as f64 / period;
                if j == 0 {
                    sum.plus(a)
                } else {
                    sum.plus_product(a, Elementary::cos(T::within(angle, angle, 4.0)))
                }
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::*;

    fn plain(length: usize) -> Fourier {
        Fourier { length, inverse: false, onesided: false }
    }

    #[test]
    fn an_oscillation_becomes_one_line() {
        let x = Tensor::from_fn(&[8, 1], |i| (2.0 * PI * 2.0 * i[0] as f64 / 8.0).cos());
        let y = dft(&x, 0, plain(8));
        for k in 0..8 {
            let expected = if k == 2 || k == 6 { 4.0 } else { 0.0 };
            assert!(
                (y.at(&[k, 0]) - expected).abs() < 1e-14 && y.at(&[k, 1]).abs() < 1e-14,
                "line {k}: {y:?}"
            );
        }
        let half = dft(&x, 0, Fourier { onesided: true, ..plain(8) });
        assert_eq!((half.shape, &half.data[..]), (vec![5, 2], &y.data[..10]));
    }

    #[test]
    fn the_inverse_undoes_the_transform_along_any_axis() {
        let x = pattern(&[3, 5, 2], 1);
        for axis in 0..2 {
            let n = x.shape[axis];
            let back = dft(&dft(&x, axis, plain(n)), axis, Fourier { inverse: true, ..plain(n) });
            assert!(back.data.iter().zip(&x.data).all(|(b, x)| (b - x).abs() < 1e-14), "axis {axis}");
        }
        for n in [4, 5] {
            let real = pattern(&[n, 1], 2);
            let half = dft(&real, 0, Fourier { onesided: true, ..plain(n) });
            let back = dft(&half, 0, Fourier { length: n, inverse: true, onesided: true });
            assert!(back.shape == real.shape, "a real signal again");
            assert!(back.data.iter().zip(&real.data).all(|(b, x)| (b - x).abs() < 1e-14), "{n}: {back:?}");
        }
    }

    #[test]
    fn a_signal_is_cut_off_or_continued_by_zeros() {
        let x = Tensor::new(&[3, 1], vec![1.0, 2.0, 3.0]);
        let first_line = |n| dft(&x, 0, plain(n)).data[0];
        assert_eq!((first_line(2), first_line(3), first_line(5)), (3.0, 6.0, 6.0));
    }

    #[test]
    fn pieces_are_windowed_and_transformed() {
        let x = pattern(&[1, 7, 1], 1);
        let window: Tensor = Window::Hann.of(4, true);
        let y = stft(&x, 2, &window, true);
        assert_eq!(y.shape, [1, 2, 3, 2]);
        let mean: f64 = (0..4).map(|n| x.data[2 + n] * window.data[n]).sum();
        assert!((y.at(&[0, 1, 0, 0]) - mean).abs() < 1e-15);
    }

    #[test]
    fn windows_by_their_ends_and_middle() {
        let ends = |window: Window| {
            let w: Tensor = window.of(5, false);
            (w.data[0], w.data[2], w.data[4])
        };
        let close = |found: (f64, f64, f64), end: f64| {
            (found.0 - end).abs() < 1e-15 && (found.1 - 1.0).abs() < 1e-15 && (found.2 - end).abs() < 1e-15
        };
        assert!(close(ends(Window::Hann), 0.0) && close(ends(Window::Hamming), 4.0 / 46.0));
        assert!(close(ends(Window::Blackman), 0.0));
        let periodic: Tensor = Window::Hann.of(4, true);
        assert!((periodic.data[2] - 1.0).abs() < 1e-15 && periodic.data[3] > 0.1);
    }
}

//! One axis of a separable interpolation: which pixels a point between them is read from, with which weights.
//!
//! A point at p = i + f, i = ⌊p⌋, of an axis whose pixel k lies at k:
//!
//! | kind | y(p) |
//! |---|---|
//! | linear | (1 − f)·v_i + f·v_{i+1} |
//! | cubic | Σ_k W(p − k)·v_k over i − 1 … i + 2, W Keys' kernel of parameter a |
//! | antialiased | Σ_k W(s·(p − k))·v_k / Σ_k W(s·(p − k)), the kernel stretched by 1/s where s < 1 pixels come out per pixel |
//!
//! W(t) = (a + 2)|t|³ − (a + 3)|t|² + 1 for |t| ≤ 1 and a|t|³ − 5a|t|² + 8a|t| − 4a for 1 < |t| < 2 (linear: 1 − |t|).
//!
//! # Rounding
//! Two parts. The arithmetic: with weight ŵ and pixel v̂ each known to within γ·m, |ŵv̂ − wv| ≤ γ(|w|·m_v + m_w·|v|), then a
//! product and the additions. And the coordinate: an error e of p moves y by the slope times e, to first order. The
//! slope of the linear kind is a difference of neighbours, the largest of the cell and the two beside it, since e may carry
//! the point over a pixel; the cubic kind has a continuous slope; the antialiased one has kinks anywhere, and its slope
//! is bounded by Σ_k max|W′|·s·|v_k − y| / Σ W.
//!
//! # References
//! R. G. Keys, Cubic convolution interpolation for digital image processing, IEEE TASSP 29 (1981), equation 4 (ONNX and
//! PyTorch take a = −3/4, Keys −1/2).

use super::Scalar;

/// The pixels around a point along one axis, and what each weighs.
#[derive(Clone, Debug)]
pub(super) struct Stencil<T> {
    /// The pixel of the first weight, which may lie outside the image; the others follow.
    pub first: i64,
    /// One weight per pixel.
    pub weights: Vec<T>,
    slope: Slope,
    /// Magnitude and terms of the coordinate's rounding.
    magnitude: f64,
    terms: f64,
}

/// What an error of the coordinate does.
#[derive(Clone, Debug)]
enum Slope {
    /// The derivatives of the weights, once for each piece of the kernel that the error may reach.
    Pieces(Vec<Vec<f64>>),
    /// A bound on the derivative of each weight.
    AtMost(f64),
}

/// The kernel of an interpolation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kernel {
    /// 1 − |t|.
    Linear,
    /// Keys' kernel with this a.
    Cubic(f64),
}

impl Kernel {
    /// W(t) = 0 from here on.
    fn reach(self) -> f64 {
        match self {
            Kernel::Linear => 1.0,
            Kernel::Cubic(_) => 2.0,
        }
    }

    /// W(t).
    fn at<T: Scalar>(self, t: T) -> T {
        let t = if t.value() < 0.0 { -t } else { t };
        if t.value() >= self.reach() {
            return T::ZERO;
        }
        let number = T::exact;
        match self {
            Kernel::Linear => number(1.0) - t,
            Kernel::Cubic(a) if t.value() <= 1.0 => {
                ((number(a + 2.0) * t - number(a + 3.0)) * t * t).plus(number(1.0))
            }
            Kernel::Cubic(a) => {
                ((number(a) * t - number(5.0 * a)) * t).plus(number(8.0 * a)) * t - number(4.0 * a)
            }
        }
    }

    /// W′(t) of the cubic kernel, continuous everywhere.
    fn derivative(a: f64, t: f64) -> f64 {
        let r = t.abs();
        let slope = match r {
            r if r <= 1.0 => (3.0 * (a + 2.0) * r - 2.0 * (a + 3.0)) * r,
            r if r < 2.0 => (3.0 * a * r - 10.0 * a) * r + 8.0 * a,
            _ => 0.0,
        };
        slope * t.signum()
    }

    /// max|W′|: at the kernel's own extrema, its joints, and r = 5/3 where W″ vanishes in the outer piece.
    fn steepest(self) -> f64 {
        match self {
            Kernel::Linear => 1.0,
            Kernel::Cubic(a) => {
                let inner = (a + 3.0) / (3.0 * (a + 2.0));
                [inner.clamp(0.0, 1.0), 1.0, 5.0 / 3.0]
                    .map(|r| Self::derivative(a, r).abs())
                    .into_iter()
                    .fold(0.0, f64::max)
            }
        }
    }
}

impl<T: Scalar> Stencil<T> {
    /// Around p by an unstretched kernel.
    pub fn new(kernel: Kernel, p: T) -> Stencil<T> {
        let i = p.value().floor();
        let f = T::exact(p.value() - i);
        let weights = match kernel {
            Kernel::Linear => vec![T::ZERO, T::exact(1.0) - f, f, T::ZERO],
            Kernel::Cubic(_) => (-1..=2).map(|k| kernel.at(f - T::exact(f64::from(k)))).collect(),
        };
        let slope = match kernel {
            _ if !T::TRACKS_ROUNDING => Slope::AtMost(0.0),
            Kernel::Linear => Slope::Pieces(
                (0..3).map(|k| (0..4).map(|j| f64::from(j == k + 1) - f64::from(j == k)).collect()).collect(),
            ),
            Kernel::Cubic(a) => Slope::Pieces(vec![
                (-1..=2).map(|k| Kernel::derivative(a, f.value() - f64::from(k))).collect(),
            ]),
        };
        Stencil::around(p, i as i64 - 1, weights, slope)
    }

    /// Around p by a kernel stretched to the `scale` < 1 of an image that shrinks, its weights brought to a sum of one.
    pub fn antialiased(kernel: Kernel, p: T, scale: f64) -> Stencil<T> {
        let reach = (kernel.reach() / scale).ceil() as i64;
        let first = p.value().floor() as i64 - reach + 1;
        let weights: Vec<T> = (first..first + 2 * reach)
            .map(|k| kernel.at((T::exact(p.value()) - T::exact(k as f64)) * T::exact(scale)))
            .collect();
        Stencil::around(p, first, weights, Slope::AtMost(kernel.steepest() * scale)).normalized()
    }

    fn around(p: T, first: i64, weights: Vec<T>, slope: Slope) -> Stencil<T> {
        // Beside the roundings of p itself: the subtraction of i, and one for p brought into the image or multiplied
        // with a reciprocal instead of divided.
        let (magnitude, terms) = if p.terms() == 0.0 { (0.0, 0.0) } else { (p.magnitude(), p.terms() + 2.0) };
        Stencil { first, weights, slope, magnitude, terms }
    }

    /// The same without the pixels outside an image of this length, the weights of the others brought to a sum of one.
    pub fn inside(mut self, length: usize) -> Stencil<T> {
        for (k, weight) in (self.first..).zip(&mut self.weights) {
            if !(0..length as i64).contains(&k) {
                *weight = T::ZERO;
                if let Slope::Pieces(pieces) = &mut self.slope {
                    for piece in pieces {
                        piece[(k - self.first) as usize] = 0.0;
                    }
                }
            }
        }
        self.normalized()
    }

    fn normalized(mut self) -> Stencil<T> {
        let sum = self.weights.iter().copied().fold(T::ZERO, T::plus);
        if sum.value() == 0.0 {
            return self;
        }
        for weight in &mut self.weights {
            *weight = *weight / sum;
        }
        match &mut self.slope {
            Slope::Pieces(pieces) => {
                for piece in pieces {
                    piece.iter_mut().for_each(|slope| *slope /= sum.value());
                }
            }
            Slope::AtMost(slope) => *slope /= sum.value().abs(),
        }
        self
    }

    /// The pixels of the weights in an image of this length whose border goes on outside.
    pub fn pixels(&self, length: usize) -> impl Iterator<Item = usize> {
        let last = length as i64 - 1;
        let first = self.first;
        (0..self.weights.len() as i64).map(move |k| (first + k).clamp(0, last) as usize)
    }

    /// Σ w·v of the pixels' values, one per weight.
    ///
    /// `additions` are those that the sum counts: one less than the weights that are not zero by construction, times
    /// the number of sums that axes before this one made of every pixel, because another implementation may
    /// multiply the axes' weights first and add all products in one sum.
    pub fn blend(&self, values: &[T], additions: f64) -> T {
        let pairs = || self.weights.iter().zip(values).filter(|(w, _)| w.magnitude() != 0.0);
        let y: f64 = pairs().map(|(w, v)| w.value() * v.value()).sum();
        if !T::TRACKS_ROUNDING {
            return T::exact(y);
        }
        let mut magnitude: f64 = pairs()
            .map(|(w, v)| {
                w.value().abs() * v.magnitude() + (w.magnitude() - w.value().abs()) * v.value().abs()
            })
            .sum();
        let operands = pairs().map(|(w, v)| w.terms() + v.terms()).fold(0.0, f64::max);
        let mut terms = operands + 1.0 + additions;
        if self.magnitude > 0.0 {
            let slope = match &self.slope {
                Slope::Pieces(pieces) => pieces
                    .iter()
                    .map(|piece| {
                        piece.iter().zip(values).map(|(d, v)| d * (v.value() - y)).sum::<f64>().abs()
                    })
                    .fold(0.0, f64::max),
                Slope::AtMost(steepest) => {
                    steepest * values.iter().map(|v| (v.value() - y).abs()).sum::<f64>()
                }
            };
            magnitude += slope * self.magnitude;
            if slope > 0.0 {
                terms = terms.max(self.terms);
            }
        }
        T::within(y, magnitude, terms)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    const KEYS: Kernel = Kernel::Cubic(-0.5);

    #[test]
    fn a_kernel_is_one_at_its_pixel_and_zero_at_all_others() {
        for kernel in [Kernel::Linear, KEYS, Kernel::Cubic(-0.75)] {
            assert_eq!(kernel.at(0.0), 1.0, "{kernel:?}");
            for k in [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0] {
                assert_eq!(kernel.at(k), 0.0, "{kernel:?} at {k}");
            }
        }
    }

    #[test]
    fn weights_sum_to_one_and_keys_kernel_reproduces_parabolas() {
        for p in [3.0, 3.25, 3.5, 3.9, 4.0_f64] {
            for kernel in [Kernel::Linear, KEYS, Kernel::Cubic(-0.75)] {
                let sum: f64 = Stencil::new(kernel, p).weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-14, "{kernel:?} at {p}: {sum}");
                for scale in [0.3, 0.5, 0.8] {
                    let sum: f64 = Stencil::antialiased(kernel, p, scale).weights.iter().sum();
                    assert!((sum - 1.0).abs() < 1e-14, "{kernel:?} at {p} by {scale}: {sum}");
                }
            }
            let stencil = Stencil::new(KEYS, p);
            let parabola: Vec<f64> = stencil.pixels(9).map(|k| (k * k) as f64).collect();
            assert!(
                (stencil.blend(&parabola, 0.0) - p * p).abs() < 1e-13,
                "a = −1/2 is exact to second order"
            );
        }
    }

    #[test]
    fn the_derivative_is_that_of_the_kernel() {
        for kernel_a in [-0.5, -0.75, -1.0] {
            let kernel = Kernel::Cubic(kernel_a);
            let mut steepest: f64 = 0.0;
            for i in -250..250 {
                let (t, h) = (f64::from(i) / 100.0 + 0.003, 1e-6);
                let numerical = (kernel.at(t + h) - kernel.at(t - h)) / (2.0 * h);
                let derivative = Kernel::derivative(kernel_a, t);
                assert!((numerical - derivative).abs() < 1e-8, "at {t}: {numerical} and {derivative}");
                steepest = steepest.max(derivative.abs());
            }
            let bound = kernel.steepest();
            assert!(steepest <= bound && bound < 1.01 * steepest, "{steepest} below {bound}");
        }
    }

    #[test]
    fn outside_pixels_are_left_out_and_the_others_make_up_for_them() {
        let stencil = Stencil::new(KEYS, 0.25_f64).inside(4);
        assert_eq!(stencil.weights[0], 0.0, "pixel −1");
        assert!((stencil.weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn the_bound_covers_f32_with_a_coordinate_that_is_rounded() {
        let row: Vec<f32> = (0..400_u16).map(|k| (f32::from(k) * 12.9898).sin()).collect();
        for kernel in [Kernel::Linear, Kernel::Cubic(-0.75)] {
            let mut worst: f64 = 0.0;
            for j in 0..500_u16 {
                let p = (f32::from(j) + 0.5) / 1.3 - 0.5;
                let rounded = (Rounded::exact(f64::from(j) + 0.5) / Rounded::exact(f64::from(1.3_f32)))
                    - Rounded::exact(0.5);
                let stencil = Stencil::new(kernel, rounded);
                let values: Vec<Rounded> =
                    stencil.pixels(400).map(|k| Rounded::exact(f64::from(row[k]))).collect();
                let y = stencil.blend(&values, 3.0);
                let (i, f) = (p.floor(), p - p.floor());
                let at = |k: f32| row[(i + k).clamp(0.0, 399.0) as usize];
                let found = match kernel {
                    Kernel::Linear => (1.0 - f) * at(0.0) + f * at(1.0),
                    Kernel::Cubic(a) => {
                        let a = a as f32;
                        let inner = |t: f32| ((a + 2.0) * t - (a + 3.0)) * t * t + 1.0;
                        let outer = |t: f32| ((a * t - 5.0 * a) * t + 8.0 * a) * t - 4.0 * a;
                        outer(f + 1.0) * at(-1.0)
                            + inner(f) * at(0.0)
                            + inner(1.0 - f) * at(1.0)
                            + outer(2.0 - f) * at(2.0)
                    }
                };
                let share = (f64::from(found) - y.value).abs() / y.bound(UNIT_ROUNDOFF_F32);
                assert!(share <= 1.0, "{kernel:?} at output {j}: {share} of the bound");
                worst = worst.max(share);
            }
            assert!(worst > 0.02, "{kernel:?}: the bound is not idle: {worst}");
        }
    }
}

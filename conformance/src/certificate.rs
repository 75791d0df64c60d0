//! The rounding certificate: what a difference between runtime and reference can be.
//!
//! The reference gives, for every element of a tensor and from the runtime's own inputs,
//!
//! - y, the value (f64),
//! - m, the operator evaluated on absolute values: one rounding of something of this size costs at most u·m, u = 2⁻²⁴.
//!   The difference in this unit is the *condition-scaled ulp*, csu = |ŷ − y| / (u·m);
//! - the bound b: no order of f32 operations, fused or not, can err by more (Higham 2002, section 3.1). n = b/(u·m) is
//!   about the number of roundings that can pile up.
//!
//! Roundings that pile up at random reach about √n, not n (Higham and Mary 2019), hence three grades inside f32:
//!
//! | grade | csu | means |
//! |---|---|---|
//! | [`Verdict::Exact`] (G0) | f32(y) bit for bit | correctly rounded |
//! | [`Verdict::Rounding`] (G1) | ≤ min(4√n, n) | ordinary rounding |
//! | [`Verdict::Unusual`] (G2) | ≤ n | rounding could do it, but rarely does: lower precision or a bias |
//! | [`Verdict::Different`] (G3) | > n | cannot be rounding: another meaning, precision or number |
//!
//! # Where does it not hold?
//! Winograd and FFT convolutions err relative to a whole tile, not to an element; underflow adds an absolute error that
//! u·m does not cover. ONNX Runtime's CPU kernels use neither transform, and the problems judged here stay above
//! 2⁻¹²⁶ in every product.

use std::fmt;

/// Unit roundoff of f32: 2⁻²⁴.
pub const UNIT_ROUNDOFF: f64 = 1.0 / 16_777_216.0;

/// How many √n the random model of rounding allows before a difference counts as unusual.
///
/// Measured: 1.58 was the largest over 78 linear nodes of six networks on ONNX Runtime's CPU kernels; the model's failure
/// probability at λ is 2·exp(−λ²/2), which is 7·10⁻⁴ at 4.
pub const LAMBDA: f64 = 4.0;

/// What a difference can be, from best to worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Verdict {
    /// G0: bit-identical to the reference rounded to f32.
    Exact,
    /// G1: ordinary rounding.
    Rounding,
    /// G2: within the proven bound, but more than random roundings make.
    Unusual,
    /// G3: more than any order of roundings can make.
    Different,
}

impl Verdict {
    /// Whether the difference can be rounding: everything but G3.
    pub fn is_rounding(self) -> bool {
        self != Self::Different
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Exact => "G0 exact",
            Self::Rounding => "G1 rounding",
            Self::Unusual => "G2 unusual",
            Self::Different => "G3 different",
        })
    }
}

/// The verdict on one element: `found` against `value` ± `bound`, with `unit` = u·m.
///
/// Values that are not finite must be found as they are: NaN where NaN is expected, the same infinity where one is.
/// A bound that is not a finite, non-negative number bounds nothing, and the verdict is [`Verdict::Different`].
pub fn grade(found: f32, value: f64, bound: f64, unit: f64) -> Verdict {
    if found.to_bits() == (value as f32).to_bits() || (found.is_nan() && value.is_nan()) {
        return Verdict::Exact;
    }
    let error = (f64::from(found) - value).abs();
    if !error.is_finite() || !(0.0..f64::INFINITY).contains(&bound) {
        return Verdict::Different;
    }
    if error == 0.0 {
        // +0 for −0: equal, and IEEE 754 lets the order of additions decide.
        return Verdict::Exact;
    }
    if error > bound {
        return Verdict::Different;
    }
    // The usual part never exceeds the bound, whatever the unit.
    let usual = if unit > 0.0 { LAMBDA * (bound / unit).sqrt() * unit } else { bound };
    if error <= usual { Verdict::Rounding } else { Verdict::Unusual }
}

/// A systematic part of the differences: e ≈ slope·y, by least squares with every element weighted by 1/unit.
///
/// A factor of 1.0005 on the weights of a long sum hides below every bound, since the sum cancels and the bound does not.
/// It cannot hide here: roundings point both ways and average out, a factor does not. Factors above n·u are seen, whatever
/// the cancellation: 1.0005 is 8389·u.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// The factor's deviation from one: Σ e·y/unit² / Σ (y/unit)².
    pub slope: f64,
    /// The slope in units of its own standard deviation, from the scatter of the differences around it.
    pub z: f64,
    /// The largest slope that rounding makes: n·u with the mean n = bound/unit, divided by the root mean square of y/m
    /// where the elements share roundings.
    pub limit: f64,
    /// Elements that took part.
    pub elements: usize,
}

impl Slope {
    /// Fewest elements from which a slope is estimated: below, one unlucky rounding is a slope.
    pub const FEWEST: usize = 32;
    /// A slope within this many of its standard deviations is chance.
    ///
    /// Chance passes 8 less than once in 10¹⁴ for Gaussian scatter; roundings are bounded, which is tamer.
    pub const Z: f64 = 8.0;

    /// Estimates the slope from differences e, values y, bounds and units; `None` when too few elements carry a unit.
    ///
    /// Independent roundings average out, except where all elements are made of the same few numbers and so round alike
    /// (the even background of a masked image, voxels that are 0 or 1): there nothing cancels, m = |y|, and the bound
    /// n·u·m is a slope of n·u. A rounding that elements share, such as a variance's that is lost by cancellation, is itself a
    /// factor: it may be as large as n·u·m/|y|, for which the root mean square over the elements stands.
    pub fn estimate(elements: impl Iterator<Item = (f64, f64, f64, f64)>, shared: bool) -> Option<Self> {
        let (mut count, mut ey, mut yy, mut ee, mut roundings) = (0_usize, 0.0, 0.0, 0.0, 0.0);
        for (error, value, bound, unit) in elements {
            if unit > 0.0 && error.is_finite() && value.is_finite() && bound.is_finite() {
                let (e, y) = (error / unit, value / unit);
                count += 1;
                ey += e * y;
                yy += y * y;
                ee += e * e;
                roundings += bound / unit;
            }
        }
        if count < Self::FEWEST || yy == 0.0 {
            return None;
        }
        let slope = ey / yy;
        let scatter = ((ee - slope * ey).max(0.0) / (count - 1) as f64).sqrt();
        // Differences that a factor explains entirely leave no scatter; then any slope is certain.
        let z = if slope == 0.0 { 0.0 } else { slope * yy.sqrt() / scatter };
        let roundings = (roundings / count as f64).max(1.0);
        // Σc² = u²·Σ(y/unit)².
        let condition = if shared { (count as f64 / yy).sqrt() / UNIT_ROUNDOFF } else { 1.0 };
        let limit = roundings * UNIT_ROUNDOFF * condition.max(1.0);
        Some(Self { slope, z, limit, elements: count })
    }

    /// Whether the differences have a common factor that rounding does not make.
    ///
    /// Both are asked for. z alone is not enough: where all elements are made of the same few numbers (voxels are 0 or 1)
    /// they share their roundings, and a correct convolution reaches z = 26 with a slope of 0.14 u. The slope alone is not
    /// enough either, since a few cancelling elements can have any slope.
    pub fn is_systematic(&self) -> bool {
        self.z.abs() > Self::Z && self.slope.abs() > self.limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grades_are_ordered_by_distance() {
        let (value, unit) = (1.0, UNIT_ROUNDOFF);
        let n = 100.0;
        let at = |csu: f64| grade((value + csu * unit) as f32, value, n * unit, unit);
        assert_eq!(at(0.0), Verdict::Exact, "the value itself");
        assert_eq!(at(40.0), Verdict::Rounding, "4·√100");
        assert_eq!(at(90.0), Verdict::Unusual, "below 100");
        assert_eq!(at(102.0), Verdict::Different, "above 100");
        assert!(
            Verdict::Exact < Verdict::Rounding && Verdict::Unusual < Verdict::Different,
            "worst is largest"
        );
    }

    #[test]
    fn a_bound_that_bounds_nothing_accepts_nothing() {
        for bound in [f64::NAN, f64::INFINITY, -1.0] {
            assert_eq!(grade(2.0, 1.0, bound, 1.0), Verdict::Different, "bound {bound}");
        }
    }

    #[test]
    fn numbers_that_are_not_finite_must_be_expected() {
        assert_eq!(grade(f32::NAN, f64::NAN, 1.0, 1.0), Verdict::Exact, "NaN for NaN");
        assert_eq!(grade(f32::INFINITY, f64::INFINITY, 1.0, 1.0), Verdict::Exact, "∞ for ∞");
        for (found, value) in [
            (f32::NAN, 1.0),
            (1.0, f64::NAN),
            (f32::INFINITY, 1.0),
            (f32::NEG_INFINITY, f64::INFINITY),
            (f32::MAX, f64::INFINITY),
        ] {
            assert_eq!(grade(found, value, 1e300, 1.0), Verdict::Different, "{found} for {value}");
        }
    }

    #[test]
    fn where_the_bound_is_zero_only_the_value_itself_passes() {
        assert_eq!(grade(0.0, 0.0, 0.0, 0.0), Verdict::Exact, "0 for 0");
        assert_eq!(grade(-0.0, 0.0, 0.0, 0.0), Verdict::Exact, "−0 equals 0");
        for wrong in [f32::MIN_POSITIVE, 1e-30, 1.0] {
            assert_eq!(grade(wrong, 0.0, 0.0, 0.0), Verdict::Different, "{wrong} for 0");
        }
    }

    /// Pseudo-random roundings in −1..1 csu around cancelling sums y = c·m with c in −1/8..1/8.
    fn noisy(factor: f64) -> Vec<(f64, f64, f64, f64)> {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        (0..512)
            .map(|i| {
                let magnitude = 10_f64.powi(i % 7 - 3);
                let unit = UNIT_ROUNDOFF * magnitude;
                let value = magnitude * next() / 8.0;
                (next() * unit + factor * value, value, 4000.0 * unit, unit)
            })
            .collect()
    }

    #[test]
    fn a_factor_below_every_bound_is_seen_and_noise_is_not() {
        let fault = noisy(5e-4);
        let hidden = |&(error, _, bound, _): &(f64, f64, f64, f64)| error.abs() <= bound;
        assert!(fault.iter().all(hidden), "the bound alone is blind to it");
        let seen = Slope::estimate(fault.into_iter(), false).expect("enough elements");
        assert!(seen.is_systematic(), "{seen:?}");
        let noise = Slope::estimate(noisy(0.0).into_iter(), false).expect("enough elements");
        assert!(!noise.is_systematic(), "{noise:?}");
    }

    #[test]
    fn a_factor_that_all_elements_share_by_rounding_is_no_fault() {
        // m = 10⁶·|y|: cancellation has eaten the statistic that all elements are divided by.
        let elements = || {
            (0..64).map(|i| {
                let value = f64::from(i) - 31.5;
                (1e-3 * value, value, 300e6 * UNIT_ROUNDOFF * 64.0, 1e6 * UNIT_ROUNDOFF * 64.0)
            })
        };
        assert!(!Slope::estimate(elements(), true).expect("enough elements").is_systematic(), "shared");
        assert!(Slope::estimate(elements(), false).expect("enough elements").is_systematic(), "independent");
    }

    #[test]
    fn few_elements_have_no_slope() {
        assert_eq!(Slope::estimate(noisy(5e-4).into_iter().take(Slope::FEWEST - 1), false), None, "too few");
    }
}

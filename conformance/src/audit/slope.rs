//! A factor that all differences of a tensor share, however small.
//!
//! A factor of 1.000001 on a long sum hides below every bound, since the sum cancels and the bound does not. It cannot hide
//! among many: roundings point both ways and average out, a factor does not. The slope of the differences e against the
//! values y, each in units of u·m, is Σ e·y / Σ y² over the elements.
//!
//! # Which elements are independent?
//! Where many elements are made of the same numbers (the even background of a masked image, voxels that are 0 or 1) they
//! round alike: their differences are one difference, copied. So equal values count once. And where elements share an
//! intermediate result, as those do that are divided by one deviation, they share its rounding: there the number of such
//! groups counts, not that of the elements.
//!
//! # How large may it be?
//! The mean of N independent sums of n roundings is off by about √(n/N) units; λ = 4 of these, and 4 units for what every
//! element may share (the rounding of a folded factor, a polynomial's error). Clean f32 graphs stay far below; a factor of
//! 1.000001 is a slope of 17 units.

use crate::certificate::LAMBDA;

/// One element's difference.
#[derive(Clone, Copy, Debug)]
pub struct Deviation {
    /// The value's bits: equal ones are copies.
    pub key: u64,
    /// e/(u·m).
    pub error: f64,
    /// y/(u·m).
    pub value: f64,
    /// n.
    pub terms: f64,
}

impl Deviation {
    /// A number that is as good as random for each value, and the same for equal ones.
    pub fn key(value: f64) -> u64 {
        // The multiplier of Knuth's 64-bit generator; its upper bits mix all lower ones.
        value.to_bits().wrapping_mul(6_364_136_223_846_793_005) >> 32
    }
}

/// The common factor of a tensor's differences, less one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// Σ e·y / Σ y², in units of (u·m)²: found is about (1 + slope)·expected.
    pub slope: f64,
    /// The slope in units of its own standard deviation, from the scatter of the differences around it.
    pub z: f64,
    /// The mean of e/(u·m) in units of its standard deviation.
    pub mean_z: f64,
    /// The largest slope that rounding makes.
    pub limit: f64,
}

impl Slope {
    /// Fewest distinct elements from which a slope is estimated: below, one unlucky rounding is a slope.
    pub const FEWEST: usize = 32;
    /// About the most that take part; larger tensors are thinned.
    pub const MOST: usize = 1 << 16;
    /// A slope within this many of its standard deviations is chance, which passes 8 less than once in 10¹⁴.
    pub const Z: f64 = 8.0;
    /// Units that all elements may share.
    const SHARED: f64 = 4.0;
    /// A z beyond this says no more; differences that a factor explains entirely would have an infinite one.
    const LARGEST_Z: f64 = 1e9;

    /// Estimates the slope, in a precision with this unit roundoff; `None` when too few distinct values have a difference.
    ///
    /// `groups` is the number of groups of elements that share an intermediate result, `None` where none do. A shared
    /// rounding is a factor on what it is multiplied with, not on the result: where that cancels, the slope is larger by
    /// the root mean square of m/|y|.
    pub fn of(mut deviations: Vec<Deviation>, unit: f64, groups: Option<usize>) -> Option<Self> {
        deviations.sort_unstable_by(|a, b| a.key.cmp(&b.key).then(a.error.total_cmp(&b.error)));
        deviations.dedup_by_key(|deviation| deviation.key);
        let count = deviations.len() as f64;
        if deviations.len() < Self::FEWEST {
            return None;
        }
        let sum = |f: &dyn Fn(&Deviation) -> f64| deviations.iter().map(f).sum::<f64>();
        let (e, ee) = (sum(&|d| d.error), sum(&|d| d.error * d.error));
        let (ey, yy) = (sum(&|d| d.error * d.value), sum(&|d| d.value * d.value));
        let terms = sum(&|d| d.terms) / count;
        if ee == 0.0 || yy == 0.0 {
            return Some(Self { slope: 0.0, z: 0.0, mean_z: 0.0, limit: unit * terms });
        }
        let slope = ey / yy;
        let certain = |z: f64| if z.is_nan() { 0.0 } else { z.clamp(-Self::LARGEST_Z, Self::LARGEST_Z) };
        let scatter = ((ee - slope * ey).max(0.0) / (count - 1.0)).sqrt();
        let z = certain(slope * yy.sqrt() / scatter);
        let deviation = ((ee - e * e / count).max(0.0) / (count - 1.0)).sqrt();
        let mean_z = certain(e / count.sqrt() / deviation);
        // A few elements may carry all the weight: the participation ratio counts those that do.
        let carrying = yy * yy / sum(&|d| d.value.powi(4));
        let (independent, condition) = match groups {
            None => (carrying, 1.0),
            Some(groups) => (carrying.min(groups as f64), ((count / yy).sqrt() / unit).max(1.0)),
        };
        let limit = terms.min(Self::SHARED + LAMBDA * (terms / independent).sqrt()) * condition * unit;
        Some(Self { slope, z, mean_z, limit })
    }

    /// Whether the differences have a common factor that rounding does not make.
    pub fn is_systematic(&self) -> bool {
        self.z.abs() > Self::Z && self.slope.abs() > self.limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certificate::UNIT_ROUNDOFF;

    /// Roundings of ±√n csu around cancelling sums of n = 289 roundings, with a factor.
    fn noisy(factor: f64, count: usize) -> Vec<Deviation> {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        (0..count)
            .map(|_| {
                let value = next() / 8.0;
                let error = 4.0 * next() + factor * value / UNIT_ROUNDOFF;
                Deviation { key: value.to_bits(), error, value: value / UNIT_ROUNDOFF, terms: 289.0 }
            })
            .collect()
    }

    fn slope(deviations: Vec<Deviation>, groups: Option<usize>) -> Slope {
        Slope::of(deviations, UNIT_ROUNDOFF, groups).expect("enough elements")
    }

    #[test]
    fn a_factor_below_every_bound_is_seen_and_noise_is_not() {
        for factor in [1e-6, -1e-6, 5e-4] {
            let seen = slope(noisy(factor, 20_000), None);
            assert!(seen.is_systematic(), "{factor}: {seen:?}");
            assert!((seen.slope / factor - 1.0).abs() < 0.1, "{factor}: {seen:?}");
        }
        let noise = slope(noisy(0.0, 20_000), None);
        assert!(!noise.is_systematic(), "{noise:?}");
    }

    #[test]
    fn copies_of_one_difference_are_one_difference() {
        let copies: Vec<Deviation> = (0..40)
            .flat_map(|i| {
                let value = f64::from(i) + 100.0;
                let one = Deviation { key: value.to_bits(), error: 10.0, value: value * 1e5, terms: 289.0 };
                std::iter::repeat_n(one, 1000)
            })
            .collect();
        assert!(
            !slope(copies, None).is_systematic(),
            "forty values, each rounded the same way a thousand times"
        );
        assert_eq!(Slope::of(noisy(1e-6, Slope::FEWEST - 1), UNIT_ROUNDOFF, None), None, "too few");
    }

    #[test]
    fn what_a_group_shares_by_rounding_is_no_fault() {
        let shared = || noisy(30.0 * UNIT_ROUNDOFF, 20_000);
        assert!(slope(shared(), None).is_systematic(), "independent");
        assert!(!slope(shared(), Some(4)).is_systematic(), "four groups of 289 roundings each");
    }
}

//! What the differences of one tensor come to: gathered element by element, in parts that can be joined.

use std::collections::BTreeMap;

use vitruvian_reference::nn::Rounded;

use super::precision::Precision;
use super::region::unravel;
use super::report::{Grade, Special, TensorReport, WorstElement};
use super::slope::{Deviation, Slope};
use crate::certificate::Verdict;
use crate::onnx::element::ElementType;

/// Worst elements that are kept.
const KEPT: usize = 5;

/// Bins of the histogram from which the percentile is read, eight to a factor of two: it is right within 5 %.
const BINS: usize = 1024;

/// One element among the worst.
#[derive(Clone, Debug)]
struct Bad {
    place: usize,
    share: f64,
    expected: f64,
    found: f64,
    csu: f64,
}

/// The differences of one tensor, or of a part of it.
#[derive(Clone, Debug)]
pub struct Measure {
    element: ElementType,
    precision: Option<Precision>,
    /// One in so many distinct values takes part in the slope, so that a tensor of any size gives a bounded list.
    thinning: u64,
    verdict: Verdict,
    compared: u64,
    terms: f64,
    csu_max: f64,
    csu_squares: f64,
    fine: BTreeMap<usize, u64>,
    decades: [u64; 10],
    abs_max: f64,
    rel_max: f64,
    ulp_max: f64,
    error_squares: f64,
    scale_squares: f64,
    bound_squares: f64,
    value_squares: f64,
    unbounded: bool,
    bad: Vec<Bad>,
    special: Special,
    undecidable: u64,
    deviations: Vec<Deviation>,
}

impl Measure {
    /// Nothing compared yet, of a tensor of this type of which so many elements are to come.
    pub fn new(element: ElementType, elements: usize) -> Self {
        Self {
            element,
            precision: Precision::of(element),
            thinning: (elements as u64).div_ceil(Slope::MOST as u64).max(1),
            verdict: Verdict::Exact,
            compared: 0,
            terms: 0.0,
            csu_max: 0.0,
            csu_squares: 0.0,
            fine: BTreeMap::new(),
            decades: [0; 10],
            abs_max: 0.0,
            rel_max: 0.0,
            ulp_max: 0.0,
            error_squares: 0.0,
            scale_squares: 0.0,
            bound_squares: 0.0,
            value_squares: 0.0,
            unbounded: false,
            bad: Vec::new(),
            special: Special::default(),
            undecidable: 0,
            deviations: Vec::new(),
        }
    }

    /// The worst grade so far.
    pub fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// Largest difference in csu so far; infinite where it is not finite.
    pub fn csu(&self) -> f64 {
        self.csu_max
    }

    /// Root mean square of the bounds over that of the values: at least one where nothing is promised.
    pub fn slack(&self) -> f64 {
        if self.bound_squares == 0.0 {
            return 0.0;
        }
        let slack = (self.bound_squares / self.value_squares).sqrt();
        if slack.is_nan() { f64::INFINITY } else { slack }
    }

    /// Whether an element's bound is infinite.
    pub fn is_unbounded(&self) -> bool {
        self.unbounded
    }

    /// Whether a number could be one that is expected.
    pub fn would_accept(&self, found: f64, expected: &Rounded) -> bool {
        self.precision.is_some_and(|precision| precision.grade(found, expected).verdict.is_rounding())
    }

    /// Compares one element of a float tensor; `place` is its offset, asked for only if it is among the worst.
    ///
    /// # Panics
    /// When the tensor is not one of floats.
    pub fn number(&mut self, place: impl FnOnce() -> usize, found: f64, expected: &Rounded) {
        let precision = self.precision.expect("numbers are of a float type");
        let graded = precision.grade(found, expected);
        self.count_special(&precision, found, expected.value);
        self.special.flushed += u64::from(graded.flushed);
        let unit = precision.csu(expected);
        let csu = graded.error.abs() / unit;
        self.element(place, graded.verdict, csu, graded.share, found, expected.value);
        self.terms = self.terms.max(expected.terms);
        if !graded.error.is_finite() || !expected.value.is_finite() {
            return;
        }
        let (error, value) = (graded.error, expected.value);
        self.csu_squares += csu * csu;
        self.abs_max = self.abs_max.max(error.abs());
        if error != 0.0 {
            self.rel_max = self.rel_max.max(error.abs() / value.abs());
            // The last place of the value as the type holds it.
            let exponent = value.abs().max(precision.normal).log2().floor();
            self.ulp_max = self.ulp_max.max(error.abs() / (exponent.exp2() * 2.0 * precision.unit));
        }
        self.error_squares += error * error;
        // A dot product of n random terms is of the size m·√(2/n), which is its magnitude for one and two.
        let scale = expected.magnitude * (2.0 / expected.terms.max(2.0)).sqrt();
        self.scale_squares += scale * scale;
        let bound = precision.bound(expected);
        self.unbounded |= !bound.is_finite();
        self.bound_squares += bound * bound;
        self.value_squares += value * value;
        if value != 0.0 && Deviation::key(value).is_multiple_of(self.thinning) {
            let (error, value) = (error / unit, value / unit);
            self.deviations.push(Deviation {
                key: expected.value.to_bits(),
                error,
                value,
                terms: expected.terms,
            });
        }
    }

    /// Compares one element of a tensor of integers or truths.
    pub fn integer(&mut self, place: impl FnOnce() -> usize, found: i128, expected: i128) {
        let error = (found - expected).unsigned_abs() as f64;
        let (verdict, csu) =
            if error == 0.0 { (Verdict::Exact, 0.0) } else { (Verdict::Different, f64::INFINITY) };
        self.element(place, verdict, csu, csu, found as f64, expected as f64);
        self.abs_max = self.abs_max.max(error);
        if error > 0.0 {
            self.rel_max = self.rel_max.max(error / expected.unsigned_abs() as f64);
        }
    }

    /// Accepts one element because a decision about it is closer than the rounding.
    pub fn accept_undecidable(&mut self, found: f64, expected: f64) {
        self.undecidable += 1;
        self.element(|| 0, Verdict::Rounding, 0.0, 0.0, found, expected);
    }

    fn element(
        &mut self,
        place: impl FnOnce() -> usize,
        verdict: Verdict,
        csu: f64,
        share: f64,
        found: f64,
        expected: f64,
    ) {
        self.compared += 1;
        self.verdict = self.verdict.max(verdict);
        self.csu_max = self.csu_max.max(if csu.is_nan() { f64::INFINITY } else { csu });
        // Decades: below 10⁻³, …, 10⁵ and above.
        let decade = if csu > 0.0 { (csu.log10().floor() + 4.0).clamp(0.0, 9.0) as usize } else { 0 };
        self.decades[decade] += 1;
        if csu > 0.0 {
            *self.fine.entry(bin(csu)).or_default() += 1;
        }
        let rank = if verdict == Verdict::Different { share.max(1.0) } else { share };
        if rank > 0.0 && (self.bad.len() < KEPT || self.bad.iter().any(|bad| bad.share < rank)) {
            self.bad.push(Bad { place: place(), share: rank, expected, found, csu });
            self.keep_worst();
        }
    }

    fn keep_worst(&mut self) {
        self.bad.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.place.cmp(&b.place)));
        self.bad.truncate(KEPT);
    }

    fn count_special(&mut self, precision: &Precision, found: f64, expected: f64) {
        let special = &mut self.special;
        let subnormal = |x: f64| x != 0.0 && x.abs() < precision.normal;
        let expected = precision.element.round(expected);
        special.nan_found += u64::from(found.is_nan());
        special.nan_expected += u64::from(expected.is_nan());
        special.inf_found += u64::from(found.is_infinite());
        special.inf_expected += u64::from(expected.is_infinite());
        special.subnormal_found += u64::from(subnormal(found));
        special.subnormal_expected += u64::from(subnormal(expected));
    }

    /// Adds what another part of the same tensor comes to.
    pub fn join(&mut self, other: Self) {
        self.verdict = self.verdict.max(other.verdict);
        self.compared += other.compared;
        self.unbounded |= other.unbounded;
        self.terms = self.terms.max(other.terms);
        self.csu_max = self.csu_max.max(other.csu_max);
        self.csu_squares += other.csu_squares;
        for (bin, count) in other.fine {
            *self.fine.entry(bin).or_default() += count;
        }
        self.decades.iter_mut().zip(&other.decades).for_each(|(a, b)| *a += b);
        self.abs_max = self.abs_max.max(other.abs_max);
        self.rel_max = self.rel_max.max(other.rel_max);
        self.ulp_max = self.ulp_max.max(other.ulp_max);
        self.error_squares += other.error_squares;
        self.scale_squares += other.scale_squares;
        self.bound_squares += other.bound_squares;
        self.value_squares += other.value_squares;
        self.bad.extend(other.bad);
        self.keep_worst();
        let (to, from) = (&mut self.special, other.special);
        to.nan_found += from.nan_found;
        to.nan_expected += from.nan_expected;
        to.inf_found += from.inf_found;
        to.inf_expected += from.inf_expected;
        to.subnormal_found += from.subnormal_found;
        to.subnormal_expected += from.subnormal_expected;
        to.flushed += from.flushed;
        self.undecidable += other.undecidable;
        self.deviations.extend(other.deviations);
    }

    /// The share of the tensor's elements that says where the 99.9th percentile lies.
    fn percentile(&self) -> f64 {
        let above = (self.compared / 1000).max(1);
        let mut seen = 0;
        for (&bin, count) in self.fine.iter().rev() {
            seen += count;
            if seen >= above {
                return centre(bin).min(self.csu_max);
            }
        }
        0.0
    }

    /// The report on the tensor; `groups` as in [`Slope::of`].
    pub fn report(mut self, name: &str, shape: &[usize], groups: Option<usize>) -> TensorReport {
        let elements = shape.iter().product::<usize>() as u64;
        let slope = self
            .precision
            .and_then(|precision| Slope::of(std::mem::take(&mut self.deviations), precision.unit, groups));
        let mut verdict = Grade::from(self.verdict);
        if slope.is_some_and(|slope| slope.is_systematic()) {
            verdict = verdict.max(Grade::G2);
        }
        let finite = |x: f64| x.is_finite().then_some(x);
        let compared = self.compared.max(1) as f64;
        let bits = -0.5 * (self.error_squares / self.scale_squares).log2();
        let percentile = self.percentile();
        let worst = self.worst(name, shape).into_iter().next();
        TensorReport {
            name: name.to_owned(),
            element: self.element.to_string(),
            shape: shape.to_vec(),
            verdict,
            elements,
            compared: self.compared,
            sample: None,
            n_eff: self.terms,
            csu_max: finite(self.csu_max),
            csu_p999: finite(percentile),
            csu_rms: finite((self.csu_squares / compared).sqrt()).filter(|_| self.csu_max.is_finite()),
            abs_max: finite(self.abs_max),
            rel_max: finite(self.rel_max),
            ulp_max: finite(self.ulp_max),
            worst,
            slope: slope.map(|s| s.slope).and_then(finite),
            slope_z: slope.map(|s| s.z).and_then(finite),
            mean_z: slope.map(|s| s.mean_z).and_then(finite),
            effective_bits: (self.error_squares > 0.0).then_some(bits).and_then(finite),
            histogram: self.decades.to_vec(),
            special: self.special,
            undecidable: self.undecidable,
            cumulative: None,
            propagated: None,
            amplification: None,
        }
    }

    /// The worst elements, the worst first.
    pub fn worst(&self, name: &str, shape: &[usize]) -> Vec<WorstElement> {
        let finite = |x: f64| x.is_finite().then_some(x);
        self.bad
            .iter()
            .map(|bad| WorstElement {
                tensor: name.to_owned(),
                index: unravel(bad.place, shape),
                expected: finite(bad.expected),
                found: finite(bad.found),
                csu: finite(bad.csu),
                receptive_field: Vec::new(),
            })
            .collect()
    }
}

/// The bin of a positive csu: eight to a factor of two, from 2⁻⁶⁴ to 2⁶⁴.
fn bin(csu: f64) -> usize {
    ((csu.log2() + 64.0) * 8.0).clamp(0.0, (BINS - 1) as f64) as usize
}

fn centre(bin: usize) -> f64 {
    ((bin as f64 + 0.5) / 8.0 - 64.0).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certificate::UNIT_ROUNDOFF;

    /// A thousand sums of a hundred products, each off by 0, 1, … 9 csu in turn.
    fn differences(range: std::ops::Range<usize>) -> Measure {
        let mut measure = Measure::new(ElementType::F32, 1000);
        for i in range {
            let expected = Rounded { value: 1.0 + i as f64 / 1024.0, magnitude: 4.0, terms: 100.0 };
            let csu = (i % 10) as f64 * if i % 20 < 10 { 1.0 } else { -1.0 };
            measure.number(|| i, expected.value + csu * 4.0 * UNIT_ROUNDOFF, &expected);
        }
        measure
    }

    #[test]
    fn parts_come_to_what_the_whole_comes_to() {
        let mut joined = differences(0..300);
        joined.join(differences(300..1000));
        let (joined, whole) =
            (joined.report("x", &[10, 100], None), differences(0..1000).report("x", &[10, 100], None));
        assert_eq!(joined.histogram, whole.histogram, "histogram");
        assert_eq!(joined.worst, whole.worst, "worst element");
        assert_eq!(
            (joined.csu_max, joined.csu_p999, joined.slope),
            (whole.csu_max, whole.csu_p999, whole.slope)
        );
        assert_eq!(whole.compared, 1000);
    }

    #[test]
    fn the_figures_are_those_of_the_differences() {
        let report = differences(0..1000).report("x", &[1000], None);
        let near = |found: Option<f64>, expected: f64, share: f64| {
            let found = found.expect("a finite number");
            assert!((found / expected - 1.0).abs() < share, "{found} for {expected}");
        };
        near(report.csu_max, 9.0, 1e-6);
        near(report.csu_p999, 9.0, 0.05);
        near(report.csu_rms, 28.5_f64.sqrt(), 1e-6);
        near(report.abs_max, 36.0 * UNIT_ROUNDOFF, 1e-6);
        assert_eq!(report.verdict, Grade::G1);
        assert_eq!(report.histogram.iter().sum::<u64>(), 1000, "every element is in a decade");
        assert_eq!(report.worst.expect("an element").index, [9], "the first of the worst");
    }

    #[test]
    fn effective_bits_tell_the_arithmetic() {
        let bits = |relative: f64| {
            let mut measure = Measure::new(ElementType::F32, 64);
            for i in 0..64 {
                let expected = Rounded { value: 1.0, magnitude: 8.0, terms: 128.0 };
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                measure.number(|| i, 1.0 + sign * relative, &expected);
            }
            measure.report("x", &[64], None).effective_bits.expect("differences")
        };
        assert!((bits(2f64.powi(-12)) - 12.0).abs() < 0.01, "{}", bits(2f64.powi(-12)));
    }

    #[test]
    fn a_bound_that_is_unknown_promises_nothing() {
        for magnitude in [f64::NAN, f64::INFINITY] {
            let mut measure = Measure::new(ElementType::F32, 1);
            measure.number(|| 0, 1.5, &Rounded { value: 1.0, magnitude, terms: 3.0 });
            assert!(measure.is_unbounded() && measure.slack() == f64::INFINITY, "{magnitude}");
            assert_eq!(measure.verdict(), Verdict::Unusual, "{magnitude}: it accuses nobody");
        }
    }

    #[test]
    fn a_wrong_integer_is_different_and_has_no_finite_csu() {
        let mut measure = Measure::new(ElementType::I64, 3);
        measure.integer(|| 0, 5, 5);
        measure.integer(|| 1, 7, 4);
        measure.accept_undecidable(1.0, 2.0);
        let report = measure.report("i", &[3], None);
        assert_eq!((report.verdict, report.csu_max, report.abs_max), (Grade::G3, None, Some(3.0)));
        assert_eq!((report.compared, report.undecidable), (3, 1));
        assert_eq!(report.worst.expect("an element").index, [1]);
    }
}

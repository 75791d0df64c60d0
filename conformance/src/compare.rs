//! The comparator: a found tensor against an expected one, element by element.

use std::fmt;

use crate::certificate::{Slope, Verdict, grade};

/// What the reference expects of a tensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// The shape.
    pub shape: Vec<usize>,
    /// The values y, last axis fastest.
    pub values: Vec<f64>,
    /// The largest difference that rounding can make, per element; 0 where the value must be met exactly.
    pub bounds: Vec<f64>,
    /// u·m per element: one rounding of the size that the operator handles there; 0 where nothing is rounded.
    pub units: Vec<f64>,
    /// Whether many elements share a rounding, as those share the deviation's that are normalised together.
    pub shared: bool,
}

impl Expected {
    /// A tensor that must be met exactly, as by operators that only move or choose numbers.
    pub fn exact(shape: &[usize], values: Vec<f64>) -> Self {
        let zeros = vec![0.0; values.len()];
        Self { shape: shape.to_vec(), values, bounds: zeros.clone(), units: zeros, shared: false }
    }

    /// A tensor in which every element may differ by as much as `tolerance`, which is also the unit of the report.
    pub fn within(shape: &[usize], values: Vec<f64>, tolerance: f64) -> Self {
        let all = vec![tolerance; values.len()];
        Self { shape: shape.to_vec(), values, bounds: all.clone(), units: all, shared: true }
    }
}

/// What the runtime gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The shape.
    pub shape: Vec<usize>,
    /// The values, last axis fastest.
    pub values: Vec<f32>,
}

/// The element with the largest share of its bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    /// Its place, one index per axis.
    pub index: Vec<usize>,
    /// What was expected.
    pub expected: f64,
    /// What was found.
    pub found: f32,
    /// What would have been accepted.
    pub bound: f64,
}

/// The outcome of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum Comparison {
    /// The shapes differ, so nothing else can be compared.
    Shape {
        /// The reference's.
        expected: Vec<usize>,
        /// The runtime's.
        found: Vec<usize>,
    },
    /// Every element was compared.
    Elements(Report),
}

/// The outcome element by element.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The worst element's verdict.
    pub verdict: Verdict,
    /// The worst element; `None` for an empty tensor.
    pub worst: Option<Worst>,
    /// Largest |ŷ − y| / bound; infinite where a difference was found and none is allowed.
    pub share: f64,
    /// Largest |ŷ − y| / unit: condition-scaled ulps.
    pub csu: f64,
    /// A factor common to the differences, when there are elements enough to see one.
    pub slope: Option<Slope>,
    /// Elements compared.
    pub elements: usize,
}

/// Compares: shape first, then every element.
///
/// # Panics
/// When the expectation's own lists do not have as many elements as its shape, or the found values as theirs.
pub fn compare(expected: &Expected, found: &Found) -> Comparison {
    let count: usize = expected.shape.iter().product();
    for (what, len) in [
        ("values", expected.values.len()),
        ("bounds", expected.bounds.len()),
        ("units", expected.units.len()),
    ] {
        assert_eq!(len, count, "expected {what} for shape {:?}", expected.shape);
    }
    assert_eq!(
        found.values.len(),
        found.shape.iter().product::<usize>(),
        "found values for shape {:?}",
        found.shape
    );
    if expected.shape != found.shape {
        return Comparison::Shape { expected: expected.shape.clone(), found: found.shape.clone() };
    }

    let mut verdict = Verdict::Exact;
    let (mut share, mut csu, mut worst) = (0.0_f64, 0.0_f64, None);
    for i in 0..count {
        let (value, bound, unit) = (expected.values[i], expected.bounds[i], expected.units[i]);
        let here = grade(found.values[i], value, bound, unit);
        verdict = verdict.max(here);
        let error = difference(found.values[i], value);
        let element_share =
            if here == Verdict::Different { ratio(error, bound).max(1.0) } else { ratio(error, bound) };
        if worst.is_none() || element_share > share {
            (worst, share) = (Some(i), element_share);
        }
        if unit > 0.0 {
            csu = csu.max(error / unit);
        }
    }
    let elements = (0..count).map(|i| {
        let error = f64::from(found.values[i]) - expected.values[i];
        (error, expected.values[i], expected.bounds[i], expected.units[i])
    });
    let slope = Slope::estimate(elements, expected.shared);
    let worst = worst.map(|i| Worst {
        index: unravel(i, &expected.shape),
        expected: expected.values[i],
        found: found.values[i],
        bound: expected.bounds[i],
    });
    Comparison::Elements(Report { verdict, worst, share, csu, slope, elements: count })
}

/// |ŷ − y|; 0 where both are the same number that is not finite, infinite where only one is.
fn difference(found: f32, value: f64) -> f64 {
    let found = f64::from(found);
    if found == value || (found.is_nan() && value.is_nan()) {
        return 0.0;
    }
    let error = (found - value).abs();
    if error.is_nan() { f64::INFINITY } else { error }
}

/// error / bound with 0/0 = 0; what is no bound is infinitely exceeded.
fn ratio(error: f64, bound: f64) -> f64 {
    if error == 0.0 {
        0.0
    } else if bound > 0.0 && bound.is_finite() {
        error / bound
    } else {
        f64::INFINITY
    }
}

fn unravel(mut i: usize, shape: &[usize]) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for axis in (0..shape.len()).rev() {
        index[axis] = i % shape[axis];
        i /= shape[axis];
    }
    index
}

impl Comparison {
    /// Whether every difference can be rounding: shapes agree and no element is beyond its bound.
    pub fn within_bounds(&self) -> bool {
        matches!(self, Self::Elements(report) if report.verdict.is_rounding())
    }

    /// Whether the differences can be rounding and share no factor that rounding does not make.
    pub fn agrees(&self) -> bool {
        self.within_bounds()
            && matches!(self, Self::Elements(report) if !report.slope.is_some_and(|slope| slope.is_systematic()))
    }

    /// The report, unless the shapes differ.
    pub fn report(&self) -> Option<&Report> {
        match self {
            Self::Shape { .. } => None,
            Self::Elements(report) => Some(report),
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape { expected, found } => write!(f, "shape {found:?}, expected {expected:?}"),
            Self::Elements(report) => {
                write!(f, "{}, {:.3} of the bound, {:.1} csu", report.verdict, report.share, report.csu)?;
                if let Some(worst) = &report.worst {
                    write!(
                        f,
                        "; worst at {:?}: {:e}, expected {:e} ± {:e}",
                        worst.index, worst.found, worst.expected, worst.bound
                    )?;
                }
                if let Some(slope) = report.slope.filter(Slope::is_systematic) {
                    write!(f, "; a common factor of 1 + {:e} (z = {:.0})", slope.slope, slope.z)?;
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certificate::UNIT_ROUNDOFF;

    /// y = 1, 2, … 24 in a 2×3×4 tensor, ten roundings each.
    fn expected() -> Expected {
        let values: Vec<f64> = (1..=24).map(f64::from).collect();
        Expected {
            shape: vec![2, 3, 4],
            bounds: values.iter().map(|v| 10.0 * UNIT_ROUNDOFF * v).collect(),
            units: values.iter().map(|v| UNIT_ROUNDOFF * v).collect(),
            values,
            shared: false,
        }
    }

    fn found(change: impl FnOnce(&mut Vec<f32>)) -> Found {
        let mut values: Vec<f32> = (1..=24_u8).map(f32::from).collect();
        change(&mut values);
        Found { shape: vec![2, 3, 4], values }
    }

    #[test]
    fn the_same_tensor_is_accepted_and_so_is_one_rounding() {
        assert!(compare(&expected(), &found(|_| ())).agrees(), "itself");
        let nearby = compare(&expected(), &found(|v| v[5] = v[5].next_up()));
        assert!(nearby.agrees(), "{nearby}");
        assert_eq!(
            nearby.report().and_then(|r| r.worst.clone()).map(|w| w.index),
            Some(vec![0, 1, 1]),
            "where"
        );
    }

    #[test]
    fn a_wrong_value_where_zero_is_expected_is_rejected() {
        let zeros = Expected::exact(&[3], vec![0.0; 3]);
        for wrong in [1.0, 1e-30, -f32::MIN_POSITIVE, 123.0] {
            let comparison = compare(&zeros, &Found { shape: vec![3], values: vec![0.0, wrong, 0.0] });
            assert!(!comparison.within_bounds(), "{wrong} for 0");
            assert_eq!(comparison.report().map(|r| r.share), Some(f64::INFINITY), "no share of nothing");
        }
    }

    #[test]
    fn nan_and_infinity_are_rejected() {
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let comparison = compare(&expected(), &found(|v| v[7] = wrong));
            assert!(!comparison.within_bounds(), "{wrong}");
            let worst = comparison.report().and_then(|r| r.worst.clone()).expect("an element");
            assert_eq!(worst.index, [0, 1, 3], "{wrong} is the worst element");
        }
    }

    #[test]
    fn a_wrong_shape_is_rejected_before_any_element() {
        let flat = Found { shape: vec![24], values: found(|_| ()).values };
        let comparison = compare(&expected(), &flat);
        assert!(!comparison.agrees() && comparison.report().is_none(), "{comparison}");
        let turned = Found { shape: vec![3, 2, 4], values: flat.values };
        assert!(!compare(&expected(), &turned).agrees(), "same count, other sides");
    }

    #[test]
    fn swapped_axes_are_rejected() {
        let cube: Vec<f64> = (0..27).map(f64::from).collect();
        let swapped: Vec<f32> = (0..27_usize).map(|i| (i % 3 * 9 + i / 3 % 3 * 3 + i / 9) as f32).collect();
        let expected = Expected::within(&[3, 3, 3], cube, 1e-3);
        assert!(
            !compare(&expected, &Found { shape: vec![3, 3, 3], values: swapped }).within_bounds(),
            "x for z"
        );
    }

    #[test]
    fn a_factor_of_1_0005_is_rejected() {
        let comparison = compare(&expected(), &found(|v| v.iter_mut().for_each(|v| *v *= 1.0005)));
        assert!(!comparison.within_bounds(), "{comparison}");
    }

    #[test]
    #[should_panic(expected = "expected bounds for shape [2, 3, 4]")]
    fn an_expectation_without_bounds_is_a_mistake_of_the_judge() {
        compare(&Expected { bounds: vec![], ..expected() }, &found(|_| ()));
    }
}

//! Outputs as plain numbers: how far apart, and how many bits they share.

use vitruvian_reference::nn::Tensor;

use super::{Displacement, Outputs, Ruler, output};
use crate::audit::variant::report::{Geometry, NumbersReport, Summary, View};

/// Outputs without a geometry that is known: each output's differences relative to the root mean square of the base's.
#[derive(Debug)]
pub struct NumbersRuler {
    base: Vec<Outputs>,
}

impl NumbersRuler {
    /// A ruler on the base's outputs.
    pub fn new(base: Vec<Outputs>) -> Self {
        Self { base }
    }
}

impl Ruler for NumbersRuler {
    fn unit(&self) -> &'static str {
        "of the outputs' root mean square"
    }

    fn displacement(&self, variant: &[Outputs]) -> Result<Displacement, String> {
        let mut components = Vec::new();
        for name in
            self.base.iter().flat_map(|outputs| outputs.keys()).collect::<std::collections::BTreeSet<_>>()
        {
            let pairs = pairs(&self.base, variant, name)?;
            let size = rms(pairs.iter().flat_map(|(base, _)| base.data.iter().copied()));
            let unit = if size > 0.0 && size.is_finite() { size } else { 1.0 };
            for (base, found) in pairs {
                components.extend(base.data.iter().zip(&found.data).map(|(b, f)| (f - b) / unit));
            }
        }
        let lengths: Vec<f64> = components.iter().map(|c: &f64| c.abs()).collect();
        Ok(Displacement { components, lengths: Summary::of(&lengths) })
    }

    fn report(&self, _variant: &[Outputs]) -> Result<(Geometry, Option<Summary>), String> {
        Ok((Geometry::Numbers, None))
    }

    fn view(&self, _variant: &[Outputs]) -> Result<Option<View>, String> {
        Ok(None)
    }
}

/// One report per output of the base, in the order of their names.
///
/// # Errors
/// When the variant lacks an output, or has it in another shape.
pub fn compare(base: &[Outputs], variant: &[Outputs]) -> Result<Vec<NumbersReport>, String> {
    let Some(first) = base.first() else { return Ok(Vec::new()) };
    first.keys().map(|name| Ok(of_output(name, &pairs(base, variant, name)?))).collect()
}

/// The output of this name on every input, of the base and of the variant, in equal shapes.
fn pairs<'a>(
    base: &'a [Outputs],
    variant: &'a [Outputs],
    name: &str,
) -> Result<Vec<(&'a Tensor, &'a Tensor)>, String> {
    base.iter()
        .zip(variant)
        .map(|(base, variant)| {
            let (base, found) = (output(base, name)?, output(variant, name)?);
            if base.shape == found.shape {
                Ok((base, found))
            } else {
                Err(format!("output \"{name}\" is {:?}, in the base {:?}", found.shape, base.shape))
            }
        })
        .collect()
}

fn of_output(name: &str, pairs: &[(&Tensor, &Tensor)]) -> NumbersReport {
    let each = || {
        pairs.iter().enumerate().flat_map(|(draw, (base, found))| {
            base.data.iter().zip(&found.data).enumerate().map(move |(place, (&b, &f))| (draw, place, b, f))
        })
    };
    // What is not finite on one side only is the worst there is.
    let difference = |b: f64, f: f64| if b.to_bits() == f.to_bits() || b == f { 0.0 } else { (f - b).abs() };
    let size = |d: f64| if d.is_nan() { f64::INFINITY } else { d };
    let worst = each().fold(None, |worst: Option<(usize, usize, f64, f64)>, at| {
        let more = worst.is_none_or(|w| size(difference(at.2, at.3)) > size(difference(w.2, w.3)));
        if more { Some(at) } else { worst }
    });
    let rms_difference = rms(each().map(|(_, _, b, f)| difference(b, f)));
    let relative = rms_difference / rms(each().map(|(_, _, b, _)| b));
    let finite = |x: f64| x.is_finite().then_some(x);
    let (worst_draw, place, expected, found) = worst.unwrap_or((0, 0, 0.0, 0.0));
    NumbersReport {
        name: name.to_owned(),
        shape: pairs.first().map_or(Vec::new(), |(base, _)| base.shape.clone()),
        count: each().count() as u64,
        abs_max: worst.and_then(|_| finite(difference(expected, found))),
        rms: finite(rms_difference),
        rel_rms: finite(relative),
        effective_bits: finite(-relative.log2()),
        worst: pairs.get(worst_draw).map_or(Vec::new(), |(base, _)| index_of(&base.shape, place)),
        worst_draw,
        expected: finite(expected),
        found: finite(found),
        not_finite_base: each().filter(|(_, _, b, _)| !b.is_finite()).count() as u64,
        not_finite_variant: each().filter(|(_, _, _, f)| !f.is_finite()).count() as u64,
    }
}

/// One index per axis of an element's place.
fn index_of(shape: &[usize], mut place: usize) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for axis in (0..shape.len()).rev() {
        index[axis] = place % shape[axis].max(1);
        place /= shape[axis].max(1);
    }
    index
}

/// Root mean square; 0 of nothing.
fn rms(numbers: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = numbers.fold((0.0, 0_u64), |(sum, count), x| (sum + x * x, count + 1));
    (sum / count.max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outputs(values: &[f64]) -> Vec<Outputs> {
        let shape = [2, values.len() / 2];
        vec![Outputs::from([("y".to_owned(), Tensor::new(&shape, values.to_vec()))])]
    }

    #[test]
    fn a_difference_of_a_thousandth_shares_ten_bits() {
        let base = outputs(&[1.0, -1.0, 1.0, -1.0]);
        let found =
            outputs(&[1.0 + 1.0 / 1024.0, -1.0 - 1.0 / 1024.0, 1.0 + 1.0 / 1024.0, -1.0 + 1.0 / 1024.0]);
        let report = compare(&base, &found).expect("equal shapes").remove(0);
        assert_eq!(report.effective_bits, Some(10.0));
        assert_eq!((report.abs_max, report.count), (Some(1.0 / 1024.0), 4));
    }

    #[test]
    fn the_worst_number_is_named_by_its_index() {
        let base = outputs(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        let found = outputs(&[0.0, 1.0, 2.0, 3.0, 4.5, 5.0]);
        let report = compare(&base, &found).expect("equal shapes").remove(0);
        assert_eq!((report.worst, report.expected, report.found), (vec![1, 1], Some(4.0), Some(4.5)));
    }

    #[test]
    fn equal_outputs_have_no_difference_even_where_they_are_not_finite() {
        let base = outputs(&[f64::NAN, f64::INFINITY, 1.0, 0.0]);
        let report = compare(&base, &base).expect("equal shapes").remove(0);
        assert_eq!((report.abs_max, report.rms, report.effective_bits), (Some(0.0), Some(0.0), None));
        assert_eq!((report.not_finite_base, report.not_finite_variant), (2, 2));
    }

    #[test]
    fn a_number_lost_to_infinity_is_the_worst_and_has_no_measure() {
        let report =
            compare(&outputs(&[1.0, 9.0]), &outputs(&[f64::NAN, 1e9])).expect("equal shapes").remove(0);
        assert_eq!((report.abs_max, report.worst, report.not_finite_variant), (None, vec![0, 0], 1));
    }

    #[test]
    fn another_shape_and_a_missing_output_are_refused_by_name() {
        let base = outputs(&[1.0, 2.0]);
        let wide = vec![Outputs::from([("y".to_owned(), Tensor::new(&[1, 2], vec![1.0, 2.0]))])];
        assert!(
            compare(&base, &wide)
                .expect_err("another shape")
                .contains("output \"y\" is [1, 2], in the base [2, 1]")
        );
        let other = vec![Outputs::from([("z".to_owned(), Tensor::new(&[1], vec![1.0]))])];
        assert!(compare(&base, &other).expect_err("no such output").contains("output \"y\" is missing"));
    }
}

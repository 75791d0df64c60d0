//! Constants that are others: weights with too few digits, printed and read back or cut, and single numbers, fitted.

use super::Suspicion;
use super::change::numbers;
use super::fit::Parameter;
use super::trial::Trial;

/// An addend below this, beside a variance or a norm, is an ε.
const SMALL: f64 = 0.02;

/// Operands of one element that are another number.
///
/// Exporters take normalisations apart, and so an ε is an addend of its own node. Of a product the number cannot be told from
/// a factor of the result, which has a family of its own.
pub(super) fn parameters(trial: &Trial) -> Vec<Parameter> {
    if !matches!(trial.operator(), "Add" | "Sub" | "Pow" | "Max" | "Min" | "Clip") {
        return Vec::new();
    }
    let single = (0..trial.case.operands.len()).filter_map(|place| match trial.numbers(place)?[..] {
        [is] => Some((place, is)),
        _ => None,
    });
    single
        .map(|(place, is)| {
            let operand = trial.node().input.get(place).cloned().unwrap_or_default();
            let name = match trial.operator() {
                "Pow" => "exponent",
                "Clip" | "Max" | "Min" => "bounds",
                _ if is.abs() <= SMALL => "epsilon",
                _ => "constant",
            };
            Parameter::new(
                name,
                is,
                move |value| format!("operand {place} (\"{operand}\") is {is:e} in the graph; {value:e} explains the numbers"),
                move |value| numbers(place, move |_| value),
            )
        })
        .collect()
}

/// Decimals or digits that a file of text is written with.
const DIGITS: std::ops::RangeInclusive<i32> = 1..=7;

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    // Weights come after the data; of element-wise operators either may be one.
    let places: Vec<usize> = (0..trial.case.operands.len().min(6))
        .rev()
        .filter(|&place| trial.numbers(place).is_some_and(|x| !x.is_empty()))
        .collect();
    for place in places {
        let name = trial.node().input.get(place).map_or("", String::as_str);
        for digits in DIGITS.rev() {
            let scale = 10f64.powi(digits);
            all.push(Suspicion::new(
                "truncated-constant",
                format!("operand {place} (\"{name}\") was rounded to {digits} decimals"),
                numbers(place, move |x| (x * scale).round_ties_even() / scale),
            ));
            all.push(Suspicion::new(
                "truncated-constant",
                format!("operand {place} (\"{name}\") was cut to {digits} decimals"),
                numbers(place, move |x| (x * scale).trunc() / scale),
            ));
            let significant = usize::try_from(digits - 1).unwrap_or(0);
            all.push(Suspicion::new(
                "truncated-constant",
                format!("operand {place} (\"{name}\") was rounded to {digits} significant digits"),
                numbers(place, move |x| format!("{x:.significant$e}").parse().unwrap_or(x)),
            ));
        }
        all.push(Suspicion::new(
            "truncated-constant",
            format!("operand {place} (\"{name}\") was rounded to whole numbers"),
            numbers(place, f64::round_ties_even),
        ));
    }
    all
}

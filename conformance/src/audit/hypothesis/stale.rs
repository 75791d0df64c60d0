//! Numbers that belong elsewhere: another tensor's, an operand's, none at all, or only some of them.

use std::collections::BTreeMap;
use std::sync::Arc;

use vitruvian_reference::nn::{Rounded, Tensor};

use super::change::{changed, exact, operand, output, output_numbers, specified};
use super::trial::Trial;
use super::{Others, Suspicion};
use crate::audit::case::Case;
use crate::audit::report::Hypothesis;
use crate::certificate::UNIT_ROUNDOFF;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::{Data, Value};

/// The largest share of elements that may be wrong alone for the rest to count as right.
const FEW: f64 = 0.02;

/// Slices along an axis that are compared with each other; more would take long.
const SLICES: usize = 64;

/// Other tensors that an operand is exchanged for; each costs an evaluation.
const EXCHANGED: usize = 24;

/// Numbers that are those of another tensor, or of an operand, bit for bit.
pub(super) fn identical(case: &Case, others: &BTreeMap<String, Arc<TypedTensor>>) -> Option<Hypothesis> {
    let found = case.found.first()?.as_ref().filter(|found| varies(found))?;
    let hypothesis = |name: &str, detail: String| Hypothesis { name: name.into(), detail, csu: 0.0 };
    for (place, operand) in case.operands.iter().enumerate() {
        if operand.as_ref().is_some_and(|operand| operand.elements == found.elements) {
            let name = case.node.input.get(place).map_or("", String::as_str);
            let detail =
                format!("the output is operand {place} (\"{name}\") unchanged: the node did nothing");
            return Some(hypothesis("skipped", detail));
        }
    }
    let own = &case.node.output;
    let (name, _) =
        others.iter().find(|(name, other)| !own.contains(name) && other.elements == found.elements)?;
    Some(hypothesis("stale", format!("the output holds the numbers of tensor \"{name}\", bit for bit")))
}

/// Slices of a batch, or channels, that are those of others bit for bit, of operands that are not.
pub(super) fn repeated(case: &Case) -> Option<Hypothesis> {
    let found = case.found.first()?.as_ref().filter(|found| varies(found))?;
    let given = case.operands.first()?.as_ref()?;
    (0..found.shape.len().min(2)).find_map(|axis| {
        let of = slices(found, axis);
        let whole = slices(given, axis);
        let differ = |a: usize, b: usize| whole.len() != of.len() || whole[a] != whole[b];
        let (copy, original) =
            (0..of.len()).flat_map(|b| (0..of.len()).map(move |a| (a, b))).find(|&(a, b)| {
                a != b && of[a] == of[b] && differ(a, b) && of[a].iter().any(|x| *x != of[a][0])
            })?;
        let name = if axis == 0 { "batch-order" } else { "channel-order" };
        let detail = format!(
            "slices {} and {} along axis {axis} of the output are the same, bit for bit",
            copy.min(original),
            copy.max(original)
        );
        Some(Hypothesis { name: name.into(), detail, csu: 0.0 })
    })
}

/// The numbers of each slice along an axis, of which there are few.
fn slices(tensor: &TypedTensor, axis: usize) -> Vec<Vec<f64>> {
    let side = tensor.shape.get(axis).copied().unwrap_or(0);
    if !(2..=SLICES).contains(&side) {
        return Vec::new();
    }
    let numbers = crate::audit::compare::numbers(tensor);
    let inner = tensor.shape[axis + 1..].iter().product::<usize>().max(1);
    (0..side)
        .map(|slice| numbers.chunks(inner).skip(slice).step_by(side).flatten().copied().collect())
        .collect()
}

pub(super) fn suspicions(trial: &Trial, others: Others) -> Vec<Suspicion> {
    let mut all = operands_of_others(trial, others);
    all.extend(trial.case.found.first().and_then(Option::as_ref).and_then(constant));
    all.extend(partial(trial));
    all.push(Suspicion::new("sign", "the output has the opposite sign", output_numbers(|y| -y)));
    all
}

fn varies(tensor: &TypedTensor) -> bool {
    let numbers = crate::audit::compare::numbers(tensor);
    numbers.iter().any(|x| *x != numbers[0])
}

/// The node's output for other operands: one exchanged for another tensor of the run with its shape.
fn operands_of_others(trial: &Trial, others: Others) -> Vec<Suspicion> {
    let mut all = Vec::new();
    for (place, given) in trial.case.operands.iter().enumerate() {
        let Some(given) = given.as_ref().filter(|given| given.to_f64().is_some() && given.len() > 1) else {
            continue;
        };
        let is = trial.node().input.get(place).map_or("", String::as_str);
        let alike = others.tensors.iter().filter(|(name, other)| {
            other.shape == given.shape
                && other.element() == given.element()
                && name.as_str() != is
                && !others.later.contains(*name)
        });
        for (name, other) in alike.take(EXCHANGED) {
            let other = Arc::clone(other);
            all.push(Suspicion::new(
                "stale",
                format!("the output is that of tensor \"{name}\" for operand {place} (\"{is}\")"),
                operand(place, move |old| {
                    (old.shape() == other.shape).then(|| Value::of(&other).ok()).flatten()
                }),
            ));
        }
    }
    all
}

/// One number everywhere, or no numbers.
fn constant(found: &TypedTensor) -> Option<Suspicion> {
    let numbers = crate::audit::compare::numbers(found);
    let first = *numbers.first()?;
    let all = |f: &dyn Fn(f64) -> bool| numbers.iter().all(|&x| f(x));
    let (name, detail) = if all(&|x| x == 0.0) {
        ("zero-output", "the output is zero everywhere: it was never written".to_owned())
    } else if all(&f64::is_nan) {
        ("nan-output", "the output is NaN everywhere".to_owned())
    } else if numbers.len() > 1 && all(&|x| x == first) {
        ("constant-output", format!("the output is {first} everywhere"))
    } else {
        return None;
    };
    let fill = move |y: &Value<Rounded>| match &y.data {
        Data::Numbers(_) => changed(y, |_| first),
        Data::Integers(x) => {
            Some(Value { element: y.element, data: Data::Integers(x.map(|_| first as i64)) })
        }
        Data::Truths(x) => Some(Value { element: y.element, data: Data::Truths(x.map(|_| first != 0.0)) }),
    };
    Some(Suspicion::new(name, detail, output(fill)))
}

/// Outputs of which a part was lost or bounded.
fn partial(trial: &Trial) -> Vec<Suspicion> {
    let (Some(found), Some(expected)) = (trial.found(), trial.values(&specified())) else {
        return Vec::new();
    };
    if found.len() != expected.len() || found.is_empty() {
        return Vec::new();
    }
    let mut all = Vec::new();
    let pairs = || found.iter().zip(&expected).enumerate();
    let lost: Vec<usize> =
        pairs().filter(|(_, (f, e))| **f == 0.0 && e.value != 0.0).map(|(i, _)| i).collect();
    if !lost.is_empty() && lost.len() < found.len() {
        all.push(Suspicion::new(
            "unwritten",
            format!(
                "{} of {} elements are zero that should not be: a part was never written",
                lost.len(),
                found.len()
            ),
            trial.overwritten(lost.iter().map(|&i| (i, 0.0)).collect()),
        ));
    }
    let nan: Vec<(usize, f64)> = pairs()
        .filter(|(_, (f, e))| !f.is_finite() && e.value.is_finite())
        .map(|(i, (f, _))| (i, *f))
        .collect();
    if !nan.is_empty() && nan.len() < found.len() {
        all.push(Suspicion::new(
            "not-finite",
            format!("{} of {} elements are NaN or infinite that should not be", nan.len(), found.len()),
            trial.overwritten(nan),
        ));
    }
    // Numbers that stop at a bound.
    let finite = || found.iter().copied().filter(|x| x.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    let beyond = expected.iter().filter(|e| e.value < low || e.value > high).count();
    if low < high && beyond > 1 {
        all.push(Suspicion::new(
            "clipped",
            format!("{beyond} of {} elements lie beyond {low}..{high} and were limited to it", found.len()),
            output(move |y| {
                let x = y.numbers().ok()?;
                let data = x.map(|r| {
                    if r.value < low {
                        exact(low)
                    } else if r.value > high {
                        exact(high)
                    } else {
                        r
                    }
                });
                Some(Value { element: y.element, data: Data::Numbers(Tensor::new(&x.shape, data.data)) })
            }),
        ));
    }
    all
}

/// Where nothing explains all numbers: that only few are wrong, or that they have nothing to do with the operands.
pub(super) fn last_resort(trial: &Trial) -> Vec<Suspicion> {
    let (Some(found), Some(expected)) = (trial.found(), trial.values(&specified())) else {
        return Vec::new();
    };
    if found.len() != expected.len() || found.len() < 64 {
        return Vec::new();
    }
    let far =
        |f: f64, e: &Rounded| (f - e.value).abs() > e.bound(UNIT_ROUNDOFF) || f.is_nan() != e.value.is_nan();
    let wrong: Vec<(usize, f64)> = found
        .iter()
        .zip(&expected)
        .enumerate()
        .filter(|(_, (f, e))| far(**f, e))
        .map(|(i, (f, _))| (i, *f))
        .collect();
    let mut all = Vec::new();
    if !wrong.is_empty() && (wrong.len() as f64) < FEW * found.len() as f64 {
        all.push(Suspicion::new(
            "few-elements",
            format!("{} of {} elements are wrong, all others right", wrong.len(), found.len()),
            trial.overwritten(wrong),
        ));
    } else if let Some(permuted) = permuted(&found, &expected) {
        all.push(Suspicion::new(
            "permuted",
            format!("the {} numbers are the right ones, but in another order", found.len()),
            trial.overwritten(permuted),
        ));
    } else if let Some(r) = correlation(trial, &found, &expected)
        && r.abs() < UNRELATED
    {
        all.push(Suspicion::new(
            "stale",
            format!(
                "the numbers are like those expected, but do not follow the operands (correlation {r:.2}): the output of \
                 another run, or for other inputs"
            ),
            trial.overwritten(found.iter().copied().enumerate().collect()),
        ));
    }
    all
}

/// Numbers that follow the operands no more than this, by their correlation with what was expected, were made of others.
///
/// Maps of two images by one convolution are not wholly unlike, even less the mean of each channel.
const UNRELATED: f64 = 0.5;

/// Every found number as an expected one, if both are the same numbers in some order.
fn permuted(found: &[f64], expected: &[Rounded]) -> Option<Vec<(usize, f64)>> {
    let mut places: Vec<usize> = (0..found.len()).collect();
    places.sort_by(|&a, &b| found[a].total_cmp(&found[b]));
    let mut numbers: Vec<&Rounded> = expected.iter().collect();
    numbers.sort_by(|a, b| a.value.total_cmp(&b.value));
    let near = |(&place, e): (&usize, &&Rounded)| (found[place] - e.value).abs() <= e.bound(UNIT_ROUNDOFF);
    // Few different numbers, as of truths, are easily the same ones.
    let different = numbers.windows(2).filter(|pair| pair[0].value < pair[1].value).count();
    (2 * different > found.len() && places.iter().zip(&numbers).all(near))
        .then(|| found.iter().copied().enumerate().collect())
}

/// Pearson's coefficient within channels, if the numbers spread alike in both.
fn correlation(trial: &Trial, found: &[f64], expected: &[Rounded]) -> Option<f64> {
    let shape = trial
        .excerpt_shape()
        .filter(|shape| shape.len() > 2 && shape.iter().product::<usize>() == found.len());
    let (channels, place) = shape.map_or((1, found.len()), |shape| (shape[1], shape[2..].iter().product()));
    let channel = |i: usize| i / place.max(1) % channels.max(1);
    let mut means = vec![[0.0; 3]; channels.max(1)];
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let mean = &mut means[channel(i)];
        *mean = [mean[0] + 1.0, mean[1] + f, mean[2] + e.value];
    }
    let (mut fe, mut ff, mut ee) = (0.0, 0.0, 0.0);
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let [n, fs, es] = means[channel(i)];
        let (f, e) = (f - fs / n, e.value - es / n);
        (fe, ff, ee) = (fe + f * e, ff + f * f, ee + e * e);
    }
    let (r, spread) = (fe / (ff * ee).sqrt(), (ff / ee).sqrt());
    (r.is_finite() && (0.2..=5.0).contains(&spread)).then_some(r)
}

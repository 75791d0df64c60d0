//! The local certificate of one node: the reference, fed with the second party's own operands, against its outputs.

use vitruvian_reference::nn::{Rounded, Tensor};

use super::case::{Case, View};
use super::discontinuity;
use super::measure::Measure;
use super::reading::Reading;
use super::report::{Grade, TensorReport, WorstElement};
use crate::certificate::Verdict;
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// A node's meaning: its outputs, with what rounding may do to them, from its operands.
pub type Meaning<'a> = dyn Fn(&NodeProto, i64, &[Option<&Value<Rounded>>]) -> Result<Vec<Option<Value<Rounded>>>, String>
    + Sync
    + 'a;

/// The verdict on one node.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// The worst of its tensors' verdicts.
    pub verdict: Grade,
    /// Why it could not be compared, or in what its outputs' shapes differ.
    pub why: Option<String>,
    /// One report per output that was compared.
    pub tensors: Vec<TensorReport>,
    /// The worst elements of the worst tensor, the worst first.
    pub worst: Vec<WorstElement>,
    /// Largest difference in csu over all outputs; infinite where it is not finite.
    pub csu: f64,
    /// Where the node agrees only under a condition: which.
    pub note: Option<&'static str>,
    /// Root mean square of the bounds over that of the values: at least one where nothing is promised.
    pub(super) slack: f64,
    /// The reference's outputs, for those that the second party did not keep.
    pub(super) derived: Vec<Option<Value<Rounded>>>,
}

impl Judgement {
    /// Whether the node is outside rounding.
    pub fn is_outside(&self) -> bool {
        matches!(self.verdict, Grade::G2 | Grade::G3)
    }

    /// A node that cannot be compared.
    pub(super) fn incomparable(why: String) -> Self {
        Self {
            verdict: Grade::NotComparable,
            why: Some(why),
            tensors: Vec::new(),
            worst: Vec::new(),
            csu: f64::INFINITY,
            note: None,
            slack: 0.0,
            derived: Vec::new(),
        }
    }
}

/// Judges a node from its own operands, by the specification.
pub fn judge(case: &Case) -> Judgement {
    judge_view(&case.view(), &walk::evaluate)
}

/// Judges a node under another meaning: the worst grade, and the largest difference in csu.
///
/// # Errors
/// When the meaning cannot be applied, or an output that was found is not made by it.
pub fn judge_as(case: &Case, meaning: &Meaning) -> Result<(Grade, f64), String> {
    let judgement = judge_view(&case.view(), meaning);
    match judgement.verdict {
        Grade::NotComparable => Err(judgement.why.unwrap_or_default()),
        verdict => Ok((verdict, judgement.csu)),
    }
}

pub(super) fn judge_view(view: &View, meaning: &Meaning) -> Judgement {
    let exact = read(view, Reading::Exact, meaning);
    if !exact.is_outside() {
        return exact;
    }
    for reading in Reading::others(&view.operands) {
        let other = read(view, reading, meaning);
        if other.verdict <= Grade::G1 {
            return Judgement { note: reading.note(), ..other };
        }
    }
    exact
}

fn read(view: &View, reading: Reading, meaning: &Meaning) -> Judgement {
    let operands: Result<Vec<_>, String> = view
        .operands
        .iter()
        .map(|operand| operand.map(|operand| reading.value(operand)).transpose())
        .collect();
    let outputs = operands.and_then(|operands| {
        let borrowed: Vec<_> = operands.iter().map(Option::as_ref).collect();
        let outputs = meaning(view.node, view.opset, &borrowed)?;
        Ok((operands, outputs))
    });
    let (operands, outputs) = match outputs {
        Ok(outputs) => outputs,
        Err(why) => return Judgement::incomparable(why),
    };
    let mut judgement = Judgement {
        verdict: Grade::G0,
        why: None,
        tensors: Vec::new(),
        worst: Vec::new(),
        csu: 0.0,
        note: None,
        slack: 0.0,
        derived: vec![None; view.node.output.len()],
    };
    let mut others = None;
    for (k, name) in view.node.output.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        let Some(expected) = outputs.get(k).cloned().flatten() else {
            return Judgement::incomparable(format!("output \"{name}\" is not defined by the reference"));
        };
        let Some(found) = view.found.get(k).copied().flatten() else {
            judgement.derived[k] = Some(expected);
            continue;
        };
        if expected.shape() != found.shape {
            let why = format!("\"{name}\" has shape {:?}, expected {:?}", found.shape, expected.shape());
            judgement.tensors.push(of_another_shape(name, &expected, found));
            judgement.verdict = Grade::G3;
            judgement.csu = f64::INFINITY;
            judgement.why.get_or_insert(why);
            continue;
        }
        let mut measure = Measure::new(expected.element, found.len());
        let mut places = compare(&mut measure, &expected, found, None);
        if measure.verdict() == Verdict::Different {
            let others = others.get_or_insert_with(|| {
                discontinuity::other_outcomes(view.node, view.opset, &operands, meaning)
            });
            let others: Vec<&Value<Rounded>> =
                others.iter().filter_map(|outcome| outcome.get(k)?.as_ref()).collect();
            if !others.is_empty() {
                measure = Measure::new(expected.element, found.len());
                places = compare(&mut measure, &expected, found, Some(&others));
            }
        }
        debug_assert_eq!(places, found.len(), "every element is compared");
        let worse = judgement.worst.is_empty() || measure.csu() > judgement.csu;
        let report_worst = measure.worst(name, &found.shape);
        if worse && !report_worst.is_empty() {
            judgement.worst = report_worst;
        }
        judgement.csu = judgement.csu.max(measure.csu());
        judgement.slack = judgement.slack.max(measure.slack());
        let report = measure.report(name, &found.shape, groups(view, &found.shape));
        judgement.verdict = judgement.verdict.max(report.verdict);
        judgement.tensors.push(report);
    }
    judgement
}

/// Compares every element; where `others` are given, an element that differs is accepted if it is one of theirs.
fn compare(
    measure: &mut Measure,
    expected: &Value<Rounded>,
    found: &TypedTensor,
    others: Option<&[&Value<Rounded>]>,
) -> usize {
    let others = others.unwrap_or_default();
    match &expected.data {
        Data::Numbers(expected) => {
            let other: Vec<&Tensor<Rounded>> = others
                .iter()
                .filter_map(|other| other.numbers().ok())
                .filter(|other| other.shape == expected.shape)
                .collect();
            let found = numbers(found);
            for (place, (found, expected)) in found.iter().zip(&expected.data).enumerate() {
                let agrees = |with: &Rounded| measure.would_accept(*found, with);
                if !other.is_empty() && !agrees(expected) && other.iter().any(|o| agrees(&o.data[place])) {
                    measure.accept_undecidable(place, *found, expected.value);
                } else {
                    measure.number(place, *found, expected);
                }
            }
            found.len()
        }
        Data::Integers(expected) => {
            let others: Vec<&Tensor<i64>> = others
                .iter()
                .filter_map(|other| other.integers().ok())
                .filter(|other| other.shape == expected.shape)
                .collect();
            let other = |place: usize, found: i128| others.iter().any(|o| i128::from(o.data[place]) == found);
            whole(measure, found, |place| i128::from(expected.data[place]), other)
        }
        Data::Truths(expected) => {
            let others: Vec<&Tensor<bool>> = others
                .iter()
                .filter_map(|other| other.truths().ok())
                .filter(|other| other.shape == expected.shape)
                .collect();
            let other = |place: usize, found: i128| others.iter().any(|o| i128::from(o.data[place]) == found);
            whole(measure, found, |place| i128::from(expected.data[place]), other)
        }
    }
}

/// Compares whole numbers, which must be met.
fn whole(
    measure: &mut Measure,
    found: &TypedTensor,
    expected: impl Fn(usize) -> i128,
    other: impl Fn(usize, i128) -> bool,
) -> usize {
    let found = integers(found);
    for (place, &found) in found.iter().enumerate() {
        let expected = expected(place);
        if found != expected && other(place, found) {
            measure.accept_undecidable(place, found as f64, expected as f64);
        } else {
            measure.integer(place, found, expected);
        }
    }
    found.len()
}

fn of_another_shape(name: &str, expected: &Value<Rounded>, found: &TypedTensor) -> TensorReport {
    let report = Measure::new(expected.element, 0).report(name, &found.shape, None);
    TensorReport { verdict: Grade::G3, csu_max: None, csu_p999: None, csu_rms: None, abs_max: None, ..report }
}

/// The elements as f64, whatever they are.
pub(super) fn numbers(tensor: &TypedTensor) -> Vec<f64> {
    match tensor.to_f64() {
        Some(numbers) => numbers,
        None => integers(tensor).into_iter().map(|i| i as f64).collect(),
    }
}

/// The elements as whole numbers; a fraction, which no integer is, becomes the least of all.
fn integers(tensor: &TypedTensor) -> Vec<i128> {
    fn all<E: Copy + Into<i128>>(elements: &[E]) -> Vec<i128> {
        elements.iter().map(|&e| e.into()).collect()
    }
    match &tensor.elements {
        Elements::I8(v) => all(v),
        Elements::U8(v) => all(v),
        Elements::I16(v) => all(v),
        Elements::U16(v) => all(v),
        Elements::I32(v) => all(v),
        Elements::U32(v) => all(v),
        Elements::I64(v) => all(v),
        Elements::U64(v) => all(v),
        Elements::Bool(v) => all(v),
        Elements::F32(_) | Elements::F64(_) | Elements::F16(_) | Elements::Bf16(_) => {
            let whole = |x: f64| if x.fract() == 0.0 { x as i128 } else { i128::MIN / 2 };
            tensor.to_f64().unwrap_or_default().into_iter().map(whole).collect()
        }
    }
}

/// How many groups of elements of an output share an intermediate result; `None` where none do.
fn groups(view: &View, shape: &[usize]) -> Option<usize> {
    let int = |name: &str, default: i64| {
        let attribute = view.node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name));
        attribute.map_or(default, |attribute| attribute.i.unwrap_or(0))
    };
    let elements: usize = shape.iter().product();
    let channels = shape.get(1).copied().unwrap_or(1);
    let samples = shape.first().copied().unwrap_or(1);
    let along = |default: i64| {
        let axis = int("axis", default);
        let axis = if axis < 0 { axis + shape.len() as i64 } else { axis };
        usize::try_from(axis).unwrap_or(0).min(shape.len())
    };
    match view.operator() {
        "BatchNormalization" => Some(channels),
        "InstanceNormalization" | "MeanVarianceNormalization" => Some(samples * channels),
        "GroupNormalization" => {
            let groups = usize::try_from(int("num_groups", 1)).unwrap_or(1);
            Some(samples * groups.max(1))
        }
        "LayerNormalization" | "RMSNormalization" => Some(shape[..along(-1)].iter().product()),
        "Softmax" | "LogSoftmax" | "LpNormalization" => {
            let default = if view.opset < 13 && view.operator() != "LpNormalization" { 1 } else { -1 };
            Some(elements / shape.get(along(default)).copied().unwrap_or(1).max(1))
        }
        "Attention" => Some(elements / shape.last().copied().unwrap_or(1).max(1)),
        _ => None,
    }
}

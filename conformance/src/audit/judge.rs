//! The local certificate of one node: the reference, fed with the second party's own operands, against its outputs.

use rayon::prelude::*;
use vitruvian_reference::nn::Rounded;

use super::case::{Case, Operand, View};
use super::compare::compare;
use super::discontinuity::{self, Outcomes};
use super::division::{Division, Source};
use super::measure::Measure;
use super::reading::Reading;
use super::recurrence;
use super::region::{Region, flat, part, value_flat};
use super::report::{Grade, TensorReport, WorstElement};
use super::same_order;
use super::sample::Plan;
use crate::certificate::Verdict;
use crate::onnx::message::NodeProto;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// A node's meaning: its outputs, with what rounding may do to them, from its operands.
pub type Meaning<'a> = dyn Fn(&NodeProto, i64, &[Option<&Value<Rounded>>]) -> Result<Vec<Option<Value<Rounded>>>, String>
    + Sync
    + 'a;

/// The outputs of a node from its operands with its decisions made otherwise.
type Others<'a> = dyn Fn(&NodeProto, i64, &[Option<Value<Rounded>>]) -> Outcomes + 'a;

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
    /// Whether an element's bound is infinite, so that its grade says nothing.
    pub(super) is_unbounded: bool,
    /// The reference's outputs, for those that the second party did not keep.
    pub(super) derived: Vec<Option<Value<Rounded>>>,
}

impl Judgement {
    /// Whether the node is outside rounding.
    pub fn is_outside(&self) -> bool {
        matches!(self.verdict, Grade::G2 | Grade::G3)
    }

    /// A node of which nothing has been compared yet.
    fn begun(view: &View) -> Self {
        Self {
            verdict: Grade::G0,
            why: None,
            tensors: Vec::new(),
            worst: Vec::new(),
            csu: 0.0,
            note: None,
            slack: 0.0,
            is_unbounded: false,
            derived: vec![None; view.node.output.len()],
        }
    }

    /// Adds an output that was compared.
    fn add(
        &mut self,
        view: &View,
        output: usize,
        found: &TypedTensor,
        measure: Measure,
        sample: Option<String>,
    ) {
        let name = &view.node.output[output];
        let worst = measure.worst(name, &found.shape);
        if !worst.is_empty() && (self.worst.is_empty() || measure.csu() > self.csu) {
            self.worst = worst;
        }
        self.csu = self.csu.max(measure.csu());
        self.slack = self.slack.max(measure.slack());
        self.is_unbounded |= measure.is_unbounded();
        let report = measure.report(name, &found.shape, groups(view, &found.shape));
        self.verdict = self.verdict.max(report.verdict);
        self.tensors.push(TensorReport { sample, ..report });
    }

    /// Adds an output of another shape than it should have.
    fn add_shape(&mut self, name: &str, expected: &[usize], found: &TypedTensor) {
        let report = Measure::new(found.element(), 0).report(name, &found.shape, None);
        let unknown = TensorReport { csu_max: None, csu_p999: None, csu_rms: None, abs_max: None, ..report };
        self.tensors.push(TensorReport { verdict: Grade::G3, rel_max: None, ulp_max: None, ..unknown });
        self.verdict = Grade::G3;
        self.csu = f64::INFINITY;
        self.why.get_or_insert(format!("\"{name}\" has shape {:?}, expected {expected:?}", found.shape));
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
            is_unbounded: false,
            derived: Vec::new(),
        }
    }
}

/// Judges a node from its own operands, by the specification: wholly where that takes no more than `effort` products, or
/// else by a stated sample.
pub fn judge(case: &Case, effort: f64) -> Judgement {
    judge_view(&case.view(), effort)
}

/// Judges a node under another meaning: the worst grade, and the largest difference in csu.
///
/// The node is evaluated whole, so a large case should be cut to a [piece](Case::piece) before.
///
/// # Errors
/// When the meaning cannot be applied, does not make an output that was found, or the case is too large.
pub fn judge_as(case: &Case, meaning: &Meaning) -> Result<(Grade, f64), String> {
    let view = case.view();
    let others = |node: &NodeProto, opset: i64, operands: &[Option<Value<Rounded>>]| {
        discontinuity::other_outcomes(node, opset, operands, meaning)
    };
    let mut judgement = whole(&view, Reading::Exact, meaning, &others);
    if judgement.is_outside() {
        for reading in Reading::others(&view.operands) {
            let other = whole(&view, reading, meaning, &others);
            if other.verdict <= Grade::G1 {
                judgement = other;
            }
        }
    }
    match judgement.verdict {
        Grade::NotComparable => Err(judgement.why.unwrap_or_default()),
        verdict => Ok((verdict, judgement.csu)),
    }
}

pub(super) fn judge_view(view: &View, effort: f64) -> Judgement {
    let exact = read(view, Reading::Exact, effort);
    if !exact.is_outside() {
        return exact;
    }
    for reading in Reading::others(&view.operands) {
        let other = read(view, reading, effort);
        if other.verdict <= Grade::G1 {
            return Judgement { note: reading.note(), ..other };
        }
    }
    exact
}

/// About how many products a node takes.
pub(super) fn cost(view: &View) -> f64 {
    let outputs = (0..view.node.output.len()).filter_map(|k| Division::of(view, k));
    let divided: f64 = outputs.map(|d| d.cost * d.shape.iter().product::<usize>() as f64).sum();
    divided.max(elements(view) as f64)
}

/// Elements of all operands and of all that was found.
fn elements(view: &View) -> usize {
    let operands = view.operands.iter().flatten().map(|operand| operand.shape().iter().product::<usize>());
    operands.sum::<usize>() + view.found.iter().flatten().map(|found| found.len()).sum::<usize>()
}

/// Judges under one reading of the operands: the whole node at once where it is small, or else output by output in pieces.
fn read(view: &View, reading: Reading, effort: f64) -> Judgement {
    let asked = || view.node.output.iter().enumerate().filter(|(_, name)| !name.is_empty());
    if let Some(states) = recurrence::shown(view) {
        let stepwise = |node: &NodeProto, opset: i64, operands: &[Option<&Value<Rounded>>]| {
            recurrence::step_by_step(node, opset, operands, states)
        };
        return whole(view, reading, &stepwise, &|_, _, _| Vec::new());
    }
    let all_found = asked().all(|(k, _)| view.found.get(k).is_some_and(Option::is_some));
    if !all_found && cost(view) > MOST_FILLED_IN {
        return Judgement::incomparable(format!("{:.0e} products are too many to be filled in", cost(view)));
    }
    if !all_found || (elements(view) <= SMALL && cost(view) <= effort) {
        return whole(view, reading, &specified, &discontinuity::specified_outcomes);
    }
    let mut judgement = Judgement::begun(view);
    for (k, name) in asked() {
        let Some(found) = view.found[k] else { continue };
        let outcome = if let Some(shape) = same_order::shape(view) {
            if shape == found.shape { Ok(in_order(view, found)) } else { Err(Fault::Shape(shape)) }
        } else if let Some(division) = Division::of(view, k) {
            if division.shape == found.shape {
                let seed = name.bytes().fold(effort.to_bits(), |h, b| h.rotate_left(7) ^ u64::from(b));
                let plan = Plan::of(&division, effort, seed);
                in_pieces(view, &division, &plan, found, reading).map(|measure| (measure, plan.sample))
            } else {
                Err(Fault::Shape(division.shape))
            }
        } else {
            return whole(view, reading, &specified, &discontinuity::specified_outcomes);
        };
        match outcome {
            Ok((measure, sample)) => judgement.add(view, k, found, measure, sample),
            Err(Fault::Shape(expected)) => judgement.add_shape(name, &expected, found),
            Err(Fault::Incomparable(why)) => return Judgement::incomparable(why),
        }
    }
    judgement
}

/// What the specification says of a node.
///
/// A cast to a narrower unit states an error that came in, in units of the type before, in those of the type after it.
fn specified(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<&Value<Rounded>>],
) -> Result<Vec<Option<Value<Rounded>>>, String> {
    let mut outputs = walk::evaluate(node, opset, operands)?;
    if node.op_type.as_deref() == Some("Cast")
        && let (Some(Some(from)), Some(Some(to))) = (operands.first(), outputs.first_mut())
        && let (Some(wide), Some(narrow)) = (from.element.unit_roundoff(), to.element.unit_roundoff())
        && wide > narrow
        && let Data::Numbers(numbers) = &mut to.data
    {
        numbers.data.iter_mut().for_each(|x| x.terms *= wide / narrow);
    }
    Ok(outputs)
}

/// Why an output has no measure.
enum Fault {
    /// Its shape should be another.
    Shape(Vec<usize>),
    /// The reference does not define it.
    Incomparable(String),
}

/// Elements of a node that is judged at once, and that of the largest that is when there is no other way.
const SMALL: usize = 1 << 16;
const LARGEST: usize = 1 << 25;

/// Products that a node may take of which an output is missing: it has to be computed wholly.
const MOST_FILLED_IN: f64 = 1e10;

/// Elements that are judged at once where the order stays.
const RUN: usize = 1 << 16;

/// The same elements in the same order.
fn in_order(view: &View, found: &TypedTensor) -> (Measure, Option<String>) {
    let measure = |first: usize| {
        let offsets = first..(first + RUN).min(found.len());
        let own = match view.operands[0] {
            Some(Operand::Given(tensor)) => Value::of(&flat(tensor, offsets.clone())),
            Some(Operand::Derived(value)) => Ok(value_flat(value, offsets.clone())),
            None => Err(String::new()),
        };
        let mut measure = Measure::new(found.element(), found.len());
        if let Ok(own) = own {
            compare(&mut measure, &own, &flat(found, offsets), &|place| first + place, &[]);
        }
        measure
    };
    let measures: Vec<Measure> =
        (0..found.len()).step_by(RUN).collect::<Vec<_>>().into_par_iter().map(measure).collect();
    (joined(measures, found), None)
}

fn joined(measures: Vec<Measure>, found: &TypedTensor) -> Measure {
    measures
        .into_iter()
        .reduce(|mut all, part| {
            all.join(part);
            all
        })
        .unwrap_or_else(|| Measure::new(found.element(), 0))
}

/// The planned boxes of one output, each as a node of its own.
fn in_pieces(
    view: &View,
    division: &Division,
    plan: &Plan,
    found: &TypedTensor,
    reading: Reading,
) -> Result<Measure, Fault> {
    let elements: usize = plan.boxes.iter().map(Region::len).sum();
    let measure = |region: &Region| -> Result<Measure, String> {
        let piece =
            division.piece(region).ok_or_else(|| format!("the output cannot be cut at {region:?}"))?;
        let operands = piece
            .operands
            .iter()
            .zip(&view.operands)
            .map(|(source, operand)| match (source, operand) {
                (Source::Made(tensor), _) => Value::of(tensor).map(Some),
                (Source::Whole, Some(operand)) => reading.value(*operand, None).map(Some),
                (Source::Part(region), Some(operand)) if region.fits(operand.shape()) => {
                    reading.value(*operand, Some(region)).map(Some)
                }
                (Source::Part(_), Some(operand)) => Err(format!(
                    "an operand of shape {:?} does not fit the output's {:?}",
                    operand.shape(),
                    found.shape
                )),
                _ => Ok(None),
            })
            .collect::<Result<Vec<_>, String>>()?;
        let borrowed: Vec<_> = operands.iter().map(Option::as_ref).collect();
        let mut outputs = walk::evaluate(&piece.node, view.opset, &borrowed)?;
        let expected = outputs.first_mut().and_then(Option::take);
        let expected = expected.ok_or("the reference does not define it")?;
        if expected.shape() != region.shape() {
            let (made, asked) = (expected.shape(), region.shape());
            return Err(format!("a box of {asked:?} was asked for, the reference makes {made:?}"));
        }
        let own = part(found, region);
        let measured = |others: &[&Value<Rounded>]| {
            let mut measure = Measure::new(expected.element, elements);
            compare(&mut measure, &expected, &own, &|place| region.offset(place, &found.shape), others);
            measure
        };
        let measure = measured(&[]);
        if measure.verdict() != Verdict::Different {
            return Ok(measure);
        }
        let others = discontinuity::specified_outcomes(&piece.node, view.opset, &operands);
        let others: Vec<_> = others.iter().filter_map(|outcome| outcome.first()?.as_ref()).collect();
        Ok(if others.is_empty() { measure } else { measured(&others) })
    };
    let measures: Result<Vec<Measure>, String> = plan.boxes.par_iter().map(measure).collect();
    Ok(joined(measures.map_err(Fault::Incomparable)?, found))
}

/// Judges a node that is evaluated at once; fills in the outputs that were not found.
fn whole(view: &View, reading: Reading, meaning: &Meaning, other_outcomes: &Others) -> Judgement {
    if elements(view) > LARGEST {
        let why = format!("{} elements are too many to be compared at once", elements(view));
        return Judgement::incomparable(why);
    }
    let operands: Result<Vec<_>, String> = view
        .operands
        .iter()
        .map(|operand| operand.map(|operand| reading.value(operand, None)).transpose())
        .collect();
    let outputs = operands.and_then(|operands| {
        let borrowed: Vec<_> = operands.iter().map(Option::as_ref).collect();
        let outputs = meaning(view.node, view.opset, &borrowed)?;
        Ok((operands, outputs))
    });
    let (operands, mut outputs) = match outputs {
        Ok(outputs) => outputs,
        Err(why) => return Judgement::incomparable(why),
    };
    let mut judgement = Judgement::begun(view);
    let mut others = None;
    for (k, name) in view.node.output.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        let Some(expected) = outputs.get_mut(k).and_then(Option::take) else {
            return Judgement::incomparable(format!("output \"{name}\" is not defined by the reference"));
        };
        let Some(found) = view.found.get(k).copied().flatten() else {
            judgement.derived[k] = Some(expected);
            continue;
        };
        if expected.shape() != found.shape {
            judgement.add_shape(name, expected.shape(), found);
            continue;
        }
        let measured = |others: &[&Value<Rounded>]| {
            let mut measure = Measure::new(expected.element, found.len());
            compare(&mut measure, &expected, found, &|place| place, others);
            measure
        };
        let mut measure = measured(&[]);
        if measure.verdict() == Verdict::Different {
            let others = others.get_or_insert_with(|| other_outcomes(view.node, view.opset, &operands));
            let others: Vec<_> = others.iter().filter_map(|outcome| outcome.get(k)?.as_ref()).collect();
            if !others.is_empty() {
                measure = measured(&others);
            }
        }
        judgement.add(view, k, found, measure, None);
    }
    judgement
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

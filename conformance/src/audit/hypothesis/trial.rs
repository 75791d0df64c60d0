//! What suspicions are tried on: a node, cut to a small part where it is large.

use vitruvian_reference::nn::{Rounded, Tensor};

use super::change::{Meaning, Operands, Outputs, exact, specified};
use super::excerpt::{Excerpt, excerpts, weights};
use crate::audit::case::Case;
use crate::audit::compare::numbers;
use crate::audit::judge::judge_as;
use crate::audit::region::Region;
use crate::audit::report::Grade;
use crate::onnx::message::NodeProto;
use crate::onnx::value::{Data, Value};

/// The share of the differences that may be left under a meaning that comes closer.
///
/// A factor of 1.000001, which is barely more than rounding, leaves three quarters.
const CLOSER: f64 = 0.95;

/// A node outside rounding, and the parts of it that meanings are tried on.
pub struct Trial<'a> {
    /// The node, whole.
    pub case: &'a Case,
    /// The grade under the specified meaning.
    pub grade: Grade,
    /// The largest difference under it, in csu.
    pub csu: f64,
    excerpts: Vec<Excerpt>,
}

impl<'a> Trial<'a> {
    /// `None` where nothing is outside rounding, or the specified meaning cannot be evaluated.
    pub fn of(case: &'a Case, worst: Option<&[usize]>) -> Option<Self> {
        let mut trial = Self { case, grade: Grade::G0, csu: 0.0, excerpts: excerpts(case, worst) };
        (trial.grade, trial.csu) = trial.judge(&specified())?;
        (trial.grade > Grade::G1).then_some(trial)
    }

    /// The worst grade and the largest difference in csu over the parts; `None` where the meaning cannot be applied.
    pub fn judge(&self, meaning: &Meaning) -> Option<(Grade, f64)> {
        let mut worst = (Grade::G0, 0.0_f64);
        if self.excerpts.is_empty() {
            return None;
        }
        for excerpt in &self.excerpts {
            let windowed = |node: &NodeProto, opset: i64, operands: &Operands| {
                excerpt.apply(meaning, node, opset, operands)
            };
            let (grade, csu) = judge_as(&excerpt.case, &windowed).ok()?;
            worst = (worst.0.max(grade), worst.1.max(csu));
            if grade == Grade::G3 && (csu.is_nan() || csu >= self.csu) {
                break;
            }
        }
        Some(worst)
    }

    /// The first output's numbers under a meaning, part by part.
    pub fn values(&self, meaning: &Meaning) -> Option<Vec<Rounded>> {
        let mut all = Vec::new();
        for excerpt in &self.excerpts {
            let operands: Vec<Option<Value<Rounded>>> = excerpt
                .case
                .operands
                .iter()
                .map(|operand| operand.as_ref().map(Value::of).transpose())
                .collect::<Result<_, _>>()
                .ok()?;
            let operands: Vec<Option<&Value<Rounded>>> = operands.iter().map(Option::as_ref).collect();
            let outputs = excerpt.apply(meaning, &excerpt.case.node, excerpt.case.opset, &operands).ok()?;
            match &outputs.first()?.as_ref()?.data {
                Data::Numbers(y) => all.extend_from_slice(&y.data),
                Data::Integers(y) => all.extend(y.data.iter().map(|&i| exact(i as f64))),
                Data::Truths(_) => return None,
            }
        }
        Some(all)
    }

    /// Whether the differences are smaller under a meaning than under the specified one, by their root mean square.
    ///
    /// Where the specified outputs are of another shape or not finite there is nothing to compare, and any meaning is closer.
    pub fn comes_closer(&self, meaning: &Meaning) -> bool {
        let Some(found) = self.found() else { return true };
        let distance = |meaning: &Meaning| {
            let y = self.values(meaning).filter(|y| y.len() == found.len())?;
            // What is not a number on both sides is no difference.
            let square = |(f, y): (&f64, &Rounded)| {
                if f.is_nan() && y.value.is_nan() || *f == y.value { 0.0 } else { (f - y.value).powi(2) }
            };
            Some(found.iter().zip(&y).map(square).sum::<f64>()).filter(|sum| sum.is_finite())
        };
        match (distance(&specified()), distance(meaning)) {
            (Some(before), Some(after)) => after <= CLOSER * CLOSER * before,
            _ => true,
        }
    }

    /// The first output's numbers as found, part by part.
    pub fn found(&self) -> Option<Vec<f64>> {
        let mut all = Vec::new();
        for excerpt in &self.excerpts {
            all.extend(numbers(excerpt.case.found.first()?.as_ref()?));
        }
        Some(all)
    }

    /// The shape of the first output's only part.
    pub fn excerpt_shape(&self) -> Option<Vec<usize>> {
        match &self.excerpts[..] {
            [one] => one.case.found.first()?.as_ref().map(|found| found.shape.clone()),
            _ => None,
        }
    }

    /// The specified meaning with some numbers of the first output replaced, by their place in [`Trial::found`].
    pub fn overwritten(&self, with: Vec<(usize, f64)>) -> Meaning {
        // A window's places are not those of the output that it is cut from.
        let direct = matches!(&self.excerpts[..], [one] if one.window.is_none());
        super::change::output(move |y| {
            let mut y = Some(y).filter(|_| direct)?.clone();
            for &(place, value) in &with {
                match &mut y.data {
                    Data::Numbers(x) => *x.data.get_mut(place)? = exact(value),
                    Data::Integers(x) => *x.data.get_mut(place)? = value as i64,
                    Data::Truths(_) => return None,
                }
            }
            Some(y)
        })
    }

    /// The node.
    pub fn node(&self) -> &NodeProto {
        &self.case.node
    }

    /// Its operator.
    pub fn operator(&self) -> &str {
        self.case.node.op_type.as_deref().unwrap_or_default()
    }

    /// The place of the weights, or of the second matrix.
    pub fn weights(&self) -> usize {
        weights(self.operator())
    }

    /// An operand's shape, whole.
    pub fn shape(&self, operand: usize) -> Option<&[usize]> {
        self.case.operands.get(operand)?.as_ref().map(|tensor| &tensor.shape[..])
    }

    /// The first output's shape, whole.
    pub fn output_shape(&self) -> Option<&[usize]> {
        self.case.found.first()?.as_ref().map(|tensor| &tensor.shape[..])
    }

    /// An operand's first element, number or integer.
    pub fn first(&self, operand: usize) -> Option<f64> {
        numbers(self.case.operands.get(operand)?.as_ref()?).first().copied()
    }

    /// An operand's integers.
    pub fn integers(&self, operand: usize) -> Option<Vec<i64>> {
        let value: Value = Value::of(self.case.operands.get(operand)?.as_ref()?).ok()?;
        value.integers().ok().map(|x| x.data.clone())
    }

    /// An operand's numbers.
    pub fn numbers(&self, operand: usize) -> Option<Vec<f64>> {
        self.case.operands.get(operand)?.as_ref()?.to_f64()
    }
}

impl Excerpt {
    /// The outputs under a meaning, cut to the window.
    fn apply(&self, meaning: &Meaning, node: &NodeProto, opset: i64, operands: &Operands) -> Outputs {
        let mut outputs = meaning(node, opset, operands)?;
        if let Some(window) = &self.window {
            let first = outputs.first_mut().and_then(Option::as_mut).ok_or("has no first output")?;
            *first = inside(first, window).ok_or("does not reach the window")?;
        }
        Ok(outputs)
    }
}

fn inside(value: &Value<Rounded>, window: &Region) -> Option<Value<Rounded>> {
    let cut = |places: &[Tensor<usize>]| {
        let x = places.first().filter(|x| window.fits(&x.shape)).ok_or("does not reach the window")?;
        let data = window.runs(&x.shape).flat_map(|run| x.data[run].iter().copied()).collect();
        Ok(Tensor::new(&window.shape(), data))
    };
    Value::arranged(&[value], cut).ok()
}

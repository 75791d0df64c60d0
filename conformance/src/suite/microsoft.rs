//! The operators of the domain `com.microsoft` against ONNX Runtime, and mistakes planted in what it gave.

use std::cell::RefCell;

use proptest::test_runner::{TestCaseError, TestError};

use super::operators::{Disagreement, Draw};
use crate::audit::report::Grade;
use crate::audit::{Case, judge};
use crate::error::Result;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::problem::microsoft::{drawn, mistaken, problems};

/// What came of one operator's problems.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Problems judged.
    pub cases: usize,
    /// Elements compared.
    pub elements: u64,
    /// Elements that are right on either side of a tie.
    pub undecidable: u64,
    /// Largest difference in csu.
    pub csu: f64,
}

/// Products that a judgement may take: all that is drawn is judged whole.
pub const EFFORT: f64 = 1e9;

/// Draws problems of an operator, lets ONNX Runtime run them and judges what it gives.
///
/// # Errors
/// The first problem whose output is outside of rounding.
pub fn judge_problems(operator: &'static str, draw: Draw) -> std::result::Result<Tally, Disagreement> {
    let tally = RefCell::new(Tally::default());
    let outcome = draw.runner(operator).run(&problems(operator), |problem| {
        let case = problem.run().map_err(|error| TestCaseError::fail(error.to_string()))?;
        let judgement = judge(&case, EFFORT);
        if judgement.is_outside() || judgement.verdict == Grade::NotComparable {
            let (verdict, why, worst) = (judgement.verdict, judgement.why, judgement.worst.first());
            return Err(TestCaseError::fail(format!("{verdict}: {why:?} {worst:?}")));
        }
        let mut tally = tally.borrow_mut();
        tally.cases += 1;
        tally.elements += judgement.tensors.iter().map(|tensor| tensor.compared).sum::<u64>();
        tally.undecidable += judgement.tensors.iter().map(|tensor| tensor.undecidable).sum::<u64>();
        tally.csu = tally.csu.max(judgement.csu);
        Ok(())
    });
    match outcome {
        Ok(()) => Ok(tally.into_inner()),
        Err(TestError::Fail(why, problem)) => {
            Err(Disagreement { judge: operator, message: format!("{why}\n{problem:?}"), draw })
        }
        Err(TestError::Abort(why)) => {
            Err(Disagreement { judge: operator, message: format!("no problems could be drawn: {why}"), draw })
        }
    }
}

/// Mistakes that were planted in an operator's outputs, and those that were not told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Planted {
    /// Outputs that a mistake changed.
    pub planted: usize,
    /// Those of them that were judged to be right.
    pub missed: Vec<String>,
}

/// Judges what ONNX Runtime gives where it reads one operand as another.
///
/// # Errors
/// When ONNX Runtime is missing or refuses a graph.
pub fn judge_mistakes(operator: &'static str, seeds: std::ops::Range<u64>) -> Result<Planted> {
    let mut outcome = Planted::default();
    for seed in seeds {
        let problem = drawn(operator, seed, false);
        let right = problem.run()?;
        for other in mistaken(&problem) {
            let found = other.run()?.found;
            if found == right.found {
                continue;
            }
            outcome.planted += 1;
            let case = Case { found, ..right.clone() };
            if !judge(&case, EFFORT).is_outside() {
                outcome.missed.push(format!("seed {seed}: {problem:?} read as {other:?}"));
            }
        }
    }
    Ok(outcome)
}

/// Integers that are one level off, in either direction, and how many of them are accepted as the other side of a tie.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps {
    /// Integers that were moved.
    pub moved: u64,
    /// Those that were accepted.
    pub accepted: u64,
}

/// Judges ONNX Runtime's output with every integer moved by one level, up and then down.
///
/// # Errors
/// When ONNX Runtime is missing or refuses a graph.
pub fn judge_steps(operator: &'static str, seeds: std::ops::Range<u64>) -> Result<Steps> {
    let mut steps = Steps::default();
    for seed in seeds {
        let right = drawn(operator, seed, false).run()?;
        for step in [-1, 1] {
            let moved: Vec<Option<TypedTensor>> =
                right.found.iter().map(|found| moved(found.as_ref()?, step)).collect();
            let Some(found) = &moved[0] else { continue };
            steps.moved += found.len() as u64;
            let judgement = judge(&Case { found: moved, ..right.clone() }, EFFORT);
            steps.accepted += judgement.tensors.iter().map(|tensor| tensor.undecidable).sum::<u64>();
            if !judgement.is_outside() {
                steps.accepted = steps.moved;
            }
        }
    }
    Ok(steps)
}

/// Integers moved by a step, those at the end of the type the other way; `None` for numbers.
fn moved(found: &TypedTensor, step: i8) -> Option<TypedTensor> {
    let elements = match &found.elements {
        Elements::I8(v) => {
            Elements::I8(v.iter().map(|&q| q.checked_add(step).unwrap_or_else(|| q - step)).collect())
        }
        Elements::U8(v) => Elements::U8(
            v.iter()
                .map(|&q| q.checked_add_signed(step).unwrap_or_else(|| q.wrapping_add_signed(-step)))
                .collect(),
        ),
        _ => return None,
    };
    Some(TypedTensor { shape: found.shape.clone(), elements })
}

//! The operators of the domain `com.microsoft` against ONNX Runtime, and mistakes planted in what it gave.

use std::cell::RefCell;

use proptest::test_runner::{TestCaseError, TestError};

use super::operators::{Disagreement, Draw};
use crate::audit::judge;
use crate::audit::report::Grade;
use crate::problem::microsoft::problems;

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
pub fn judge_problems(operator: &'static str, draw: Draw) -> Result<Tally, Disagreement> {
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

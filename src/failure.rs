//! Why a command ended without its result, in one line for the terminal.

use std::path::Path;

use vitruvian_conformance::audit::report::Grade;
use vitruvian_conformance::error::Error as JudgeError;
use vitruvian_runtime::error::Error;

/// A command's failure.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The runtime refused: a file, a camera, a graph, a missing component.
    #[error(transparent)]
    Runtime(#[from] Error),
    /// The arguments or their files do not make sense together.
    #[error("{0}")]
    Usage(String),
    /// A verdict that was asked for is negative.
    #[error("{0}")]
    Negative(String),
    /// The judge could not read or compare what it was given.
    #[error(transparent)]
    Judge(#[from] JudgeError),
    /// An audit ended with a grade that is not ordinary rounding.
    #[error("{words}")]
    Audit {
        /// The audit's verdict.
        grade: Grade,
        /// What is wrong and where.
        words: String,
    },
}

impl Failure {
    /// 1 for a negative verdict, 2 for bad input or usage, 3 for a missing component; of an audit 1 for unusual rounding, 4 for what
    /// cannot be rounding, 5 for what could not be compared.
    pub fn exit_status(&self) -> u8 {
        match self {
            Failure::Runtime(error) => error.exit_status(),
            Failure::Usage(_) => 2,
            Failure::Negative(_) => 1,
            Failure::Judge(JudgeError::Runtime(error)) => error.exit_status(),
            Failure::Judge(JudgeError::Io { .. } | JudgeError::Onnx { .. }) => 2,
            Failure::Audit { grade, .. } => match grade {
                Grade::G0 | Grade::G1 => 0,
                Grade::G2 => 1,
                Grade::G3 => 4,
                Grade::NotComparable => 5,
            },
        }
    }
}

/// A command's result.
pub type Result<T> = std::result::Result<T, Failure>;

/// Names the file in a failure that the runtime could not tie to one, because it was handed the content alone.
pub fn about(path: &Path) -> impl Fn(Error) -> Failure {
    move |error| match error {
        Error::Unanswerable(message) => Error::file(path, message).into(),
        other => other.into(),
    }
}

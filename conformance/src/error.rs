//! What can keep the judge from judging. A disagreement is not an error: it is a verdict.

use std::path::PathBuf;

/// Why a comparison could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A graph's bytes do not hold what is needed.
    #[error("{graph}: {item}: {message}")]
    Onnx {
        /// The file, or a name for a graph built in memory.
        graph: String,
        /// The part of the graph, such as `initializer "stem.conv.weight"`.
        item: String,
        /// What was found and what was expected.
        message: String,
    },
    /// The runtime, or ONNX Runtime through it, refused.
    #[error(transparent)]
    Runtime(#[from] vitruvian_runtime::error::Error),
}

/// The judge's result.
pub type Result<T> = std::result::Result<T, Error>;

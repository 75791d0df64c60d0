//! Every failure that comes from outside, named by what it concerns.

use std::path::{Path, PathBuf};

/// What went wrong, where, what was expected and how to mend it.
///
/// The variants say whose move it is: the file's author, the caller, or whoever installed the machine.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A file was read but does not hold what it should.
    #[error("{path}: {message}")]
    File {
        /// The file.
        path: PathBuf,
        /// What was found, what was expected, how to mend it.
        message: String,
    },
    /// A capture's view or camera is unusable.
    #[error("{path}: camera \"{camera}\": {message}")]
    Camera {
        /// The capture folder or cameras file.
        path: PathBuf,
        /// The camera's name.
        camera: String,
        /// What was found, what was expected, how to mend it.
        message: String,
    },
    /// A graph does not keep its contract.
    #[error("{path}: {item}: {message}")]
    Graph {
        /// The ONNX file.
        path: PathBuf,
        /// The property or tensor, such as `metadata "vitruvian.kind"` or `input "uv"`.
        item: String,
        /// What was found, what was expected, how to mend it.
        message: String,
    },
    /// A component that the work needs is not installed.
    #[error("{component} is missing: {message}")]
    Missing {
        /// Such as `ONNX Runtime`.
        component: &'static str,
        /// Where it was looked for and how to get it.
        message: String,
    },
    /// A square around a person that cannot be cut out of a photograph.
    #[error("person box of {side_px:?} pixels around ({:?}, {:?}): {message}", .center_px[0], .center_px[1])]
    PersonBox {
        /// The square's middle.
        center_px: [f64; 2],
        /// The square's side.
        side_px: f64,
        /// What was found, what was expected, how to mend it.
        message: String,
    },
    /// The input is well-formed but holds no answer (an empty field, a level never reached).
    #[error("{0}")]
    Unanswerable(String),
}

impl Error {
    /// The command's exit status for this failure: 3 for a missing component, 2 otherwise.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::Missing { .. } => 3,
            _ => 2,
        }
    }

    /// A failure to read or write `path`.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Error::Io { path: path.to_owned(), source }
    }

    /// A file whose content is not what it should be.
    pub fn file(path: &Path, message: impl Into<String>) -> Self {
        Error::File { path: path.to_owned(), message: message.into() }
    }

    /// A camera, or one of its files, that cannot be used.
    pub fn camera(path: &Path, camera: &str, message: impl Into<String>) -> Self {
        Error::Camera { path: path.to_owned(), camera: camera.to_owned(), message: message.into() }
    }
}

/// The runtime's result.
pub type Result<T> = std::result::Result<T, Error>;

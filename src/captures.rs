//! One capture, or a folder of captures, on the command line.

use std::path::{Path, PathBuf};

use vitruvian_runtime::error::Error;

use crate::failure::Result;

/// A capture and the folder for its results.
pub struct Job {
    /// The capture's folder.
    pub capture: PathBuf,
    /// Where its results go.
    pub out: PathBuf,
}

/// Whether a folder holds a capture: whether it has cameras.
pub fn is_capture(path: &Path) -> bool {
    ["cameras.json", "intri.yml"].iter().any(|name| path.join(name).is_file())
}

/// The capture `path` with the results in `out`; or every capture in the folder `path`, in the order of their names,
/// with the results in folders of the same names in `out`.
///
/// A folder that holds neither is returned as it stands: reading it says what is missing.
pub fn jobs(path: &Path, out: &Path) -> Result<Vec<Job>> {
    if !is_capture(path) && path.is_dir() {
        let entries = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
        let mut folders: Vec<PathBuf> =
            entries.flatten().map(|entry| entry.path()).filter(|path| is_capture(path)).collect();
        folders.sort();
        if !folders.is_empty() {
            let named = |capture: PathBuf| Some(Job { out: out.join(capture.file_name()?), capture });
            return Ok(folders.into_iter().filter_map(named).collect());
        }
    }
    Ok(vec![Job { capture: path.to_owned(), out: out.to_owned() }])
}

/// Whether `path` is a folder of captures rather than one capture.
pub fn is_sequence(path: &Path, jobs: &[Job]) -> bool {
    jobs.first().is_some_and(|job| job.capture != path)
}

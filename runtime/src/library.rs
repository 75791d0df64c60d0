//! Finding ONNX Runtime: the shared library that executes the graphs.
//!
//! It is looked for when the first graph is loaded, never before: everything that needs no network works without it.
//! The places, in order:
//!
//! 1. `ORT_DYLIB_PATH`, when set: that file and no other;
//! 2. `vendor/onnxruntime/` (where `make onnxruntime` puts it), in the current folder, the executable's, or any above;
//! 3. beside the executable;
//! 4. wherever the system's loader finds it by name.
//!
//! A library that is too old or is none is passed over, and named if none fits. The version is read from the library
//! before anything else is asked of it, so an old one is refused and never run.
//!
//! # Why is there no unsafe code here?
//! `ort` opens the library, compares its version with the interface it was compiled for and returns what it found as
//! an error; this module only decides which files to offer it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ort::environment::Environment;

use crate::error::{Error, Result};

/// The oldest minor version of ONNX Runtime 1.x that is accepted: the one whose interface `ort` is compiled for.
pub const OLDEST_MINOR_VERSION: u32 = ort::MINOR_VERSION;

/// The environment variable that names the library.
pub const PATH_VARIABLE: &str = "ORT_DYLIB_PATH";

/// The library's file name on this platform, such as `libonnxruntime.so`.
fn file_name() -> String {
    format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// The process-wide ONNX Runtime environment, loading the library on the first call.
///
/// # Errors
/// [`Error::Missing`] when no usable library is found: it lists every place with what was wrong there.
pub fn environment() -> Result<&'static Environment> {
    static LOADED: OnceLock<Environment> = OnceLock::new();
    static LOADING: Mutex<()> = Mutex::new(());
    if let Some(environment) = LOADED.get() {
        return Ok(environment);
    }
    let _one_at_a_time = LOADING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(environment) = LOADED.get() {
        return Ok(environment);
    }
    let environment = load(&Places::of_this_process())?;
    Ok(LOADED.get_or_init(|| environment))
}

/// The library that is in use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loaded {
    /// Its file, links resolved.
    pub path: PathBuf,
    /// Such as `1.32`.
    pub version: String,
    /// What it says about its build: commit, compile flags.
    pub build: String,
}

/// The file behind the environment.
static OPENED: OnceLock<PathBuf> = OnceLock::new();

/// Which library [`environment`] loaded; `None` before the first graph is.
pub fn loaded() -> Option<Loaded> {
    let path = OPENED.get()?;
    let version = ort::util::probe(path).map_or("unknown".to_string(), |minor| format!("1.{minor}"));
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.clone());
    Some(Loaded { path, version, build: ort::info().to_string() })
}

/// What decides where to look.
#[derive(Debug)]
struct Places {
    named: Option<PathBuf>,
    current_folder: Option<PathBuf>,
    executable_folder: Option<PathBuf>,
}

impl Places {
    fn of_this_process() -> Places {
        Places {
            named: std::env::var_os(PATH_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from),
            current_folder: std::env::current_dir().ok(),
            executable_folder: std::env::current_exe()
                .ok()
                .and_then(|path| Some(path.parent()?.to_path_buf())),
        }
    }

    /// The folders from which `vendor/onnxruntime` is looked for upwards.
    fn starts(&self) -> impl Iterator<Item = &PathBuf> {
        self.current_folder.iter().chain(&self.executable_folder)
    }

    /// The folders to look into, nearest first, each once.
    fn folders(&self) -> Vec<PathBuf> {
        let vendored =
            self.starts().flat_map(|start| start.ancestors()).map(|folder| folder.join("vendor/onnxruntime"));
        let mut folders: Vec<PathBuf> = Vec::new();
        for folder in vendored.chain(self.executable_folder.clone()) {
            if !folders.contains(&folder) {
                folders.push(folder);
            }
        }
        folders
    }
}

/// The library in a folder: under its plain name, or else the last of its versioned names.
fn library_in(folder: &Path) -> Option<PathBuf> {
    let plain = folder.join(file_name());
    if plain.is_file() {
        return Some(plain);
    }
    let versioned = format!("{}.", file_name());
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    entries
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&versioned)))
        .max()
}

/// Tries the places in order.
fn load(places: &Places) -> Result<Environment> {
    let mut tried = Vec::new();
    if let Some(path) = &places.named {
        // A relative path would be looked for beside the executable first.
        let path = std::path::absolute(path).unwrap_or_else(|_| path.clone());
        match open(&path) {
            Ok(environment) => return Ok(environment),
            Err(reason) => tried.push(format!("{PATH_VARIABLE} names {}: {reason}", path.display())),
        }
    } else {
        for folder in places.folders() {
            match library_in(&folder).map(|path| (open(&path), path)) {
                Some((Ok(environment), _)) => return Ok(environment),
                Some((Err(reason), path)) => tried.push(format!("{}: {reason}", path.display())),
                None => {}
            }
        }
        let starts: Vec<String> = places.starts().map(|folder| folder.display().to_string()).collect();
        tried.push(format!(
            "{} in vendor/onnxruntime of {} or a folder above, or beside the executable: nothing more",
            file_name(),
            starts.join(" or of ")
        ));
        match open(Path::new(&file_name())) {
            Ok(environment) => return Ok(environment),
            Err(reason) => tried.push(format!("the system's library folders: {reason}")),
        }
    }
    Err(Error::Missing {
        component: "ONNX Runtime",
        message: format!(
            "no usable library of version 1.{OLDEST_MINOR_VERSION} or newer; run `make onnxruntime`, or set \
             {PATH_VARIABLE} to its file. Looked at:\n  {}",
            tried.join("\n  ")
        ),
    })
}

/// Opens one library and starts its environment; the error is one line.
fn open(path: &Path) -> std::result::Result<Environment, String> {
    // Once `ort` has a library it keeps it, whatever file it is given; this one must be judged by itself.
    if ort::util::probe(path).is_none_or(|minor| minor < OLDEST_MINOR_VERSION) {
        return Err(ort::init_from(path).err().map_or("is no usable ONNX Runtime 1.x".to_string(), reason));
    }
    let builder = ort::init_from(path).map_err(reason)?;
    // Its failures come back as errors; printing them as well would tell everything twice.
    let silent = Arc::new(|_: ort::logging::LogLevel, _: &str, _: &str, _: &str, _: &str| {});
    let environment = builder
        .with_name("vitruvian")
        .with_telemetry(false)
        .with_logger(silent)
        .build()
        .map_err(|error| format!("does not start ({})", error.message()))?;
    OPENED.get_or_init(|| path.to_path_buf());
    Ok(environment)
}

/// Why `ort` refused a library, in one line.
fn reason(refusal: ort::LoadDynamicError) -> String {
    use ort::LoadDynamicError as Refusal;
    match refusal {
        Refusal::Dlopen { error, .. } => format!("cannot be loaded ({error})"),
        Refusal::MissingApi { .. } => "is a library, but not ONNX Runtime (no OrtGetApiBase)".to_string(),
        Refusal::InvalidVersionString => "does not tell its version".to_string(),
        Refusal::BadVersion { version_str, .. } => {
            format!("is version {version_str}, at least 1.{OLDEST_MINOR_VERSION} is needed")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(path: &Path) -> Places {
        Places { named: Some(path.to_path_buf()), current_folder: None, executable_folder: None }
    }

    fn message(places: &Places) -> String {
        match load(places) {
            Err(Error::Missing { component: "ONNX Runtime", message }) => message,
            other => panic!("expected a missing component, got {other:?}"),
        }
    }

    #[test]
    fn a_named_library_that_does_not_exist_is_missing_and_nothing_else_is_tried() {
        let message = message(&named(Path::new("/nowhere/libonnxruntime.so")));
        assert!(message.contains("ORT_DYLIB_PATH names /nowhere/libonnxruntime.so"), "{message}");
        assert!(message.contains("make onnxruntime"), "{message}");
        assert!(!message.contains("system's"), "{message}");
    }

    #[test]
    fn a_file_that_is_no_library_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join(file_name());
        std::fs::write(&path, b"not a library").expect("a writable folder");
        // Which of the two words is used depends on whether another test has loaded a library before.
        let message = message(&named(&path));
        let refused =
            ["cannot be loaded", "is no usable ONNX Runtime"].iter().any(|words| message.contains(words));
        assert!(refused, "{message}");
    }

    #[test]
    fn an_old_library_is_refused_with_its_version() {
        let refusal = ort::LoadDynamicError::BadVersion {
            version_str: "1.22.1".to_string(),
            path: PathBuf::from("old.so"),
        };
        assert_eq!(reason(refusal), "is version 1.22.1, at least 1.23 is needed");
    }

    #[test]
    fn vendored_folders_are_searched_upwards_before_the_executables_own() {
        let places = Places {
            named: None,
            current_folder: Some(PathBuf::from("/a/b")),
            executable_folder: Some(PathBuf::from("/a/target")),
        };
        let found: Vec<String> = places.folders().iter().map(|path| path.display().to_string()).collect();
        assert_eq!(
            found,
            [
                "/a/b/vendor/onnxruntime",
                "/a/vendor/onnxruntime",
                "/vendor/onnxruntime",
                "/a/target/vendor/onnxruntime",
                "/a/target",
            ]
        );
    }

    #[test]
    fn a_versioned_name_serves_when_the_plain_one_is_absent() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(library_in(folder.path()), None);
        let versioned = folder.path().join(format!("{}.1", file_name()));
        std::fs::write(&versioned, b"").expect("a writable folder");
        assert_eq!(library_in(folder.path()), Some(versioned));
    }

    #[test]
    fn the_library_of_make_onnxruntime_is_found_from_here() {
        // Fails with the list of places and the command to run when it has not been brought.
        environment().unwrap_or_else(|error| panic!("{error}"));
        let loaded = loaded().expect("the environment has a library");
        let minor: u32 =
            loaded.version.strip_prefix("1.").and_then(|m| m.parse().ok()).expect("a version 1.x");
        assert!(minor >= OLDEST_MINOR_VERSION && loaded.path.is_file(), "{loaded:?}");
    }
}

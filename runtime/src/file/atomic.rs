//! Files that appear whole or not at all: written beside their place, then renamed into it.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, Result};

static COUNTER: AtomicU64 = AtomicU64::new(0);

/// A file under construction; removed unless it was put in its place.
struct Partial {
    path: PathBuf,
    placed: bool,
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.placed {
            // Nothing is left to do about a failure here: the error that led here is already on its way.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Writes `bytes` to `path`: afterwards the file holds them all, or is as it was before.
///
/// # Errors
/// The folder does not exist or cannot be written, or the disk is full.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |out| out.write_all(bytes))
}

/// As [`write()`], with the content produced by `fill` through a buffer.
///
/// The rename replaces an existing file in one step, so readers see the old or the new content. A power cut may
/// still lose the new content: it is not forced to disk.
///
/// # Errors
/// As [`write()`], or whatever `fill` returns.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    let name = path.file_name().ok_or_else(|| Error::file(path, "is no file name to write to"))?;
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    let mut beside = std::ffi::OsString::from(".");
    beside.push(name);
    beside.push(format!(".{}-{number}.partial", std::process::id()));
    let mut partial = Partial { path: path.with_file_name(beside), placed: false };
    let produce = || -> io::Result<()> {
        let mut out = BufWriter::with_capacity(1 << 16, File::create(&partial.path)?);
        fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?;
        fs::rename(&partial.path, path)
    };
    produce().map_err(|e| Error::io(path, e))?;
    partial.placed = true;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_content_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write(&path, b"old").unwrap();
        let failure = write_with(&path, |out| {
            out.write_all(b"half of the new")?;
            Err(io::Error::other("planted"))
        });
        assert!(failure.unwrap_err().to_string().ends_with("a.txt: planted"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_missing_folder_is_an_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let message = write(&folder.path().join("none/a.txt"), b"x").unwrap_err().to_string();
        assert!(message.contains("none/a.txt"), "{message}");
    }
}

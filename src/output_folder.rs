//! Folders of results that appear whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use vitruvian_runtime::error::Error;

use crate::failure::{Failure, Result};

/// A folder under construction beside its place; removed unless it was put there.
pub struct OutputFolder {
    target: PathBuf,
    staging: PathBuf,
    /// The uppermost folder above the target that had to be made.
    made_above: Option<PathBuf>,
    placed: bool,
}

impl OutputFolder {
    /// Refuses a target that is a file, before any work is done for it.
    pub fn check(target: &Path) -> Result<()> {
        let is_taken = target.symlink_metadata().is_ok() && !target.is_dir();
        if is_taken || target.file_name().is_none() && !target.is_dir() {
            return Err(Failure::Usage(format!(
                "{}: expected a folder to write to, or a new name",
                target.display()
            )));
        }
        Ok(())
    }

    /// Begins an empty folder beside `target`, in which the results are to be written.
    pub fn begin(target: &Path) -> Result<OutputFolder> {
        Self::check(target)?;
        // `.` and `..` have no name of their own to stand beside.
        let target = match target.file_name() {
            Some(_) => target.to_owned(),
            None => fs::canonicalize(target).map_err(|e| Error::io(target, e))?,
        };
        let above = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let made_above = above.ancestors().filter(|a| !a.as_os_str().is_empty() && !a.exists()).last();
        let made_above = made_above.map(Path::to_owned);
        fs::create_dir_all(&above).map_err(|e| Error::io(&above, e))?;
        let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let staging = above.join(format!(".{name}.{}.partial", std::process::id()));
        let folder = OutputFolder { target, staging, made_above, placed: false };
        fs::create_dir(&folder.staging).map_err(|e| Error::io(&folder.staging, e))?;
        Ok(folder)
    }

    /// Where a result is to be written until all are there.
    pub fn file(&self, name: &str) -> PathBuf {
        self.staging.join(name)
    }

    /// Puts the results in their place; other files that are there already stay, but for those named `stale`.
    pub fn place(mut self, stale: &[&str]) -> Result<()> {
        if self.target.exists() {
            merge(&self.staging, &self.target)?;
            for name in stale.iter().map(|name| self.target.join(name)).filter(|path| path.is_file()) {
                fs::remove_file(&name).map_err(|e| Error::io(&name, e))?;
            }
        } else {
            fs::rename(&self.staging, &self.target).map_err(|e| Error::io(&self.target, e))?;
        }
        self.placed = true;
        let _ = fs::remove_dir_all(&self.staging);
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if self.placed {
            return;
        }
        // Nothing is left to do about a failure here: the error that led here is already on its way.
        let _ = fs::remove_dir_all(&self.staging);
        if let Some(top) = &self.made_above {
            let mut folder = self.staging.parent();
            while let Some(empty) = folder.filter(|f| f.starts_with(top)) {
                let _ = fs::remove_dir(empty);
                folder = empty.parent();
            }
        }
    }
}

fn merge(from: &Path, to: &Path) -> Result<()> {
    for entry in fs::read_dir(from).map_err(|e| Error::io(from, e))? {
        let entry = entry.map_err(|e| Error::io(from, e))?;
        let (source, place) = (entry.path(), to.join(entry.file_name()));
        if source.is_dir() && place.is_dir() {
            merge(&source, &place)?;
        } else {
            fs::rename(&source, &place).map_err(|e| Error::io(&place, e))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_given_up_leaves_nothing_behind() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("new/deep/out");
        let folder = OutputFolder::begin(&target).unwrap();
        fs::write(folder.file("a"), "half").unwrap();
        drop(folder);
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_that_is_placed_holds_the_results_and_what_was_there() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("out");
        for content in ["first", "second"] {
            let folder = OutputFolder::begin(&target).unwrap();
            fs::write(folder.file("a"), content).unwrap();
            folder.place(&["old"]).unwrap();
            assert_eq!(fs::read_to_string(target.join("a")).unwrap(), content);
            assert!(!target.join("old").exists(), "a stale result is gone");
            fs::write(target.join("old"), "x").unwrap();
            fs::write(target.join("mine"), "x").unwrap();
        }
        assert!(target.join("mine").exists());
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1, "nothing beside it");
    }

    #[test]
    fn a_file_in_the_way_is_refused() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("out");
        fs::write(&target, "x").unwrap();
        assert!(OutputFolder::begin(&target).is_err());
        assert!(OutputFolder::check(&target.join("below")).is_ok(), "it is not there yet");
    }
}

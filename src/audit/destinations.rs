//! Where an audit's reports go: `--json`, `--junit`, `--html`.

use std::path::{Path, PathBuf};

use serde::Serialize;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::atomic;

use super::junit::Suite;
use crate::failure::{Failure, Result};
use crate::table;

/// The files that a verb writes its report to, beside the words on the terminal.
#[derive(clap::Args, Debug, Default)]
pub struct Destinations {
    /// Write the report as JSON (docs/audit.md names the schema) to this file, or to standard output for -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the report as JUnit XML to this file: a test case for each node, or output
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Write the report as one page that needs no network
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}

impl Destinations {
    /// Refuses files that cannot be written, before any work is done for them.
    pub fn check(&self) -> Result<()> {
        let files = [&self.json, &self.junit, &self.html].into_iter().flatten();
        for file in files.filter(|file| !is_standard_output(file)) {
            let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
            if file.is_dir() {
                return Err(Failure::Usage(format!("{}: is a folder; give a file's name", file.display())));
            }
            if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
                return Err(Failure::Usage(format!(
                    "{}: its folder {} does not exist; make it first",
                    file.display(),
                    folder.display()
                )));
            }
        }
        if [&self.junit, &self.html].into_iter().flatten().any(|file| is_standard_output(file)) {
            return Err(Failure::Usage("only --json can go to standard output (-)".into()));
        }
        Ok(())
    }

    /// Whether standard output belongs to the JSON, so that the words go to standard error.
    pub fn prints_json(&self) -> bool {
        self.json.as_deref().is_some_and(is_standard_output)
    }

    /// Writes what was asked for; each form is made only then.
    pub fn write(
        &self,
        report: &impl Serialize,
        junit: impl FnOnce() -> Suite,
        html: impl FnOnce() -> String,
    ) -> Result<()> {
        if let Some(file) = &self.json {
            let json = serde_json::to_string_pretty(report).map_err(|error| {
                Error::file(file, format!("the report cannot be written as JSON: {error}"))
            })?;
            match is_standard_output(file) {
                true => table::say(&json),
                false => atomic::write(file, format!("{json}\n").as_bytes())?,
            }
        }
        if let Some(file) = &self.junit {
            atomic::write(file, junit().xml().as_bytes())?;
        }
        if let Some(file) = &self.html {
            atomic::write(file, html().as_bytes())?;
        }
        Ok(())
    }

    /// Says the words where the JSON is not.
    pub fn say(&self, words: &str) {
        if self.prints_json() { eprintln!("{words}") } else { table::say(words) }
    }
}

/// Writes a report as JSON where that was asked for, and says the words where the JSON is not.
pub fn write_json(file: Option<&PathBuf>, report: &impl Serialize, words: &str) -> Result<()> {
    let Some(file) = file else {
        table::say(words);
        return Ok(());
    };
    let json = serde_json::to_string_pretty(report)
        .map_err(|error| Error::file(file, format!("the report cannot be written as JSON: {error}")))?;
    if is_standard_output(file) {
        table::say(&json);
        eprintln!("{words}");
    } else {
        atomic::write(file, format!("{json}\n").as_bytes())?;
        table::say(words);
    }
    Ok(())
}

fn is_standard_output(file: &Path) -> bool {
    file.as_os_str() == "-"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(destinations: &Destinations) -> String {
        destinations.check().expect_err("it is refused").to_string()
    }

    #[test]
    fn files_that_cannot_be_written_are_refused_before_the_work() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let place = |name: &str| Some(folder.path().join(name));
        let good = Destinations { json: Some("-".into()), junit: place("a.xml"), html: place("a.html") };
        good.check().expect("a writable folder");
        assert!(good.prints_json() && !Destinations::default().prints_json());
        let absent = Destinations { html: place("absent/a.html"), ..Default::default() };
        assert!(refused(&absent).contains("does not exist"));
        assert!(refused(&Destinations { junit: place(""), ..Default::default() }).contains("is a folder"));
        let two = Destinations { html: Some("-".into()), ..Default::default() };
        assert!(refused(&two).contains("only --json"));
    }
}

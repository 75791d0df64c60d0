//! `vitruvian audit blame`: one node's record out of a report.

use std::path::PathBuf;

use vitruvian_conformance::audit::report::{Audit, SCHEMA};
use vitruvian_runtime::error::Error;

use super::destinations::Destinations;
use super::figures::plain;
use super::{answers, junit, page, terminal};
use crate::failure::{Failure, Result};
use crate::table;

/// One node's record out of a report, and the report in its other forms
#[derive(clap::Args)]
pub struct Arguments {
    /// A report as `--json` writes it
    report: PathBuf,
    /// The node's name; the first outside rounding without it
    #[arg(long)]
    node: Option<String>,
    #[command(flatten)]
    destinations: Destinations,
}

/// Reads, writes the other forms, says the record.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { report, node, destinations } = arguments;
    destinations.check()?;
    let bytes = std::fs::read(report).map_err(|error| Error::io(report, error))?;
    let audit: Audit = serde_json::from_slice(&bytes)
        .map_err(|error| Error::file(report, format!("is not an audit's JSON: {error}")))?;
    if audit.schema != SCHEMA {
        let message = format!("has the schema {:?}; this program reads {SCHEMA:?}", audit.schema);
        return Err(Error::file(report, message).into());
    }
    let Some(name) = node.as_ref().or(audit.first_outside.as_ref().map(|first| &first.node)) else {
        return Err(Failure::Usage(format!(
            "{}: no node is outside rounding; name the one to show with --node",
            report.display()
        )));
    };
    let Some(found) = audit.nodes.iter().find(|node| &node.name == name) else {
        let message = format!("has no node {:?} among its {}", plain(name), audit.nodes.len());
        return Err(Error::file(report, message).into());
    };
    let look = terminal::Look::of_standard_output(true);
    let mut words = terminal::record(found, look);
    if let Some(first) = audit.first_outside.as_ref().filter(|first| &first.node == name) {
        words += &format!("\n  {}", answers::cause(first));
        answers::worst(first).iter().for_each(|line| words += &format!("\n  {line}"));
    }
    destinations.write(&audit, || junit::of_audit(&audit), || page::certificate(&audit))?;
    if !destinations.prints_json() {
        table::say(&words);
    }
    Ok(())
}

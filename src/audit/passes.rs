//! `vitruvian audit passes`: which of ONNX Runtime's optimisers changes an output.

use std::path::PathBuf;

use vitruvian_conformance::audit::passes::passes;
use vitruvian_conformance::audit::report::{ChangedOutput, PassesReport};
use vitruvian_conformance::onnx::model::Model;

use super::certificate::Inputs;
use super::destinations::write_json;
use super::figures::{counted, optional, plain};
use crate::failure::Result;

/// Say which of ONNX Runtime's optimisers changes an output, and by how much
///
/// Exit status: 0 it was found out, 2 bad input or usage, 3 a needed component is missing.
#[derive(clap::Args)]
pub struct Arguments {
    /// The graph (.onnx)
    graph: PathBuf,
    #[command(flatten)]
    inputs: Inputs,
    /// Threads within an operator of ONNX Runtime; 0 takes one per core
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Write the report as JSON (docs/audit.passes.schema.json) to this file, or to standard output for -
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Searches, says, writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    let model = Model::read(&arguments.graph)?;
    let (inputs, words) = arguments.inputs.given(&model)?;
    let report = passes(&model, &inputs, arguments.threads)?;
    let text = format!("{}\ninputs: {}\n\n{}", arguments.graph.display(), plain(&words), text(&report));
    write_json(arguments.json.as_ref(), &report, &text)
}

fn text(report: &PassesReport) -> String {
    let outputs = |outputs: &[ChangedOutput]| {
        let one =
            |output: &ChangedOutput| format!("{} by up to {}", plain(&output.name), optional(output.abs_max));
        outputs.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let mut lines = vec![if report.changed.is_empty() {
        "No output changes: the optimised session is bit-identical.".to_owned()
    } else {
        format!("The optimised session changes {}.", outputs(&report.changed))
    }];
    lines.extend(report.passes.iter().map(|pass| {
        let together = if pass.names.len() > 1 { " together" } else { "" };
        format!("  {}{together}: {}", pass.names.join(" + "), outputs(&pass.outputs))
    }));
    lines.extend(report.notes.iter().map(|note| format!("note: {}", plain(note))));
    lines.push(format!("found with {}", counted(report.sessions, "session")));
    lines.join("\n")
}

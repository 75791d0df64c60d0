//! `vitruvian audit plan`: which nodes to keep in f32 for a budget of millimetres.

use std::path::PathBuf;

use clap::ValueEnum;
use vitruvian_conformance::audit::variant::report::PlanReport;
use vitruvian_conformance::audit::variant::{Precision, attribution, plan};

use super::destinations::write_json;
use super::diff::{Given, check_budget, costs};
use super::figures::{counted, number, optional, plain};
use crate::failure::{Failure, Result};
use crate::progress::StageBars;

/// Say which nodes to keep in f32 so that the rest may be f16 or int8 within a budget of millimetres
///
/// Exit status: 0 a plan was found, 1 none keeps the budget, 2 bad input or usage, 3 a needed component is missing.
#[derive(clap::Args)]
pub struct Arguments {
    /// The graph
    base: PathBuf,
    /// The precision of the other nodes
    #[arg(long, value_enum)]
    to: To,
    /// Millimetres that are allowed
    #[arg(long, value_name = "MM")]
    budget_mm: f64,
    #[command(flatten)]
    given: Given,
    /// Write the mixed graph, which simulates the precision by rounding in f32, to this file
    #[arg(long, value_name = "ONNX")]
    write: Option<PathBuf>,
    /// Write the nodes to keep to this file, one name a line: node_block_list, nodes_to_exclude
    #[arg(long, value_name = "FILE")]
    list: Option<PathBuf>,
    /// Write the report as JSON (docs/audit.plan.schema.json) to this file, or to standard output for -
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The precision of the other nodes.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum To {
    /// IEEE half precision
    F16,
    /// 8-bit integers
    Int8,
}

/// Plans, says, writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    check_budget(arguments.budget_mm)?;
    let to = match arguments.to {
        To::F16 => Precision::F16,
        To::Int8 => Precision::Int8,
    };
    let mut bars = StageBars::about("audit plan");
    let shown = &mut |done: usize, all: usize, what: &str| bars.show(&plain(what), done as u64, all as u64);
    let options = arguments.given.options();
    let report = plan(&arguments.base, to, arguments.budget_mm, &options, arguments.write.as_deref(), shown);
    bars.clear();
    let report = report?;
    if let Some(file) = &arguments.list {
        let lines: String = report.keep.iter().map(|name| format!("{name}\n")).collect();
        vitruvian_runtime::file::atomic::write(file, lines.as_bytes())?;
    }
    write_json(arguments.json.as_ref(), &report, &text(&report))?;
    if report.pass {
        return Ok(());
    }
    Err(Failure::Negative(format!(
        "{}: no plan keeps {} mm in {}: with all {} in f32 it is {} mm off",
        arguments.base.display(),
        report.budget_mm,
        report.to,
        counted(report.keep.len(), "node"),
        report.planned.map_or("more than any number of".to_owned(), number),
    )))
}

fn text(report: &PlanReport) -> String {
    let mut lines = vec![
        format!("{} in {}: {}", plain(&report.base.path), report.to, report.simulation),
        format!("inputs: {}", plain(&report.inputs)),
        String::new(),
        costs(&report.attribution),
        String::new(),
        format!(
            "all {} in {}: {} mm ({}); {} kept in f32: {} mm of {} mm, by {}",
            counted(report.candidates, "node"),
            report.to,
            optional(report.all_lowered),
            attribution::word(report.statistic),
            counted(report.keep.len(), "node"),
            optional(report.planned),
            report.budget_mm,
            counted(report.trials.len(), "run"),
        ),
    ];
    lines.extend(report.keep.iter().map(|name| format!("  {}", plain(name))));
    lines.extend(report.graph.iter().map(|path| format!("mixed graph: {}", plain(path))));
    lines.extend(report.notes.iter().map(|note| format!("note: {}", plain(note))));
    lines.join("\n")
}

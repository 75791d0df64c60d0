//! `vitruvian audit diff`: two graphs that should be the same, in millimetres.

use std::path::PathBuf;

use clap::ValueEnum;
use serde_json::json;
use vitruvian_conformance::audit::variant::report::{
    Attribution, BodyReport, Cost, DiffReport, FieldReport, Geometry, NumbersReport, Statistic, Summary,
    TopologyReport,
};
use vitruvian_conformance::audit::variant::{Options, attribution, diff};

use super::destinations::Destinations;
use super::figures::{ending, list, number, optional, plain};
use super::junit::{Case, Outcome, Suite};
use super::page::page;
use crate::failure::{Failure, Result};
use crate::progress::StageBars;
use crate::table;

/// Rows of the table of costs on the terminal.
const ROWS: usize = 20;

/// Characters of a cell there.
const WIDTH: usize = 44;

/// Compare two graphs that should be the same, in millimetres of the body or the surface
///
/// Exit status: 0 done and within the budget, 1 beyond it, 2 bad input or usage, 3 a needed component is missing.
#[derive(clap::Args)]
pub struct Arguments {
    /// The graph that is right; or a dump of its outputs (.npz)
    base: PathBuf,
    /// The f16, int8, optimised or re-exported graph; or a dump of its outputs (.npz)
    variant: PathBuf,
    #[command(flatten)]
    given: Given,
    /// Millimetres that are allowed; more is exit status 1
    #[arg(long, value_name = "MM")]
    budget_mm: Option<f64>,
    /// Do not say which nodes cost the difference
    #[arg(long)]
    no_attribution: bool,
    /// Take the reference's f64 chain for the truth instead of the base by ONNX Runtime
    #[arg(long)]
    reference: bool,
    #[command(flatten)]
    destinations: Destinations,
}

/// What `diff` and `plan` are given beside the graphs.
#[derive(clap::Args)]
pub struct Given {
    /// Inputs to run instead of drawn ones: an npz with an array for each input of the base
    #[arg(long, value_name = "NPZ")]
    inputs: Option<PathBuf>,
    /// How many inputs to draw
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=1000))]
    draws: u64,
    /// Seed of the first
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The body that a regressor's parameters pose [default: the mannequin]
    #[arg(long, value_name = "NPZ")]
    body: Option<PathBuf>,
    /// The query graph that makes a surface of an encoder's features
    #[arg(long, value_name = "ONNX")]
    query: Option<PathBuf>,
    /// The encoder that makes a query's features
    #[arg(long, value_name = "ONNX")]
    encoder: Option<PathBuf>,
    /// Lattice points along each side of the cube in which a surface is looked for [default: 64; 40 for queries]
    #[arg(long, value_parser = clap::value_parser!(u64).range(4..=512))]
    lattice: Option<u64>,
    /// Voxels along each side, where the graph leaves them free
    #[arg(long, value_parser = clap::value_parser!(u64).range(8..=512))]
    voxels: Option<u64>,
    /// The value at the surface of an output that is a volume, larger inside
    #[arg(long)]
    level: Option<f64>,
    /// Which number of the distances counts
    #[arg(long, value_enum, default_value_t = Which::Max)]
    statistic: Which,
}

/// Which number of many distances counts.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Which {
    /// Their mean
    Mean,
    /// The one that a hundredth of them exceeds
    P99,
    /// The largest
    Max,
}

impl Given {
    /// As the judge takes them.
    pub fn options(&self) -> Options {
        Options {
            draws: self.draws as usize,
            seed: self.seed,
            inputs: self.inputs.clone(),
            body: self.body.clone(),
            query: self.query.clone(),
            encoder: self.encoder.clone(),
            lattice: self.lattice.map(|n| n as usize),
            voxels: self.voxels.map(|n| n as usize),
            level: self.level,
            statistic: match self.statistic {
                Which::Mean => Statistic::Mean,
                Which::P99 => Statistic::P99,
                Which::Max => Statistic::Max,
            },
            ..Options::default()
        }
    }
}

/// A budget is a length.
pub fn check_budget(budget_mm: f64) -> Result<()> {
    if budget_mm.is_finite() && budget_mm >= 0.0 {
        Ok(())
    } else {
        Err(Failure::Usage(format!(
            "--budget-mm is {budget_mm}, a number of millimetres from 0 was expected"
        )))
    }
}

/// Compares, says, writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(budget) = arguments.budget_mm {
        check_budget(budget)?;
    }
    arguments.destinations.check()?;
    let options = Options {
        budget_mm: arguments.budget_mm,
        attribute: !arguments.no_attribution,
        reference: arguments.reference,
        ..arguments.given.options()
    };
    let mut bars = StageBars::about("audit diff");
    let shown = &mut |done: usize, all: usize, what: &str| bars.show(&plain(what), done as u64, all as u64);
    let report = diff(&arguments.base, &arguments.variant, &options, shown);
    bars.clear();
    let report = report?;
    arguments.destinations.write(&report, || suite(&report), || html(&report))?;
    arguments.destinations.say(&text(&report));
    if report.budget_mm.is_some() && report.pass.is_none() {
        let message = "the outputs have no geometry that is known, so the budget says nothing";
        return Err(Failure::Usage(format!("{}: {message}", arguments.base.display())));
    }
    match (report.pass, report.budget_mm) {
        (Some(false), Some(budget)) => Err(Failure::Negative(format!(
            "{} is {} mm off, {budget} mm are allowed",
            arguments.variant.display(),
            report.millimetres.map_or("more than any number of".to_owned(), number),
        ))),
        _ => Ok(()),
    }
}

/// The whole report in words.
fn text(report: &DiffReport) -> String {
    let mut lines = vec![
        format!("{} against {}", plain(&report.variant.path), plain(&report.base.path)),
        format!("inputs: {}", plain(&report.inputs)),
        String::new(),
    ];
    lines.extend(measured(report));
    if let Some(attribution) = &report.attribution {
        lines.push(String::new());
        lines.push(costs(attribution));
    }
    lines.extend(report.notes.iter().map(|note| format!("note: {}", plain(note))));
    lines.join("\n")
}

/// How far apart the two are, line by line.
fn measured(report: &DiffReport) -> Vec<String> {
    let mut lines = match &report.geometry {
        Geometry::Body(body) => of_body(body),
        Geometry::Field(field) => of_field(field),
        Geometry::Numbers => Vec::new(),
    };
    lines.extend(report.outputs.iter().map(of_numbers));
    if let Some(pass) = report.pass {
        lines.push(format!(
            "budget: {} mm ({}) of {}: {}",
            report.millimetres.map_or("∞".to_owned(), number),
            attribution::word(report.statistic),
            report.budget_mm.map_or(String::new(), |mm| format!("{mm} mm")),
            if pass { "kept" } else { "exceeded" },
        ));
    }
    lines
}

/// The report's test cases: the budget, and each output's numbers.
fn suite(report: &DiffReport) -> Suite {
    let case = |class: &str, name: &str, outcome| Case {
        class: class.to_owned(),
        name: name.to_owned(),
        seconds: 0.0,
        outcome,
    };
    let failed = |kind: &str, message: String| Outcome::Failed {
        kind: kind.to_owned(),
        message,
        details: measured(report).join("\n"),
    };
    let budget = match (report.pass, report.budget_mm) {
        (Some(true), _) => Outcome::Passed,
        (Some(false), Some(budget)) => {
            let found = report.millimetres.map_or("more than any number of".to_owned(), number);
            failed("budget", format!("{found} mm, {budget} mm are allowed"))
        }
        _ => {
            Outcome::Skipped("no budget was given, or the outputs have no geometry that is known".to_owned())
        }
    };
    let finite = |output: &NumbersReport| {
        let (base, variant) = (output.not_finite_base, output.not_finite_variant);
        let outcome = if base == variant {
            Outcome::Passed
        } else {
            failed("not finite", format!("{variant} numbers are not finite, in the base {base}"))
        };
        case("output", &output.name, outcome)
    };
    let budget = case("geometry", "millimetres", budget);
    Suite {
        verb: "audit diff",
        name: report.variant.path.clone(),
        properties: vec![
            ("schema", report.schema.clone()),
            ("base", report.base.path.clone()),
            ("base.sha256", report.base.sha256.clone()),
            ("variant.sha256", report.variant.sha256.clone()),
            ("millimetres", report.millimetres.map_or(String::new(), |mm| mm.to_string())),
            ("inputs", report.inputs.clone()),
        ],
        cases: std::iter::once(budget).chain(report.outputs.iter().map(finite)).collect(),
        seconds: report.seconds,
    }
}

/// The report as a page.
fn html(report: &DiffReport) -> String {
    let title = format!("{} against {}", plain(&report.variant.path), plain(&report.base.path));
    let rows = report.attribution.iter().flat_map(|attribution| &attribution.costs).map(cells);
    let table = json!({ "title": "What the nodes cost", "head": COSTS, "rows": rows.collect::<Vec<_>>() });
    // A graph with a camera answers in the camera's axes.
    let is_seen = matches!(&report.geometry, Geometry::Body(body) if body.reprojection_px.is_some());
    let surfaces = report.view.iter().map(|view| {
        json!({ "title": view.title, "y_down": is_seen, "vertices": view.vertices, "faces": view.faces, "millimetres": view.millimetres })
    });
    let mut sentences = measured(report);
    sentences.extend(report.notes.iter().map(|note| format!("Note: {}", plain(note))));
    let data = json!({
        "title": title,
        "facts": [["inputs", plain(&report.inputs)], ["truth", report.truth], ["took", format!("{} s", number(report.seconds))]],
        "answers": [{ "question": "How far apart are the two?", "sentences": sentences }],
        "surfaces": surfaces.collect::<Vec<_>>(),
        "tables": [table],
    });
    page(&title, &data)
}

fn of_body(body: &BodyReport) -> Vec<String> {
    let mut lines = vec![format!(
        "{}, {}: MPJPE {} mm, PA-MPJPE {} mm",
        if body.bodies == 1 { "1 body".to_owned() } else { format!("{} bodies", body.bodies) },
        plain(&body.body),
        optional(body.mpjpe),
        optional(body.pa_mpjpe)
    )];
    if let (Some(vertices), Some(worst)) = (&body.vertices, &body.worst_vertex) {
        let joint = worst.joint.as_ref().map_or(String::new(), |joint| format!(" at the {joint}"));
        lines.push(format!(
            "  vertices  {}; worst: vertex {}{joint} of body {}",
            of_summary(vertices, "mm"),
            worst.vertex,
            worst.body
        ));
    }
    if let (Some(joints), Some(worst)) = (&body.joints, &body.worst_joint) {
        lines.push(format!("  joints    {}; worst: {}", of_summary(joints, "mm"), plain(&worst.joint)));
    }
    if body.joints.is_none() {
        lines.push("  the variant's bodies are not finite".to_owned());
    }
    if let Some(pixels) = &body.reprojection_px {
        lines.push(format!("  picture   {}", of_summary(pixels, "px")));
    }
    if let Some(camera) = &body.camera {
        lines.push(format!("  camera    {}", of_summary(camera, "mm")));
    }
    lines
}

fn of_field(field: &FieldReport) -> Vec<String> {
    let mut lines = vec![format!("surface at {} on {}", number(field.level), plain(&field.lattice))];
    if let Some(displacement) = &field.displacement {
        lines.push(format!("  |Δf|/‖∇f‖  {}", of_summary(displacement, "mm")));
    }
    lines.push(format!(
        "  distance   {}",
        field.distance.map_or("none: a surface vanished".to_owned(), |d| of_summary(&d, "mm"))
    ));
    lines.push(format!(
        "  Hausdorff {} mm, Chamfer {} mm; {} of {} points change sides{}",
        optional(field.hausdorff),
        optional(field.chamfer),
        field.flipped,
        field.points,
        field
            .flipped_margin
            .map_or(String::new(), |margin| format!(", up to {} from the level", number(margin))),
    ));
    let words = |all: &[TopologyReport]| -> String {
        let each = all.iter().map(|t| format!("{}, {}, {}", t.components, t.betti_1, t.betti_2));
        each.collect::<Vec<_>>().join("; ")
    };
    lines.push(match field.same_topology {
        true => format!("  topology   the same: Betti numbers {}", words(&field.base_topology)),
        false => format!(
            "  topology   differs: Betti numbers {} became {}",
            words(&field.base_topology),
            words(&field.variant_topology)
        ),
    });
    if field.not_finite > 0 {
        lines.push(format!("  {} points are not finite and were taken as outside", field.not_finite));
    }
    lines
}

fn of_numbers(output: &NumbersReport) -> String {
    let lost = match output.not_finite_variant {
        0 => String::new(),
        n => format!("; {n} not finite"),
    };
    format!(
        "output {} {}: largest difference {} at {}, relative {} (root mean square), {} bits in common{lost}",
        plain(&output.name),
        list(&output.shape),
        optional(output.abs_max),
        list(&output.worst),
        optional(output.rel_rms),
        output.effective_bits.map_or("all".to_owned(), number),
    )
}

fn of_summary(summary: &Summary, unit: &str) -> String {
    format!("mean {}, p99 {}, max {} {unit}", number(summary.mean), number(summary.p99), number(summary.max))
}

/// The columns of the table of costs.
const COSTS: [&str; 5] = ["node", "operators", "alone", "share", "its own error"];

/// One row of it.
fn cells(cost: &Cost) -> Vec<String> {
    vec![
        plain(&cost.name),
        plain(&cost.operators),
        optional(cost.alone),
        format!("{:.1} %", 100.0 * cost.share),
        optional(cost.local),
    ]
}

/// The table of costs.
pub fn costs(attribution: &Attribution) -> String {
    if attribution.costs.is_empty() {
        return "no place computes anything else".to_owned();
    }
    let rows: Vec<Vec<String>> = attribution
        .costs
        .iter()
        .take(ROWS)
        .map(|cost| cells(cost).into_iter().map(|cell| ending(&cell, WIDTH)).collect())
        .collect();
    let left = attribution.costs.len().saturating_sub(ROWS);
    let rest = if left > 0 { format!("\n… and {left} more in the JSON") } else { String::new() };
    format!(
        "{}\n{}{rest}\nall alone sum to {}, the whole is {} {}; shares sum to {:.1} %",
        plain(&attribution.method),
        table::aligned(&COSTS, &rows),
        number(attribution.sum),
        optional(attribution.whole),
        plain(&attribution.unit),
        100.0 * attribution.explained,
    )
}

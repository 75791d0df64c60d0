//! Judges every operator on many random problems and prints one line per operator.
//!
//! ```text
//! cargo run --release -p vitruvian-conformance --example sweep -- --cases 10000 --seed 7
//! ```
//!
//! `--cases` is the total, shared evenly by the operators. The table goes to standard output; the exit status is 1 when
//! runtime and reference disagree.

use std::process::ExitCode;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use vitruvian_conformance::suite::operators::{Draw, JUDGES};

/// Judges every operator on many random problems.
#[derive(Parser)]
struct Arguments {
    /// Random problems in all, each run with ONNX Runtime's optimisation off and on.
    #[arg(long, default_value_t = 10_000)]
    cases: u32,
    /// Where the random numbers start.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let draw = Draw { cases: arguments.cases.div_ceil(JUDGES.len() as u32), seed: arguments.seed };
    let style = ProgressStyle::with_template("{pos}/{len} operators {wide_bar} {msg}");
    let progress = ProgressBar::new(JUDGES.len() as u64);
    if let Ok(style) = style {
        progress.set_style(style);
    }
    println!(
        "| operator | cases | elements | exact tensors | unusual tensors | largest csu | share of the bound |"
    );
    println!("|---|---|---|---|---|---|---|");
    let (mut cases, mut disagreements) = (0, 0);
    for judge in JUDGES {
        progress.set_message(judge.name);
        match judge.run(draw) {
            Ok(tally) => {
                cases += tally.cases;
                println!(
                    "| {} | {} | {} | {} | {} | {:.2} | {:.3} |",
                    judge.name,
                    tally.cases,
                    tally.elements,
                    tally.exact,
                    tally.unusual,
                    tally.csu,
                    tally.share
                );
            }
            Err(disagreement) => {
                disagreements += 1;
                println!("| {} | disagreement |", judge.name);
                progress.suspend(|| eprintln!("{disagreement}"));
            }
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    eprintln!("{cases} cases with seed {}, {disagreements} operators disagree", draw.seed);
    ExitCode::from(u8::from(disagreements > 0))
}

//! `vitruvian`: bodies from images, and the proof that the numbers agree.
//!
//! Composes the crates and owns no mathematics: one file per subcommand, `synthesis/` for the captures that it makes.
//! A library so that `examples/` and `benches/` meet the same bodies and scenes as the command; what it promises to others
//! are the crates below it.

pub mod audit;
pub mod body;
mod captures;
pub mod chart;
mod dataset;
mod demo;
mod evaluate;
pub mod failure;
mod fit;
mod mesh;
mod mesh_format;
mod output_folder;
mod pose;
pub mod progress;
mod reconstruct;
mod regress;
pub mod synthesis;
mod synthesize;
pub mod table;
mod voxelize;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// 3-D human bodies from images: reconstruct, measure, synthesise.
///
/// Results go to files; progress and words to standard error; tables and --json to standard output.
/// Exit status: 0 done, 1 the verdict is negative, 2 bad input or usage, 3 a needed component is missing; of audits also 4 and 5.
#[derive(Parser)]
#[command(version, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Audit(audit::Arguments),
    Fit(fit::Arguments),
    Reconstruct(reconstruct::Arguments),
    Regress(regress::Arguments),
    Pose(pose::Arguments),
    Mesh(mesh::Arguments),
    Voxelize(voxelize::Arguments),
    Evaluate(evaluate::Arguments),
    Synthesize(synthesize::Arguments),
    Dataset(dataset::Arguments),
}

/// The command: reads the arguments of the process, does what they say, and gives the exit status.
pub fn run() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Audit(arguments) => audit::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Reconstruct(arguments) => reconstruct::run(&arguments),
        Command::Regress(arguments) => regress::run(&arguments),
        Command::Pose(arguments) => pose::run(&arguments),
        Command::Mesh(arguments) => mesh::run(&arguments),
        Command::Voxelize(arguments) => voxelize::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Synthesize(arguments) => synthesize::run(&arguments),
        Command::Dataset(arguments) => dataset::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.exit_status())
        }
    }
}

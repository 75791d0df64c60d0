//! `vitruvian audit`: whether an exported graph's numbers can be rounding, where they stop being it, and why.

pub mod answers;
mod blame;
mod certificate;
pub mod destinations;
mod diff;
pub mod figures;
pub mod junit;
pub mod page;
mod passes;
mod plan;
#[cfg(test)]
mod samples;
pub mod schema;
pub mod terminal;

use clap::Subcommand;

use crate::failure::Result;

/// Certify an exported graph: every node judged by what rounding can do
///
/// Exit status: 0 ordinary rounding (G0, G1), 1 unusual (G2), 2 bad input or usage, 3 a needed component is missing, 4 more than any
/// rounding can make (G3), 5 not wholly comparable.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Arguments {
    #[command(subcommand)]
    verb: Option<Verb>,
    #[command(flatten)]
    certificate: certificate::Arguments,
}

#[derive(Subcommand)]
enum Verb {
    Blame(blame::Arguments),
    Diff(Box<diff::Arguments>),
    Passes(passes::Arguments),
    Plan(Box<plan::Arguments>),
}

/// Does what the verb says; without one, certifies a graph.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.verb {
        Some(Verb::Blame(arguments)) => blame::run(arguments),
        Some(Verb::Diff(arguments)) => diff::run(arguments),
        Some(Verb::Passes(arguments)) => passes::run(arguments),
        Some(Verb::Plan(arguments)) => plan::run(arguments),
        None => certificate::run(&arguments.certificate),
    }
}

//! Runs the official ONNX backend tests and writes the table: see `make node-tests`.

use std::path::PathBuf;

use clap::Parser;
use vitruvian_conformance::node_tests::engine::{Engine, OnnxRuntime};
use vitruvian_conformance::node_tests::{audits::audits, row, table};

/// The official ONNX backend tests on the reference and on the engines.
#[derive(Parser)]
struct Arguments {
    /// The folder that conformance/node_tests/generate.py wrote.
    #[arg(default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/node_tests/generated"))]
    folder: PathBuf,
    /// Where the table goes; without it, it is printed.
    #[arg(short, long)]
    output: Option<PathBuf>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse();
    let version = std::fs::read_to_string(arguments.folder.join("VERSION"))
        .map_err(|why| format!("{}: {why}; run `make node-tests`", arguments.folder.display()))?;
    let mut engines: Vec<Box<dyn Engine>> = vec![Box::new(OnnxRuntime)];
    #[cfg(feature = "tract")]
    engines.push(Box::new(vitruvian_conformance::node_tests::tract::Tract));
    let names: Vec<&str> = engines.iter().map(|engine| engine.name()).collect();
    let bar = indicatif::ProgressBar::new(0);
    let rows = row::run(&arguments.folder, &mut engines, |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let text = table::markdown(&version, &names, &rows, &audits(&arguments.folder)?);
    match arguments.output {
        Some(path) => std::fs::write(&path, text).map_err(|why| format!("{}: {why}", path.display()))?,
        None => print!("{text}"),
    }
    Ok(())
}

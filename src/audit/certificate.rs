//! `vitruvian audit GRAPH`: the certificate of a whole graph.

use std::collections::BTreeMap;
use std::path::PathBuf;

use vitruvian_conformance::audit::report::{Audit, Grade};
use vitruvian_conformance::audit::{self, Dump, OnnxRuntime, Party, inputs};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::onnx::typed_tensor::TypedTensor;

use super::destinations::Destinations;
use super::figures::plain;
use super::{junit, page, terminal};
use crate::failure::{Failure, Result};
use crate::progress::StageBars;

/// What `audit` does without a verb.
#[derive(clap::Args)]
pub struct Arguments {
    /// The graph (.onnx)
    // Not a plain path: a verb takes its place.
    #[arg(required = true)]
    graph: Option<PathBuf>,
    #[command(flatten)]
    inputs: Inputs,
    /// Who computes the numbers that are judged: ort (ONNX Runtime, optimisation off), or npz:DUMP.npz, tensors that anything else
    /// computed, under their ONNX names
    #[arg(long, value_name = "ort|npz:DUMP.npz", default_value = "ort", value_parser = second_party)]
    runtime: SecondParty,
    /// Write the first node outside rounding by itself into this folder, in ONNX's test layout
    #[arg(long, value_name = "DIR")]
    reproduction: Option<PathBuf>,
    /// Compare every element, however long it takes; without it large nodes are judged by a stated sample
    #[arg(long)]
    every_element: bool,
    /// Threads within an operator of ONNX Runtime; 0 takes one per core
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Show every node in the table, not the worst alone
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    destinations: Destinations,
}

/// What a graph is given to compute with.
#[derive(clap::Args)]
pub struct Inputs {
    /// An .npz with an array for each input, under the inputs' names; drawn from the seed without it
    #[arg(long = "inputs", value_name = "X.npz")]
    file: Option<PathBuf>,
    /// Length of a dimension that the graph leaves open, such as N=4
    #[arg(long = "dim", value_name = "NAME=LENGTH", value_parser = dimension)]
    dimensions: Vec<(String, usize)>,
    /// Where drawn inputs begin
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl Inputs {
    /// The inputs and where they came from.
    ///
    /// # Errors
    /// When the file cannot be read or does not fit the graph, or a length is open that no `--dim` gives.
    pub fn given(&self, model: &Model) -> Result<(BTreeMap<String, TypedTensor>, String)> {
        if let Some(file) = &self.file {
            return Ok((Dump::open(file, model)?.inputs(model)?, format!("from {}", file.display())));
        }
        let dimensions = self.dimensions.iter().cloned().collect();
        Ok(inputs::draw(model, self.seed, &dimensions)?)
    }
}

/// Who computes the numbers that are judged.
#[derive(Clone, Debug, PartialEq)]
enum SecondParty {
    OnnxRuntime,
    Dump(PathBuf),
}

fn second_party(text: &str) -> std::result::Result<SecondParty, String> {
    match text.split_once(':') {
        None if text == "ort" => Ok(SecondParty::OnnxRuntime),
        Some(("npz", path)) if !path.is_empty() => Ok(SecondParty::Dump(path.into())),
        _ => Err("expected ort, or npz:FILE".into()),
    }
}

fn dimension(text: &str) -> std::result::Result<(String, usize), String> {
    let (name, length) = text.split_once('=').ok_or("expected NAME=LENGTH, such as N=4")?;
    let length = length.parse().map_err(|_| format!("{length:?} is no length: expected a whole number"))?;
    Ok((name.to_owned(), length))
}

/// Audits, writes and says what was found.
pub fn run(arguments: &Arguments) -> Result<()> {
    let destinations = &arguments.destinations;
    destinations.check()?;
    let path = arguments.graph.as_deref().expect("clap asks for the graph where there is no verb");
    let model = Model::read(path)?;
    let mut dump = match &arguments.runtime {
        SecondParty::Dump(file) => Some(Dump::open(file, &model)?),
        SecondParty::OnnxRuntime => None,
    };
    let (inputs, words) = given(arguments, &model, dump.as_mut())?;
    let mut options =
        audit::Options { inputs: words, reproductions: arguments.reproduction.clone(), ..Default::default() };
    if arguments.every_element {
        (options.effort, options.chain) = (f64::MAX, f64::MAX);
    }
    let mut runtime = OnnxRuntime { threads: arguments.threads, ..Default::default() };
    let party: &mut dyn Party = match &mut dump {
        Some(dump) => dump,
        None => &mut runtime,
    };
    let mut bars = StageBars::about("");
    let audit = audit::audit(&model, &inputs, party, &options, &mut |done, all, _| {
        bars.show("audit", done as u64, all as u64);
    })?;
    bars.clear();
    destinations.write(&audit, || junit::of_audit(&audit), || page::certificate(&audit))?;
    destinations.say(&terminal::text(&audit, terminal::Look::of_standard_output(arguments.all)));
    eprintln!("\n{}", terminal::next(&audit, destinations));
    verdict(&audit)
}

/// The inputs and where they came from: where no file gives them, those of the dump.
fn given(
    arguments: &Arguments,
    model: &Model,
    dump: Option<&mut Dump>,
) -> Result<(BTreeMap<String, TypedTensor>, String)> {
    match (dump, &arguments.runtime) {
        (Some(dump), SecondParty::Dump(file)) if arguments.inputs.file.is_none() => {
            Ok((dump.inputs(model)?, format!("from {}", file.display())))
        }
        _ => arguments.inputs.given(model),
    }
}

/// Success, or the failure whose exit status is the verdict's.
fn verdict(audit: &Audit) -> Result<()> {
    let at = |what: &str| match &audit.first_outside {
        Some(first) => format!("{what}: {} ({})", plain(&first.node), plain(&first.op)),
        None => what.to_owned(),
    };
    let words = match audit.verdict {
        Grade::G0 | Grade::G1 => return Ok(()),
        Grade::G2 => at("G2, unusual rounding"),
        Grade::G3 => at("G3, not rounding"),
        Grade::NotComparable => {
            let coverage = &audit.coverage;
            format!("not comparable: {} of {} nodes compared", coverage.compared, coverage.nodes)
        }
    };
    Err(Failure::Audit { grade: audit.verdict, words: format!("{}: {words}", plain(&audit.graph.path)) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parties_and_dimensions_are_read_or_refused() {
        assert_eq!(second_party("ort"), Ok(SecondParty::OnnxRuntime));
        assert_eq!(second_party("npz:a:b.npz"), Ok(SecondParty::Dump("a:b.npz".into())));
        assert!(second_party("npz:").is_err() && second_party("dump.npz").is_err());
        assert_eq!(dimension("N=4"), Ok(("N".into(), 4)));
        assert!(dimension("N").is_err() && dimension("N=-1").is_err() && dimension("N=four").is_err());
    }
}

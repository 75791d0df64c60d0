//! Which nodes to keep in f32 so that the rest may be f16 or int8 within a budget of millimetres.
//!
//! All nodes are lowered and the difference is attributed. The dearest are then kept: as few of the list, from its top, as
//! bring the mixed graph within the budget when it is *run* — attribution is first order, only the run counts — found by
//! bisection. At last every kept row is tried without, cheapest first.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;

use vitruvian_runtime::file::atomic;

use super::flow::{Flow, fault};
use super::geometry::{Outputs, Ruler};
use super::lowering::{self, Precision, Ranges};
use super::report::{PLAN_SCHEMA, PlanReport, Trial};
use super::runner::Arrays;
use super::setup::Setup;
use super::{Options, as_outputs, attributed, read, side_of};
use crate::error::Result;

/// Kept rows that are tried without, at most.
const DROPPED: usize = 12;

/// Plans which nodes of a graph to keep in f32; writes the mixed graph if told where to.
///
/// # Errors
/// When the graph cannot be read or run, has no geometry that is known, or the graph cannot be written.
pub fn plan(
    base: &Path,
    to: Precision,
    budget_mm: f64,
    options: &Options,
    write: Option<&Path>,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<PlanReport> {
    let started = Instant::now();
    let bytes = read(base)?;
    let flow = Flow::of_file(base, &bytes)?;
    let mut setup = Setup::new(base, &flow, options)?;
    let draws = setup.draws.clone();
    progress(0, 3, "recording");
    let recorded: Vec<Arrays> = draws.iter().map(|inputs| flow.record(inputs)).collect::<Result<_>>()?;
    let ranges = lowering::ranges(&with_inputs(&recorded, &draws));
    drop(recorded);
    let base_outputs = finished(&flow, &draws, &mut setup)?;
    if let (Some(level), Some(outputs)) = (options.level, base_outputs.first()) {
        setup.take_volume(outputs, level).map_err(|message| fault(&flow.name, message))?;
    }
    let ruler = setup.meaning.ruler(&base_outputs).map_err(|message| fault(&flow.name, message))?;

    let mut trial = Trials { flow: &flow, to, ranges: &ranges, options, ruler: &*ruler, trials: Vec::new() };
    let all = trial.lowered(&BTreeSet::new())?;
    let all_lowered = trial.measure(&all, &draws, &mut setup, 0)?;
    if matches!(setup.meaning, super::meaning::Meaning::Numbers) {
        let message = "its outputs have no geometry that is known, so millimetres cannot be planned for";
        return Err(fault(&flow.name, message.into()));
    }
    progress(1, 3, "attributing");
    let same: Vec<(String, String)> = flow.outputs.iter().map(|name| (name.clone(), name.clone())).collect();
    let inputs: Vec<(String, String)> = flow.inputs.iter().map(|name| (name.clone(), name.clone())).collect();
    let attribution =
        attributed((&flow, &all), &mut setup, &draws, (&inputs, &same), options.statistic, progress)?;

    progress(2, 3, "verifying");
    // Places of the nodes of each row that could be lowered, the dearest row first.
    let candidates: BTreeSet<usize> = to.candidates(&flow).into_iter().collect();
    let place_of = |name: &String| (0..flow.nodes().len()).find(|&place| flow.node_name(place) == *name);
    let rows: Vec<BTreeSet<usize>> = attribution
        .costs
        .iter()
        .map(|cost| cost.base_nodes.iter().filter_map(place_of).filter(|p| candidates.contains(p)).collect())
        .filter(|row: &BTreeSet<usize>| !row.is_empty())
        .collect();
    let within = |mm: Option<f64>| mm.is_some_and(|mm| mm <= budget_mm);
    let mut try_rows = |kept: &[usize], setup: &mut Setup| -> Result<Option<f64>> {
        let keep: BTreeSet<usize> = kept.iter().flat_map(|&row| rows[row].iter().copied()).collect();
        let graph = trial.lowered(&keep)?;
        trial.measure(&graph, &draws, setup, keep.len())
    };
    let mut kept: Vec<usize> = Vec::new();
    let mut planned = all_lowered;
    if !within(all_lowered) {
        let (mut few, mut enough) = (0, rows.len());
        planned = try_rows(&(0..enough).collect::<Vec<_>>(), &mut setup)?;
        while within(planned) && enough - few > 1 {
            let middle = (few + enough) / 2;
            let found = try_rows(&(0..middle).collect::<Vec<_>>(), &mut setup)?;
            if within(found) {
                (enough, planned) = (middle, found);
            } else {
                few = middle;
            }
        }
        kept = (0..enough).collect();
        if within(planned) {
            for row in (0..enough).rev().take(DROPPED) {
                let without: Vec<usize> = kept.iter().copied().filter(|&other| other != row).collect();
                let found = try_rows(&without, &mut setup)?;
                if within(found) {
                    (kept, planned) = (without, found);
                }
            }
        }
    }
    let keep: BTreeSet<usize> = kept.iter().flat_map(|&row| rows[row].iter().copied()).collect();
    let trials = trial.trials;
    let mut notes = std::mem::take(&mut setup.notes);
    if keep.iter().any(|&place| flow.nodes()[place].name.as_deref().unwrap_or_default().is_empty()) {
        notes.push(
            "some nodes have no names in the file: name them before a converter is told to block them".into(),
        );
    }
    let graph = match write {
        Some(path) => {
            let mixed = lowering::lower(&flow, to, &keep, &ranges).map_err(|why| fault(&flow.name, why))?;
            atomic::write(path, &mixed)?;
            Some(path.display().to_string())
        }
        None => None,
    };
    Ok(PlanReport {
        schema: PLAN_SCHEMA.to_owned(),
        base: side_of(base, &bytes, flow.nodes().len()),
        inputs: setup.words.clone(),
        to: to.name().to_owned(),
        simulation: to.simulation().to_owned(),
        budget_mm,
        statistic: options.statistic,
        candidates: candidates.len(),
        all_lowered,
        keep: keep.iter().map(|&place| flow.node_name(place)).collect(),
        planned,
        pass: within(planned),
        trials,
        attribution,
        graph,
        notes,
        seconds: started.elapsed().as_secs_f64(),
    })
}

/// Mixed graphs, and what came of them.
struct Trials<'a> {
    flow: &'a Flow,
    to: Precision,
    ranges: &'a Ranges,
    options: &'a Options,
    ruler: &'a dyn Ruler,
    trials: Vec<Trial>,
}

impl Trials<'_> {
    /// The graph with all candidates lowered but these.
    fn lowered(&self, keep: &BTreeSet<usize>) -> Result<Flow> {
        let bytes = lowering::lower(self.flow, self.to, keep, self.ranges)
            .map_err(|why| fault(&self.flow.name, why))?;
        Flow::new(&format!("{} in {}", self.flow.name, self.to.name()), &bytes)
    }

    /// How far the graph is from the base.
    fn measure(
        &mut self,
        graph: &Flow,
        draws: &[Arrays],
        setup: &mut Setup,
        kept: usize,
    ) -> Result<Option<f64>> {
        let outputs = finished(graph, draws, setup)?;
        let (_, distances) = self.ruler.report(&outputs).map_err(|message| fault(&graph.name, message))?;
        let millimetres = distances.map(|d| d.statistic(self.options.statistic));
        self.trials.push(Trial { kept, millimetres });
        Ok(millimetres)
    }
}

/// A graph's outputs on all inputs, as the ruler reads them.
fn finished(flow: &Flow, draws: &[Arrays], setup: &mut Setup) -> Result<Vec<Outputs>> {
    let mut runner = flow.outputs_runner()?;
    draws
        .iter()
        .enumerate()
        .map(|(draw, inputs)| {
            let found = runner.run(|name| inputs.get(name))?;
            setup.finish(draw, as_outputs(super::flow::unprefixed(found, "out:")))
        })
        .collect()
}

/// What was recorded, and what was given.
fn with_inputs(recorded: &[Arrays], draws: &[Arrays]) -> Vec<Arrays> {
    recorded.iter().chain(draws).cloned().collect()
}

//! The second audit: the session as shipped, optimised and asked for nothing but its outputs.
//!
//! The first audit sees every node because every tensor is asked for, and that alone keeps an optimiser from doing what it does for
//! users: a tensor that is an output is not fused away. So the session is run as it ships, and the graph that its
//! optimiser made is written out. That graph, run as it is written, computes the same bits (which is checked), and the tensors that
//! survive in it under their own names can be asked for without disturbing anything.
//!
//! Each is compared with the session without optimisation, bit by bit, and with the reference: evaluated, by the original nodes,
//! from the last surviving tensors before it, with the bound that rounding earns along the way or, where that says nothing any
//! more, by drawn roundings. Where this would take too long there is no verdict, and the report says so.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use foreign::foreign;
pub(super) use session::Inputs;
use session::{Exposed, ship};
use sha2::{Digest as _, Sha256};
use vitruvian_runtime::session::Optimization;

use super::party::{Party, Segment, Tensors};
use super::report::{Grade, NodeReport, ShippedReport, ShippedTensor};
use super::{Options, audit};
use crate::error::Result;
use crate::onnx::message::NodeProto;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

mod foreign;
mod session;

/// The levels of optimisation, from the least.
const LEVELS: [(Optimization, &str); 3] =
    [(Optimization::Basic, "basic"), (Optimization::Extended, "extended"), (Optimization::All, "all")];

/// Bytes of surviving tensors that are asked for.
const ASKED: usize = 256 << 20;

/// Products that the reference may compute to fill in the tensors that the optimiser removed.
const FILLED_IN: f64 = 2e9;

/// Products that it may compute to judge those that survive; see [`Options::effort`].
const EFFORT: f64 = 1e9;

/// Seconds that loading and running the session once may take for the lower levels to be tried as well.
const PATIENCE: f64 = 0.5;

/// Audits the session as shipped; `nodes` are the reports of the first audit.
///
/// # Errors
/// When ONNX Runtime is missing, or refuses the graph, its own optimised graph, or the inputs.
pub fn shipped(
    model: &Model,
    inputs: &BTreeMap<String, TypedTensor>,
    threads: usize,
    nodes: &[NodeReport],
) -> Result<ShippedReport> {
    let embedded = model.embedded()?;
    let model = embedded.as_ref();
    let held = Inputs::new(inputs)?;
    let begin = Instant::now();
    let (outputs, optimised) = ship(model, &held, Optimization::All, threads)?;
    let once = begin.elapsed().as_secs_f64();
    let mut notes = Vec::new();
    let survivors = survivors(model, &optimised);
    let asked = affordable(&survivors, &model.outputs(), nodes);
    if asked.len() < survivors.len() {
        let (few, all, size) = (asked.len(), survivors.len(), ASKED >> 20);
        notes.push(format!(
            "of {all} surviving tensors {few} were compared, evenly chosen to stay below {size} MB"
        ));
    }
    let before = Exposed::new(model, &asked, threads)?.run(&held, &asked)?;
    let after = Exposed::new(&optimised, &asked, threads)?.run(&held, &asked)?;

    let mut tensors = Vec::new();
    let mut prints = BTreeMap::new();
    let mut kept = BTreeMap::new();
    let mut other_bits = Vec::new();
    for ((&name, before), after) in asked.iter().zip(before).zip(after) {
        let (old, new) = (print(&before), print(&after));
        if outputs.get(name).is_some_and(|shipped| print(shipped) != new) {
            other_bits.push(name);
        }
        let identical = old == new;
        tensors.push(ShippedTensor {
            name: name.to_owned(),
            identical,
            abs_max: if identical { Some(0.0) } else { largest_difference(&before, &after) },
            verdict: Grade::NotComparable,
            changed_at: None,
            why: None,
        });
        if !identical {
            prints.insert(name.to_owned(), old);
        }
        kept.insert(name.to_owned(), after);
    }
    if !other_bits.is_empty() {
        notes.push(format!(
            "the optimised graph as it is written out gives other bits than the session that wrote it: {other_bits:?}"
        ));
    }
    if once <= PATIENCE {
        first_changes(model, &held, threads, &prints, &mut tensors)?;
    } else if !prints.is_empty() {
        notes
            .push(format!("at which level tensors change was not looked for: the session takes {once:.1} s"));
    }
    judge(model, inputs, nodes, kept, &mut tensors, &mut notes)?;
    Ok(ShippedReport {
        level: "all".into(),
        verdict: worst(&tensors),
        nodes: (model.nodes().len(), optimised.nodes().len()),
        tensors,
        operators: foreign(optimised.nodes()),
        notes,
    })
}

/// The worst verdict: G3 before not comparable before G2, as of a whole audit.
fn worst(tensors: &[ShippedTensor]) -> Grade {
    let rank = |grade: Grade| match grade {
        Grade::G0 => 0,
        Grade::G1 => 1,
        Grade::G2 => 2,
        Grade::NotComparable => 3,
        Grade::G3 => 4,
    };
    tensors.iter().map(|tensor| tensor.verdict).max_by_key(|&grade| rank(grade)).unwrap_or(Grade::G0)
}

/// The tensors that nodes of both graphs make under the same name, in the order of the first.
fn survivors<'a>(model: &'a Model, optimised: &Model) -> Vec<&'a str> {
    let left: BTreeSet<&str> = made(optimised.nodes()).collect();
    made(model.nodes()).filter(|name| left.contains(name)).collect()
}

fn made(nodes: &[NodeProto]) -> impl Iterator<Item = &str> {
    nodes.iter().flat_map(|node| &node.output).map(String::as_str).filter(|name| !name.is_empty())
}

/// The tensors, or where they have more than [`ASKED`] bytes by the first audit, every k-th of them beside the graph's own
/// outputs. One that was not compared there counts as the largest.
fn affordable<'a>(tensors: &[&'a str], outputs: &[&str], nodes: &[NodeReport]) -> Vec<&'a str> {
    let reports = nodes.iter().flat_map(|node| &node.tensors);
    let bytes: BTreeMap<&str, usize> =
        reports.map(|tensor| (tensor.name.as_str(), tensor.shape.iter().product::<usize>() * 4)).collect();
    let largest = bytes.values().copied().max().unwrap_or(0);
    let all: usize = tensors.iter().map(|name| bytes.get(name).copied().unwrap_or(largest)).sum();
    let step = all.div_ceil(ASKED).max(1);
    let chosen = tensors.iter().enumerate().filter(|(i, name)| i % step == 0 || outputs.contains(*name));
    chosen.map(|(_, name)| *name).collect()
}

/// What tells tensors apart, bit by bit, without keeping them.
fn print(tensor: &TypedTensor) -> [u8; 32] {
    let mut hash = Sha256::new();
    tensor.shape.iter().for_each(|side| hash.update(side.to_le_bytes()));
    hash.update(tensor.elements.to_bytes());
    hash.finalize().into()
}

/// Largest absolute difference; none where it is not finite or the shapes differ.
pub(super) fn largest_difference(before: &TypedTensor, after: &TypedTensor) -> Option<f64> {
    if before.shape != after.shape {
        return None;
    }
    let [before, after] = [before, after].map(super::compare::numbers);
    let largest = before.iter().zip(&after).map(|(a, b)| {
        // The same infinity on both sides is no difference.
        if a == b || (a.is_nan() && b.is_nan()) { 0.0 } else { (a - b).abs() }
    });
    let largest = largest.fold(0.0, |most: f64, d| if d.is_nan() { f64::INFINITY } else { most.max(d) });
    largest.is_finite().then_some(largest)
}

/// The lowest level at which each of the changed tensors has other bits than without optimisation.
///
/// A tensor that a level does not leave is asked for at the next; what has changed at no lower one changes at `all`.
fn first_changes(
    model: &Model,
    inputs: &Inputs,
    threads: usize,
    prints: &BTreeMap<String, [u8; 32]>,
    tensors: &mut [ShippedTensor],
) -> Result<()> {
    let mut open: BTreeSet<&str> = prints.keys().map(String::as_str).collect();
    for (level, name) in LEVELS {
        if open.is_empty() {
            return Ok(());
        }
        let changed: Vec<String> = if level == Optimization::All {
            open.iter().map(|&tensor| tensor.to_owned()).collect()
        } else {
            let (_, optimised) = ship(model, inputs, level, threads)?;
            let left: Vec<&str> =
                survivors(model, &optimised).into_iter().filter(|tensor| open.contains(tensor)).collect();
            let found = Exposed::new(&optimised, &left, threads)?.run(inputs, &left)?;
            let changed = left.iter().zip(&found).filter(|(tensor, found)| prints[**tensor] != print(found));
            changed.map(|(tensor, _)| (*tensor).to_owned()).collect()
        };
        for tensor in tensors.iter_mut().filter(|tensor| changed.contains(&tensor.name)) {
            tensor.changed_at = Some(name.to_owned());
        }
        open.retain(|tensor| !changed.iter().any(|c| c == tensor));
    }
    Ok(())
}

/// The tensors that survive, as a party that has no others.
struct Survivors(BTreeMap<String, TypedTensor>);

impl Party for Survivors {
    fn describe(&self) -> String {
        "ONNX Runtime as shipped".into()
    }

    fn segment(&mut self, model: &Model, first: usize, _held: &Tensors) -> Result<Segment> {
        let tensors = std::mem::take(&mut self.0);
        let missing = made(&model.nodes()[first..]).filter(|name| !tensors.contains_key(*name));
        let missing = missing.map(|name| (name.to_owned(), "the optimiser removed it".to_owned())).collect();
        Ok(Segment { nodes: first..model.nodes().len(), tensors, missing, notes: Vec::new() })
    }
}

/// The verdict on each tensor from the last ones before it.
///
/// Where nothing has changed, it is that of the first audit, whose reports are `nodes`. `kept` are the tensors.
fn judge(
    model: &Model,
    inputs: &BTreeMap<String, TypedTensor>,
    nodes: &[NodeReport],
    kept: BTreeMap<String, TypedTensor>,
    tensors: &mut [ShippedTensor],
    notes: &mut Vec<String>,
) -> Result<()> {
    if tensors.iter().all(|tensor| tensor.identical) {
        grade(nodes, tensors, None);
        return Ok(());
    }
    let is_removed =
        |node: &&NodeReport| node.outputs.iter().any(|name| !name.is_empty() && !kept.contains_key(name));
    let removed = nodes.iter().filter(is_removed).flat_map(|node| &node.tensors);
    let products: f64 = removed.map(|tensor| tensor.elements as f64 * tensor.n_eff.max(1.0)).sum();
    if products > FILLED_IN {
        notes.push(format!(
            "tensors behind the first change were compared with the session without optimisation alone: to fill in what the \
             optimiser removed takes {products:.1e} products"
        ));
        grade(nodes, tensors, Some(&unchanged(model, tensors)));
        return Ok(());
    }
    let options = Options { effort: EFFORT, chain: 0.0, ..Options::default() };
    let again = audit(model, inputs, &mut Survivors(kept), &options, &mut |_, _, _| ())?;
    grade(&again.nodes, tensors, None);
    Ok(())
}

/// The tensors of which neither they nor anything before them has changed.
fn unchanged(model: &Model, tensors: &[ShippedTensor]) -> BTreeSet<String> {
    let mut changed: BTreeSet<&str> =
        tensors.iter().filter(|tensor| !tensor.identical).map(|tensor| tensor.name.as_str()).collect();
    for node in model.nodes() {
        if node.input.iter().any(|name| changed.contains(name.as_str())) {
            changed.extend(node.output.iter().map(String::as_str));
        }
    }
    made(model.nodes()).filter(|name| !changed.contains(name)).map(str::to_owned).collect()
}

/// Takes the verdicts over from an audit, of the tensors in `of` alone where that is given.
fn grade(nodes: &[NodeReport], tensors: &mut [ShippedTensor], of: Option<&BTreeSet<String>>) {
    let mut verdicts = BTreeMap::new();
    for node in nodes {
        for name in &node.outputs {
            let own = node.tensors.iter().find(|tensor| tensor.name == *name);
            // A tensor whose operands were filled in may have been found wanting as a node only.
            let verdict = own.map_or(node.verdict, |tensor| match node.verdict {
                Grade::NotComparable => Grade::NotComparable,
                _ => tensor.verdict,
            });
            verdicts.insert(name.as_str(), (verdict, node.why.clone()));
        }
    }
    for tensor in tensors {
        if of.is_some_and(|of| !of.contains(&tensor.name)) {
            tensor.why = Some("it lies behind a change and was not judged again".into());
            continue;
        }
        match verdicts.get(tensor.name.as_str()) {
            Some((verdict, why)) => {
                tensor.verdict = *verdict;
                tensor.why = why.clone().filter(|_| *verdict == Grade::NotComparable);
            }
            None => tensor.why = Some("no node that was judged makes it".into()),
        }
    }
}

#[cfg(test)]
mod tests;

//! Which nodes cost the millimetres.
//!
//! Between the tensors that two graphs have in common ([`matching`](super::matching)) lies what each computes from one to the
//! next. All of the variant's pieces are run at once, each fed with the *base's* tensors; what a piece then makes differs from
//! the base's by δ_k, the variant's own error there. The base is rerun from that place on with δ_k added and nothing else
//! changed: the output moves by Δ_k, to which the ruler gives its millimetres.
//!
//! To first order the whole displacement is Δ = Σ Δ_k. Lengths do not add up, since errors cancel; the signed shares
//! ⟨Δ_k, Δ⟩/⟨Δ, Δ⟩ do, to 1 where nothing but first order matters. Both are reported.
//!
//! Nodes are put into groups where there are more than [`LARGEST`] of them, neighbours together; the dearest groups are then
//! taken apart.

use std::collections::{BTreeMap, BTreeSet};

use super::flow::{Flow, unprefixed};
use super::geometry::{Displacement, Outputs, Ruler};
use super::matching::Matching;
use super::report::{Attribution, Cost, Statistic};
use super::runner::{Arrays, Runner};
use super::surgery::{Port, Rewriting, feed, nudge};
use crate::array::Array;
use crate::error::Result;

/// Rows that are rerun one by one.
pub const LARGEST: usize = 96;

/// Groups that are taken apart, where nodes were grouped.
const REFINED: usize = 6;

/// Reruns that share a session, which begins where the first of them does.
const PER_SESSION: usize = 24;

/// Numbers of all the base's tensors together, over the inputs attributed: 2 GiB.
pub const LARGEST_RECORD: usize = 1 << 29;

/// What is attributed.
pub struct Subject<'a> {
    /// The base.
    pub base: &'a Flow,
    /// The variant.
    pub variant: &'a Flow,
    /// The tensors that are the same.
    pub matching: &'a Matching,
    /// The base's inputs.
    pub inputs: &'a [Arrays],
    /// What the base's floats hold on each.
    pub recorded: &'a [Arrays],
    /// The variant's input of each of the base's.
    pub input_pairs: &'a [(String, String)],
    /// The ruler on the base's outputs.
    pub ruler: &'a dyn Ruler,
    /// What the variant's outputs are as a whole.
    pub whole: &'a [Outputs],
    /// Which number of the lengths.
    pub statistic: Statistic,
}

/// One pair of tensors at which the variant computes something else.
struct Row {
    tensor: String,
    base_places: Vec<usize>,
    variant_places: Vec<usize>,
    /// δ_k for each input.
    differences: Vec<Array>,
    local: f64,
}

/// What rows cost when they are nudged together.
struct Priced {
    rows: std::ops::Range<usize>,
    displacement: Displacement,
}

/// Attributes the difference. `finish` makes the ruler's outputs of the base's own, such as by a second graph that reads them.
///
/// # Errors
/// When a rewritten graph does not run, or the ruler refuses what it gives.
pub fn attribute(
    subject: &Subject,
    finish: &mut dyn FnMut(usize, Outputs) -> Result<Outputs>,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<Attribution> {
    let ruled = |message: String| super::flow::fault(&subject.variant.name, message);
    let whole = subject.ruler.displacement(subject.whole).map_err(ruled)?;
    let rows = subject.rows()?;
    let grouped = rows.len() > LARGEST;
    let size = rows.len().div_ceil(LARGEST).max(1);
    let mut groups: Vec<_> =
        (0..rows.len()).step_by(size).map(|from| from..(from + size).min(rows.len())).collect();
    let mut priced = subject.price(&rows, &groups, finish, progress)?;
    if grouped {
        priced.sort_by(|a, b| weight(b, &whole).total_cmp(&weight(a, &whole)));
        let (dear, rest): (Vec<_>, Vec<_>) = priced
            .into_iter()
            .enumerate()
            .partition(|(place, group)| *place < REFINED && group.rows.len() > 1);
        groups = dear.into_iter().flat_map(|(_, group)| group.rows.map(|row| row..row + 1)).collect();
        groups.sort_by_key(|group| group.start);
        priced = rest.into_iter().map(|(_, group)| group).collect();
        priced.extend(subject.price(&rows, &groups, finish, progress)?);
    }
    let mut costs: Vec<Cost> = priced.iter().map(|group| subject.cost(&rows, group, &whole)).collect();
    costs.sort_by(|a, b| dearness(b).total_cmp(&dearness(a)));
    let explained = costs.iter().map(|cost| cost.share).sum();
    let sum = costs.iter().filter_map(|cost| cost.alone).sum();
    let how = if grouped {
        format!(", in groups of {size} of which the {REFINED} dearest were taken apart")
    } else {
        String::new()
    };
    Ok(Attribution {
        method: format!(
            "{} places where the variant computes something else, each alone in the base on {} input(s){how}",
            rows.len(),
            subject.inputs.len()
        ),
        unit: format!("{} ({})", subject.ruler.unit(), word(subject.statistic)),
        whole: whole.lengths.map(|lengths| lengths.statistic(subject.statistic)),
        sum,
        explained,
        matched: subject.matching.counts,
        costs,
    })
}

/// The statistic in a word.
pub fn word(statistic: Statistic) -> &'static str {
    match statistic {
        Statistic::Mean => "mean",
        Statistic::P99 => "99th percentile",
        Statistic::Max => "largest",
    }
}

/// Dearest first: what is not finite, then by length, then by share.
fn dearness(cost: &Cost) -> f64 {
    cost.alone.unwrap_or(f64::INFINITY)
}

fn weight(group: &Priced, whole: &Displacement) -> f64 {
    share(&group.displacement, whole).abs().max(group.displacement.lengths.map_or(f64::INFINITY, |l| l.rms))
}

/// ⟨Δ_k, Δ⟩/⟨Δ, Δ⟩; 0 where it is not a number.
fn share(part: &Displacement, whole: &Displacement) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let share = dot(&part.components, &whole.components) / dot(&whole.components, &whole.components);
    if share.is_finite() { share } else { 0.0 }
}

impl Subject<'_> {
    /// The places where the variant, fed with the base's tensors, makes something else, in the base's order.
    fn rows(&self) -> Result<Vec<Row>> {
        let pairs: Vec<(&str, &str)> = self.matching.pairs().collect();
        let first = &self.recorded[0];
        let feeds: Vec<Port> =
            pairs.iter().map(|(b, v)| self.variant.port(v, first[*b].shape.len())).collect();
        let outputs: Vec<&str> = pairs.iter().map(|(_, v)| *v).collect();
        let rewriting = Rewriting { feeds: &feeds, outputs: &outputs, as_made: true, ..Default::default() };
        let mut runner = self.variant.runner(&rewriting)?;
        let fed: BTreeMap<String, &str> = pairs.iter().map(|(b, v)| (feed(v), *b)).collect();
        let named: BTreeMap<&str, &str> =
            self.input_pairs.iter().map(|(b, v)| (v.as_str(), b.as_str())).collect();

        let mut differences: BTreeMap<&str, Vec<Array>> = BTreeMap::new();
        for (inputs, recorded) in self.inputs.iter().zip(self.recorded) {
            let given = |name: &str| match fed.get(name) {
                Some(base) => recorded.get(*base),
                None => inputs.get(*named.get(name)?),
            };
            let made = unprefixed(runner.run(given)?, "out:");
            for (b, v) in &pairs {
                differences.entry(b).or_default().push(difference(&made[*v], &recorded[*b]));
            }
        }

        let mut rows = Vec::new();
        for (b, v) in pairs {
            let differences = differences.remove(b).unwrap_or_default();
            if differences.iter().all(|d| d.values.iter().all(|&x| x == 0.0)) {
                continue;
            }
            let squares = |arrays: &mut dyn Iterator<Item = &Array>| {
                arrays.flat_map(|a| &a.values).map(|&x| f64::from(x).powi(2)).sum::<f64>()
            };
            let size = squares(&mut self.recorded.iter().map(|recorded| &recorded[b]));
            rows.push(Row {
                tensor: b.to_owned(),
                base_places: self.base.region(b, |t| self.matching.variant(t).is_some()).0,
                variant_places: self.variant.region(v, |t| self.matching.base(t).is_some()).0,
                local: (squares(&mut differences.iter()) / size).sqrt(),
                differences,
            });
        }
        rows.sort_by_key(|row| self.base.maker[&row.tensor]);
        Ok(rows)
    }

    /// Reruns the base once for each group of rows and input, from where the groups of a session begin.
    fn price(
        &self,
        rows: &[Row],
        groups: &[std::ops::Range<usize>],
        finish: &mut dyn FnMut(usize, Outputs) -> Result<Outputs>,
        progress: &mut dyn FnMut(usize, usize, &str),
    ) -> Result<Vec<Priced>> {
        let mut priced = Vec::new();
        for together in groups.chunks(PER_SESSION) {
            let members = &rows[together[0].start..together[together.len() - 1].end];
            let mut session = self.suffix(members)?;
            for group in together {
                progress(priced.len(), groups.len(), "attributing");
                let outputs: Result<Vec<Outputs>> = (0..self.inputs.len())
                    .map(|draw| finish(draw, self.nudged(&mut session, members, &rows[group.clone()], draw)?))
                    .collect();
                let displacement = self
                    .ruler
                    .displacement(&outputs?)
                    .map_err(|message| super::flow::fault(&self.base.name, message))?;
                priced.push(Priced { rows: group.clone(), displacement });
            }
        }
        Ok(priced)
    }

    /// The base from the first of these rows on: what is made before is given as it was recorded.
    fn suffix(&self, members: &[Row]) -> Result<Runner> {
        let first = members.iter().map(|row| self.base.maker[&row.tensor]).min().unwrap_or(0);
        let nudged: BTreeSet<&str> = members.iter().map(|row| row.tensor.as_str()).collect();
        let recorded = &self.recorded[0];
        let rank = |tensor: &str| recorded[tensor].shape.len();
        let nudges: Vec<Port> = nudged.iter().map(|t| self.base.port(t, rank(t))).collect();
        let before = |tensor: &&String| self.base.maker[*tensor] < first && !nudged.contains(tensor.as_str());
        let feeds: Vec<Port> =
            self.base.floats.keys().filter(before).map(|t| self.base.port(t, rank(t))).collect();
        let outputs: Vec<&str> = self.base.outputs.iter().map(String::as_str).collect();
        self.base.runner(&Rewriting { feeds: &feeds, nudges: &nudges, outputs: &outputs, as_made: false })
    }

    /// The base's outputs with the differences of a group added.
    fn nudged(&self, session: &mut Runner, members: &[Row], group: &[Row], draw: usize) -> Result<Outputs> {
        let recorded = &self.recorded[draw];
        let mut given: BTreeMap<String, &Array> =
            recorded.iter().map(|(t, array)| (feed(t), array)).collect();
        let zeros: Vec<(String, Array)> = members
            .iter()
            .map(|row| {
                (nudge(&row.tensor), Array::new(&vec![1; recorded[&row.tensor].shape.len()], vec![0.0]))
            })
            .collect();
        given.extend(zeros.iter().map(|(name, zero)| (name.clone(), zero)));
        given.extend(group.iter().map(|row| (nudge(&row.tensor), &row.differences[draw])));
        let inputs = &self.inputs[draw];
        let found = session.run(|name| given.get(name).copied().or_else(|| inputs.get(name)))?;
        Ok(super::as_outputs(unprefixed(found, "out:")))
    }

    fn cost(&self, rows: &[Row], group: &Priced, whole: &Displacement) -> Cost {
        let members = &rows[group.rows.clone()];
        let names = |flow: &Flow, places: &dyn Fn(&Row) -> &Vec<usize>| -> Vec<String> {
            let all: BTreeSet<usize> = members.iter().flat_map(places).copied().collect();
            all.into_iter().map(|place| flow.node_name(place)).collect()
        };
        let base_places: BTreeSet<usize> = members.iter().flat_map(|row| &row.base_places).copied().collect();
        let operators: Vec<&str> = base_places
            .iter()
            .map(|&p| self.base.nodes()[p].op_type.as_deref().unwrap_or_default())
            .collect();
        let maker = |row: &Row| self.base.node_name(self.base.maker[&row.tensor]);
        let name = match members {
            [only] => maker(only),
            [first, .., last] => format!("{} … {}", maker(first), maker(last)),
            [] => String::new(),
        };
        let operators = if members.len() == 1 { operators.join(", ") } else { counted(&operators) };
        Cost {
            name,
            operators,
            base_nodes: names(self.base, &|row| &row.base_places),
            variant_nodes: names(self.variant, &|row| &row.variant_places),
            alone: group.displacement.lengths.map(|lengths| lengths.statistic(self.statistic)),
            share: share(&group.displacement, whole),
            local: members.iter().map(|row| row.local).reduce(f64::max).filter(|local| local.is_finite()),
        }
    }
}

/// `3 Conv, 2 Relu`.
fn counted(operators: &[&str]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for operator in operators {
        *counts.entry(operator).or_default() += 1;
    }
    let words: Vec<String> =
        counts.into_iter().map(|(operator, count)| format!("{count} {operator}")).collect();
    words.join(", ")
}

/// a − b; where a is not finite, so is the difference.
fn difference(a: &Array, b: &Array) -> Array {
    let values = a.values.iter().zip(&b.values).map(|(x, y)| x - y).collect();
    Array { shape: b.shape.clone(), values }
}

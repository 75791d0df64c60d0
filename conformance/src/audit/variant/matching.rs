//! Which tensors of two graphs are the same.
//!
//! A tensor of the variant is the same as one of the base when it is meant to hold the same numbers, however it is computed:
//! in another precision, through casts and quantisation, by fused or decomposed operators. What lies between such tensors is
//! then the variant's way of computing what the base computes between theirs.
//!
//! Three signs are tried in turn, and what one finds helps the next:
//!
//! 1. equal names;
//! 2. structure: the same operators on the same tensors, where Cast, Identity, QuantizeLinear and DequantizeLinear change
//!    nothing; what is ambiguous goes to the tensor whose numbers are nearest;
//! 3. equal numbers, up to `NEAR`, where no other tensor comes near.
//!
//! A pair must agree in shape and, up to `FAR`, in its numbers on the inputs given: exporters reuse names.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher as _};

use super::flow::Flow;
use super::report::Matched;
use super::runner::Arrays;
use crate::array::Array;

/// Tensors are not the same if they differ by more than this part of their norm.
const FAR: f64 = 0.5;

/// Tensors may be called the same for their numbers alone if they differ by no more than this part of their norm: int8's
/// rounding of activations costs a few per cent.
const NEAR: f64 = 0.1;

/// By how many times nearer the nearest must be than the next.
const CLEARLY: f64 = 4.0;

/// Numbers looked at to tell tensors apart.
const SAMPLES: usize = 1024;

/// Operators that pass a tensor on, but for its precision.
const PASSING: [&str; 5] = ["Cast", "CastLike", "Identity", "QuantizeLinear", "DequantizeLinear"];

/// The tensors of the variant that are the same as tensors of the base, and the other way round.
#[derive(Clone, Debug, Default)]
pub struct Matching {
    to_variant: BTreeMap<String, String>,
    to_base: BTreeMap<String, String>,
    /// How they were found.
    pub counts: Matched,
}

impl Matching {
    /// Matches the tensors that were recorded on the same inputs. `inputs` and `outputs` are pairs that are known: the graphs'
    /// own inputs and outputs, base first.
    pub fn of(
        base: &Flow,
        variant: &Flow,
        recorded: (&Arrays, &Arrays),
        inputs: &[(String, String)],
        outputs: &[(String, String)],
    ) -> Self {
        let mut matching = Self::default();
        matching.counts.base_tensors = base.floats.len();
        for (b, v) in outputs {
            if recorded.0.contains_key(b) && recorded.1.contains_key(v) {
                matching.insert(b, v);
                matching.counts.by_name += 1;
            }
        }
        for (name, array) in recorded.0 {
            let Some(other) = recorded.1.get(name) else { continue };
            let apart = distance(array, other);
            let overflowed = base.operator(name) == variant.operator(name)
                && array.shape == other.shape
                && other.values.iter().any(|x| !x.is_finite());
            if apart < FAR || overflowed {
                matching.counts.by_name += usize::from(matching.insert(name, name));
            }
        }
        matching.counts.by_structure += matching.by_structure(base, variant, recorded, inputs);
        matching.counts.by_values += matching.by_values(base, variant, recorded);
        matching.counts.by_structure += matching.by_structure(base, variant, recorded, inputs);
        matching.drop_crossings(base, variant);
        matching
    }

    /// The variant's tensor that is the same as this one of the base.
    pub fn variant(&self, base: &str) -> Option<&str> {
        self.to_variant.get(base).map(String::as_str)
    }

    /// The base's tensor that is the same as this one of the variant.
    pub fn base(&self, variant: &str) -> Option<&str> {
        self.to_base.get(variant).map(String::as_str)
    }

    /// All pairs, base first, in the order of the base's names.
    pub fn pairs(&self) -> impl Iterator<Item = (&str, &str)> {
        self.to_variant.iter().map(|(b, v)| (b.as_str(), v.as_str()))
    }

    /// Adds a pair unless either is taken.
    fn insert(&mut self, base: &str, variant: &str) -> bool {
        let free = !self.to_variant.contains_key(base) && !self.to_base.contains_key(variant);
        if free {
            self.to_variant.insert(base.to_owned(), variant.to_owned());
            self.to_base.insert(variant.to_owned(), base.to_owned());
        }
        free
    }

    fn by_structure(
        &mut self,
        base: &Flow,
        variant: &Flow,
        recorded: (&Arrays, &Arrays),
        inputs: &[(String, String)],
    ) -> usize {
        let mut anchors = (BTreeMap::new(), BTreeMap::new());
        for (number, (b, v)) in
            inputs.iter().map(|(b, v)| (b.as_str(), v.as_str())).chain(self.pairs()).enumerate()
        {
            anchors.0.insert(b.to_owned(), number as u64);
            anchors.1.insert(v.to_owned(), number as u64);
        }
        let labels = (labels(base, &anchors.0), labels(variant, &anchors.1));
        let mut alike: BTreeMap<u64, Vec<&str>> = BTreeMap::new();
        for (tensor, &label) in
            labels.1.iter().filter(|(t, _)| recorded.1.contains_key(**t) && self.base(t).is_none())
        {
            alike.entry(label).or_default().push(tensor);
        }
        let mut found = Vec::new();
        for (tensor, label) in
            labels.0.iter().filter(|(t, _)| recorded.0.contains_key(**t) && self.variant(t).is_none())
        {
            for other in alike.get(label).into_iter().flatten() {
                let apart = distance(&recorded.0[*tensor], &recorded.1[*other]);
                // Of a tensor and its casts, the one that the same operator makes.
                let passed = base.operator(tensor) != variant.operator(other);
                if apart < FAR {
                    found.push((passed, apart, (*tensor).to_owned(), (*other).to_owned()));
                }
            }
        }
        found.sort_by(|a, b| {
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then_with(|| (&a.2, &a.3).cmp(&(&b.2, &b.3)))
        });
        found.into_iter().filter(|(_, _, b, v)| self.insert(b, v)).count()
    }

    fn by_values(&mut self, base: &Flow, variant: &Flow, recorded: (&Arrays, &Arrays)) -> usize {
        let mut by_shape: BTreeMap<&[usize], Vec<&str>> = BTreeMap::new();
        for (name, array) in recorded.1.iter().filter(|(name, _)| self.base(name).is_none()) {
            by_shape.entry(&array.shape).or_default().push(name);
        }
        let mut found = Vec::new();
        for (name, array) in recorded.0.iter().filter(|(name, _)| self.variant(name).is_none()) {
            let mut near: Vec<(f64, &str)> = by_shape
                .get(&array.shape[..])
                .into_iter()
                .flatten()
                .map(|other| (distance(array, &recorded.1[*other]), *other))
                .filter(|(apart, _)| *apart <= NEAR)
                .collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let same = near.iter().find(|(_, other)| variant.operator(other) == base.operator(name));
            let clear = match near[..] {
                [only] => Some(only),
                [first, second, ..] if second.0 > CLEARLY * first.0 => Some(first),
                [first, ..] => same.copied().filter(|same| same.0 <= CLEARLY * first.0),
                [] => None,
            };
            found.extend(clear.map(|(apart, other)| (apart, name.clone(), other.to_owned())));
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| (&a.1, &a.2).cmp(&(&b.1, &b.2))));
        found.into_iter().filter(|(_, b, v)| self.insert(b, v)).count()
    }

    /// Drops pairs whose variant is computed from something that the base computes only later: they are no cuts of one flow.
    fn drop_crossings(&mut self, base: &Flow, variant: &Flow) {
        loop {
            let crossing = self.pairs().find(|(b, v)| {
                let (_, frontier) = variant.region(v, |t| self.base(t).is_some());
                let earlier = |t: &String| match self.base(t).and_then(|b| base.maker.get(b)) {
                    Some(place) => *place < base.maker[*b],
                    None => true,
                };
                !frontier.iter().all(earlier)
            });
            let Some((b, v)) = crossing.map(|(b, v)| (b.to_owned(), v.to_owned())) else { return };
            self.to_variant.remove(&b);
            self.to_base.remove(&v);
        }
    }
}

/// A label per tensor, equal where the same operators lead to it from the same anchors.
fn labels<'a>(flow: &'a Flow, anchors: &BTreeMap<String, u64>) -> BTreeMap<&'a str, u64> {
    let mut labels: BTreeMap<&str, u64> = BTreeMap::new();
    for input in &flow.inputs {
        labels.insert(input, hash(&("anchor", anchors.get(input))));
    }
    for node in flow.nodes() {
        let read: Vec<u64> =
            node.input.iter().map(|name| labels.get(name.as_str()).copied().unwrap_or(0)).collect();
        let operator = node.op_type.as_deref().unwrap_or_default();
        for (place, output) in node.output.iter().enumerate().filter(|(_, name)| flow.is_live(name)) {
            let label = match anchors.get(output) {
                Some(anchor) => hash(&("anchor", anchor)),
                None if PASSING.contains(&operator) => read.first().copied().unwrap_or(0),
                None => hash(&(operator, place, &read)),
            };
            labels.insert(output, label);
        }
    }
    labels
}

fn hash(value: &impl std::hash::Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

/// ‖a − b‖/max(‖a‖, ‖b‖) over a sample of the places; infinite where shapes differ or a number is not finite.
fn distance(a: &Array, b: &Array) -> f64 {
    if a.shape != b.shape {
        return f64::INFINITY;
    }
    // A step that shares no factor with the usual sides.
    let count = a.values.len();
    let step = if count <= SAMPLES { 1 } else { (count / SAMPLES) | 1 };
    let (mut apart, mut size_a, mut size_b) = (0.0_f64, 0.0_f64, 0.0_f64);
    for place in (0..count).step_by(step) {
        let (x, y) = (f64::from(a.values[place]), f64::from(b.values[place]));
        apart += (x - y).powi(2);
        size_a += x * x;
        size_b += y * y;
    }
    let apart = if apart == 0.0 { 0.0 } else { (apart / size_a.max(size_b)).sqrt() };
    if apart.is_nan() { f64::INFINITY } else { apart }
}

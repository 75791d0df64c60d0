//! The hypothesis engine: which plausible mistake turns the specified meaning into the numbers that were found?
//!
//! A suspicion is a mistake with a name: an attribute read wrongly, operands in another order, fewer digits, a stale
//! tensor. The node is evaluated once more under each, from the second party's own operands, and judged by the same
//! certificate as before.
//!
//! # When does a suspicion explain the numbers?
//! When nothing but rounding is left under it (G0 or G1), although it was not (G2 or G3) under the specified meaning. So a
//! mistake that changes nothing for these operands (align_corners in a grid of zeros) explains nothing. Where none reaches
//! G1, one that leaves at most a hundredth of the difference and G2 is named too: a mistake is seldom alone, but a
//! coincidence of two digits is rarer still.
//!
//! It must also come closer to the numbers, not only widen the bound: normalisation takes any common addend away again, and
//! one of 500 leaves nothing but cancellation, which excuses everything.
//!
//! # Which one, when several do?
//! Families are listed from what one attribute says to what any number can be bent to, and within a family the closest
//! meaning comes first. The first whose grade is the best and whose csu is within twice the smallest (and one unit) is
//! named: a closer mistake needs less to have gone wrong, but not if another fits clearly better.
//!
//! | family | mistakes |
//! |---|---|
//! | `interpolation` | corners, half pixels, nearest, cubic coefficient, antialias |
//! | `padding` | kinds of padding, sides, counts, ceil_mode |
//! | `kernel` | strides, dilations, groups, flipped and transposed kernels |
//! | `normalisation` | epsilon, variance, statistics and scales exchanged, axes and groups |
//! | `matrix` | alpha, beta, transposed matrices, biases |
//! | `activation` | slopes, approximations, softmax axes, bounds |
//! | `reduction` | other reductions and axes |
//! | `indexing` | slices, indices, orders of operands |
//! | `rounding` | ties, truncation, limits of a type |
//! | `requantisation` | the same of quantised results, with their scale and zero point |
//! | `quantisation` | zero points, signs and scales of quantised operands |
//! | `layout` | orders of axes, channels and batches |
//! | `stale` | numbers of other tensors, or none |
//! | `constants` | weights with too few digits, single numbers that are others |
//! | `precision` | operands, sums and results with too few bits |
//! | `factor` | a common factor or addend, fitted |

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::case::Case;
use super::report::{Grade, Hypothesis};
use crate::onnx::typed_tensor::TypedTensor;
use change::Meaning;
use fit::Parameter;
use trial::Trial;

mod activation;
mod change;
mod constants;
mod excerpt;
mod factor;
mod fit;
mod indexing;
mod interpolation;
mod kernel;
mod layout;
mod matrix;
mod normalisation;
mod padding;
mod precision;
mod quantisation;
mod reduction;
mod requantisation;
mod rounding;
mod stale;
mod trial;

/// A mistake that is tried.
pub struct Suspicion {
    /// A stable name in lower case.
    name: String,
    /// One sentence with the values.
    detail: String,
    /// What the node means under it.
    meaning: Meaning,
}

impl Suspicion {
    fn new(name: impl Into<String>, detail: impl Into<String>, meaning: Meaning) -> Self {
        Self { name: name.into(), detail: detail.into(), meaning }
    }
}

/// Further tensors of the run in which a node was outside rounding.
#[derive(Clone, Copy)]
pub struct Others<'a> {
    /// Them by name.
    pub tensors: &'a BTreeMap<String, Arc<TypedTensor>>,
    /// Those that are computed from the node's outputs, and its outputs. A node cannot have read these; but its output may
    /// have been overwritten with them.
    pub later: &'a BTreeSet<String>,
}

/// How much of the difference a suspicion that does not reach G1 may leave.
const CLEARLY: f64 = 0.01;

/// The longest that is spent on one node. Most take milliseconds; the limit is for operators that cannot be sampled.
const PATIENCE: Duration = Duration::from_secs(20);

/// The mistake that explains a node that is outside rounding; `None` where none that is tried does.
///
/// `worst` is the place of the worst element in the first output, which samples of large nodes include. `others` are
/// further tensors of the same run, in which a stale output is looked for.
pub fn explain(case: &Case, worst: Option<&[usize]>, others: Others) -> Option<Hypothesis> {
    let trial = Trial::of(case, worst)?;
    let mut candidates =
        Candidates { trial: &trial, until: Instant::now() + PATIENCE, explaining: Vec::new() };
    for family in FAMILIES {
        candidates.consider(family(&trial));
    }
    candidates.consider(stale::suspicions(&trial, others));
    for family in LATER_FAMILIES {
        candidates.consider(family(&trial));
    }
    for parameter in PARAMETERS.iter().flat_map(|family| family(&trial)) {
        if candidates.in_time() {
            candidates.consider(fit::fitted(parameter, &trial));
        }
    }
    // Wide bounds and single elements, the narrowest first: here the first that explains is the one that is named.
    for suspicion in precision::last_resort(&trial).into_iter().chain(stale::last_resort(&trial)) {
        if candidates.explaining.is_empty() {
            candidates.consider_wider([suspicion]);
        }
    }
    // Numbers that are another tensor's bit for bit need no evaluation; but a meaning that gives them says more.
    if candidates.explaining.is_empty() {
        return stale::identical(case, others.tensors).or_else(|| stale::repeated(case));
    }
    named(candidates.explaining)
}

/// The suspicions that explain the numbers so far.
struct Candidates<'a> {
    trial: &'a Trial<'a>,
    until: Instant,
    explaining: Vec<(Grade, Hypothesis)>,
}

impl Candidates<'_> {
    fn in_time(&self) -> bool {
        Instant::now() < self.until
    }

    /// Keeps the suspicions that explain the numbers, and do so by coming closer to them, not by a wider bound.
    fn consider(&mut self, suspicions: impl IntoIterator<Item = Suspicion>) {
        let trial = self.trial;
        self.consider_if(suspicions, |meaning| trial.comes_closer(meaning));
    }

    /// As [`Self::consider`], for suspicions that are a wider bound.
    fn consider_wider(&mut self, suspicions: impl IntoIterator<Item = Suspicion>) {
        self.consider_if(suspicions, |_| true);
    }

    fn consider_if(
        &mut self,
        suspicions: impl IntoIterator<Item = Suspicion>,
        closer: impl Fn(&Meaning) -> bool,
    ) {
        for Suspicion { name, detail, meaning } in suspicions {
            if !self.in_time() {
                return;
            }
            let Some((grade, csu)) = self.trial.judge(&meaning) else { continue };
            let clearly =
                grade == Grade::G2 && self.trial.grade == Grade::G3 && csu <= CLEARLY * self.trial.csu;
            if (grade <= Grade::G1 || clearly) && closer(&meaning) {
                self.explaining.push((grade.max(Grade::G1), Hypothesis { name, detail, csu }));
            }
        }
    }
}

/// The first of the best grade whose csu is within twice the smallest and one.
fn named(candidates: Vec<(Grade, Hypothesis)>) -> Option<Hypothesis> {
    let best = candidates.iter().map(|(grade, _)| *grade).min()?;
    let of_grade: Vec<Hypothesis> = candidates
        .into_iter()
        .filter(|(grade, _)| *grade == best)
        .map(|(_, hypothesis)| hypothesis)
        .collect();
    let smallest = of_grade.iter().map(|hypothesis| hypothesis.csu).fold(f64::INFINITY, f64::min);
    of_grade.into_iter().find(|hypothesis| hypothesis.csu <= 2.0 * smallest + 1.0)
}

type Family = fn(&Trial) -> Vec<Suspicion>;

const FAMILIES: &[Family] = &[
    interpolation::suspicions,
    padding::suspicions,
    kernel::suspicions,
    normalisation::suspicions,
    matrix::suspicions,
    activation::suspicions,
    reduction::suspicions,
    indexing::suspicions,
    rounding::suspicions,
    requantisation::suspicions,
    quantisation::suspicions,
    layout::suspicions,
];

const LATER_FAMILIES: &[Family] = &[constants::suspicions, precision::suspicions];

/// Families of mistakes in one number, which is fitted.
const PARAMETERS: &[fn(&Trial) -> Vec<Parameter>] = &[
    normalisation::parameters,
    activation::parameters,
    interpolation::parameters,
    padding::parameters,
    constants::parameters,
    factor::parameters,
];

#[cfg(test)]
mod tests;

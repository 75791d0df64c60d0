//! A gap: nodes that follow each other and of whose tensors the second party kept none.
//!
//! The reference fills such tensors in, with a bound that is proven and holds for roundings that all conspire. It grows with
//! every node, and after a few layers it promises nothing. So the roundings are also drawn: each number made in a gap is moved up
//! or down at random by what its own rounding *usually* comes to, √n·u·m, and in other draws by what it can come to *at most*,
//! n·u·m, and the moved numbers go on through the nodes that follow. Where a tensor is there again its differences are measured
//! by the draws' scatter, over the whole tensor: the largest, the root mean square, and the factor that they have in common.
//!
//! | all three are within λ = 4 times | |
//! |---|---|
//! | the usual scatter | G1 |
//! | the scatter of the largest roundings | G2 |
//! | neither | G3: it would take roundings that conspire |
//!
//! This is evidence, where a bound would be proof: it supposes that the roundings of different numbers are independent (Higham
//! and Mary 2019), as the usual grade of a single node does. A decision that a draw makes otherwise is open to the second
//! party as well.
//!
//! # References
//! N. J. Higham and T. Mary, A new approach to probabilistic rounding error analysis, SIAM J. Sci. Comput. 41 (2019).
//! J. Vignes, A stochastic arithmetic for reliable scientific computation, Math. Comput. Simul. 35 (1993).

use std::collections::BTreeMap;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use vitruvian_reference::nn::{Rounded, Scalar};

use super::compare::{integers, numbers};
use super::party::{Held, Tensors};
use super::report::Grade;
use crate::certificate::LAMBDA;
use crate::onnx::message::NodeProto;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// Draws of each kind: of usual roundings, and of the largest.
const DRAWS: usize = 3;

/// Scatter of this share of the values says nothing about them.
pub(super) const SAYS_NOTHING: f64 = 0.1;

/// Products of a node, and elements of a tensor and of all that are kept, beyond which nothing is drawn.
const MOST_PRODUCTS: f64 = 1e9;
const MOST_ELEMENTS: usize = 1 << 22;
const MOST_KEPT: usize = 1 << 27;

/// What the draws say of a node behind a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// The grade; not comparable where rounding alone could make a tenth of the values.
    pub grade: Grade,
    /// The differences in units of the usual scatter.
    pub share: f64,
}

/// The draws of all tensors that were filled in and are still needed: the usual ones, then the largest.
#[derive(Default)]
pub(super) struct Gaps {
    drawn: BTreeMap<String, Vec<Value<f64>>>,
}

impl Gaps {
    /// Goes on by one node: draws its outputs that are `missing`, and judges those that are held if an operand was drawn.
    pub fn step(
        &mut self,
        model: &Model,
        index: usize,
        held: &Tensors,
        missing: &BTreeMap<String, String>,
        cost: f64,
    ) -> Option<Evidence> {
        let (node, opset) = (&model.nodes()[index], model.opset());
        let reads = node.input.iter().any(|name| matches!(held.get(name), Some(Held::Derived(_))));
        let lacks = node.output.iter().any(|name| missing.contains_key(name));
        if !(reads || lacks) || cost > MOST_PRODUCTS {
            return None;
        }
        let centre = evaluated(node, opset, |name| match held.get(name)? {
            Held::Derived(value) => Some(centred(value)),
            other => given(other),
        })?;
        let kept: usize = self.drawn.values().flatten().map(Value::len).sum();
        let too_large =
            |value: &Value<Rounded>| value.len() > MOST_ELEMENTS || value.len() + kept > MOST_KEPT;
        if centre.iter().flatten().any(too_large) {
            return None;
        }
        let draw = |draw: usize| -> Option<Vec<Option<Value<f64>>>> {
            let mut random = ChaCha8Rng::seed_from_u64((index * 2 * DRAWS + draw) as u64);
            let mut outputs = evaluated(node, opset, |name| match self.drawn.get(name) {
                Some(drawn) => Some(drawn[draw].clone()),
                None => given(held.get(name)?),
            })?;
            for (output, centre) in outputs.iter_mut().zip(&centre) {
                if let (Some(output), Some(centre)) = (output, centre) {
                    move_by_rounding(output, centre, draw >= DRAWS, &mut random);
                }
            }
            Some(outputs)
        };
        let mut draws: Vec<_> = (0..2 * DRAWS).into_par_iter().map(draw).collect::<Option<_>>()?;
        let mut evidence: Option<Evidence> = None;
        for (k, name) in node.output.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            let drawn: Vec<Value<f64>> =
                draws.iter_mut().filter_map(|outputs| outputs.get_mut(k)?.take()).collect();
            let centre = centre.get(k)?.as_ref()?;
            // Draws may come to other shapes, or to none, where shapes hang on numbers.
            if drawn.len() < 2 * DRAWS || drawn.iter().any(|drawn| drawn.shape() != centre.shape()) {
                return None;
            }
            match held.get(name) {
                Some(Held::Given(found)) if reads => {
                    let own = weigh(found, centre, &drawn);
                    evidence = Some(match evidence {
                        Some(other) if other.grade >= own.grade => other,
                        _ => own,
                    });
                }
                Some(Held::Given(_)) => {}
                _ => drop(self.drawn.insert(name.clone(), drawn)),
            }
        }
        evidence
    }

    /// Lets go of the tensors that no node needs any more.
    pub fn retain(&mut self, needed: impl Fn(&str) -> bool) {
        self.drawn.retain(|name, _| needed(name));
    }
}

/// A node's outputs from operands by name; `None` where one is not there or the node cannot be evaluated.
fn evaluated<T: Scalar>(
    node: &NodeProto,
    opset: i64,
    operand: impl Fn(&str) -> Option<Value<T>>,
) -> Option<Vec<Option<Value<T>>>> {
    let operands =
        node.input.iter().map(|name| if name.is_empty() { Some(None) } else { operand(name).map(Some) });
    let operands: Vec<Option<Value<T>>> = operands.collect::<Option<_>>()?;
    let borrowed: Vec<_> = operands.iter().map(Option::as_ref).collect();
    walk::evaluate(node, opset, &borrowed).ok()
}

/// A tensor of the graph or of the second party.
fn given<T: Scalar>(held: &Held) -> Option<Value<T>> {
    match held {
        Held::Constant(tensor) | Held::Given(tensor) => Value::of(tensor).ok(),
        Held::Derived(_) | Held::Unknown(_) => None,
    }
}

/// A tensor that was filled in, as if it were exact, so that the next node's own rounding is all that it states.
fn centred(value: &Value<Rounded>) -> Value<Rounded> {
    let mut value = value.clone();
    if let Data::Numbers(numbers) = &mut value.data {
        numbers.data.iter_mut().for_each(|x| *x = Rounded::exact(x.value));
    }
    value
}

/// Moves every number up or down by what its own rounding comes to: usually √n·u·m, at most n·u·m.
fn move_by_rounding(value: &mut Value<f64>, centre: &Value<Rounded>, at_most: bool, random: &mut ChaCha8Rng) {
    let Some(unit) = value.element.unit_roundoff() else { return };
    if let (Data::Numbers(numbers), Ok(centre)) = (&mut value.data, centre.numbers()) {
        for (x, centre) in numbers.data.iter_mut().zip(&centre.data).filter(|(_, centre)| centre.terms != 0.0)
        {
            let roundings = if at_most { centre.terms } else { centre.terms.sqrt() };
            // Not a number where the bound is unknown: then the draw is none either, and says nothing.
            let size = roundings * unit * centre.magnitude;
            *x += if random.random() { size } else { -size };
        }
    }
}

/// What was found against the draws of it.
fn weigh(found: &TypedTensor, centre: &Value<Rounded>, drawn: &[Value<f64>]) -> Evidence {
    let all = |of: &Value<f64>| -> Option<Vec<f64>> { Some(of.numbers().ok()?.data.clone()) };
    let drawn_numbers: Option<Vec<Vec<f64>>> = drawn.iter().map(all).collect();
    let (Ok(centre), Some(drawn_numbers)) = (centre.numbers(), drawn_numbers) else {
        return weigh_decisions(found, centre, drawn);
    };
    let centre: Vec<f64> = centre.data.iter().map(|x| x.value).collect();
    let error = Scatter::of(&numbers(found), &centre);
    let joined = |draws: &[Vec<f64>]| {
        draws.iter().map(|draw| Scatter::of(draw, &centre)).reduce(Scatter::joined).unwrap_or_default()
    };
    let (usual, most) = (joined(&drawn_numbers[..DRAWS]), joined(&drawn_numbers[DRAWS..]));
    let finite: Vec<f64> = centre.iter().copied().filter(|y| y.is_finite()).collect();
    let size = Scatter::of(&finite, &vec![0.0; finite.len()]).root_mean_square();
    let scatter = usual.root_mean_square();
    let grade = if !scatter.is_finite() || scatter > SAYS_NOTHING * size {
        Grade::NotComparable
    } else if error.share(&usual) <= LAMBDA {
        Grade::G1
    } else if error.share(&most) <= LAMBDA {
        Grade::G2
    } else {
        Grade::G3
    };
    Evidence { grade, share: error.share(&usual) }
}

/// Integers and truths that were found: one that differs must differ in a draw as well.
fn weigh_decisions(found: &TypedTensor, centre: &Value<Rounded>, drawn: &[Value<f64>]) -> Evidence {
    fn whole<T>(value: &Value<T>) -> Vec<i128> {
        match &value.data {
            Data::Integers(v) => v.data.iter().map(|&i| i.into()).collect(),
            Data::Truths(v) => v.data.iter().map(|&t| t.into()).collect(),
            Data::Numbers(_) => Vec::new(),
        }
    }
    let (found, centre) = (integers(found), whole(centre));
    let drawn: Vec<Vec<i128>> = drawn.iter().map(whole).collect();
    let open = |i: usize| drawn.iter().any(|draw| draw.get(i) != centre.get(i));
    let wrong = (0..centre.len()).any(|i| found.get(i) != centre.get(i) && !open(i));
    if wrong || found.len() != centre.len() {
        Evidence { grade: Grade::G3, share: f64::INFINITY }
    } else {
        Evidence { grade: Grade::G1, share: 0.0 }
    }
}

/// How far numbers lie from others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Scatter {
    largest: f64,
    squares: f64,
    count: usize,
    /// The factor that the distances have in common, |Σ(x − y)y| / Σy².
    factor: f64,
}

impl Scatter {
    /// Two numbers that are the same, finite or not, are no distance apart; a finite one is infinitely far from one that is not.
    fn of(numbers: &[f64], centre: &[f64]) -> Self {
        let mut scatter = Self { count: centre.len(), ..Self::default() };
        let (mut along, mut norm) = (0.0, 0.0);
        for (x, y) in numbers.iter().zip(centre) {
            let distance = if x == y || (x.is_nan() && y.is_nan()) { 0.0 } else { (x - y).abs() };
            let distance = if distance.is_nan() { f64::INFINITY } else { distance };
            scatter.largest = scatter.largest.max(distance);
            scatter.squares += distance * distance;
            if x.is_finite() && y.is_finite() {
                along += (x - y) * y;
                norm += y * y;
            }
        }
        scatter.factor = if norm > 0.0 { (along / norm).abs() } else { 0.0 };
        scatter
    }

    fn joined(self, other: Self) -> Self {
        Self {
            largest: self.largest.max(other.largest),
            squares: self.squares + other.squares,
            count: self.count + other.count,
            factor: self.factor.max(other.factor),
        }
    }

    fn root_mean_square(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }

    /// This scatter in units of another, by the measure in which it is the larger.
    fn share(&self, of: &Self) -> f64 {
        let share =
            |measure: fn(&Self) -> f64| if measure(self) == 0.0 { 0.0 } else { measure(self) / measure(of) };
        [share(|s| s.largest), share(Self::root_mean_square), share(|s| s.factor)]
            .into_iter()
            .fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::element::ElementType;
    use vitruvian_reference::nn::Tensor;

    const COUNT: usize = 400;

    fn wave(phase: f64) -> Vec<f64> {
        (0..COUNT).map(|i| (i as f64 * 12.9898 + phase).sin()).collect()
    }

    /// What is said of numbers off by these differences, where draws scatter by `usual` and ten times as far.
    fn weighed(differences: &[f64], usual: f64) -> Grade {
        let centre = wave(0.0);
        let value = |data: Vec<f64>| Value::from_numbers(ElementType::F64, Tensor::new(&[COUNT], data));
        let drawn = |size: f64, phase: f64| {
            value(centre.iter().zip(wave(phase)).map(|(y, noise)| y + size * noise).collect())
        };
        let draws: Vec<Value<f64>> = (0..2 * DRAWS)
            .map(|draw| drawn(if draw < DRAWS { usual } else { 10.0 * usual }, 1.0 + draw as f64))
            .collect();
        let found = centre.iter().zip(differences).map(|(y, d)| y + d).collect();
        let found =
            TypedTensor::new(&[COUNT], crate::onnx::typed_tensor::Elements::F64(found)).expect("a tensor");
        let exact = Tensor::new(&[COUNT], centre.iter().map(|&y| Rounded::exact(y)).collect());
        weigh(&found, &Value::from_numbers(ElementType::F64, exact), &draws).grade
    }

    #[test]
    fn differences_are_graded_by_the_scatter_of_the_draws() {
        let off = |size: f64| -> Vec<f64> { wave(9.0).into_iter().map(|noise| size * noise).collect() };
        assert_eq!(weighed(&off(0.0), 1e-6), Grade::G1, "none");
        assert_eq!(weighed(&off(2e-6), 1e-6), Grade::G1, "twice the usual scatter");
        assert_eq!(weighed(&off(2e-5), 1e-6), Grade::G2, "as the largest roundings scatter");
        assert_eq!(weighed(&off(2e-4), 1e-6), Grade::G3, "beyond them");
        assert_eq!(weighed(&off(2e-4), 0.5), Grade::NotComparable, "draws that say nothing");
        assert_eq!(weighed(&off(0.0), f64::INFINITY), Grade::NotComparable, "draws that overflow");
        let mut one = off(0.0);
        one[7] = 1e-3;
        assert_eq!(weighed(&one, 1e-6), Grade::G3, "a single element");
    }

    #[test]
    fn an_integer_may_differ_where_a_draw_decides_otherwise() {
        let integers = |data: [i64; 3]| {
            Value::<f64>::from_integers(ElementType::I64, Tensor::new(&[3], data.to_vec())).expect("integers")
        };
        let found = |data: [i64; 3]| {
            TypedTensor::new(&[3], crate::onnx::typed_tensor::Elements::I64(data.to_vec())).expect("a tensor")
        };
        let centre =
            Value::from_integers(ElementType::I64, Tensor::new(&[3], vec![4, 5, 6])).expect("integers");
        let mut draws = vec![integers([4, 5, 6]); 2 * DRAWS];
        draws[1] = integers([4, 5, 7]);
        let grade = |data: [i64; 3]| weigh(&found(data), &centre, &draws).grade;
        assert_eq!(grade([4, 5, 9]), Grade::G1, "open");
        assert_eq!(grade([4, 6, 6]), Grade::G3, "decided alike by all draws");
    }
}

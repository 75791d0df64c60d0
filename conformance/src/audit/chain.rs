//! The reference's own chain: the whole graph from its inputs in f64, beside the second party's.
//!
//! A node's local error is what it adds; here is what has come together on the way. For each tensor the *cumulative*
//! difference is that from the chain; its *propagated* part came in with the operands, and the *amplification* is the norm of
//! what went out over the norm of what came in. How much of an output is noise that no implementation can avoid is found by
//! rounding every tensor of the chain to its type up or down at random (stochastic arithmetic): the outputs' scatter over a
//! few such draws is the noise floor.
//!
//! The chain takes five evaluations of every node, wholly, so it is followed only as far as a stated effort reaches.
//!
//! # References
//! J. Vignes, A stochastic arithmetic for reliable scientific computation, Math. Comput. Simul. 35 (1993).

use std::collections::BTreeMap;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::compare::numbers;
use super::party::{Held, Tensors};
use super::report::{NodeReport, OutputReport};
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// Draws of random roundings.
const DRAWS: u64 = 3;

/// Elements that one chain may hold at once.
const MOST_HELD: usize = 1 << 25;

/// One pass through the graph: exact, or with its tensors rounded at random.
struct Pass {
    random: Option<ChaCha8Rng>,
    values: BTreeMap<String, Value<f64>>,
}

/// The chain as far as it has come.
pub(super) struct Chain {
    passes: Vec<Pass>,
    /// Σ of the squared differences of each tensor that is held.
    squares: BTreeMap<String, f64>,
    /// Products that it may still take.
    effort: f64,
    outputs: Vec<OutputReport>,
    /// Why it ended.
    pub ended: Option<String>,
}

impl Chain {
    /// A chain from the graph's inputs that may take so many products.
    pub fn new(model: &Model, inputs: &BTreeMap<String, TypedTensor>, effort: f64) -> Self {
        let values = |(name, tensor): (&String, &TypedTensor)| {
            Value::of(tensor)
                .map(|value| (name.clone(), value))
                .map_err(|why| format!("input \"{name}\" {why}"))
        };
        let values: Result<BTreeMap<String, Value<f64>>, String> = inputs.iter().map(values).collect();
        let (values, ended) = match values {
            Ok(values) => (values, None),
            Err(why) => (BTreeMap::new(), Some(why)),
        };
        let pass = |draw: u64| Pass {
            random: (draw > 0).then(|| ChaCha8Rng::seed_from_u64(draw)),
            values: values.clone(),
        };
        let output = |name: &str| OutputReport {
            name: name.to_owned(),
            cumulative: None,
            cumulative_rms: None,
            noise_floor: None,
        };
        Self {
            passes: (0..=DRAWS).map(pass).collect(),
            squares: BTreeMap::new(),
            effort,
            outputs: model.outputs().into_iter().map(output).collect(),
            ended,
        }
    }

    /// Goes on by one node, which takes about `cost` products, and completes its report.
    pub fn step(&mut self, model: &Model, index: usize, held: &Tensors, cost: f64, report: &mut NodeReport) {
        let (node, opset) = (&model.nodes()[index], model.opset());
        if self.ended.is_some() {
            return;
        }
        self.effort -= cost;
        let elements: usize = self.passes[0].values.values().map(Value::len).sum();
        if self.effort < 0.0 || elements > MOST_HELD {
            self.end(format!("too much to compute from {} on", report.name));
            return;
        }
        let constant = |name: &String| match held.get(name) {
            Some(Held::Constant(tensor)) => Value::of(tensor).ok(),
            _ => None,
        };
        let constants: BTreeMap<&String, Value<f64>> =
            node.input.iter().filter_map(|name| Some((name, constant(name)?))).collect();
        let outcome: Result<(), String> = self.passes.par_iter_mut().try_for_each(|pass| {
            let operands = node.input.iter().map(|name| match name.is_empty() {
                true => Ok(None),
                false => {
                    let value = constants.get(name).or_else(|| pass.values.get(name));
                    value.map(Some).ok_or_else(|| format!("operand \"{name}\" is not there"))
                }
            });
            let operands = operands.collect::<Result<Vec<_>, String>>()?;
            let outputs = walk::evaluate(node, opset, &operands)?;
            for (name, value) in node.output.iter().zip(outputs) {
                if let Some(mut value) = value {
                    pass.random.iter_mut().for_each(|random| round_at_random(&mut value, random));
                    pass.values.insert(name.clone(), value);
                }
            }
            Ok(())
        });
        if let Err(why) = outcome {
            self.end(format!("{}: {why}", report.name));
            return;
        }
        let local = self.local(node, opset, held);
        for (k, name) in node.output.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            self.compare(node, name, held, local.as_ref().and_then(|local| local.get(k)?.as_ref()), report);
        }
    }

    /// Ends the chain before the graph's end.
    fn end(&mut self, why: String) {
        self.ended = Some(why);
        self.passes.clear();
    }

    /// The node's outputs from the second party's own operands.
    fn local(&self, node: &NodeProto, opset: i64, held: &Tensors) -> Option<Vec<Option<Value<f64>>>> {
        let operand = |name: &String| match (name.is_empty(), held.get(name)) {
            (true, _) => Some(None),
            (false, Some(Held::Given(tensor) | Held::Constant(tensor))) => Value::of(tensor).ok().map(Some),
            (false, _) => None,
        };
        let operands: Vec<Option<Value<f64>>> = node.input.iter().map(operand).collect::<Option<_>>()?;
        let borrowed: Vec<_> = operands.iter().map(Option::as_ref).collect();
        walk::evaluate(node, opset, &borrowed).ok()
    }

    fn compare(
        &mut self,
        node: &NodeProto,
        name: &str,
        held: &Tensors,
        local: Option<&Value<f64>>,
        report: &mut NodeReport,
    ) {
        let Some(chain) = self.passes[0].values.get(name).and_then(|value| value.numbers().ok()) else {
            return;
        };
        let Some(Held::Given(found)) = held.get(name) else { return };
        if found.shape != chain.shape {
            return;
        }
        let found = numbers(found);
        let (mut largest, mut squares) = (0.0_f64, 0.0);
        for (found, exact) in found.iter().zip(&chain.data) {
            let error = found - exact;
            if error.is_finite() {
                largest = largest.max(error.abs());
                squares += error * error;
            }
        }
        let propagated =
            local.and_then(|local| local.numbers().ok()).filter(|local| local.shape == chain.shape);
        let propagated: Option<f64> = propagated.map(|local| {
            let squares = local.data.iter().zip(&chain.data).map(|(a, b)| (a - b) * (a - b));
            squares.filter(|square| square.is_finite()).sum()
        });
        let came_in: f64 = node.input.iter().filter_map(|name| self.squares.get(name)).sum();
        let count = found.len().max(1) as f64;
        if let Some(tensor) = report.tensors.iter_mut().find(|tensor| tensor.name == name) {
            tensor.cumulative = Some(largest);
            tensor.propagated = propagated.map(|squares| (squares / count).sqrt());
            tensor.amplification =
                propagated.filter(|_| came_in > 0.0).map(|squares| (squares / came_in).sqrt());
        }
        let noise: f64 = self.passes[1..]
            .iter()
            .filter_map(|pass| pass.values.get(name)?.numbers().ok())
            .flat_map(|drawn| drawn.data.iter().zip(&chain.data))
            .map(|(drawn, exact)| (drawn - exact) * (drawn - exact))
            .filter(|square| square.is_finite())
            .sum();
        if let Some(output) = self.outputs.iter_mut().find(|output| output.name == name) {
            output.cumulative = Some(largest);
            output.cumulative_rms = Some((squares / count).sqrt());
            output.noise_floor = Some((noise / count / DRAWS as f64).sqrt());
        }
        self.squares.insert(name.to_owned(), squares);
    }

    /// Lets go of the tensors that no node needs any more.
    pub fn retain(&mut self, needed: impl Fn(&str) -> bool) {
        for pass in &mut self.passes {
            pass.values.retain(|name, _| needed(name));
        }
        self.squares.retain(|name, _| needed(name));
    }

    /// The graph's outputs, end to end.
    pub fn outputs(self) -> Vec<OutputReport> {
        self.outputs
    }
}

/// Rounds every number to its type, up or down with a chance that makes it right on average.
fn round_at_random(value: &mut Value<f64>, random: &mut ChaCha8Rng) {
    let element = value.element;
    if let Data::Numbers(numbers) = &mut value.data {
        for x in &mut numbers.data {
            *x = rounded_at_random(*x, element, random.random());
        }
    }
}

/// `chance` in 0..1 decides which of the two neighbours is taken.
fn rounded_at_random(x: f64, element: ElementType, chance: f64) -> f64 {
    let (Some(unit), Some(smallest)) = (element.unit_roundoff(), element.smallest_subnormal()) else {
        return x;
    };
    let nearest = element.round(x);
    let rest = x - nearest;
    if rest == 0.0 || !rest.is_finite() {
        return nearest;
    }
    // The spacing of the type's numbers on the side of x.
    let spacing = (2.0 * unit * x.abs().log2().floor().exp2()).max(smallest);
    if chance < rest.abs() / spacing { element.round(nearest + spacing.copysign(rest)) } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_rounding_is_right_on_average_and_gives_neighbours() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for element in [ElementType::F16, ElementType::F32, ElementType::Bf16] {
            let unit = element.unit_roundoff().expect("a float type");
            for x in [1.3_f64, -0.001_234_5, 7.9999, 1000.7] {
                let draws: Vec<f64> =
                    (0..4000).map(|_| rounded_at_random(x, element, random.random())).collect();
                let mean = draws.iter().sum::<f64>() / 4000.0;
                assert!((mean - x).abs() < 0.1 * unit * x.abs(), "{element} {x}: {mean}");
                for drawn in draws {
                    assert_eq!(element.round(drawn), drawn, "{element} {x}: a number of the type");
                    assert!(
                        (drawn - x).abs() <= 2.0 * unit * x.abs(),
                        "{element} {x}: {drawn} is a neighbour"
                    );
                }
            }
        }
        assert_eq!(rounded_at_random(0.25, ElementType::F16, 0.0), 0.25, "what the type holds stays");
    }
}

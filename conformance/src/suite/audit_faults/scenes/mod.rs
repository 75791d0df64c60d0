//! Graphs of a few nodes in which mistakes are made: as the networks' layers follow each other, only smaller.

use std::collections::BTreeMap;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::onnx::builder::GraphBuilder;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

pub use self::images::{images, maps, volumes, wide};
pub use self::levels::{bytes, levels};
pub use self::lists::{lists, tokens};

mod images;
mod levels;
mod lists;

/// A graph and its inputs.
pub struct Scene {
    /// The graph.
    pub model: Model,
    /// Its inputs by name.
    pub inputs: BTreeMap<String, TypedTensor>,
}

/// All scenes by name.
pub const SCENES: &[(&str, fn() -> Scene)] = &[
    ("images", images),
    ("maps", maps),
    ("volumes", volumes),
    ("tokens", tokens),
    ("lists", lists),
    ("bytes", bytes),
    ("levels", levels),
    ("wide", wide),
];

/// Seed of all numbers in the scenes.
pub const SEED: u64 = 20;

/// Numbers of about unit size, in as many decimals as f32 has.
pub fn drawn(name: &str, shape: &[usize]) -> Vec<f32> {
    let salt = name.bytes().fold(SEED, |seed, byte| seed.wrapping_mul(31).wrapping_add(u64::from(byte)));
    let mut random = ChaCha8Rng::seed_from_u64(salt);
    (0..shape.iter().product::<usize>()).map(|_| random.random_range(-1.7..1.7)).collect()
}

/// A graph under construction with drawn weights and inputs.
struct Builder {
    graph: GraphBuilder,
    inputs: BTreeMap<String, TypedTensor>,
}

impl Builder {
    fn new(opset: i64) -> Self {
        Self { graph: GraphBuilder::new(opset), inputs: BTreeMap::new() }
    }

    fn input(self, name: &str, shape: &[usize]) -> Self {
        self.given(name, shape, drawn(name, shape))
    }

    fn given(mut self, name: &str, shape: &[usize], values: Vec<f32>) -> Self {
        self.graph = self.graph.input(name, shape);
        let tensor = TypedTensor::new(shape, Elements::F32(values)).expect("values for the shape");
        self.inputs.insert(name.to_owned(), tensor);
        self
    }

    /// A weight, smaller where more products are summed.
    fn weight(mut self, name: &str, shape: &[usize]) -> Self {
        let products: usize = shape[1..].iter().product();
        let factor = 1.0 / (products as f32).sqrt();
        let values: Vec<f32> = drawn(name, shape).iter().map(|x| x * factor).collect();
        self.graph = self.graph.constant(name, shape, &values);
        self
    }

    /// A list of constants mapped from drawn numbers.
    fn list(mut self, name: &str, count: usize, map: fn(f32) -> f32) -> Self {
        let values: Vec<f32> = drawn(name, &[count]).into_iter().map(map).collect();
        self.graph = self.graph.constant(name, &[count], &values);
        self
    }

    /// A constant of this type.
    fn tensor(mut self, name: &str, shape: &[usize], elements: Elements) -> Self {
        let tensor = TypedTensor::new(shape, elements).expect("elements for the shape");
        self.graph = self.graph.tensor(name, &tensor);
        self
    }

    fn with(mut self, add: impl FnOnce(GraphBuilder) -> GraphBuilder) -> Self {
        self.graph = add(self.graph);
        self
    }

    fn output(self, name: &str) -> Self {
        self.with(|graph| graph.output(name))
    }

    fn scene(self, name: &str) -> Scene {
        let model = Model::from_bytes(name, self.graph.to_bytes()).expect("a graph as it was built");
        Scene { model, inputs: self.inputs }
    }
}

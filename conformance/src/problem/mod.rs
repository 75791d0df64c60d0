//! Problems: one operator, its attributes and its operands, as a value with two answers.
//!
//! A [`Problem`] is drawn at random, answered by the reference ([`Problem::reference`]: the value, and the bound that comes
//! out of the same text) and by the runtime ([`Problem::runtime`]: a graph of this one node through ONNX Runtime), and
//! judged by [`compare`].
//!
//! | file | operators |
//! |---|---|
//! | [`convolution`] | Conv in 1-D, 2-D and 3-D, ConvTranspose in 2-D and 3-D |
//! | [`grid_sample`] | GridSample in 2-D and 3-D, in every mode |
//! | [`normalization`] | BatchNormalization, GroupNormalization, InstanceNormalization, LayerNormalization, LpNormalization |
//! | [`axis`] | Softmax, LogSoftmax, Hardmax, ArgMax, ArgMin, CumSum |
//! | [`resampling`] | Resize in 1-D to 3-D, Pad, DepthToSpace, LRN, Conv with `auto_pad` |
//! | [`pooling`] | MaxPool, AveragePool and LpPool in 2-D and 3-D, the same of whole images, the reductions |
//! | [`elementwise`] | arithmetic, activations, powers and transcendental functions |
//! | [`choice`] | comparisons, Where, ScatterND, ScatterElements |
//! | [`matrix_product`] | Gemm, MatMul, Einsum |
//! | [`microsoft`] | those of ONNX Runtime's own domain, in integers and fused |
//! | [`movement`] | Concat, Split, Slice, Gather, Tile, Expand, Reshape, Flatten, Squeeze, Unsqueeze, Transpose, Shape |
//! | [`values`] | the numbers |

use std::fmt;

use vitruvian_reference::nn::{Rounded, Scalar as _, Tensor, UNIT_ROUNDOFF_F32};

use crate::array::Array;
use crate::compare::{Comparison, Expected, Found, compare};
use crate::engine::{self, Optimization};
use crate::error::{Error, Result};
use crate::onnx::builder::{GraphBuilder, int};
use crate::onnx::element::ElementType;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::walk::{self, Data, Value};

pub mod axis;
pub mod choice;
pub mod convolution;
pub mod elementwise;
pub mod grid_sample;
pub mod matrix_product;
pub mod microsoft;
pub mod movement;
pub mod normalization;
pub mod pooling;
pub mod resampling;
pub mod values;

/// The version of ONNX's operators that the problems are written in: that of the exported networks.
pub const OPSET: i64 = 21;

/// What an operator is applied to.
#[derive(Clone, Debug, PartialEq)]
pub enum Operand {
    /// Given when the graph runs.
    Input(Array),
    /// Part of the graph, as weights are.
    Weight(Array),
    /// Part of the graph: a shape, axes, or (of rank 0) an index.
    Integers(Tensor<i64>),
    /// Part of the graph: what is chosen.
    Truths(Tensor<bool>),
}

/// One operator applied to given operands.
#[derive(Clone, PartialEq)]
pub struct Problem {
    /// ONNX's name of the operator.
    pub operator: &'static str,
    /// Its attributes.
    pub attributes: Vec<AttributeProto>,
    /// Its operands, in order.
    pub operands: Vec<Operand>,
}

impl Problem {
    /// The same problem with an attribute replaced.
    ///
    /// # Panics
    /// When the problem has no attribute of this name: a fault that changes nothing is no fault.
    #[must_use]
    pub fn with_attribute(mut self, attribute: AttributeProto) -> Self {
        let (operator, name) = (self.operator, attribute.name.clone());
        let place = self.attributes.iter_mut().find(|a| a.name == name);
        *place.unwrap_or_else(|| panic!("{operator} has no attribute {name:?}")) = attribute;
        self
    }

    /// The same problem with the numbers of one operand changed.
    ///
    /// # Panics
    /// When the operand is missing or holds no numbers.
    #[must_use]
    pub fn with_operand(mut self, i: usize, change: impl FnOnce(&Array) -> Array) -> Self {
        match &mut self.operands[i] {
            Operand::Input(array) | Operand::Weight(array) => *array = change(array),
            Operand::Integers(integers) => {
                panic!("operand {i} of {} holds integers {integers:?}", self.operator)
            }
            Operand::Truths(truths) => panic!("operand {i} of {} holds truths {truths:?}", self.operator),
        }
        self
    }

    /// The reference's answer with its rounding analysis, from exactly the numbers that the runtime gets.
    ///
    /// # Errors
    /// When the operator or an attribute is not understood.
    pub fn reference(&self) -> Result<Tensor<Rounded>> {
        let error = |message: String| Error::Onnx {
            graph: "problem".into(),
            item: format!("node {}", self.operator),
            message,
        };
        let operands: Vec<Value<Rounded>> = self
            .operands
            .iter()
            .map(|operand| match operand {
                Operand::Input(array) | Operand::Weight(array) => {
                    Ok(Value::from_numbers(ElementType::F32, exact(&array.shape, &array.values)))
                }
                Operand::Integers(integers) => Value::from_integers(ElementType::I64, integers.clone()),
                Operand::Truths(truths) => Ok(Value::from_truths(truths.clone())),
            })
            .collect::<std::result::Result<_, _>>()
            .map_err(error)?;
        let node = NodeProto {
            op_type: Some(self.operator.into()),
            output: (1..=self.outputs()).map(|k| format!("output_{k}")).collect(),
            attribute: self.attributes.clone(),
            ..Default::default()
        };
        let outputs =
            walk::evaluate(&node, OPSET, &operands.iter().map(Some).collect::<Vec<_>>()).map_err(error)?;
        match outputs.into_iter().flatten().last().map(|value| value.data) {
            Some(Data::Numbers(tensor)) => Ok(tensor),
            Some(Data::Integers(tensor)) => Ok(tensor.map(|i| Rounded::exact(i as f64))),
            Some(Data::Truths(tensor)) => Ok(tensor.map(|t| Rounded::exact(f64::from(u8::from(t))))),
            None => Err(error("has fewer outputs than were expected".into())),
        }
    }

    /// The graph of this one node, and its inputs.
    fn graph(&self) -> (GraphBuilder, Vec<(String, &Array)>) {
        let mut graph = GraphBuilder::new(OPSET);
        let (mut names, mut inputs) = (Vec::new(), Vec::new());
        for (i, operand) in self.operands.iter().enumerate() {
            let name = format!("operand_{i}");
            match operand {
                Operand::Input(array) => {
                    graph = graph.input(&name, &array.shape);
                    inputs.push((name.clone(), array));
                }
                Operand::Weight(array) => graph = graph.constant(&name, &array.shape, &array.values),
                Operand::Integers(tensor) => graph = graph.integers(&name, &tensor.shape, &tensor.data),
                Operand::Truths(tensor) => graph = graph.truths(&name, &tensor.shape, &tensor.data),
            }
            names.push(name);
        }
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let outputs: Vec<String> = (1..=self.outputs()).map(|k| format!("output_{k}")).collect();
        let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
        let judged = outputs[outputs.len() - 1];
        graph = graph.node(self.operator, &names, &outputs, self.attributes.clone());
        if UNREAL.contains(&self.operator) {
            // What is no f32 is made one, which is exact for small integers.
            let to = int("to", ElementType::F32.number().into());
            return (graph.node("Cast", &[judged], &["y"], vec![to]).output("y"), inputs);
        }
        (graph.output(judged), inputs)
    }

    /// How many outputs the node has; the last one is judged.
    fn outputs(&self) -> usize {
        match (self.operator, self.operands.get(1)) {
            ("Split", Some(Operand::Integers(sides))) => sides.data.len(),
            _ => 1,
        }
    }

    /// The runtime's answer.
    ///
    /// # Errors
    /// When ONNX Runtime is missing or refuses the graph.
    pub fn runtime(&self, optimization: Optimization) -> Result<Found> {
        let (graph, inputs) = self.graph();
        let inputs: Vec<(&str, &Array)> =
            inputs.iter().map(|(name, array)| (name.as_str(), *array)).collect();
        let mut outputs = engine::run(self.operator, &graph.to_bytes(), optimization, &inputs)?;
        Ok(outputs.swap_remove(0))
    }

    /// Compares the two answers.
    ///
    /// # Errors
    /// As [`Problem::reference`] and [`Problem::runtime`].
    pub fn judge(&self, optimization: Optimization) -> Result<Comparison> {
        Ok(compare(&self.expected()?, &self.runtime(optimization)?))
    }

    /// The reference's answer as an expectation for f32.
    ///
    /// # Errors
    /// As [`Problem::reference`].
    pub fn expected(&self) -> Result<Expected> {
        Ok(expected(self.operator, &self.reference()?))
    }
}

impl fmt::Debug for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.operator)?;
        for a in &self.attributes {
            write!(f, " {}=", a.name.as_deref().unwrap_or_default())?;
            match (a.i, a.f, &a.s) {
                (Some(i), _, _) => write!(f, "{i}")?,
                (_, Some(x), _) => write!(f, "{x}")?,
                (_, _, Some(text)) => write!(f, "{}", String::from_utf8_lossy(text))?,
                _ => write!(f, "{:?}", a.ints)?,
            }
        }
        for operand in &self.operands {
            match operand {
                Operand::Input(array) => write!(f, "\n  input {array:?}")?,
                Operand::Weight(array) => write!(f, "\n  weight {array:?}")?,
                Operand::Integers(integers) => {
                    write!(f, "\n  integers {:?}{:?}", integers.shape, integers.data)?
                }
                Operand::Truths(truths) => write!(f, "\n  truths {:?}{:?}", truths.shape, truths.data)?,
            }
        }
        Ok(())
    }
}

/// What an operator's answer with its rounding analysis lets one expect of f32: value, bound γ_n·m and unit u·m.
pub fn expected(operator: &str, answer: &Tensor<Rounded>) -> Expected {
    let unit = |r: &Rounded| if r.terms == 0.0 { 0.0 } else { UNIT_ROUNDOFF_F32 * r.magnitude };
    Expected {
        shape: answer.shape.clone(),
        values: answer.data.iter().map(|r| r.value).collect(),
        bounds: answer.data.iter().map(|r| r.bound(UNIT_ROUNDOFF_F32)).collect(),
        units: answer.data.iter().map(unit).collect(),
        shared: SHARING.contains(&operator),
    }
}

/// Operators that give integers or truths.
const UNREAL: [&str; 10] = [
    "ArgMax",
    "ArgMin",
    "Equal",
    "Greater",
    "GreaterOrEqual",
    "IsNaN",
    "Less",
    "LessOrEqual",
    "Range",
    "Shape",
];

/// Operators that compute one number, such as a deviation or a sum, and apply it to many elements, which share its rounding.
const SHARING: [&str; 7] = [
    "BatchNormalization",
    "GroupNormalization",
    "InstanceNormalization",
    "LayerNormalization",
    "LogSoftmax",
    "LpNormalization",
    "Softmax",
];

/// f32 numbers as exact inputs of a rounding analysis.
pub(crate) fn exact(shape: &[usize], values: &[f32]) -> Tensor<Rounded> {
    Tensor::new(shape, values.iter().map(|&v| f64::from(v)).collect()).rounded()
}

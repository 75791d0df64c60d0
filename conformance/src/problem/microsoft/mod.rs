//! Operators of the domain `com.microsoft` on drawn operands: integers that stand for numbers, and what is fused.
//!
//! Unlike a [`Problem`](super::Problem) it has operands of several element types. Scales are drawn over two decades, or as
//! powers of two, where halves abound.

use proptest::prelude::*;
use vitruvian_runtime::session::{Input, Optimization, Session, Settings};

use super::OPSET;
use crate::audit::Case;
use crate::audit::onnx_runtime::{given, taken};
use crate::error::{Error, Result};
use crate::onnx::builder::GraphBuilder;
use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::typed_tensor::{Elements, TypedTensor};

pub use self::draw::drawn;

mod draw;

/// The domain, whose operators are of version 1.
pub const DOMAIN: &str = "com.microsoft";

/// One operator with its operands; the first one is given when the graph runs, the others are part of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Foreign {
    /// The operator's name.
    pub operator: &'static str,
    /// Its attributes.
    pub attributes: Vec<AttributeProto>,
    /// Its operands; `None` where an optional one is left out.
    pub operands: Vec<Option<TypedTensor>>,
}

impl Foreign {
    /// The node as ONNX Runtime runs it, with optimisation off.
    ///
    /// # Errors
    /// When ONNX Runtime is missing or refuses the graph.
    pub fn run(&self) -> Result<Case> {
        let names: Vec<String> = (0..self.operands.len()).map(|i| format!("operand_{i}")).collect();
        let mut graph = GraphBuilder::new(OPSET);
        for (i, (name, operand)) in names.iter().zip(&self.operands).enumerate() {
            match operand {
                Some(tensor) if i == 0 => graph = graph.input_of(name, tensor.element(), &tensor.shape),
                Some(tensor) => graph = graph.tensor(name, tensor),
                None => {}
            }
        }
        let inputs: Vec<&str> = names
            .iter()
            .zip(&self.operands)
            .map(|(name, operand)| operand.as_ref().map_or("", |_| name.as_str()))
            .collect();
        let graph = graph.node(self.operator, &inputs, &["y"], self.attributes.clone()).of_domain(DOMAIN, 1);
        let settings = Settings { optimization: Optimization::Disabled, threads: 1 };
        let mut session = Session::from_bytes(self.operator, &graph.output("y").to_bytes(), &settings)?;
        let first =
            self.operands.first().and_then(Option::as_ref).expect("the first operand is never left out");
        let first = given(&names[0], first)?;
        let found = session.run(&[(&names[0], Input::from(&first))], &["y"])?;
        let found = taken(&found[0]).map_err(|message| Error::Onnx {
            graph: "problem".into(),
            item: format!("node {}", self.operator),
            message,
        })?;
        Ok(self.case(found, inputs.iter().map(|&name| name.to_owned()).collect()))
    }

    fn case(&self, found: TypedTensor, input: Vec<String>) -> Case {
        let node = NodeProto {
            input,
            output: vec!["y".into()],
            op_type: Some(self.operator.into()),
            domain: Some(DOMAIN.into()),
            attribute: self.attributes.clone(),
            ..NodeProto::default()
        };
        Case {
            node,
            opset: OPSET,
            name: self.operator.into(),
            operands: self.operands.clone(),
            found: vec![Some(found)],
        }
    }
}

/// The problem with each operand read as another in turn, as an engine with a mistake in it might: scales a little larger,
/// zero points far off, the elements from behind, the other choices.
pub fn mistaken(problem: &Foreign) -> Vec<Foreign> {
    let misread = |i: usize| {
        let mut other = problem.clone();
        other.operands[i] = Some(misread(problem.operands[i].as_ref()?));
        Some(other)
    };
    (0..problem.operands.len()).filter_map(misread).collect()
}

fn misread(tensor: &TypedTensor) -> TypedTensor {
    fn bytes<E: Copy>(v: &[E], other: fn(E) -> E) -> Vec<E> {
        match v {
            &[zero] => vec![other(zero)],
            _ => v.iter().rev().copied().collect(),
        }
    }
    let elements = match &tensor.elements {
        Elements::F32(v) => Elements::F32(v.iter().map(|x| x * 1.03).collect()),
        Elements::I8(v) => Elements::I8(bytes(v, |zero| if zero.unsigned_abs() < 25 { 50 } else { 0 })),
        Elements::U8(v) => Elements::U8(bytes(v, |zero| if zero < 25 { 50 } else { 0 })),
        Elements::I32(v) => Elements::I32(vec![0; v.len()]),
        Elements::Bool(v) => Elements::Bool(v.iter().map(|choice| !choice).collect()),
        other => panic!("operands of {other:?} are not drawn"),
    };
    TypedTensor { shape: tensor.shape.clone(), elements }
}

/// Problems of an operator.
pub fn problems(operator: &'static str) -> impl Strategy<Value = Foreign> {
    (any::<u64>(), prop::bool::weighted(0.25)).prop_map(move |(seed, halves)| drawn(operator, seed, halves))
}

/// Operators that give integers that stand for numbers.
pub const QUANTIZED: [&str; 11] = [
    "QGemm",
    "QLinearAdd",
    "QLinearAveragePool",
    "QLinearConcat",
    "QLinearConv",
    "QLinearGlobalAveragePool",
    "QLinearLeakyRelu",
    "QLinearMul",
    "QLinearSigmoid",
    "QLinearSoftmax",
    "QLinearWhere",
];

/// Operators that give numbers.
pub const REAL: [&str; 9] = [
    "BiasGelu",
    "DynamicQuantizeMatMul",
    "FastGelu",
    "FusedConv",
    "FusedGemm",
    "FusedMatMul",
    "Gelu",
    "MatMulIntegerToFloat",
    "QuickGelu",
];

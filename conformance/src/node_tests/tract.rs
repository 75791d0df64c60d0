//! tract, an engine in Rust, as a third opinion.

use tract_onnx::prelude::{
    DatumType, Framework, InferenceFact, InferenceModelExt, IntoRunnable, TValue, TVec, Tensor,
};

use super::case::Case;
use super::engine::Engine;
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::walk::caught;

/// tract on the graph as it rewrites it for itself: what it runs without rewriting is a part of its operators only.
#[derive(Clone, Copy, Debug)]
pub struct Tract;

impl Engine for Tract {
    fn name(&self) -> &'static str {
        "tract"
    }

    fn run(&mut self, case: &Case) -> Result<Vec<TypedTensor>, String> {
        // It panics where it does not understand some graphs.
        caught(|| outputs(case))?
    }
}

fn outputs(case: &Case) -> Result<Vec<TypedTensor>, String> {
    // The outermost message names the node, the innermost says what is missing.
    let why = |error: tract_onnx::prelude::TractError| {
        error.root_cause().to_string().lines().collect::<Vec<_>>().join("; ")
    };
    let mut model = tract_onnx::onnx().model_for_read(&mut case.model.bytes()).map_err(why)?;
    let names: Vec<String> = {
        let outlets = model.input_outlets().map_err(why)?;
        outlets.iter().map(|outlet| model.node(outlet.node).name.clone()).collect()
    };
    let mut inputs: TVec<TValue> = TVec::new();
    for (k, name) in names.iter().enumerate() {
        let tensor = case.inputs.get(name).ok_or_else(|| format!("input \"{name}\" is not given"))?;
        let tensor = given(tensor)?;
        let fact = InferenceFact::dt_shape(tensor.datum_type(), tensor.shape());
        model.set_input_fact(k, fact).map_err(why)?;
        inputs.push(tensor.into());
    }
    let plan = model.into_optimized().map_err(why)?.into_runnable().map_err(why)?;
    plan.run(inputs).map_err(why)?.iter().map(|value| taken(value)).collect()
}

/// A tensor handed to tract.
fn given(tensor: &TypedTensor) -> Result<Tensor, String> {
    let shape = &tensor.shape[..];
    let made = match &tensor.elements {
        Elements::F32(v) => Tensor::from_shape(shape, v),
        Elements::F64(v) => Tensor::from_shape(shape, v),
        Elements::F16(v) => Tensor::from_shape(shape, v),
        Elements::Bf16(_) => return Err("it has no bf16".into()),
        Elements::I8(v) => Tensor::from_shape(shape, v),
        Elements::U8(v) => Tensor::from_shape(shape, v),
        Elements::I16(v) => Tensor::from_shape(shape, v),
        Elements::U16(v) => Tensor::from_shape(shape, v),
        Elements::I32(v) => Tensor::from_shape(shape, v),
        Elements::U32(v) => Tensor::from_shape(shape, v),
        Elements::I64(v) => Tensor::from_shape(shape, v),
        Elements::U64(v) => Tensor::from_shape(shape, v),
        Elements::Bool(v) => Tensor::from_shape(shape, v),
    };
    made.map_err(|error| error.to_string())
}

/// A tensor taken from tract. Its symbolic dimensions are numbers here, which ONNX calls i64.
fn taken(tensor: &Tensor) -> Result<TypedTensor, String> {
    if tensor.datum_type() == DatumType::TDim {
        let numbers = tensor.cast_to::<i64>().map_err(|error| error.to_string())?;
        return taken(&numbers);
    }
    let element = match tensor.datum_type().unquantized() {
        DatumType::F32 => ElementType::F32,
        DatumType::F64 => ElementType::F64,
        DatumType::F16 => ElementType::F16,
        DatumType::I8 => ElementType::I8,
        DatumType::U8 => ElementType::U8,
        DatumType::I16 => ElementType::I16,
        DatumType::U16 => ElementType::U16,
        DatumType::I32 => ElementType::I32,
        DatumType::U32 => ElementType::U32,
        DatumType::I64 => ElementType::I64,
        DatumType::U64 => ElementType::U64,
        DatumType::Bool => ElementType::Bool,
        other => return Err(format!("an output is {other:?}, which is not read here")),
    };
    TypedTensor::from_bytes(element, tensor.shape(), tensor.as_bytes())
}

//! The tensors of a graph: as it declares them, as runs give them, as they are given to it.

use std::path::PathBuf;

use ndarray::{Array, ArrayViewD};
use ort::value::{DynValue, Outlet, PrimitiveTensorElementType, Tensor, TensorElementType, ValueType};

use super::first_line;
use crate::error::{Error, Result};
use crate::library;

/// One side of a tensor as a graph declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// Always this long.
    Fixed(usize),
    /// Any length, under this name (which may be empty).
    Free(String),
}

impl Dimension {
    /// The length, where it is declared.
    pub fn fixed(&self) -> Option<usize> {
        match self {
            Dimension::Fixed(length) => Some(*length),
            Dimension::Free(_) => None,
        }
    }
}

/// An input or output as a graph declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorInfo {
    /// Its name.
    pub name: String,
    /// Its element type in ONNX's words, such as `f32` or `i64`; or what it is if it is no tensor.
    pub element: String,
    /// Its sides.
    pub shape: Vec<Dimension>,
}

impl TensorInfo {
    pub(super) fn of(outlet: &Outlet) -> TensorInfo {
        let name = outlet.name().to_string();
        match outlet.dtype() {
            ValueType::Tensor { ty, shape, dimension_symbols } => {
                let symbol = |axis: usize| dimension_symbols.get(axis).cloned().unwrap_or_default();
                let dimension = |(axis, &length): (usize, &i64)| {
                    usize::try_from(length).map_or_else(|_| Dimension::Free(symbol(axis)), Dimension::Fixed)
                };
                let shape = shape.iter().enumerate().map(dimension).collect();
                TensorInfo { name, element: ty.to_string(), shape }
            }
            other => TensorInfo { name, element: other.to_string(), shape: Vec::new() },
        }
    }

    /// Type and shape in one word, such as `f32[N, P, 2]`.
    pub fn signature(&self) -> String {
        let side = |dimension: &Dimension| match dimension {
            Dimension::Fixed(length) => length.to_string(),
            Dimension::Free(name) if name.is_empty() => "?".to_string(),
            Dimension::Free(name) => name.clone(),
        };
        format!("{}[{}]", self.element, self.shape.iter().map(side).collect::<Vec<_>>().join(", "))
    }

    /// Whether a tensor of this element type and shape may be given.
    pub(super) fn accepts(&self, element: &str, shape: &[usize]) -> bool {
        self.element == element
            && self.shape.len() == shape.len()
            && self
                .shape
                .iter()
                .zip(shape)
                .all(|(side, &length)| side.fixed().is_none_or(|fixed| fixed == length))
    }
}

/// What a tensor can hold: f32, f64, `half::f16`, `half::bf16`, integers of 8 to 64 bits with and without sign, `bool`.
pub trait Number: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static {}

impl<T: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static> Number for T {}

/// A tensor that ONNX Runtime holds: an output, ready to be an input.
#[derive(Debug)]
pub struct Value {
    pub(super) value: DynValue,
    /// For messages: `GRAPH: output "name"`.
    pub(super) origin: (PathBuf, String),
}

impl Value {
    /// A tensor of any element type, which takes the numbers over; `name` stands for it in messages.
    ///
    /// # Errors
    /// [`Error::Graph`] when the shape does not fit the numbers, [`Error::Missing`] without ONNX Runtime.
    pub fn new<T: Number>(name: &str, shape: &[usize], numbers: Vec<T>) -> Result<Value> {
        library::environment()?;
        let origin = (PathBuf::from(name), "tensor".to_string());
        let fault =
            |message: String| Error::Graph { path: origin.0.clone(), item: origin.1.clone(), message };
        let count = numbers.len();
        let array = Array::from_shape_vec(shape, numbers)
            .map_err(|_| fault(format!("shape {shape:?} does not fit {count} numbers")))?;
        let value = Tensor::from_array(array).map_err(|error| fault(first_line(error.message())))?.into_dyn();
        Ok(Value { value, origin })
    }

    /// Its shape.
    pub fn shape(&self) -> Vec<usize> {
        match self.value.dtype() {
            ValueType::Tensor { shape, .. } => shape.iter().map(|&length| length.max(0) as usize).collect(),
            _ => Vec::new(),
        }
    }

    /// Its element type, such as `f32`.
    pub fn element(&self) -> String {
        self.value
            .dtype()
            .tensor_type()
            .map_or_else(|| "no tensor".to_string(), |element| element.to_string())
    }

    /// Its numbers, without a copy.
    ///
    /// # Errors
    /// [`Error::Graph`] when it is not an f32 tensor.
    pub fn f32(&self) -> Result<ArrayViewD<'_, f32>> {
        self.view(TensorElementType::Float32)
    }

    /// Its numbers as i64, without a copy.
    ///
    /// # Errors
    /// [`Error::Graph`] when it is not an i64 tensor.
    pub fn i64(&self) -> Result<ArrayViewD<'_, i64>> {
        self.view(TensorElementType::Int64)
    }

    /// Its numbers as `T`, without a copy.
    ///
    /// # Errors
    /// [`Error::Graph`] when it holds another type.
    pub fn numbers<T: Number>(&self) -> Result<ArrayViewD<'_, T>> {
        self.view(T::into_tensor_element_type())
    }

    fn view<T: Number>(&self, wanted: TensorElementType) -> Result<ArrayViewD<'_, T>> {
        self.value.try_extract_array::<T>().map_err(|_| Error::Graph {
            path: self.origin.0.clone(),
            item: self.origin.1.clone(),
            message: format!("it is {}, expected {wanted}", self.element()),
        })
    }
}

/// What is given to an input.
#[derive(Debug)]
pub enum Input<'a> {
    /// f32 numbers.
    F32(ArrayViewD<'a, f32>),
    /// i64 numbers.
    I64(ArrayViewD<'a, i64>),
    /// What another run gave.
    Value(&'a Value),
}

impl<'a, D: ndarray::Dimension> From<&'a Array<f32, D>> for Input<'a> {
    fn from(array: &'a Array<f32, D>) -> Self {
        Input::F32(array.view().into_dyn())
    }
}

impl<'a, D: ndarray::Dimension> From<&'a Array<i64, D>> for Input<'a> {
    fn from(array: &'a Array<i64, D>) -> Self {
        Input::I64(array.view().into_dyn())
    }
}

impl<'a> From<&'a Value> for Input<'a> {
    fn from(value: &'a Value) -> Self {
        Input::Value(value)
    }
}

impl Input<'_> {
    pub(super) fn element(&self) -> String {
        match self {
            Input::F32(_) => TensorElementType::Float32.to_string(),
            Input::I64(_) => TensorElementType::Int64.to_string(),
            Input::Value(value) => value.element(),
        }
    }

    pub(super) fn shape(&self) -> Vec<usize> {
        match self {
            Input::F32(array) => array.shape().to_vec(),
            Input::I64(array) => array.shape().to_vec(),
            Input::Value(value) => value.shape(),
        }
    }
}

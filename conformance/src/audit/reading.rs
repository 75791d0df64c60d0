//! How an operand's numbers are read.

use vitruvian_reference::nn::{Rounded, Scalar as _};

use super::case::Operand;
use super::precision::Precision;
use super::region::{Region, part, value_part};
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};

/// What the second party is taken to have had in place of the numbers it shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reading {
    /// The numbers as they stand.
    Exact,
    /// Numbers of 16 bits had not been rounded yet: ONNX Runtime keeps chains of such nodes in f32 and rounds only what
    /// is looked at, so that what the next node got differs by half a unit.
    Unrounded,
    /// Numbers too small to be normal were taken for zero.
    Flushed,
}

impl Reading {
    /// The readings under which a node may be right although it is not under [`Reading::Exact`].
    pub fn others(operands: &[Option<Operand>]) -> Vec<Self> {
        let mut readings = Vec::new();
        let given = || {
            operands.iter().flatten().filter_map(|operand| match operand {
                Operand::Given(tensor) => Some(*tensor),
                Operand::Derived(_) => None,
            })
        };
        if given().any(|tensor| is_half(tensor.element())) {
            readings.push(Self::Unrounded);
        }
        let subnormal = |tensor: &TypedTensor| match &tensor.elements {
            Elements::F32(v) => v.iter().any(|x| x.is_subnormal()),
            Elements::F64(v) => v.iter().any(|x| x.is_subnormal()),
            Elements::F16(v) => v.iter().any(|x| x.classify() == std::num::FpCategory::Subnormal),
            Elements::Bf16(v) => v.iter().any(|x| x.classify() == std::num::FpCategory::Subnormal),
            _ => false,
        };
        if given().any(subnormal) {
            readings.push(Self::Flushed);
        }
        readings
    }

    /// The operand's value, or a part of it, under this reading.
    ///
    /// # Errors
    /// When a value cannot hold the operand.
    pub fn value(self, operand: Operand, region: Option<&Region>) -> Result<Value<Rounded>, String> {
        let mut value: Value<Rounded> = match (operand, region) {
            (Operand::Given(tensor), None) => Value::of(tensor)?,
            (Operand::Given(tensor), Some(region)) => Value::of(&part(tensor, region))?,
            (Operand::Derived(value), None) => return Ok(value.clone()),
            (Operand::Derived(value), Some(region)) => return Ok(value_part(value, region)),
        };
        let element = value.element;
        if let (Data::Numbers(numbers), Some(precision)) = (&mut value.data, Precision::of(element)) {
            match self {
                Self::Unrounded if is_half(element) => {
                    for x in &mut numbers.data {
                        *x = Rounded::within(x.value, x.magnitude, if x.value == 0.0 { 0.0 } else { 1.0 });
                    }
                }
                Self::Flushed => {
                    for x in numbers.data.iter_mut().filter(|x| x.value.abs() < precision.normal) {
                        *x = Rounded::ZERO;
                    }
                }
                Self::Exact | Self::Unrounded => {}
            }
        }
        Ok(value)
    }

    /// What to say of a node that is right only under this reading.
    pub fn note(self) -> Option<&'static str> {
        match self {
            Self::Exact => None,
            Self::Unrounded => Some(
                "agree if their operands had not been rounded to 16 bits: the runtime keeps chains of such nodes in f32",
            ),
            Self::Flushed => Some("agree if operands too small to be normal numbers were taken for zero"),
        }
    }
}

fn is_half(element: ElementType) -> bool {
    matches!(element, ElementType::F16 | ElementType::Bf16)
}

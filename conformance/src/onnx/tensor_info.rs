//! What a graph declares of a tensor: element type and shape.

use super::element::ElementType;
use super::message::{DimensionProto, DimensionValue, ValueInfoProto};

/// A side of a declared shape.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// A number.
    Fixed(usize),
    /// A number that the inputs decide, under the name that the graph has for it.
    Symbol(String),
    /// Nothing is said.
    Unknown,
}

/// A tensor as a graph declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorInfo {
    /// Its name.
    pub name: String,
    /// Its element type; `None` when none is declared, or one that is not read, or it is no tensor.
    pub element: Option<ElementType>,
    /// Its shape; `None` when not even the rank is declared.
    pub shape: Option<Vec<Dimension>>,
}

impl TensorInfo {
    /// Reads a declaration.
    ///
    /// # Errors
    /// When a side is negative, or there are more places than can be counted.
    pub fn of(value: &ValueInfoProto) -> Result<Self, String> {
        let tensor = value.r#type.as_ref().and_then(|declared| declared.tensor_type.as_ref());
        let shape = tensor.and_then(|tensor| tensor.shape.as_ref());
        let shape: Option<Vec<_>> =
            shape.map(|shape| shape.dim.iter().map(side).collect::<Result<_, _>>()).transpose()?;
        let fixed = shape.iter().flatten().filter_map(|side| match side {
            Dimension::Fixed(side) => Some((*side).max(1)),
            _ => None,
        });
        let mut places = fixed.scan(1_usize, |all, side| {
            let more = all.checked_mul(side).filter(|&more| isize::try_from(more).is_ok());
            *all = more.unwrap_or(0);
            Some(more)
        });
        if places.any(|places| places.is_none()) {
            return Err(format!("shape {shape:?} has more places than can be counted"));
        }
        Ok(Self {
            name: value.name.clone().unwrap_or_default(),
            element: tensor.and_then(|tensor| tensor.elem_type).and_then(ElementType::from_number),
            shape,
        })
    }
}

fn side(dimension: &DimensionProto) -> Result<Dimension, String> {
    match &dimension.value {
        Some(DimensionValue::Number(side)) => usize::try_from(*side)
            .map(Dimension::Fixed)
            .map_err(|_| format!("a side of its shape is {side}; a length or a name was expected")),
        Some(DimensionValue::Symbol(name)) if !name.is_empty() => Ok(Dimension::Symbol(name.clone())),
        Some(DimensionValue::Symbol(_)) | None => Ok(Dimension::Unknown),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::write::{declaration, undeclared};

    #[test]
    fn types_sides_and_symbols_are_as_declared() {
        let mut value = declaration("x", ElementType::F16, &[2, 3]);
        let shape = value.r#type.as_mut().and_then(|t| t.tensor_type.as_mut()).and_then(|t| t.shape.as_mut());
        let dims = &mut shape.expect("a shape").dim;
        dims[0].value = Some(DimensionValue::Symbol("batch".into()));
        dims.push(DimensionProto::default());
        let expected = [Dimension::Symbol("batch".into()), Dimension::Fixed(3), Dimension::Unknown];
        let info = TensorInfo::of(&value).expect("a declaration");
        assert_eq!((info.element, info.shape), (Some(ElementType::F16), Some(expected.to_vec())));
        let nothing = TensorInfo::of(&undeclared("y")).expect("a declaration");
        assert_eq!((nothing.element, nothing.shape), (None, None));
    }

    #[test]
    fn sides_that_cannot_be_are_refused() {
        let huge = TensorInfo::of(&declaration("x", ElementType::F32, &[1 << 40, 0, 1 << 40]));
        assert!(huge.expect_err("refused").contains("more places"), "too many places");
        let negative = TensorInfo::of(&declaration("x", ElementType::F32, &[usize::MAX]));
        assert!(negative.expect_err("refused").contains("is -1"), "a negative side");
    }
}

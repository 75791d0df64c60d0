//! The elements of a constant tensor, wherever the container keeps them.

use super::message::{ElementType, TensorProto};

/// A constant tensor's elements, last axis fastest.
#[derive(Clone, Debug, PartialEq)]
pub enum Elements {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 64-bit floats.
    F64(Vec<f64>),
    /// 32-bit integers.
    I32(Vec<i32>),
    /// 64-bit integers.
    I64(Vec<i64>),
    /// Truths.
    Bool(Vec<bool>),
}

/// A named constant of a graph: a weight, as a rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// The name, such as PyTorch's parameter name.
    pub name: String,
    /// The shape; empty for a scalar.
    pub shape: Vec<usize>,
    /// As many elements as the shape has places.
    pub elements: Elements,
}

impl Constant {
    /// The floating-point elements as f64 (exact), or `None` for others.
    pub fn to_f64(&self) -> Option<Vec<f64>> {
        match &self.elements {
            Elements::F32(values) => Some(values.iter().map(|&v| f64::from(v)).collect()),
            Elements::F64(values) => Some(values.clone()),
            Elements::I32(_) | Elements::I64(_) | Elements::Bool(_) => None,
        }
    }

    /// Reads a tensor message; the message of the error says what was found and what was expected.
    ///
    /// Nothing is allocated beyond what the file's own bytes justify, whatever the shape claims.
    pub fn read(tensor: &TensorProto) -> Result<Self, String> {
        let name = tensor.name.clone().unwrap_or_default();
        if tensor.data_location == Some(1) || !tensor.external_data.is_empty() {
            let location = tensor
                .external_data
                .iter()
                .find(|entry| entry.key.as_deref() == Some("location"))
                .and_then(|entry| entry.value.clone())
                .unwrap_or_else(|| "an unnamed file".into());
            return Err(format!("its elements lie in {location}; export the graph with its weights inside"));
        }
        let number = tensor.data_type.unwrap_or(0);
        let element = ElementType::from_number(number).ok_or_else(|| {
            format!("element type {number}; f32, f64, i32, i64 and bool (1, 11, 6, 7, 9) are read")
        })?;
        let mut shape = Vec::with_capacity(tensor.dims.len());
        let mut count = 1_usize;
        for &dim in &tensor.dims {
            let dim =
                usize::try_from(dim).map_err(|_| format!("shape {:?} has a negative side", tensor.dims))?;
            count = count
                .checked_mul(dim)
                .ok_or_else(|| format!("shape {:?} has more places than can be counted", tensor.dims))?;
            shape.push(dim);
        }
        let elements = match &tensor.raw_data {
            Some(bytes) => from_bytes(element, bytes),
            None => match element {
                ElementType::F32 => Elements::F32(tensor.float_data.clone()),
                ElementType::F64 => Elements::F64(tensor.double_data.clone()),
                ElementType::I32 => Elements::I32(tensor.int32_data.clone()),
                ElementType::I64 => Elements::I64(tensor.int64_data.clone()),
                ElementType::Bool => Elements::Bool(tensor.int32_data.iter().map(|&i| i != 0).collect()),
            },
        };
        let found = elements.len();
        let remainder = tensor.raw_data.as_ref().map_or(0, |bytes| bytes.len() % element.size());
        if found != count || remainder != 0 {
            return Err(format!("shape {shape:?} has {count} places, {found} {element} elements were found"));
        }
        Ok(Self { name, shape, elements })
    }
}

impl Elements {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F64(values) => values.len(),
            Self::I32(values) => values.len(),
            Self::I64(values) => values.len(),
            Self::Bool(values) => values.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

fn from_bytes(element: ElementType, bytes: &[u8]) -> Elements {
    fn split<const N: usize, T>(bytes: &[u8], read: fn([u8; N]) -> T) -> Vec<T> {
        bytes.as_chunks::<N>().0.iter().map(|chunk| read(*chunk)).collect()
    }
    match element {
        ElementType::F32 => Elements::F32(split(bytes, f32::from_le_bytes)),
        ElementType::F64 => Elements::F64(split(bytes, f64::from_le_bytes)),
        ElementType::I32 => Elements::I32(split(bytes, i32::from_le_bytes)),
        ElementType::I64 => Elements::I64(split(bytes, i64::from_le_bytes)),
        ElementType::Bool => Elements::Bool(bytes.iter().map(|&byte| byte != 0).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(dims: &[i64], values: &[f32]) -> TensorProto {
        TensorProto {
            dims: dims.to_vec(),
            data_type: Some(1),
            raw_data: Some(values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            name: Some("w".into()),
            ..Default::default()
        }
    }

    #[test]
    fn raw_and_typed_elements_are_the_same_tensor() {
        let values = [1.5_f32, -2.0, 0.0, 3e-20, 7.0, 8.0];
        let typed = TensorProto { float_data: values.to_vec(), raw_data: None, ..raw(&[2, 3], &values) };
        let from_raw = Constant::read(&raw(&[2, 3], &values)).expect("raw");
        assert_eq!(from_raw, Constant::read(&typed).expect("typed"), "two ways to store one tensor");
        assert_eq!(from_raw.to_f64().expect("floats")[3], f64::from(3e-20_f32), "f32 to f64 is exact");
    }

    #[test]
    fn a_shape_that_promises_more_than_the_file_holds_is_refused() {
        for dims in [vec![2, 4], vec![1 << 40, 1 << 40], vec![-6], vec![5]] {
            let message = Constant::read(&raw(&dims, &[0.0; 6])).expect_err("refused");
            assert!(message.contains("shape"), "{message}");
        }
        let mut torn = raw(&[6], &[0.0; 6]);
        torn.raw_data.as_mut().expect("raw").push(0);
        assert!(Constant::read(&torn).is_err(), "a torn element");
    }

    #[test]
    fn elements_in_another_file_and_foreign_types_are_refused_by_name() {
        let mut outside = raw(&[1], &[0.0]);
        outside.data_location = Some(1);
        outside.external_data.push(super::super::message::StringStringEntryProto {
            key: Some("location".into()),
            value: Some("weights.bin".into()),
        });
        assert!(Constant::read(&outside).expect_err("refused").contains("weights.bin"), "names the file");
        let half = TensorProto { data_type: Some(10), ..raw(&[1], &[0.0]) };
        assert!(Constant::read(&half).expect_err("refused").contains("element type 10"), "names the type");
    }
}

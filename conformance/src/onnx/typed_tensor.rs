//! A tensor with elements of their own type, as a file holds them, wherever the container keeps them.

use half::{bf16, f16};

use super::element::ElementType;
use super::external::is_external;
use super::message::TensorProto;

/// The elements of a tensor, last axis fastest.
#[derive(Clone, Debug, PartialEq)]
pub enum Elements {
    /// IEEE binary32.
    F32(Vec<f32>),
    /// IEEE binary64.
    F64(Vec<f64>),
    /// IEEE binary16.
    F16(Vec<f16>),
    /// The upper half of a binary32.
    Bf16(Vec<bf16>),
    /// 8-bit integers.
    I8(Vec<i8>),
    /// 8-bit integers without sign.
    U8(Vec<u8>),
    /// 16-bit integers.
    I16(Vec<i16>),
    /// 16-bit integers without sign.
    U16(Vec<u16>),
    /// 32-bit integers.
    I32(Vec<i32>),
    /// 32-bit integers without sign.
    U32(Vec<u32>),
    /// 64-bit integers.
    I64(Vec<i64>),
    /// 64-bit integers without sign.
    U64(Vec<u64>),
    /// Truths.
    Bool(Vec<bool>),
}

/// A shape and its elements: a weight of a graph, an operand or an output of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct TypedTensor {
    /// The shape; empty for a scalar.
    pub shape: Vec<usize>,
    /// As many elements as the shape has places.
    pub elements: Elements,
}

/// The same expression for the list of whatever type `$elements` is.
macro_rules! for_each_type {
    ($elements:expr, $values:ident => $result:expr) => {
        match $elements {
            Elements::F32($values) => $result,
            Elements::F64($values) => $result,
            Elements::F16($values) => $result,
            Elements::Bf16($values) => $result,
            Elements::I8($values) => $result,
            Elements::U8($values) => $result,
            Elements::I16($values) => $result,
            Elements::U16($values) => $result,
            Elements::I32($values) => $result,
            Elements::U32($values) => $result,
            Elements::I64($values) => $result,
            Elements::U64($values) => $result,
            Elements::Bool($values) => $result,
        }
    };
}

impl TypedTensor {
    /// A tensor of these elements.
    ///
    /// # Errors
    /// When the shape has another number of places.
    pub fn new(shape: &[usize], elements: Elements) -> Result<Self, String> {
        fits(elements.element(), shape, elements.len())?;
        Ok(Self { shape: shape.to_vec(), elements })
    }

    /// A tensor from the bytes of its elements, little endian, last axis fastest; a truth is one byte.
    ///
    /// # Errors
    /// When the shape asks for another number of bytes.
    pub fn from_bytes(element: ElementType, shape: &[usize], bytes: &[u8]) -> Result<Self, String> {
        fits_bytes(element, shape, bytes.len())?;
        Ok(Self { shape: shape.to_vec(), elements: Elements::from_bytes(element, bytes) })
    }

    /// The type of the elements.
    pub fn element(&self) -> ElementType {
        self.elements.element()
    }

    /// How many elements there are.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The floating-point elements as f64 (exact), or `None` for others.
    pub fn to_f64(&self) -> Option<Vec<f64>> {
        match &self.elements {
            Elements::F32(values) => Some(values.iter().map(|&v| f64::from(v)).collect()),
            Elements::F64(values) => Some(values.clone()),
            Elements::F16(values) => Some(values.iter().map(|&v| f64::from(v)).collect()),
            Elements::Bf16(values) => Some(values.iter().map(|&v| f64::from(v)).collect()),
            _ => None,
        }
    }

    /// Reads a tensor message whose elements lie in the message itself.
    ///
    /// Nothing is allocated beyond what the message's own bytes justify, whatever the shape claims.
    ///
    /// # Errors
    /// When the elements lie in another file, are of a type that is not read, or do not fit the shape.
    pub fn read(tensor: &TensorProto) -> Result<Self, String> {
        if is_external(tensor) {
            return Err("its elements lie in another file; only an initializer's may".into());
        }
        let (element, shape) = (element_of(tensor)?, shape_of(tensor)?);
        match raw(tensor) {
            Some(bytes) => Self::from_bytes(element, &shape, bytes),
            None => Self::new(&shape, Elements::from_fields(element, tensor)?),
        }
    }
}

/// Checks that a tensor message holds as many elements as its shape has places; of a type that is not read, only its shape.
///
/// # Errors
/// With the shape and what was found.
pub(super) fn check(tensor: &TensorProto) -> Result<(), String> {
    let shape = shape_of(tensor)?;
    let Ok(element) = element_of(tensor) else { return Ok(()) };
    match raw(tensor) {
        Some(bytes) => fits_bytes(element, &shape, bytes.len()),
        None => fits(element, &shape, Elements::field_len(element, tensor)),
    }
}

/// The elements' bytes, if they are kept as such. Some writers add an empty list of bytes to typed elements.
fn raw(tensor: &TensorProto) -> Option<&[u8]> {
    tensor.raw_data.as_deref().filter(|bytes| !bytes.is_empty())
}

fn fits(element: ElementType, shape: &[usize], found: usize) -> Result<(), String> {
    match places(shape)? {
        count if count == found => Ok(()),
        count => Err(format!("shape {shape:?} has {count} places, {found} {element} elements were found")),
    }
}

fn fits_bytes(element: ElementType, shape: &[usize], found: usize) -> Result<(), String> {
    let (count, size) = (places(shape)?, element.size());
    if count.checked_mul(size) == Some(found) {
        return Ok(());
    }
    Err(format!("shape {shape:?} of {element} asks for {count} × {size} bytes, {found} were found"))
}

/// The element type of a tensor message.
///
/// # Errors
/// When it is none that is read here.
pub fn element_of(tensor: &TensorProto) -> Result<ElementType, String> {
    let number = tensor.data_type.unwrap_or(0);
    ElementType::from_number(number).ok_or_else(|| {
        let name = FOREIGN.iter().find(|(foreign, _)| *foreign == number).map_or("unknown", |(_, name)| name);
        format!("element type {number} ({name}); floats, integers and truths of 8 bits or more are read")
    })
}

/// ONNX's element types that are not read here.
const FOREIGN: [(i32, &str); 16] = [
    (0, "undefined"),
    (8, "string"),
    (14, "complex64"),
    (15, "complex128"),
    (17, "float8e4m3fn"),
    (18, "float8e4m3fnuz"),
    (19, "float8e5m2"),
    (20, "float8e5m2fnuz"),
    (21, "uint4"),
    (22, "int4"),
    (23, "float4e2m1"),
    (24, "float8e8m0"),
    (25, "uint2"),
    (26, "int2"),
    (27, "float6e2m3"),
    (28, "float6e3m2"),
];

/// The shape of a tensor message.
///
/// # Errors
/// When a side is negative, or there are more places than can be counted.
pub fn shape_of(tensor: &TensorProto) -> Result<Vec<usize>, String> {
    let side = |&side: &i64| usize::try_from(side).ok();
    let shape: Option<Vec<usize>> = tensor.dims.iter().map(side).collect();
    let shape = shape.ok_or_else(|| format!("shape {:?} has a negative side", tensor.dims))?;
    places(&shape)?;
    Ok(shape)
}

/// The number of a shape's places.
fn places(shape: &[usize]) -> Result<usize, String> {
    // Of sides such as 0 × 2⁶⁰ × 2⁶⁰ the product of the others must be countable, too.
    let others = shape
        .iter()
        .filter(|&&side| side != 0)
        .try_fold(1_usize, |all, &side| all.checked_mul(side).filter(|&all| isize::try_from(all).is_ok()));
    let others = others.ok_or_else(|| format!("shape {shape:?} has more places than can be counted"))?;
    Ok(if shape.contains(&0) { 0 } else { others })
}

impl Elements {
    /// Their type.
    pub fn element(&self) -> ElementType {
        match self {
            Self::F32(_) => ElementType::F32,
            Self::F64(_) => ElementType::F64,
            Self::F16(_) => ElementType::F16,
            Self::Bf16(_) => ElementType::Bf16,
            Self::I8(_) => ElementType::I8,
            Self::U8(_) => ElementType::U8,
            Self::I16(_) => ElementType::I16,
            Self::U16(_) => ElementType::U16,
            Self::I32(_) => ElementType::I32,
            Self::U32(_) => ElementType::U32,
            Self::I64(_) => ElementType::I64,
            Self::U64(_) => ElementType::U64,
            Self::Bool(_) => ElementType::Bool,
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        for_each_type!(self, values => values.len())
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their bytes, little endian; a truth is one byte.
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::Bool(values) => values.iter().map(|&v| u8::from(v)).collect(),
            Self::F32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::F64(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::F16(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Bf16(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::I8(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::U8(values) => values.clone(),
            Self::I16(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::U16(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::I32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::U32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::I64(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::U64(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }

    /// As many whole elements as these bytes hold.
    fn from_bytes(element: ElementType, bytes: &[u8]) -> Self {
        fn split<const N: usize, T>(bytes: &[u8], read: fn([u8; N]) -> T) -> Vec<T> {
            bytes.as_chunks::<N>().0.iter().map(|chunk| read(*chunk)).collect()
        }
        match element {
            ElementType::F32 => Self::F32(split(bytes, f32::from_le_bytes)),
            ElementType::F64 => Self::F64(split(bytes, f64::from_le_bytes)),
            ElementType::F16 => Self::F16(split(bytes, f16::from_le_bytes)),
            ElementType::Bf16 => Self::Bf16(split(bytes, bf16::from_le_bytes)),
            ElementType::I8 => Self::I8(split(bytes, i8::from_le_bytes)),
            ElementType::U8 => Self::U8(bytes.to_vec()),
            ElementType::I16 => Self::I16(split(bytes, i16::from_le_bytes)),
            ElementType::U16 => Self::U16(split(bytes, u16::from_le_bytes)),
            ElementType::I32 => Self::I32(split(bytes, i32::from_le_bytes)),
            ElementType::U32 => Self::U32(split(bytes, u32::from_le_bytes)),
            ElementType::I64 => Self::I64(split(bytes, i64::from_le_bytes)),
            ElementType::U64 => Self::U64(split(bytes, u64::from_le_bytes)),
            ElementType::Bool => Self::Bool(bytes.iter().map(|&byte| byte != 0).collect()),
        }
    }

    /// How many numbers lie in the field of this type.
    fn field_len(element: ElementType, tensor: &TensorProto) -> usize {
        match element {
            ElementType::F32 => tensor.float_data.len(),
            ElementType::F64 => tensor.double_data.len(),
            ElementType::I64 => tensor.int64_data.len(),
            ElementType::U32 | ElementType::U64 => tensor.uint64_data.len(),
            _ => tensor.int32_data.len(),
        }
    }

    /// The elements in the field of their type; the narrow ones lie in `int32_data`, the 16-bit floats there as their bits.
    fn from_fields(element: ElementType, tensor: &TensorProto) -> Result<Self, String> {
        fn narrow<F: Copy + std::fmt::Display, T: TryFrom<F>>(
            element: ElementType,
            field: &[F],
        ) -> Result<Vec<T>, String> {
            let one = |&v: &F| T::try_from(v).map_err(|_| format!("{v} is stored as an {element}"));
            field.iter().map(one).collect()
        }
        let small = &tensor.int32_data[..];
        let bits = || narrow::<i32, u16>(element, small);
        Ok(match element {
            ElementType::F32 => Self::F32(tensor.float_data.clone()),
            ElementType::F64 => Self::F64(tensor.double_data.clone()),
            ElementType::F16 => Self::F16(bits()?.into_iter().map(f16::from_bits).collect()),
            ElementType::Bf16 => Self::Bf16(bits()?.into_iter().map(bf16::from_bits).collect()),
            ElementType::I8 => Self::I8(narrow(element, small)?),
            ElementType::U8 => Self::U8(narrow(element, small)?),
            ElementType::I16 => Self::I16(narrow(element, small)?),
            ElementType::U16 => Self::U16(narrow(element, small)?),
            ElementType::I32 => Self::I32(tensor.int32_data.clone()),
            ElementType::U32 => Self::U32(narrow(element, &tensor.uint64_data)?),
            ElementType::I64 => Self::I64(tensor.int64_data.clone()),
            ElementType::U64 => Self::U64(tensor.uint64_data.clone()),
            ElementType::Bool => Self::Bool(small.iter().map(|&i| i != 0).collect()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(dims: &[i64], values: &[f32]) -> TensorProto {
        TensorProto {
            dims: dims.to_vec(),
            data_type: Some(1),
            raw_data: Some(values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into()),
            name: Some("w".into()),
            ..Default::default()
        }
    }

    #[test]
    fn raw_and_typed_elements_are_the_same_tensor() {
        let values = [1.5_f32, -2.0, 0.0, 3e-20, 7.0, 8.0];
        let typed = TensorProto { float_data: values.to_vec(), raw_data: None, ..raw(&[2, 3], &values) };
        let from_raw = TypedTensor::read(&raw(&[2, 3], &values)).expect("raw");
        assert_eq!(from_raw, TypedTensor::read(&typed).expect("typed"), "two ways to store one tensor");
        assert_eq!(from_raw.to_f64().expect("floats")[3], f64::from(3e-20_f32), "f32 to f64 is exact");
    }

    #[test]
    fn every_type_is_read_from_its_own_field() {
        let stored = |element: ElementType| TensorProto {
            dims: vec![2],
            data_type: Some(element.number()),
            float_data: vec![0.5, -1.0],
            double_data: vec![0.25, -2.0],
            // 1.0 and −2.0 as f16 are these bits.
            int32_data: match element {
                ElementType::F16 => vec![0x3c00, 0xc000],
                ElementType::Bf16 => vec![0x3f80, 0xc000],
                _ => vec![1, 0],
            },
            int64_data: vec![-5, i64::MAX],
            uint64_data: vec![7, if element == ElementType::U32 { 1 << 31 } else { u64::MAX }],
            ..Default::default()
        };
        let expected = [
            Elements::F32(vec![0.5, -1.0]),
            Elements::F64(vec![0.25, -2.0]),
            Elements::F16(vec![f16::from_f32(1.0), f16::from_f32(-2.0)]),
            Elements::Bf16(vec![bf16::from_f32(1.0), bf16::from_f32(-2.0)]),
            Elements::I8(vec![1, 0]),
            Elements::U8(vec![1, 0]),
            Elements::I16(vec![1, 0]),
            Elements::U16(vec![1, 0]),
            Elements::I32(vec![1, 0]),
            Elements::U32(vec![7, 1 << 31]),
            Elements::I64(vec![-5, i64::MAX]),
            Elements::U64(vec![7, u64::MAX]),
            Elements::Bool(vec![true, false]),
        ];
        for (element, expected) in ElementType::ALL.into_iter().zip(expected) {
            let typed = TypedTensor::read(&stored(element)).expect("typed");
            assert_eq!(typed.elements, expected, "{element}");
            let raw = TensorProto { raw_data: Some(expected.to_bytes().into()), ..stored(element) };
            assert_eq!(TypedTensor::read(&raw), Ok(typed), "{element} from raw bytes");
        }
    }

    #[test]
    fn a_number_that_its_type_cannot_hold_is_refused() {
        let tensor = TensorProto {
            dims: vec![1],
            data_type: Some(ElementType::U8.number()),
            int32_data: vec![256],
            ..Default::default()
        };
        assert_eq!(TypedTensor::read(&tensor), Err("256 is stored as an u8".into()));
    }

    #[test]
    fn a_shape_that_promises_more_than_the_file_holds_is_refused() {
        for dims in [vec![2, 4], vec![1 << 40, 1 << 40], vec![-6], vec![5], vec![0, 1 << 40, 1 << 40]] {
            let message = TypedTensor::read(&raw(&dims, &[0.0; 6])).expect_err("refused");
            assert!(message.contains("shape"), "{message}");
        }
        let torn = TensorProto { raw_data: Some(vec![0; 25].into()), ..raw(&[6], &[0.0; 6]) };
        assert!(TypedTensor::read(&torn).is_err(), "a torn element");
    }

    #[test]
    fn elements_in_another_file_and_foreign_types_are_refused_by_name() {
        let mut outside = raw(&[1], &[0.0]);
        outside.data_location = Some(1);
        assert!(TypedTensor::read(&outside).expect_err("refused").contains("another file"), "external");
        let narrow = TensorProto { data_type: Some(17), ..raw(&[1], &[0.0]) };
        let message = TypedTensor::read(&narrow).expect_err("refused");
        assert!(message.contains("element type 17 (float8e4m3fn)"), "{message}");
    }
}

//! How much memory a file's messages will take, found from its bytes before any of them is made.
//!
//! Two bytes can stand for an empty message that takes three hundred in memory, so that a file of a few megabytes could
//! fill a machine. A graph with weights takes little more than its file, one of nothing but short nodes up to twenty-five
//! times as much.

use super::message::{
    AttributeProto, DimensionProto, FunctionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    SparseTensorProto, StringStringEntryProto, TensorProto, TensorShapeProto, TensorTypeProto, TypeProto,
    ValueInfoProto,
};

/// Messages may take this many times the file's length, and as much again while their lists grow.
pub const LARGEST_FACTOR: usize = 32;

/// Messages may lie in each other as deep as this, which is what prost reads.
const DEEPEST: usize = 100;

/// The messages that hold others, or that there can be many of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Attribute,
    Dimension,
    Function,
    Graph,
    Model,
    Node,
    Opset,
    Property,
    Shape,
    SparseTensor,
    Tensor,
    TensorType,
    Type,
    ValueInfo,
}

impl Kind {
    /// Bytes in memory, without what it points to.
    fn size(self) -> usize {
        match self {
            Self::Attribute => size_of::<AttributeProto>(),
            Self::Dimension => size_of::<DimensionProto>(),
            Self::Function => size_of::<FunctionProto>(),
            Self::Graph => size_of::<GraphProto>(),
            Self::Model => size_of::<ModelProto>(),
            Self::Node => size_of::<NodeProto>(),
            Self::Opset => size_of::<OperatorSetIdProto>(),
            Self::Property => size_of::<StringStringEntryProto>(),
            Self::Shape => size_of::<TensorShapeProto>(),
            Self::SparseTensor => size_of::<SparseTensorProto>(),
            Self::Tensor => size_of::<TensorProto>(),
            Self::TensorType => size_of::<TensorTypeProto>(),
            Self::Type => size_of::<TypeProto>(),
            Self::ValueInfo => size_of::<ValueInfoProto>(),
        }
    }

    /// The message that a field holds, if it holds one.
    fn field(self, tag: u64) -> Option<Self> {
        Some(match (self, tag) {
            (Self::Model, 7) | (Self::Attribute, 6 | 11) => Self::Graph,
            (Self::Model | Self::Function, 14)
            | (Self::Graph, 16)
            | (Self::Node, 9)
            | (Self::Tensor, 13 | 16)
            | (Self::ValueInfo, 4) => Self::Property,
            (Self::Model, 8) | (Self::Function, 9) => Self::Opset,
            (Self::Model, 25) => Self::Function,
            (Self::Graph, 1) | (Self::Function, 7) => Self::Node,
            (Self::Graph, 5) | (Self::Attribute, 5 | 10) | (Self::SparseTensor, 1 | 2) => Self::Tensor,
            (Self::Graph, 11..=13) | (Self::Function, 12) => Self::ValueInfo,
            (Self::Graph, 15) | (Self::Attribute, 22 | 23) => Self::SparseTensor,
            (Self::Node, 5) | (Self::Function, 11) => Self::Attribute,
            (Self::ValueInfo, 2) => Self::Type,
            (Self::Type, 1) => Self::TensorType,
            (Self::TensorType, 2) => Self::Shape,
            (Self::Shape, 1) => Self::Dimension,
            _ => return None,
        })
    }

    /// Bytes that a field of `length` bytes without messages takes.
    fn plain(self, tag: u64, length: usize) -> usize {
        match (self, tag) {
            // Shared with the file.
            (Self::Tensor, 9) => 0,
            (Self::Tensor, 4 | 10) | (Self::Attribute, 7) => length,
            // Integers of one byte or more become eight.
            (Self::Tensor, 1 | 5 | 7 | 11) | (Self::Attribute, 8) | (Self::SparseTensor, 3) => 8 * length,
            // A text in a list.
            _ => 32 + length,
        }
    }
}

/// Refuses bytes whose messages would take more than [`LARGEST_FACTOR`] times their length, that end too early, or whose
/// messages lie in each other too deep.
///
/// # Errors
/// With what was found.
pub fn check(bytes: &[u8]) -> Result<(), String> {
    let memory = memory(Kind::Model, bytes, 0)?;
    // A file of a few bytes may take a few kilobytes.
    let allowed = bytes.len().saturating_mul(LARGEST_FACTOR).saturating_add(1 << 16);
    if memory > allowed {
        let length = bytes.len();
        return Err(format!("its {length} bytes would take {memory} in memory, {allowed} are allowed"));
    }
    Ok(())
}

/// The bytes that a message and all that it holds will take.
fn memory(kind: Kind, mut bytes: &[u8], depth: usize) -> Result<usize, String> {
    if depth > DEEPEST {
        return Err(format!("its messages lie in each other deeper than {DEEPEST}"));
    }
    let mut memory = kind.size();
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let tag = key >> 3;
        memory += match key & 7 {
            0 => varint(&mut bytes).map(|_| 8)?,
            1 => taken(&mut bytes, 8).map(|_| 8)?,
            5 => taken(&mut bytes, 4).map(|_| 8)?,
            2 => {
                let length = varint(&mut bytes)?;
                let field = taken(&mut bytes, length)?;
                match kind.field(tag) {
                    Some(inner) => self::memory(inner, field, depth + 1)?,
                    None => kind.plain(tag, field.len()),
                }
            }
            wire => return Err(format!("not an ONNX model: field {tag} is of wire type {wire}")),
        };
    }
    Ok(memory)
}

/// The first `length` bytes, which are then behind.
fn taken<'a>(bytes: &mut &'a [u8], length: u64) -> Result<&'a [u8], String> {
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    let (head, tail) = bytes.split_at_checked(length).ok_or_else(|| {
        format!("not an ONNX model, or cut off: a field of {length} bytes has {} left", bytes.len())
    })?;
    *bytes = tail;
    Ok(head)
}

/// A number in groups of seven bits, the lowest first.
fn varint(bytes: &mut &[u8]) -> Result<u64, String> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, tail) = bytes.split_first().ok_or("not an ONNX model, or cut off in a number")?;
        *bytes = tail;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err("not an ONNX model: a number of more than 64 bits".into())
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::*;

    /// A file with `inside` in the fields that lead to it from the model.
    fn wrapped(path: &[u64], inside: Vec<u8>) -> Vec<u8> {
        path.iter().rev().fold(inside, |inside, &tag| {
            let mut bytes = Vec::new();
            prost::encoding::encode_varint((tag << 3) | 2, &mut bytes);
            prost::encoding::encode_varint(inside.len() as u64, &mut bytes);
            bytes.extend(inside);
            bytes
        })
    }

    #[test]
    fn real_exports_are_far_from_the_limit() {
        for bytes in [
            &include_bytes!("../../tests/foreign/axis_angle_dynamo.onnx")[..],
            include_bytes!("../../tests/foreign/axis_angle_torchscript.onnx"),
            include_bytes!("../../tests/foreign/matrix_dynamo.onnx"),
        ] {
            let factor = memory(Kind::Model, bytes, 0).expect("a model") as f64 / bytes.len() as f64;
            assert!(factor < 0.25 * LARGEST_FACTOR as f64, "{factor} times its length");
        }
    }

    #[test]
    fn a_file_of_empty_messages_is_refused_before_they_are_made() {
        // From the model: nodes, attributes of a node, weights, tensors of an attribute, declared types, functions.
        for path in [&[7, 1][..], &[7, 1, 5], &[7, 5], &[7, 1, 5, 10], &[7, 13], &[25], &[25, 7]] {
            let (last, outer) = path.split_last().expect("a path");
            let empty = [((last << 3) | 2) as u8, 0, 0];
            let empty = if *last < 16 { vec![empty[0], 0] } else { vec![empty[0] | 0x80, 1, 0] };
            let bytes = wrapped(outer, empty.repeat(100_000));
            assert!(ModelProto::decode(&bytes[..]).is_ok(), "{path:?} is a model");
            assert!(check(&bytes).expect_err("refused").contains("in memory"), "{path:?}");
        }
    }

    #[test]
    fn messages_deeper_than_can_be_read_are_refused() {
        // A graph in an attribute of a node of a graph, and so on.
        let nested = |levels: usize| wrapped(&[&[7][..], &[1, 5, 6].repeat(levels)].concat(), Vec::new());
        assert_eq!(check(&nested(10)), Ok(()));
        for levels in [40, 10_000] {
            let bytes = nested(levels);
            assert!(check(&bytes).expect_err("refused").contains("deeper than 100"), "{levels}");
        }
    }

    #[test]
    fn a_file_that_is_cut_off_is_refused_wherever_it_is() {
        let bytes = include_bytes!("../../tests/foreign/matrix_dynamo.onnx");
        for length in (1..bytes.len()).step_by(97) {
            // A cut between two fields of the model itself leaves a shorter model.
            let whole = ModelProto::decode(&bytes[..length]).is_ok();
            assert_eq!(check(&bytes[..length]).is_ok(), whole, "{length} bytes");
        }
    }
}

//! The ONNX container's messages, field for field; the tag numbers are those of `onnx.proto` (IR version 14).
//!
//! Every field that the container has is declared, so that a message read can be written again without loss. Those that
//! nothing here looks into are kept as the bytes that they are in the file.

mod graph;
mod tensor;
mod types;

pub use graph::{
    AttributeKind, AttributeProto, FunctionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto,
};
pub use tensor::{SparseTensorProto, TensorProto};
pub use types::{
    DimensionProto, DimensionValue, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto,
};

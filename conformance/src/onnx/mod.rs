//! The ONNX container: read for the weights and operators of a graph, written for graphs of a few nodes.
//!
//! | file | is |
//! |---|---|
//! | [`message`] | the container's messages, field for field |
//! | [`model`] | a file read and checked: operators, constants, properties |
//! | [`element`] | the types of elements, and what a float type holds |
//! | [`typed_tensor`] | a tensor with elements of their own type |
//! | `scan` | how much memory a file's messages will take |
//! | `structure` | every tensor has one maker, every node stands behind those that it reads |
//! | `inline` | functions that a file brings along, written out |
//! | `external` | elements that lie in other files |
//! | [`tensor_info`] | what a graph declares of a tensor |
//! | [`attributes`] | the attributes of a node, with defaults and nothing guessed |
//! | [`value`] | what a tensor of a graph holds |
//! | [`walk`] | the operators by the reference |
//! | [`builder`] | graphs built in memory, to run one operator alone |
//! | [`write`](mod@write) | nodes and constants as a file of their own |
//! | [`expose`] | the same file with every intermediate tensor as an output |

pub mod attributes;
pub mod builder;
pub mod element;
pub mod expose;
pub(crate) mod external;
mod inline;
pub mod message;
pub mod model;
mod scan;
mod structure;
pub mod tensor_info;
pub mod typed_tensor;
pub mod value;
pub mod walk;
pub mod write;

pub use structure::reads;

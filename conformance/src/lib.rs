//! The judge: proves, number by number, that the runtime computes what the reference defines.

pub mod array;
pub mod certificate;
pub mod compare;
pub mod convert;
pub mod engine;
pub mod error;
pub mod onnx;
pub mod problem;
pub mod suite;
pub mod tolerance;

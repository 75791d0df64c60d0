//! The judge: proves, number by number, that the runtime computes what the reference defines.

pub mod certificate;
pub mod compare;
pub mod error;
pub mod onnx;

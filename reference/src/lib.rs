//! The systems of Li 2021, written to be read and trusted: f64, no dependencies, no unsafe code, no threads.

pub mod body;
pub mod camera;
pub mod linalg;
pub mod loss;
pub mod metric;
pub mod network;
pub mod nn;
pub mod rotation;
pub mod surface;

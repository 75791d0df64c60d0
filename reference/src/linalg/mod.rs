//! Small linear algebra: three-vectors, 3×3 matrices, and the dense factorisations that the solvers need.
//!
//! Plain arrays and free functions: a reader sees the numbers, and nothing has to be imported to index them.

pub mod dense;
pub mod matrix;
pub mod vector;

//! Small linear algebra: three-vectors, 3×3 matrices, and the dense factorisations that the solvers need.
//!
//! Plain arrays and free functions: a reader sees the numbers, and nothing has to be imported to index them.
//!
//! | module | what |
//! |---|---|
//! | [`vector`], [`matrix`] | ℝ³ and its linear maps |
//! | [`dense`] | matrices of any size, row-major |
//! | [`cholesky`] | A x = b for symmetric positive definite A: normal equations |
//! | [`qr`] | least squares by Householder reflections: what normal equations would square away |
//! | [`complete_orthogonal`] | the shortest least-squares solution where columns depend on each other |
//! | [`svd`] | the singular values of a 3×3 matrix: Procrustes alignment, the nearest rotation |

pub mod cholesky;
pub mod complete_orthogonal;
pub mod dense;
pub mod matrix;
pub mod qr;
pub mod svd;
pub mod vector;

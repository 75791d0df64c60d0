//! Linear algebra: three-vectors, 3×3 matrices, and the dense and sparse factorisations that the solvers need.
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
//! | [`sparse`] | matrices of which only the non-zeros are stored |
//! | [`minimum_degree`](mod@minimum_degree), [`sparse_cholesky`] | A x = b for large sparse A: the order of elimination, the factor |
//! | [`conjugate_gradient`] | A x = b for A known by its products |
//! | [`svd`] | the singular values of a 3×3 matrix: Procrustes alignment, the nearest rotation |

pub mod cholesky;
pub mod complete_orthogonal;
pub mod conjugate_gradient;
pub mod dense;
pub mod matrix;
pub mod minimum_degree;
pub mod qr;
pub mod sparse;
pub mod sparse_cholesky;
pub mod svd;
pub mod vector;

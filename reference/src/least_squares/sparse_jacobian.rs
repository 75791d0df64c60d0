//! Sparse Jacobians: three ways to the Gauss–Newton step.

use super::problem::Jacobian;
use crate::linalg::conjugate_gradient::ConjugateGradient;
use crate::linalg::sparse::Sparse;
use crate::linalg::sparse_cholesky::SymbolicCholesky;
use std::sync::Arc;

/// A sparse Jacobian and how to solve its normal equations.
#[derive(Clone, Debug)]
pub struct SparseJacobian {
    /// J, m×n.
    pub matrix: Sparse,
    /// The way to JᵀJ d = g.
    pub method: NormalEquations,
}

/// How to solve JᵀJ d = g.
#[derive(Clone, Debug)]
pub enum NormalEquations {
    /// By [`crate::linalg::sparse_cholesky`]; if JᵀJ is not positive definite in f64, by conjugate gradients.
    Cholesky,
    /// The same, with the analysis of a JᵀJ of the same pattern at hand; it is what takes longest.
    AnalyzedCholesky(Arc<SymbolicCholesky>),
    /// By conjugate gradients: JᵀJ is never formed. For a J whose JᵀJ is full, or would fill.
    ConjugateGradient(ConjugateGradient),
}

impl From<Sparse> for SparseJacobian {
    fn from(matrix: Sparse) -> SparseJacobian {
        SparseJacobian { matrix, method: NormalEquations::Cholesky }
    }
}

impl Jacobian for SparseJacobian {
    fn apply(&self, d: &[f64]) -> Vec<f64> {
        self.matrix.apply(d)
    }

    fn apply_transposed(&self, r: &[f64]) -> Vec<f64> {
        self.matrix.apply_transposed(r)
    }

    /// By the method chosen.
    ///
    /// Conjugate gradients run without preconditioner, so that a singular JᵀJ gives the shortest step. If they end early,
    /// what they have is still a direction of descent: the model falls with each of their steps.
    fn gauss_newton_step(&self, gradient: &[f64]) -> Vec<f64> {
        let factor = match &self.method {
            NormalEquations::Cholesky => {
                let gram = self.matrix.gram();
                SymbolicCholesky::analyze(&gram).factor(&gram)
            }
            NormalEquations::AnalyzedCholesky(symbolic) => symbolic.factor(&self.matrix.gram()),
            NormalEquations::ConjugateGradient(method) => {
                return self.step_by_conjugate_gradients(method, gradient);
            }
        };
        match factor {
            Some(factor) => factor.solve(gradient),
            None => self.step_by_conjugate_gradients(&ConjugateGradient::default(), gradient),
        }
    }
}

impl SparseJacobian {
    fn step_by_conjugate_gradients(&self, method: &ConjugateGradient, gradient: &[f64]) -> Vec<f64> {
        let operator = |d: &[f64]| self.matrix.apply_transposed(&self.matrix.apply(d));
        method.solve(operator, |r| r.to_vec(), gradient).x
    }
}

impl Jacobian for Sparse {
    fn apply(&self, d: &[f64]) -> Vec<f64> {
        Sparse::apply(self, d)
    }

    fn apply_transposed(&self, r: &[f64]) -> Vec<f64> {
        Sparse::apply_transposed(self, r)
    }

    /// By [`NormalEquations::Cholesky`].
    fn gauss_newton_step(&self, gradient: &[f64]) -> Vec<f64> {
        SparseJacobian::from(self.clone()).gauss_newton_step(gradient)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::dense::Dense;

    /// Differences along a chain of seven, its ends also known: J of a smoothing.
    fn chain(ends: f64) -> (Sparse, Dense) {
        let mut triplets: Vec<_> =
            (0..6).flat_map(|i| [(i, i, -1.0), (i, i + 1, 1.0 + 0.1 * i as f64)]).collect();
        triplets.extend([(6, 0, ends), (7, 6, ends)]);
        let mut dense = Dense::zeros(8, 7);
        triplets.iter().for_each(|&(r, c, v)| dense[(r, c)] += v);
        (Sparse::from_triplets(8, 7, &triplets), dense)
    }

    fn methods(matrix: &Sparse) -> [NormalEquations; 3] {
        [
            NormalEquations::Cholesky,
            NormalEquations::AnalyzedCholesky(SymbolicCholesky::analyze(&matrix.gram())),
            NormalEquations::ConjugateGradient(ConjugateGradient::default()),
        ]
    }

    #[test]
    fn every_method_gives_the_step_of_the_dense_jacobian() {
        // With known ends the step is unique; without, the shortest is meant.
        for ends in [2.0, 0.0] {
            let (matrix, dense) = chain(ends);
            let gradient = dense.apply_transposed(&[1.0, 0.5, -2.0, 0.0, 3.0, 1.0, -1.0, 4.0]);
            let expected = dense.gauss_newton_step(&gradient);
            for method in methods(&matrix) {
                let jacobian = SparseJacobian { matrix: matrix.clone(), method };
                let found = jacobian.gauss_newton_step(&gradient);
                for (found, expected) in found.iter().zip(&expected) {
                    assert!((found - expected).abs() < 1e-8, "{:?}: {found} for {expected}", jacobian.method);
                }
            }
        }
    }
}

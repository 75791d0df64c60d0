//! The derivative of a shape stage, and its Gauss–Newton step by preconditioned conjugate gradients.
//!
//! The unknowns are B betas and 3V offsets. Each robust residual knows one vertex and all betas; the
//! [regulariser](super::regulariser) knows the offsets, ω_β I the betas. JᵀJ is never formed: conjugate gradients only ask for J d and Jᵀ r. Their preconditioner is
//! the block diagonal of
//!
//! * M ⊗ I₃ with M = ω_L² LᵀK²L + ω_B² K² + diag(h), K = diag(κ), factored once a stage by sparse Cholesky as a V×V matrix: h_i is the mean
//!   of the data's 3×3 block at vertex i;
//! * the B×B block of the betas.
//!
//! Few vertices are matched, and their blocks are not far from multiples of the identity, so a dozen steps do. The step is
//! solved to 10⁻³ of its right-hand side: the dogleg judges every step by the energy, and asks no more of it.

use super::regulariser::Regulariser;
use super::shape_problem::Weights;
use crate::least_squares::Jacobian;
use crate::linalg::cholesky::Cholesky;
use crate::linalg::conjugate_gradient::ConjugateGradient;
use crate::linalg::dense::Dense;
use crate::linalg::sparse::Sparse;
use crate::linalg::sparse_cholesky::SparseCholesky;
use crate::linalg::vector::{Vector3, norm_squared};
use std::rc::Rc;

/// ‖b − A d‖/‖b‖ at which a Gauss–Newton step is good enough.
const STEP_TOLERANCE: f64 = 1e-3;
/// Steps of conjugate gradients at most.
const STEP_LIMIT: usize = 60;

/// The derivatives of the robust residuals.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Rows {
    /// The vertex whose offset each residual feels, and the derivative by that offset.
    pub by_offset: Vec<(usize, Vector3)>,
    /// By the betas: B numbers for each residual.
    pub by_betas: Vec<f64>,
}

/// M⁻¹ for a stage's offsets.
#[derive(Clone, Debug)]
pub struct Preconditioner(Rc<SparseCholesky>);

impl Preconditioner {
    /// Factors M; see the module.
    ///
    /// # Panics
    /// If ω_B is not positive: M may then be singular.
    pub fn new(regulariser: &Regulariser, weights: &Weights, rows: &Rows) -> Preconditioner {
        assert!(
            weights.model > 0.0,
            "Preconditioner: ω_B = {} leaves rigid motions of the offsets free",
            weights.model
        );
        let n = regulariser.vertex_count();
        let mut data = vec![0.0; n];
        for (vertex, derivative) in &rows.by_offset {
            data[*vertex] += norm_squared(*derivative) / 3.0;
        }
        let entries: Vec<(usize, usize, f64)> =
            data.into_iter().enumerate().map(|(i, d)| (i, i, d)).collect();
        let data = Sparse::from_triplets(n, n, &entries);
        let matrix = Sparse::combination(1.0, &regulariser.gram(weights), 1.0, &data);
        let factor =
            regulariser.ordering(&matrix).factor(&matrix).expect("a Gram matrix and a positive diagonal");
        Preconditioner(Rc::new(factor))
    }

    /// M⁻¹ ⊗ I₃ applied to 3V numbers.
    fn solve(&self, r: &[f64]) -> Vec<f64> {
        let points: Vec<Vector3> = r.chunks_exact(3).map(|r| [r[0], r[1], r[2]]).collect();
        self.0.solve_many(&points).into_iter().flatten().collect()
    }
}

/// J of a [shape stage](super::shape_problem).
#[derive(Clone, Debug)]
pub struct ShapeJacobian {
    betas: usize,
    rows: Rows,
    /// None: the offsets are not free.
    regulariser: Option<Regulariser>,
    weights: Weights,
    preconditioner: Option<Preconditioner>,
    /// JᵀJ of the betas alone.
    betas_factor: Option<Cholesky>,
}

impl ShapeJacobian {
    /// J with B = `betas`, the robust rows, and, if offsets are free, their regulariser and preconditioner.
    pub fn new(
        betas: usize,
        rows: Rows,
        regulariser: Option<Regulariser>,
        weights: Weights,
        preconditioner: Option<Preconditioner>,
    ) -> ShapeJacobian {
        let mut gram = Dense::zeros(betas, betas);
        for row in rows.by_betas.chunks_exact(betas.max(1)) {
            for k in 0..betas {
                for l in 0..=k {
                    gram[(k, l)] += row[k] * row[l];
                }
            }
        }
        for k in 0..betas {
            gram[(k, k)] += weights.shape * weights.shape;
        }
        let betas_factor = Cholesky::factor(&gram);
        ShapeJacobian { betas, rows, regulariser, weights, preconditioner, betas_factor }
    }

    fn row_by_betas(&self, n: usize) -> &[f64] {
        &self.rows.by_betas[n * self.betas..(n + 1) * self.betas]
    }

    fn precondition(&self, r: &[f64]) -> Vec<f64> {
        let (betas, offsets) = r.split_at(self.betas);
        let mut z = match &self.betas_factor {
            Some(factor) => factor.solve(betas),
            None => betas.to_vec(),
        };
        match &self.preconditioner {
            Some(preconditioner) => z.extend(preconditioner.solve(offsets)),
            None => z.extend(offsets),
        }
        z
    }
}

impl Jacobian for ShapeJacobian {
    fn apply(&self, d: &[f64]) -> Vec<f64> {
        let (betas, offsets) = d.split_at(self.betas);
        let mut image = Vec::with_capacity(self.rows.by_offset.len() + 2 * d.len());
        for (n, (vertex, derivative)) in self.rows.by_offset.iter().enumerate() {
            let by_betas: f64 = self.row_by_betas(n).iter().zip(betas).map(|(a, d)| a * d).sum();
            let by_offset: f64 = match offsets.get(3 * vertex..3 * vertex + 3) {
                Some(d) => derivative.iter().zip(d).map(|(a, d)| a * d).sum(),
                None => 0.0,
            };
            image.push(by_betas + by_offset);
        }
        if let Some(regulariser) = &self.regulariser {
            image.extend(regulariser.apply(&self.weights, offsets));
        }
        image.extend(betas.iter().map(|d| self.weights.shape * d));
        image
    }

    fn apply_transposed(&self, r: &[f64]) -> Vec<f64> {
        let (data, rest) = r.split_at(self.rows.by_offset.len());
        let (regularisers, shape) = rest.split_at(rest.len() - self.betas);
        let mut image: Vec<f64> = shape.iter().map(|r| self.weights.shape * r).collect();
        if let Some(regulariser) = &self.regulariser {
            image.extend(regulariser.apply_transposed(&self.weights, regularisers));
        }
        let (betas, offsets) = image.split_at_mut(self.betas);
        for (n, ((vertex, derivative), r)) in self.rows.by_offset.iter().zip(data).enumerate() {
            for (sum, a) in betas.iter_mut().zip(self.row_by_betas(n)) {
                *sum += a * r;
            }
            if let Some(sums) = offsets.get_mut(3 * vertex..3 * vertex + 3) {
                for (sum, a) in sums.iter_mut().zip(derivative) {
                    *sum += a * r;
                }
            }
        }
        image
    }

    fn gauss_newton_step(&self, gradient: &[f64]) -> Vec<f64> {
        let solver = ConjugateGradient { tolerance: STEP_TOLERANCE, max_iterations: STEP_LIMIT };
        let solution =
            solver.solve(|d| self.apply_transposed(&self.apply(d)), |r| self.precondition(r), gradient);
        solution.x
    }
}

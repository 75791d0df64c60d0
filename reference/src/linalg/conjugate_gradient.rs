//! Conjugate gradients: A x = b for a symmetric positive definite A that is known by its products.
//!
//! Each step minimises the energy ½ xᵀAx − bᵀx over x₀ + span(z₀, A z₀, A² z₀, …), where z = M⁻¹r is the residual seen
//! through the preconditioner M. The nearer M is to A, the fewer steps; with exact numbers n suffice, and as many as M⁻¹A
//! has distinct eigenvalues.
//!
//! # References
//! Hestenes, Stiefel 1952, "Methods of conjugate gradients for solving linear systems". Golub, Van Loan, "Matrix
//! Computations", the section on the preconditioned conjugate gradient method.

/// When to stop.
#[derive(Clone, Debug, PartialEq)]
pub struct ConjugateGradient {
    /// Stop when ‖b − A x‖ is at most this fraction of ‖b‖; 10⁻¹⁰.
    pub tolerance: f64,
    /// The most products with A.
    pub max_iterations: usize,
}

impl Default for ConjugateGradient {
    fn default() -> ConjugateGradient {
        ConjugateGradient { tolerance: 1e-10, max_iterations: 1000 }
    }
}

/// Where the steps ended, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct ConjugateGradientSolution {
    /// The last x.
    pub x: Vec<f64>,
    /// ‖b − A x‖ / ‖b‖, as the recurrence has it.
    pub relative_residual: f64,
    /// Products with A.
    pub iterations: usize,
    /// Why it ended.
    pub ending: ConjugateGradientEnding,
}

/// Why conjugate gradients ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ConjugateGradientEnding {
    /// The residual is small enough.
    SmallResidual,
    /// As many iterations as allowed were made.
    IterationLimit,
    /// pᵀAp ≤ 0 or rᵀM⁻¹r ≤ 0 for some vector: A or M is not positive definite as far as f64 can tell, or a number is not
    /// finite. x is the last one before.
    NotPositiveDefinite,
}

impl ConjugateGradient {
    /// Solves A x = b from x = 0. `operator` is x ↦ A x, `preconditioner` is r ↦ M⁻¹ r; `|r| r.to_vec()` is none.
    ///
    /// If A is singular and b in its range, x without preconditioner is the shortest solution: all steps are in that range.
    pub fn solve(
        &self,
        operator: impl Fn(&[f64]) -> Vec<f64>,
        preconditioner: impl Fn(&[f64]) -> Vec<f64>,
        b: &[f64],
    ) -> ConjugateGradientSolution {
        use ConjugateGradientEnding::*;
        let mut x = vec![0.0; b.len()];
        let mut residual = b.to_vec();
        let b_norm = dot(b, b).sqrt();
        let mut direction = vec![0.0; b.len()];
        let mut rho_before = f64::INFINITY;
        let mut iterations = 0;
        let ending = loop {
            if dot(&residual, &residual).sqrt() <= self.tolerance * b_norm {
                break SmallResidual;
            }
            if iterations >= self.max_iterations {
                break IterationLimit;
            }
            let z = preconditioner(&residual);
            let rho = dot(&residual, &z);
            if rho.is_nan() || rho <= 0.0 {
                break NotPositiveDefinite;
            }
            // Conjugate to all directions before, because it is to the last.
            let beta = rho / rho_before;
            for (p, z) in direction.iter_mut().zip(&z) {
                *p = z + beta * *p;
            }
            let image = operator(&direction);
            iterations += 1;
            let curvature = dot(&direction, &image);
            if curvature.is_nan() || curvature <= 0.0 {
                break NotPositiveDefinite;
            }
            let alpha = rho / curvature;
            for k in 0..b.len() {
                x[k] += alpha * direction[k];
                residual[k] -= alpha * image[k];
            }
            rho_before = rho;
        };
        let relative_residual = if b_norm > 0.0 { dot(&residual, &residual).sqrt() / b_norm } else { 0.0 };
        ConjugateGradientSolution { x, relative_residual, iterations, ending }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::ConjugateGradientEnding::*;
    use super::*;
    use crate::linalg::sparse::Sparse;

    /// The second difference on n points, with `more` on the diagonal.
    fn chain(n: usize, more: f64) -> Sparse {
        let mut triplets: Vec<_> = (0..n).map(|i| (i, i, 2.0 + more)).collect();
        triplets.extend((1..n).flat_map(|i| [(i - 1, i, -1.0), (i, i - 1, -1.0)]));
        Sparse::from_triplets(n, n, &triplets)
    }

    fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn as_many_steps_as_unknowns_suffice() {
        let a = chain(12, 0.0);
        let x: Vec<f64> = (0..12).map(|i| (i as f64).cos()).collect();
        let solution = ConjugateGradient::default().solve(|d| a.apply(d), |r| r.to_vec(), &a.apply(&x));
        assert!(solution.ending == SmallResidual && solution.iterations <= 12, "{solution:?}");
        assert!(largest_difference(&solution.x, &x) < 1e-9);
    }

    #[test]
    fn exact_preconditioner_needs_one_step() {
        let a = chain(40, 0.1);
        let factor = crate::linalg::sparse_cholesky::SparseCholesky::factor(&a).expect("positive definite");
        let b: Vec<f64> = (0..40).map(|i| (i as f64).sin()).collect();
        let solution = ConjugateGradient::default().solve(|d| a.apply(d), |r| factor.solve(r), &b);
        assert_eq!((solution.iterations, solution.ending), (1, SmallResidual));
        assert!(largest_difference(&solution.x, &factor.solve(&b)) < 1e-14);
    }

    #[test]
    fn singular_system_gives_the_shortest_solution() {
        // A cycle's Laplacian: constants are in its kernel, so the shortest solution has mean 0.
        let n = 9;
        let triplets: Vec<_> =
            (0..n).flat_map(|i| [(i, i, 2.0), (i, (i + 1) % n, -1.0), (i, (i + n - 1) % n, -1.0)]).collect();
        let a = Sparse::from_triplets(n, n, &triplets);
        let x: Vec<f64> = (0..n).map(|i| (i as f64).powi(2)).collect();
        let mean = x.iter().sum::<f64>() / n as f64;
        let solution = ConjugateGradient::default().solve(|d| a.apply(d), |r| r.to_vec(), &a.apply(&x));
        assert_eq!(solution.ending, SmallResidual);
        assert!(largest_difference(&solution.x, &x.iter().map(|x| x - mean).collect::<Vec<_>>()) < 1e-9);
    }

    #[test]
    fn endings_say_what_happened() {
        let a = chain(50, 0.0);
        let ending = |method: ConjugateGradient, sign: f64, b: f64| {
            let operator = |d: &[f64]| a.apply(d).iter().map(|y| sign * y).collect();
            method.solve(operator, |r| r.to_vec(), &[b; 50])
        };
        let short = ConjugateGradient { max_iterations: 3, ..ConjugateGradient::default() };
        assert_eq!(ending(short, 1.0, 1.0).ending, IterationLimit);
        assert_eq!(ending(ConjugateGradient::default(), -1.0, 1.0).ending, NotPositiveDefinite);
        assert_eq!(ending(ConjugateGradient::default(), f64::NAN, 1.0).ending, NotPositiveDefinite);
        assert_eq!(ending(ConjugateGradient::default(), 1.0, f64::NAN).ending, NotPositiveDefinite);
        let nothing = ending(ConjugateGradient::default(), 1.0, 0.0);
        assert_eq!((nothing.ending, nothing.iterations, nothing.x), (SmallResidual, 0, vec![0.0; 50]));
    }
}

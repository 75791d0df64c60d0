//! Laws of least squares: planted answers, the region of trust, and sparse against dense.

use proptest::prelude::*;
use vitruvian_reference::least_squares::finite_difference::worst_difference;
use vitruvian_reference::least_squares::{Dogleg, Jacobian, Problem, Trial};
use vitruvian_reference::linalg::complete_orthogonal::CompleteOrthogonal;
use vitruvian_reference::linalg::conjugate_gradient::{ConjugateGradient, ConjugateGradientEnding};
use vitruvian_reference::linalg::dense::Dense;
use vitruvian_reference::linalg::minimum_degree::minimum_degree;
use vitruvian_reference::linalg::sparse::Sparse;
use vitruvian_reference::linalg::sparse_cholesky::SparseCholesky;

/// r = sin-bent lines: A x + bend · sin(B x) − c. Linear for bend 0.
#[derive(Clone, Debug)]
struct Bent {
    a: Dense,
    b: Dense,
    c: Vec<f64>,
    bend: f64,
}

impl Problem for Bent {
    type Jacobian = Dense;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        let waves = self.b.apply(x);
        let lines = self.a.apply(x).into_iter().zip(&self.c);
        Some(lines.zip(waves).map(|((ax, c), w)| ax + self.bend * w.sin() - c).collect())
    }

    fn jacobian(&self, x: &[f64]) -> Dense {
        let waves = self.b.apply(x);
        let mut jacobian = self.a.clone();
        for i in 0..self.a.rows() {
            for j in 0..self.a.columns() {
                jacobian[(i, j)] += self.bend * waves[i].cos() * self.b[(i, j)];
            }
        }
        jacobian
    }
}

fn dense(m: usize, n: usize) -> impl Strategy<Value = Dense> {
    prop::collection::vec(-1.0..1.0f64, m * n).prop_map(move |data| Dense::new(m, n, data))
}

fn bent(bend: impl Strategy<Value = f64> + Clone) -> impl Strategy<Value = (Bent, Vec<f64>)> {
    (1..6usize, 0..6usize).prop_flat_map(move |(n, more)| {
        let m = n + more;
        let start = prop::collection::vec(-3.0..3.0f64, n);
        (dense(m, n), dense(m, n), prop::collection::vec(-3.0..3.0f64, m), bend.clone(), start)
            .prop_map(|(a, b, c, bend, start)| (Bent { a, b, c, bend }, start))
    })
}

/// Sparse matrices with duplicate triplets, empty rows and empty columns.
fn triplets() -> impl Strategy<Value = (usize, usize, Vec<(usize, usize, f64)>)> {
    (1..12usize, 1..12usize)
        .prop_flat_map(|(m, n)| (Just(m), Just(n), prop::collection::vec((0..m, 0..n, -2.0..2.0f64), 0..40)))
}

/// The same matrix in both forms.
fn both(m: usize, n: usize, triplets: &[(usize, usize, f64)]) -> (Sparse, Dense) {
    let mut dense = Dense::zeros(m, n);
    triplets.iter().for_each(|&(r, c, v)| dense[(r, c)] += v);
    (Sparse::from_triplets(m, n, triplets), dense)
}

fn full(a: &Sparse) -> Dense {
    let mut dense = Dense::zeros(a.rows(), a.columns());
    for r in 0..a.rows() {
        a.entries(r).for_each(|(c, v)| dense[(r, c)] = v);
    }
    dense
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|a| a * a).sum::<f64>().sqrt()
}

/// Whether the columns are far enough from dependent for tight tolerances: every pivot of Gram–Schmidt above `least`.
fn independent(a: &Dense, least: f64) -> bool {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for c in 0..a.columns() {
        let mut column: Vec<f64> = (0..a.rows()).map(|r| a[(r, c)]).collect();
        for b in &basis {
            let along: f64 = b.iter().zip(&column).map(|(b, x)| b * x).sum();
            column.iter_mut().zip(b).for_each(|(x, b)| *x -= along * b);
        }
        let length = norm(&column);
        if length < least {
            return false;
        }
        basis.push(column.iter().map(|x| x / length).collect());
    }
    true
}

proptest! {
    #[test]
    fn linear_problems_are_solved_by_the_first_step((problem, start) in bent(Just(0.0))) {
        prop_assume!(independent(&problem.a, 0.05));
        let mut first: Option<(Vec<f64>, bool)> = None;
        let solution = Dogleg::default().minimize_traced(&problem, &start, &mut |t: &Trial| {
            first.get_or_insert((t.x.to_vec(), t.accepted));
        });
        prop_assert!(solution.termination.was_successful());
        if let Some((x, accepted)) = first {
            let planted = problem.a.gauss_newton_step(&problem.a.apply_transposed(&problem.c));
            prop_assert!(difference(&x, &planted) < 1e-9, "{x:?} for {planted:?}");
            prop_assert!(accepted || difference(&start, &planted) < 1e-6);
        }
    }

    #[test]
    fn steps_stay_in_the_region_and_the_energy_falls((problem, start) in bent(0.0..4.0f64), radius in 0.01..10.0f64) {
        let mut region = radius;
        let mut energy = norm(&problem.residuals(&start).expect("defined everywhere")).powi(2);
        let mut violation = None;
        let dogleg = Dogleg { initial_radius: Some(radius), ..Dogleg::default() };
        let solution = dogleg.minimize_traced(&problem, &start, &mut |t: &Trial| {
            if t.step_norm > region * (1.0 + 1e-12) {
                violation = Some(format!("a step of {} in a region of {region}", t.step_norm));
            }
            if t.accepted != (t.energy < energy) {
                violation = Some(format!("energy {energy} to {}, accepted: {}", t.energy, t.accepted));
            }
            if t.accepted {
                energy = t.energy;
            }
            region = t.radius;
        });
        prop_assert_eq!(violation, None);
        prop_assert_eq!(solution.energy, energy);
        let found = norm(&problem.residuals(&solution.x).expect("defined everywhere")).powi(2);
        prop_assert!((found - energy).abs() <= 1e-12 * energy.max(1e-300));
    }

    #[test]
    fn trace_counts_what_the_solution_counts((problem, start) in bent(0.0..4.0f64)) {
        let (mut trials, mut accepted) = (0, 0);
        let solution = Dogleg::default().minimize_traced(&problem, &start, &mut |t: &Trial| {
            trials += 1;
            accepted += usize::from(t.accepted);
        });
        prop_assert_eq!(solution.evaluations, trials + 1);
        // The last iteration may end without having found anything to accept.
        prop_assert!(solution.iterations == accepted || solution.iterations == accepted + 1);
        prop_assert_eq!(&solution, &Dogleg::default().minimize(&problem, &start));
    }

    #[test]
    fn differences_agree_with_right_jacobians((problem, x) in bent(0.0..4.0f64)) {
        let worst = worst_difference(&problem, &x).expect("defined everywhere");
        prop_assert!(worst.relative < 1e-8, "{worst}");
    }

    #[test]
    fn planted_linear_answer_is_found_at_any_rank(
        left in dense(9, 3), right in dense(3, 6), x in prop::collection::vec(-1.0..1.0f64, 6),
    ) {
        prop_assume!(independent(&left, 0.2));
        let mut a = Dense::zeros(9, 6);
        for i in 0..9 {
            for j in 0..6 {
                a[(i, j)] = (0..3).map(|k| left[(i, k)] * right[(k, j)]).sum();
            }
        }
        let decomposition = CompleteOrthogonal::factor(&a);
        prop_assert!(decomposition.rank() <= 3);
        let image = a.apply(&x);
        let found = decomposition.solve_normal_equations(&a.apply_transposed(&image));
        // It explains the image as well as the planted one, and is no longer.
        prop_assert!(difference(&a.apply(&found), &image) < 1e-7);
        prop_assert!(norm(&found) <= norm(&x) * (1.0 + 1e-7));
    }

    #[test]
    fn sparse_products_are_those_of_the_dense_matrix(
        (m, n, triplets) in triplets(), x in prop::collection::vec(-1.0..1.0f64, 12),
        weights in prop::collection::vec(0.0..2.0f64, 12),
    ) {
        let (sparse, dense) = both(m, n, &triplets);
        prop_assert!(difference(&sparse.apply(&x[..n]), &dense.apply(&x[..n])) < 1e-13);
        prop_assert!(difference(&sparse.apply_transposed(&x[..m]), &dense.apply_transposed(&x[..m])) < 1e-13);
        prop_assert!(difference(&sparse.transposed().apply(&x[..m]), &dense.apply_transposed(&x[..m])) < 1e-13);

        let gram = sparse.weighted_gram(&weights[..m]);
        prop_assert_eq!(&gram, &gram.transposed(), "symmetric to the last bit");
        let mut scaled = dense.clone();
        for i in 0..m {
            scaled.row_mut(i).iter_mut().for_each(|a| *a *= weights[i].sqrt());
        }
        let (found, expected) = (full(&gram), scaled.gram());
        for i in 0..n {
            prop_assert!(difference(found.row(i), expected.row(i)) < 1e-12);
        }
    }

    #[test]
    fn sparse_systems_have_one_answer(
        (m, n, triplets) in triplets(), damping in 0.1..2.0f64, x in prop::collection::vec(-1.0..1.0f64, 12),
    ) {
        let (sparse, _) = both(m, n, &triplets);
        let a = Sparse::combination(1.0, &sparse.gram(), damping, &Sparse::identity(n));
        let x = &x[..n];
        let b = a.apply(x);
        let factor = SparseCholesky::factor(&a).expect("damped");
        // The condition is at most 1 + 40·2²·12/0.1.
        prop_assert!(difference(&factor.solve(&b), x) < 1e-10);
        let solution = ConjugateGradient { tolerance: 1e-13, max_iterations: 500 }
            .solve(|d| a.apply(d), |r| r.to_vec(), &b);
        prop_assert_eq!(solution.ending, ConjugateGradientEnding::SmallResidual);
        prop_assert!(difference(&solution.x, x) < 1e-8);

        let mut order = minimum_degree(&a);
        order.sort_unstable();
        prop_assert_eq!(order, (0..n).collect::<Vec<_>>());
    }

    #[test]
    fn sparse_jacobians_step_as_dense_ones(
        (m, n, triplets) in triplets(), r in prop::collection::vec(-1.0..1.0f64, 12),
    ) {
        let (sparse, dense) = both(m, n, &triplets);
        let gradient = dense.apply_transposed(&r[..m]);
        // Of any rank. Both explain the residuals as well as can be, whether or not they differ where J is nearly singular.
        let explained = |d: &[f64]| difference(&dense.apply_transposed(&dense.apply(d)), &gradient);
        let scale = norm(&gradient).max(1.0);
        prop_assert!(explained(&dense.gauss_newton_step(&gradient)) < 1e-6 * scale);
        prop_assert!(explained(&Jacobian::gauss_newton_step(&sparse, &gradient)) < 1e-6 * scale);
    }
}

//! Problems 21 to 35: as many unknowns as one likes.

use super::case::{Case, Matrix};

pub fn cases() -> Vec<Case> {
    let one_to = |n: usize| (1..=n).map(|j| j as f64);
    let repeated = |part: &[f64], times: usize| part.repeat(times);
    let parabola =
        |n: usize| -> Vec<f64> { one_to(n).map(|j| j / (n as f64 + 1.0)).map(|t| t * (t - 1.0)).collect() };
    let nodes = |n: usize| -> Vec<f64> { one_to(n).map(|j| j / (n as f64 + 1.0)).collect() };
    let (m, n) = (LINEAR_M as f64, 10);
    vec![
        Case::new(21, "Rosenbrock, extended, n = 20", &repeated(&[-1.2, 1.0], 10), extended_rosenbrock)
            .zero(),
        Case::new(
            22,
            "Powell, singular, extended, n = 20",
            &repeated(&[3.0, -1.0, 0.0, 1.0], 5),
            extended_powell,
        )
        .zero(),
        Case::new(23, "Penalty I, n = 4", &one_to(4).collect::<Vec<_>>(), penalty_1).minimum(2.24997e-5),
        Case::new(23, "Penalty I, n = 10", &one_to(10).collect::<Vec<_>>(), penalty_1).minimum(7.08765e-5),
        Case::new(24, "Penalty II, n = 4", &[0.5; 4], penalty_2).minimum(9.37629e-6),
        Case::new(24, "Penalty II, n = 10", &[0.5; 10], penalty_2).minimum(2.93660e-4),
        Case::new(
            25,
            "Variably dimensioned, n = 10",
            &one_to(n).map(|j| 1.0 - j / n as f64).collect::<Vec<_>>(),
            variably_dimensioned,
        )
        .zero(),
        Case::new(26, "Trigonometric, n = 10", &[0.1; 10], trigonometric).zero(),
        Case::new(26, "Trigonometric, n = 10, from 10 x₀", &[1.0; 10], trigonometric)
            .zero()
            .but_reaches(2.79506e-5),
        Case::new(27, "Brown, almost linear, n = 10", &[0.5; 10], brown_almost_linear).zero(),
        Case::new(27, "Brown, almost linear, n = 10, from 100 x₀", &[50.0; 10], brown_almost_linear)
            .zero()
            .but_reaches(1.0),
        Case::new(28, "Discrete boundary value, n = 10", &parabola(n), boundary_value).zero(),
        Case::new(29, "Discrete integral equation, n = 10", &parabola(n), integral_equation).zero(),
        Case::new(30, "Broyden, tridiagonal, n = 10", &[-1.0; 10], broyden_tridiagonal).zero(),
        Case::new(31, "Broyden, banded, n = 10", &[-1.0; 10], broyden_banded).zero(),
        Case::new(32, "Linear, full rank, n = 10, m = 20", &[1.0; 10], linear_full_rank)
            .minimum(m - n as f64),
        Case::new(33, "Linear, rank 1, n = 10, m = 20", &[1.0; 10], linear_rank_1)
            .minimum(m * (m - 1.0) / (2.0 * (2.0 * m + 1.0))),
        Case::new(34, "Linear, rank 1, zero columns, m = 20", &[1.0; 10], linear_rank_1_zeros)
            .minimum((m * m + 3.0 * m - 6.0) / (2.0 * (2.0 * m - 3.0))),
        Case::new(35, "Chebyquad, n = 7", &nodes(7), chebyquad).zero(),
        Case::new(35, "Chebyquad, n = 8", &nodes(8), chebyquad).minimum(3.51687e-3),
        Case::new(35, "Chebyquad, n = 9", &nodes(9), chebyquad).zero(),
        Case::new(35, "Chebyquad, n = 10", &nodes(10), chebyquad).minimum(6.50395e-3),
    ]
}

/// Equations of the linear problems.
const LINEAR_M: usize = 20;

/// A row with numbers at a few places.
fn row(n: usize, entries: &[(usize, f64)]) -> Vec<f64> {
    let mut row = vec![0.0; n];
    entries.iter().for_each(|&(j, a)| row[j] += a);
    row
}

fn extended_rosenbrock(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    (0..n / 2)
        .map(|k| (2 * k, 2 * k + 1))
        .flat_map(|(i, j)| {
            [
                (10.0 * (x[j] - x[i] * x[i]), row(n, &[(i, -20.0 * x[i]), (j, 10.0)])),
                (1.0 - x[i], row(n, &[(i, -1.0)])),
            ]
        })
        .unzip()
}

fn extended_powell(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let (a, b) = (5f64.sqrt(), 10f64.sqrt());
    (0..n / 4)
        .map(|k| 4 * k)
        .flat_map(|k| {
            let (p, q) = (x[k + 1] - 2.0 * x[k + 2], x[k] - x[k + 3]);
            [
                (x[k] + 10.0 * x[k + 1], row(n, &[(k, 1.0), (k + 1, 10.0)])),
                (a * (x[k + 2] - x[k + 3]), row(n, &[(k + 2, a), (k + 3, -a)])),
                (p * p, row(n, &[(k + 1, 2.0 * p), (k + 2, -4.0 * p)])),
                (b * q * q, row(n, &[(k, 2.0 * b * q), (k + 3, -2.0 * b * q)])),
            ]
        })
        .unzip()
}

fn penalty_1(x: &[f64]) -> (Vec<f64>, Matrix) {
    let (n, a) = (x.len(), 1e-5f64.sqrt());
    let sum: f64 = x.iter().map(|x| x * x).sum();
    (0..n)
        .map(|i| (a * (x[i] - 1.0), row(n, &[(i, a)])))
        .chain([(sum - 0.25, x.iter().map(|x| 2.0 * x).collect())])
        .unzip()
}

fn penalty_2(x: &[f64]) -> (Vec<f64>, Matrix) {
    let (n, a) = (x.len(), 1e-5f64.sqrt());
    let e = |i: usize| (x[i] / 10.0).exp();
    let weight = |j: usize| (n - j) as f64;
    let sum: f64 = (0..n).map(|j| weight(j) * x[j] * x[j]).sum();
    let pairs = (1..n).map(|i| {
        let y = ((i + 1) as f64 / 10.0).exp() + (i as f64 / 10.0).exp();
        (a * (e(i) + e(i - 1) - y), row(n, &[(i, a * e(i) / 10.0), (i - 1, a * e(i - 1) / 10.0)]))
    });
    let singles = (1..n).map(|i| (a * (e(i) - (-0.1f64).exp()), row(n, &[(i, a * e(i) / 10.0)])));
    [(x[0] - 0.2, row(n, &[(0, 1.0)]))]
        .into_iter()
        .chain(pairs)
        .chain(singles)
        .chain([(sum - 1.0, (0..n).map(|j| 2.0 * weight(j) * x[j]).collect())])
        .unzip()
}

fn variably_dimensioned(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let sum: f64 = (0..n).map(|j| (j + 1) as f64 * (x[j] - 1.0)).sum();
    (0..n)
        .map(|i| (x[i] - 1.0, row(n, &[(i, 1.0)])))
        .chain([
            (sum, (1..=n).map(|j| j as f64).collect()),
            (sum * sum, (1..=n).map(|j| 2.0 * sum * j as f64).collect()),
        ])
        .unzip()
}

fn trigonometric(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let cosines: f64 = x.iter().map(|x| x.cos()).sum();
    (0..n)
        .map(|i| {
            let weight = (i + 1) as f64;
            let mut row: Vec<f64> = x.iter().map(|x| x.sin()).collect();
            row[i] += weight * x[i].sin() - x[i].cos();
            (n as f64 - cosines + weight * (1.0 - x[i].cos()) - x[i].sin(), row)
        })
        .unzip()
}

fn brown_almost_linear(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let sum: f64 = x.iter().sum();
    let product_without = |i: usize| -> f64 { (0..n).filter(|&j| j != i).map(|j| x[j]).product() };
    (0..n - 1)
        .map(|i| {
            let mut row = vec![1.0; n];
            row[i] = 2.0;
            (x[i] + sum - (n as f64 + 1.0), row)
        })
        .chain([(x.iter().product::<f64>() - 1.0, (0..n).map(product_without).collect())])
        .unzip()
}

fn boundary_value(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let h = 1.0 / (n as f64 + 1.0);
    (0..n)
        .map(|i| {
            let c = x[i] + (i + 1) as f64 * h + 1.0;
            let mut residual = 2.0 * x[i] + h * h * c * c * c / 2.0;
            let mut row = row(n, &[(i, 2.0 + 1.5 * h * h * c * c)]);
            for j in [i.wrapping_sub(1), i + 1] {
                if j < n {
                    residual -= x[j];
                    row[j] = -1.0;
                }
            }
            (residual, row)
        })
        .unzip()
}

fn integral_equation(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let h = 1.0 / (n as f64 + 1.0);
    let t = |i: usize| (i + 1) as f64 * h;
    (0..n)
        .map(|i| {
            let mut residual = x[i];
            let mut row = row(n, &[(i, 1.0)]);
            for j in 0..n {
                let c = x[j] + t(j) + 1.0;
                let kernel = if j <= i { (1.0 - t(i)) * t(j) } else { t(i) * (1.0 - t(j)) };
                residual += h * kernel * c * c * c / 2.0;
                row[j] += 1.5 * h * kernel * c * c;
            }
            (residual, row)
        })
        .unzip()
}

fn broyden_tridiagonal(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    (0..n)
        .map(|i| {
            let mut residual = (3.0 - 2.0 * x[i]) * x[i] + 1.0;
            let mut row = row(n, &[(i, 3.0 - 4.0 * x[i])]);
            for (j, a) in [(i.wrapping_sub(1), -1.0), (i + 1, -2.0)] {
                if j < n {
                    residual += a * x[j];
                    row[j] = a;
                }
            }
            (residual, row)
        })
        .unzip()
}

fn broyden_banded(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    (0..n)
        .map(|i| {
            let mut residual = x[i] * (2.0 + 5.0 * x[i] * x[i]) + 1.0;
            let mut row = row(n, &[(i, 2.0 + 15.0 * x[i] * x[i])]);
            for j in (i.saturating_sub(5)..=(i + 1).min(n - 1)).filter(|&j| j != i) {
                residual -= x[j] * (1.0 + x[j]);
                row[j] = -1.0 - 2.0 * x[j];
            }
            (residual, row)
        })
        .unzip()
}

fn linear_full_rank(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let share = 2.0 / LINEAR_M as f64;
    let sum: f64 = x.iter().sum();
    (0..LINEAR_M)
        .map(|i| {
            let mut row = vec![-share; n];
            if i < n {
                row[i] += 1.0;
            }
            (x.get(i).unwrap_or(&0.0) - share * sum - 1.0, row)
        })
        .unzip()
}

fn linear_rank_1(x: &[f64]) -> (Vec<f64>, Matrix) {
    let sum: f64 = x.iter().enumerate().map(|(j, x)| (j + 1) as f64 * x).sum();
    (1..=LINEAR_M).map(|i| (i as f64 * sum - 1.0, (1..=x.len()).map(|j| (i * j) as f64).collect())).unzip()
}

fn linear_rank_1_zeros(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let weight = |j: usize| if j == 0 || j == n - 1 { 0.0 } else { (j + 1) as f64 };
    let sum: f64 = (0..n).map(|j| weight(j) * x[j]).sum();
    (0..LINEAR_M)
        .map(|i| if i == LINEAR_M - 1 { 0.0 } else { i as f64 })
        .map(|factor| (factor * sum - 1.0, (0..n).map(|j| factor * weight(j)).collect()))
        .unzip()
}

/// Chebyshev's polynomials shifted to [0, 1]; m = n.
fn chebyquad(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    // T_i(y), T_i′(y) by T_{i+1} = 2 y T_i − T_{i−1}, y = 2 x − 1.
    let mut before: Vec<(f64, f64)> = vec![(1.0, 0.0); n];
    let mut now: Vec<(f64, f64)> = x.iter().map(|x| (2.0 * x - 1.0, 1.0)).collect();
    let (mut residuals, mut rows) = (Vec::new(), Vec::new());
    for i in 1..=n {
        let integral = if i % 2 == 0 { -1.0 / ((i * i) as f64 - 1.0) } else { 0.0 };
        residuals.push(now.iter().map(|t| t.0).sum::<f64>() / n as f64 - integral);
        rows.push(now.iter().map(|t| 2.0 * t.1 / n as f64).collect());
        for j in 0..n {
            let y = 2.0 * x[j] - 1.0;
            let next = (2.0 * y * now[j].0 - before[j].0, 2.0 * now[j].0 + 2.0 * y * now[j].1 - before[j].1);
            (before[j], now[j]) = (now[j], next);
        }
    }
    (residuals, rows)
}

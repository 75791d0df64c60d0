//! Problems 1 to 12: two and three unknowns.

use super::case::{Case, Matrix};
use std::f64::consts::TAU;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(1, "Rosenbrock", &[-1.2, 1.0], rosenbrock).zero(),
        Case::new(2, "Freudenstein and Roth", &[0.5, -2.0], freudenstein_roth).zero().but_reaches(48.9842),
        Case::new(3, "Powell, badly scaled", &[0.0, 1.0], powell_badly_scaled).zero(),
        Case::new(4, "Brown, badly scaled", &[1.0, 1.0], brown_badly_scaled).zero(),
        Case::new(5, "Beale", &[1.0, 1.0], beale).zero(),
        Case::new(6, "Jennrich and Sampson", &[0.3, 0.4], jennrich_sampson).minimum(124.362),
        Case::new(7, "Helical valley", &[-1.0, 0.0, 0.0], helical_valley).zero(),
        Case::new(8, "Bard", &[1.0; 3], bard).minimum(8.21487e-3),
        Case::new(8, "Bard, from 10 x₀", &[10.0; 3], bard).minimum(8.21487e-3).but_reaches(17.4286),
        Case::new(9, "Gaussian", &[0.4, 1.0, 0.0], gaussian).minimum(1.12793e-8),
        Case::new(10, "Meyer", &[0.02, 4000.0, 250.0], meyer).minimum(87.9458),
        Case::new(11, "Gulf research", &[5.0, 2.5, 0.15], gulf).zero(),
        Case::new(12, "Box, three-dimensional", &[0.0, 10.0, 20.0], box_three).zero(),
    ]
}

fn rosenbrock(x: &[f64]) -> (Vec<f64>, Matrix) {
    (vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]], vec![vec![-20.0 * x[0], 10.0], vec![-1.0, 0.0]])
}

fn freudenstein_roth(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = x[1];
    (
        vec![-13.0 + x[0] + ((5.0 - y) * y - 2.0) * y, -29.0 + x[0] + ((y + 1.0) * y - 14.0) * y],
        vec![vec![1.0, (10.0 - 3.0 * y) * y - 2.0], vec![1.0, (3.0 * y + 2.0) * y - 14.0]],
    )
}

fn powell_badly_scaled(x: &[f64]) -> (Vec<f64>, Matrix) {
    let (e0, e1) = ((-x[0]).exp(), (-x[1]).exp());
    (vec![1e4 * x[0] * x[1] - 1.0, e0 + e1 - 1.0001], vec![vec![1e4 * x[1], 1e4 * x[0]], vec![-e0, -e1]])
}

fn brown_badly_scaled(x: &[f64]) -> (Vec<f64>, Matrix) {
    (vec![x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0], vec![vec![1.0, 0.0], vec![0.0, 1.0], vec![x[1], x[0]]])
}

fn beale(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = [1.5, 2.25, 2.625];
    (
        (1..=3).map(|i| y[i - 1] - x[0] * (1.0 - x[1].powi(i as i32))).collect(),
        (1..=3).map(|i| vec![x[1].powi(i) - 1.0, x[0] * i as f64 * x[1].powi(i - 1)]).collect(),
    )
}

fn jennrich_sampson(x: &[f64]) -> (Vec<f64>, Matrix) {
    let e = |i: i32, k: usize| (i as f64 * x[k]).exp();
    (
        (1..=10).map(|i| 2.0 + 2.0 * i as f64 - (e(i, 0) + e(i, 1))).collect(),
        (1..=10).map(|i| vec![-i as f64 * e(i, 0), -i as f64 * e(i, 1)]).collect(),
    )
}

fn helical_valley(x: &[f64]) -> (Vec<f64>, Matrix) {
    let theta = (x[1] / x[0]).atan() / TAU + if x[0] > 0.0 { 0.0 } else { 0.5 };
    let squared = x[0] * x[0] + x[1] * x[1];
    let (radius, c) = (squared.sqrt(), 100.0 / (TAU * squared));
    (
        vec![10.0 * (x[2] - 10.0 * theta), 10.0 * (radius - 1.0), x[2]],
        vec![
            vec![c * x[1], -c * x[0], 10.0],
            vec![10.0 * x[0] / radius, 10.0 * x[1] / radius, 0.0],
            vec![0.0, 0.0, 1.0],
        ],
    )
}

fn bard(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39];
    (1..=15)
        .map(|i| {
            let (u, v) = (i as f64, 16.0 - i as f64);
            let w = u.min(v);
            let below = v * x[1] + w * x[2];
            let slope = u / (below * below);
            (y[i - 1] - (x[0] + u / below), vec![-1.0, v * slope, w * slope])
        })
        .unzip()
}

fn gaussian(x: &[f64]) -> (Vec<f64>, Matrix) {
    let half = [0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989];
    (1..=15usize)
        .map(|i| {
            let d = (8.0 - i as f64) / 2.0 - x[2];
            let e = (-x[1] * d * d / 2.0).exp();
            (x[0] * e - half[i.min(16 - i) - 1], vec![e, -x[0] * e * d * d / 2.0, x[0] * e * x[1] * d])
        })
        .unzip()
}

fn meyer(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = [
        34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0, 8261.0, 7030.0, 6005.0,
        5147.0, 4427.0, 3820.0, 3307.0, 2872.0,
    ];
    (1..=16)
        .map(|i| {
            let below = 45.0 + 5.0 * i as f64 + x[2];
            let e = (x[1] / below).exp();
            (x[0] * e - y[i - 1], vec![e, x[0] * e / below, -x[0] * e * x[1] / (below * below)])
        })
        .unzip()
}

/// |yᵢ − x₂|; the report prints |yᵢ m i x₂|, a slip known since, with which (50, 25, 1.5) would be no solution. m = 99.
fn gulf(x: &[f64]) -> (Vec<f64>, Matrix) {
    (1..=99)
        .map(|i| {
            let t = i as f64 / 100.0;
            let d = 25.0 + (-50.0 * t.ln()).powf(2.0 / 3.0) - x[1];
            let p = d.abs().powf(x[2]);
            let e = (-p / x[0]).exp();
            (e - t, vec![e * p / (x[0] * x[0]), e * p * x[2] / (x[0] * d), -e * p * d.abs().ln() / x[0]])
        })
        .unzip()
}

/// m = 10.
fn box_three(x: &[f64]) -> (Vec<f64>, Matrix) {
    (1..=10)
        .map(|i| {
            let t = 0.1 * i as f64;
            let (e0, e1, u) = ((-t * x[0]).exp(), (-t * x[1]).exp(), (-t).exp() - (-10.0 * t).exp());
            (e0 - e1 - x[2] * u, vec![-t * e0, t * e1, -u])
        })
        .unzip()
}

//! Problems 13 to 20: four to twelve unknowns.

use super::case::{Case, Matrix};

pub fn cases() -> Vec<Case> {
    let osborne_2 = [1.3, 0.65, 0.65, 0.7, 0.6, 3.0, 5.0, 7.0, 2.0, 4.5, 5.5];
    vec![
        Case::new(13, "Powell, singular", &[3.0, -1.0, 0.0, 1.0], powell_singular).zero(),
        Case::new(14, "Wood", &[-3.0, -1.0, -3.0, -1.0], wood).zero(),
        Case::new(15, "Kowalik and Osborne", &[0.25, 0.39, 0.415, 0.39], kowalik_osborne).minimum(3.07505e-4),
        Case::new(15, "Kowalik and Osborne, from 10 x₀", &[2.5, 3.9, 4.15, 3.9], kowalik_osborne)
            .minimum(3.07505e-4)
            .but_reaches(1.02734e-3),
        Case::new(16, "Brown and Dennis", &[25.0, 5.0, -5.0, -1.0], brown_dennis).minimum(85822.2),
        Case::new(17, "Osborne 1", &[0.5, 1.5, -1.0, 0.01, 0.02], osborne_1).minimum(5.46489e-5),
        Case::new(18, "Biggs EXP6", &[1.0, 2.0, 1.0, 1.0, 1.0, 1.0], biggs).zero().but_creeps(0.2810),
        Case::new(18, "Biggs EXP6, from 10 x₀", &[10.0, 20.0, 10.0, 10.0, 10.0, 10.0], biggs)
            .zero()
            .but_reaches(5.65565e-3),
        Case::new(19, "Osborne 2", &osborne_2, self::osborne_2).minimum(4.01377e-2),
        Case::new(20, "Watson, n = 6", &[0.0; 6], watson).minimum(2.28767e-3),
        Case::new(20, "Watson, n = 9", &[0.0; 9], watson).minimum(1.39976e-6),
        Case::new(20, "Watson, n = 12", &[0.0; 12], watson).minimum(4.72238e-10),
    ]
}

fn powell_singular(x: &[f64]) -> (Vec<f64>, Matrix) {
    let (a, b) = (5f64.sqrt(), 10f64.sqrt());
    let (p, q) = (x[1] - 2.0 * x[2], x[0] - x[3]);
    (
        vec![x[0] + 10.0 * x[1], a * (x[2] - x[3]), p * p, b * q * q],
        vec![
            vec![1.0, 10.0, 0.0, 0.0],
            vec![0.0, 0.0, a, -a],
            vec![0.0, 2.0 * p, -4.0 * p, 0.0],
            vec![2.0 * b * q, 0.0, 0.0, -2.0 * b * q],
        ],
    )
}

fn wood(x: &[f64]) -> (Vec<f64>, Matrix) {
    let (a, b, c) = (90f64.sqrt(), 10f64.sqrt(), 0.1f64.sqrt());
    (
        vec![
            10.0 * (x[1] - x[0] * x[0]),
            1.0 - x[0],
            a * (x[3] - x[2] * x[2]),
            1.0 - x[2],
            b * (x[1] + x[3] - 2.0),
            c * (x[1] - x[3]),
        ],
        vec![
            vec![-20.0 * x[0], 10.0, 0.0, 0.0],
            vec![-1.0, 0.0, 0.0, 0.0],
            vec![0.0, 0.0, -2.0 * a * x[2], a],
            vec![0.0, 0.0, -1.0, 0.0],
            vec![0.0, b, 0.0, b],
            vec![0.0, c, 0.0, -c],
        ],
    )
}

fn kowalik_osborne(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246];
    let u = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625];
    y.iter()
        .zip(u)
        .map(|(y, u)| {
            let (above, below) = (u * u + u * x[1], u * u + u * x[2] + x[3]);
            let slope = x[0] * above / (below * below);
            (y - x[0] * above / below, vec![-above / below, -x[0] * u / below, u * slope, slope])
        })
        .unzip()
}

/// m = 20.
fn brown_dennis(x: &[f64]) -> (Vec<f64>, Matrix) {
    (1..=20)
        .map(|i| {
            let t = i as f64 / 5.0;
            let (p, q) = (x[0] + t * x[1] - t.exp(), x[2] + x[3] * t.sin() - t.cos());
            (p * p + q * q, vec![2.0 * p, 2.0 * p * t, 2.0 * q, 2.0 * q * t.sin()])
        })
        .unzip()
}

fn osborne_1(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = [
        0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658,
        0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431,
        0.424, 0.420, 0.414, 0.411, 0.406,
    ];
    y.iter()
        .enumerate()
        .map(|(i, y)| {
            let t = 10.0 * i as f64;
            let (e3, e4) = ((-t * x[3]).exp(), (-t * x[4]).exp());
            (y - (x[0] + x[1] * e3 + x[2] * e4), vec![-1.0, -e3, -e4, t * x[1] * e3, t * x[2] * e4])
        })
        .unzip()
}

/// m = 13, to which the published local minimum belongs.
///
/// At the standard start columns 1 and 5 of J, and 3 and 6, are equal: the first steps are the shortest of many, and another
/// choice goes elsewhere. The dogleg enters a valley in which x₃ goes to −∞ and x₆ to +∞ while x₅ comes to x₁, and the
/// energy falls ever more slowly: 0.28137 after 200 iterations, 0.28101 after 2000, 0.27876 after 100 000.
fn biggs(x: &[f64]) -> (Vec<f64>, Matrix) {
    (1..=13)
        .map(|i| {
            let t = 0.1 * i as f64;
            let y = (-t).exp() - 5.0 * (-10.0 * t).exp() + 3.0 * (-4.0 * t).exp();
            let (e0, e1, e4) = ((-t * x[0]).exp(), (-t * x[1]).exp(), (-t * x[4]).exp());
            (
                x[2] * e0 - x[3] * e1 + x[5] * e4 - y,
                vec![-t * x[2] * e0, t * x[3] * e1, e0, -e1, -t * x[5] * e4, e4],
            )
        })
        .unzip()
}

fn osborne_2(x: &[f64]) -> (Vec<f64>, Matrix) {
    let y = [
        1.366, 1.191, 1.112, 1.013, 0.991, 0.885, 0.831, 0.847, 0.786, 0.725, 0.746, 0.679, 0.608, 0.655,
        0.616, 0.606, 0.602, 0.626, 0.651, 0.724, 0.649, 0.649, 0.694, 0.644, 0.624, 0.661, 0.612, 0.558,
        0.533, 0.495, 0.500, 0.423, 0.395, 0.375, 0.372, 0.391, 0.396, 0.405, 0.428, 0.429, 0.523, 0.562,
        0.607, 0.653, 0.672, 0.708, 0.633, 0.668, 0.645, 0.632, 0.591, 0.559, 0.597, 0.625, 0.739, 0.710,
        0.729, 0.720, 0.636, 0.581, 0.428, 0.292, 0.162, 0.098, 0.054,
    ];
    y.iter()
        .enumerate()
        .map(|(i, y)| {
            let t = i as f64 / 10.0;
            let decay = (-t * x[4]).exp();
            let mut residual = y - x[0] * decay;
            let mut row = vec![0.0; 11];
            (row[0], row[4]) = (-decay, t * x[0] * decay);
            // Three bells: height x₂₊ₖ, sharpness x₆₊ₖ, place x₉₊ₖ.
            for k in 1..=3 {
                let d = t - x[7 + k];
                let e = (-d * d * x[4 + k]).exp();
                residual -= x[k] * e;
                (row[k], row[4 + k], row[7 + k]) = (-e, x[k] * d * d * e, -2.0 * x[k] * x[4 + k] * d * e);
            }
            (residual, row)
        })
        .unzip()
}

fn watson(x: &[f64]) -> (Vec<f64>, Matrix) {
    let n = x.len();
    let (mut residuals, mut rows): (Vec<f64>, Matrix) = (1..=29)
        .map(|i| {
            let t = i as f64 / 29.0;
            let value: f64 = (0..n).map(|j| x[j] * t.powi(j as i32)).sum();
            let slope: f64 = (1..n).map(|j| j as f64 * x[j] * t.powi(j as i32 - 1)).sum();
            let row =
                (0..n).map(|j| j as f64 * t.powi(j as i32 - 1) - 2.0 * value * t.powi(j as i32)).collect();
            (slope - value * value - 1.0, row)
        })
        .unzip();
    residuals.extend([x[0], x[1] - x[0] * x[0] - 1.0]);
    let mut row = vec![0.0; n];
    row[0] = 1.0;
    rows.push(row.clone());
    (row[0], row[1]) = (-2.0 * x[0], 1.0);
    rows.push(row);
    (residuals, rows)
}

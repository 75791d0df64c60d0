//! A mistake in one number, which is found from the numbers by Gauss and Newton's method.
//!
//! With outputs y(p) and found numbers f, minimise Σ ((f − y(p))/m)² over p: the step is Σ (f − y) y′ / Σ y′², both weighted
//! by 1/m², with y′ by differences. A factor is found in one step, an ε in a few. People write short numbers, so of all
//! numbers within three standard errors of the minimum the shortest decimal is taken, or the reciprocal of an integer.

use super::Suspicion;
use super::change::{Meaning, specified};
use super::trial::Trial;
use crate::certificate::UNIT_ROUNDOFF;

const STEPS: usize = 12;

/// A mistake in one number.
pub struct Parameter {
    name: String,
    start: f64,
    least: f64,
    detail: Box<dyn Fn(f64) -> String>,
    meaning: Box<dyn Fn(f64) -> Meaning>,
}

impl Parameter {
    /// A number whose specified value is `start`.
    pub fn new(
        name: impl Into<String>,
        start: f64,
        detail: impl Fn(f64) -> String + 'static,
        meaning: impl Fn(f64) -> Meaning + 'static,
    ) -> Self {
        let (detail, meaning) = (Box::new(detail), Box::new(meaning));
        Self { name: name.into(), start, least: f64::NEG_INFINITY, detail, meaning }
    }

    /// The same, never below `least`.
    #[must_use]
    pub fn at_least(self, least: f64) -> Self {
        Self { least, ..self }
    }
}

/// The suspicions with the number that fits best, as an f32 and as it is written; none where the outputs do not depend on it.
pub fn fitted(parameter: Parameter, trial: &Trial) -> Vec<Suspicion> {
    let p = best(&parameter, trial).filter(|&p| p != parameter.start);
    p.map_or(Vec::new(), |p| {
        let suspicion =
            |kept: f64| Suspicion::new(&parameter.name[..], (parameter.detail)(p), (parameter.meaning)(kept));
        vec![suspicion(f64::from(p as f32)), suspicion(p)]
    })
}

/// The number that fits best, as short as people write it.
fn best(parameter: &Parameter, trial: &Trial) -> Option<f64> {
    let found = trial.found()?;
    let magnitudes: Vec<f64> = trial.values(&specified())?.iter().map(|y| y.magnitude).collect();
    let values = |p: f64| -> Option<Vec<f64>> {
        let y = trial.values(&(parameter.meaning)(p))?;
        (y.len() == found.len()).then(|| y.iter().map(|y| y.value).collect())
    };
    let mut p = parameter.start;
    let mut error = 0.0;
    for _ in 0..STEPS {
        let h = if p == 0.0 { 1e-4 } else { p.abs() * 1e-3 };
        let (y, moved) = (values(p)?, values(p + h)?);
        let (mut ry, mut yy, mut rr, mut count) = (0.0, 0.0, 0.0, 0.0);
        for (((f, y), moved), m) in found.iter().zip(&y).zip(&moved).zip(&magnitudes) {
            let (residual, slope) = ((f - y) / m, (moved - y) / (h * m));
            if *m > 0.0 && residual.is_finite() && slope.is_finite() {
                ry += residual * slope;
                yy += slope * slope;
                rr += residual * residual;
                count += 1.0;
            }
        }
        if yy == 0.0 || count < 4.0 {
            return None;
        }
        let step = ry / yy;
        let next = (p + step).max(parameter.least);
        error = ((rr - ry * step).max(0.0) / (count - 1.0) / yy).sqrt();
        if !next.is_finite() {
            return None;
        }
        let done = (next - p).abs() <= 1e-13 * next.abs() + 1e-3 * error;
        p = next;
        if done {
            break;
        }
    }
    // A program keeps its numbers in f32.
    Some(shortest(p, 3.0 * error + UNIT_ROUNDOFF * p.abs()))
}

/// The shortest decimal within `error` of p, or 1/k for an integer k, where that is shorter.
pub fn shortest(p: f64, error: f64) -> f64 {
    if p.abs() <= error {
        return 0.0;
    }
    for digits in 0..15 {
        let decimal: f64 = format!("{p:.digits$e}").parse().unwrap_or(p);
        if (decimal - p).abs() <= error {
            return decimal;
        }
        // 1/255 has no short decimal.
        let inverse = (1.0 / p).round();
        if digits >= 2 && inverse.abs() <= 1e4 && (1.0 / inverse - p).abs() <= error {
            return 1.0 / inverse;
        }
    }
    p
}

#[cfg(test)]
mod tests {
    use super::shortest;

    #[test]
    fn people_write_short_numbers() {
        for (p, error, expected) in [
            (1.000_500_000_3, 1e-8, 1.0005),
            (1.000_001_000_02, 1e-9, 1.000_001),
            (0.003_921_6, 1e-6, 1.0 / 255.0),
            (254.999_7, 1e-2, 255.0),
            (-0.499_999, 1e-4, -0.5),
            (9.97e-4, 1e-5, 1e-3),
            (1e-9, 1e-7, 0.0),
        ] {
            assert_eq!(shortest(p, error), expected, "{p} ± {error}");
        }
    }
}

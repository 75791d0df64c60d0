//! Losses: what training minimises, as a value and its gradient.
//!
//! | module | thesis | network |
//! |---|---|---|
//! | [`mean_squared_error`] | eq. 5.4, 6.6 | MF-PIFu |
//! | [`binary_cross_entropy`] | eq. 6.10 | VSR |
//!
//! Both take logits z and labels o (1 inside, 0 outside; erratum E17), and average over the points.

mod binary_cross_entropy;
mod mean_squared_error;

pub use binary_cross_entropy::binary_cross_entropy;
pub use mean_squared_error::mean_squared_error;

/// The value of a loss and its gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// L.
    pub value: f64,
    /// ∂L/∂z of every point.
    pub gradient: Vec<f64>,
}

/// The mean of a per-point loss given as (value, derivative).
fn mean(name: &str, logits: &[f64], labels: &[f64], point: impl Fn(f64, f64) -> (f64, f64)) -> Loss {
    assert!(
        logits.len() == labels.len() && !logits.is_empty(),
        "{name}: {} logits and {} labels must be the same number of points, at least one",
        logits.len(),
        labels.len()
    );
    let points = logits.len() as f64;
    let (values, gradient): (Vec<f64>, Vec<f64>) = logits
        .iter()
        .zip(labels)
        .map(|(&z, &o)| {
            let (value, derivative) = point(z, o);
            (value / points, derivative / points)
        })
        .unzip();
    Loss { value: values.iter().sum(), gradient }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences of a loss at (z, o).
    pub(super) fn assert_gradient_is_the_slope(loss: impl Fn(&[f64], &[f64]) -> Loss) {
        let (z, o) = ([-30.0, -2.0, -0.1, 0.0, 0.7, 3.0, 25.0], [0.0, 1.0, 0.0, 1.0, 0.3, 1.0, 0.0]);
        let gradient = loss(&z, &o).gradient;
        for k in 0..z.len() {
            let moved = |step: f64| {
                let mut z = z;
                z[k] += step;
                loss(&z, &o).value
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((slope - gradient[k]).abs() < 1e-9, "point {k}: slope {slope}, gradient {}", gradient[k]);
        }
    }

    #[test]
    #[should_panic(expected = "2 logits and 1 labels")]
    fn every_logit_needs_a_label() {
        mean_squared_error(&[0.0, 1.0], &[1.0]);
    }
}

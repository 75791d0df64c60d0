//! Local response normalisation: each pixel divided by what its neighbours among the channels amount to.
//!
//! y_c = x_c / (bias + (α/size)·Σ x_k²)^β, k from c − ⌊(size − 1)/2⌋ to c + ⌈(size − 1)/2⌉ as far as there are channels: of
//! an even size the window reaches further up.
//!
//! Rounding: the sum of squares, its scale and the bias; the power to within two units and |β·ln(…)| for the rounding of its
//! logarithm; a division.

use super::{Scalar, Tensor};

/// The window and the constants of the normalisation, named as in ONNX.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalResponse {
    /// Channels in the window.
    pub size: usize,
    /// Weight of the mean square.
    pub alpha: f64,
    /// Exponent.
    pub beta: f64,
    /// What the mean square is added to.
    pub bias: f64,
}

/// x [N,C,…] → [N,C,…].
///
/// # Panics
/// If x is not [N,C,…] or the size is zero.
///
/// # References
/// ONNX operator LRN (versions 1 and 13); A. Krizhevsky, I. Sutskever, G. E. Hinton, ImageNet classification with deep
/// convolutional neural networks, NIPS 2012, §3.3.
pub fn local_response_norm<T: Scalar>(x: &Tensor<T>, params: LocalResponse) -> Tensor<T> {
    assert!(x.rank() > 1, "local_response_norm: x must be [N,C,…], found shape {:?}", x.shape);
    assert!(params.size > 0, "local_response_norm: size must be positive");
    let (channels, pixels) = (x.shape[1], x.shape[2..].iter().product::<usize>());
    let (below, above) = ((params.size - 1) / 2, params.size / 2);
    let scale = T::exact(params.alpha) / T::exact(params.size as f64);
    let mut y = x.clone();
    for sample in 0..x.shape[0] {
        for c in 0..channels {
            let window = c.saturating_sub(below)..(c + above + 1).min(channels);
            for pixel in 0..pixels {
                let at = |k: usize| (sample * channels + k) * pixels + pixel;
                let squares =
                    window.clone().fold(T::ZERO, |sum, k| sum.plus_product(x.data[at(k)], x.data[at(k)]));
                let squares = if T::TRACKS_ROUNDING {
                    slid(squares, (0..window.end).map(|k| x.data[at(k)]))
                } else {
                    squares
                };
                let base = T::exact(params.bias).plus(scale * squares);
                let (power, log) = (base.value().powf(params.beta), base.value().ln());
                let divisor =
                    base.function(power, params.beta * power / base.value(), 2.0 + (params.beta * log).abs());
                y.data[at(c)] = x.data[at(c)] / divisor;
            }
        }
    }
    y
}

/// A window's sum of squares as it may be had by sliding: each square of the channels so far is added once and taken away once,
/// and what their roundings leave stays.
fn slid<T: Scalar>(squares: T, so_far: impl Iterator<Item = T>) -> T {
    let (mut magnitude, mut terms) = (0.0, 0.0_f64);
    for x in so_far {
        magnitude += x.magnitude() * x.magnitude();
        terms = terms.max(2.0 * x.terms()) + 2.0;
    }
    T::within(squares.value(), magnitude.max(squares.magnitude()), terms.max(squares.terms()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_of_even_size_reaches_further_up() {
        let x = Tensor::new(&[1, 4, 1], vec![1.0, 2.0, 3.0, 4.0]);
        let params = LocalResponse { size: 2, alpha: 2.0, beta: 1.0, bias: 0.0 };
        let y = local_response_norm(&x, params).data;
        let expected = [1.0 / 5.0, 2.0 / 13.0, 3.0 / 25.0, 4.0 / 16.0];
        assert!(y.iter().zip(expected).all(|(y, e)| (y - e).abs() < 1e-15), "{y:?}");
    }

    #[test]
    fn without_weight_it_divides_by_a_constant() {
        let x = Tensor::new(&[1, 3, 2], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let params = LocalResponse { size: 3, alpha: 0.0, beta: 0.5, bias: 4.0 };
        assert_eq!(local_response_norm(&x, params), x.map(|v| v / 2.0));
    }
}

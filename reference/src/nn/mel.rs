//! Triangular filters, evenly spaced in pitch, that gather the lines of a spectrum.

use super::{Scalar, Tensor};

/// The weights \[lines,filters\] of a spectrum of ⌊N/2⌋ + 1 lines, N = `dft_length`, at `sample_rate` samples a second.
///
/// Pitch is mel(f) = 2595·log₁₀(1 + f/700), f in hertz. The filters' F + 2 edges divide lower…upper into F + 2 equal steps of
/// pitch, the last of which is not reached, and are moved to the line ⌊(N + 1)·f/rate⌋. Filter k rises from 0 at edge k to 1 at
/// edge k + 1 and falls to 0 at edge k + 2.
///
/// Rounding: one quotient. The edges are taken to stand where exact arithmetic puts them; an implementation that computes in f32
/// may move one that lies very near to a whole number.
///
/// # Conventions
/// F + 2 edges have F + 1 steps between them, and librosa and PyTorch divide into so many; ONNX divides into F + 2.
///
/// # Panics
/// If an edge is below zero or lies beyond the spectrum.
///
/// # References
/// ONNX operator MelWeightMatrix (version 17).
pub fn mel_weight_matrix<T: Scalar>(
    filters: usize,
    dft_length: usize,
    sample_rate: f64,
    lower_hz: f64,
    upper_hz: f64,
) -> Tensor<T> {
    let mel = |hz: f64| 2595.0 * (hz / 700.0).ln_1p() / 10f64.ln();
    let hz = |mel: f64| 700.0 * (mel / 2595.0 * 10f64.ln()).exp_m1();
    let lines = dft_length / 2 + 1;
    let step = (mel(upper_hz) - mel(lower_hz)) / (filters + 2) as f64;
    let edges: Vec<f64> = (0..filters + 2)
        .map(|k| ((dft_length + 1) as f64 * hz(mel(lower_hz) + k as f64 * step) / sample_rate).floor())
        .collect();
    let inside = edges.iter().all(|&edge| edge >= 0.0 && edge <= lines as f64);
    assert!(inside, "mel_weight_matrix: the edges {edges:?} do not lie in a spectrum of {lines} lines");
    Tensor::from_fn(&[lines, filters], |i| {
        let (line, [left, middle, right]) = (i[0] as f64, [edges[i[1]], edges[i[1] + 1], edges[i[1] + 2]]);
        match line {
            _ if line == middle => T::exact(1.0),
            _ if line > left && line < middle => T::exact(line - left) / T::exact(middle - left),
            _ if line > middle && line < right => T::exact(right - line) / T::exact(right - middle),
            _ => T::ZERO,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_rise_to_one_and_fall_to_the_next() {
        let y: Tensor = mel_weight_matrix(8, 64, 8192.0, 0.0, 4096.0);
        assert_eq!(y.shape, [33, 8]);
        for filter in 0..8 {
            let column: Vec<f64> = (0..33).map(|line| y.at(&[line, filter])).collect();
            let peak = column.iter().position(|&w| w == 1.0).expect("a peak");
            assert!(column[..=peak].is_sorted(), "{column:?} rises");
            assert!(column[peak..].iter().rev().is_sorted(), "{column:?} falls");
        }
        let wide: Vec<f64> = (0..33).map(|line| y.at(&[line, 7])).collect();
        assert!(wide.iter().filter(|&&w| w > 0.0).count() > 6, "high filters are wide: {wide:?}");
    }

    #[test]
    #[should_panic(expected = "do not lie in a spectrum of 3 lines")]
    fn edges_lie_in_the_spectrum() {
        mel_weight_matrix::<f64>(4, 4, 10.0, 0.0, 4000.0);
    }
}

//! What PyTorch answers, in f64, to inputs that both sides make by the same rule.
//!
//! `operators.rs` here, `network/goldens.rs` and `loss/goldens.rs` are written by one command, which needs the environment of `models/`:
//! `models/.venv/bin/python reference/goldens/generate.py`.

mod operators;

pub(crate) use operators::*;

use super::Tensor;

/// A tensor that PyTorch computed.
pub(crate) struct Golden {
    pub shape: &'static [usize],
    pub data: &'static [f64],
}

/// A tensor of numbers in [−1, 1) that look random and are the same in every language: element i is
/// ((31i² + 7919i + 104729·seed) mod 1009)/504.5 − 1.
pub(crate) fn pattern(shape: &[usize], seed: usize) -> Tensor {
    let element = |i: usize| ((31 * i * i + 7919 * i + 104_729 * seed) % 1009) as f64 / 504.5 - 1.0;
    Tensor::new(shape, (0..shape.iter().product()).map(element).collect())
}

/// Assert that a tensor is the golden one, to twelve digits of its largest element.
pub(crate) fn check(found: &Tensor, golden: &Golden) {
    assert_eq!(found.shape, golden.shape, "shape");
    let largest = golden.data.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    for (i, (found, golden)) in found.data.iter().zip(golden.data).enumerate() {
        assert!(
            (found - golden).abs() <= 1e-12 * largest,
            "element {i}: found {found}, PyTorch gave {golden}; regenerate with \
             models/.venv/bin/python reference/goldens/generate.py"
        );
    }
}

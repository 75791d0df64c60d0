//! Rotary position embedding: pairs of features are turned by an angle that grows with their token's position.

use super::{Scalar, Tensor};

/// Which features form a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pairs {
    /// k and k + R/2: the first half with the second (GPT-NeoX, ONNX's `interleaved` = 0).
    Halves,
    /// 2k and 2k + 1: neighbours (GPT-J, ONNX's `interleaved` = 1).
    Neighbours,
}

/// (a, b) → (a·cos − b·sin, a·sin + b·cos) for each pair of the first R features; those after R stay.
///
/// x \[N,H,L,E\], cos and sin \[N,L,R/2\], R ≤ E.
///
/// Rounding: two products and a sum.
///
/// # Conventions
/// Where ONNX gives x as [N,L,H·E], heads lie side by side: see [`split_heads`](super::attention::split_heads). Where it gives caches
/// [positions,R/2] and position ids, the rows are to be gathered first.
///
/// # Panics
/// If the shapes do not fit.
///
/// # References
/// Su and others, RoFormer, 2021; ONNX operator RotaryEmbedding (version 23).
pub fn rotary_embedding<T: Scalar>(
    x: &Tensor<T>,
    cos: &Tensor<T>,
    sin: &Tensor<T>,
    pairs: Pairs,
) -> Tensor<T> {
    let fits = x.rank() == 4
        && cos.rank() == 3
        && cos.shape == sin.shape
        && cos.shape[..2] == [x.shape[0], x.shape[2]]
        && 2 * cos.shape[2] <= x.shape[3];
    assert!(
        fits,
        "rotary_embedding: cos {:?} and sin {:?} must be [N,L,R/2] with R ≤ E for x [N,H,L,E] {:?}",
        cos.shape, sin.shape, x.shape
    );
    let half = cos.shape[2];
    let mut y = x.clone();
    let (heads, tokens, features) = (x.shape[1], x.shape[2], x.shape[3]);
    for (row, token) in y.data.chunks_exact_mut(features.max(1)).enumerate() {
        let angles = (row / (heads * tokens) * tokens + row % tokens) * half;
        for k in 0..half {
            let (i, j) = match pairs {
                Pairs::Halves => (k, k + half),
                Pairs::Neighbours => (2 * k, 2 * k + 1),
            };
            let (a, b, cos, sin) = (token[i], token[j], cos.data[angles + k], sin.data[angles + k]);
            token[i] = (a * cos).plus(-(b * sin));
            token[j] = (a * sin).plus(b * cos);
        }
    }
    y
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::*;

    #[test]
    fn a_quarter_turn_of_either_kind_of_pair() {
        let x = Tensor::new(&[1, 1, 1, 5], vec![1.0, 2.0, 3.0, 4.0, 5.0]);
        let (cos, sin) = (Tensor::new(&[1, 1, 2], vec![0.0, 1.0]), Tensor::new(&[1, 1, 2], vec![1.0, 0.0]));
        assert_eq!(rotary_embedding(&x, &cos, &sin, Pairs::Halves).data, [-3.0, 2.0, 1.0, 4.0, 5.0]);
        assert_eq!(rotary_embedding(&x, &cos, &sin, Pairs::Neighbours).data, [-2.0, 1.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn products_of_queries_and_keys_depend_on_the_distance_alone() {
        let (q, k) = (pattern(&[1, 1, 1, 4], 1), pattern(&[1, 1, 1, 4], 2));
        let product = |at: f64, to: f64| {
            let turned = |x: &Tensor, position: f64| {
                let angles = Tensor::new(&[1, 1, 2], vec![position, position / 100.0]);
                rotary_embedding(x, &angles.map(f64::cos), &angles.map(f64::sin), Pairs::Halves)
            };
            turned(&q, at).data.iter().zip(turned(&k, to).data).map(|(q, k)| q * k).sum::<f64>()
        };
        assert!((product(3.0, 7.0) - product(10.0, 14.0)).abs() < 1e-14);
        assert!((product(3.0, 7.0) - product(3.0, 8.0)).abs() > 1e-3);
    }

    #[test]
    fn each_token_has_its_angle_in_every_head() {
        let x = Tensor::filled(&[2, 3, 2, 2], 1.0);
        let angles = Tensor::new(&[2, 2, 1], vec![0.0, 1.0, 2.0, 3.0]);
        let y = rotary_embedding(&x, &angles.map(f64::cos), &angles.map(f64::sin), Pairs::Neighbours);
        for n in 0..2 {
            for l in 0..2 {
                let angle: f64 = angles.at(&[n, l, 0]);
                assert!(
                    (0..3).all(|h| y.at(&[n, h, l, 0]) == angle.cos() - angle.sin()),
                    "sample {n}, token {l}"
                );
            }
        }
    }
}

//! Linear attention: a state that is written by keys and values and read by queries, token by token.
//!
//! S ← e^g·S (gated), v ← β·(v − Sᵀk) (delta rule), S ← S + k·vᵀ, o = s·Sᵀq.
//!
//! # Conventions
//! The state decays before the delta rule looks at it. Heads of states are read by neighbouring heads of queries: h₀h₀h₁h₁.
//!
//! Rounding: of the formulas, token after token; a kernel that works in chunks computes other sums of the same terms.
//!
//! # References
//! Katharopoulos and others, Transformers are RNNs, ICML 2020; Yang and others, Gated Delta Networks, 2024; ONNX operator
//! LinearAttention (version 27).

use super::transcendental::Elementary;
use super::{Scalar, Tensor};

/// What changes the state beside the plain update.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearAttention<'a, T> {
    /// g: \[N,G,L,E\] or \[N,G,L,1\], logarithms of the decay; no decay if absent.
    pub decay: Option<&'a Tensor<T>>,
    /// β: \[N,G,L,1\] or \[N,1,L,1\], the rate of the delta rule; no delta rule if absent.
    pub beta: Option<&'a Tensor<T>>,
    /// S before the first token \[N,G,E,F\]; zero if absent.
    pub past: Option<&'a Tensor<T>>,
    /// s; 1/√E if absent.
    pub scale: Option<f64>,
}

/// Queries \[N,H,L,E\], keys \[N,G,L,E\] and values \[N,G,L,F\] → the answers \[N,H,L,F\] and the last state \[N,G,E,F\].
///
/// # Panics
/// If the shapes do not fit.
pub fn linear_attention<T: Scalar>(
    q: &Tensor<T>,
    k: &Tensor<T>,
    v: &Tensor<T>,
    params: &LinearAttention<T>,
) -> (Tensor<T>, Tensor<T>) {
    let four = [q, k, v].iter().all(|x| x.rank() == 4);
    assert!(
        four && q.shape[0] == k.shape[0]
            && q.shape[2..] == k.shape[2..]
            && k.shape[..3] == v.shape[..3]
            && k.shape[1] > 0
            && q.shape[1].is_multiple_of(k.shape[1]),
        "linear_attention: Q {:?}, K {:?} and V {:?} must be [N,H,L,E], [N,G,L,E] and [N,G,L,F] with G a divisor of H",
        q.shape,
        k.shape,
        v.shape
    );
    let [samples, heads, tokens, features] = [q.shape[0], q.shape[1], q.shape[2], q.shape[3]];
    let (groups, outputs) = (k.shape[1], v.shape[3]);
    let of_group = |x: &Tensor<T>, last: &[usize], all: bool| {
        x.rank() == 4
            && [x.shape[0], x.shape[2]] == [samples, tokens]
            && (x.shape[1] == groups || (all && x.shape[1] == 1))
            && last.contains(&x.shape[3])
    };
    let state_shape = [samples, groups, features, outputs];
    assert!(
        params.decay.is_none_or(|g| of_group(g, &[1, features], false))
            && params.beta.is_none_or(|b| of_group(b, &[1], true))
            && params.past.is_none_or(|s| s.shape == state_shape),
        "linear_attention: decay {:?}, beta {:?} or past {:?} does not fit K {:?} and V {:?}",
        params.decay.map(|x| &x.shape),
        params.beta.map(|x| &x.shape),
        params.past.map(|x| &x.shape),
        k.shape,
        v.shape
    );
    let scale = match params.scale {
        Some(scale) => T::exact(scale),
        // A root and a quotient.
        None => T::within((features as f64).sqrt().recip(), (features as f64).sqrt().recip(), 2.0),
    };
    let mut state = params.past.cloned().unwrap_or_else(|| Tensor::zeros(&state_shape));
    let mut y = Tensor::zeros(&[samples, heads, tokens, outputs]);
    for n in 0..samples {
        for g in 0..groups {
            let s = &mut state.data[(n * groups + g) * features * outputs..][..features * outputs];
            for t in 0..tokens {
                let row = (n * groups + g) * tokens + t;
                let key = &k.data[row * features..][..features];
                let mut value = v.data[row * outputs..][..outputs].to_vec();
                if let Some(decay) = params.decay {
                    for (e, line) in s.chunks_exact_mut(outputs).enumerate() {
                        let factor = Elementary::exp(decay.at(&[n, g, t, e % decay.shape[3]]));
                        line.iter_mut().for_each(|s| *s = *s * factor);
                    }
                }
                if let Some(beta) = params.beta {
                    let rate = beta.at(&[n, g % beta.shape[1], t, 0]);
                    for (f, value) in value.iter_mut().enumerate() {
                        let known = (0..features)
                            .fold(T::ZERO, |sum, e| sum.plus_product(s[e * outputs + f], key[e]));
                        *value = rate * value.plus(-known);
                    }
                }
                for (line, &key) in s.chunks_exact_mut(outputs).zip(key) {
                    line.iter_mut().zip(&value).for_each(|(s, &v)| *s = s.plus_product(key, v));
                }
                for h in g * (heads / groups)..(g + 1) * (heads / groups) {
                    let row = (n * heads + h) * tokens + t;
                    let query = &q.data[row * features..][..features];
                    for f in 0..outputs {
                        let answer = (0..features)
                            .fold(T::ZERO, |sum, e| sum.plus_product(query[e], s[e * outputs + f]));
                        y.data[row * outputs + f] = scale * answer;
                    }
                }
            }
        }
    }
    (y, state)
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::super::{matmul, transpose};
    use super::*;

    const PLAIN: LinearAttention<f64> =
        LinearAttention { decay: None, beta: None, past: None, scale: Some(1.0) };

    #[test]
    fn without_gates_it_is_attention_without_softmax_over_the_tokens_so_far() {
        let (q, k, v) = (pattern(&[1, 2, 3, 4], 1), pattern(&[1, 2, 3, 4], 2), pattern(&[1, 2, 3, 5], 3));
        let scores = matmul(&q, &transpose(&k, &[0, 1, 3, 2]));
        let causal =
            Tensor::from_fn(&scores.shape.clone(), |i| if i[3] <= i[2] { scores.at(i) } else { 0.0 });
        let (y, state) = linear_attention(&q, &k, &v, &PLAIN);
        let expected = matmul(&causal, &v);
        assert!(y.data.iter().zip(&expected.data).all(|(a, b)| (a - b).abs() < 1e-14));
        let sum = matmul(&transpose(&k, &[0, 1, 3, 2]), &v);
        assert!(state.data.iter().zip(&sum.data).all(|(a, b)| (a - b).abs() < 1e-14));
    }

    #[test]
    fn the_delta_rule_replaces_what_a_key_stood_for() {
        // A unit key written twice with rate 1 remembers the second value only.
        let k = Tensor::new(&[1, 1, 2, 2], vec![0.6, 0.8, 0.6, 0.8]);
        let v = Tensor::new(&[1, 1, 2, 1], vec![5.0, 7.0]);
        let rate = Tensor::filled(&[1, 1, 2, 1], 1.0);
        let (y, _) = linear_attention(&k, &k, &v, &LinearAttention { beta: Some(&rate), ..PLAIN });
        assert!((y.data[0] - 5.0).abs() < 1e-14 && (y.data[1] - 7.0).abs() < 1e-14, "{y:?}");
        let halving = Tensor::filled(&[1, 1, 2, 1], 0.5f64.ln());
        let (y, _) = linear_attention(&k, &k, &v, &LinearAttention { decay: Some(&halving), ..PLAIN });
        assert!((y.data[1] - 9.5).abs() < 1e-14, "7 and the half of 5");
    }

    #[test]
    fn neighbouring_heads_of_queries_share_a_state() {
        let (q, k, v) = (pattern(&[1, 4, 2, 3], 1), pattern(&[1, 2, 2, 3], 2), pattern(&[1, 2, 2, 3], 3));
        let (y, _) = linear_attention(&q, &k, &v, &PLAIN);
        let second = super::super::slice(&q, 1, 1, 2, 1);
        let (own, _) = linear_attention(
            &second,
            &super::super::slice(&k, 1, 0, 1, 1),
            &super::super::slice(&v, 1, 0, 1, 1),
            &PLAIN,
        );
        assert_eq!(super::super::slice(&y, 1, 1, 2, 1), own);
    }
}

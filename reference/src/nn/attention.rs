//! Scaled dot-product attention.
//!
//! For each head, with queries Q \[L,E\], keys K \[S,E\] and values V \[S,F\]:
//!
//! scores = (√s·Q)(√s·K)ᵀ → capped = c·tanh(scores/c) → biased = capped + mask → weights = softmax(biased) → Y = weights·V.
//!
//! # Conventions
//! * s is 1/√E unless given. The specification scales Q and K by √s each, which rounds otherwise than scaling the product.
//! * The cap comes before the mask, so that −∞ stays −∞.
//! * Masks are added: true is 0 and false is −∞. A mask shorter than S is continued by −∞.
//! * A query at place i sees, with the `causal` mask, the keys j ≤ i + offset: `offset` is the number of keys before the first
//!   query, the length of a cache. It is not S − L, and not 0 with a cache. The window is counted from i + offset as well.
//! * Fewer heads of keys than of queries are repeated one by one, h₀h₀h₁h₁, not h₀h₁h₀h₁.
//! * A query that sees no key gets zeros, where a softmax over nothing but −∞ would give NaN.
//!
//! Rounding: that of the formula. What is masked takes no part.
//!
//! # References
//! Vaswani and others, Attention Is All You Need, NeurIPS 2017; ONNX operator Attention (versions 23 to 25).

use super::elementwise::broadcast_offset;
use super::movement::transpose;
use super::softmax::softmax_line;
use super::transcendental::Elementary;
use super::{Scalar, Tensor};

/// The options of attention.
#[derive(Clone, Debug, PartialEq)]
pub struct Attention {
    /// s; 1/√E if absent.
    pub scale: Option<f64>,
    /// c, if scores are capped.
    pub softcap: Option<f64>,
    /// Whether a query sees only the keys up to its own place.
    pub causal: bool,
    /// How many keys before its own place a query sees at most.
    pub left_window: Option<usize>,
    /// How many keys after its own place a query sees at most.
    pub right_window: Option<usize>,
    /// The place of the first query among the keys, for each sample; negative where queries outnumber keys.
    pub offsets: Vec<i64>,
    /// How many keys of each sample there are; what follows is padding. All, if absent.
    pub lengths: Option<Vec<usize>>,
}

/// What attention gives, stage by stage; all but y \[N,H,L,F\] are \[N,H,L,S\].
#[derive(Clone, Debug, PartialEq)]
pub struct Attended<T> {
    /// The weighted values.
    pub y: Tensor<T>,
    /// The scaled products of queries and keys.
    pub scores: Tensor<T>,
    /// The scores after the cap.
    pub capped: Tensor<T>,
    /// The capped scores with every mask added.
    pub biased: Tensor<T>,
    /// The shares of the keys.
    pub weights: Tensor<T>,
}

/// Attention of queries \[N,H,L,E\] to keys \[N,G,S,E\] with values \[N,G,S,F\], G a divisor of H; the mask broadcasts to \[N,H,L,S\].
///
/// # Panics
/// If the shapes do not fit.
pub fn attention<T: Scalar>(
    q: &Tensor<T>,
    k: &Tensor<T>,
    v: &Tensor<T>,
    mask: Option<&Tensor<T>>,
    params: &Attention,
) -> Attended<T> {
    let four = [q, k, v].iter().all(|x| x.rank() == 4);
    assert!(
        four && q.shape[0] == k.shape[0]
            && q.shape[3] == k.shape[3]
            && k.shape[..3] == v.shape[..3]
            && k.shape[1] > 0
            && q.shape[1].is_multiple_of(k.shape[1]),
        "attention: Q {:?}, K {:?} and V {:?} must be [N,H,L,E], [N,G,S,E] and [N,G,S,F] with G a divisor of H",
        q.shape,
        k.shape,
        v.shape
    );
    let [samples, heads, queries, features] = [q.shape[0], q.shape[1], q.shape[2], q.shape[3]];
    let [keys, outputs] = [k.shape[2], v.shape[3]];
    assert!(
        params.offsets.len() == samples && params.lengths.as_ref().is_none_or(|l| l.len() == samples),
        "attention: {samples} samples need as many offsets and lengths, found {:?} and {:?}",
        params.offsets,
        params.lengths
    );
    if let Some(mask) = mask {
        let sides = [samples, heads, queries];
        let fits = (1..=4).contains(&mask.rank())
            && mask.shape.iter().rev().skip(1).zip(sides.iter().rev()).all(|(&m, &n)| m == 1 || m == n)
            && mask.shape[mask.rank() - 1] <= keys;
        assert!(fits, "attention: mask {:?} does not broadcast to [N,H,L,S] {sides:?}, {keys}", mask.shape);
    }
    let root = match params.scale {
        Some(scale) => T::within(scale.sqrt(), scale.sqrt(), 1.0),
        // Two roots and a quotient.
        None => T::within((features as f64).powf(-0.25), (features as f64).powf(-0.25), 3.0),
    };
    let (scaled_q, scaled_k) = (q.map(|q| q * root), k.map(|k| k * root));
    let per_group = heads / k.shape[1];

    let stage = |elements| Vec::<T>::with_capacity(samples * heads * queries * elements);
    let (mut scores, mut capped, mut biased) = (stage(keys), stage(keys), stage(keys));
    let (mut weights, mut y) = (stage(keys), stage(outputs));
    for row in 0..samples * heads * queries {
        let (n, h, i) = (row / (heads * queries), row / queries % heads, row % queries);
        let group = (n * k.shape[1] + h / per_group) * keys;
        let query = &scaled_q.data[row * features..][..features];
        let first = scores.len();
        for j in 0..keys {
            let key = &scaled_k.data[(group + j) * features..][..features];
            let score = query.iter().zip(key).fold(T::ZERO, |sum, (&q, &k)| sum.plus_product(q, k));
            let cap = params.softcap.map_or(score, |c| {
                let c = T::exact(c);
                c * Elementary::tanh(score / c)
            });
            scores.push(score);
            capped.push(cap);
            biased.push(if params.sees(n, i, j) {
                masked(cap, mask, [n, h, i, j])
            } else {
                minus_infinity()
            });
        }
        let biased = &biased[first..];
        let seen: Vec<usize> = (0..keys).filter(|&j| biased[j].value() != f64::NEG_INFINITY).collect();
        let shares = softmax_line(&seen.iter().map(|&j| biased[j]).collect::<Vec<_>>());
        weights.resize(first + keys, T::ZERO);
        let mut sum = vec![T::ZERO; outputs];
        for (&j, share) in seen.iter().zip(shares) {
            weights[first + j] = share;
            for (sum, &v) in sum.iter_mut().zip(&v.data[(group + j) * outputs..][..outputs]) {
                *sum = sum.plus_product(share, v);
            }
        }
        y.extend(sum);
    }
    let tensor = |data, last| Tensor::new(&[samples, heads, queries, last], data);
    Attended {
        y: tensor(y, outputs),
        scores: tensor(scores, keys),
        capped: tensor(capped, keys),
        biased: tensor(biased, keys),
        weights: tensor(weights, keys),
    }
}

fn minus_infinity<T: Scalar>() -> T {
    T::exact(f64::NEG_INFINITY)
}

/// A score with the mask added; beyond the mask's last column, and where it is −∞, that is −∞ without any rounding.
fn masked<T: Scalar>(score: T, mask: Option<&Tensor<T>>, index: [usize; 4]) -> T {
    let Some(mask) = mask else { return score };
    let columns = mask.shape[mask.rank() - 1];
    if columns != 1 && index[3] >= columns {
        return minus_infinity();
    }
    let bias = mask.data[broadcast_offset(&mask.shape, &index)];
    if bias.value() == f64::NEG_INFINITY { minus_infinity() } else { score.plus(bias) }
}

impl Attention {
    /// Plain attention for so many samples: no cap, no mask, no window, no cache.
    pub fn new(samples: usize) -> Attention {
        Attention {
            scale: None,
            softcap: None,
            causal: false,
            left_window: None,
            right_window: None,
            offsets: vec![0; samples],
            lengths: None,
        }
    }

    /// Whether the causal mask, the window and the length of sample n let query i see key j.
    fn sees(&self, n: usize, i: usize, j: usize) -> bool {
        let (place, key) = (i as i64 + self.offsets[n], j as i64);
        let within = |window: Option<usize>, distance: i64| window.is_none_or(|w| distance <= w as i64);
        (!self.causal || key <= place)
            && within(self.left_window, place - key)
            && within(self.right_window, key - place)
            && self.lengths.as_ref().is_none_or(|lengths| j < lengths[n])
    }
}

/// [N,L,H·E] → \[N,H,L,E\]: heads lie side by side in a token's features.
///
/// # Panics
/// If the heads do not divide the features.
pub fn split_heads<T: Copy>(x: &Tensor<T>, heads: usize) -> Tensor<T> {
    let fits = x.rank() == 3 && heads > 0 && x.shape[2].is_multiple_of(heads);
    assert!(fits, "split_heads: x {:?} must be [N,L,H·E] with H = {heads}", x.shape);
    let [n, l, features] = [x.shape[0], x.shape[1], x.shape[2]];
    transpose(&x.reshape(&[n, l, heads, features / heads]), &[0, 2, 1, 3])
}

/// \[N,H,L,E\] → [N,L,H·E], the inverse of [`split_heads`].
///
/// # Panics
/// If x is not \[N,H,L,E\].
pub fn join_heads<T: Copy>(x: &Tensor<T>) -> Tensor<T> {
    assert!(x.rank() == 4, "join_heads: x must be [N,H,L,E], found shape {:?}", x.shape);
    let [n, h, l, e] = [x.shape[0], x.shape[1], x.shape[2], x.shape[3]];
    transpose(x, &[0, 2, 1, 3]).reshape(&[n, l, h * e])
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::super::{matmul, softmax};
    use super::*;

    fn plain(q: &Tensor, k: &Tensor, v: &Tensor) -> Tensor {
        let root = (q.shape[3] as f64).sqrt();
        matmul(&softmax(&matmul(q, &transpose(k, &[0, 1, 3, 2])).map(|s| s / root), 3), v)
    }

    fn close(a: &Tensor, b: &Tensor) -> bool {
        a.shape == b.shape && a.data.iter().zip(&b.data).all(|(a, b)| (a - b).abs() < 1e-14)
    }

    fn qkv() -> [Tensor; 3] {
        [pattern(&[2, 4, 3, 5], 1), pattern(&[2, 2, 6, 5], 2), pattern(&[2, 2, 6, 7], 3)]
    }

    /// Each head of keys twice in a row.
    fn repeated(x: &Tensor) -> Tensor {
        Tensor::from_fn(&[x.shape[0], 2 * x.shape[1], x.shape[2], x.shape[3]], |i| {
            x.at(&[i[0], i[1] / 2, i[2], i[3]])
        })
    }

    #[test]
    fn it_is_a_softmax_between_two_products_with_each_head_of_keys_repeated() {
        let [q, k, v] = qkv();
        let found = attention(&q, &k, &v, None, &Attention::new(2));
        assert!(close(&found.y, &plain(&q, &repeated(&k), &repeated(&v))));
        assert_eq!((found.weights.shape, found.scores.shape), (vec![2, 4, 3, 6], vec![2, 4, 3, 6]));
    }

    #[test]
    fn what_is_masked_might_as_well_be_absent() {
        let [q, k, v] = qkv();
        let first = |x: &Tensor, n| super::super::slice(x, 2, 0, n, 1);
        let expected = plain(&q, &repeated(&first(&k, 4)), &repeated(&first(&v, 4)));
        let by_length = Attention { lengths: Some(vec![4, 4]), ..Attention::new(2) };
        assert!(close(&attention(&q, &k, &v, None, &by_length).y, &expected));
        let short = Tensor::zeros(&[1, 4]);
        assert!(close(&attention(&q, &k, &v, Some(&short), &Attention::new(2)).y, &expected), "a short mask");
        let infinite = Tensor::from_fn(&[6], |i| if i[0] < 4 { 0.0 } else { f64::NEG_INFINITY });
        assert!(close(&attention(&q, &k, &v, Some(&infinite), &Attention::new(2)).y, &expected));
        let rounded = attention(
            &q.rounded(),
            &k.rounded(),
            &v.rounded(),
            Some(&infinite.rounded()),
            &Attention::new(2),
        );
        assert!(rounded.y.data.iter().all(|y| y.magnitude.is_finite()), "masked scores have no rounding");
    }

    #[test]
    fn a_causal_query_sees_the_cache_and_the_keys_up_to_its_own() {
        let [q, k, v] = qkv();
        let params = Attention { causal: true, offsets: vec![3, 0], ..Attention::new(2) };
        let weights = attention(&q, &k, &v, None, &params).weights;
        for i in 0..3 {
            for j in 0..6 {
                assert_eq!(weights.at(&[0, 1, i, j]) > 0.0, j <= i + 3, "with a cache of 3: {i}, {j}");
                assert_eq!(weights.at(&[1, 1, i, j]) > 0.0, j <= i, "without: {i}, {j}");
            }
        }
    }

    #[test]
    fn a_window_is_counted_from_the_place_of_the_query() {
        let [q, k, v] = qkv();
        let window = Attention { left_window: Some(1), right_window: Some(2), ..Attention::new(2) };
        let weights = attention(&q, &k, &v, None, &window).weights;
        for i in 0..3_i64 {
            for j in 0..6_i64 {
                let sees = i - 1 <= j && j <= i + 2;
                assert_eq!(weights.at(&[0, 0, i as usize, j as usize]) > 0.0, sees, "{i}, {j}");
            }
        }
    }

    #[test]
    fn a_query_that_sees_nothing_gets_zeros() {
        let [q, k, v] = qkv();
        let params = Attention { causal: true, offsets: vec![-1, 0], ..Attention::new(2) };
        let found = attention(&q, &k, &v, None, &params);
        assert!((0..7).all(|f| found.y.at(&[0, 0, 0, f]) == 0.0 && found.y.at(&[0, 0, 1, f]) != 0.0));
    }

    #[test]
    fn a_cap_bounds_the_scores_and_leaves_the_mask() {
        let [q, k, v] = qkv();
        let params = Attention { scale: Some(100.0), softcap: Some(2.0), ..Attention::new(2) };
        let mask = Tensor::new(&[6], vec![0.0, f64::NEG_INFINITY, 0.0, 5.0, 0.0, 0.0]);
        let found = attention(&q, &k, &v, Some(&mask), &params);
        assert!(
            found.scores.data.iter().any(|s| s.abs() > 2.0)
                && found.capped.data.iter().all(|s| s.abs() <= 2.0)
        );
        assert_eq!(found.biased.at(&[0, 0, 0, 3]), found.capped.at(&[0, 0, 0, 3]) + 5.0);
        assert_eq!(found.weights.at(&[1, 3, 2, 1]), 0.0);
    }

    #[test]
    fn heads_split_and_join() {
        let x = pattern(&[2, 3, 8], 1);
        let heads = split_heads(&x, 4);
        assert_eq!(heads.shape, [2, 4, 3, 2]);
        assert_eq!(heads.at(&[1, 2, 0, 1]), x.at(&[1, 0, 5]), "head 2 has the features 4 and 5");
        assert_eq!(join_heads(&heads), x);
    }

    #[test]
    #[should_panic(expected = "with G a divisor of H")]
    fn heads_of_keys_must_divide_those_of_queries() {
        let [q, ..] = qkv();
        let k = pattern(&[2, 3, 6, 5], 2);
        attention(&q, &k, &k, None, &Attention::new(2));
    }
}

//! Numbers as small integers: q = saturate(round(fl(x / s)) + z), and back x ≈ (q − z)·s.
//!
//! s is the scale, z the zero point (the integer that stands for 0), and saturation cuts off what the integer type
//! cannot hold. Rounding to an integer is to the nearest, ties to the even one: 0.5 → 0, 1.5 → 2, 2.5 → 2.
//!
//! # What is fl?
//! The quotient is a number of the graph's precision, and that rounding decides ties: −2.5 / (5/255) is −127.5, but with
//! 5/255 in f32 it is −127.49999…, which f32 holds as −127.5 or as its neighbour. So the caller gives fl, the rounding of the
//! graph's precision (the identity for f64). An implementation that computes x·(1/s) instead may still differ by one,
//! within rounding of a tie; anywhere else that is no rounding.

use super::{Scalar, Tensor};

/// The integers first ≤ q ≤ last of a type, such as 0 … 255.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntegerRange {
    /// The least one.
    pub first: i64,
    /// The greatest one.
    pub last: i64,
}

impl IntegerRange {
    /// Integers of eight bits without sign.
    pub const U8: Self = Self { first: 0, last: 255 };

    /// The nearest integer, ties to even, cut off to the range; NaN is 0, as C's conversions on most machines have it.
    pub fn saturated(self, x: f64) -> i64 {
        // `as` itself saturates at i64, so that nothing wraps.
        (x.round_ties_even() as i64).clamp(self.first, self.last)
    }
}

/// saturate(round(fl(x / scale)) + zero_point), element by element; all shapes are equal (see [`spread`]).
///
/// # Panics
/// If the shapes differ.
///
/// # References
/// ONNX operator QuantizeLinear (version 25).
pub fn quantize(
    x: &Tensor,
    scale: &Tensor,
    zero_point: &Tensor<i64>,
    range: IntegerRange,
    fl: impl Fn(f64) -> f64,
) -> Tensor<i64> {
    assert!(
        x.shape == scale.shape && x.shape == zero_point.shape,
        "quantize: x {:?}, scale {:?} and zero point {:?} differ",
        x.shape,
        scale.shape,
        zero_point.shape
    );
    let quantized = x.data.iter().zip(&scale.data).zip(&zero_point.data);
    // round(x/s) and z are integers below 2⁵³ wherever the sum is not cut off: it is exact.
    let data =
        quantized.map(|((x, s), &z)| range.saturated(fl(x / s).round_ties_even() + z as f64)).collect();
    Tensor { shape: x.shape.clone(), data }
}

/// The numbers that integers stand for: x = (q − z)·s.
///
/// Rounding: that of q·s − z·s, since an implementation may scale both apart; what cancels then is remembered by the
/// magnitude (|q| + |z|)·s.
///
/// # References
/// ONNX operator DequantizeLinear (version 25).
pub fn dequantize<T: Scalar>(q: &Tensor<i64>, scale: T, zero_point: i64) -> Tensor<T> {
    let zero = T::exact(zero_point as f64) * scale;
    q.map(|q| T::exact(q as f64) * scale - zero)
}

/// Where numbers lie among the integers that are to stand for them: x/s + z, not yet rounded and cut off
/// ([`IntegerRange::saturated`]).
///
/// Rounding: the quotient, or the product with a rounded reciprocal, and the sum, whose terms may cancel. Two neighbouring
/// integers are both right where the bound of a level reaches over the tie between them.
pub fn levels<T: Scalar>(x: &Tensor<T>, scale: T, zero_point: i64) -> Tensor<T> {
    let zero = T::exact(zero_point as f64);
    x.map(|x| {
        let quotient = x / scale;
        T::within(quotient.value(), quotient.magnitude(), quotient.terms() + 1.0).plus(zero)
    })
}

/// One parameter for each element of `shape`: of one parameter for all, one for each place of `axis`, or one for each block.
///
/// Parameters of one element serve all. Parameters of rank 1 are one for each place of `axis`. Those of the rank of `shape`
/// have its lengths but along `axis`, where each serves `block` neighbours.
///
/// # Panics
/// If the parameters do not fit.
///
/// # References
/// ONNX operators QuantizeLinear and DequantizeLinear (version 25), the attributes axis and block_size.
pub fn spread<T: Copy>(parameters: &Tensor<T>, shape: &[usize], axis: usize, block: usize) -> Tensor<T> {
    let along = shape.get(axis).copied();
    let blocked = block > 0
        && parameters.rank() == shape.len()
        && (0..shape.len())
            .all(|a| parameters.shape[a] == if a == axis { shape[a].div_ceil(block) } else { shape[a] });
    match (parameters.rank(), &parameters.data[..]) {
        _ if blocked => Tensor::from_fn(shape, |index| {
            let mut from = index.to_vec();
            from[axis] /= block;
            parameters.at(&from)
        }),
        (0 | 1, &[all]) if block == 0 => Tensor::filled(shape, all),
        (1, each) if block == 0 && Some(each.len()) == along => {
            Tensor::from_fn(shape, |index| each[index[axis]])
        }
        _ => panic!(
            "spread: parameters {:?} do not fit shape {shape:?} along axis {axis} in blocks of {block}",
            parameters.shape
        ),
    }
}

/// The scale and zero point of integers 0 … 255 that hold every number of x, and 0 exactly; and x in them.
///
/// s = fl(fl(max(x, 0) − min(x, 0))/255), z = saturate(round(fl(−min(x, 0)/s))).
///
/// # References
/// ONNX operator DynamicQuantizeLinear (version 11).
pub fn quantize_dynamically(x: &Tensor, fl: impl Fn(f64) -> f64) -> (Tensor<i64>, f64, i64) {
    let largest = x.data.iter().fold(0.0_f64, |m, &x| m.max(x));
    let smallest = x.data.iter().fold(0.0_f64, |m, &x| m.min(x));
    let scale = fl(fl(largest - smallest) / 255.0);
    // Zeros alone have no scale; any serves.
    let divisor = if scale == 0.0 { 1.0 } else { scale };
    let zero_point = IntegerRange::U8.saturated(fl(-smallest / divisor));
    let filled = |value| Tensor::filled(&x.shape, value);
    let q = quantize(x, &filled(divisor), &Tensor::filled(&x.shape, zero_point), IntegerRange::U8, fl);
    (q, scale, zero_point)
}

#[cfg(test)]
mod tests {
    use super::super::{Rounded, UNIT_ROUNDOFF_F32};
    use super::*;

    #[test]
    fn ties_go_to_the_even_integer_and_what_is_too_large_is_cut_off() {
        let at = |x: f64| IntegerRange { first: -128, last: 127 }.saturated(x);
        assert_eq!([0.5, 1.5, 2.5, -0.5, -1.5].map(at), [0, 2, 2, 0, -2]);
        assert_eq!([126.5, 127.5, 1e300, -128.5, -129.0].map(at), [126, 127, 127, -128, -128]);
        assert_eq!([f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(at), [0, 127, -128]);
    }

    #[test]
    fn the_zero_point_is_added_before_the_cut() {
        let x = Tensor::new(&[3], vec![-1000.0, 3.0, 254.0]);
        let q = quantize(&x, &Tensor::filled(&[3], 2.0), &Tensor::filled(&[3], 128), IntegerRange::U8, |x| x);
        assert_eq!(q.data, [0, 130, 255], "1.5 is a tie");
    }

    #[test]
    fn levels_undo_what_integers_stand_for() {
        let q = Tensor::new(&[4], vec![0, 7, 128, 255]);
        let scale = f64::from(0.037_f32);
        assert_eq!(levels(&dequantize(&q, scale, 128), scale, 128).data, [0.0, 7.0, 128.0, 255.0]);
        assert_eq!(dequantize(&q, 0.5, 7).data, [-3.5, 0.0, 60.5, 124.0]);
        assert_eq!(levels(&Tensor::new(&[2], vec![1.25, -1.25]), 0.5, 10).data, [12.5, 7.5]);
    }

    #[test]
    fn a_sum_in_f32_lies_within_the_bound_of_its_level_however_it_is_arranged() {
        let (a_scale, b_scale, y_scale) = (0.037_f32, 0.0021_f32, 0.041_f32);
        let (a_zero, b_zero, y_zero) = (128_i64, 3_i64, 77_i64);
        let exact = |scale: f32| Rounded::exact(f64::from(scale));
        let mut furthest = 0.0_f64;
        for (a, b) in (0..=255).flat_map(|a| [(a, 0), (a, 3), (a, 200), (a, 255)]) {
            let one = |q: i64| Tensor::new(&[1], vec![q]);
            let [x, y] = [
                dequantize(&one(a), exact(a_scale), a_zero).data[0],
                dequantize(&one(b), exact(b_scale), b_zero).data[0],
            ];
            let level = levels(&Tensor::new(&[1], vec![x + y]), exact(y_scale), y_zero).data[0];
            let (a, b) = (a as f32, b as f32);
            let (a_zero, b_zero, y_zero) = (a_zero as f32, b_zero as f32, y_zero as f32);
            let plain = (a_scale * (a - a_zero) + b_scale * (b - b_zero)) / y_scale + y_zero;
            // Ratios of scales, with all that is the same for every element added up first.
            let (to_a, to_b) = (a_scale / y_scale, b_scale / y_scale);
            let arranged = to_a * a + (to_b * b + ((y_zero - to_a * a_zero) - to_b * b_zero));
            for found in [plain, arranged] {
                let share = (f64::from(found) - level.value).abs() / level.bound(UNIT_ROUNDOFF_F32);
                furthest = furthest.max(share);
            }
        }
        assert!((0.05..=1.0).contains(&furthest), "{furthest} of the bound");
    }

    #[test]
    fn parameters_serve_all_a_place_or_a_block() {
        let of = |shape: &[usize]| Tensor::from_fn(shape, |i| i.iter().fold(0, |n, i| 10 * n + i));
        assert_eq!(spread(&of(&[]), &[2, 2], 0, 0).data, [0, 0, 0, 0]);
        assert_eq!(spread(&of(&[2]), &[2, 2], 0, 0).data, [0, 0, 1, 1]);
        assert_eq!(spread(&of(&[2]), &[2, 2], 1, 0).data, [0, 1, 0, 1]);
        assert_eq!(
            spread(&of(&[2, 2]), &[2, 3], 1, 2).data,
            [0, 0, 1, 10, 10, 11],
            "the last block is short"
        );
    }

    #[test]
    #[should_panic(expected = "parameters [3] do not fit shape [2, 2] along axis 1 in blocks of 0")]
    fn there_must_be_a_parameter_for_each_place() {
        spread(&Tensor::new(&[3], vec![1, 2, 3]), &[2, 2], 1, 0);
    }

    #[test]
    fn a_dynamic_scale_holds_every_number_and_zero_exactly() {
        let (q, scale, zero_point) = quantize_dynamically(&Tensor::new(&[3], vec![-1.0, 0.0, 4.1]), |x| x);
        assert_eq!((q.data, scale, zero_point), (vec![0, 50, 255], 5.1 / 255.0, 50));
        let (_, scale, zero_point) = quantize_dynamically(&Tensor::new(&[2], vec![1.0, 2.0]), |x| x);
        assert_eq!((scale, zero_point), (2.0 / 255.0, 0), "the range reaches to zero");
        assert_eq!(
            quantize_dynamically(&Tensor::zeros(&[1]), |x| x),
            (Tensor::new(&[1], vec![0]), 0.0, 0),
            "zeros alone"
        );
    }

    #[test]
    fn the_precision_of_the_quotient_decides_a_tie() {
        let x = Tensor::new(&[3], vec![2.0, -3.0, -2.5]);
        assert_eq!(quantize_dynamically(&x, |x| x).0.data, [255, 0, 25], "−127.5 and 153");
        assert_eq!(
            quantize_dynamically(&x, |x| f64::from(x as f32)).0.data,
            [255, 0, 26],
            "−127.49999 and 153"
        );
    }
}

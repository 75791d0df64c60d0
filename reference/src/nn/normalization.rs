//! Batch, group, instance and layer normalisation.
//!
//! All are y = s·(x − μ)/√(v + ε) + b and differ in where μ and v come from: stored (batch, at inference), or the mean and
//! the biased variance of the elements that are normalised together.
//!
//! # Rounding
//! An implementation may fold scale and offset, x·a + (b − μ·a) with a = s/√(v + ε), or centre first. Both are sums, so
//! the rule for sums of any order covers them: m = |a|(|x| + |μ|) + |b|, not |y|; six roundings when μ and v are stored.
//!
//! Statistics over N elements come in one pass, v = E\[x²\] − μ², or two, v = E\[(x − μ)²\]. The rules applied to the two-pass
//! form, with |x − μ| bounded by |x| + E|x|, give v the magnitude E\[(|x| + E|x|)²\] ≥ E\[x²\] + (E|x|)² and 3N + 6 roundings,
//! which contains the one-pass form (magnitude E\[x²\] + (E|x|)², 2N + 4 roundings). Through 1/√(v + ε), whose relative slope
//! is ½/(v + ε), the condition κ ≈ E\[x²\]/v enters the bound of y: data far from zero for its spread normalise badly.

use super::pooling::mean_of;
use super::{Scalar, Tensor};

/// A scale and an offset per channel, and the statistics of one set of elements.
fn normalized<T: Scalar>(x: T, mean: T, deviation: T, scale: T, bias: T) -> T {
    (x.plus(-mean) * (scale / deviation)).plus(bias)
}

/// The mean and √(biased variance + ε) of elements that are normalised together.
fn statistics<T: Scalar>(x: &[T], epsilon: f64) -> (T, T) {
    let mean = mean_of(x.iter().copied().fold(T::ZERO, T::plus), x.len());
    let squares = x.iter().fold(T::ZERO, |sum, &x| {
        let centred = x.plus(-mean);
        sum.plus_product(centred, centred)
    });
    (mean, (mean_of(squares, x.len()) + T::exact(epsilon)).sqrt())
}

fn assert_per_channel<T: Copy>(operator: &str, x: &Tensor<T>, parameters: &[(&str, &Tensor<T>)]) {
    assert!(x.rank() > 1, "{operator}: x must be [N,C,…], found shape {:?}", x.shape);
    for (name, p) in parameters {
        assert!(
            p.shape == [x.shape[1]],
            "{operator}: {name} has shape {:?}, x {:?} needs [{}]",
            p.shape,
            x.shape,
            x.shape[1]
        );
    }
}

/// Batch normalisation at inference: x [N,C,…] with a stored mean \[C\] and variance \[C\], scale \[C\] and bias \[C\].
///
/// # Panics
/// If a parameter has not one number per channel.
///
/// # References
/// ONNX operator BatchNormalization (version 15, training_mode 0).
pub fn batch_norm<T: Scalar>(
    x: &Tensor<T>,
    scale: &Tensor<T>,
    bias: &Tensor<T>,
    mean: &Tensor<T>,
    variance: &Tensor<T>,
    epsilon: f64,
) -> Tensor<T> {
    let parameters = [("scale", scale), ("bias", bias), ("mean", mean), ("variance", variance)];
    assert_per_channel("batch_norm", x, &parameters);
    let channels = x.shape[1];
    let pixels: usize = x.shape[2..].iter().product();
    let mut y = x.clone();
    for (image, plane) in y.data.chunks_exact_mut(pixels.max(1)).enumerate() {
        let c = image % channels;
        let deviation = (variance.data[c] + T::exact(epsilon)).sqrt();
        for y in plane {
            *y = normalized(*y, mean.data[c], deviation, scale.data[c], bias.data[c]);
        }
    }
    y
}

/// Group normalisation: each sample's channels in `groups` equal runs, each run normalised over its channels and pixels.
///
/// x [N,C,…], scale \[C\] and bias \[C\].
///
/// # Panics
/// If the groups do not divide the channels, or a parameter has not one number per channel.
///
/// # References
/// Wu and He, Group Normalization, ECCV 2018; ONNX operator GroupNormalization (version 21).
pub fn group_norm<T: Scalar>(
    x: &Tensor<T>,
    groups: usize,
    scale: &Tensor<T>,
    bias: &Tensor<T>,
    epsilon: f64,
) -> Tensor<T> {
    assert_per_channel("group_norm", x, &[("scale", scale), ("bias", bias)]);
    let channels = x.shape[1];
    assert!(
        groups > 0 && channels.is_multiple_of(groups),
        "group_norm: {groups} groups do not divide the {channels} channels of x {:?}",
        x.shape
    );
    let pixels: usize = x.shape[2..].iter().product();
    let per_group = channels / groups;
    let mut y = x.clone();
    for (run, elements) in y.data.chunks_exact_mut((per_group * pixels).max(1)).enumerate() {
        let (mean, deviation) = statistics(elements, epsilon);
        for (k, plane) in elements.chunks_exact_mut(pixels.max(1)).enumerate() {
            let c = run % groups * per_group + k;
            for y in plane {
                *y = normalized(*y, mean, deviation, scale.data[c], bias.data[c]);
            }
        }
    }
    y
}

/// Instance normalisation: group normalisation with one channel per group.
///
/// # Panics
/// As [`group_norm`].
///
/// # References
/// ONNX operator InstanceNormalization (versions 6 and 22 agree).
pub fn instance_norm<T: Scalar>(
    x: &Tensor<T>,
    scale: &Tensor<T>,
    bias: &Tensor<T>,
    epsilon: f64,
) -> Tensor<T> {
    assert_per_channel("instance_norm", x, &[("scale", scale), ("bias", bias)]);
    group_norm(x, x.shape[1], scale, bias, epsilon)
}

/// Layer normalisation over the last axes, those from `axis` on; scale and bias have the shape of these axes.
///
/// # Panics
/// If scale or bias has another shape.
///
/// # References
/// Ba, Kiros and Hinton, Layer Normalization, 2016; ONNX operator LayerNormalization (version 17).
pub fn layer_norm<T: Scalar>(
    x: &Tensor<T>,
    axis: usize,
    scale: &Tensor<T>,
    bias: &Tensor<T>,
    epsilon: f64,
) -> Tensor<T> {
    let inner = x.shape.get(axis..).unwrap_or_default();
    assert!(
        !inner.is_empty() && scale.shape == inner && bias.shape == inner,
        "layer_norm: scale {:?} and bias {:?} must have the axes of x {:?} from axis {axis} on",
        scale.shape,
        bias.shape,
        x.shape
    );
    let mut y = x.clone();
    for elements in y.data.chunks_exact_mut(scale.data.len().max(1)) {
        let (mean, deviation) = statistics(elements, epsilon);
        for ((y, &scale), &bias) in elements.iter_mut().zip(&scale.data).zip(&bias.data) {
            *y = normalized(*y, mean, deviation, scale, bias);
        }
    }
    y
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::*;

    fn vector(values: &[f64]) -> Tensor {
        Tensor::new(&[values.len()], values.to_vec())
    }

    #[test]
    fn batch_norm_is_an_affine_map_of_each_channel() {
        let x = Tensor::new(&[1, 2, 2], vec![5.0, 7.0, 1.0, 2.0]);
        let y = batch_norm(
            &x,
            &vector(&[2.0, 1.0]),
            &vector(&[0.5, 0.0]),
            &vector(&[5.0, 1.0]),
            &vector(&[3.0, 0.0]),
            1.0,
        );
        assert_eq!(y.data, [0.5, 2.5, 0.0, 1.0]);
    }

    #[test]
    fn stored_statistics_cost_six_roundings_on_the_uncancelled_magnitude() {
        let r = |v: f64| vector(&[v]).rounded();
        let x = Tensor::new(&[1, 1, 1], vec![5.25]).rounded();
        let y = batch_norm(&x, &r(2.0), &r(-1.0), &r(5.0), &r(3.0), 1.0).data[0];
        assert_eq!((y.value, y.magnitude, y.terms), (-0.75, 11.25, 6.0));
    }

    #[test]
    fn groups_are_runs_of_channels() {
        let x = Tensor::new(&[1, 4, 1], vec![1.0, 3.0, 10.0, 10.0]);
        let y = group_norm(&x, 2, &vector(&[1.0; 4]), &vector(&[0.0, 0.0, 0.0, 7.0]), 0.0);
        assert_eq!(&y.data[..2], [-1.0, 1.0]);
        assert!(y.data[2].is_nan(), "no spread and no epsilon: 0/0");
        let y = group_norm(&x, 2, &vector(&[1.0; 4]), &vector(&[0.0, 0.0, 0.0, 7.0]), 1e-5);
        assert_eq!(&y.data[2..], [0.0, 7.0]);
    }

    #[test]
    fn agrees_with_pytorch() {
        let (x, s, b) = (pattern(&[2, 6, 3, 2], 1), pattern(&[6], 2), pattern(&[6], 3));
        check(&group_norm(&x, 3, &s, &b, 1e-5), &goldens::GROUP_NORM);
        check(&instance_norm(&x, &s, &b, 1e-5), &goldens::INSTANCE_NORM);
        let (m, v) = (pattern(&[6], 4), pattern(&[6], 5).map(|v| v * v));
        check(&batch_norm(&x, &s, &b, &m, &v, 1e-5), &goldens::BATCH_NORM);
        let (s, b) = (pattern(&[3, 2], 6), pattern(&[3, 2], 7));
        check(&layer_norm(&x, 2, &s, &b, 1e-5), &goldens::LAYER_NORM);
    }

    /// Group normalisation of one group in f32, with the variance in one pass or in two.
    fn in_f32(x: &[f32], epsilon: f32, one_pass: bool) -> Vec<f32> {
        let n = x.len() as f32;
        let mean = x.iter().sum::<f32>() / n;
        let variance = if one_pass {
            x.iter().map(|x| x * x).sum::<f32>() / n - mean * mean
        } else {
            x.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>() / n
        };
        let scale = 1.0 / (variance + epsilon).sqrt();
        x.iter().map(|x| if one_pass { x * scale - mean * scale } else { (x - mean) * scale }).collect()
    }

    #[test]
    fn the_bound_covers_one_pass_and_two_pass_variance_in_f32() {
        for offset in [0.0, 1.0, 30.0] {
            let x: Vec<f32> = pattern(&[200], 1).data.iter().map(|&v| (v + offset) as f32).collect();
            let exact = Tensor::new(&[1, 1, 200], x.iter().map(|&v| f64::from(v)).collect()).rounded();
            let one = |v: f64| vector(&[v]).rounded();
            let y = group_norm(&exact, 1, &one(1.0), &one(0.0), 1e-5);
            let bounds = y.bounds(super::super::UNIT_ROUNDOFF_F32);
            for one_pass in [false, true] {
                for ((y, f32), bound) in
                    y.values().data.iter().zip(in_f32(&x, 1e-5, one_pass)).zip(&bounds.data)
                {
                    let error = (f64::from(f32) - y).abs();
                    assert!(error <= *bound, "offset {offset}: error {error:e} exceeds {bound:e}");
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "4 groups do not divide the 6 channels")]
    fn groups_must_divide_the_channels() {
        let p = Tensor::<f64>::zeros(&[6]);
        group_norm(&Tensor::zeros(&[1, 6, 2]), 4, &p, &p, 1e-5);
    }
}

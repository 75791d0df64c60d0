//! Batch, group, instance, layer and mean–variance normalisation.
//!
//! All are y = s·(x − μ)/√(v + ε) + b and differ in where μ and v come from: stored (batch, at inference), or the mean and
//! the biased variance of the elements that are normalised together.
//!
//! # Conventions
//! ε is added to the variance, under the root; only [`mean_variance_norm`] adds its ε to the deviation. The variance is the biased one, /N,
//! not /(N − 1), also where batch normalisation keeps it for later: PyTorch keeps the unbiased one.
//!
//! # Rounding
//! An implementation may fold scale and offset, x·a + (b − μ·a) with a = s/√(v + ε), or centre first. Both are sums, so
//! the rule for sums of any order covers them: m = |a|(|x| + |μ|) + |b|, not |y|; six roundings when μ and v are stored.
//!
//! Statistics over N elements come in one pass, v = E\[x²\] − μ², or two, v = E\[(x − μ)²\]. The rules applied to the two-pass
//! form, with |x − μ| bounded by |x| + E|x|, give v the magnitude E\[(|x| + E|x|)²\] ≥ E\[x²\] + (E|x|)² and 3N + 6 roundings,
//! which contains the one-pass form (magnitude E\[x²\] + (E|x|)², 2N + 4 roundings). Through 1/√(v + ε), whose relative slope
//! is ½/(v + ε), the condition κ ≈ E\[x²\]/v enters the bound of y: data far from zero for its spread normalise badly.

use super::elementwise::broadcast;
use super::movement::expand;
use super::pooling::mean_of;
use super::reduction::{mean, reduce};
use super::{Scalar, Tensor};

/// A scale and an offset per channel, and the statistics of one set of elements.
fn normalized<T: Scalar>(x: T, mean: T, deviation: T, scale: T, bias: T) -> T {
    (x.plus(-mean) * (scale / deviation)).plus(bias)
}

/// The mean and the biased variance of elements that are normalised together.
fn moments<T: Scalar>(x: &[T]) -> (T, T) {
    let mean = mean(x);
    let squares = x.iter().fold(T::ZERO, |sum, &x| {
        let centred = x.plus(-mean);
        sum.plus_product(centred, centred)
    });
    (mean, mean_of(squares, x.len()))
}

/// The mean and √(biased variance + ε) of elements that are normalised together.
fn statistics<T: Scalar>(x: &[T], epsilon: T) -> (T, T) {
    let (mean, variance) = moments(x);
    (mean, (variance + epsilon).sqrt())
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
    epsilon: T,
) -> Tensor<T> {
    let parameters = [("scale", scale), ("bias", bias), ("mean", mean), ("variance", variance)];
    assert_per_channel("batch_norm", x, &parameters);
    let channels = x.shape[1];
    let pixels: usize = x.shape[2..].iter().product();
    let mut y = x.clone();
    for (image, plane) in y.data.chunks_exact_mut(pixels.max(1)).enumerate() {
        let c = image % channels;
        let deviation = (variance.data[c] + epsilon).sqrt();
        for y in plane {
            *y = normalized(*y, mean.data[c], deviation, scale.data[c], bias.data[c]);
        }
    }
    y
}

/// What batch normalisation in training gives.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchNormTraining<T> {
    /// x normalised with its own statistics.
    pub y: Tensor<T>,
    /// momentum·mean + (1 − momentum)·(the mean of x), per channel.
    pub mean: Tensor<T>,
    /// momentum·variance + (1 − momentum)·(the biased variance of x), per channel.
    pub variance: Tensor<T>,
}

/// Batch normalisation in training: x [N,C,…] is normalised over N and the pixels, the stored statistics move towards its own.
///
/// # Conventions
/// `momentum` is the share of what is stored (ONNX, 0.9); PyTorch's momentum (0.1) is the share of what is new.
///
/// # Panics
/// As [`batch_norm`].
///
/// # References
/// ONNX operator BatchNormalization (version 15, training_mode 1).
pub fn batch_norm_training<T: Scalar>(
    x: &Tensor<T>,
    [scale, bias, mean, variance]: [&Tensor<T>; 4],
    epsilon: T,
    momentum: T,
) -> BatchNormTraining<T> {
    let parameters = [("scale", scale), ("bias", bias), ("mean", mean), ("variance", variance)];
    assert_per_channel("batch_norm_training", x, &parameters);
    let others: Vec<usize> = (0..x.rank()).filter(|&axis| axis != 1).collect();
    let own = reduce(x, &others, false, moments);
    let (own_mean, own_variance) = (own.map(|(mean, _)| mean), own.map(|(_, variance)| variance));
    let new = T::exact(1.0) - momentum;
    let moved = |stored, own| broadcast("batch_norm", stored, own, |s: T, o: T| (s * momentum).plus(o * new));
    BatchNormTraining {
        y: batch_norm(x, scale, bias, &own_mean, &own_variance, epsilon),
        mean: moved(mean, &own_mean),
        variance: moved(variance, &own_variance),
    }
}

/// Group normalisation: each sample's channels in `groups` equal runs, each run normalised over its channels and pixels.
///
/// x [N,C,…], scale \[C\] and bias \[C\].
///
/// # Conventions
/// Version 18 of the operator has one scale and bias per group, version 21 and PyTorch one per channel: repeat the former for
/// each channel of its group ([`per_channel`]).
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
    epsilon: T,
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

/// One parameter per group, repeated for each channel of its group.
///
/// # Panics
/// If the groups do not divide the channels.
pub fn per_channel<T: Copy>(per_group: &Tensor<T>, channels: usize) -> Tensor<T> {
    let groups = per_group.data.len();
    assert!(
        groups > 0 && channels.is_multiple_of(groups),
        "per_channel: {groups} groups do not divide {channels} channels"
    );
    expand(&per_group.reshape(&[groups, 1]), &[groups, channels / groups]).reshape(&[channels])
}

/// Instance normalisation: group normalisation with one channel per group.
///
/// # Panics
/// As [`group_norm`].
///
/// # References
/// ONNX operator InstanceNormalization (versions 6 and 22 agree).
pub fn instance_norm<T: Scalar>(x: &Tensor<T>, scale: &Tensor<T>, bias: &Tensor<T>, epsilon: T) -> Tensor<T> {
    assert_per_channel("instance_norm", x, &[("scale", scale), ("bias", bias)]);
    group_norm(x, x.shape[1], scale, bias, epsilon)
}

/// What layer normalisation gives.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerNorm<T> {
    /// The shape of x.
    pub y: Tensor<T>,
    /// The means; the axes that were normalised have length one.
    pub mean: Tensor<T>,
    /// 1/√(v + ε), in the same shape.
    pub inverse_deviation: Tensor<T>,
}

/// Layer normalisation over the last axes, those from `axis` on; scale and bias broadcast to x.
///
/// Usually scale and bias have the shape of the axes that are normalised.
///
/// # Panics
/// If the axis is not one of x, or scale or bias does not broadcast to x.
///
/// # References
/// Ba, Kiros and Hinton, Layer Normalization, 2016; ONNX operator LayerNormalization (version 17).
pub fn layer_norm<T: Scalar>(
    x: &Tensor<T>,
    axis: usize,
    scale: &Tensor<T>,
    bias: Option<&Tensor<T>>,
    epsilon: T,
) -> LayerNorm<T> {
    assert!(axis < x.rank(), "layer_norm: axis {axis} does not lie in shape {:?}", x.shape);
    let axes: Vec<usize> = (axis..x.rank()).collect();
    let statistics = reduce(x, &axes, true, |x| statistics(x, epsilon));
    let of_element = broadcast("layer_norm", x, scale, |x, scale| (x, scale));
    let bias = bias.cloned().unwrap_or_else(|| Tensor::zeros(&[]));
    let affine = broadcast("layer_norm", &of_element, &bias, |(x, scale), bias| (x, scale, bias));
    assert!(
        affine.shape == x.shape,
        "layer_norm: scale {:?} and bias {:?} do not broadcast to x {:?}",
        scale.shape,
        bias.shape,
        x.shape
    );
    LayerNorm {
        y: broadcast("layer_norm", &affine, &statistics, |(x, scale, bias), (mean, deviation)| {
            normalized(x, mean, deviation, scale, bias)
        }),
        mean: statistics.map(|(mean, _)| mean),
        inverse_deviation: statistics.map(|(_, deviation)| T::exact(1.0) / deviation),
    }
}

/// (x − μ)/(√v + ε) with the mean and the biased variance over the given axes.
///
/// # Conventions
/// The specification's formula has no ε, its function body 10⁻⁹ beside the root.
///
/// # Panics
/// If an axis is not one of x.
///
/// # References
/// ONNX operator MeanVarianceNormalization (version 13).
pub fn mean_variance_norm<T: Scalar>(x: &Tensor<T>, axes: &[usize], epsilon: T) -> Tensor<T> {
    let statistics = reduce(x, axes, true, moments);
    broadcast("mean_variance_norm", x, &statistics, |x, (mean, variance)| {
        normalized(x, mean, variance.sqrt() + epsilon, T::exact(1.0), T::ZERO)
    })
}

#[cfg(test)]
mod tests {
    use super::super::Rounded;
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
        let y = batch_norm(&x, &r(2.0), &r(-1.0), &r(5.0), &r(3.0), Rounded::exact(1.0)).data[0];
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
        check(&layer_norm(&x, 2, &s, Some(&b), 1e-5).y, &goldens::LAYER_NORM);
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
            let y = group_norm(&exact, 1, &one(1.0), &one(0.0), Rounded::exact(1e-5));
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
    fn training_normalises_with_its_own_statistics_and_moves_the_stored_ones() {
        let x = Tensor::new(&[2, 1, 2], vec![1.0, 3.0, 5.0, 7.0]);
        let stored = [&vector(&[2.0]), &vector(&[0.5]), &vector(&[10.0]), &vector(&[1.0])];
        let trained = batch_norm_training(&x, stored, 0.0, 0.75);
        let deviation = 5f64.sqrt();
        let expected = [-3.0, -1.0, 1.0, 3.0].map(|c| 2.0 * c / deviation + 0.5);
        assert!(trained.y.data.iter().zip(expected).all(|(y, e)| (y - e).abs() < 1e-15), "{trained:?}");
        assert_eq!((trained.mean.data[0], trained.variance.data[0]), (8.5, 2.0), "¾·10 + ¼·4, ¾·1 + ¼·5");
    }

    #[test]
    fn layers_give_their_statistics_and_scales_broadcast() {
        let x = Tensor::new(&[2, 2], vec![1.0, 3.0, 10.0, 10.0]);
        let y = layer_norm(&x, 1, &Tensor::new(&[2, 1], vec![1.0, 5.0]), None, 1.0);
        assert_eq!(y.mean, Tensor::new(&[2, 1], vec![2.0, 10.0]));
        assert_eq!(y.inverse_deviation.data, [1.0 / 2f64.sqrt(), 1.0]);
        assert!((y.y.data[0] + 1.0 / 2f64.sqrt()).abs() < 1e-15 && y.y.data[2..] == [0.0, 0.0], "{y:?}");
    }

    #[test]
    fn mean_and_variance_over_chosen_axes() {
        let x = Tensor::new(&[2, 2], vec![1.0, 5.0, 3.0, 9.0]);
        let y = mean_variance_norm(&x, &[0], 0.0);
        assert_eq!(y.data, [-1.0, -1.0, 1.0, 1.0]);
    }

    #[test]
    fn each_channel_has_the_parameter_of_its_group() {
        assert_eq!(per_channel(&Tensor::new(&[2], vec![1, 2]), 6).data, [1, 1, 1, 2, 2, 2]);
    }

    #[test]
    #[should_panic(expected = "4 groups do not divide the 6 channels")]
    fn groups_must_divide_the_channels() {
        let p = Tensor::<f64>::zeros(&[6]);
        group_norm(&Tensor::zeros(&[1, 6, 2]), 4, &p, &p, 1e-5);
    }
}

//! Layers: an operator with its weights, taken by name. The number of outputs is read off the weight; the number of inputs
//! is what the layer before gives. Applied to numbers that track rounding, a layer's weights are exact.

use super::Weights;
use crate::nn::{self, Conv, ConvTranspose, Scalar, Tensor};

/// ε of every normalisation, PyTorch's default.
const EPSILON: f64 = 1e-5;

/// A convolution, with a bias or without.
#[derive(Clone, Debug)]
pub(super) struct Convolution {
    weight: Tensor,
    bias: Option<Tensor>,
    geometry: Conv,
}

impl Convolution {
    /// `{name}.weight` [O,inputs,side,…] and `{name}.bias` [O] for as many axes as the geometry has.
    pub fn take(
        weights: &mut Weights,
        name: &str,
        inputs: usize,
        side: usize,
        geometry: Conv,
    ) -> Convolution {
        let bare = Convolution::take_without_bias(weights, name, inputs, side, geometry);
        let bias = weights.take(&format!("{name}.bias"), &[bare.outputs()]);
        Convolution { bias: Some(bias), ..bare }
    }

    /// `{name}.weight` [O,inputs,side,…] alone: a normalisation that follows would cancel a bias.
    pub fn take_without_bias(
        weights: &mut Weights,
        name: &str,
        inputs: usize,
        side: usize,
        geometry: Conv,
    ) -> Convolution {
        let outputs = weights.shape(&format!("{name}.weight")).first().copied().unwrap_or(0);
        let shape = [vec![outputs, inputs], vec![side; geometry.stride.len()]].concat();
        Convolution { weight: weights.take(&format!("{name}.weight"), &shape), bias: None, geometry }
    }

    /// The number of channels it gives.
    pub fn outputs(&self) -> usize {
        self.weight.shape[0]
    }

    /// The layer applied.
    pub fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        let bias = self.bias.as_ref().map(lifted);
        nn::conv(x, &lifted(&self.weight), bias.as_ref(), &self.geometry)
    }
}

/// Weights, known without error, as the numbers of the pass.
fn lifted<T: Scalar>(weight: &Tensor) -> Tensor<T> {
    weight.map(T::exact)
}

/// A fully connected layer.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    weight: Tensor,
    bias: Tensor,
}

impl Linear {
    /// `{name}.weight` [O,inputs] and `{name}.bias` [O].
    pub fn take(weights: &mut Weights, name: &str, inputs: usize) -> Linear {
        let outputs = weights.shape(&format!("{name}.bias")).first().copied().unwrap_or(0);
        Linear {
            weight: weights.take(&format!("{name}.weight"), &[outputs, inputs]),
            bias: weights.take(&format!("{name}.bias"), &[outputs]),
        }
    }

    /// The number of values it gives.
    pub fn outputs(&self) -> usize {
        self.weight.shape[0]
    }

    /// The layer applied.
    pub fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        nn::linear(x, &lifted(&self.weight), &lifted(&self.bias))
    }
}

/// A transposed convolution with bias, kernel 4, stride 2, padding 1: it doubles the side.
#[derive(Clone, Debug)]
pub(super) struct Doubling {
    weight: Tensor,
    bias: Tensor,
}

impl Doubling {
    /// `{name}.weight` [inputs,O,4,4] and `{name}.bias` [O].
    pub fn take(weights: &mut Weights, name: &str, inputs: usize) -> Doubling {
        let outputs = weights.shape(&format!("{name}.bias"))[0];
        Doubling {
            weight: weights.take(&format!("{name}.weight"), &[inputs, outputs, 4, 4]),
            bias: weights.take(&format!("{name}.bias"), &[outputs]),
        }
    }

    /// The layer applied.
    pub fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        nn::conv_transpose(
            x,
            &lifted(&self.weight),
            Some(&lifted(&self.bias)),
            &ConvTranspose::new(2).stride(2).padding(1),
        )
    }
}

/// Group normalisation with a fixed number of channels per group.
#[derive(Clone, Debug)]
pub(super) struct GroupNorm {
    groups: usize,
    scale: Tensor,
    bias: Tensor,
}

impl GroupNorm {
    /// `{name}.weight` [channels] and `{name}.bias` [channels].
    pub fn take(weights: &mut Weights, name: &str, channels: usize, per_group: usize) -> GroupNorm {
        assert!(
            channels.is_multiple_of(per_group),
            "{name}: groups of {per_group} channels do not divide {channels} channels"
        );
        GroupNorm {
            groups: channels / per_group,
            scale: weights.take(&format!("{name}.weight"), &[channels]),
            bias: weights.take(&format!("{name}.bias"), &[channels]),
        }
    }

    /// The layer applied.
    pub fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        nn::group_norm(x, self.groups, &lifted(&self.scale), &lifted(&self.bias), T::exact(EPSILON))
    }
}

/// Batch normalisation at inference.
#[derive(Clone, Debug)]
pub(super) struct BatchNorm {
    scale: Tensor,
    bias: Tensor,
    mean: Tensor,
    variance: Tensor,
}

impl BatchNorm {
    /// `{name}.weight`, `.bias`, `.running_mean` and `.running_var`, all [channels].
    pub fn take(weights: &mut Weights, name: &str, channels: usize) -> BatchNorm {
        let mut take = |part: &str| weights.take(&format!("{name}.{part}"), &[channels]);
        BatchNorm {
            scale: take("weight"),
            bias: take("bias"),
            mean: take("running_mean"),
            variance: take("running_var"),
        }
    }

    /// The layer applied.
    pub fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        let [scale, bias, mean, variance] = [&self.scale, &self.bias, &self.mean, &self.variance].map(lifted);
        nn::batch_norm(x, &scale, &bias, &mean, &variance, T::exact(EPSILON))
    }
}

/// The name and shape of a weight and its bias, for listing what a network needs.
pub(super) fn pair(name: &str, weight: &[usize], bias: usize) -> [(String, Vec<usize>); 2] {
    [(format!("{name}.weight"), weight.to_vec()), (format!("{name}.bias"), vec![bias])]
}

/// The names and shapes of a batch normalisation's weights.
pub(super) fn batch_norm_weights(name: &str, channels: usize) -> [(String, Vec<usize>); 4] {
    ["weight", "bias", "running_mean", "running_var"].map(|part| (format!("{name}.{part}"), vec![channels]))
}

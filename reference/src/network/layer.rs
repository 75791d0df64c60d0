//! Layers: an operator with its weights, taken by name. The number of outputs is read off the weight; the number of inputs
//! is what the layer before gives.

use super::Weights;
use crate::nn::{self, Conv, ConvTranspose, Tensor};

/// ε of every normalisation, PyTorch's default.
const EPSILON: f64 = 1e-5;

/// A convolution with bias.
#[derive(Clone, Debug)]
pub(super) struct Convolution {
    weight: Tensor,
    bias: Tensor,
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
        let outputs = weights.shape(&format!("{name}.weight"))[0];
        let shape = [vec![outputs, inputs], vec![side; geometry.stride.len()]].concat();
        Convolution {
            weight: weights.take(&format!("{name}.weight"), &shape),
            bias: weights.take(&format!("{name}.bias"), &[outputs]),
            geometry,
        }
    }

    /// The number of channels it gives.
    pub fn outputs(&self) -> usize {
        self.bias.shape[0]
    }

    /// The layer applied.
    pub fn apply(&self, x: &Tensor) -> Tensor {
        nn::conv(x, &self.weight, Some(&self.bias), &self.geometry)
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
    pub fn apply(&self, x: &Tensor) -> Tensor {
        nn::conv_transpose(x, &self.weight, Some(&self.bias), &ConvTranspose::new(2).stride(2).padding(1))
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
    pub fn apply(&self, x: &Tensor) -> Tensor {
        nn::group_norm(x, self.groups, &self.scale, &self.bias, EPSILON)
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
    pub fn apply(&self, x: &Tensor) -> Tensor {
        nn::batch_norm(x, &self.scale, &self.bias, &self.mean, &self.variance, EPSILON)
    }
}

/// The name and shape of a weight and its bias, for listing what a network needs.
pub(super) fn pair(name: &str, weight: &[usize], bias: usize) -> [(String, Vec<usize>); 2] {
    [(format!("{name}.weight"), weight.to_vec()), (format!("{name}.bias"), vec![bias])]
}

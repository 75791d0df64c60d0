//! ResNet with bottlenecks: an image becomes one vector of features.
//!
//! | stage | operators | channels × side at 224, ResNet-50 |
//! |---|---|---|
//! | stem | conv 7×7 stride 2, batch norm, ReLU, max-pool 3×3 stride 2 | 64 × 56² |
//! | layer1 | 3 bottlenecks | 256 × 56² |
//! | layer2 | 4 bottlenecks, the first with stride 2 | 512 × 28² |
//! | layer3 | 6 bottlenecks, the first with stride 2 | 1024 × 14² |
//! | layer4 | 3 bottlenecks, the first with stride 2 | 2048 × 7² |
//! | feature | mean over the pixels | 2048 |
//!
//! A bottleneck of p planes maps x to ReLU(F(x) + S(x)): F is 1×1 → p, 3×3 → p, 1×1 → 4p, each with batch norm and the
//! first two with ReLU; the shortcut S is x itself, or a 1×1 convolution with batch norm where channels or side change.
//! Batch norms cancel a bias, so no convolution has one.
//!
//! # Conventions
//! The stride is on the 3×3 convolution ("version 1.5", torchvision's); the paper has it on the first 1×1, which then
//! never sees three pixels of four. The names of the weights are torchvision's.
//!
//! # References
//! He, Zhang, Ren, Sun, "Deep Residual Learning for Image Recognition", CVPR 2016, §4.1 and table 1.

use super::layer::{BatchNorm, Convolution, batch_norm_weights};
use super::{Stages, Weights};
use crate::nn::{self, Conv, Pool, Scalar, Tensor};

/// Bottlenecks per layer of ResNet-50.
pub const BLOCKS: [usize; 4] = [3, 4, 6, 3];

/// Channels that a bottleneck gives for each of its planes.
pub const EXPANSION: usize = 4;

/// Name and shape of every weight of a ResNet-50 with these planes per layer; the stem has the planes of the first.
pub fn weights(planes: [usize; 4]) -> Vec<(String, Vec<usize>)> {
    let mut list = Vec::new();
    let mut layer = |conv: String, norm: String, outputs: usize, inputs: usize, side: usize| {
        list.push((format!("{conv}.weight"), vec![outputs, inputs, side, side]));
        list.extend(batch_norm_weights(&norm, outputs));
    };
    layer("conv1".into(), "bn1".into(), planes[0], 3, 7);
    let mut inputs = planes[0];
    for (l, (blocks, planes)) in BLOCKS.into_iter().zip(planes).enumerate() {
        for k in 0..blocks {
            let name = |part: &str| format!("layer{}.{k}.{part}", l + 1);
            let outputs = EXPANSION * planes;
            layer(name("conv1"), name("bn1"), planes, inputs, 1);
            layer(name("conv2"), name("bn2"), planes, planes, 3);
            layer(name("conv3"), name("bn3"), outputs, planes, 1);
            if k == 0 {
                layer(name("downsample.0"), name("downsample.1"), outputs, inputs, 1);
            }
            inputs = outputs;
        }
    }
    list
}

/// A convolution and the batch normalisation after it.
#[derive(Clone, Debug)]
struct Normed {
    conv: Convolution,
    norm: BatchNorm,
}

impl Normed {
    fn take(
        weights: &mut Weights,
        [conv, norm]: [&str; 2],
        inputs: usize,
        side: usize,
        geometry: Conv,
    ) -> Normed {
        let conv = Convolution::take_without_bias(weights, conv, inputs, side, geometry);
        let norm = BatchNorm::take(weights, norm, conv.outputs());
        Normed { conv, norm }
    }

    fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        self.norm.apply(&self.conv.apply(x))
    }
}

#[derive(Clone, Debug)]
struct Bottleneck {
    convs: [Normed; 3],
    downsample: Option<Normed>,
}

impl Bottleneck {
    fn take(weights: &mut Weights, name: &str, inputs: usize, stride: usize, downsample: bool) -> Bottleneck {
        let mut take = |conv: &str, norm: &str, inputs, side, geometry| {
            let names = [&*format!("{name}.{conv}"), &*format!("{name}.{norm}")];
            Normed::take(weights, names, inputs, side, geometry)
        };
        let narrow = take("conv1", "bn1", inputs, 1, Conv::new(2));
        let planes = narrow.conv.outputs();
        let spatial = take("conv2", "bn2", planes, 3, Conv::new(2).stride(stride).padding(1));
        let widen = take("conv3", "bn3", planes, 1, Conv::new(2));
        let outputs = widen.conv.outputs();
        let downsample =
            downsample.then(|| take("downsample.0", "downsample.1", inputs, 1, Conv::new(2).stride(stride)));
        let shortcut = downsample.as_ref().map_or(inputs, |normed| normed.conv.outputs());
        assert!(
            spatial.conv.outputs() == planes && shortcut == outputs,
            "{name}: the convolutions give {planes}, {} and {outputs} channels, the shortcut {shortcut}",
            spatial.conv.outputs()
        );
        Bottleneck { convs: [narrow, spatial, widen], downsample }
    }

    fn apply<T: Scalar>(&self, x: &Tensor<T>) -> Tensor<T> {
        let [narrow, spatial, widen] = &self.convs;
        let y = nn::relu(&narrow.apply(x));
        let y = nn::relu(&spatial.apply(&y));
        let y = widen.apply(&y);
        let shortcut = self.downsample.as_ref().map_or_else(|| x.clone(), |normed| normed.apply(x));
        nn::relu(&nn::add(&y, &shortcut))
    }
}

/// Images to features.
#[derive(Clone, Debug)]
pub struct ResNet {
    stem: Normed,
    layers: [Vec<Bottleneck>; 4],
    features: usize,
}

impl ResNet {
    /// Takes the weights listed by [`weights`], whose shapes give the widths, and leaves the others.
    ///
    /// # Panics
    /// If a weight is missing or has a shape that does not fit its neighbours.
    pub fn take(weights: &mut Weights) -> ResNet {
        let geometry = Conv::new(2).stride(2).padding(3);
        let stem = Normed::take(weights, ["conv1", "bn1"], 3, 7, geometry);
        let mut channels = stem.conv.outputs();
        let layers = std::array::from_fn(|l| {
            let bottleneck = |k: usize| {
                let stride = if l > 0 && k == 0 { 2 } else { 1 };
                let name = format!("layer{}.{k}", l + 1);
                let bottleneck = Bottleneck::take(weights, &name, channels, stride, k == 0);
                channels = bottleneck.convs[2].conv.outputs();
                bottleneck
            };
            (0..BLOCKS[l]).map(bottleneck).collect()
        });
        ResNet { stem, layers, features: channels }
    }

    /// The length of the feature.
    pub fn features(&self) -> usize {
        self.features
    }

    /// Images \[N,3,H,W\] → stages `stem`, `layer1` … `layer4` [N,C,·,·] and `feature` \[N,C\].
    ///
    /// # Panics
    /// If the images are not \[N,3,H,W\].
    pub fn forward<T: Scalar>(&self, images: &Tensor<T>) -> Stages<T> {
        assert!(
            images.rank() == 4 && images.shape[1] == 3,
            "ResNet: images must be [N,3,H,W], found shape {:?}",
            images.shape
        );
        let mut stages = Stages::default();
        let halving = Pool { stride: vec![2; 2], padding: vec![[1, 1]; 2], ..Pool::new(2, 3) };
        let stem = nn::max_pool(&nn::relu(&self.stem.apply(images)), &halving);
        let mut x = stages.record("stem", stem).clone();
        for (l, layer) in self.layers.iter().enumerate() {
            x = layer.iter().fold(x, |x, bottleneck| bottleneck.apply(&x));
            stages.record(format!("layer{}", l + 1), x.clone());
        }
        stages.record("feature", nn::reduce_mean(&x, &[2, 3], false));
        stages
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::goldens::pattern;

    const PLANES: [usize; 4] = [2, 3, 4, 5];

    fn tiny() -> ResNet {
        let mut weights = Weights::pattern(weights(PLANES));
        let net = ResNet::take(&mut weights);
        weights.finish();
        net
    }

    #[test]
    fn the_stride_is_on_the_three_by_three() {
        // Pixel (1, 1) lies where a 1×1 of stride 2 never looks; its neighbours' 3×3 do.
        let block = &tiny().layers[1][0];
        let x = Tensor::filled(&[1, EXPANSION * PLANES[0], 4, 4], 0.5);
        let mut touched = x.clone();
        for c in 0..x.shape[1] {
            let place = touched.offset(&[0, c, 1, 1]);
            touched.data[place] = -3.0;
        }
        let y = block.apply(&x);
        assert_eq!(y.shape, [1, EXPANSION * PLANES[1], 2, 2]);
        assert_ne!(y, block.apply(&touched));
    }

    #[test]
    fn each_layer_but_the_first_halves_the_map() {
        let stages = tiny().forward(&pattern(&[1, 3, 64, 96], 1));
        let shapes: Vec<(&str, &[usize])> = stages.iter().map(|(name, x)| (name, &x.shape[..])).collect();
        let expected: [(&str, &[usize]); 6] = [
            ("stem", &[1, 2, 16, 24]),
            ("layer1", &[1, 8, 16, 24]),
            ("layer2", &[1, 12, 8, 12]),
            ("layer3", &[1, 16, 4, 6]),
            ("layer4", &[1, 20, 2, 3]),
            ("feature", &[1, 20]),
        ];
        assert_eq!(shapes, expected);
    }

    #[test]
    #[should_panic(expected = "layer1.0: the convolutions give 2, 3 and 8 channels, the shortcut 8")]
    fn the_channels_of_a_bottleneck_must_fit() {
        let mut list = weights(PLANES);
        let conv = list.iter_mut().find(|w| w.0 == "layer1.0.conv2.weight").expect("listed");
        conv.1 = vec![3, 2, 3, 3];
        let bn = list.iter_mut().filter(|w| w.0.starts_with("layer1.0.bn2"));
        bn.for_each(|w| w.1 = vec![3]);
        ResNet::take(&mut Weights::pattern(list));
    }
}

//! MF-PIFu: multi-scale pixel-aligned features of several views, and the occupancy they imply (Li 2021, chapter 5).
//!
//! | block | operators | channels × side, thesis size |
//! |---|---|---|
//! | stem | conv 7×7, group norm, ReLU, max-pool 2 | 64 × 128² |
//! | hourglass_1.a | conv 3×3 stride 2, group norm, ReLU | 128 × 64² |
//! | hourglass_1.b | conv 3×3 stride 2, group norm, ReLU | 256 × 32² |
//! | hourglass_1.c | transposed conv 4×4 stride 2, group norm, + 1×1 of a, ReLU | 256 × 64² |
//! | hourglass_1.d = F₁ | transposed conv 4×4 stride 2, group norm, + 1×1 of the input, ReLU | 256 × 128² |
//! | hourglass_2…4 | max-pool 2, then as hourglass_1 | F₂ 256 × 64², F₃ 256 × 32², F₄ 256 × 16² |
//! | query | F₁…F₄ sampled at (u, v), and the depth | 1025 × P in each view |
//! | MLP | 1025 → 1024 → 512 → 128, leaky ReLU, mean over the views, → 1, sigmoid | P |
//!
//! The thesis leaves the stem's stride, the hourglass' interior, skips, norm and fusion open (errata E18–E20, E39); the
//! readings are those of PIFu, its ancestor: the hidden layers see the point's feature again, and the views are
//! joined by the mean of the last hidden layer and of that skip, not by a vote. Occupancy is 1 inside (erratum E17).
//!
//! # Why fixed channels per group?
//! Groups hold 2 (stem), 4 (a) or 8 channels, the thesis' 32 groups at its widths, at every width. So a network padded with
//! zero channels computes exactly what it computed before.
//!
//! # References
//! Li 2021, eq. 5.1–5.3 and §3.2 of chapter 5; Saito et al., PIFu, ICCV 2019.

use super::layer::{Convolution, Doubling, GroupNorm, pair};
use super::{Stages, Weights};
use crate::nn::{self, Conv, GridSample, PaddingMode, Pool, SampleMode, Tensor};

/// The widths of one MF-PIFu.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Channels of the stem.
    pub stem: usize,
    /// Channels of an hourglass at half its side.
    pub inner: usize,
    /// Channels of the features.
    pub out: usize,
    /// Widths of the hidden layers.
    pub hidden: [usize; 3],
}

/// The size that trains on a desk.
pub const SMALL: Size = Size { stem: 16, inner: 16, out: 32, hidden: [128, 64, 32] };

/// The size of Li 2021.
pub const THESIS: Size = Size { stem: 64, inner: 128, out: 256, hidden: [1024, 512, 128] };

/// Channels per group of the stem, of an hourglass' first convolution, and of the rest.
const PER_GROUP: [usize; 3] = [2, 4, 8];

impl Size {
    /// Length of a point's feature: four maps and the depth.
    pub fn feature(&self) -> usize {
        4 * self.out + 1
    }

    /// Name and shape of every weight of the encoder.
    pub fn encoder_weights(&self) -> Vec<(String, Vec<usize>)> {
        let &Size { stem, inner, out, .. } = self;
        let mut list = Vec::new();
        list.extend(pair("stem.conv", &[stem, 3, 7, 7], stem));
        list.extend(pair("stem.norm", &[stem], stem));
        for k in 0..4 {
            let inputs = if k == 0 { stem } else { out };
            let name = |layer: &str| format!("hourglasses.{k}.{layer}");
            list.extend(pair(&name("down1"), &[inner, inputs, 3, 3], inner));
            list.extend(pair(&name("down1_norm"), &[inner], inner));
            list.extend(pair(&name("down2"), &[out, inner, 3, 3], out));
            list.extend(pair(&name("down2_norm"), &[out], out));
            list.extend(pair(&name("up1"), &[out, out, 4, 4], out));
            list.extend(pair(&name("up1_norm"), &[out], out));
            list.extend(pair(&name("skip1"), &[out, inner, 1, 1], out));
            list.extend(pair(&name("up2"), &[out, out, 4, 4], out));
            list.extend(pair(&name("up2_norm"), &[out], out));
            list.extend(pair(&name("skip2"), &[out, inputs, 1, 1], out));
        }
        list
    }

    /// Name and shape of every weight of the query.
    pub fn query_weights(&self) -> Vec<(String, Vec<usize>)> {
        let (d, [h1, h2, h3]) = (self.feature(), self.hidden);
        [(d, h1), (h1 + d, h2), (h2 + d, h3), (h3 + d, 1)]
            .into_iter()
            .enumerate()
            .flat_map(|(k, (i, o))| pair(&format!("mlp.layers.{k}"), &[o, i, 1], o))
            .collect()
    }
}

#[derive(Clone, Debug)]
struct Hourglass {
    down1: (Convolution, GroupNorm),
    down2: (Convolution, GroupNorm),
    up1: (Doubling, GroupNorm),
    skip1: Convolution,
    up2: (Doubling, GroupNorm),
    skip2: Convolution,
}

impl Hourglass {
    fn take(weights: &mut Weights, name: &str, inputs: usize) -> Hourglass {
        let halving = Conv::new(2).stride(2).padding(1);
        let [_, inner_group, out_group] = PER_GROUP;
        let down1 = Convolution::take(weights, &format!("{name}.down1"), inputs, 3, halving.clone());
        let inner = down1.outputs();
        let down2 = Convolution::take(weights, &format!("{name}.down2"), inner, 3, halving);
        let out = down2.outputs();
        let mut norm = |layer: &str, channels, per_group| {
            GroupNorm::take(weights, &format!("{name}.{layer}_norm"), channels, per_group)
        };
        let [down1_norm, down2_norm] = [norm("down1", inner, inner_group), norm("down2", out, out_group)];
        let [up1_norm, up2_norm] = [norm("up1", out, out_group), norm("up2", out, out_group)];
        Hourglass {
            down1: (down1, down1_norm),
            down2: (down2, down2_norm),
            up1: (Doubling::take(weights, &format!("{name}.up1"), out), up1_norm),
            skip1: Convolution::take(weights, &format!("{name}.skip1"), inner, 1, Conv::new(2)),
            up2: (Doubling::take(weights, &format!("{name}.up2"), out), up2_norm),
            skip2: Convolution::take(weights, &format!("{name}.skip2"), inputs, 1, Conv::new(2)),
        }
    }

    /// x [N,C,H,W] → [a, b, c, d], d [N,out,H,W].
    fn forward(&self, x: &Tensor) -> [Tensor; 4] {
        let a = nn::relu(&self.down1.1.apply(&self.down1.0.apply(x)));
        let b = nn::relu(&self.down2.1.apply(&self.down2.0.apply(&a)));
        let c = nn::relu(&nn::add(&self.up1.1.apply(&self.up1.0.apply(&b)), &self.skip1.apply(&a)));
        let d = nn::relu(&nn::add(&self.up2.1.apply(&self.up2.0.apply(&c)), &self.skip2.apply(x)));
        [a, b, c, d]
    }
}

/// Images to features.
#[derive(Clone, Debug)]
pub struct Encoder {
    stem: (Convolution, GroupNorm),
    hourglasses: [Hourglass; 4],
}

impl Encoder {
    /// The encoder with these weights, whose shapes give the widths.
    ///
    /// # Panics
    /// If a weight is missing, has a shape that does not fit its neighbours, or is left over.
    pub fn from_weights(mut weights: Weights) -> Encoder {
        let conv = Convolution::take(&mut weights, "stem.conv", 3, 7, Conv::new(2).padding(3));
        let norm = GroupNorm::take(&mut weights, "stem.norm", conv.outputs(), PER_GROUP[0]);
        let mut inputs = conv.outputs();
        let hourglasses = std::array::from_fn(|k| {
            let hourglass = Hourglass::take(&mut weights, &format!("hourglasses.{k}"), inputs);
            inputs = hourglass.skip2.outputs();
            hourglass
        });
        weights.finish();
        Encoder { stem: (conv, norm), hourglasses }
    }

    /// Images \[N,3,S,S\] → stages `stem`, `hourglass_k.a` … `.c`, and `features_k` [N,out,S/2ᵏ,S/2ᵏ] for k = 1 … 4.
    ///
    /// # Panics
    /// If the images have not 3 channels, or a side that is no multiple of 64.
    pub fn forward(&self, images: &Tensor) -> Stages {
        let fits =
            images.rank() == 4 && images.shape[1] == 3 && images.shape[2..].iter().all(|s| s % 64 == 0);
        assert!(fits, "MF-PIFu: images must be [N,3,64k,64l], found shape {:?}", images.shape);
        let mut stages = Stages::default();
        let halve = |x: &Tensor| nn::max_pool(x, &Pool::new(2, 2));
        let (conv, norm) = &self.stem;
        let mut x = stages.record("stem", halve(&nn::relu(&norm.apply(&conv.apply(images))))).clone();
        for (k, hourglass) in self.hourglasses.iter().enumerate() {
            let [a, b, c, features] = hourglass.forward(&x);
            let k = k + 1;
            stages.record(format!("hourglass_{k}.a"), a);
            stages.record(format!("hourglass_{k}.b"), b);
            stages.record(format!("hourglass_{k}.c"), c);
            x = halve(stages.record(format!("features_{k}"), features));
        }
        stages
    }
}

/// Features and points to occupancy.
#[derive(Clone, Debug)]
pub struct Query {
    feature: usize,
    layers: [Convolution; 4],
}

impl Query {
    /// The point network with these weights, whose shapes give the widths.
    ///
    /// # Panics
    /// If a weight is missing, has a shape that does not fit its neighbours, or is left over.
    pub fn from_weights(mut weights: Weights) -> Query {
        let feature = weights.shape("mlp.layers.0.weight").get(1).copied().unwrap_or(0);
        let mut inputs = feature;
        let layers = std::array::from_fn(|k| {
            let layer = Convolution::take(&mut weights, &format!("mlp.layers.{k}"), inputs, 1, Conv::new(1));
            inputs = layer.outputs() + feature;
            layer
        });
        assert!(
            layers[3].outputs() == 1,
            "MF-PIFu: the last layer must have one output, not {}",
            layers[3].outputs()
        );
        weights.finish();
        Query { feature, layers }
    }

    /// P points in N views → stages `point_feature` \[N,D,P\], `layer_1` … `layer_3` [N,·,P], `joined` [1,·,P], `logits` \[P\] and
    /// `occupancy` \[P\].
    ///
    /// `uv` \[N,P,2\] are the points' image coordinates, −1 and 1 at the outer edges of the crop, u to the right; `depth` \[N,P\]
    /// is relative to the body's centre in units of half the crop's width there. Outside the crop features are 0.
    ///
    /// # Panics
    /// If there are not four features, or the shapes do not fit each other and the weights.
    pub fn forward(&self, features: &[&Tensor], uv: &Tensor, depth: &Tensor) -> Stages {
        assert!(features.len() == 4, "MF-PIFu: four features are needed, {} were given", features.len());
        assert!(
            uv.rank() == 3 && uv.shape[2] == 2 && depth.shape == uv.shape[..2],
            "MF-PIFu: uv must be [N,P,2] and depth [N,P], found {:?} and {:?}",
            uv.shape,
            depth.shape
        );
        let (views, points) = (uv.shape[0], uv.shape[1]);
        let grid = uv.reshape(&[views, points, 1, 2]);
        let bilinear =
            GridSample { mode: SampleMode::Linear, padding: PaddingMode::Zeros, align_corners: false };
        let mut parts: Vec<Tensor> = features
            .iter()
            .map(|f| nn::grid_sample(f, &grid, bilinear).reshape(&[views, f.shape[1], points]))
            .collect();
        parts.push(depth.reshape(&[views, 1, points]));

        let mut stages = Stages::default();
        let x = nn::concat(&parts.iter().collect::<Vec<_>>(), 1);
        assert!(
            x.shape[1] == self.feature,
            "MF-PIFu: the features and the depth make {} channels, the first layer takes {}",
            x.shape[1],
            self.feature
        );
        stages.record("point_feature", x.clone());
        let mut y = x.clone();
        for (k, layer) in self.layers[..3].iter().enumerate() {
            let input = if k == 0 { y } else { nn::concat(&[&y, &x], 1) };
            y = nn::leaky_relu(&layer.apply(&input), 0.01);
            stages.record(format!("layer_{}", k + 1), y.clone());
        }
        let joined = nn::reduce_mean(&nn::concat(&[&y, &x], 1), &[0], true);
        let logits = self.layers[3].apply(stages.record("joined", joined)).reshape(&[points]);
        let occupancy = nn::sigmoid(stages.record("logits", logits));
        stages.record("occupancy", occupancy);
        stages
    }
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::*;
    use crate::nn::goldens::{check, pattern};
    use crate::nn::slice;

    const TINY: Size = Size { stem: 4, inner: 4, out: 8, hidden: [6, 5, 4] };

    #[test]
    fn agrees_with_pytorch() {
        let encoder = Encoder::from_weights(Weights::pattern(TINY.encoder_weights()));
        let stages = encoder.forward(&pattern(&[2, 3, 64, 64], 1));
        for (f, golden) in stages.features().into_iter().zip(&goldens::MF_PIFU_FEATURES) {
            let every = |x: &Tensor, axis, step| slice(x, axis, 0, x.shape[axis], step);
            check(&every(&every(&every(f, 1, 3), 2, 5), 3, 7), golden);
        }
        let query = Query::from_weights(Weights::pattern(TINY.query_weights()));
        let uv = pattern(&[2, 9, 2], 2).map(|v| 1.2 * v);
        let answer = query.forward(&stages.features(), &uv, &pattern(&[2, 9], 3));
        check(answer.get("occupancy"), &goldens::MF_PIFU_OCCUPANCY);
    }

    #[test]
    fn every_stage_has_the_shape_of_the_table() {
        let encoder = Encoder::from_weights(Weights::pattern(TINY.encoder_weights()));
        let stages = encoder.forward(&Tensor::zeros(&[1, 3, 64, 64]));
        let shape = |name: &str| stages.get(name).shape[1..].to_vec();
        assert_eq!(shape("stem"), [4, 32, 32]);
        assert_eq!([shape("hourglass_1.a"), shape("hourglass_1.b")], [[4, 16, 16], [8, 8, 8]]);
        assert_eq!([shape("hourglass_1.c"), shape("features_1")], [[8, 16, 16], [8, 32, 32]]);
        assert_eq!(
            [shape("features_2"), shape("features_3"), shape("features_4")],
            [[8, 16, 16], [8, 8, 8], [8, 4, 4]]
        );
    }

    #[test]
    fn the_thesis_size_has_the_parameters_of_its_layer_table() {
        let count = |list: Vec<(String, Vec<usize>)>| {
            list.iter().map(|(_, s)| s.iter().product::<usize>()).sum::<usize>()
        };
        assert_eq!(THESIS.feature(), 1025);
        assert_eq!(count(THESIS.query_weights()), 2_298_242);
        assert_eq!(count(THESIS.encoder_weights()) / 10_000, 1089, "10.89 million");
    }

    #[test]
    fn views_are_joined_by_their_mean_so_their_order_does_not_matter() {
        let query = Query::from_weights(Weights::pattern(TINY.query_weights()));
        let features: Vec<Tensor> = (0..4).map(|k| pattern(&[2, 8, 8 >> k, 8 >> k], k)).collect();
        let (uv, depth) = (pattern(&[2, 5, 2], 1), pattern(&[2, 5], 2));
        let swap = |x: &Tensor| nn::concat(&[&slice(x, 0, 1, 2, 1), &slice(x, 0, 0, 1, 1)], 0);
        let swapped: Vec<Tensor> = features.iter().map(swap).collect();
        let answer = query.forward(&features.iter().collect::<Vec<_>>(), &uv, &depth);
        let mirrored = query.forward(&swapped.iter().collect::<Vec<_>>(), &swap(&uv), &swap(&depth));
        for (a, b) in answer.get("occupancy").data.iter().zip(&mirrored.get("occupancy").data) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
    }

    #[test]
    #[should_panic(expected = "images must be [N,3,64k,64l], found shape [1, 3, 32, 64]")]
    fn the_side_must_halve_six_times() {
        Encoder::from_weights(Weights::pattern(TINY.encoder_weights()))
            .forward(&Tensor::zeros(&[1, 3, 32, 64]));
    }
}

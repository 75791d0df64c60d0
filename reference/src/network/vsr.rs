//! VSR, voxel super-resolution: a coarse body as voxels, and the refined occupancy it implies (Li 2021, chapter 6).
//!
//! | stage | operators (3×3×3, padding 1) | features, thesis size |
//! |---|---|---|
//! | 1 | conv, ReLU, batch norm | 16 × 128³ |
//! | 2 | max-pool 2, (conv, ReLU) twice, batch norm | 32 × 64³ |
//! | 3 | max-pool 2, (conv, ReLU) twice, batch norm | 64 × 32³ |
//! | 4 | max-pool 2, (conv, ReLU) twice, batch norm | 128 × 16³ |
//! | 5 | max-pool 2, (conv, ReLU) twice, batch norm | 128 × 8³ |
//! | query | F₁…F₅ sampled at (x, y, z) | 368 × P |
//! | MLP | 368 → 256 → 256 → 256, ReLU, → 1, sigmoid | P |
//!
//! The layout is IF-Net's, the channels the thesis' (erratum E22); occupancy is 1 inside (erratum E17).
//!
//! # Conventions
//! Voxels are indexed `[z][y][x]` and points given as (x, y, z), because the first coordinate of a grid runs along the last
//! axis. −1 and 1 are the outer faces of the cube, so cell centre i of D lies at (2i + 1)/D − 1 on every level of
//! the pyramid (the thesis does not say, erratum E38). Outside the cube the border's features continue.
//!
//! # References
//! Li 2021, §3.3 of chapter 6; Chibane, Alldieck and Pons-Moll, IF-Net, CVPR 2020.

use super::layer::{BatchNorm, Convolution, batch_norm_weights, pair};
use super::{Stages, Weights};
use crate::nn::{self, Conv, GridSample, PaddingMode, Pool, SampleMode, Tensor};

/// The widths of one VSR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Channels of the five stages.
    pub stages: [usize; 5],
    /// Widths of the hidden layers.
    pub hidden: [usize; 3],
}

/// The size that trains on a desk.
pub const SMALL: Size = Size { stages: [8, 16, 32, 32, 32], hidden: [64, 64, 64] };

/// The size of Li 2021.
pub const THESIS: Size = Size { stages: [16, 32, 64, 128, 128], hidden: [256, 256, 256] };

impl Size {
    /// Length of a point's feature.
    pub fn feature(&self) -> usize {
        self.stages.iter().sum()
    }

    /// Name and shape of every weight of the encoder.
    pub fn encoder_weights(&self) -> Vec<(String, Vec<usize>)> {
        let mut list = Vec::new();
        let mut inputs = 1;
        for (k, outputs) in self.stages.into_iter().enumerate() {
            for c in 0..convolutions(k) {
                list.extend(pair(&format!("stages.{k}.convs.{c}"), &[outputs, inputs, 3, 3, 3], outputs));
                inputs = outputs;
            }
            list.extend(batch_norm_weights(&format!("stages.{k}.norm"), outputs));
        }
        list
    }

    /// Name and shape of every weight of the query.
    pub fn query_weights(&self) -> Vec<(String, Vec<usize>)> {
        let [h1, h2, h3] = self.hidden;
        [(self.feature(), h1), (h1, h2), (h2, h3), (h3, 1)]
            .into_iter()
            .enumerate()
            .flat_map(|(k, (i, o))| pair(&format!("mlp.layers.{k}"), &[o, i, 1], o))
            .collect()
    }
}

/// The first stage has one convolution, the others two.
fn convolutions(stage: usize) -> usize {
    if stage == 0 { 1 } else { 2 }
}

#[derive(Clone, Debug)]
struct Stage {
    convs: Vec<Convolution>,
    norm: BatchNorm,
}

/// Voxels to features.
#[derive(Clone, Debug)]
pub struct Encoder {
    stages: [Stage; 5],
}

impl Encoder {
    /// The encoder with these weights, whose shapes give the widths.
    ///
    /// # Panics
    /// If a weight is missing, has a shape that does not fit its neighbours, or is left over.
    pub fn from_weights(mut weights: Weights) -> Encoder {
        let mut channels = 1;
        let stages = std::array::from_fn(|k| {
            let mut take = |c: usize| {
                let name = format!("stages.{k}.convs.{c}");
                let conv = Convolution::take(&mut weights, &name, channels, 3, Conv::new(3).padding(1));
                channels = conv.outputs();
                conv
            };
            let convs = (0..convolutions(k)).map(&mut take).collect();
            Stage { convs, norm: BatchNorm::take(&mut weights, &format!("stages.{k}.norm"), channels) }
        });
        weights.finish();
        Encoder { stages }
    }

    /// Voxels \[1,1,D,D,D\] → stages `features_k` [1,C_k,D/2ᵏ⁻¹,…] for k = 1 … 5.
    ///
    /// # Panics
    /// If the voxels have not one channel, or a side that is no multiple of 16.
    pub fn forward(&self, voxels: &Tensor) -> Stages {
        let fits =
            voxels.rank() == 5 && voxels.shape[1] == 1 && voxels.shape[2..].iter().all(|s| s % 16 == 0);
        assert!(fits, "VSR: voxels must be [N,1,16k,16l,16m], found shape {:?}", voxels.shape);
        let mut stages = Stages::default();
        let mut x = voxels.clone();
        for (k, stage) in self.stages.iter().enumerate() {
            if k > 0 {
                x = nn::max_pool(&x, &Pool::new(3, 2));
            }
            for conv in &stage.convs {
                x = nn::relu(&conv.apply(&x));
            }
            x = stages.record(format!("features_{}", k + 1), stage.norm.apply(&x)).clone();
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
            inputs = layer.outputs();
            layer
        });
        assert!(inputs == 1, "VSR: the last layer must have one output, not {inputs}");
        weights.finish();
        Query { feature, layers }
    }

    /// Points \[P,3\], (x, y, z) in −1…1 → stages `point_feature` \[1,D,P\], `layer_1` … `layer_3` [1,·,P], `logits` \[P\] and
    /// `occupancy` \[P\].
    ///
    /// # Panics
    /// If there are not five features of one volume, or the shapes do not fit each other and the weights.
    pub fn forward(&self, features: &[&Tensor], points: &Tensor) -> Stages {
        assert!(features.len() == 5, "VSR: five features are needed, {} were given", features.len());
        assert!(
            points.rank() == 2 && points.shape[1] == 3,
            "VSR: points must be [P,3], found {:?}",
            points.shape
        );
        let count = points.shape[0];
        let grid = points.reshape(&[1, count, 1, 1, 3]);
        let trilinear =
            GridSample { mode: SampleMode::Linear, padding: PaddingMode::Border, align_corners: false };
        let sampled: Vec<Tensor> = features
            .iter()
            .map(|f| nn::grid_sample(f, &grid, trilinear).reshape(&[1, f.shape[1], count]))
            .collect();

        let mut stages = Stages::default();
        let mut x =
            stages.record("point_feature", nn::concat(&sampled.iter().collect::<Vec<_>>(), 1)).clone();
        assert!(
            x.shape[1] == self.feature,
            "VSR: the features make {} channels, the first layer takes {}",
            x.shape[1],
            self.feature
        );
        for (k, layer) in self.layers[..3].iter().enumerate() {
            x = stages.record(format!("layer_{}", k + 1), nn::relu(&layer.apply(&x))).clone();
        }
        let logits = self.layers[3].apply(&x).reshape(&[count]);
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

    const TINY: Size = Size { stages: [2, 3, 4, 5, 5], hidden: [6, 5, 4] };

    #[test]
    fn agrees_with_pytorch() {
        let encoder = Encoder::from_weights(Weights::pattern(TINY.encoder_weights()));
        let voxels = pattern(&[1, 1, 16, 16, 16], 1).map(|v| f64::from(v > 0.0));
        let stages = encoder.forward(&voxels);
        for (f, golden) in stages.features().into_iter().zip(&goldens::VSR_FEATURES) {
            let every = |x: &Tensor, axis, step| slice(x, axis, 0, x.shape[axis], step);
            check(&every(&every(&every(f, 2, 3), 3, 3), 4, 5), golden);
        }
        let query = Query::from_weights(Weights::pattern(TINY.query_weights()));
        let answer = query.forward(&stages.features(), &pattern(&[9, 3], 2).map(|v| 1.2 * v));
        check(answer.get("occupancy"), &goldens::VSR_OCCUPANCY);
    }

    #[test]
    fn cell_centres_of_every_level_read_their_own_cell() {
        let query = Query::from_weights(Weights::pattern(TINY.query_weights()));
        let features: Vec<Tensor> = TINY
            .stages
            .iter()
            .enumerate()
            .map(|(k, &c)| pattern(&[1, c, 16 >> k, 16 >> k, 16 >> k], k))
            .collect();
        // The centre of cell (x, y, z) = (1, 0, 3) of the level with four cells a side.
        let point = Tensor::new(&[1, 3], [1.0, 0.0, 3.0].map(|i| (2.0 * i + 1.0) / 4.0 - 1.0).to_vec());
        let sampled = query.forward(&features.iter().collect::<Vec<_>>(), &point);
        let start: usize = TINY.stages[..2].iter().sum();
        for c in 0..TINY.stages[2] {
            let found = sampled.get("point_feature").at(&[0, start + c, 0]);
            assert_eq!(found, features[2].at(&[0, c, 3, 0, 1]), "channel {c} is read at [z][y][x]");
        }
    }

    #[test]
    fn the_thesis_size_has_the_parameters_of_its_layer_table() {
        let count = |list: Vec<(String, Vec<usize>)>| {
            list.iter().map(|(_, s)| s.iter().product::<usize>()).sum::<usize>()
        };
        assert_eq!(THESIS.feature(), 368);
        assert_eq!(count(THESIS.query_weights()), 226_305);
        let affine_and_statistics = 4 * THESIS.feature();
        assert_eq!(count(THESIS.encoder_weights()), 1_756_800 + affine_and_statistics);
    }

    #[test]
    #[should_panic(expected = "voxels must be [N,1,16k,16l,16m], found shape [1, 1, 8, 16, 16]")]
    fn the_side_must_halve_four_times() {
        Encoder::from_weights(Weights::pattern(TINY.encoder_weights()))
            .forward(&Tensor::zeros(&[1, 1, 8, 16, 16]));
    }
}

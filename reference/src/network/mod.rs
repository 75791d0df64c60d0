//! The networks of Li 2021, read like their tables: weights by PyTorch's names, forward passes on [`nn`](crate::nn).
//!
//! | module | thesis | in | out |
//! |---|---|---|---|
//! | [`mf_pifu`] | chapter 5, eq. 5.1–5.3 | images, then points in each view | features, then occupancy |
//! | [`regressor`] on a [`resnet`] | chapter 4 §3.2 | an image of a person | pose, betas, weak-perspective camera |
//! | [`vsr`] | chapter 6, eq. 6.7–6.9 | voxels, then points | features, then occupancy |
//!
//! A forward pass returns its [`Stages`] by name, so that another implementation can be compared stage by stage.
//!
//! ```
//! use vitruvian_reference::network::{Weights, vsr};
//! use vitruvian_reference::nn::Tensor;
//!
//! let size = vsr::Size { stages: [1, 1, 1, 1, 1], hidden: [2, 2, 2] };
//! let ones = |shapes: Vec<(String, Vec<usize>)>| -> Weights {
//!     shapes.into_iter().map(|(name, shape)| (name, Tensor::filled(&shape, 1.0))).collect()
//! };
//! let encoder = vsr::Encoder::from_weights(ones(size.encoder_weights()));
//! let query = vsr::Query::from_weights(ones(size.query_weights()));
//!
//! let stages = encoder.forward(&Tensor::filled(&[1, 1, 16, 16, 16], 1.0));
//! assert_eq!(stages.get("features_5").shape, [1, 1, 1, 1, 1]);
//! let answer = query.forward(&stages.features(), &Tensor::new(&[1, 3], vec![0.0, 0.0, 0.0]));
//! assert!(answer.get("occupancy").data[0] > 0.5);
//! ```

mod layer;
pub mod mf_pifu;
pub mod regressor;
pub mod resnet;
mod stages;
pub mod vsr;
mod weights;

pub use stages::Stages;
pub use weights::Weights;

#[cfg(test)]
mod goldens;

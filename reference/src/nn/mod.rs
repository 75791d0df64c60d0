//! The operators of the networks, with the semantics of the ONNX specification, one family a file.
//!
//! Every operator is a function of [`Tensor`]s whose text is generic over the number type, so that one code gives
//! both the answer and the tolerance of the answer:
//!
//! | call with | get |
//! |---|---|
//! | `Tensor<f64>` (written `Tensor`) | the value y |
//! | `Tensor<Rounded>` ([`Tensor::rounded`]) | y, its magnitude m and the number n of roundings that a lower precision may spend on it |
//!
//! An implementation in a precision with unit roundoff u — any order of its sums, any blocking, with or without fused
//! multiply-add — answers within γ_n·m of y, γ_n = nu/(1 − nu): see [`rounded`] for the derivation.
//! Judge a graph one operator at a time: feed each the tensors its subject really saw, which are exact.
//!
//! ```
//! use vitruvian_reference::nn::{Conv, Tensor, UNIT_ROUNDOFF_F32, conv};
//! let x = Tensor::new(&[1, 1, 4], vec![1.0, 2.0, 3.0, 4.0]);
//! let w = Tensor::new(&[1, 1, 3], vec![1.0, 0.0, -1.0]);
//! let same = Conv::new(1).padding(1);
//! assert_eq!(conv(&x, &w, None, &same).data, [-2.0, -2.0, -2.0, 3.0]);
//!
//! let y = conv(&x.rounded(), &w.rounded(), None, &same);
//! assert_eq!(y.values().data, [-2.0, -2.0, -2.0, 3.0]);
//! assert_eq!(y.magnitudes().data, [2.0, 4.0, 6.0, 3.0]); // the convolution of |x| with |w|
//! assert_eq!(y.terms().data, [1.0, 2.0, 2.0, 1.0]); // a product with zero rounds nothing
//! assert_eq!(y.bounds(UNIT_ROUNDOFF_F32).shape, [1, 1, 4]);
//! ```
//!
//! # Why no threads, no blocking, no im2col?
//! The loops are the definition. They are ordered so that the innermost runs over contiguous pixels, which the compiler
//! vectorises, and nothing more.

pub mod activation;
pub mod affine_grid;
pub mod attention;
pub mod col2im;
pub mod convolution;
pub mod cumulative;
pub mod deform_conv;
pub mod depth_to_space;
pub mod determinant;
pub mod einsum;
pub mod elementwise;
pub mod extremum;
pub mod fourier;
pub mod gather;
pub mod grid_sample;
mod interpolation;
pub mod likelihood;
pub mod linear_attention;
pub mod local_response;
pub mod matrix_product;
pub mod max_unpool;
pub mod mel;
pub mod movement;
pub mod non_max_suppression;
pub mod normalization;
pub mod pad;
pub mod pooling;
pub mod quantization;
pub mod rectifier;
pub mod recurrent;
pub mod reduction;
pub mod resize;
pub mod ring;
pub mod roi_align;
pub mod rotary;
pub mod rounded;
pub mod scalar;
pub mod scaling;
pub mod scatter;
pub mod selection;
pub mod softmax;
pub mod step;
pub mod tensor;
pub mod top_k;
pub mod transcendental;
pub mod transposed_convolution;
pub mod unique;
mod window;

pub use activation::{
    gelu, gelu_tanh, hard_sigmoid, hard_swish, mish, sigmoid, softplus, softsign, swish, tanh,
};
pub use affine_grid::affine_grid;
pub use attention::{Attended, Attention, attention, join_heads, split_heads};
pub use col2im::col2im;
pub use convolution::{Conv, conv};
pub use cumulative::{Cumulative, cumulative_product, cumulative_sum};
pub use deform_conv::deform_conv;
pub use depth_to_space::{BlockOrder, depth_to_space, space_to_depth};
pub use determinant::det;
pub use einsum::{einsum, einsum_shape};
pub use elementwise::{add, broadcast, clip, div, maximum, mean, minimum, mul, sub, sum};
pub use extremum::place_of_extremum;
pub use fourier::{Fourier, Window, dft, stft};
pub use gather::{gather, gather_elements, gather_nd};
pub use grid_sample::{GridSample, PaddingMode, SampleMode, grid_sample};
pub use likelihood::{Reduction, negative_log_likelihood};
pub use linear_attention::{LinearAttention, linear_attention};
pub use local_response::{LocalResponse, local_response_norm};
pub use matrix_product::{gemm, linear, matmul};
pub use max_unpool::max_unpool;
pub use mel::mel_weight_matrix;
pub use movement::{concat, expand, reverse_sequence, slice, tile, transpose};
pub use non_max_suppression::{NonMaxSuppression, non_max_suppression};
pub use normalization::{
    BatchNormTraining, LayerNorm, batch_norm, batch_norm_training, group_norm, instance_norm, layer_norm,
    mean_variance_norm, per_channel,
};
pub use pad::{PadMode, center_crop_pad, pad};
pub use pooling::{
    AveragePool, Pool, average_pool, global_average_pool, global_lp_pool, global_max_pool, lp_pool, max_pool,
    max_pool_indices,
};
pub use quantization::{IntegerRange, dequantize, levels, quantize, quantize_dynamically, spread};
pub use rectifier::{celu, elu, leaky_relu, prelu, relu, selu, shrink, thresholded_relu};
pub use recurrent::{Direction, Gate, Recurred, Recurrent, gru, lstm, rnn};
pub use reduction::{
    reduce, reduce_l1, reduce_l2, reduce_log_sum, reduce_log_sum_exp, reduce_max, reduce_mean, reduce_min,
    reduce_prod, reduce_sum, reduce_sum_square,
};
pub use resize::{
    CoordinateTransformation, Interpolation, NearestMode, Resize, ResizedAxis, resize, resize_alternatives,
};
pub use ring::Ring;
pub use roi_align::{RoiAlign, max_roi_pool, roi_align};
pub use rotary::{Pairs, rotary_embedding};
pub use rounded::{Rounded, UNIT_ROUNDOFF_F32, gamma};
pub use scalar::Scalar;
pub use scaling::{Length, lp_norm, rms_norm};
pub use scatter::{replace, scatter_elements, scatter_nd};
pub use selection::{compress, eye, non_zero, one_hot, triangle};
pub use softmax::{hardmax, log_softmax, softmax};
pub use step::{ceil, floor, modulo, round, sign};
pub use tensor::Tensor;
pub use top_k::top_k;
pub use transcendental::{Elementary, acos, atan, cos, exp, log, pow, sin};
pub use transposed_convolution::{ConvTranspose, conv_transpose};
pub use unique::{Unique, unique};
pub use window::same_padding;

#[cfg(test)]
pub(crate) mod goldens;

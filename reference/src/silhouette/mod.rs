//! Silhouettes: masks of a body, how a mesh makes one, and where its boundary runs.
//!
//! | module | what it answers |
//! |---|---|
//! | [`mask`] | which pixels show the body |
//! | [`raster`] | which pixels a mesh covers, with which triangle, how far away |
//! | [`boundary`] | the outline of a mask as points between pixels, with normals |
//! | [`outline`] | the edges of a mesh that make the outline seen by a camera |
//! | [`dilation`] | masks grown and shrunk: the robustness experiment of Li 2021, fig. 3.5 |

pub mod boundary;
pub mod dilation;
pub mod mask;
pub mod outline;
pub mod raster;

pub use mask::Mask;

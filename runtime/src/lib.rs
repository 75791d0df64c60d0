//! Runs exported networks on captures: images and cameras in, bodies and meshes out.

pub mod capture;
pub mod contract;
pub mod error;
pub mod file;
pub mod image_input;
pub mod implicit_field;
pub mod inside;
pub mod library;
pub mod marching_cubes;
pub mod mesh;
pub mod person_crop;
pub mod reconstruct;
pub mod regress;
pub mod render;
pub mod rotation;
pub mod session;
pub mod skinning;
#[cfg(test)]
mod test_graph;
pub mod voxelize;

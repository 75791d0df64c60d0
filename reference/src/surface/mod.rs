//! Surfaces as triangle meshes: what they are, how far, what is inside, and how they come out of a sampled field.
//!
//! | module | what it answers |
//! |---|---|
//! | [`mesh`] | area, volume, normals, affine images |
//! | [`bounding_box`] | the smallest box around points |
//! | [`topology`] | closed? one piece? which Euler characteristic? |
//! | [`edges`] | which two faces every edge joins |
//! | [`laplacian`] | how much a field over the mesh differs from its surroundings (Li 2021, eq. 3.9) |
//! | [`distance`] | the nearest point of a triangle |
//! | [`aabb_tree`] | the nearest point of a whole surface |
//! | [`sampling`] | random points of a surface or a box |
//! | [`inside`] | is this point inside? (exact winding number by counting ray crossings) |
//! | [`winding_number`] | the same as a real number by solid angles: the slow definition |
//! | [`cube`] | where a body sits in the cells of a voxel grid |
//! | [`voxelize`] | occupancy of the cells (Li 2021, ch. 6: the input of VSR) |
//! | [`marching_cubes`] | the level set of a sampled field (Li 2021, ch. 5 and 6) |
//! | [`marching_cubes_tables`] | its 256 cases, derived from one rule |

pub mod aabb_tree;
pub mod bounding_box;
pub mod cube;
pub mod distance;
pub mod edges;
pub mod inside;
pub mod laplacian;
pub mod marching_cubes;
pub mod marching_cubes_tables;
pub mod mesh;
mod ray_crossings;
pub mod sampling;
pub mod topology;
pub mod voxelize;
pub mod winding_number;

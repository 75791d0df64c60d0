//! What is judged, written once and run by tests, by the sweep and by the command.
//!
//! | file | judges |
//! |---|---|
//! | [`operators`] | every operator of the networks on random problems |
//! | [`faults`] | the judge itself: planted faults must be seen |
//! | [`audit_faults`] | the audit: mistakes planted in an engine must be found and named |
//! | [`microsoft`] | the operators of ONNX Runtime's own domain on random problems |
//! | [`networks`] | the exported graphs, node by node and stage by stage |
//! | [`regressor`] | where the regressor's stages stand in a graph, and faults planted in one |
//! | [`surface`] | marching cubes, voxels and the inside test |
//! | [`body`] | skinning of bodies, and planted faults in it |
//! | [`regress`] | what stands around a regressor: rotations and cameras, and planted faults in it |

pub mod audit_faults;
pub mod body;
pub mod faults;
pub mod microsoft;
pub mod networks;
pub mod operators;
pub mod regress;
pub mod regressor;
pub mod surface;

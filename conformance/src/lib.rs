//! The judge: proves, number by number, that the runtime computes what the reference defines.
//!
//! # How is a number judged?
//! The reference computes in f64 from exactly the numbers that the runtime was given, and the same text, run over its
//! rounding-analysis number, says how far any f32 implementation may be off: no tolerance is chosen. [`certificate`] grades
//! a difference, [`compare`] a tensor. Only whole networks, whose bounds multiply into nothing, have measured
//! tolerances, and all of them stand in [`tolerance`].
//!
//! # What is judged?
//! - every operator of the networks on random problems ([`problem`], [`suite::operators`]);
//! - the judge itself, by planted faults ([`suite::faults`]), and the audit ([`suite::audit_faults`]);
//! - the exported graphs, node by node and stage by stage ([`suite::networks`]);
//! - marching cubes, voxels and the inside test ([`suite::surface`]);
//! - the skinning of bodies ([`suite::body`]);
//! - rotations and cameras from a regressor's numbers ([`suite::regress`]);
//! - the official ONNX backend tests ([`node_tests`]).
//!
//! `cargo test` runs a moderate number of problems, `VITRUVIAN_CASES=2000 cargo test` more, from `VITRUVIAN_SEED`; `make
//! conformance` sweeps ten thousand and prints a table.
//!
//! # How to add an operator
//! Add it to [`onnx::walk`], a strategy for it to a file of [`problem`], and a line to
//! [`JUDGES`](suite::operators::JUDGES). An exported graph with an operator that is not there fails the tests.

pub mod array;
pub mod audit;
pub mod certificate;
pub mod compare;
pub mod convert;
pub mod engine;
pub mod error;
pub mod node_tests;
pub mod onnx;
pub mod problem;
pub mod suite;
pub mod tolerance;

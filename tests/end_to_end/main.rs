//! The built command as a user runs it: arguments and files in, files, words and an exit status out.
//!
//! Needs the graphs of models/exported and ONNX Runtime (`make onnxruntime`).

mod audit;
mod audit_diff;
mod bad_input;
mod command;
mod demo;
mod evaluate;
mod evaluate_joints;
mod fit;
mod mesh;
mod mv_smplify;
mod pose;
mod real_body;
mod reconstruct;
mod regress;
mod regress_bad_input;
mod regress_trained;
mod synthesize;

//! The audit of an exported graph: every node a second party ran, judged against the node's specified meaning.

pub mod report;

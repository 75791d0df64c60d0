//! The official ONNX backend tests, run against the reference and the engines.
//!
//! `make node-tests` writes them from their pinned package and then `docs/node_tests.md`; `cargo test` runs them where they
//! have been written.
//!
//! # Who judges whom?
//! A stored expectation is not the truth but another party's answer: computed by NumPy in f32 or f64, sometimes
//! rounded by hand to four decimals. The reference's value and its derived bound judge it as they judge every engine. An
//! expectation that lies outside is listed with the measured difference and the reason ([`witness`]), and so is every
//! case that the reference does not compute ([`table`]).
//!
//! | file | is |
//! |---|---|
//! | [`case`] | a case as read from its folder |
//! | [`expected`] | what the reference says of a case, and how far a party is from it |
//! | [`engine`] | the parties that compute: ONNX Runtime, and tract with the feature of its name |
//! | [`audits`] | the audit on every case |
//! | [`witness`] | expectations that were computed in another way than their operator is defined |
//! | [`row`] | one case on all parties |
//! | [`table`] | all cases on all parties, as a Markdown file |

pub mod audits;
pub mod case;
pub mod engine;
pub mod expected;
pub mod row;
pub mod table;
#[cfg(feature = "tract")]
pub mod tract;
pub mod witness;

//! The audit is judged: mistakes planted in what an engine computes must be found at their node, and named.
//!
//! An engine with one mistake runs the graph node by node in ONNX Runtime: at one node it reads other attributes, is given
//! other operands or gives other numbers, and every later node computes from what it then has. The audit sees the true
//! graph and the tensors that this engine left.
//!
//! | file | is |
//! |---|---|
//! | [`engine`] | the engine with one mistake |
//! | [`scenes`] | graphs of a few nodes in which mistakes are made, of every class of the networks |
//! | [`faults`] | the mistakes, by families of operators |

pub mod engine;
pub mod faults;
pub mod scenes;

use crate::audit::{Audit, Options, audit};
use crate::error::Result;
use engine::Engine;
use faults::Fault;
use scenes::Scene;

impl Fault {
    /// Plants the mistake in its scene and audits what the engine left.
    ///
    /// # Errors
    /// When ONNX Runtime is missing or refuses a node, or the audit fails.
    pub fn audit(&self) -> Result<Audit> {
        let scene = (self.scene)();
        let mut engine = Engine::with(&scene, Some(self))?;
        audit(&scene.model, &scene.inputs, &mut engine, &Options::default(), &mut |_, _, _| ())
    }

    /// The name of the node in which the mistake is made.
    ///
    /// # Panics
    /// When the scene has no such node.
    pub fn node(&self) -> String {
        let model = (self.scene)().model;
        let node = model.nodes().iter().find(|node| node.output.iter().any(|name| name == self.output));
        let node = node.unwrap_or_else(|| panic!("{}: no node makes \"{}\"", self.name, self.output));
        node.name.clone().unwrap_or_default()
    }
}

/// Audits what the engine leaves when it makes no mistake.
///
/// # Errors
/// As [`Fault::audit`].
pub fn clean(scene: &Scene) -> Result<Audit> {
    let mut engine = Engine::with(scene, None)?;
    audit(&scene.model, &scene.inputs, &mut engine, &Options::default(), &mut |_, _, _| ())
}

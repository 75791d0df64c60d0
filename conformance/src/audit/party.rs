//! The second party: who computed the numbers that are judged.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use vitruvian_reference::nn::Rounded;

use crate::error::Result;
use crate::onnx::element::ElementType;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;
use crate::onnx::value::Value;

/// A tensor of the graph while nodes still need it.
#[derive(Clone, Debug)]
pub enum Held {
    /// A constant of the graph.
    Constant(Arc<TypedTensor>),
    /// The second party's own, or an input.
    Given(Arc<TypedTensor>),
    /// The reference's, from the second party's tensors before it: it kept none.
    Derived(Arc<Value<Rounded>>),
    /// Nobody's, with the reason.
    Unknown(String),
}

impl Held {
    /// Its element type, where it is there.
    pub fn element(&self) -> Option<ElementType> {
        match self {
            Self::Constant(tensor) | Self::Given(tensor) => Some(tensor.element()),
            Self::Derived(value) => Some(value.element),
            Self::Unknown(_) => None,
        }
    }

    /// Its shape, where it is there.
    pub fn shape(&self) -> Option<&[usize]> {
        match self {
            Self::Constant(tensor) | Self::Given(tensor) => Some(&tensor.shape),
            Self::Derived(value) => Some(value.shape()),
            Self::Unknown(_) => None,
        }
    }
}

/// The tensors that are held, by name.
pub type Tensors = BTreeMap<String, Held>;

/// What the second party computed for some nodes that follow each other.
#[derive(Debug, Default)]
pub struct Segment {
    /// The nodes; at least one.
    pub nodes: Range<usize>,
    /// Their outputs by name.
    pub tensors: BTreeMap<String, TypedTensor>,
    /// Outputs that it does not have, with the reason.
    pub missing: BTreeMap<String, String>,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// Who computed a graph's tensors: an engine that is run, or a file of what another left.
pub trait Party {
    /// Its name and settings, such as `ONNX Runtime 1.32.0, optimisation off`.
    fn describe(&self) -> String;

    /// The tensors of the nodes from `first` on, as many nodes as it likes; `held` has all that these nodes read and no
    /// node of theirs makes.
    ///
    /// # Errors
    /// When the party is not there or broken; a tensor that it lacks is no error.
    fn segment(&mut self, model: &Model, first: usize, held: &Tensors) -> Result<Segment>;

    /// Whether it computes from what it is given, so that the reference's tensor can stand in for one that it lacks.
    fn computes(&self) -> bool {
        false
    }

    /// Threads of the session that also runs the graph as shipped, if it is one.
    fn ships(&self) -> Option<usize> {
        None
    }

    /// Tensors that it has and the graph does not.
    fn unmatched(&self) -> Vec<String> {
        Vec::new()
    }
}

//! What outputs mean in space: a ruler is laid on the base's outputs and held against others'.
//!
//! | file | the outputs are |
//! |---|---|
//! | [`body`] | bodies: vertices and joints, or the pose, betas and camera that make them |
//! | [`field`] | an implicit field on a lattice: its surface, and the topology of that |
//! | [`numbers`] | anything else |
//! | [`summary`] | many distances in a few numbers |

use std::collections::BTreeMap;

use vitruvian_reference::nn::Tensor;

use super::report::{Geometry, Summary, View};

pub mod body;
pub mod field;
pub mod numbers;
pub mod summary;

/// The outputs of one run by their names in the base, in f64.
pub type Outputs = BTreeMap<String, Tensor>;

/// How far outputs are from the base's, item by item (a vertex, a point of the surface, a number).
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// The displacements' components one after the other, so that ⟨Δ_k, Δ⟩ can be taken.
    pub components: Vec<f64>,
    /// Their lengths in the ruler's unit; absent where there are none or one is not finite.
    pub lengths: Option<Summary>,
}

/// The base's outputs on all inputs, understood; every method compares other outputs on the same inputs with them.
///
/// The errors name an output whose shape or numbers do not fit its meaning.
pub trait Ruler {
    /// The unit of a displacement.
    fn unit(&self) -> &'static str;

    /// The displacement to first order: what attribution adds up.
    fn displacement(&self, variant: &[Outputs]) -> Result<Displacement, String>;

    /// Everything there is to say, and the distances that a budget in millimetres is about.
    fn report(&self, variant: &[Outputs]) -> Result<(Geometry, Option<Summary>), String>;

    /// The worst input's surface with the error at each vertex.
    fn view(&self, variant: &[Outputs]) -> Result<Option<View>, String>;
}

/// The output of this name.
fn output<'a>(outputs: &'a Outputs, name: &str) -> Result<&'a Tensor, String> {
    outputs.get(name).ok_or_else(|| {
        let names: Vec<&str> = outputs.keys().map(String::as_str).collect();
        format!("output \"{name}\" is missing; there are {names:?}")
    })
}

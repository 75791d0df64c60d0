//! A rewritten graph in a session: f32 arrays in, f32 arrays out, by name.

use std::collections::BTreeMap;

use ndarray::ArrayViewD;
use vitruvian_runtime::session::{Input, Optimization, Session, Settings, TensorInfo};

use crate::array::Array;
use crate::error::Result;

/// Arrays by their names.
pub type Arrays = BTreeMap<String, Array>;

/// A loaded graph whose inputs and outputs are all f32.
#[derive(Debug)]
pub struct Runner {
    session: Session,
    /// The names that arrays go by, each with the graph's own.
    inputs: Vec<(String, String)>,
    outputs: Vec<(String, String)>,
}

impl Runner {
    /// Loads a graph with optimisation off, on one thread; `name` stands for it in messages.
    ///
    /// # Errors
    /// When ONNX Runtime is missing or refuses the graph.
    pub fn new(name: &str, graph: &[u8]) -> Result<Self> {
        let settings = Settings { optimization: Optimization::Disabled, threads: 1 };
        let session = Session::from_bytes(name, graph, &settings)?;
        let names =
            |infos: &[TensorInfo]| infos.iter().map(|info| (info.name.clone(), info.name.clone())).collect();
        Ok(Self { inputs: names(session.inputs()), outputs: names(session.outputs()), session })
    }

    /// Lets arrays go by other names: `inputs` and `outputs` are the new name of each of the graph's own.
    pub fn rename(&mut self, inputs: &BTreeMap<String, String>, outputs: &BTreeMap<String, String>) {
        for (names, new) in [(&mut self.inputs, inputs), (&mut self.outputs, outputs)] {
            for (name, own) in names {
                if let Some(other) = new.get(own) {
                    name.clone_from(other);
                }
            }
        }
    }

    /// Runs the graph on the arrays that `given` has for its inputs.
    ///
    /// # Errors
    /// When an array is missing or has another shape than declared, or ONNX Runtime stops.
    pub fn run<'a>(&mut self, given: impl Fn(&str) -> Option<&'a Array>) -> Result<Arrays> {
        let inputs: Vec<(&str, Input)> = self
            .inputs
            .iter()
            .filter_map(|(name, own)| {
                let array = given(name)?;
                let view = ArrayViewD::from_shape(&array.shape[..], &array.values);
                Some((own.as_str(), Input::F32(view.expect("an array has as many values as places"))))
            })
            .collect();
        let wanted: Vec<&str> = self.outputs.iter().map(|(_, own)| own.as_str()).collect();
        let values = self.session.run(&inputs, &wanted)?;
        let mut found = Arrays::new();
        for ((name, _), value) in self.outputs.iter().zip(values) {
            let view = value.f32()?;
            let (shape, values) = (view.shape().to_vec(), view.iter().copied().collect());
            found.insert(name.clone(), Array { shape, values });
        }
        Ok(found)
    }
}

//! The tensors a graph declares, compared with what its kind asks for.

use std::path::Path;

use crate::error::{Error, Result};
use crate::session::{Dimension, TensorInfo};

/// Expected sides: `None` may have any length.
type Sides<'a> = &'a [Option<usize>];

/// The declared tensors of one graph.
pub(super) struct Signature<'a> {
    pub(super) path: &'a Path,
    pub(super) inputs: &'a [TensorInfo],
    pub(super) outputs: &'a [TensorInfo],
}

impl Signature<'_> {
    fn fault(&self, item: String, message: String) -> Error {
        Error::Graph { path: self.path.to_path_buf(), item, message }
    }

    /// Checks an input and returns its fixed sides.
    pub(super) fn input(&self, name: &str, expected: Sides) -> Result<Vec<Option<usize>>> {
        self.check(self.inputs, "input", name, expected)
    }

    /// Checks an output and returns its fixed sides.
    pub(super) fn output(&self, name: &str, expected: Sides) -> Result<Vec<Option<usize>>> {
        self.check(self.outputs, "output", name, expected)
    }

    fn check(
        &self,
        among: &[TensorInfo],
        role: &str,
        name: &str,
        expected: Sides,
    ) -> Result<Vec<Option<usize>>> {
        let item = format!("{role} \"{name}\"");
        let Some(found) = among.iter().find(|info| info.name == name) else {
            let message = format!(
                "it is missing, expected {}; the graph's {role}s are {}",
                words(expected),
                quoted(among)
            );
            return Err(self.fault(item, message));
        };
        if !fits(found, expected) {
            return Err(
                self.fault(item, format!("found {}, expected {}", found.signature(), words(expected)))
            );
        }
        Ok(found.shape.iter().map(Dimension::fixed).collect())
    }

    /// Checks an output that may have one of several shapes and returns what stands beside the fitting one.
    pub(super) fn one_of<T: Copy + PartialEq>(&self, name: &str, forms: &[(T, Sides)]) -> Result<T> {
        let any = forms.iter().map(|(_, sides)| words(sides)).collect::<Vec<_>>().join(" or ");
        let item = format!("output \"{name}\"");
        let Some(found) = self.outputs.iter().find(|info| info.name == name) else {
            let names = quoted(self.outputs);
            return Err(
                self.fault(item, format!("it is missing, expected {any}; the graph's outputs are {names}"))
            );
        };
        let fitting: Vec<T> =
            forms.iter().filter(|(_, sides)| fits(found, sides)).map(|(form, _)| *form).collect();
        match fitting.split_first() {
            None => Err(self.fault(item, format!("found {}, expected {any}", found.signature()))),
            Some((form, others)) if others.iter().all(|other| other == form) => Ok(*form),
            Some(_) => Err(self.fault(
                item,
                format!(
                    "found {}, which may be any of {any}: export it with all sides fixed but the first",
                    found.signature()
                ),
            )),
        }
    }

    /// Checks features_1, features_2, … (at least one, each of the same rank) and returns their channels C_k.
    pub(super) fn features(&self, among: &[TensorInfo], role: &str, rank: usize) -> Result<Vec<usize>> {
        let mut channels = Vec::new();
        let sides = vec![None; rank];
        loop {
            let name = format!("features_{}", channels.len() + 1);
            if !channels.is_empty() && among.iter().all(|info| info.name != name) {
                break;
            }
            let Some(count) = self.check(among, role, &name, &sides)?[1] else {
                let message = "its second side is free, expected a fixed number of channels".to_string();
                return Err(self.fault(format!("{role} \"{name}\""), message));
            };
            channels.push(count);
        }
        Ok(channels)
    }

    /// Refuses inputs beyond the named ones and features_1..K: nobody would know what to give them.
    pub(super) fn only_inputs(&self, named: &[&str], features: usize) -> Result<()> {
        let expected =
            |name: &str| named.contains(&name) || (1..=features).any(|k| name == format!("features_{k}"));
        match self.inputs.iter().find(|info| !expected(&info.name)) {
            None => Ok(()),
            Some(extra) => {
                let message =
                    format!("the contract has no such input ({}); fold it into the graph", extra.signature());
                Err(self.fault(format!("input \"{}\"", extra.name), message))
            }
        }
    }
}

fn fits(found: &TensorInfo, expected: Sides) -> bool {
    let side_fits = |(side, want): (&Dimension, &Option<usize>)| match (side.fixed(), want) {
        (Some(found), Some(wanted)) => found == *wanted,
        _ => true,
    };
    found.element == "f32"
        && found.shape.len() == expected.len()
        && found.shape.iter().zip(expected).all(side_fits)
}

/// Names in quotes.
fn quoted(tensors: &[TensorInfo]) -> String {
    tensors.iter().map(|info| format!("\"{}\"", info.name)).collect::<Vec<_>>().join(", ")
}

/// An expectation as `f32[?, 3]`.
fn words(expected: Sides) -> String {
    let side = |side: &Option<usize>| side.map_or_else(|| "?".to_string(), |length| length.to_string());
    format!("f32[{}]", expected.iter().map(side).collect::<Vec<_>>().join(", "))
}

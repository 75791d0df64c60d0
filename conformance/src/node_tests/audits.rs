//! The audit on every case: what it says of ONNX Runtime, node by node, and whether it cries wolf.

use std::path::Path;

use super::case::{self, Case};
use crate::audit::report::Grade;
use crate::audit::{OnnxRuntime, Options, audit};
use crate::error::Result;

/// What the audit says of a case.
#[derive(Clone, Debug)]
pub struct Audited {
    /// The case.
    pub name: String,
    /// The verdict on its whole graph.
    pub verdict: Grade,
    /// The operator of the first node outside rounding.
    pub first_outside: Option<String>,
}

/// Audits ONNX Runtime on every case under `root` whose tensors can be read.
///
/// # Errors
/// When a folder cannot be read, or ONNX Runtime is missing.
pub fn audits(root: &Path) -> Result<Vec<Audited>> {
    let mut audited = Vec::new();
    for folder in case::folders(root)? {
        for (name, case) in case::read(&folder)? {
            if let Ok(case) = case {
                let (verdict, first_outside) = verdict(&case)?;
                audited.push(Audited { name, verdict, first_outside });
            }
        }
    }
    Ok(audited)
}

fn verdict(case: &Case) -> Result<(Grade, Option<String>)> {
    // A constant that stands among the inputs has its own value in every case.
    let inputs = case.model.inputs();
    let given = case.inputs.iter().filter(|(name, _)| inputs.contains(&name.as_str()));
    let given = given.map(|(name, tensor)| (name.clone(), tensor.clone())).collect();
    let mut party = OnnxRuntime { threads: 1, ..OnnxRuntime::default() };
    let audit = audit(&case.model, &given, &mut party, &Options::default(), &mut |_, _, _| ())?;
    let outside = audit.first_outside.map(|outside| outside.op);
    Ok((audit.verdict, outside))
}

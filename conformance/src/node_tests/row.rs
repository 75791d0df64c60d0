//! One case on all parties.

use std::collections::BTreeMap;
use std::path::Path;

use super::case::{self, Case};
use super::engine::Engine;
use super::expected::{Distance, Expected, numbers, passes_officially};
use crate::error::Result;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// What was found about one case.
#[derive(Clone, Debug)]
pub struct Row {
    /// `node`, `simple`, `pytorch-converted` or `pytorch-operator`.
    pub kind: String,
    /// The case.
    pub name: String,
    /// The operator that it is about.
    pub operator: String,
    /// The reference's own answer against the stored one, or why there is none.
    pub reference: std::result::Result<Judged, String>,
    /// Each engine's answer, in the order of the engines, or why there is none.
    pub engines: Vec<std::result::Result<Judged, String>>,
}

/// An answer, judged.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The distance from the reference: of the stored expectation in the reference's column, of the engine's answer in an
    /// engine's; or which output has another type or shape. `None` where the reference does not compute the case.
    pub distance: Option<std::result::Result<Distance, String>>,
    /// Whether the answer meets the stored one by the official rule.
    pub official: bool,
}

impl Judged {
    /// Whether the reference has an opinion and it is that the difference cannot be rounding.
    pub fn is_outside(&self) -> bool {
        self.distance
            .as_ref()
            .is_some_and(|distance| !distance.as_ref().is_ok_and(|distance| distance.within))
    }
}

/// Runs every case under `root` on the reference and the engines; `progress` is told how many are done.
///
/// # Errors
/// When a folder cannot be read. A case that cannot be read is a row.
pub fn run(
    root: &Path,
    engines: &mut [Box<dyn Engine>],
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<Row>> {
    let folders = case::folders(root)?;
    let mut rows = Vec::new();
    for (done, folder) in folders.iter().enumerate() {
        progress(done, folders.len());
        for (name, case) in case::read(folder)? {
            rows.push(match case {
                Ok(case) => judged(&case, engines),
                Err(why) => unread(folder, name, &why, engines.len()),
            });
        }
    }
    // A graph that spells an operator out belongs to the operator.
    let operators: BTreeMap<String, String> =
        rows.iter().map(|row| (row.name.clone(), row.operator.clone())).collect();
    for row in &mut rows {
        if let Some((whole, _)) = row.name.split_once("_expanded") {
            let operator = operators.get(whole).map_or("several", String::as_str);
            row.operator = format!("{operator}, spelled out");
        }
    }
    Ok(rows)
}

fn unread(folder: &Path, name: String, why: &str, engines: usize) -> Row {
    let kind = folder.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    // The model may be readable where its data are not.
    let model = Model::read(&folder.join("model.onnx"));
    let operator = model.map_or_else(|_| "several".into(), |model| operator(&model));
    let not = || Err(why.to_string());
    Row { kind, name, operator, reference: not(), engines: (0..engines).map(|_| not()).collect() }
}

fn operator(model: &Model) -> String {
    let mut operators = model.operators().into_iter();
    operators.next().filter(|_| operators.next().is_none()).unwrap_or_else(|| "several".into())
}

fn judged(case: &Case, engines: &mut [Box<dyn Engine>]) -> Row {
    let expected = Expected::of(case);
    let stored: Vec<Vec<f64>> = case.outputs.iter().map(numbers).collect();
    let official = |found: &[Vec<f64>]| {
        found.len() == stored.len() && found.iter().zip(&stored).all(|(f, s)| passes_officially(f, s))
    };
    let reference = expected.as_ref().map_err(Clone::clone).map(|expected| Judged {
        distance: Some(expected.distance(&case.outputs)),
        official: official(&expected.rounded()),
    });
    let engines = engines
        .iter_mut()
        .map(|engine| {
            let outputs = engine.run(case)?;
            let same = |(found, stored): (&_, &_)| same_kind(found, stored);
            let alike = outputs.iter().zip(&case.outputs).all(same);
            Ok(Judged {
                distance: expected.as_ref().ok().map(|expected| expected.distance(&outputs)),
                official: alike && official(&outputs.iter().map(numbers).collect::<Vec<_>>()),
            })
        })
        .collect();
    Row {
        kind: case.kind.clone(),
        name: case.name.clone(),
        operator: operator(&case.model),
        reference,
        engines,
    }
}

fn same_kind(a: &TypedTensor, b: &TypedTensor) -> bool {
    a.element() == b.element() && a.shape == b.shape
}

//! Two graphs that should be the same, compared in millimetres: f16, int8, optimised or re-exported against their base.
//!
//! ```text
//! inputs ─┬─ base ──── outputs ─┐                 ┌─ bodies: joints, vertices, pictures
//!         └─ variant ─ outputs ─┴─ what they mean ┼─ fields: surfaces, flipped points, topology
//!                                                 └─ numbers
//! tensors in common ─ the variant's pieces on the base's tensors ─ the base rerun with each ─ which nodes cost it
//! ```
//!
//! | file | is |
//! |---|---|
//! | [`report`] | what was found, as data |
//! | [`geometry`] | rulers: bodies, fields, numbers |
//! | [`topology`] | pieces and handles of a surface |
//! | [`people`] | inputs that mean something |
//! | [`meaning`], [`setup`] | what outputs mean; the inputs; the second graph of an implicit function |
//! | [`surgery`], [`runner`], [`flow`] | graphs cut open, nudged and run |
//! | [`matching`], [`attribution`] | which tensors are the same; which nodes cost the millimetres |
//! | [`truth`] | the base by the reference in f64 |
//! | [`lowering`], [`plan`](mod@plan) | a graph with some nodes in f16 or int8; which to keep in f32 |

use std::path::{Path, PathBuf};
use std::time::Instant;

use sha2::{Digest as _, Sha256};
use vitruvian_reference::nn::Tensor;

use crate::error::{Error, Result};
use attribution::Subject;
use flow::{Flow, fault, unprefixed};
use geometry::Outputs;
use geometry::numbers;
use matching::Matching;
use report::{DiffReport, Paired, Pairing, SCHEMA, Side, Statistic};
use runner::Arrays;
use setup::Setup;

pub mod attribution;
pub mod flow;
pub mod geometry;
pub mod lowering;
pub mod matching;
pub mod meaning;
pub mod people;
pub mod plan;
pub mod report;
pub mod runner;
pub mod setup;
pub mod surgery;
pub mod topology;
pub mod truth;

pub use lowering::Precision;
pub use plan::plan;

#[cfg(test)]
mod tests;

/// How two graphs are compared.
#[derive(Clone, Debug)]
pub struct Options {
    /// Inputs to draw.
    pub draws: usize,
    /// The first one's seed.
    pub seed: u64,
    /// Inputs to read instead: an npz with an array for each of the base's inputs.
    pub inputs: Option<PathBuf>,
    /// The body that a regressor's parameters pose, and whose triangles a body graph's vertices span; without one, the mannequin,
    /// and none.
    pub body: Option<PathBuf>,
    /// The query graph that follows when encoders are compared.
    pub query: Option<PathBuf>,
    /// The encoder that makes the features when queries are compared.
    pub encoder: Option<PathBuf>,
    /// Lattice points along each side of the cube; 64 if not given, 40 where queries are compared.
    pub lattice: Option<usize>,
    /// Voxels along each side, where the graph leaves them free.
    pub voxels: Option<usize>,
    /// The value at the surface of an output that is a volume, larger inside.
    pub level: Option<f64>,
    /// Which number of the distances is the difference.
    pub statistic: Statistic,
    /// How many millimetres are allowed.
    pub budget_mm: Option<f64>,
    /// Whether to say which nodes cost the difference.
    pub attribute: bool,
    /// Whether the base is the reference's f64 chain instead of ONNX Runtime's f32.
    pub reference: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            draws: 4,
            seed: 0,
            inputs: None,
            body: None,
            query: None,
            encoder: None,
            lattice: None,
            voxels: None,
            level: None,
            statistic: Statistic::Max,
            budget_mm: None,
            attribute: true,
            reference: false,
        }
    }
}

impl Options {
    fn query_lattice(&self) -> usize {
        self.lattice.unwrap_or(40)
    }
}

/// One of the two: a graph, or arrays that something else computed.
enum Party {
    Graph(Box<Flow>),
    Dump(Arrays),
}

/// ONNX's number of f16.
const F16: i32 = 10;

/// Inputs of which the difference is attributed; more cost time and tell little else.
const ATTRIBUTED: usize = 2;

/// Compares a graph with its variant; either may be a dump of outputs, a `.npz` with arrays under the outputs' names.
///
/// `progress` is told how much of what is done.
///
/// # Errors
/// When a file cannot be read or run, the two cannot be paired, or the base's outputs are not what they mean. A difference is
/// no error.
pub fn diff(
    base: &Path,
    variant: &Path,
    options: &Options,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<DiffReport> {
    let started = Instant::now();
    let (base_bytes, variant_bytes) = (read(base)?, read(variant)?);
    let open = |path: &Path, bytes: &[u8]| -> Result<Option<Box<Flow>>> {
        if path.extension().is_some_and(|e| e == "npz") {
            return Ok(None);
        }
        Ok(Some(Box::new(Flow::of_file(path, bytes)?)))
    };
    let flows = (open(base, &base_bytes)?, open(variant, &variant_bytes)?);
    let (lead, lead_path) = match &flows {
        (Some(flow), _) => (flow, base),
        (None, Some(flow)) => (flow, variant),
        (None, None) => return Err(fault("audit diff", "two dumps; one of the two must be a graph".into())),
    };
    let dumped = flows.0.is_none() || flows.1.is_none();
    if dumped && options.inputs.is_none() {
        let message = "a dump belongs to inputs that only its maker knows: give them with --inputs FILE.npz";
        return Err(fault("audit diff", message.into()));
    }
    let mut setup = Setup::new(lead_path, lead, options)?;
    let names: Vec<String> = lead.outputs.clone();
    let dump = |path: &Path| setup::read_npz(path, names.iter().map(String::as_str));
    let (base_dump, variant_dump) = (
        if flows.0.is_none() { Some(dump(base)?) } else { None },
        if flows.1.is_none() { Some(dump(variant)?) } else { None },
    );
    let pairing = match &flows {
        (Some(base), Some(variant)) => pair(base, variant)?,
        _ => Pairing {
            inputs: Vec::new(),
            outputs: names.iter().map(|name| paired((name, lead), (name, lead))).collect(),
        },
    };
    let parties = (party(flows.0, base_dump), party(flows.1, variant_dump));
    let side = |path: &Path, bytes: &[u8], party: &Party| match party {
        Party::Graph(flow) => side_of(path, bytes, flow.nodes().len()),
        Party::Dump(_) => Side { runtime: format!("npz:{}", path.display()), ..side_of(path, bytes, 0) },
    };
    let sides = (side(base, &base_bytes, &parties.0), side(variant, &variant_bytes, &parties.1));

    let inputs = setup.draws.clone();
    let input_pairs = names_of(&pairing.inputs);
    let output_pairs = names_of(&pairing.outputs);
    progress(0, 3, "running both");
    let (base_outputs, truth) = match &parties.0 {
        Party::Graph(flow) if options.reference => {
            let exact: Result<Vec<Outputs>> =
                inputs.iter().map(|given| truth::outputs(flow, given)).collect();
            (exact?, "the base by the reference, every node in f64")
        }
        Party::Graph(_) => (outputs(&parties.0, &inputs, &[])?, "the base by ONNX Runtime, optimisation off"),
        Party::Dump(_) => (outputs(&parties.0, &inputs, &[])?, "the base's dump"),
    };
    let variant_outputs: Vec<Outputs> = outputs(&parties.1, &inputs, &input_pairs)?
        .into_iter()
        .map(|outputs| renamed(outputs, &output_pairs))
        .collect();

    let numbers = numbers::compare(&base_outputs, &variant_outputs).map_err(|m| fault(&sides.1.path, m))?;
    progress(1, 3, "measuring");
    if let (Some(level), Some(outputs)) = (options.level, base_outputs.first()) {
        setup.take_volume(outputs, level).map_err(|message| fault(&sides.0.path, message))?;
    }
    let finished = |outputs: &[Outputs], setup: &mut Setup| -> Result<Vec<Outputs>> {
        outputs.iter().enumerate().map(|(draw, outputs)| setup.finish(draw, outputs.clone())).collect()
    };
    let base_finished = finished(&base_outputs, &mut setup)?;
    let variant_finished = finished(&variant_outputs, &mut setup)?;
    let ruler = setup.meaning.ruler(&base_finished).map_err(|message| fault(&sides.0.path, message))?;
    let mut notes = std::mem::take(&mut setup.notes);
    let (geometry, distances) =
        ruler.report(&variant_finished).map_err(|message| fault(&sides.1.path, message))?;
    let view = ruler.view(&variant_finished).map_err(|message| fault(&sides.1.path, message))?;

    let attribution = match (&parties, options.attribute) {
        ((Party::Graph(base), Party::Graph(variant)), true) => {
            progress(2, 3, "attributing");
            let flows = (&**base, &**variant);
            match attributed(
                flows,
                &mut setup,
                &inputs,
                (&input_pairs, &output_pairs),
                options.statistic,
                progress,
            ) {
                Ok(attribution) => Some(attribution),
                Err(why) => {
                    notes.push(format!("no attribution: {why}"));
                    None
                }
            }
        }
        _ => None,
    };
    if matches!(&parties.1, Party::Graph(flow) if flow.floats.values().any(|&element| element == F16)) {
        notes.push(
            "ONNX Runtime on a CPU computes chains of f16 nodes in f32 and rounds what is asked for: the difference is \
             of the outputs alone, the attribution of all tensors"
                .into(),
        );
    }
    let millimetres = distances.map(|d| d.statistic(options.statistic));
    let measured = !matches!(geometry, report::Geometry::Numbers);
    if !measured {
        notes.push(
            "the outputs have no geometry that is known: their numbers were compared, and no budget applies"
                .into(),
        );
    }
    let pass =
        options.budget_mm.filter(|_| measured).map(|budget| millimetres.is_some_and(|mm| mm <= budget));
    Ok(DiffReport {
        schema: SCHEMA.to_owned(),
        base: sides.0,
        variant: sides.1,
        truth: truth.to_owned(),
        inputs: setup.words.clone(),
        draws: inputs.len(),
        pairing,
        geometry,
        outputs: numbers,
        millimetres,
        statistic: options.statistic,
        budget_mm: options.budget_mm,
        pass,
        attribution,
        view,
        notes,
        seconds: started.elapsed().as_secs_f64(),
    })
}

/// A graph that ONNX Runtime runs.
fn side_of(path: &Path, bytes: &[u8], nodes: usize) -> Side {
    Side {
        path: path.display().to_string(),
        sha256: Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect(),
        runtime: "ONNX Runtime, optimisation off".to_owned(),
        nodes,
    }
}

fn party(flow: Option<Box<Flow>>, dump: Option<Arrays>) -> Party {
    match flow {
        Some(flow) => Party::Graph(flow),
        None => Party::Dump(dump.unwrap_or_default()),
    }
}

/// Which nodes cost the difference between two graphs, on the first inputs.
fn attributed(
    (base, variant): (&Flow, &Flow),
    setup: &mut Setup,
    inputs: &[Arrays],
    (input_pairs, output_pairs): (&[(String, String)], &[(String, String)]),
    statistic: Statistic,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<report::Attribution> {
    let inputs = &inputs[..inputs.len().min(ATTRIBUTED)];
    let (mut recorded, mut whole, mut base_outputs, mut matching) =
        (Vec::new(), Vec::new(), Vec::new(), None);
    for (draw, given) in inputs.iter().enumerate() {
        let of_base = base.record(given)?;
        let numbers: usize = of_base.values().map(|array| array.values.len()).sum();
        if numbers * inputs.len() > attribution::LARGEST_RECORD {
            let message = format!(
                "the tensors of {} input(s) hold {numbers} numbers each; draw fewer or smaller inputs",
                inputs.len()
            );
            return Err(fault(&base.name, message));
        }
        let of_variant = variant.record(&as_given(given, input_pairs))?;
        let select = |flow: &Flow, recorded: &Arrays| -> Outputs {
            let outputs =
                flow.outputs.iter().filter_map(|name| Some((name.clone(), recorded.get(name)?.clone())));
            as_outputs(outputs.collect())
        };
        base_outputs.push(setup.finish(draw, select(base, &of_base))?);
        whole.push(setup.finish(draw, renamed(select(variant, &of_variant), output_pairs))?);
        if matching.is_none() {
            matching = Some(Matching::of(base, variant, (&of_base, &of_variant), input_pairs, output_pairs));
        }
        recorded.push(of_base);
    }
    let ruler = setup.meaning.ruler(&base_outputs).map_err(|message| fault(&base.name, message))?;
    let subject = Subject {
        base,
        variant,
        matching: &matching.unwrap_or_default(),
        inputs,
        recorded: &recorded,
        input_pairs,
        ruler: &*ruler,
        whole: &whole,
        statistic,
    };
    attribution::attribute(&subject, &mut |draw, outputs| setup.finish(draw, outputs), progress)
}

/// A party's outputs on each input, by its own names.
fn outputs(party: &Party, inputs: &[Arrays], input_pairs: &[(String, String)]) -> Result<Vec<Outputs>> {
    match party {
        Party::Dump(arrays) => Ok(vec![as_outputs(arrays.clone()); inputs.len().min(1)]),
        Party::Graph(flow) => {
            let mut runner = flow.outputs_runner()?;
            let mut run = |given: &Arrays| -> Result<Outputs> {
                let given = as_given(given, input_pairs);
                Ok(as_outputs(unprefixed(runner.run(|name| given.get(name))?, "out:")))
            };
            inputs.iter().map(&mut run).collect()
        }
    }
}

/// The base's inputs under the variant's names.
fn as_given(inputs: &Arrays, pairs: &[(String, String)]) -> Arrays {
    if pairs.is_empty() {
        return inputs.clone();
    }
    pairs.iter().filter_map(|(b, v)| Some((v.clone(), inputs.get(b)?.clone()))).collect()
}

/// The variant's outputs under the base's names.
fn renamed(mut outputs: Outputs, pairs: &[(String, String)]) -> Outputs {
    pairs.iter().filter_map(|(b, v)| Some((b.clone(), outputs.remove(v)?))).collect()
}

/// f32 arrays in f64: exact.
pub fn as_outputs(arrays: Arrays) -> Outputs {
    let tensor = |array: crate::array::Array| {
        Tensor::new(&array.shape, array.values.iter().map(|&x| f64::from(x)).collect())
    };
    arrays.into_iter().map(|(name, array)| (name, tensor(array))).collect()
}

fn names_of(paired: &[Paired]) -> Vec<(String, String)> {
    paired.iter().map(|pair| (pair.base.clone(), pair.variant.clone())).collect()
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })
}

/// Pairs inputs with inputs and outputs with outputs: by name where all names agree, else by order.
fn pair(base: &Flow, variant: &Flow) -> Result<Pairing> {
    let of = |role: &str, ours: &[String], theirs: &[String]| -> Result<Vec<Paired>> {
        if ours.iter().all(|name| theirs.contains(name)) {
            return Ok(ours.iter().map(|name| paired((name, base), (name, variant))).collect());
        }
        if ours.len() != theirs.len() {
            let message = format!("{role} {ours:?} cannot be paired with the variant's {theirs:?}");
            return Err(fault(&base.name, message));
        }
        Ok(ours.iter().zip(theirs).map(|(b, v)| paired((b, base), (v, variant))).collect())
    };
    Ok(Pairing {
        inputs: of("inputs", &base.inputs, &variant.inputs)?,
        outputs: of("outputs", &base.outputs, &variant.outputs)?,
    })
}

fn paired((base, base_flow): (&str, &Flow), (variant, variant_flow): (&str, &Flow)) -> Paired {
    Paired {
        base: base.to_owned(),
        variant: variant.to_owned(),
        by_name: base == variant,
        base_element: base_flow.element(base),
        variant_element: variant_flow.element(variant),
    }
}

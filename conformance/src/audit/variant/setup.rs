//! What is run: inputs for the two graphs, and what makes the ruler's outputs of theirs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use vitruvian_reference::nn::Tensor;
use vitruvian_runtime::contract::{Contract, ImageInput, Occupancy};
use vitruvian_runtime::file::npz::Npz;

use super::Options;
use super::flow::{Flow, fault};
use super::geometry::Outputs;
use super::geometry::body::Source;
use super::geometry::field::Lattice;
use super::meaning::{self, Declared, Meaning};
use super::people::{CUBE, Normal, Person, cameras};
use super::runner::{Arrays, Runner};
use super::surgery::out;
use crate::array::Array;
use crate::error::Result;
use crate::onnx::message::DimensionValue;

/// Views of a drawn capture.
const VIEWS: usize = 4;

/// Points that a query is asked for at once.
const CHUNK: usize = 1 << 15;

/// Radians (standard deviation) of a drawn pose's numbers.
const POSE_RAD: f64 = 0.3;

/// Inputs, and how outputs are read.
pub struct Setup {
    /// One set of inputs per draw, by the graph's own names.
    pub draws: Vec<Arrays>,
    /// Where they came from.
    pub words: String,
    /// What the outputs mean.
    pub meaning: Meaning,
    /// What the meaning calls each of the graph's outputs.
    outputs: BTreeMap<String, String>,
    after: After,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// What makes the ruler's outputs of the graph's own.
#[expect(clippy::large_enum_variant, reason = "there is one for each graph")]
enum After {
    /// Nothing.
    Nothing,
    /// A query of features at points; per draw, the points' inputs in chunks and the points that are worth asking.
    Query { runner: Runner, chunks: Vec<Vec<Arrays>>, seen: Vec<Option<Vec<bool>>>, outside: f64 },
    /// Points that no picture shows the person at are outside.
    Masks { seen: Vec<Vec<bool>>, outside: f64 },
}

impl After {
    /// Inputs that were given show somebody else.
    fn forget_masks(&mut self) {
        match self {
            After::Nothing => {}
            After::Query { seen, .. } => seen.fill(None),
            After::Masks { .. } => *self = After::Nothing,
        }
    }
}

impl Setup {
    /// Draws or reads the inputs of a graph and finds out what its outputs mean.
    ///
    /// # Errors
    /// When a file cannot be read, a second graph does not fit, or an input cannot be drawn; says what to give.
    pub fn new(path: &Path, flow: &Flow, options: &Options) -> Result<Self> {
        let declared = Declared::read(path)?;
        let mut setup = Self {
            draws: Vec::new(),
            words: String::new(),
            meaning: Meaning::Numbers,
            outputs: flow.outputs.iter().cloned().zip(declared.outputs.iter().cloned()).collect(),
            after: After::Nothing,
            notes: declared.refusal.iter().map(|why| format!("no geometry by contract: {why}")).collect(),
        };
        let drawn = setup.draw(flow, &declared, options)?;
        let own: BTreeMap<&str, &str> =
            declared.inputs.iter().map(String::as_str).zip(flow.inputs.iter().map(String::as_str)).collect();
        let renamed = |arrays: Arrays| -> Arrays {
            arrays
                .into_iter()
                .map(|(name, a)| (own.get(name.as_str()).map_or(name.clone(), |n| (*n).to_owned()), a))
                .collect()
        };
        setup.draws = drawn.into_iter().map(renamed).collect();
        if let Some(file) = &options.inputs {
            setup.draws = vec![read_npz(file, flow.inputs.iter().map(String::as_str))?];
            setup.words = file.display().to_string();
            setup.after.forget_masks();
        }
        if matches!(setup.meaning, Meaning::Numbers) {
            setup.guess(options);
        }
        Ok(setup)
    }

    /// The outputs as the ruler reads them.
    ///
    /// # Errors
    /// When a query does not run on them.
    pub fn finish(&mut self, draw: usize, outputs: Outputs) -> Result<Outputs> {
        let named =
            |(name, tensor): (String, Tensor)| (self.outputs.get(&name).cloned().unwrap_or(name), tensor);
        let mut outputs: Outputs = outputs.into_iter().map(named).collect();
        let (seen, outside) = match &mut self.after {
            After::Nothing => return Ok(outputs),
            After::Masks { seen, outside } => (seen.get(draw), *outside),
            After::Query { runner, chunks, seen, outside } => {
                let features: Arrays = outputs.iter().map(|(name, t)| (name.clone(), as_array(t))).collect();
                let mut values = Vec::new();
                for chunk in &chunks[draw] {
                    let found = runner.run(|name| chunk.get(name).or_else(|| features.get(name)))?;
                    values.extend(found.into_values().next().map_or(Vec::new(), |array| array.values));
                }
                let values: Vec<f64> = values.into_iter().map(f64::from).collect();
                outputs = Outputs::from([("occupancy".to_owned(), Tensor::new(&[values.len()], values))]);
                (seen[draw].as_ref(), *outside)
            }
        };
        if let (Some(seen), Some(field)) = (seen, outputs.get_mut("occupancy")) {
            for (value, _) in field.data.iter_mut().zip(seen).filter(|(_, seen)| !**seen) {
                *value = outside;
            }
        }
        Ok(outputs)
    }

    /// Draws inputs by the contract's names and sets what outputs mean.
    fn draw(&mut self, flow: &Flow, declared: &Declared, options: &Options) -> Result<Vec<Arrays>> {
        let seeds = (0..options.draws.max(1) as u64).map(|i| options.seed.wrapping_add(i));
        let people = || seeds.clone().map(Person::new);
        let one = |name: &str, array: Array| Arrays::from([(name.to_owned(), array)]);
        let drawn = format!("{} drawn from seed {}", options.draws.max(1), options.seed);
        let Some(contract) = &declared.contract else {
            self.words = format!("{drawn}: standard normal numbers");
            return seeds
                .clone()
                .map(|seed| normal_inputs(flow, seed, options.voxels.unwrap_or(32)))
                .collect();
        };
        match contract {
            Contract::Regressor { image, .. } => {
                if let Some(source) = meaning::pose_source(contract, options.body.as_ref())? {
                    self.meaning = Meaning::Body(source);
                }
                self.words = format!("{drawn}: pictures of the mannequin, posed and shaped at random");
                Ok(people().map(|p| one("image", p.images(&cameras(1, image.size), image).0)).collect())
            }
            Contract::Body { betas, .. } => {
                self.meaning = Meaning::Body(Source::Points { faces: faces(options.body.as_ref())? });
                self.words = format!("{drawn}: poses of {POSE_RAD} rad and betas of 1, standard deviation");
                let parameters = |seed| {
                    let mut normal = Normal::new(seed);
                    let pose = normal.array(&[1, 72], POSE_RAD);
                    Arrays::from([
                        ("pose".to_owned(), pose),
                        ("betas".to_owned(), normal.array(&[1, betas.unwrap_or(10)], 1.0)),
                    ])
                };
                Ok(seeds.map(parameters).collect())
            }
            Contract::VsrEncoder { resolution, .. } => {
                let cells = options.voxels.unwrap_or(*resolution);
                self.words = format!("{drawn}: {cells}³ voxels of the mannequin, posed and shaped at random");
                let draws: Result<Vec<Arrays>> =
                    people().map(|p| Ok(one("voxels", p.voxels(cells)?))).collect();
                match &options.query {
                    Some(query) => self.ask_vsr(query, options)?,
                    None => self
                        .notes
                        .push("an encoder alone has no surface: name its query graph with --query".into()),
                }
                draws
            }
            Contract::MfPifuEncoder { image, .. } => {
                self.words =
                    format!("{drawn}: {VIEWS} pictures of the mannequin, posed and shaped at random");
                let (draws, masks): (Vec<_>, Vec<_>) = people().map(|p| images(&p, image)).unzip();
                match &options.query {
                    Some(query) => self.ask_pifu(query, image, &masks, options)?,
                    None => self
                        .notes
                        .push("an encoder alone has no surface: name its query graph with --query".into()),
                }
                Ok(draws)
            }
            Contract::VsrQuery { align_corners, occupancy, .. } => {
                let encoder = self.encoder(options, "VSR")?;
                let Contract::VsrEncoder { resolution, .. } = encoder.contract else {
                    return Err(fault(&encoder.name, "it is no VSR encoder, which the query needs".into()));
                };
                let cells = options.voxels.unwrap_or(resolution);
                let lattice = meaning::lattice(options.query_lattice(), *occupancy, "");
                let points = meaning::vsr_points(&meaning::points(&lattice), *align_corners, cells);
                self.meaning = Meaning::Field(lattice);
                self.words =
                    format!("{drawn}: features of {cells}³ voxels of the mannequin by {}", encoder.name);
                let mut runner = encoder.runner;
                people()
                    .map(|person| {
                        let mut inputs = features(&mut runner, &one("voxels", person.voxels(cells)?))?;
                        inputs.insert("points".to_owned(), points.clone());
                        Ok(inputs)
                    })
                    .collect()
            }
            Contract::MfPifuQuery { align_corners, occupancy, depth_center, depth_scale, .. } => {
                let encoder = self.encoder(options, "MF-PIFu")?;
                let Contract::MfPifuEncoder { image, .. } = encoder.contract else {
                    return Err(fault(
                        &encoder.name,
                        "it is no MF-PIFu encoder, which the query needs".into(),
                    ));
                };
                let lattice = meaning::lattice(
                    options.query_lattice(),
                    *occupancy,
                    ", outside where a picture does not show the person",
                );
                let world = meaning::points(&lattice);
                self.meaning = Meaning::Field(lattice);
                self.words =
                    format!("{drawn}: features of {VIEWS} pictures of the mannequin by {}", encoder.name);
                let (mut runner, views) = (encoder.runner, cameras(VIEWS, image.size));
                let mut all_seen = Vec::new();
                let draws: Result<Vec<Arrays>> = people()
                    .map(|person| {
                        let (given, masks) = images(&person, &image);
                        let mut inputs = features(&mut runner, &given)?;
                        let depths = (*depth_center, *depth_scale);
                        let (uv, depth, seen) =
                            meaning::pifu_points(&world, &views, &masks, *align_corners, depths);
                        inputs.extend([("uv".to_owned(), uv), ("depth".to_owned(), depth)]);
                        all_seen.push(seen);
                        Ok(inputs)
                    })
                    .collect();
                self.after = After::Masks { seen: all_seen, outside: outside(*occupancy) };
                draws
            }
        }
    }

    /// A VSR query after the encoder.
    fn ask_vsr(&mut self, path: &Path, options: &Options) -> Result<()> {
        let Second { name, contract, runner } = Second::load(path)?;
        let Contract::VsrQuery { align_corners, occupancy, .. } = contract else {
            return Err(fault(&name, "it is no VSR query".into()));
        };
        let lattice =
            meaning::lattice(options.lattice.unwrap_or(64), occupancy, &format!(", asked of {name}"));
        let cells = options.voxels.unwrap_or(128);
        let points = meaning::points(&lattice);
        let chunk = |part: &[[f64; 3]]| {
            Arrays::from([("points".to_owned(), meaning::vsr_points(part, align_corners, cells))])
        };
        let chunks: Vec<Arrays> = points.chunks(CHUNK).map(chunk).collect();
        let draws = options.draws.max(1);
        self.after = After::Query {
            runner,
            chunks: vec![chunks; draws],
            seen: vec![None; draws],
            outside: outside(occupancy),
        };
        self.meaning = Meaning::Field(lattice);
        Ok(())
    }

    /// An MF-PIFu query after the encoder.
    fn ask_pifu(
        &mut self,
        path: &Path,
        image: &ImageInput,
        masks: &[Vec<Vec<bool>>],
        options: &Options,
    ) -> Result<()> {
        let Second { name, contract, runner } = Second::load(path)?;
        let Contract::MfPifuQuery { align_corners, occupancy, depth_center, depth_scale, .. } = contract
        else {
            return Err(fault(&name, "it is no MF-PIFu query".into()));
        };
        let words = format!(", asked of {name}, outside where a picture does not show the person");
        let lattice = meaning::lattice(options.lattice.unwrap_or(64), occupancy, &words);
        let (points, views) = (meaning::points(&lattice), cameras(VIEWS, image.size));
        let (mut chunks, mut all_seen) = (Vec::new(), Vec::new());
        for masks in masks {
            let mut seen = Vec::new();
            let mut parts = Vec::new();
            for part in points.chunks(CHUNK) {
                let depths = (depth_center, depth_scale);
                let (uv, depth, shown) = meaning::pifu_points(part, &views, masks, align_corners, depths);
                parts.push(Arrays::from([("uv".to_owned(), uv), ("depth".to_owned(), depth)]));
                seen.extend(shown);
            }
            chunks.push(parts);
            all_seen.push(Some(seen));
        }
        self.after = After::Query { runner, chunks, seen: all_seen, outside: outside(occupancy) };
        self.meaning = Meaning::Field(lattice);
        Ok(())
    }

    fn encoder(&self, options: &Options, network: &str) -> Result<Second> {
        match &options.encoder {
            Some(path) => Second::load(path),
            None => Err(fault(
                &format!("a {network} query"),
                "its features come from an encoder: name that graph with --encoder".into(),
            )),
        }
    }

    /// Takes an output that is a volume for a field with its surface at `level`, larger inside; the cube's side is that of
    /// [`CUBE`].
    ///
    /// # Errors
    /// When no output has exactly three sides longer than 1.
    pub fn take_volume(&mut self, outputs: &Outputs, level: f64) -> std::result::Result<(), String> {
        let long = |tensor: &Tensor| -> Option<[usize; 3]> {
            tensor.shape.iter().copied().filter(|&side| side > 1).collect::<Vec<_>>().try_into().ok()
        };
        let (name, shape) = outputs
            .iter()
            .find_map(|(name, tensor)| Some((name, long(tensor)?)))
            .ok_or("no output is a volume, with three sides longer than 1")?;
        let spacing = CUBE.side / shape.into_iter().max().unwrap_or(1) as f64;
        self.meaning = Meaning::Field(Lattice {
            output: self.outputs.get(name).unwrap_or(name).clone(),
            shape,
            origin: CUBE.origin.map(|x| x + 0.5 * spacing),
            spacing,
            level,
            inside_is_larger: true,
            words: format!("output \"{name}\", {shape:?} points of a cube of {} m", CUBE.side),
        });
        Ok(())
    }

    /// Outputs that are bodies by their names and shapes, without a contract.
    fn guess(&mut self, options: &Options) {
        let has = |name: &str| self.outputs.contains_key(name);
        if has("vertices")
            && has("joints")
            && let Ok(faces) = faces(options.body.as_ref())
        {
            self.notes.push("outputs \"vertices\" and \"joints\" were taken for bodies in metres".into());
            self.meaning = Meaning::Body(Source::Points { faces });
        }
    }
}

/// Another graph that keeps a contract, ready to run under the contract's names.
struct Second {
    name: String,
    contract: Contract,
    runner: Runner,
}

impl Second {
    fn load(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let declared = Declared::read(path)?;
        let Some(contract) = declared.contract else {
            let why = declared.refusal.unwrap_or_else(|| "it says nothing of its kind".to_owned());
            return Err(fault(&name, format!("no graph by contract: {why}")));
        };
        let bytes = std::fs::read(path)
            .map_err(|source| crate::error::Error::Io { path: path.to_owned(), source })?;
        let flow = Flow::of_file(path, &bytes)?;
        let mut runner = flow.outputs_runner()?;
        let by_contract = |own: &[String], names: &[String], prefix: fn(&str) -> String| {
            own.iter().map(|own| prefix(own)).zip(names.iter().cloned()).collect()
        };
        let inputs = by_contract(&flow.inputs, &declared.inputs, str::to_owned);
        runner.rename(&inputs, &by_contract(&flow.outputs, &declared.outputs, out));
        Ok(Self { name, contract, runner })
    }
}

/// What an encoder makes of its inputs.
fn features(runner: &mut Runner, inputs: &Arrays) -> Result<Arrays> {
    runner.run(|name| inputs.get(name))
}

/// Pictures of a person, and which pixels show it.
fn images(person: &Person, image: &ImageInput) -> (Arrays, Vec<Vec<bool>>) {
    let (images, masks) = person.images(&cameras(VIEWS, image.size), image);
    (Arrays::from([("images".to_owned(), images)]), masks)
}

/// What a query gives far outside.
fn outside(occupancy: Occupancy) -> f64 {
    if occupancy.inside_is_one { 0.0 } else { 1.0 }
}

/// The triangles of a body file, or none.
fn faces(body: Option<&PathBuf>) -> Result<Vec<[u32; 3]>> {
    Ok(match body {
        Some(path) => vitruvian_runtime::file::body::read(path)?.faces,
        None => Vec::new(),
    })
}

fn as_array(tensor: &Tensor) -> Array {
    Array::new(&tensor.shape, tensor.data.iter().map(|&x| x as f32).collect())
}

/// The arrays of these names, f32.
///
/// # Errors
/// When the file cannot be read or lacks one; names it.
pub fn read_npz<'a>(path: &Path, names: impl Iterator<Item = &'a str>) -> Result<Arrays> {
    let mut archive = Npz::open(path)?;
    names
        .map(|name| {
            let array = archive.array::<f32>(name)?;
            Ok((name.to_owned(), Array::new(&array.shape, array.values)))
        })
        .collect()
}

/// Standard normal numbers for every input of a graph, whole numbers from 0 to 7 where it takes integers; a free side is 1 if it comes first, else as long as `side`, and `D/4` is a
/// quarter of that.
fn normal_inputs(flow: &Flow, seed: u64, side: usize) -> Result<Arrays> {
    let mut normal = Normal::new(seed);
    let graph = flow.model.graph.clone().unwrap_or_default();
    let mut inputs = Arrays::new();
    for name in &flow.inputs {
        let info = graph.input.iter().find(|info| info.name.as_deref() == Some(name));
        let shape = info
            .and_then(|info| info.r#type.as_ref()?.tensor_type.as_ref()?.shape.as_ref())
            .ok_or_else(|| {
                fault(
                    &flow.name,
                    format!("input \"{name}\" has no shape: give the inputs with --inputs FILE.npz"),
                )
            })?;
        let length =
            |(axis, dimension): (usize, &crate::onnx::message::DimensionProto)| match &dimension.value {
                Some(DimensionValue::Number(number)) if *number > 0 => Some(*number as usize),
                Some(DimensionValue::Symbol(symbol)) if symbol.contains('/') => {
                    let divisor: usize = symbol.split('/').nth(1)?.trim().parse().ok().filter(|&d| d > 0)?;
                    Some((side / divisor).max(1))
                }
                _ if axis == 0 => Some(1),
                _ => Some(side),
            };
        let sides: Option<Vec<usize>> = shape.dim.iter().enumerate().map(length).collect();
        let sides = sides
            .filter(|sides| {
                sides.iter().try_fold(1_usize, |n, &s| n.checked_mul(s)).is_some_and(|n| n <= 1 << 28)
            })
            .ok_or_else(|| {
                fault(
                    &flow.name,
                    format!("input \"{name}\" cannot be drawn: give the inputs with --inputs FILE.npz"),
                )
            })?;
        let mut drawn = normal.array(&sides, 1.0);
        if flow.input_element(name).is_some_and(|element| !element.is_float()) {
            // Indices, tokens, truths: small and not negative.
            drawn = drawn.map(|x| (3.0 * x.abs()).floor().min(7.0));
        }
        inputs.insert(name.clone(), drawn);
    }
    Ok(inputs)
}

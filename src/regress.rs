//! `vitruvian regress`: pose, shape and camera of a person from one photograph, by a network.

pub mod people;
mod photograph;
mod report;
mod write;

use std::path::{Path, PathBuf};
use std::time::Instant;

use indicatif::ProgressBar;
use serde_json::Value;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::regress::camera::CONVENTION;
use vitruvian_runtime::regress::{JOINTS, Regressor};
use vitruvian_runtime::session;
use vitruvian_runtime::skinning::Skinner;

use self::people::{Errors, People};
use self::photograph::Source;
use crate::captures::{self, Job};
use crate::failure::{Failure, Result, about};
use crate::mesh_format::MeshFormat;
use crate::output_folder::OutputFolder;
use crate::reconstruct::models;
use crate::{body, progress};

/// The regressor's file in a models folder.
pub const GRAPH: &str = "regressor.onnx";

/// Regress a body from each photograph by itself: pose, shape and a weak-perspective camera (chapter 4)
///
/// Takes photographs, or one capture (its cameras give K, its masks the person), or one folder of captures. A photograph's person is
/// in the box of --box, in the mask of --mask, or it is the whole photograph. Writes into OUT, for a folder of captures into a
/// folder for each: params.npz (poses, betas, trans, camera, crop, K, names; one row a photograph), joints.npz, body_NAME.ply and
/// overlay_NAME.png for each photograph, report.json. Bodies stand in the axes of their photograph's camera: x right, y down, z
/// forward, metres.
#[derive(clap::Args)]
pub struct Arguments {
    /// Photographs (.png, .jpg), a capture, or a folder of captures
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long)]
    out: PathBuf,
    /// Body model of 24 joints (.npz with SMPL's arrays); the built-in mannequin without it
    #[arg(long)]
    body: Option<PathBuf>,
    /// Folder of the exported graphs; models/exported here, above, or beside the executable without it
    #[arg(long, conflicts_with = "graph")]
    models: Option<PathBuf>,
    /// The regressor itself; what it does not declare may stand in a GRAPH.toml beside it
    #[arg(long)]
    graph: Option<PathBuf>,
    /// Where the person is, in pixels: x,y,width,height from the top-left corner; once for each photograph
    #[arg(long = "box", value_name = "X,Y,W,H", allow_hyphen_values = true)]
    boxes: Vec<String>,
    /// Which pixels the person is (128 and more); once for each photograph
    #[arg(long = "mask", conflicts_with = "boxes")]
    masks: Vec<PathBuf>,
    /// Focal length of the photographs in pixels; their diagonal without it
    #[arg(long, allow_hyphen_values = true)]
    focal_px: Option<f64>,
    /// Format of the meshes
    #[arg(long, value_enum, default_value_t = MeshFormat::Ply)]
    format: MeshFormat,
}

/// Everything that is the same for all photographs.
pub struct Setting {
    regressor: Regressor,
    /// Name, size and SHA-256 of the graph.
    graph: Value,
    skinner: Skinner,
    faces: Vec<[u32; 3]>,
    body: Option<PathBuf>,
    format: MeshFormat,
}

/// Regresses the photographs, or those of one capture, or those of every capture of a folder.
pub fn run(arguments: &Arguments) -> Result<()> {
    OutputFolder::check(&arguments.out)?;
    let jobs = jobs(arguments)?;
    let mut setting = Setting::load(arguments)?;
    let bar = progress::bar("regress", jobs.iter().map(|(source, _)| source.count()).sum::<usize>() as u64);
    let mut failures = Vec::new();
    for (source, out) in &jobs {
        let done = one(source, out, &mut setting, &bar);
        match done {
            Ok(people) => bar.suspend(|| eprintln!("{}: {}", out.display(), people.words())),
            Err(failure) if jobs.len() > 1 => {
                bar.suspend(|| eprintln!("error: {failure}"));
                failures.push(failure);
            }
            Err(failure) => return Err(failure),
        }
    }
    bar.finish_and_clear();
    if failures.is_empty() {
        eprintln!("{CONVENTION}");
        return Ok(());
    }
    Err(Failure::Usage(format!("{} of {} captures gave no bodies, see above", failures.len(), jobs.len())))
}

/// What is looked at, and where the results go.
fn jobs(arguments: &Arguments) -> Result<Vec<(Source, PathBuf)>> {
    let Arguments { inputs, out, .. } = arguments;
    let folder = inputs.iter().find(|input| input.is_dir());
    let Some(folder) = folder else {
        let photographs = photograph::listed(inputs, &arguments.boxes, &arguments.masks, arguments.focal_px)?;
        return Ok(vec![(Source::Photographs(photographs), out.clone())]);
    };
    if inputs.len() > 1 {
        return Err(Failure::Usage(format!(
            "{}: a folder is given by itself: one capture, or one folder of captures, or photographs",
            folder.display()
        )));
    }
    for (option, is_given) in [
        ("--box", !arguments.boxes.is_empty()),
        ("--mask", !arguments.masks.is_empty()),
        ("--focal-px", arguments.focal_px.is_some()),
    ] {
        if is_given {
            let message = format!("{option} is for photographs; a capture has its own masks and cameras");
            return Err(Error::file(folder, message).into());
        }
    }
    let jobs = captures::jobs(folder, out)?;
    let source = |Job { capture, out }| Ok((Source::capture(capture)?, out));
    jobs.into_iter().map(source).collect()
}

impl Setting {
    fn load(arguments: &Arguments) -> Result<Setting> {
        let graph = match &arguments.graph {
            Some(graph) => graph.clone(),
            None => models::find(arguments.models.as_deref())?.join(GRAPH),
        };
        Setting::new(arguments.body.as_deref(), &graph, arguments.format)
    }

    fn new(body: Option<&Path>, graph: &Path, format: MeshFormat) -> Result<Setting> {
        let arrays = body::load_arrays(body)?;
        let name = body.unwrap_or(Path::new("the mannequin"));
        let refuse = |message: String| Err(Error::file(name, message).into());
        if arrays.joint_count() != JOINTS {
            let joints = arrays.joint_count();
            return refuse(format!(
                "has {joints} joints; a regressor poses SMPL's {JOINTS}: give such a body"
            ));
        }
        let regressor = Regressor::load(graph, &session::Settings::default())?;
        if let Some(betas) = regressor.beta_count().filter(|&betas| betas > arrays.beta_count()) {
            return refuse(format!(
                "has {} betas, but {} gives {betas}: give a body with as many",
                arrays.beta_count(),
                graph.display()
            ));
        }
        Ok(Setting {
            regressor,
            graph: models::describe_file(graph)?,
            skinner: Skinner::new(&arrays).map_err(about(name))?,
            faces: arrays.faces,
            body: body.map(Path::to_owned),
            format,
        })
    }
}

/// Looks at the photographs of one source, in portions, and writes what was found when all are done.
fn one(source: &Source, out: &Path, setting: &mut Setting, bar: &ProgressBar) -> Result<People> {
    let clock = Instant::now();
    let folder = OutputFolder::begin(out)?;
    let mut people = People::default();
    for portion in source.portions()? {
        let photographs = portion.read()?;
        let first = people.count();
        people.look(&photographs, setting)?;
        write::pictures(&folder, &photographs, &people, first, setting)?;
        bar.inc(photographs.len() as u64);
    }
    write::tables(&folder, &people)?;
    let seconds = clock.elapsed().as_secs_f64();
    write::report(&folder, &report::report(source, &people, setting, seconds))?;
    let stale = write::stale(&people, setting);
    folder.place(&stale.iter().map(String::as_str).collect::<Vec<_>>())?;
    Ok(people)
}

/// Regresses the mannequin from every view of a capture, by the regressor of a models folder, and writes the results into the
/// folder `out`; with the mean errors where the capture knows the truth. `None` if the models folder has no regressor.
pub fn from_each_view(capture: &Path, models: &Path, out: &Path) -> Result<Option<Option<Errors>>> {
    let graph = models.join(GRAPH);
    if !graph.is_file() {
        return Ok(None);
    }
    let mut setting = Setting::new(None, &graph, MeshFormat::Ply)?;
    let source = Source::capture(capture.to_owned())?;
    let people = one(&source, out, &mut setting, &ProgressBar::hidden())?;
    Ok(Some(people.mean_errors()))
}

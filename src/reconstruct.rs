//! `vitruvian reconstruct`: the surface of the body that a capture shows.

pub mod body_capture;
pub mod models;
pub mod report;
pub mod sheet;

use std::path::{Path, PathBuf};

use serde_json::Value;
use vitruvian_runtime::capture::{Capture, Needs, picture};
use vitruvian_runtime::file::{self, atomic};
use vitruvian_runtime::implicit_field::{MAX_DENSE_RESOLUTION, MAX_RESOLUTION, Mode};
use vitruvian_runtime::reconstruct::{Options, Reconstructor};
use vitruvian_runtime::session::Settings;

use self::body_capture::BodyCapture;
use crate::captures::{self, Job};
use crate::failure::{Failure, Result};
use crate::mesh_format::MeshFormat;
use crate::output_folder::OutputFolder;
use crate::progress::StageBars;

/// Reconstruct the body that a capture shows: MF-PIFu, then voxel super-resolution
///
/// Writes coarse.ply, refined.ply, report.json and preview.png into OUT; for a folder of captures, into a folder for each.
#[derive(clap::Args)]
pub struct Arguments {
    /// Capture (a folder with cameras.json, images/ and masks/), or a folder of captures
    capture: PathBuf,
    /// Folder for the results
    #[arg(short, long)]
    out: PathBuf,
    /// Folder of the exported graphs; models/exported here, above, or beside the executable without it
    #[arg(long)]
    models: Option<PathBuf>,
    /// Cells along each side of the lattice on which the surfaces are found
    #[arg(long, default_value_t = 256)]
    resolution: usize,
    /// Stop after the coarse surface
    #[arg(long)]
    no_refine: bool,
    /// Ask the networks for every lattice point instead of those near the surface
    #[arg(long)]
    dense: bool,
    /// Format of the meshes
    #[arg(long, value_enum, default_value_t = MeshFormat::Ply)]
    format: MeshFormat,
}

/// Reconstructs one capture, or every capture of a folder.
pub fn run(arguments: &Arguments) -> Result<()> {
    OutputFolder::check(&arguments.out)?;
    let options = options(arguments.resolution, arguments.dense)?;
    let jobs = captures::jobs(&arguments.capture, &arguments.out)?;
    // Everything that can be wrong with the captures is said before the first network runs.
    for job in &jobs {
        Capture::read(&job.capture, Needs::RECONSTRUCTION)?;
    }
    let mut networks = Networks::load(arguments.models.as_deref(), !arguments.no_refine)?;
    let mut failures = Vec::new();
    for (number, Job { capture, out }) in jobs.iter().enumerate() {
        let subject =
            if jobs.len() > 1 { format!("capture {} of {}", number + 1, jobs.len()) } else { String::new() };
        let done = one(capture, out, &mut networks, &options, arguments.format, subject);
        match done {
            Ok(words) => eprintln!("{words}"),
            Err(failure) if jobs.len() > 1 => {
                eprintln!("error: {failure}");
                failures.push(failure);
            }
            Err(failure) => return Err(failure),
        }
    }
    if failures.is_empty() {
        return Ok(());
    }
    Err(Failure::Usage(format!("{} of {} captures gave no surface, see above", failures.len(), jobs.len())))
}

/// Checks the resolution before anything is loaded.
pub fn options(resolution: usize, dense: bool) -> Result<Options> {
    let (mode, largest) =
        if dense { (Mode::Dense, MAX_DENSE_RESOLUTION) } else { (Mode::CoarseToFine, MAX_RESOLUTION) };
    if !(2..=largest).contains(&resolution) {
        let with = if dense { " with --dense" } else { "" };
        return Err(Failure::Usage(format!(
            "--resolution {resolution} is out of range: choose 2 to {largest}{with}"
        )));
    }
    Ok(Options { resolution, mode })
}

/// The loaded networks and what they were loaded from.
pub struct Networks {
    /// Ready to run.
    pub reconstructor: Reconstructor,
    /// Names, sizes and SHA-256.
    pub graphs: Vec<Value>,
}

impl Networks {
    /// Finds the models folder and loads its graphs.
    pub fn load(models: Option<&Path>, refine: bool) -> Result<Networks> {
        let folder = models::find(models)?;
        let reconstructor = Reconstructor::load(&folder, refine, &Settings::default())?;
        Ok(Networks { reconstructor, graphs: models::describe(&folder, refine)? })
    }
}

fn one(
    capture: &Path,
    out: &Path,
    networks: &mut Networks,
    options: &Options,
    format: MeshFormat,
    subject: String,
) -> Result<String> {
    let mut bars = StageBars::about(subject);
    let done = BodyCapture::reconstruct(capture, &mut networks.reconstructor, options, &mut bars);
    bars.clear();
    let done = done?;
    for view in done.views.iter().filter(|view| view.cut_off) {
        eprintln!(
            "warning: {}: camera \"{}\": its mask reaches the image's border, and what lies beyond counts as outside: \
             frame the whole body, or leave this view out",
            capture.display(),
            view.camera.name
        );
    }
    let folder = OutputFolder::begin(out)?;
    write(&folder, capture, &done, options, format, &networks.graphs)?;
    folder.place(&stale(&done, format))?;

    let mut words = format!("{}:", out.display());
    for ((name, surface), measures) in done.surfaces().zip(&done.measures) {
        words += &format!(" {name} {} triangles", surface.mesh.faces.len());
        if let Some(m) = measures {
            words += &format!(
                ", P2S {:.2} cm, IoU {};",
                m.p2s_cm,
                m.iou.map_or("none".into(), |x| format!("{x:.3}"))
            );
        } else {
            words.push(';');
        }
    }
    let seconds: f64 = done.found.seconds.iter().map(|(_, seconds)| seconds).sum();
    Ok(format!("{words} {seconds:.1} s"))
}

/// Writes what a reconstruction found.
pub fn write(
    folder: &OutputFolder,
    capture: &Path,
    done: &BodyCapture,
    options: &Options,
    format: MeshFormat,
    graphs: &[Value],
) -> Result<()> {
    let format = format.format();
    for (name, surface) in done.surfaces() {
        file::mesh::write(
            &folder.file(&format!("{name}.{}", format.extension())),
            format,
            &surface.mesh,
            None,
        )?;
    }
    picture::write_rgb(&folder.file("preview.png"), &sheet::sheet(done))?;
    let report = report::report(capture, done, options, graphs);
    atomic::write(&folder.file("report.json"), format!("{report:#}\n").as_bytes())?;
    Ok(())
}

/// Meshes of an earlier run that this one does not replace and that would be taken for its results.
fn stale(done: &BodyCapture, format: MeshFormat) -> Vec<&'static str> {
    const MESHES: [(&str, &str, &str); 6] = [
        ("coarse.ply", "coarse", "ply"),
        ("coarse.obj", "coarse", "obj"),
        ("coarse.glb", "coarse", "glb"),
        ("refined.ply", "refined", "ply"),
        ("refined.obj", "refined", "obj"),
        ("refined.glb", "refined", "glb"),
    ];
    let extension = format.format().extension();
    let written = |name: &str, ext: &str| ext == extension && done.surfaces().any(|(n, _)| n == name);
    MESHES.iter().filter(|(_, name, ext)| !written(name, ext)).map(|(file, _, _)| *file).collect()
}

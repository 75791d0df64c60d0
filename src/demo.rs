//! `vitruvian demo`: the whole path on a person that the program makes up itself.

mod page;

use std::path::PathBuf;
use std::time::Instant;

use vitruvian_runtime::file::atomic;

use crate::body;
use crate::evaluate::surfaces::{Measures, Sampling};
use crate::failure::Result;
use crate::mesh_format::MeshFormat;
use crate::output_folder::OutputFolder;
use crate::progress::StageBars;
use crate::reconstruct::body_capture::{BodyCapture, stage_name};
use crate::reconstruct::{self, Networks};
use crate::synthesis::{Scene, Settings};
use crate::{synthesize, table};

/// The folder of the capture within the results.
const CAPTURE: &str = "capture";

/// Show it all: photograph a made-up person, reconstruct the body, refine it, measure it against the truth
///
/// Writes the capture, the meshes, pictures and a page, index.html, that shows them.
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the results
    #[arg(short, long, default_value = "out/demo")]
    out: PathBuf,
    /// Which person, pose, clothes and cameras
    #[arg(long, default_value_t = 8)]
    seed: u64,
    /// Folder of the exported graphs; models/exported here, above, or beside the executable without it
    #[arg(long)]
    models: Option<PathBuf>,
    /// Cells along each side of the lattice on which the surfaces are found
    #[arg(long, default_value_t = 256)]
    resolution: usize,
}

/// What the table and the page show.
pub struct Results<'a> {
    /// Stage and seconds, in order.
    pub seconds: Vec<(&'static str, f64)>,
    /// The surfaces and their errors.
    pub done: &'a BodyCapture,
    /// The seed of the scene.
    pub seed: u64,
}

/// Synthesises, reconstructs, measures, prints and writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    OutputFolder::check(&arguments.out)?;
    let options = reconstruct::options(arguments.resolution, false)?;
    let body = body::load(None)?;
    let mut networks = Networks::load(arguments.models.as_deref(), true)?;

    let folder = OutputFolder::begin(&arguments.out)?;
    let mut bars = StageBars::about("");
    let clock = Instant::now();
    bars.show("synthesise", 0, 1);
    let settings = Settings { seed: arguments.seed, views: 4, size_px: 512 };
    let scene = Scene::random(&body, &settings, 0);
    synthesize::write(&folder.file(CAPTURE), &scene)?;
    let mut seconds = vec![("synthesise", clock.elapsed().as_secs_f64())];

    let done =
        BodyCapture::reconstruct(&folder.file(CAPTURE), &mut networks.reconstructor, &options, &mut bars)?;
    seconds.push(("read and crop", done.seconds_to_read));
    seconds.extend(done.found.seconds.iter().map(|(stage, seconds)| (stage_name(*stage), *seconds)));
    seconds.push(("measure", done.seconds_to_measure));

    let capture = arguments.out.join(CAPTURE);
    reconstruct::write(&folder, &capture, &done, &options, MeshFormat::Ply, &networks.graphs)?;
    let results = Results { seconds, done: &done, seed: arguments.seed };
    atomic::write(&folder.file("index.html"), page::page(&results).as_bytes())?;
    folder.place(&[])?;
    bars.clear();

    table::say(&text(&results));
    eprintln!("\nopen {}", arguments.out.join("index.html").display());
    Ok(())
}

impl Results<'_> {
    /// Name, measures, triangles, and how many of the lattice's points were asked, for each surface.
    pub fn surface_rows(&self) -> Vec<Vec<String>> {
        let row = |((name, surface), measures): ((&str, &_), &Option<Measures>)| -> Vec<String> {
            let surface: &vitruvian_runtime::reconstruct::Surface = surface;
            let mut cells = vec![name.to_owned()];
            cells.extend(measures.map_or(vec!["none".into(); Measures::HEAD.len()], |m| m.cells()));
            cells.push(surface.mesh.faces.len().to_string());
            cells.push(format!("1/{:.0}", surface.field.points as f64 / surface.field.asked.max(1) as f64));
            cells
        };
        self.done.surfaces().zip(&self.done.measures).map(row).collect()
    }

    /// The heads of [`Results::surface_rows`].
    pub fn surface_head() -> Vec<&'static str> {
        let mut head = vec!["surface"];
        head.extend(Measures::HEAD);
        head.extend(["triangles", "points asked"]);
        head
    }

    /// Stage and seconds, with the sum at the end.
    pub fn time_rows(&self) -> Vec<Vec<String>> {
        let all: f64 = self.seconds.iter().map(|(_, seconds)| seconds).sum();
        let rows = self.seconds.iter().copied().chain([("together", all)]);
        rows.map(|(stage, seconds)| vec![stage.to_owned(), format!("{seconds:.2}")]).collect()
    }
}

fn text(results: &Results) -> String {
    let times = table::aligned(&["stage", "seconds"], &results.time_rows());
    let surfaces = table::aligned(&Results::surface_head(), &results.surface_rows());
    format!("{times}\n\n{surfaces}\n{}", Sampling::default().words())
}

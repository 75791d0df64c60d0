//! `vitruvian demo`: the whole path on a person that the program makes up itself.

mod page;

use std::path::PathBuf;
use std::time::Instant;

use vitruvian_reference::metric::joints::mean_joint_error;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_runtime::file::atomic;

use crate::body;
use crate::evaluate::surfaces::{self, Measures, Sampling};
use crate::failure::Result;
use crate::mesh_format::MeshFormat;
use crate::output_folder::OutputFolder;
use crate::progress::StageBars;
use crate::reconstruct::body_capture::{BodyCapture, stage_name};
use crate::reconstruct::{self, Networks, models};
use crate::regress::people::Errors;
use crate::synthesis::surroundings::Wanted;
use crate::synthesis::{Scene, Settings, Surroundings};
use crate::{fit, regress, synthesize, table};

/// The folder of the capture within the results.
const CAPTURE: &str = "capture";

/// Show it all: photograph a made-up person, fit a body, regress it from each photograph, reconstruct the surface, refine it, measure
/// against the truth
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

/// The folder of the fitted body within the results.
const FIT: &str = "fit";

/// The folder of the regressed bodies within the results.
const REGRESS: &str = "regress";

/// How far the fitted body is from the truth.
pub struct Body {
    /// Eq. 2.7, millimetres.
    pub joint_error_mm: f64,
    /// Of the skin, against the dressed surface.
    pub measures: Option<Measures>,
    /// Triangles.
    pub faces: usize,
}

/// What the table and the page show.
pub struct Results<'a> {
    /// Stage and seconds, in order.
    pub seconds: Vec<(&'static str, f64)>,
    /// The body fitted to joints and masks.
    pub fitted: Body,
    /// The bodies regressed from one photograph each, where there is a regressor.
    pub regressed: Option<Errors>,
    /// The surfaces and their errors.
    pub done: &'a BodyCapture,
    /// The seed of the scene.
    pub seed: u64,
}

/// Synthesises, fits, reconstructs, measures, prints and writes.
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
    let shots = Surroundings::random(&scene, &settings, &Wanted::default(), 0).photograph(&scene);
    synthesize::write(&folder.file(CAPTURE), &scene, shots)?;
    let mut seconds = vec![("synthesise", clock.elapsed().as_secs_f64())];

    bars.show("fit", 0, 1);
    let fitted = fit::to_joints_and_masks(&folder.file(CAPTURE), &body, &folder.file(FIT))?;
    let seen = fitted.seconds.iter().map(|(stage, seconds)| match *stage {
        "joints" => ("fit joints", *seconds),
        _ => ("fit masks", *seconds),
    });
    seconds.extend(seen);
    let skin = Mesh::new(fitted.posed.vertices.clone(), body.faces.clone());
    let fitted = Body {
        joint_error_mm: 1000.0 * mean_joint_error(&fitted.posed.joints, &scene.joints),
        measures: surfaces::measure(&skin, &scene.surface, &Sampling::default()),
        faces: skin.faces.len(),
    };

    bars.show("regress", 0, 1);
    let clock = Instant::now();
    let models = models::find(arguments.models.as_deref())?;
    let regressed = regress::from_each_view(&folder.file(CAPTURE), &models, &folder.file(REGRESS))?;
    match regressed {
        Some(_) => seconds.push(("regress", clock.elapsed().as_secs_f64())),
        None => eprintln!("{} has no regressor.onnx: nothing is regressed", models.display()),
    }

    let done =
        BodyCapture::reconstruct(&folder.file(CAPTURE), &mut networks.reconstructor, &options, &mut bars)?;
    seconds.push(("read and crop", done.seconds_to_read));
    seconds.extend(done.found.seconds.iter().map(|(stage, seconds)| (stage_name(*stage), *seconds)));
    seconds.push(("measure", done.seconds_to_measure));

    let capture = arguments.out.join(CAPTURE);
    reconstruct::write(&folder, &capture, &done, &options, MeshFormat::Ply, &networks.graphs)?;
    let results =
        Results { seconds, fitted, regressed: regressed.flatten(), done: &done, seed: arguments.seed };
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
        let mut body = vec!["fitted body".to_owned()];
        body.extend(self.fitted.measures.map_or(vec!["none".into(); Measures::HEAD.len()], |m| m.cells()));
        body.extend([self.fitted.faces.to_string(), "–".to_owned()]);
        [body].into_iter().chain(self.done.surfaces().zip(&self.done.measures).map(row)).collect()
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
    let joints =
        format!("fitted body: joints {:.2} mm from the true ones (eq. 2.7)", results.fitted.joint_error_mm);
    let regressed = results.regressed.map_or(String::new(), |errors| {
        format!(
            "\nregressed bodies, one photograph each: joints {:.1} mm from the true ones (MPJPE), {:.1} mm aligned (PA-MPJPE)",
            errors.mpjpe_mm, errors.pa_mpjpe_mm
        )
    });
    format!("{times}\n\n{surfaces}\n{}\n{joints}{regressed}", Sampling::default().words())
}

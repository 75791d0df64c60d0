//! Table 4.8 of Li 2021: a body fitted to each view alone and to four views together, from what the regressor makes of them;
//! and figure 4.8's curve.
//!
//! ```text
//! cargo run --release --example table_4_8 -- --regressor models/exported/regressor.onnx [--body BODY.npz]
//! ```
//! People that no training has seen, four views of 256×256, exact joints with noise N(0, 2²) px, those behind furniture not
//! marked. The 24 joints are compared image by image in the camera's frame. Prints the table and draws `figure_4_8.svg`.

mod common;

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use rayon::prelude::*;
use vitruvian::table;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::mv_smplify::{MvPreset, MvSmplify, ViewStart};
use vitruvian_reference::fitting::{KeypointSet, View};
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_reference::metric::joints::pa_mpjpe;
use vitruvian_reference::metric::pck::thresholds_m;
use vitruvian_runtime::regress::Regressor;
use vitruvian_runtime::session;

use common::chart::{self, Scale, Series};
use common::held_out::{self, Arguments, Errors, HEAD, Person};

/// As printed, on 100×4 images of Human3.6M's S1: PCK, AUC, PA.
const THESIS: [(&str, [&str; 3]); 2] =
    [("thesis, SMPLify", ["93.9", "54.9", "70.0"]), ("thesis, MV-SMPLify", ["97.4", "60.7", "59.2"])];

#[derive(clap::Parser)]
struct Own {
    #[command(flatten)]
    arguments: Arguments,
    /// The regressor's graph
    #[arg(long)]
    regressor: PathBuf,
    /// Folder for the chart
    #[arg(short, long, default_value = "docs/results")]
    out: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let Own { arguments, regressor, out } = Own::parse();
    let (name, body) = arguments.body()?;
    let mut regressor = Regressor::load(&regressor, &session::Settings::default())?;
    let (mut rows, mut series) = (Vec::new(), Vec::new());
    for (scenes, people) in arguments.people(&body, regressor.image_size())? {
        let starts = held_out::regress(&mut regressor, &people)?;
        let mut add = |way: &str, joints: &[Vec<Vector3>], note: String| {
            let errors = Errors::of(joints, &people);
            let mut row = vec![name.clone(), scenes.to_owned(), way.to_owned()];
            row.extend(errors.cells());
            row.push(note);
            rows.push(row);
            let curve = errors.root_relative.pck_curve();
            let points = thresholds_m().iter().map(|t| 1000.0 * t).zip(curve).collect();
            series.push(Series { name: format!("{way}, {scenes}"), points });
        };
        add("regressor", &held_out::joints(&body.skeleton(), &starts), String::new());
        for (label, preset) in [("", MvPreset::Refined), (", preset thesis", MvPreset::Thesis)] {
            for (way, together) in [("SMPLify, each view alone", 1), ("MV-SMPLify, four views", 4)] {
                let fits = fit(&body, &people, &starts, preset, together);
                add(&format!("{way}{label}"), &fits.joints, fits.note(&people));
            }
        }
    }
    let head = [&["body", "scenes", "way"], &HEAD[..], &["fits"]].concat();
    table::say(&table::aligned(&head, &rows));
    let rows: Vec<Vec<String>> = THESIS
        .iter()
        .map(|(way, cells)| [&[*way], &cells[..]].concat().into_iter().map(str::to_owned).collect())
        .collect();
    table::say(&table::aligned(&["way", "PCK@150", "AUC", "PA-MPJPE mm"], &rows));
    std::fs::create_dir_all(&out)?;
    // The presets of the thesis differ too little to be told apart in a chart.
    series.retain(|series| !series.name.contains("preset"));
    let title = "Figure 4.8: percentage of correct keypoints";
    chart::lines(&out.join("figure_4_8.svg"), title, ["threshold, mm", "PCK"], Scale::Linear, &series)?;
    Ok(())
}

/// The fits of all people.
struct Fits {
    /// Of each image, camera frame, without translations.
    joints: Vec<Vec<Vector3>>,
    /// Of each fit.
    valid: Vec<bool>,
    seconds: Vec<f64>,
}

impl Fits {
    /// How many can be trusted, how near those are, and what a fit costs.
    fn note(&self, people: &[Person]) -> String {
        let truth = people.iter().flat_map(|person| &person.views).map(|seen| &seen.joints);
        let views = self.joints.len() / self.valid.len();
        let errors: Vec<f64> = self.joints.iter().zip(truth).map(|(j, truth)| pa_mpjpe(j, truth)).collect();
        let trusted: Vec<f64> = errors
            .chunks(views)
            .zip(&self.valid)
            .filter(|(_, v)| **v)
            .flat_map(|(e, _)| e)
            .copied()
            .collect();
        let pa_mm = 1000.0 * trusted.iter().sum::<f64>() / trusted.len().max(1) as f64;
        let mut sorted = self.seconds.clone();
        sorted.sort_by(f64::total_cmp);
        let median_ms = 1000.0 * sorted[sorted.len() / 2];
        let valid = self.valid.iter().filter(|valid| **valid).count();
        format!("{valid} of {} valid (PA {pa_mm:.1} mm), median {median_ms:.1} ms", sorted.len())
    }
}

/// Fits each person's views, so many `together`. What a fit refuses (fewer than four marks in a view) stays as regressed.
fn fit(
    body: &BodyModel,
    people: &[Person],
    starts: &[Vec<ViewStart>],
    preset: MvPreset,
    together: usize,
) -> Fits {
    let fitter = MvSmplify::new(body, KeypointSet::Smpl24).expect("a body of SMPL's tree");
    let options = preset.options();
    let of_person = |(person, starts): (&Person, &Vec<ViewStart>)| {
        let mut fits = Vec::new();
        for (seen, starts) in person.views.chunks(together).zip(starts.chunks(together)) {
            let views: Vec<View> = seen.iter().map(|seen| seen.view.clone()).collect();
            let clock = Instant::now();
            let found = fitter.fit(&views, starts, &options);
            let seconds = clock.elapsed().as_secs_f64();
            let joints = |view: usize| match &found {
                Ok(fit) => fitter.skeleton().posed_joints(&fit.pose(view), &fit.betas),
                Err(_) => fitter.skeleton().posed_joints(&held_out::pose(&starts[view]), &starts[view].betas),
            };
            let joints: Vec<_> = (0..views.len()).map(joints).collect();
            fits.push((joints, found.is_ok_and(|fit| fit.valid), seconds));
        }
        fits
    };
    let all: Vec<_> = people.par_iter().zip(starts).flat_map_iter(of_person).collect();
    Fits {
        valid: all.iter().map(|(_, valid, _)| *valid).collect(),
        seconds: all.iter().map(|(.., seconds)| *seconds).collect(),
        joints: all.into_iter().flat_map(|(joints, ..)| joints).collect(),
    }
}

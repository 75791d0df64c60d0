//! Table 4.7 of Li 2021: the regressor trained without and with the fit in the loop.
//!
//! ```text
//! cargo run --release --example table_4_7 -- --without A/regressor.onnx --with B/regressor.onnx [--body BODY.npz]
//! ```
//! Both look at the same people that no training has seen, one image at a time. The 24 joints, and the vertices, are compared
//! image by image in the camera's frame, relative to the pelvis. Prints the table.

mod common;

use std::error::Error;
use std::path::PathBuf;

use clap::Parser;
use rayon::prelude::*;
use vitruvian::table;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::mv_smplify::ViewStart;
use vitruvian_reference::linalg::matrix::apply;
use vitruvian_reference::linalg::vector::{Vector3, distance, sub};
use vitruvian_runtime::regress::Regressor;
use vitruvian_runtime::session;

use common::held_out::{self, Arguments, Errors, HEAD, Person};

/// As printed: PA-MPJPE / MPJPE, mm, of Human3.6M, MPI-INF-3DHP and 3DPW.
const THESIS: [(&str, [&str; 3]); 2] = [
    ("thesis, L2D + L3D", ["46.4 / 65.8", "66.8 / 100.8", "61.7 / 99.0"]),
    ("thesis, and the fit", ["43.8 / 64.8", "65.1 / 97.6", "58.6 / 93.4"]),
];

#[derive(clap::Parser)]
struct Own {
    #[command(flatten)]
    arguments: Arguments,
    /// The graph that was trained without the fit
    #[arg(long)]
    without: PathBuf,
    /// The graph that was trained with it
    #[arg(long)]
    with: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let Own { arguments, without, with } = Own::parse();
    let (name, body) = arguments.body()?;
    let load = |path: &PathBuf| Regressor::load(path, &session::Settings::default());
    let mut arms = [("without the fit", load(&without)?), ("with the fit", load(&with)?)];
    let size = arms[0].1.image_size();
    if arms[1].1.image_size() != size {
        return Err(
            format!("the two graphs take images of {size} and {} pixels", arms[1].1.image_size()).into()
        );
    }
    let mut rows = Vec::new();
    for (scenes, people) in arguments.people(&body, size)? {
        for (arm, regressor) in &mut arms {
            let found = held_out::regress(regressor, &people)?;
            let errors = Errors::of(&held_out::joints(&body.skeleton(), &found), &people);
            let mut row = vec![name.clone(), scenes.to_owned(), (*arm).to_owned()];
            row.extend(errors.cells());
            row.push(format!("{:.1}", 1000.0 * vertex_error(&body, &people, &found)));
            rows.push(row);
        }
    }
    let head = [&["body", "scenes", "trained"], &HEAD[..], &["vertices mm"]].concat();
    table::say(&table::aligned(&head, &rows));
    let rows: Vec<Vec<String>> = THESIS
        .iter()
        .map(|(arm, cells)| [&[*arm], &cells[..]].concat().into_iter().map(str::to_owned).collect())
        .collect();
    table::say(&table::aligned(&["PA / MPJPE, mm", "Human3.6M", "MPI-INF-3DHP", "3DPW"], &rows));
    Ok(())
}

/// The mean distance of the bare body's vertices, relative to the pelvis, over all images; metres.
fn vertex_error(body: &BodyModel, people: &[Person], found: &[Vec<ViewStart>]) -> f64 {
    let skeleton = body.skeleton();
    let of_person = |(person, found): (&Person, &Vec<ViewStart>)| -> f64 {
        let truth = body.pose(&person.pose, &person.betas, person.trans);
        let of_view = |(seen, found): (&held_out::Seen, &ViewStart)| {
            let pelvis = skeleton.rest_joints(&found.betas)[0];
            let estimate = body.pose(&held_out::pose(found), &found.betas, [0.0; 3]);
            let turned = |v: &Vector3| apply(&seen.extrinsics.r, sub(*v, truth.joints[0]));
            let pairs = estimate.vertices.iter().zip(&truth.vertices);
            let sum: f64 = pairs.map(|(e, v)| distance(sub(*e, pelvis), turned(v))).sum();
            sum / truth.vertices.len() as f64
        };
        person.views.iter().zip(found).map(of_view).sum::<f64>() / person.views.len() as f64
    };
    people.par_iter().zip(found).map(of_person).sum::<f64>() / people.len() as f64
}

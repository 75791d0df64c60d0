//! Figure 3.10 of Li 2021: the overlap of silhouettes after each method, and with the 3-D term of eq. 3.8 alone.
//!
//! ```text
//! cargo run --release --example figure_3_10 -- [--body BODY.npz]
//! ```
//! Moving people, joints with 2 px noise, four known cameras and true masks. Prints the table and draws `figure_3_10.svg`.

mod common;

use std::error::Error;

use vitruvian::synthesis::{Stance, Subject};
use vitruvian::table;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::multiview_smplify::MultiviewSmplify;
use vitruvian_reference::fitting::silhouette::{
    PoseRefinement, SilhouetteOptions, Terms, Unknowns, fit_silhouettes,
};
use vitruvian_reference::fitting::{Extrinsics, Options, Parameters, Preset};
use vitruvian_reference::linalg::vector::Vector3;

use common::silhouettes::{masks, score};
use common::{Arguments, chart};

const NOISE_PX: f64 = 2.0;

/// What is compared, in this order; the first looks through the first camera alone.
const METHODS: [&str; 7] =
    ["smplify", "ch3 joints", "joints", "β only", "3-D term", "both terms", "pose too"];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::of_process();
    let (mut rows, mut series) = (Vec::new(), Vec::new());
    for (name, body) in arguments.bodies()? {
        let people = arguments.each(|index| person(&body, arguments.seed, index));
        let mean = |method: usize, of: fn(&(f64, f64)) -> f64| {
            people.iter().map(|scores| of(&scores[method])).sum::<f64>() / people.len() as f64
        };
        for (method, words) in METHODS.iter().enumerate() {
            rows.push(vec![
                name.clone(),
                (*words).to_owned(),
                people.len().to_string(),
                format!("{:.4}", mean(method, |s| s.0)),
                format!("{:.1}", mean(method, |s| s.1)),
            ]);
        }
        series.push((name, (0..METHODS.len()).map(|m| mean(m, |s| s.0)).collect()));
    }
    table::say(&table::aligned(&["body", "method", "people", "IoU", "vertices mm"], &rows));
    std::fs::create_dir_all(&arguments.out)?;
    let path = arguments.out.join("figure_3_10.svg");
    Ok(chart::bars(&path, "Figure 3.10: overlap of silhouettes", "mean IoU", &METHODS, &series, 0.2)?)
}

/// IoU and vertex error of every method.
fn person(body: &BodyModel, seed: u64, index: u64) -> Vec<(f64, f64)> {
    let subject = Subject::random(body, Stance::Any, 4, seed, index);
    let truth = masks(body, &subject);
    let all = subject.observation(NOISE_PX, Extrinsics::Known);
    let mut first = all.clone();
    first.views.truncate(1);
    let fitter = MultiviewSmplify::new(body).expect("a body with SMPL's tree");
    let joints = |observation, options: Options| {
        fitter.fit(observation, &options, None).expect("24 joints can be fitted").parameters
    };
    let pose =
        |found: &Parameters| -> Vec<Vector3> { body.pose(&found.pose, &found.betas, found.trans).vertices };
    let start = joints(&all, Options::default());
    let silhouettes = |options: SilhouetteOptions| {
        let fit = fit_silhouettes(body, &start, &truth, Some(&all), &options);
        fit.expect("masks of the person that the joints are of").vertices
    };
    let own = SilhouetteOptions::default;
    let found = [
        pose(&joints(&first, Preset::Smplify.options())),
        pose(&joints(&all, Preset::Ch3.options())),
        pose(&start),
        silhouettes(SilhouetteOptions { unknowns: Unknowns::Betas, ..own() }),
        silhouettes(SilhouetteOptions { terms: Terms::Rays, ..own() }),
        silhouettes(own()),
        silhouettes(SilhouetteOptions { refine_pose: Some(PoseRefinement::default()), ..own() }),
    ];
    found.iter().map(|vertices| score(body, &subject, vertices, &truth)).collect()
}

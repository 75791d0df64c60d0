//! Figure 3.5 of Li 2021: how noise on the joints and too large masks move the fit to silhouettes.
//!
//! ```text
//! cargo run --release --example figure_3_5 -- [--body BODY.npz] [--refine-pose]
//! ```
//! People in the A-pose, four known cameras. Above: joints with noise N(0, k²), k = 2 … 5 px, and true masks. Below: exact
//! joints, and masks dilated by squares of 3, 5, 7, 9 pixels. IoU is taken with the *true* masks. Prints the tables and draws
//! `figure_3_5_noise.svg` and `figure_3_5_dilation.svg`.

mod common;

use std::error::Error;

use clap::Parser;
use vitruvian::synthesis::{Stance, Subject};
use vitruvian::table;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::silhouette::{PoseRefinement, SilhouetteOptions};
use vitruvian_reference::silhouette::dilation::{StructuringElement, dilate};

use common::Arguments;
use common::chart::{self, Scale, Series};
use common::silhouettes::{Outcome, fit, masks};

const NOISE_PX: [usize; 5] = [0, 2, 3, 4, 5];
const SQUARES_PX: [usize; 5] = [1, 3, 5, 7, 9];

#[derive(clap::Parser)]
struct Own {
    #[command(flatten)]
    arguments: Arguments,
    /// Our extension as well: the masks move the pose
    #[arg(long)]
    refine_pose: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let Own { arguments, refine_pose } = Own::parse();
    let ways: &[_] =
        if refine_pose { &[("pose fixed", false), ("pose refined", true)] } else { &[("pose fixed", false)] };
    let (mut noisy, mut dilated) = (Vec::new(), Vec::new());
    let mut rows = Vec::new();
    for (name, body) in arguments.bodies()? {
        for &(way, refine) in ways {
            let refine_pose = refine.then(PoseRefinement::default);
            let options = SilhouetteOptions { refine_pose, ..SilhouetteOptions::default() };
            let mut sweep =
                |what: &str, levels: [usize; 5], disturb: &(dyn Fn(usize) -> Disturbance + Sync)| {
                    let of_level = levels.map(|level| {
                        let all = arguments
                            .each(|index| person(&body, disturb(level), &options, arguments.seed, index));
                        let mean = Outcome::mean(&all);
                        rows.push(mean.row([&name, way, &format!("{what} {level} px")], all.len()));
                        (level as f64, mean.iou)
                    });
                    Series { name: format!("{name}, {way}"), points: of_level.to_vec() }
                };
            noisy.push(sweep("noise", NOISE_PX, &|k| Disturbance { noise_px: k as f64, square_px: 1 }));
            dilated.push(sweep("square", SQUARES_PX, &|s| Disturbance { noise_px: 0.0, square_px: s }));
        }
    }
    table::say(&table::aligned(&Outcome::head(["body", "way", "disturbance"]), &rows));
    std::fs::create_dir_all(&arguments.out)?;
    let draw = |file: &str, title: &str, x: &str, series: &[Series]| {
        chart::lines(
            &arguments.out.join(file),
            title,
            [x, "mean IoU with the true masks"],
            Scale::Linear,
            series,
        )
    };
    draw("figure_3_5_noise.svg", "Figure 3.5: noise on the joints", "k, pixels", &noisy)?;
    draw("figure_3_5_dilation.svg", "Figure 3.5: dilated masks", "side of the square, pixels", &dilated)?;
    Ok(())
}

/// What is wrong with the detections.
struct Disturbance {
    noise_px: f64,
    square_px: usize,
}

fn person(
    body: &BodyModel,
    wrong: Disturbance,
    options: &SilhouetteOptions,
    seed: u64,
    index: u64,
) -> Outcome {
    let subject = Subject::random(body, Stance::APose, 4, seed, index);
    let truth = masks(body, &subject);
    let square = StructuringElement::Square { size: wrong.square_px };
    let seen: Vec<_> = truth.iter().map(|mask| dilate(mask, square)).collect();
    fit(body, &subject, wrong.noise_px, &seen, &truth, options)
}

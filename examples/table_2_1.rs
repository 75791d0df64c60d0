//! Table 2.1 of Li 2021: the error of the joints (eq. 2.7) fitted to 1, 2, 3 and 4 views of synthetic people, exact 2-D
//! joints, unknown extrinsics.
//!
//! ```text
//! cargo run --release --example table_2_1 -- [--body BODY.npz]
//! ```
//! Prints the table and draws `table_2_1.svg`. Without extrinsics position, heading and size of the world are free, so the
//! error is taken after Procrustes alignment; the thesis does not say how it compares.

mod common;

use std::error::Error;

use vitruvian::synthesis::{Stance, Subject};
use vitruvian::table;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::fitting::multiview_smplify::MultiviewSmplify;
use vitruvian_reference::fitting::{Extrinsics, Preset, Start};
use vitruvian_reference::metric::joints::pa_mpjpe;

use common::chart::{self, Scale, Series};
use common::{Arguments, mean_and_worst};

/// Metres, as printed: SMPLify with one view, then ours with 2, 3, 4.
const THESIS: [f64; 4] = [0.0177, 0.0113, 0.0108, 0.00525];

/// Ways to run the fit.
const WAYS: [(&str, Preset, Start); 3] = [
    ("ch2, start as the thesis", Preset::Ch2, Start::Identity),
    ("ch2, robust start", Preset::Ch2, Start::Robust),
    ("empirical Bayes (default)", Preset::EmpiricalBayes, Start::Robust),
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::of_process();
    let mut rows = Vec::new();
    let mut series =
        vec![Series { name: "thesis".into(), points: points(&THESIS.map(|metres| 1000.0 * metres)) }];
    for (body_name, body) in arguments.bodies()? {
        for (way, preset, start) in WAYS {
            let mut means = Vec::new();
            for views in 1..=4 {
                let errors =
                    arguments.each(|index| error_mm(&body, views, preset, start, arguments.seed, index));
                let (mean, worst) = mean_and_worst(&errors);
                let mut sorted = errors;
                sorted.sort_by(f64::total_cmp);
                rows.push(vec![
                    body_name.clone(),
                    way.to_owned(),
                    views.to_string(),
                    format!("{mean:.3}"),
                    format!("{:.3}", sorted[sorted.len() / 2]),
                    format!("{worst:.1}"),
                    format!("{:.2}", 1000.0 * THESIS[views - 1]),
                ]);
                means.push(mean);
            }
            series.push(Series { name: format!("{body_name}, {way}"), points: points(&means) });
        }
    }
    let head = ["body", "way", "views", "mean mm", "median mm", "worst mm", "thesis mm"];
    table::say(&table::aligned(&head, &rows));
    std::fs::create_dir_all(&arguments.out)?;
    let path = arguments.out.join("table_2_1.svg");
    Ok(chart::lines(
        &path,
        "Table 2.1: error of joints",
        ["views", "mean error, mm"],
        Scale::Logarithmic(1e-4),
        &series,
    )?)
}

/// The error after alignment of person `index` fitted with the first `views` of four cameras.
fn error_mm(body: &BodyModel, views: usize, preset: Preset, start: Start, seed: u64, index: u64) -> f64 {
    let mut subject = Subject::random(body, Stance::Any, 4, seed, index);
    subject.cameras.truncate(views);
    let mut options = preset.options();
    options.start = start;
    let fit = MultiviewSmplify::new(body)
        .and_then(|fitter| fitter.fit(&subject.observation(0.0, Extrinsics::Unknown), &options, None))
        .expect("24 exact joints in every view can be fitted");
    1000.0 * pa_mpjpe(&fit.joints, &subject.posed.joints)
}

fn points(values: &[f64]) -> Vec<(f64, f64)> {
    values.iter().enumerate().map(|(i, &value)| (i as f64 + 1.0, value)).collect()
}

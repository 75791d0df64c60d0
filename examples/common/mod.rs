//! What the experiments share: arguments, bodies, people.
#![allow(dead_code, unused_imports, reason = "each experiment uses its part")]

pub mod held_out;
pub mod silhouettes;

use std::path::PathBuf;

use rayon::prelude::*;
use vitruvian::body;
pub use vitruvian::chart;
use vitruvian::failure::Result;
use vitruvian_reference::body::BodyModel;

/// The arguments of an experiment.
#[derive(clap::Args)]
pub struct Arguments {
    /// A second body (.npz in SMPL's arrays) beside the mannequin
    #[arg(long)]
    pub body: Option<PathBuf>,
    /// People for each figure
    #[arg(long, default_value_t = 100)]
    pub count: u64,
    /// Seed of the people
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder for the chart
    #[arg(short, long, default_value = "docs/results")]
    pub out: PathBuf,
}

impl Arguments {
    /// Those that the example was called with, where it has no others.
    pub fn of_process() -> Arguments {
        #[derive(clap::Parser)]
        struct Only {
            #[command(flatten)]
            arguments: Arguments,
        }
        <Only as clap::Parser>::parse().arguments
    }

    /// The mannequin, and the second body under its file's name.
    pub fn bodies(&self) -> Result<Vec<(String, BodyModel)>> {
        let mut bodies = vec![("mannequin".to_owned(), body::load(None)?)];
        if let Some(path) = &self.body {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            bodies.push((name, body::load_to_pose(Some(path))?));
        }
        Ok(bodies)
    }

    /// `measure` of every person's number, in parallel, in order.
    pub fn each<T: Send>(&self, measure: impl Fn(u64) -> T + Sync) -> Vec<T> {
        let bar = vitruvian::progress::bar("people", self.count);
        let all = (0..self.count).into_par_iter().map(|index| {
            let measured = measure(index);
            bar.inc(1);
            measured
        });
        all.collect()
    }
}

/// The mean, and the largest.
pub fn mean_and_worst(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, values.iter().copied().fold(0.0, f64::max))
}

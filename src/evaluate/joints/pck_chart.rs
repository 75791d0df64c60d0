//! PCK over its threshold as a picture, as in Li 2021, figure 4.8.

use std::path::Path;

use vitruvian_reference::metric::pck::thresholds_m;

use super::Evaluation;
use crate::chart::{self, Scale, Series};
use crate::failure::Result;

/// Draws the curve of every evaluation, relative to the root, and of a single one also that after Procrustes.
pub fn draw(path: &Path, evaluations: &[Evaluation]) -> Result<()> {
    let series = |name: String, curve: [f64; 31]| Series {
        name,
        points: thresholds_m().iter().map(|threshold| 1000.0 * threshold).zip(curve).collect(),
    };
    let mut all: Vec<Series> = evaluations
        .iter()
        .map(|evaluation| {
            let measures = evaluation.errors.measures();
            let name = format!("{}: PCK {:.1}, AUC {:.1}", evaluation.label, measures.pck_150, measures.auc);
            series(name, evaluation.errors.relative.pck_curve())
        })
        .collect();
    if let [only] = evaluations {
        let measures = only.errors.measures();
        let name = format!("after Procrustes: PCK {:.1}, AUC {:.1}", measures.pa_pck_150, measures.pa_auc);
        all.push(series(name, only.errors.aligned.pck_curve()));
    }
    chart::lines(path, "Correct joints", ["threshold, mm", "PCK, %"], Scale::Percent, &all)
}

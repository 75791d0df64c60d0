//! Two surfaces: P2S, completeness, Chamfer-L2, normal consistency, IoU.

use std::path::Path;

use serde::Serialize;
use serde_json::json;
use vitruvian_conformance::convert;
use vitruvian_reference::metric::surface::{SurfaceDistance, volume_iou};
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_reference::surface::topology::Topology;
use vitruvian_runtime::file;

use super::largest_piece::largest_piece;
use super::{Findings, sides};
use crate::failure::{Failure, Result};

/// How surfaces and volumes are sampled.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Sampling {
    /// Points drawn from each surface
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    samples: u32,
    /// Points drawn for the IoU of the volumes
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=1_000_000_000))]
    iou_points: u32,
    /// Seed of the points
    #[arg(long = "sampling-seed", default_value_t = 0)]
    seed: u64,
}

impl Default for Sampling {
    fn default() -> Sampling {
        Sampling { samples: 100_000, iou_points: 1_000_000, seed: 0 }
    }
}

/// What two surfaces differ by, in the units of Li 2021's tables.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Measures {
    /// Mean distance from the predicted surface to the true one, cm.
    pub p2s_cm: f64,
    /// P2S of the predicted surface's largest piece alone, cm.
    pub largest_piece_p2s_cm: f64,
    /// Mean distance from the true surface to the predicted one, cm.
    pub completeness_cm: f64,
    /// Chamfer-L2 in m² times 100 (erratum E15).
    pub chamfer_l2: f64,
    /// Mean |cos| between normals, 0 to 1.
    pub normal_consistency: f64,
    /// Intersection over union of the enclosed volumes, 0 to 1; `None` where neither encloses anything.
    pub iou: Option<f64>,
    /// Connected pieces of the predicted surface.
    pub pieces: usize,
}

impl Measures {
    /// The heads of [`Measures::cells`].
    pub const HEAD: [&str; 6] =
        ["P2S cm", "largest piece", "complete cm", "Chamfer 10⁻²m²", "normals", "IoU"];

    /// The numbers as a table prints them.
    pub fn cells(&self) -> Vec<String> {
        let mut cells: Vec<String> =
            [self.p2s_cm, self.largest_piece_p2s_cm, self.completeness_cm].map(|x| format!("{x:.4}")).into();
        cells.push(format!("{:.5}", self.chamfer_l2));
        cells.push(format!("{:.4}", self.normal_consistency));
        cells.push(self.iou.map_or("none".into(), |iou| format!("{iou:.4}")));
        cells
    }

    /// The mean of several; `None` of none. An IoU that one of them lacks is lacking.
    pub fn mean(all: &[Measures]) -> Option<Measures> {
        let mean = |of: fn(&Measures) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| Measures {
            p2s_cm: mean(|m| m.p2s_cm),
            largest_piece_p2s_cm: mean(|m| m.largest_piece_p2s_cm),
            completeness_cm: mean(|m| m.completeness_cm),
            chamfer_l2: mean(|m| m.chamfer_l2),
            normal_consistency: mean(|m| m.normal_consistency),
            iou: all.iter().map(|m| m.iou).sum::<Option<f64>>().map(|sum| sum / all.len() as f64),
            pieces: all.iter().map(|m| m.pieces).sum(),
        })
    }
}

/// Measures a predicted surface against the true one; `None` if one of them has no area.
pub fn measure(predicted: &Mesh, truth: &Mesh, sampling: &Sampling) -> Option<Measures> {
    let distance =
        |mesh: &Mesh| SurfaceDistance::between(mesh, truth, sampling.samples as usize, sampling.seed);
    let (largest, pieces) = largest_piece(predicted);
    let ((whole, largest), iou) = rayon::join(
        || rayon::join(|| distance(predicted), || if pieces > 1 { distance(&largest) } else { None }),
        || volume_iou(predicted, truth, sampling.iou_points as usize, sampling.seed),
    );
    let whole = whole?;
    Some(Measures {
        p2s_cm: 100.0 * whole.p2s,
        largest_piece_p2s_cm: 100.0 * largest.unwrap_or(whole).p2s,
        completeness_cm: 100.0 * whole.completeness,
        chamfer_l2: 100.0 * whole.chamfer_l2,
        normal_consistency: whole.normal_consistency,
        iou,
        pieces,
    })
}

/// Reads a mesh for the reference, with a word on standard error if it is not closed.
pub fn read(path: &Path) -> Result<Mesh> {
    let mesh = file::mesh::read(path)?;
    let mesh = convert::mesh_to_reference(&mesh);
    let topology = Topology::of(&mesh);
    if !topology.is_closed() {
        eprintln!(
            "warning: {}: the mesh is not closed ({} border edges): what is inside it is not defined everywhere",
            path.display(),
            topology.boundary_edges
        );
    }
    Ok(mesh)
}

/// The failure for surfaces of which one has no area.
pub fn without_area(predicted: &Path, truth: &Path) -> Failure {
    Failure::Usage(format!(
        "{} or {}: the mesh has no area, so there is nothing to measure: check the file",
        predicted.display(),
        truth.display()
    ))
}

/// Compares two mesh files.
pub fn evaluate(predicted: &Path, truth: &Path, sampling: &Sampling) -> Result<Findings> {
    let found =
        measure(&read(predicted)?, &read(truth)?, sampling).ok_or_else(|| without_area(predicted, truth))?;
    let mut text: Vec<String> = Measures::HEAD
        .iter()
        .zip(found.cells())
        .map(|(head, cell)| format!("{head:<16}{cell:>10}"))
        .collect();
    text.push(format!("{:<16}{:>10}", "pieces", found.pieces));
    text.push(sampling.words());
    let json = json!({ "files": sides(predicted, truth), "measures": found, "sampling": sampling.json() });
    Ok(Findings { iou: found.iou, p2s_cm: Some(found.p2s_cm), ..Findings::new(text.join("\n"), json) })
}

impl Sampling {
    /// One line for the foot of a table.
    pub fn words(&self) -> String {
        format!(
            "{} points per surface, {} points for the IoU, seed {}",
            self.samples, self.iou_points, self.seed
        )
    }

    /// The same for machines.
    pub fn json(&self) -> serde_json::Value {
        json!({ "samples": self.samples, "iou_points": self.iou_points, "seed": self.seed })
    }
}

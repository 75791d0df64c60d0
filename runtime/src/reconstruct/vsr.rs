//! Voxel super-resolution: features of a coarse body's voxels, and the occupancy of points from them.

use std::path::Path;

use ndarray::{Array2, Array3, Axis};

use super::mf_pifu::feature_names;
use super::{check_channels, load_graph, points_at_once};
use crate::contract::{Contract, Graph, Kind, Occupancy};
use crate::error::{Error, Result};
use crate::implicit_field::ImplicitField;
use crate::session::{Input, Settings, Value};
use crate::voxelize::{Cube, Voxels};

/// The two graphs of VSR.
#[derive(Debug)]
pub struct Vsr {
    encoder: Graph,
    query: Graph,
    resolution: usize,
    channels: Vec<usize>,
    align_corners: bool,
    occupancy: Occupancy,
}

impl Vsr {
    /// Loads `vsr_encoder.onnx` and `vsr_query.onnx` from a folder.
    ///
    /// # Errors
    /// As [`super::Reconstructor::load`].
    pub fn load(models: &Path, settings: &Settings) -> Result<Vsr> {
        let encoder = load_graph(models, "vsr_encoder.onnx", Kind::VsrEncoder, settings)?;
        let query = load_graph(models, "vsr_query.onnx", Kind::VsrQuery, settings)?;
        match (encoder.contract.clone(), query.contract.clone()) {
            (
                Contract::VsrEncoder { resolution, channels: given },
                Contract::VsrQuery { channels, align_corners, occupancy },
            ) => {
                check_channels(&encoder, &given, &query, &channels)?;
                Ok(Vsr { encoder, query, resolution, channels, align_corners, occupancy })
            }
            (encoder, query) => Err(Error::Unanswerable(format!(
                "{:?} and {:?} were loaded as VSR",
                encoder.kind(),
                query.kind()
            ))),
        }
    }

    /// D: the body is given as D³ voxels.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// The occupancy of the surface, 1 being inside.
    pub fn level(&self) -> f32 {
        self.occupancy.surface_level()
    }

    /// The features of a body's voxels, features_1..K \[1, C_k, D_k, D_k, D_k\].
    ///
    /// # Errors
    /// Whatever the graph gives, such as for another number of voxels than [`Vsr::resolution`].
    pub fn encode(&mut self, voxels: &Voxels) -> Result<Vec<Value>> {
        let names = feature_names(self.channels.len());
        let wanted: Vec<&str> = names.iter().map(String::as_str).collect();
        self.encoder.session.run(&[("voxels", (&voxels.to_tensor()).into())], &wanted)
    }

    /// The occupancy of world points, the voxels filling `cube`.
    pub fn field<'a>(&'a mut self, features: &'a [Value], voxels: &Voxels, cube: Cube) -> VsrField<'a> {
        let reach = (REACH_M / cube.side * voxels.values.dim().0 as f64).ceil() as usize;
        VsrField { network: self, features, cube, near: dilate(&voxels.values, reach) }
    }

    /// A cube coordinate −1..1 from face to face, as the graph counts: from voxel centre to voxel centre if it aligns corners.
    fn grid_coordinate(&self, face_to_face: f64) -> f64 {
        if self.align_corners {
            let voxel = 0.5 * (face_to_face + 1.0) * self.resolution as f64 - 0.5;
            2.0 * voxel / (self.resolution as f64 - 1.0) - 1.0
        } else {
            face_to_face
        }
    }
}

/// How far along an axis the refined body may lie from the coarse one: inside σ_max = 15 cm of the points that VSR learns
/// from (erratum E40), and small enough that a body at 256³ is asked for at less than 1/40 of the lattice
/// (docs/results.md).
const REACH_M: f64 = 0.10;

/// Voxels with a solid one at most `reach` away along every axis.
fn dilate(solid: &Array3<u8>, reach: usize) -> Array3<u8> {
    let mut near = solid.clone();
    for axis in 0..3 {
        for mut line in near.lanes_mut(Axis(axis)) {
            // before[i] of the line's first i voxels are solid.
            let mut before = vec![0; line.len() + 1];
            for (at, &value) in line.iter().enumerate() {
                before[at + 1] = before[at] + usize::from(value);
            }
            let length = line.len();
            for (at, value) in line.iter_mut().enumerate() {
                let (low, high) = (at.saturating_sub(reach), (at + reach + 1).min(length));
                *value = u8::from(before[high] > before[low]);
            }
        }
    }
    near
}

/// VSR's occupancy over world points, inside being larger.
///
/// A point more than 10 cm along an axis from every coarse voxel is outside the refined one, and the network is not asked.
#[derive(Debug)]
pub struct VsrField<'a> {
    network: &'a mut Vsr,
    features: &'a [Value],
    cube: Cube,
    /// 1 within reach of the coarse body.
    near: Array3<u8>,
}

impl ImplicitField for VsrField<'_> {
    fn values(&mut self, points: &[[f64; 3]]) -> Result<Vec<f32>> {
        let mut normalized = Array2::<f32>::zeros((points.len(), 3));
        for (mut row, &point) in normalized.rows_mut().into_iter().zip(points) {
            for (to, from) in row.iter_mut().zip(self.cube.normalize(point)) {
                *to = self.network.grid_coordinate(from) as f32;
            }
        }
        let names = feature_names(self.features.len());
        let mut inputs: Vec<(&str, Input)> =
            names.iter().map(String::as_str).zip(self.features.iter().map(Input::from)).collect();
        inputs.push(("points", (&normalized).into()));
        let outputs = self.network.query.session.run(&inputs, &["occupancy"])?;
        let occupancy = self.network.occupancy;
        Ok(outputs[0].f32()?.iter().map(|&raw| occupancy.value(raw)).collect())
    }

    fn coarse_cells(&self) -> usize {
        super::COARSE_CELLS
    }

    fn certainly_outside(&self, point: [f64; 3]) -> bool {
        let d = self.near.dim().0;
        let voxel = self.cube.normalize(point).map(|c| (0.5 * (c + 1.0) * d as f64).floor());
        let inside = voxel.iter().all(|&v| v >= 0.0 && v < d as f64);
        // Lattice points on the cube's upper faces lie in no voxel.
        !inside || self.near[voxel.map(|v| v as usize)] == 0
    }

    fn chunk(&self) -> usize {
        points_at_once(1, &self.network.channels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dilation_is_the_box_around_every_solid_voxel() {
        let mut solid = Array3::zeros((9, 9, 9));
        solid[[4, 1, 8]] = 1;
        let near = dilate(&solid, 2);
        for ((x, y, z), &value) in near.indexed_iter() {
            let inside = x.abs_diff(4) <= 2 && y.abs_diff(1) <= 2 && z.abs_diff(8) <= 2;
            assert_eq!(value, u8::from(inside), "({x}, {y}, {z})");
        }
    }
}

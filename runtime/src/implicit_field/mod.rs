//! From a field that must be asked point by point to its closed surface, asking as little as possible.
//!
//! The field lives on a lattice: a cube cut into R cells along each side, (R+1)³ points. Asking a network for
//! all of them is the whole cost of a reconstruction, and nearly all of them are far from the surface. Coarse to fine:
//!
//! 1. every s-th point is asked, s = R/C for R ≥ 2C, 2 for R > C, else 1: C is the field's number of coarse cells
//!    ([`ImplicitField::coarse_cells`]);
//! 2. wherever two neighbouring coarse points lie on different sides of the level, the fine points between them are
//!    asked: each fine edge that changes sides has four *seed* cells around it;
//! 3. from the seeds the surface is followed over fine cells, across every cell face whose corners do not all lie on
//!    one side, until nothing is left to follow. Only corners of surface cells are asked.
//!
//! # What is found?
//! Every component of the fine surface that crosses a coarse edge whose ends differ, whole and vertex for vertex as
//! [`Mode::Dense`] gives it, and whatever shares a cell with it; nothing that the coarse level sees is dropped. A component
//! that fits between coarse points is not found; [`Mode::Dense`] asks for everything.
//!
//! # References
//! The octree evaluation of PIFu (Saito et al. 2019) fills blocks whose corners agree to a threshold, and stops where
//! they do by chance; following the surface instead asks fewer points and leaves no holes.

mod following;
mod sampler;

use ndarray::Array3;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::marching_cubes::{extract, level_never_reached, marching_cubes};
use crate::mesh::Mesh;
use crate::voxelize::Cube;
use sampler::Asker;

/// The finest lattice that is followed: at 1024 cells a body has about three million surface points.
pub const MAX_RESOLUTION: usize = 1024;

/// The finest lattice that is evaluated wholly: 513³ values are 540 MB.
pub const MAX_DENSE_RESOLUTION: usize = 512;

/// A scalar field over world points, larger inside.
///
/// Any closure from points to values is one:
///
/// ```
/// use vitruvian_runtime::error::Result;
/// use vitruvian_runtime::implicit_field::{Lattice, Mode, surface};
/// use vitruvian_runtime::voxelize::Cube;
/// let mut ball = |points: &[[f64; 3]]| -> Result<Vec<f32>> {
///     Ok(points.iter().map(|p| 1.0 - p.iter().map(|x| (x * x) as f32).sum::<f32>()).collect())
/// };
/// let lattice = Lattice { cube: Cube { origin: [-1.5; 3], side: 3.0 }, resolution: 128 };
/// let (mesh, report) = surface(&mut ball, &lattice, 0.0, Mode::CoarseToFine, &mut |_, _| {})?;
/// assert!(mesh.faces.len() > 10_000 && report.asked < report.points / 5);
/// # Ok::<(), vitruvian_runtime::error::Error>(())
/// ```
pub trait ImplicitField {
    /// The values at world points (metres), one each. At most [`ImplicitField::chunk`] points are asked at a time.
    ///
    /// # Errors
    /// Whatever stops the evaluation.
    fn values(&mut self, points: &[[f64; 3]]) -> Result<Vec<f32>>;

    /// Whether a point is known to be outside without asking; it then counts as [`ImplicitField::outside_value`].
    fn certainly_outside(&self, _point: [f64; 3]) -> bool {
        false
    }

    /// The value of points that are certainly outside; it must not exceed the level.
    fn outside_value(&self) -> f32 {
        0.0
    }

    /// C, the cells of the coarse lattice along each side. In a cube of 2 m, 64 cells are 3 cm each, which limbs cannot
    /// pass between; a field that knows most points to be outside can afford 128, and sees specks of half that size.
    fn coarse_cells(&self) -> usize {
        64
    }

    /// The largest number of points asked at once, which bounds the memory of an evaluation.
    fn chunk(&self) -> usize {
        16_384
    }
}

impl<F: FnMut(&[[f64; 3]]) -> Result<Vec<f32>>> ImplicitField for F {
    fn values(&mut self, points: &[[f64; 3]]) -> Result<Vec<f32>> {
        self(points)
    }
}

/// The points at which a field is looked at: (i, j, k), 0 ≤ i, j, k ≤ R, at origin + (side/R)·(i, j, k).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// The cube, in world metres.
    pub cube: Cube,
    /// R, the cells along each side.
    pub resolution: usize,
}

impl Lattice {
    /// The world position of a lattice point or, for fractions, of a position between points.
    pub fn world(&self, index: [f64; 3]) -> [f64; 3] {
        let spacing = self.cube.side / self.resolution as f64;
        std::array::from_fn(|axis| self.cube.origin[axis] + spacing * index[axis])
    }

    fn point_count(&self) -> u64 {
        (self.resolution as u64 + 1).pow(3)
    }
}

/// How many points are asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Coarse points, then only those around the surface.
    #[default]
    CoarseToFine,
    /// All of them.
    Dense,
}

/// What an evaluation cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Report {
    /// R.
    pub resolution: usize,
    /// Cells of the coarse lattice along each side; R where everything was asked.
    pub coarse_resolution: usize,
    /// (R+1)³.
    pub points: u64,
    /// Points the field was asked for.
    pub asked: u64,
    /// Points known to be outside without asking, among those looked at.
    pub outside: u64,
    /// Surface cells.
    pub cells: usize,
}

/// The closed surface {field > level} on a lattice, in world metres, and what it cost.
///
/// `progress` is told the points asked so far and the points that will be asked as far as is known.
///
/// # Errors
/// [`Error::Unanswerable`] when the resolution is out of range, a value is not finite, the level is never reached
/// (with the smallest and largest value found) or the cube has no finite positive side; and whatever the field gives.
pub fn surface(
    field: &mut impl ImplicitField,
    lattice: &Lattice,
    level: f32,
    mode: Mode,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(Mesh, Report)> {
    check(field, lattice, level, mode)?;
    let step = match mode {
        Mode::Dense => 1,
        Mode::CoarseToFine => coarse_step(lattice.resolution, field.coarse_cells()),
    };
    let mut asker = Asker::new(field, lattice, progress);
    let (mut mesh, cells) = if step == 1 {
        let volume = asker.everything()?;
        check_both_sides(asker.range, level, Mode::Dense)?;
        let mesh = marching_cubes(volume.view(), level)?;
        (mesh, surface_cells(&volume, level))
    } else {
        let sampled = following::follow(&mut asker, step, level)?;
        (extract(&sampled.values, &sampled.cells, level)?, sampled.cells.len())
    };
    for vertex in &mut mesh.vertices {
        *vertex = lattice.world(vertex.map(f64::from)).map(|x| x as f32);
    }
    let report = Report {
        resolution: lattice.resolution,
        coarse_resolution: lattice.resolution.div_ceil(step),
        points: lattice.point_count(),
        asked: asker.asked,
        outside: asker.outside,
        cells,
    };
    Ok((mesh, report))
}

/// Every how many points the coarse lattice has one.
fn coarse_step(resolution: usize, coarse_cells: usize) -> usize {
    if resolution <= coarse_cells {
        1
    } else if resolution < 2 * coarse_cells {
        2
    } else {
        resolution / coarse_cells
    }
}

fn check(field: &impl ImplicitField, lattice: &Lattice, level: f32, mode: Mode) -> Result<()> {
    let (largest, hint) = match mode {
        Mode::CoarseToFine => (MAX_RESOLUTION, ""),
        Mode::Dense => (MAX_DENSE_RESOLUTION, " when every point is asked"),
    };
    if !(2..=largest).contains(&lattice.resolution) {
        return Err(Error::Unanswerable(format!(
            "resolution {} is out of range: choose 2 to {largest}{hint}",
            lattice.resolution
        )));
    }
    let Cube { origin, side } = lattice.cube;
    if !(side.is_finite() && side > 0.0 && origin.iter().all(|x| x.is_finite())) {
        return Err(Error::Unanswerable(format!(
            "the cube at {origin:?} of side {side} has no finite positive side"
        )));
    }
    if !level.is_finite() || field.outside_value() > level {
        return Err(Error::Unanswerable(format!(
            "level {level} cannot be: it must be finite and at least {}, the value outside",
            field.outside_value()
        )));
    }
    Ok(())
}

/// Refuses a field that lies on one side of the level at every point looked at.
fn check_both_sides((low, high): (f32, f32), level: f32, mode: Mode) -> Result<()> {
    if high > level && low <= level {
        return Ok(());
    }
    match (level_never_reached(level, low, high), mode) {
        (Error::Unanswerable(message), Mode::CoarseToFine) if high <= level => Err(Error::Unanswerable(
            format!("{message}, or evaluate densely to look between the coarse points"),
        )),
        (error, _) => Err(error),
    }
}

/// How many cells, the surrounding layer included, have corners on both sides.
fn surface_cells(volume: &Array3<f32>, level: f32) -> usize {
    crate::marching_cubes::active_cells(volume.view(), level).len()
}

#[cfg(test)]
mod tests;

//! What a graph's outputs mean, from its contract, and the second graph that an implicit function needs.

use std::path::{Path, PathBuf};

use vitruvian_reference::body::mannequin;
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::contract::{Contract, DepthCenter, DepthScale, Graph, Kind, Occupancy};
use vitruvian_runtime::file::body;
use vitruvian_runtime::session::{Optimization, Session, Settings};

use super::geometry::body::{BodyRuler, Source};
use super::geometry::field::{FieldRuler, Lattice};
use super::geometry::numbers::NumbersRuler;
use super::geometry::{Outputs, Ruler};
use super::people::{CUBE, MIDDLE_DEPTH_M};
use crate::array::Array;
use crate::convert;
use crate::error::Result;

/// What outputs mean.
#[derive(Clone, Debug)]
pub enum Meaning {
    /// Bodies.
    Body(Source),
    /// A field.
    Field(Lattice),
    /// Nothing that is known.
    Numbers,
}

impl Meaning {
    /// A ruler of this kind on the base's outputs.
    ///
    /// # Errors
    /// As the rulers' own.
    pub fn ruler(&self, base: &[Outputs]) -> std::result::Result<Box<dyn Ruler>, String> {
        Ok(match self {
            Meaning::Body(source) => Box::new(BodyRuler::new(source.clone(), base)?),
            Meaning::Field(lattice) => Box::new(FieldRuler::new(lattice.clone(), base)?),
            Meaning::Numbers => Box::new(NumbersRuler::new(base.to_vec())),
        })
    }
}

/// What a graph says of itself, and what the contract calls its tensors.
#[derive(Debug, Default)]
pub struct Declared {
    /// Its contract, if it keeps one.
    pub contract: Option<Contract>,
    /// Why it keeps none, where it says that it does.
    pub refusal: Option<String>,
    /// The contract's names of its inputs, in the file's order; its own where it keeps none.
    pub inputs: Vec<String>,
    /// The same of its outputs.
    pub outputs: Vec<String>,
}

impl Declared {
    /// Reads a graph's metadata and the side file beside it.
    ///
    /// # Errors
    /// When ONNX Runtime does not load it.
    pub fn read(path: &Path) -> Result<Self> {
        let settings = Settings { optimization: Optimization::Disabled, threads: 1 };
        let session = Session::load(path, &settings)?;
        let says = session.metadata().get("vitruvian.kind").cloned();
        let has_side_file = path.with_extension("toml").is_file();
        let names = |session: &Session| -> (Vec<String>, Vec<String>) {
            let of = |infos: &[vitruvian_runtime::session::TensorInfo]| {
                infos.iter().map(|i| i.name.clone()).collect()
            };
            (of(session.inputs()), of(session.outputs()))
        };
        let mut refusal = None;
        for kind in Kind::ALL {
            if says.as_deref().is_some_and(|name| name != kind.name()) || (says.is_none() && !has_side_file) {
                continue;
            }
            match Graph::load(path, kind, &settings) {
                Ok(Graph { session, contract }) => {
                    let (inputs, outputs) = names(&session);
                    return Ok(Self { contract: Some(contract), refusal: None, inputs, outputs });
                }
                Err(why) => refusal = Some(why.to_string()),
            }
        }
        let (inputs, outputs) = names(&session);
        Ok(Self { contract: None, refusal, inputs, outputs })
    }
}

/// The body that poses are drawn with: a file, or the mannequin.
///
/// # Errors
/// When the file cannot be read, or its body does not have 24 joints.
pub fn pose_source(contract: &Contract, file: Option<&PathBuf>) -> Result<Option<Source>> {
    let Contract::Regressor { image, pose, focal_length_px, .. } = contract else { return Ok(None) };
    let (body, name) = match file {
        Some(path) => (convert::body_to_reference(body::read(path)?), path.display().to_string()),
        None => (mannequin(), "the built-in mannequin".to_owned()),
    };
    if body.joint_count() != 24 {
        let message = format!("its body has {} joints, a regressor poses 24", body.joint_count());
        return Err(super::flow::fault(&name, message));
    }
    let side_px = image.size as f64;
    // The focal length of HMR's and SPIN's cameras.
    let focal_px = focal_length_px.unwrap_or(5000.0 * side_px / 224.0);
    Ok(Some(Source::Parameters { body: Box::new(body), name, form: *pose, focal_px, side_px }))
}

/// The lattice of cell centres that divides [`CUBE`] by `cells` along each side.
pub fn lattice(cells: usize, occupancy: Occupancy, words: &str) -> Lattice {
    let spacing = CUBE.side / cells as f64;
    Lattice {
        output: "occupancy".to_owned(),
        shape: [cells; 3],
        origin: CUBE.origin.map(|x| x + 0.5 * spacing),
        spacing,
        level: f64::from(occupancy.level),
        inside_is_larger: occupancy.inside_is_one,
        words: format!("{cells}³ cell centres of a cube of {} m{words}", CUBE.side),
    }
}

/// Where the points of a lattice are, metres.
pub fn points(lattice: &Lattice) -> Vec<[f64; 3]> {
    let [nx, ny, nz] = lattice.shape;
    let place = |p: usize| [p / (ny * nz), p / nz % ny, p % nz];
    let world = |index: [usize; 3]| {
        std::array::from_fn(|axis| lattice.origin[axis] + lattice.spacing * index[axis] as f64)
    };
    (0..nx * ny * nz).map(|p| world(place(p))).collect()
}

/// `[P, 3]` points as a VSR query takes them: −1 … 1, from voxel centre to voxel centre if it aligns corners.
pub fn vsr_points(points: &[[f64; 3]], align_corners: bool, resolution: usize) -> Array {
    let d = resolution as f64;
    let stretch = if align_corners { d / (d - 1.0) } else { 1.0 };
    let values = points.iter().flat_map(|&p| CUBE.normalize(p)).map(|x| (stretch * x) as f32).collect();
    Array::new(&[points.len(), 3], values)
}

/// `[N, P, 2]` places in the pictures and `[N, P]` depths, as an MF-PIFu query takes them, of points seen by cameras with pictures of
/// S × S pixels; and which points all pictures show the person at, by its masks.
pub fn pifu_points(
    points: &[[f64; 3]],
    views: &[Camera],
    masks: &[Vec<bool>],
    align_corners: bool,
    (center, scale): (DepthCenter, DepthScale),
) -> (Array, Array, Vec<bool>) {
    let (mut uv, mut depth) = (Vec::new(), Vec::new());
    let zero = match center {
        DepthCenter::BodyCenter => MIDDLE_DEPTH_M,
        DepthCenter::Metres(metres) => metres,
    };
    let one = match scale {
        DepthScale::CropHalfWidth => 0.5 * CUBE.side,
        DepthScale::Metres(metres) => metres,
    };
    let mut seen = vec![true; points.len()];
    for (camera, mask) in views.iter().zip(masks) {
        let size = f64::from(camera.width);
        let stretch = if align_corners { size / (size - 1.0) } else { 1.0 };
        for (point, seen) in points.iter().zip(&mut seen) {
            let (pixel, metres) = camera.project(*point).unwrap_or(([-size; 2], MIDDLE_DEPTH_M));
            uv.extend(pixel.map(|x| (stretch * (2.0 * x / size - 1.0)) as f32));
            depth.push(((metres - zero) / one) as f32);
            let inside = pixel.iter().all(|&x| x >= 0.0 && x < size);
            *seen &= inside && mask[pixel[1] as usize * camera.width as usize + pixel[0] as usize];
        }
    }
    let (n, p) = (views.len(), points.len());
    (Array::new(&[n, p, 2], uv), Array::new(&[n, p], depth), seen)
}

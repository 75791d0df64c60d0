//! What a graph must declare, checked when it is loaded.
//!
//! A graph says what it is in its ONNX `metadata_props`, key `vitruvian.kind`; kind by kind, the table below fixes
//! its tensors, and further keys its conventions. Keys that an export lacks can be given in a side file `GRAPH.toml`
//! (beside `GRAPH.onnx`, same keys without the prefix), so that foreign exports run too; a key in the graph wins. Tensors
//! that go by other names in the graph are named in the side file's table `[tensors]`, such as `pose = "pred_rotmat"`.
//!
//! | kind | inputs → outputs | keys |
//! |---|---|---|
//! | `mf-pifu.encoder` | images f32\[N,3,S,S\] → features_1..K f32\[N,C_k,H_k,W_k\] | image_size, mean, std, background |
//! | `mf-pifu.query` | features_1..K, uv f32\[N,P,2\], depth f32\[N,P\] → occupancy f32\[P\] | align_corners, inside, level, depth_center, depth_scale |
//! | `vsr.encoder` | voxels f32\[1,1,D,D,D\] → features_1..K f32\[1,C_k,D_k,D_k,D_k\] | resolution |
//! | `vsr.query` | features_1..K, points f32\[P,3\] (−1..1, x first) → occupancy f32\[P\] | align_corners, inside, level |
//! | `regressor` | image f32\[N,3,S,S\] → pose f32\[N,24,3,3\], \[N,144\] or \[N,72\], betas f32\[N,B\], camera f32\[N,3\] | image_size, mean, std; background and focal_length if need be |
//! | `body` | pose f32\[N,72\], betas f32\[N,B\] → vertices f32\[N,V,3\], joints f32\[N,24,3\] | |
//!
//! A regressor's pose may also be laid out as \[N,216\] or \[N,24,9\] (matrices by rows), \[N,24,6\] or \[N,24,3,2\] (two
//! columns), \[N,24,3\] (axis–angle).
//!
//! Sides named by a letter may be free in the graph; a number must be that number or free. Cameras never enter a graph.

mod declaration;
mod signature;

use std::path::Path;

use crate::error::{Error, Result};
use crate::image_input::Normalization;
use crate::session::{Session, Settings};
use declaration::Declaration;
use signature::Signature;

/// The kind of a graph, the value of `vitruvian.kind`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `mf-pifu.encoder`
    MfPifuEncoder,
    /// `mf-pifu.query`
    MfPifuQuery,
    /// `vsr.encoder`
    VsrEncoder,
    /// `vsr.query`
    VsrQuery,
    /// `regressor`
    Regressor,
    /// `body`
    Body,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Kind; 6] = [
        Kind::MfPifuEncoder,
        Kind::MfPifuQuery,
        Kind::VsrEncoder,
        Kind::VsrQuery,
        Kind::Regressor,
        Kind::Body,
    ];

    /// The value of `vitruvian.kind`.
    pub fn name(self) -> &'static str {
        match self {
            Kind::MfPifuEncoder => "mf-pifu.encoder",
            Kind::MfPifuQuery => "mf-pifu.query",
            Kind::VsrEncoder => "vsr.encoder",
            Kind::VsrQuery => "vsr.query",
            Kind::Regressor => "regressor",
            Kind::Body => "body",
        }
    }
}

/// How images enter a network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageInput {
    /// S: images are S × S pixels (`image_size`).
    pub size: usize,
    /// Colours (`mean`, `std`, `background`).
    pub normalization: Normalization,
}

/// How an occupancy is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occupancy {
    /// Whether 1 means inside (`inside` = 1) or outside (0, as Li 2021 eq. 5.1 and 6.1 write; erratum E17).
    pub inside_is_one: bool,
    /// The value at the surface (`level`), as the graph counts.
    pub level: f32,
}

impl Occupancy {
    /// A graph's value as 1-is-inside occupancy.
    pub fn value(&self, raw: f32) -> f32 {
        if self.inside_is_one { raw } else { 1.0 - raw }
    }

    /// The level in 1-is-inside occupancy.
    pub fn surface_level(&self) -> f32 {
        self.value(self.level)
    }
}

/// Where depth is 0 (`depth_center`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthCenter {
    /// At the estimated body centre's depth in each camera: `body_center`.
    BodyCenter,
    /// At this depth in metres.
    Metres(f64),
}

/// How much depth is 1 (`depth_scale`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthScale {
    /// Half the crop's width in metres at the depth centre: `crop_half_width`.
    CropHalfWidth,
    /// This many metres.
    Metres(f64),
}

/// How a pose is written by a regressor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseForm {
    /// Rotation matrices \[N,24,3,3\].
    Matrices,
    /// The first two columns of each, interleaved: a 3×2 array by rows, \[N,144\].
    SixD,
    /// Axis-angle \[N,72\].
    AxisAngle,
}

impl PoseForm {
    /// The numbers of one joint.
    pub fn width(self) -> usize {
        match self {
            PoseForm::Matrices => 9,
            PoseForm::SixD => 6,
            PoseForm::AxisAngle => 3,
        }
    }
}

/// What a graph declares, checked and typed, kind by kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Contract {
    /// Images to feature maps.
    MfPifuEncoder {
        /// How images enter.
        image: ImageInput,
        /// C_k of each feature map.
        channels: Vec<usize>,
    },
    /// Feature maps and projected points to occupancy.
    MfPifuQuery {
        /// C_k of each feature map.
        channels: Vec<usize>,
        /// Whether uv = ±1 are the centres of the outermost pixels (`true`) or their outer edges.
        align_corners: bool,
        /// How the occupancy is read.
        occupancy: Occupancy,
        /// Where depth is 0.
        depth_center: DepthCenter,
        /// How much depth is 1.
        depth_scale: DepthScale,
    },
    /// Voxels to feature volumes.
    VsrEncoder {
        /// D (`resolution`).
        resolution: usize,
        /// C_k of each feature volume.
        channels: Vec<usize>,
    },
    /// Feature volumes and points to occupancy.
    VsrQuery {
        /// C_k of each feature volume.
        channels: Vec<usize>,
        /// Whether ±1 are the centres of the outermost voxels (`true`) or their outer faces.
        align_corners: bool,
        /// How the occupancy is read.
        occupancy: Occupancy,
    },
    /// Images to body parameters.
    Regressor {
        /// How images enter.
        image: ImageInput,
        /// How the pose is written.
        pose: PoseForm,
        /// B, where the graph fixes it.
        betas: Option<usize>,
        /// The focal length in pixels that the weak-perspective camera assumes (`focal_length`), where given.
        focal_length_px: Option<f64>,
    },
    /// Body parameters to a posed body.
    Body {
        /// B, where the graph fixes it.
        betas: Option<usize>,
        /// V, where the graph fixes it.
        vertices: Option<usize>,
    },
}

impl Contract {
    /// The kind of graph it belongs to.
    pub fn kind(&self) -> Kind {
        match self {
            Contract::MfPifuEncoder { .. } => Kind::MfPifuEncoder,
            Contract::MfPifuQuery { .. } => Kind::MfPifuQuery,
            Contract::VsrEncoder { .. } => Kind::VsrEncoder,
            Contract::VsrQuery { .. } => Kind::VsrQuery,
            Contract::Regressor { .. } => Kind::Regressor,
            Contract::Body { .. } => Kind::Body,
        }
    }

    /// Checks a loaded graph, with the side file beside it if there is one. Tensors are looked for by the names that they
    /// have; [`Graph::load`] lets them go by the contract's first.
    ///
    /// # Errors
    /// [`Error::Graph`] naming the property or tensor that is missing, unreadable or different, with what was expected;
    /// [`Error::File`] when the side file is no table of strings, numbers, booleans and lists of numbers.
    pub fn of(session: &Session) -> Result<Contract> {
        let declaration = Declaration::read(session.path(), session.metadata())?;
        let kind = declaration.kind()?;
        let signature =
            Signature { path: session.path(), inputs: session.inputs(), outputs: session.outputs() };
        read(kind, &declaration, &signature)
    }
}

/// A graph that keeps its contract.
#[derive(Debug)]
pub struct Graph {
    /// The loaded graph.
    pub session: Session,
    /// What it declares.
    pub contract: Contract,
}

impl Graph {
    /// Loads a graph and checks that it is of the kind that is needed.
    ///
    /// # Errors
    /// As [`Session::load`] and [`Contract::of`]; [`Error::Graph`] when the kind is another.
    pub fn load(path: impl AsRef<Path>, kind: Kind, settings: &Settings) -> Result<Graph> {
        let mut session = Session::load(path, settings)?;
        let declaration = Declaration::read(session.path(), session.metadata())?;
        session.rename(&declaration.tensor_names())?;
        let found = declaration.kind()?;
        if found != kind {
            return Err(Error::Graph {
                path: session.path().to_path_buf(),
                item: declaration::item("kind"),
                message: format!(
                    "expected {:?}, found {:?}: this is another graph's place",
                    kind.name(),
                    found.name()
                ),
            });
        }
        let contract = Contract::of(&session)?;
        Ok(Graph { session, contract })
    }
}

fn read(kind: Kind, declared: &Declaration, tensors: &Signature) -> Result<Contract> {
    Ok(match kind {
        Kind::MfPifuEncoder => {
            let image = image_input(declared, declared.number("background")?)?;
            tensors.input("images", &[None, Some(3), Some(image.size), Some(image.size)])?;
            tensors.only_inputs(&["images"], 0)?;
            let channels = tensors.features(tensors.outputs, "output", 4)?;
            Contract::MfPifuEncoder { image, channels }
        }
        Kind::MfPifuQuery => {
            let channels = tensors.features(tensors.inputs, "input", 4)?;
            tensors.input("uv", &[None, None, Some(2)])?;
            tensors.input("depth", &[None, None])?;
            tensors.only_inputs(&["uv", "depth"], channels.len())?;
            tensors.output("occupancy", &[None])?;
            Contract::MfPifuQuery {
                channels,
                align_corners: declared.boolean("align_corners")?,
                occupancy: occupancy(declared)?,
                depth_center: match declared.word_or_metres("depth_center", "body_center")? {
                    None => DepthCenter::BodyCenter,
                    Some(metres) => DepthCenter::Metres(metres),
                },
                depth_scale: match declared.word_or_metres("depth_scale", "crop_half_width")? {
                    None => DepthScale::CropHalfWidth,
                    Some(metres) if metres != 0.0 => DepthScale::Metres(metres),
                    Some(_) => {
                        return Err(declared
                            .fault("depth_scale", "found 0, expected a length in metres that is not 0"));
                    }
                },
            }
        }
        Kind::VsrEncoder => {
            let resolution = declared.count("resolution", 1024)?;
            tensors
                .input("voxels", &[Some(1), Some(1), Some(resolution), Some(resolution), Some(resolution)])?;
            tensors.only_inputs(&["voxels"], 0)?;
            Contract::VsrEncoder { resolution, channels: tensors.features(tensors.outputs, "output", 5)? }
        }
        Kind::VsrQuery => {
            let channels = tensors.features(tensors.inputs, "input", 5)?;
            tensors.input("points", &[None, Some(3)])?;
            tensors.only_inputs(&["points"], channels.len())?;
            tensors.output("occupancy", &[None])?;
            Contract::VsrQuery {
                channels,
                align_corners: declared.boolean("align_corners")?,
                occupancy: occupancy(declared)?,
            }
        }
        Kind::Regressor => {
            // The person crop is black beyond the photograph before it is normalised, so that no graph need say more.
            let background = declared.optional_number("background")?.unwrap_or(0.0);
            let image = image_input(declared, background)?;
            tensors.input("image", &[None, Some(3), Some(image.size), Some(image.size)])?;
            tensors.only_inputs(&["image"], 0)?;
            let pose = tensors.one_of(
                "pose",
                &[
                    (PoseForm::Matrices, &[None, Some(24), Some(3), Some(3)]),
                    (PoseForm::SixD, &[None, Some(144)]),
                    (PoseForm::AxisAngle, &[None, Some(72)]),
                    (PoseForm::Matrices, &[None, Some(24), Some(9)]),
                    (PoseForm::Matrices, &[None, Some(216)]),
                    (PoseForm::SixD, &[None, Some(24), Some(3), Some(2)]),
                    (PoseForm::SixD, &[None, Some(24), Some(6)]),
                    (PoseForm::AxisAngle, &[None, Some(24), Some(3)]),
                ],
            )?;
            let betas = tensors.output("betas", &[None, None])?[1];
            tensors.output("camera", &[None, Some(3)])?;
            let focal_length_px = declared.optional_number("focal_length")?;
            if focal_length_px.is_some_and(|focal| focal <= 0.0) {
                return Err(
                    declared.fault("focal_length", "expected a positive number of pixels of the crop")
                );
            }
            Contract::Regressor { image, pose, betas, focal_length_px }
        }
        Kind::Body => {
            tensors.input("pose", &[None, Some(72)])?;
            let betas = tensors.input("betas", &[None, None])?[1];
            tensors.only_inputs(&["pose", "betas"], 0)?;
            let vertices = tensors.output("vertices", &[None, None, Some(3)])?[1];
            tensors.output("joints", &[None, Some(24), Some(3)])?;
            Contract::Body { betas, vertices }
        }
    })
}

fn image_input(declared: &Declaration, background: f64) -> Result<ImageInput> {
    let std = declared.three_numbers("std")?;
    if std.contains(&0.0) {
        return Err(declared.fault("std", "found a 0, expected three numbers to divide by"));
    }
    let normalization =
        Normalization { mean: declared.three_numbers("mean")?, std, background: background as f32 };
    Ok(ImageInput { size: declared.count("image_size", 8192)?, normalization })
}

fn occupancy(declared: &Declaration) -> Result<Occupancy> {
    let inside_is_one = match declared.number("inside")? {
        1.0 => true,
        0.0 => false,
        other => {
            return Err(declared
                .fault("inside", &format!("found {other}, expected 1 or 0: what the graph gives inside")));
        }
    };
    Ok(Occupancy { inside_is_one, level: declared.number("level")? as f32 })
}

#[cfg(test)]
mod tests;

//! `vitruvian pose`: a body model put into poses.

use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use rayon::prelude::*;
use vitruvian_conformance::convert;
use vitruvian_reference::body::BodyModel;
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::body::BodyArrays;
use vitruvian_runtime::file::mesh::Format;
use vitruvian_runtime::file::params::{self, Counts, Parameters};
use vitruvian_runtime::file::{self, npz};
use vitruvian_runtime::mesh::Mesh;
use vitruvian_runtime::skinning::{Frame, Posed, Skinner};

use crate::body;
use crate::failure::{Failure, Result, about};
use crate::mesh_format::MeshFormat;
use crate::progress;

/// Frames that are in memory at a time.
const BLOCK: usize = 64;

/// Put a body model into poses: parameters (.npz) to vertices and joints (.npz) or to meshes
///
/// The parameters are arrays under the names of AMASS, 3DPW and smplx: poses [F, 3J] (or [3J], [F, J, 3]; or global_orient and
/// body_pose), betas [B] or [F, B], trans [F, 3]; without betas or trans they are zero. Axis–angle in radians, metres.
///
/// An .npz holds vertices f64 [F, V, 3] and joints f64 [F, J, 3]. A mesh holds one frame; of several, each goes to a file of its
/// own: body.ply becomes body_0000.ply, body_0001.ply and so on.
#[derive(clap::Args)]
pub struct Arguments {
    /// Body model (.npz with SMPL's arrays); the built-in mannequin without it
    #[arg(long)]
    body: Option<PathBuf>,
    /// The parameters
    #[arg(long)]
    params: PathBuf,
    /// File for the result: .npz, or a mesh (.ply, .obj, .glb)
    #[arg(short, long)]
    out: PathBuf,
    /// Compute in f64 from end to end; without it the skin is blended in f32, within 20 µm
    #[arg(long)]
    exact: bool,
    /// Write meshes of this format, where the file's extension does not say it
    #[arg(long, value_enum)]
    format: Option<MeshFormat>,
}

/// Reads the body and its parameters, poses every frame and writes the result.
pub fn run(arguments: &Arguments) -> Result<()> {
    let out = &arguments.out;
    let is_npz = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
    let format = match arguments.format {
        None if is_npz => None,
        chosen => Some(MeshFormat::of(out, chosen).map_err(|_| {
            Error::file(
                out,
                "its extension is none of .npz, .ply, .obj and .glb: give the result one of them",
            )
        })?),
    };
    let arrays = body::load_arrays(arguments.body.as_deref())?;
    let counts =
        Counts { vertices: arrays.vertex_count(), joints: arrays.joint_count(), betas: arrays.beta_count() };
    let parameters = params::read(&arguments.params, &counts)?;
    let faces = arrays.faces.clone();
    let job = Job {
        model: Model::new(arrays, arguments.exact, arguments.body.as_deref())?,
        parameters,
        path: &arguments.params,
    };
    let frames = job.parameters.frame_count();
    let bar = progress::bar("pose", frames as u64);
    let written = match format {
        None => {
            write_arrays(&job, out, &counts, &bar)?;
            out.display().to_string()
        }
        Some(format) => write_meshes(&job, out, format, &faces, &bar)?,
    };
    bar.finish_and_clear();
    let Counts { vertices, joints, .. } = counts;
    let frames = if frames == 1 { "1 frame".into() } else { format!("{frames} frames") };
    eprintln!("{written}: {frames} of {vertices} vertices and {joints} joints");
    Ok(())
}

/// A body in the precision that was asked for.
enum Model {
    Exact(BodyModel),
    Fast(Skinner),
}

impl Model {
    fn new(arrays: BodyArrays, exact: bool, path: Option<&Path>) -> Result<Model> {
        if exact {
            return Ok(Model::Exact(convert::body_to_reference(arrays)));
        }
        Ok(Model::Fast(Skinner::new(&arrays).map_err(about(path.unwrap_or(Path::new("the mannequin"))))?))
    }
}

struct Job<'a> {
    model: Model,
    parameters: Parameters,
    /// Where the parameters came from.
    path: &'a Path,
}

impl Job<'_> {
    /// Poses the frames in blocks and hands every block over with the number of its first frame.
    fn blocks(&self, bar: &ProgressBar, mut take: impl FnMut(usize, &[Posed]) -> Result<()>) -> Result<()> {
        let frames = self.parameters.frame_count();
        for first in (0..frames).step_by(BLOCK) {
            let posed = self.pose(first..frames.min(first + BLOCK))?;
            take(first, &posed)?;
            bar.inc(posed.len() as u64);
        }
        Ok(())
    }

    fn pose(&self, frames: std::ops::Range<usize>) -> Result<Vec<Posed>> {
        let parameters = &self.parameters;
        let first = frames.start;
        let block: Vec<Frame<'_>> = frames
            .map(|f| Frame {
                pose: &parameters.poses[f],
                betas: parameters.betas_of(f),
                trans: parameters.trans[f],
                offsets: &parameters.offsets,
            })
            .collect();
        let posed = match &self.model {
            Model::Fast(skinner) => skinner.pose(&block).map_err(about(self.path))?,
            Model::Exact(body) => block
                .par_iter()
                .map(|frame| {
                    let posed = body.pose_with_offsets(frame.pose, frame.betas, frame.offsets, frame.trans);
                    Posed { vertices: posed.vertices, joints: posed.joints }
                })
                .collect(),
        };
        let is_finite = |posed: &Posed| {
            posed.vertices.as_flattened().iter().chain(posed.joints.as_flattened()).all(|x| x.is_finite())
        };
        if let Some(f) = posed.iter().position(|posed| !is_finite(posed)) {
            let message = format!("frame {} puts the body beyond the range of numbers", first + f);
            return Err(Error::file(self.path, message).into());
        }
        Ok(posed)
    }
}

/// Vertices go to the file as they are made; the joints, which are few, wait for their turn.
fn write_arrays(job: &Job<'_>, out: &Path, counts: &Counts, bar: &ProgressBar) -> Result<()> {
    let frames = job.parameters.frame_count();
    npz::write_stream(out, |stream| -> Result<()> {
        stream.begin("vertices", &[frames, counts.vertices, 3])?;
        let mut joints = Vec::with_capacity(frames * counts.joints);
        job.blocks(bar, |_, block| {
            for posed in block {
                stream.push(posed.vertices.as_flattened())?;
                joints.extend(&posed.joints);
            }
            Ok(())
        })?;
        stream.begin("joints", &[frames, counts.joints, 3])?;
        Ok(stream.push(joints.as_flattened())?)
    })
}

/// One mesh as `out`, or several beside where it would be; says which.
fn write_meshes(
    job: &Job<'_>,
    out: &Path,
    format: Format,
    faces: &[[u32; 3]],
    bar: &ProgressBar,
) -> Result<String> {
    let frames = job.parameters.frame_count();
    let place = |frame: usize| if frames == 1 { out.to_owned() } else { numbered(out, frame) };
    job.blocks(bar, |first, block| {
        for (i, posed) in block.iter().enumerate() {
            let vertices = posed.vertices.iter().map(|v| v.map(|x| x as f32)).collect();
            let mesh = Mesh { vertices, faces: faces.to_vec() };
            mesh.check().map_err(|message| {
                Failure::Usage(format!("{}: frame {}: {message}", job.path.display(), first + i))
            })?;
            file::mesh::write(&place(first + i), format, &mesh, None)?;
        }
        Ok(())
    })?;
    Ok(match frames {
        1 => out.display().to_string(),
        _ => format!("{} to {}", numbered(out, 0).display(), numbered(out, frames - 1).display()),
    })
}

/// `folder/body.ply` and 7 become `folder/body_0007.ply`.
fn numbered(path: &Path, frame: usize) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("_{frame:04}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

//! The choice of a mesh file's format on the command line.

use std::path::Path;

use vitruvian_runtime::file::mesh::Format;

use crate::failure::Result;

/// How a mesh is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum MeshFormat {
    /// Stanford PLY, binary
    #[default]
    Ply,
    /// Wavefront OBJ, text
    Obj,
    /// Binary glTF
    Glb,
}

impl MeshFormat {
    /// The runtime's name for it.
    pub fn format(self) -> Format {
        match self {
            MeshFormat::Ply => Format::Ply,
            MeshFormat::Obj => Format::Obj,
            MeshFormat::Glb => Format::Glb,
        }
    }

    /// What was `chosen`, or else what the extension of `path` says.
    pub fn of(path: &Path, chosen: Option<MeshFormat>) -> Result<Format> {
        Ok(chosen.map_or_else(|| Format::of(path), |format| Ok(format.format()))?)
    }
}

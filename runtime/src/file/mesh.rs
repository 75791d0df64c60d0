//! Mesh files by their extension: `.ply`, `.obj`, `.glb`.

use std::path::Path;

use super::{glb, obj, ply};
use crate::error::{Error, Result};
use crate::mesh::Mesh;

/// A mesh file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ: text, without colours.
    Obj,
    /// Stanford PLY: binary.
    Ply,
    /// Binary glTF: written only.
    Glb,
}

impl Format {
    /// Every format.
    pub const ALL: [Format; 3] = [Format::Obj, Format::Ply, Format::Glb];

    /// The file name extension.
    pub fn extension(self) -> &'static str {
        match self {
            Format::Obj => "obj",
            Format::Ply => "ply",
            Format::Glb => "glb",
        }
    }

    /// What the extension of `path` says, in either case.
    ///
    /// # Errors
    /// The extension is none of the three.
    pub fn of(path: &Path) -> Result<Format> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        Format::ALL.into_iter().find(|f| f.extension() == extension).ok_or_else(|| {
            Error::file(path, "its extension is none of .ply, .obj and .glb: give the mesh one of them")
        })
    }
}

/// Reads a mesh and checks it (finite vertices, faces that name vertices).
///
/// # Errors
/// As [`obj::read`] and [`ply::read`]; GLB is not read.
pub fn read(path: &Path) -> Result<Mesh> {
    let mesh = match Format::of(path)? {
        Format::Obj => obj::read(path)?,
        Format::Ply => ply::read(path)?.mesh,
        Format::Glb => return Err(Error::file(path, "GLB is written, not read: convert it to .ply or .obj")),
    };
    mesh.check().map_err(|message| Error::file(path, message))?;
    Ok(mesh)
}

/// Writes a mesh atomically, with one displayed colour per vertex if given and the format holds them.
///
/// # Errors
/// As the format's own `write`.
///
/// # Panics
/// If there are not as many colours as vertices.
pub fn write(path: &Path, format: Format, mesh: &Mesh, colors: Option<&[[u8; 3]]>) -> Result<()> {
    match format {
        Format::Obj => obj::write(path, mesh),
        Format::Ply => ply::write(path, mesh, colors),
        Format::Glb => glb::write(path, mesh, colors),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::cube;

    #[test]
    fn the_extension_chooses_the_format() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.obj", "a.PLY"] {
            let path = folder.path().join(name);
            write(&path, Format::of(&path).unwrap(), &cube(), None).unwrap();
            assert_eq!(read(&path).unwrap(), cube());
        }
        assert!(read(&folder.path().join("a.glb")).unwrap_err().to_string().contains("not read"));
        assert!(Format::of(Path::new("a.stl")).unwrap_err().to_string().contains(".ply, .obj and .glb"));
        assert_eq!(Format::of(Path::new("a.glb")).unwrap(), Format::Glb);
    }
}

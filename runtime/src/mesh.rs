//! Triangle meshes as the runtime carries them.

/// A triangle mesh: V vertices in metres (world frame unless said otherwise), F faces.
///
/// Faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// V positions.
    pub vertices: Vec<[f32; 3]>,
    /// F triangles of zero-based vertex indices, every one < V.
    pub faces: Vec<[u32; 3]>,
}

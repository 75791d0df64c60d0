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

impl Mesh {
    /// The axis-aligned box around all vertices as `(least, greatest)` corner, or `None` without vertices.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let first = *self.vertices.first()?;
        Some(self.vertices.iter().fold((first, first), |(mut low, mut high), v| {
            for a in 0..3 {
                low[a] = low[a].min(v[a]);
                high[a] = high[a].max(v[a]);
            }
            (low, high)
        }))
    }

    /// V unit normals: each the area-weighted mean of the normals of the faces around its vertex.
    ///
    /// n_v = Σ_f (b − a) × (c − a) over the faces f = (a, b, c) at v, then normalised; the cross product's
    /// length is twice the face's area, which is the weight. Zero where a vertex has no face or the sum vanishes.
    pub fn vertex_normals(&self) -> Vec<[f32; 3]> {
        let mut sums = vec![[0.0f64; 3]; self.vertices.len()];
        for face in &self.faces {
            let [a, b, c] = face.map(|i| self.vertices[i as usize].map(f64::from));
            let (e, f): ([f64; 3], [f64; 3]) =
                (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
            let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
            for &i in face {
                for k in 0..3 {
                    sums[i as usize][k] += n[k];
                }
            }
        }
        sums.iter()
            .map(|n| {
                let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
                if length > 0.0 { n.map(|x| (x / length) as f32) } else { [0.0; 3] }
            })
            .collect()
    }

    /// Says what is wrong with the mesh: a vertex that is not finite or a face that names no vertex.
    ///
    /// # Errors
    /// One sentence for the first fault found.
    pub fn check(&self) -> std::result::Result<(), String> {
        if let Some(i) = self.vertices.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            return Err(format!("vertex {i} is {:?}, expected three finite coordinates", self.vertices[i]));
        }
        let count = self.vertices.len();
        if let Some(i) = self.faces.iter().position(|f| f.iter().any(|&v| v as usize >= count)) {
            return Err(format!(
                "face {i} names the vertices {:?}, but there are only {count}",
                self.faces[i]
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A unit cube centred at the origin with outward faces.
    pub(crate) fn cube() -> Mesh {
        let vertices = (0..8)
            .map(|i| [(i & 1) as f32 - 0.5, ((i >> 1) & 1) as f32 - 0.5, ((i >> 2) & 1) as f32 - 0.5])
            .collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        Mesh { vertices, faces }
    }

    /// A latitude-longitude sphere with outward faces.
    pub(crate) fn sphere(radius: f32, centre: [f32; 3], rings: u32) -> Mesh {
        let sectors = 2 * rings;
        let mut vertices = vec![[centre[0], centre[1] + radius, centre[2]]];
        for i in 1..rings {
            let theta = std::f32::consts::PI * i as f32 / rings as f32;
            for j in 0..sectors {
                let phi = 2.0 * std::f32::consts::PI * j as f32 / sectors as f32;
                vertices.push([
                    centre[0] + radius * theta.sin() * phi.cos(),
                    centre[1] + radius * theta.cos(),
                    centre[2] - radius * theta.sin() * phi.sin(),
                ]);
            }
        }
        vertices.push([centre[0], centre[1] - radius, centre[2]]);
        let last = vertices.len() as u32 - 1;
        let at = |i: u32, j: u32| 1 + (i - 1) * sectors + j % sectors;
        let mut faces = Vec::new();
        for j in 0..sectors {
            faces.push([0, at(1, j), at(1, j + 1)]);
            for i in 1..rings - 1 {
                faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
            faces.push([at(rings - 1, j), last, at(rings - 1, j + 1)]);
        }
        Mesh { vertices, faces }
    }

    #[test]
    fn normals_of_a_sphere_point_away_from_its_centre() {
        let centre = [0.3, -0.2, 1.0];
        let mesh = sphere(2.0, centre, 24);
        for (v, n) in mesh.vertices.iter().zip(mesh.vertex_normals()) {
            let along: f32 = (0..3).map(|k| (v[k] - centre[k]) / 2.0 * n[k]).sum();
            assert!(along > 0.999, "normal {n:?} at {v:?}");
        }
    }

    #[test]
    fn bounds_of_a_cube_are_its_corners() {
        assert_eq!(cube().bounds(), Some(([-0.5; 3], [0.5; 3])));
        assert_eq!(Mesh::default().bounds(), None);
    }

    #[test]
    fn a_face_beyond_the_vertices_is_refused() {
        let mut mesh = cube();
        assert!(mesh.check().is_ok());
        mesh.faces[3][1] = 8;
        assert!(mesh.check().unwrap_err().contains("face 3"));
        mesh.vertices[2][0] = f32::NAN;
        assert!(mesh.check().unwrap_err().contains("vertex 2"));
    }
}

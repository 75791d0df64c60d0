//! Triangle meshes: area, volume and normals.

use super::bounding_box::BoundingBox;
use crate::linalg::matrix::{self, Matrix3};
use crate::linalg::vector::{Vector3, add, cross, dot, norm, scale, sub};

/// Vertices and triangles; a triangle names its three corners counter-clockwise as seen from outside.
///
/// `faces` hold indices into `vertices`. The methods panic, by indexing, on a face that names a vertex that is
/// not there; [`Mesh::new`] checks this once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Positions, V of them.
    pub vertices: Vec<Vector3>,
    /// Corners of each triangle, F of them.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// A mesh whose faces are known to name existing vertices.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that is not there.
    pub fn new(vertices: Vec<Vector3>, faces: Vec<[u32; 3]>) -> Mesh {
        for (number, face) in faces.iter().enumerate() {
            assert!(
                face.iter().all(|&vertex| (vertex as usize) < vertices.len()),
                "mesh: face {number} is {face:?}, but there are {} vertices",
                vertices.len()
            );
        }
        Mesh { vertices, faces }
    }

    /// The three corners of a face.
    pub fn corners(&self, face: usize) -> [Vector3; 3] {
        self.faces[face].map(|vertex| self.vertices[vertex as usize])
    }

    /// The corners of every face in turn.
    pub fn triangles(&self) -> impl Iterator<Item = [Vector3; 3]> + '_ {
        (0..self.faces.len()).map(|face| self.corners(face))
    }

    /// Smallest box around all vertices; none for a mesh without vertices.
    pub fn bounding_box(&self) -> Option<BoundingBox> {
        BoundingBox::around(self.vertices.iter().copied())
    }

    /// Per face ½ (b − a) × (c − a): its length is the area of the face, its direction points outward. `F`
    pub fn area_vectors(&self) -> Vec<Vector3> {
        self.triangles().map(|[a, b, c]| scale(cross(sub(b, a), sub(c, a)), 0.5)).collect()
    }

    /// Total area, in square units of the vertices.
    pub fn area(&self) -> f64 {
        self.area_vectors().into_iter().map(norm).sum()
    }

    /// Enclosed volume, positive if the faces are counter-clockwise seen from outside:
    ///
    /// V = ⅙ Σ (a − o)·((b − o) × (c − o)) over the faces abc.
    ///
    /// By the divergence theorem the apex o does not matter if the mesh is closed; it is put at the centre of
    /// the bounding box, so that a mesh far from the origin loses no digits. For an open mesh the number means
    /// nothing.
    pub fn signed_volume(&self) -> f64 {
        let Some(bounds) = self.bounding_box() else { return 0.0 };
        let apex = bounds.center();
        let six_volumes = self.triangles().map(|corners| {
            let [a, b, c] = corners.map(|corner| sub(corner, apex));
            dot(a, cross(b, c))
        });
        six_volumes.sum::<f64>() / 6.0
    }

    /// Unit outward normal of each face; zero for a face without area. `F`
    pub fn face_normals(&self) -> Vec<Vector3> {
        self.area_vectors().into_iter().map(unit_or_zero).collect()
    }

    /// Unit normal of each vertex: the direction of the sum of the area vectors of its faces, so that large
    /// faces count for more; zero for a vertex without faces. `V`
    pub fn vertex_normals(&self) -> Vec<Vector3> {
        let mut sums = vec![[0.0; 3]; self.vertices.len()];
        for (face, area_vector) in self.faces.iter().zip(self.area_vectors()) {
            for &vertex in face {
                sums[vertex as usize] = add(sums[vertex as usize], area_vector);
            }
        }
        sums.into_iter().map(unit_or_zero).collect()
    }

    /// The mesh with every vertex p moved to `linear`·p + `translation`.
    ///
    /// A map with negative determinant turns a mesh inside out; its faces are then reversed, so that outside
    /// stays outside.
    pub fn affine(&self, linear: &Matrix3, translation: Vector3) -> Mesh {
        let map = |p: Vector3| add(matrix::apply(linear, p), translation);
        let mirrors = matrix::determinant(linear) < 0.0;
        let turn = |[a, b, c]: [u32; 3]| if mirrors { [a, c, b] } else { [a, b, c] };
        Mesh {
            vertices: self.vertices.iter().copied().map(map).collect(),
            faces: self.faces.iter().copied().map(turn).collect(),
        }
    }

    /// The mesh in world coordinates, from one in the index units of a lattice: p ↦ origin + spacing·p.
    pub fn from_lattice(&self, origin: Vector3, spacing: f64) -> Mesh {
        self.affine(&matrix::diagonal([spacing; 3]), origin)
    }
}

fn unit_or_zero(v: Vector3) -> Vector3 {
    let length = norm(v);
    if length > 0.0 { scale(v, 1.0 / length) } else { [0.0; 3] }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The box [0, x] × [0, y] × [0, z], its corner c = x + 2y + 4z, two triangles a side.
    pub(crate) fn cuboid(size: Vector3) -> Mesh {
        let corner = |c: usize| [0, 1, 2].map(|axis| if c >> axis & 1 == 1 { size[axis] } else { 0.0 });
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Mesh::new((0..8).map(corner).collect(), faces)
    }

    #[test]
    fn a_box_has_its_volume_and_area() {
        let mesh = cuboid([1.0, 2.0, 3.0]);
        assert!((mesh.signed_volume() - 6.0).abs() < 1e-14);
        assert!((mesh.area() - 22.0).abs() < 1e-14);
        assert_eq!(mesh.bounding_box().unwrap().max, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn normals_of_a_box_point_outward() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        assert_eq!(mesh.face_normals()[0], [-1.0, 0.0, 0.0]);
        assert_eq!(mesh.face_normals()[11], [0.0, 0.0, 1.0]);
        let center = [0.5; 3];
        for (vertex, normal) in mesh.vertices.iter().zip(mesh.vertex_normals()) {
            assert!((norm(normal) - 1.0).abs() < 1e-15);
            assert!(dot(sub(*vertex, center), normal) > 0.5);
        }
    }

    #[test]
    fn volume_does_not_feel_a_distant_translation() {
        let far = cuboid([1.0, 2.0, 3.0]).affine(&matrix::IDENTITY, [4096.0, -1024.0, 2048.0]);
        assert!((far.signed_volume() - 6.0).abs() < 1e-14);
    }

    #[test]
    fn volume_scales_by_the_determinant_and_a_mirror_image_stays_outward() {
        let shear = [[2.0, 0.5, 0.0], [0.0, 1.5, 0.25], [0.0, 0.0, -1.0]];
        let mesh = cuboid([1.0, 2.0, 3.0]).affine(&shear, [1.0, 1.0, 1.0]);
        assert!((mesh.signed_volume() - 18.0).abs() < 1e-12);
    }

    #[test]
    fn a_face_without_area_has_no_normal() {
        let needle = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], vec![[0, 1, 2]]);
        assert_eq!(needle.face_normals(), [[0.0; 3]]);
        assert_eq!(needle.vertex_normals(), [[0.0; 3]; 3]);
        assert_eq!(Mesh::default().signed_volume(), 0.0);
    }

    #[test]
    #[should_panic(expected = "face 0 is [0, 1, 3], but there are 3 vertices")]
    fn a_face_of_a_missing_vertex_is_refused() {
        Mesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 3]]);
    }
}

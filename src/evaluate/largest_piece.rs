//! The largest connected piece of a mesh.

use vitruvian_reference::linalg::vector::norm;
use vitruvian_reference::surface::mesh::Mesh;

/// The piece with the most surface, and how many pieces there are.
///
/// Faces belong to one piece if a chain of faces that share vertices joins them, as
/// [`Topology::components`](vitruvian_reference::surface::topology::Topology) counts.
pub fn largest_piece(mesh: &Mesh) -> (Mesh, usize) {
    let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    for face in &mesh.faces {
        let root = root_of(&mut parent, face[0]);
        for &vertex in &face[1..] {
            let other = root_of(&mut parent, vertex);
            parent[other as usize] = root;
        }
    }
    let roots: Vec<u32> = mesh.faces.iter().map(|face| root_of(&mut parent, face[0])).collect();
    let mut area = vec![None; mesh.vertices.len()];
    for (vector, &root) in mesh.area_vectors().iter().zip(&roots) {
        *area[root as usize].get_or_insert(0.0) += norm(*vector);
    }
    let pieces = area.iter().flatten().count();
    let largest = (0..area.len()).filter(|&v| area[v].is_some()).max_by(|&a, &b| {
        let of = |v: usize| area[v].unwrap_or(0.0);
        of(a).total_cmp(&of(b))
    });
    let kept = mesh.faces.iter().zip(&roots).filter(|&(_, &root)| Some(root as usize) == largest);
    (Mesh::new(mesh.vertices.clone(), kept.map(|(face, _)| *face).collect()), pieces)
}

/// The vertex that stands for the piece of `vertex`; shortens the way there for the next question.
fn root_of(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        let above = parent[parent[vertex as usize] as usize];
        parent[vertex as usize] = above;
        vertex = above;
    }
    vertex
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::surface::topology::Topology;

    fn tetrahedron(side: f64) -> Mesh {
        let corners = vec![[0.0; 3], [side, 0.0, 0.0], [0.0, side, 0.0], [0.0, 0.0, side]];
        Mesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    }

    fn together(meshes: &[Mesh]) -> Mesh {
        let mut all = Mesh::new(Vec::new(), Vec::new());
        for mesh in meshes {
            let first = all.vertices.len() as u32;
            all.vertices.extend(&mesh.vertices);
            all.faces.extend(mesh.faces.iter().map(|face| face.map(|v| v + first)));
        }
        all
    }

    #[test]
    fn the_piece_with_the_most_surface_is_kept_whole() {
        let mesh = together(&[tetrahedron(1.0), tetrahedron(3.0), tetrahedron(2.0)]);
        let (largest, pieces) = largest_piece(&mesh);
        assert_eq!(pieces, Topology::of(&mesh).components);
        assert_eq!((pieces, largest.faces.len()), (3, 4));
        assert!((largest.signed_volume() - 27.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn a_mesh_of_one_piece_is_its_own_largest_piece() {
        assert_eq!(largest_piece(&tetrahedron(1.0)), (tetrahedron(1.0), 1));
    }

    #[test]
    fn a_mesh_without_faces_has_no_pieces() {
        assert_eq!(largest_piece(&Mesh::new(vec![[0.0; 3]], Vec::new())).1, 0);
    }
}

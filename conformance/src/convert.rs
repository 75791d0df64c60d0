//! Where the types of the runtime and of the reference meet, and the only place.
//!
//! f32 → f64 is exact (every f32 is an f64); f64 → f32 rounds to nearest and is used to hand data to the runtime, never
//! to compare. A conversion between two f64 types is exact.

use ndarray::{Array, ArrayD, ArrayView, Dimension, IxDyn};
use vitruvian_reference::nn::Tensor;
use vitruvian_reference::surface;
use vitruvian_runtime::{mesh, voxelize};

/// The runtime's mesh for the reference: exact.
///
/// # Panics
/// When a face names a vertex that is not there; [`mesh::Mesh::check`] finds such faces in data from outside.
pub fn mesh_to_reference(mesh: &mesh::Mesh) -> surface::mesh::Mesh {
    let vertices = mesh.vertices.iter().map(|vertex| vertex.map(f64::from)).collect();
    surface::mesh::Mesh::new(vertices, mesh.faces.clone())
}

/// The reference's mesh for the runtime: vertices rounded to f32.
pub fn mesh_to_runtime(mesh: &surface::mesh::Mesh) -> mesh::Mesh {
    mesh::Mesh {
        vertices: mesh.vertices.iter().map(|vertex| vertex.map(|x| x as f32)).collect(),
        faces: mesh.faces.clone(),
    }
}

/// The runtime's cube for the reference: exact.
pub fn cube_to_reference(cube: &voxelize::Cube) -> surface::cube::Cube {
    surface::cube::Cube { origin: cube.origin, side: cube.side }
}

/// An array for the reference: exact.
pub fn tensor<D: Dimension>(array: ArrayView<'_, f32, D>) -> Tensor {
    Tensor::new(array.shape(), array.iter().map(|&value| f64::from(value)).collect())
}

/// A tensor for the runtime: rounded to f32.
pub fn array(tensor: &Tensor) -> ArrayD<f32> {
    Array::from_shape_fn(IxDyn(&tensor.shape), |index| {
        let index: Vec<usize> = (0..tensor.shape.len()).map(|axis| index[axis]).collect();
        tensor.at(&index) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn a_mesh_of_the_runtime_comes_back_unchanged() {
        let there = mesh::Mesh {
            vertices: vec![[0.1, -2.0, 3e-7], [1.0, 0.0, 0.0], [0.0, 1.0 / 3.0, 0.0]],
            faces: vec![[0, 1, 2], [2, 1, 0]],
        };
        assert_eq!(mesh_to_runtime(&mesh_to_reference(&there)), there, "f32 to f64 to f32");
    }

    #[test]
    fn the_last_axis_is_the_fastest_on_both_sides_whatever_the_memory() {
        let volume = Array3::from_shape_fn((2, 3, 4), |(i, j, k)| (100 * i + 10 * j + k) as f32);
        let turned = tensor(volume.t());
        assert_eq!(turned.shape, [4, 3, 2], "a transposed view keeps its own axes");
        assert_eq!(turned.at(&[3, 1, 0]), 13.0, "and its own elements");
        assert_eq!(array(&tensor(volume.view())), volume.into_dyn(), "there and back");
    }
}

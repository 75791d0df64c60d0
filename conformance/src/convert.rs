//! Where the types of the runtime and of the reference meet, and the only place.
//!
//! f32 → f64 is exact (every f32 is an f64); f64 → f32 rounds to nearest and is used to hand data to the runtime, never
//! to compare. A conversion between two f64 types is exact.

use ndarray::{Array, ArrayD, ArrayView, Dimension, IxDyn};
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::nn::Tensor;
use vitruvian_reference::surface;
use vitruvian_runtime::capture::Camera;
use vitruvian_runtime::file::body::BodyArrays;
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

/// A body read from a file for the reference: the same numbers under the same names.
pub fn body_to_reference(body: BodyArrays) -> BodyModel {
    let BodyArrays { v_template, faces, shapedirs, posedirs, j_regressor, lbs_weights, parents } = body;
    BodyModel { v_template, faces, shapedirs, posedirs, j_regressor, lbs_weights, parents }
}

/// The reference's body for the runtime to write: the same numbers under the same names.
pub fn body_to_runtime(body: &BodyModel) -> BodyArrays {
    let BodyModel { v_template, faces, shapedirs, posedirs, j_regressor, lbs_weights, parents } =
        body.clone();
    BodyArrays { v_template, faces, shapedirs, posedirs, j_regressor, lbs_weights, parents }
}

/// A capture's camera for the reference: exact. `None` when its place is unknown or its pixels are skewed (K₀₁ ≠ 0),
/// which the reference does not describe.
pub fn camera_to_reference(camera: &Camera) -> Option<Pinhole> {
    let [[fx, skew, cx], [_, fy, cy], _] = camera.k;
    let extrinsics = camera.extrinsics.as_ref()?;
    (skew == 0.0).then_some(Pinhole {
        focal_px: [fx, fy],
        principal_px: [cx, cy],
        distortion: camera.distortion,
        rotation: extrinsics.r,
        translation: extrinsics.t,
    })
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
    use vitruvian_runtime::capture::look_at;

    #[test]
    fn a_mesh_of_the_runtime_comes_back_unchanged() {
        let there = mesh::Mesh {
            vertices: vec![[0.1, -2.0, 3e-7], [1.0, 0.0, 0.0], [0.0, 1.0 / 3.0, 0.0]],
            faces: vec![[0, 1, 2], [2, 1, 0]],
        };
        assert_eq!(mesh_to_runtime(&mesh_to_reference(&there)), there, "f32 to f64 to f32");
    }

    #[test]
    fn a_camera_projects_alike_on_both_sides() {
        let camera = Camera {
            name: "front".into(),
            width: 320,
            height: 240,
            k: [[400.0, 0.0, 161.5], [0.0, 390.0, 118.0], [0.0, 0.0, 1.0]],
            extrinsics: look_at([0.3, 1.2, 3.0], [0.0, 0.9, 0.0]),
            distortion: [-0.12, 0.05, 1e-3, -2e-3, 0.01],
        };
        let reference = camera_to_reference(&camera).expect("a camera without skew");
        for point in [[0.1, 0.8, 0.2], [-0.4, 1.6, -0.3], [0.0, 0.0, 0.0]] {
            let (runtime, _) = camera.project(point).expect("in front");
            let expected = reference.project(point).expect("in front");
            for (found, expected) in runtime.iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 1e-9 * 400.0,
                    "{point:?}: {found} px, expected {expected} px"
                );
            }
        }
        assert!(camera_to_reference(&Camera { extrinsics: None, ..camera }).is_none(), "nowhere");
    }

    #[test]
    fn a_body_comes_back_unchanged() {
        let body = vitruvian_reference::body::mannequin();
        let back = body_to_reference(body_to_runtime(&body));
        assert_eq!(back.v_template, body.v_template, "vertices");
        assert_eq!(back.lbs_weights, body.lbs_weights, "weights");
        assert_eq!(back.parents, body.parents, "parents");
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

//! Surfaces of the runtime against those of the reference.

use proptest::prelude::*;
use vitruvian_conformance::convert;
use vitruvian_conformance::suite::surface::{
    closed_mesh, judge_inside, judge_marching_cubes, judge_voxels, volume,
};
use vitruvian_reference::body::mannequin;

/// Deterministic: the same problems in every run.
fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(20_210_615),
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(600))]

    #[test]
    fn marching_cubes_gives_the_same_mesh_triangle_for_triangle(volume in volume()) {
        judge_marching_cubes(&volume).map_err(TestCaseError::fail)?;
    }
}

proptest! {
    #![proptest_config(config(60))]

    #[test]
    fn voxels_and_inside_agree_on_closed_meshes(mesh in closed_mesh(), seed in any::<u64>()) {
        judge_voxels(&mesh, 12).map_err(TestCaseError::fail)?;
        judge_inside(&mesh, seed, 300).map_err(TestCaseError::fail)?;
    }
}

#[test]
fn voxels_and_inside_agree_on_the_mannequin() {
    let body = mannequin();
    let betas = [0.5, -1.0, 0.3];
    let posed = body.pose(&vec![0.1; 3 * body.joint_count()], &betas, [0.0, 1.0, 0.0]);
    let mesh = convert::mesh_to_runtime(&vitruvian_reference::surface::mesh::Mesh {
        vertices: posed.vertices,
        faces: body.faces.clone(),
    });
    let voxels = judge_voxels(&mesh, 32).expect("the same cells");
    assert!(voxels.inside > 100, "a body fills part of its cube: {voxels:?}");
    let points = judge_inside(&mesh, 5, 2000).expect("the same points");
    assert!(points.inside > 20, "some points are inside: {points:?}");
}

//! Regressors as others export them, with rotations computed inside the graph: every node is understood and right.
//!
//! `foreign/*.onnx` are written by `foreign/generate.py`, which says what they are.

use std::path::Path;

use vitruvian_conformance::array::Array;
use vitruvian_conformance::engine::{self, OPTIMIZATIONS, Optimization};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::problem::values::Values;
use vitruvian_conformance::suite::networks::{judge_nodes, unjudged};
use vitruvian_reference::linalg::matrix::{IDENTITY, Matrix3, determinant, max_abs, mul, sub, transpose};
use vitruvian_reference::rotation::rodrigues;

const IMAGES: usize = 3;

fn read(name: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/foreign").join(name).with_extension("onnx");
    Model::read(&path)
        .unwrap_or_else(|error| panic!("{error}\nconformance/tests/foreign/generate.py writes it"))
}

fn images() -> Array {
    Values::ordinary(5).fill(&[IMAGES, 3, 32, 32])
}

fn pose(model: &Model, optimization: Optimization) -> Vec<f64> {
    let found = engine::run(model.name(), model.bytes(), optimization, &[("image", &images())]);
    found.expect("outputs").swap_remove(0).values.into_iter().map(f64::from).collect()
}

#[test]
fn every_node_of_a_foreign_regressor_is_within_rounding() {
    for name in ["matrix_torchscript", "matrix_dynamo", "axis_angle_torchscript", "axis_angle_dynamo"] {
        let model = read(name);
        let verdicts = judge_nodes(&model, &[("image", &images())]).unwrap_or_else(|error| panic!("{error}"));
        let share =
            verdicts.iter().filter_map(|v| v.comparison.report()).fold(0.0_f64, |a, r| a.max(r.share));
        println!(
            "{name}: opset {}, {} nodes judged, at most {share:.3} of their bounds",
            model.opset(),
            verdicts.len()
        );
        for verdict in &verdicts {
            let (operator, tensor) = (&verdict.operator, &verdict.tensor);
            assert!(
                verdict.comparison.within_bounds(),
                "{name}: {operator} → {tensor}: {}",
                verdict.comparison
            );
        }
        println!("{name}: judged here alone: {:?}", unjudged(&model));
    }
}

#[test]
fn both_exporters_and_both_forms_mean_the_same_rotations() {
    let matrices = pose(&read("matrix_torchscript"), Optimization::Disabled);
    let matrices: &[Matrix3] = matrices.as_chunks().0.as_chunks().0;
    assert_eq!(matrices.len(), 24 * IMAGES, "24 rotations an image");
    for r in matrices {
        assert!(max_abs(&sub(&mul(r, &transpose(r)), &IDENTITY)) < 1e-6 && determinant(r) > 0.0, "{r:?}");
    }
    for optimization in OPTIMIZATIONS {
        let others = pose(&read("matrix_dynamo"), optimization);
        for (k, (r, other)) in matrices.iter().zip(others.as_chunks().0.as_chunks().0).enumerate() {
            assert!(
                max_abs(&sub(r, other)) < 2e-5,
                "rotation {k} of the newer exporter: {other:?} for {r:?}"
            );
        }
        for name in ["axis_angle_torchscript", "axis_angle_dynamo"] {
            let vectors = pose(&read(name), optimization);
            for (k, (r, &v)) in matrices.iter().zip(vectors.as_chunks::<3>().0).enumerate() {
                // A quaternion's length is a root, which loses half of the digits near a half turn.
                assert!(max_abs(&sub(r, &rodrigues(v))) < 1e-4, "rotation {k} of {name}: {v:?} for {r:?}");
            }
        }
    }
}

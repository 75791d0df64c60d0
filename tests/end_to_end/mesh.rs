//! `mesh` and `voxelize`: from volumes to surfaces and back.

use std::path::Path;

use vitruvian_conformance::convert::mesh_to_reference;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_reference::surface::topology::Topology;
use vitruvian_runtime::file;
use vitruvian_runtime::file::npy::{self, Values};

use crate::command::{files, folder, sphere, vitruvian, word};

const SIDE: usize = 33;

/// radius − |x − (16, 16, 16)| on 33³ points.
fn ball(radius: f64) -> Vec<f64> {
    let middle = (SIDE as f64 - 1.0) / 2.0;
    (0..SIDE.pow(3))
        .map(|index| {
            let point = [index / (SIDE * SIDE), index / SIDE % SIDE, index % SIDE];
            radius - point.iter().map(|&i| (i as f64 - middle).powi(2)).sum::<f64>().sqrt()
        })
        .collect()
}

fn read(path: &Path) -> Mesh {
    mesh_to_reference(&file::mesh::read(path).expect("a mesh"))
}

#[test]
fn a_ball_becomes_a_closed_sphere_in_index_units_from_every_type_of_numbers() {
    let folder = folder();
    let volume = folder.path().join("ball.npy");
    let values = ball(10.0);
    let single: Vec<f32> = values.iter().map(|&x| x as f32).collect();
    let bytes: Vec<u8> = values.iter().map(|&x| u8::from(x > 0.0)).collect();
    let truths: Vec<bool> = values.iter().map(|&x| x > 0.0).collect();
    let volume_of_ball = 4.0 / 3.0 * std::f64::consts::PI * 1000.0;
    let cases = [
        (Values::F64(&values), "0"),
        (Values::F32(&single), "0"),
        (Values::U8(&bytes), "0.5"),
        (Values::Bool(&truths), "0.5"),
    ];
    for (values, level) in cases {
        npy::write(&volume, &[SIDE; 3], values).expect("a writable folder");
        let out = folder.path().join("ball.ply");
        vitruvian(&["mesh", word(&volume), "--level", level, "-o", word(&out)]).done();
        let mesh = read(&out);
        let topology = Topology::of(&mesh);
        assert!(topology.is_closed_surface() && topology.euler_characteristic() == 2, "{topology:?}");
        // Truth values know the sphere to half a cell only.
        let found = mesh.signed_volume();
        assert!((found / volume_of_ball - 1.0).abs() < 0.03, "{found} at level {level}");
        let centre = mesh.bounding_box().expect("vertices").center();
        assert!(centre.iter().all(|c| (c - 16.0).abs() < 1e-4), "{centre:?}");
    }
}

#[test]
fn origin_and_spacing_place_the_mesh_in_the_world() {
    let folder = folder();
    let (volume, out) = (folder.path().join("ball.npy"), folder.path().join("ball.obj"));
    npy::write(&volume, &[SIDE; 3], Values::F64(&ball(10.0))).expect("a writable folder");
    let place = ["--origin", "-0.8,0,1", "--spacing", "0.05"];
    vitruvian(&[&["mesh", word(&volume), "--level", "0", "-o", word(&out)], &place[..]].concat()).done();
    let bounds = read(&out).bounding_box().expect("vertices");
    for (axis, middle) in [0.0, 0.8, 1.8].into_iter().enumerate() {
        assert!((bounds.min[axis] - (middle - 0.5)).abs() < 1e-5, "{bounds:?}");
        assert!((bounds.max[axis] - (middle + 0.5)).abs() < 1e-5, "{bounds:?}");
    }
}

#[test]
fn glb_is_chosen_by_name_or_by_option() {
    let folder = folder();
    let volume = folder.path().join("ball.npy");
    npy::write(&volume, &[SIDE; 3], Values::F64(&ball(5.0))).expect("a writable folder");
    let (named, chosen) = (folder.path().join("a.glb"), folder.path().join("a.bin"));
    vitruvian(&["mesh", word(&volume), "--level", "0", "-o", word(&named)]).done();
    vitruvian(&["mesh", word(&volume), "--level", "0", "-o", word(&chosen), "--format", "glb"]).done();
    let bytes = std::fs::read(&named).expect("a file");
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!(bytes, std::fs::read(&chosen).expect("a file"));
    let refused = vitruvian(&["mesh", word(&volume), "-o", word(&folder.path().join("a.stl"))]);
    assert!(refused.status == 2 && refused.err.contains("a.stl"), "{refused:?}");
}

#[test]
fn a_volume_without_a_surface_is_refused_by_name_and_nothing_is_written() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let mut holed = ball(10.0);
    holed[5] = f64::NAN;
    npy::write(&path("ball.npy"), &[SIDE; 3], Values::F64(&ball(10.0))).expect("a writable folder");
    npy::write(&path("nan.npy"), &[SIDE; 3], Values::F64(&holed)).expect("a writable folder");
    npy::write(&path("flat.npy"), &[SIDE, SIDE * SIDE], Values::F64(&ball(10.0))).expect("a writable folder");
    npy::write(&path("empty.npy"), &[0, 3, 3], Values::F64(&[])).expect("a writable folder");
    std::fs::write(path("text.npy"), "not an array").expect("a writable folder");
    let before = files(folder.path());
    let cases = [
        ("ball.npy", "99", "level 99 is never reached"),
        ("ball.npy", "-99", "level -99 is never reached"),
        ("ball.npy", "nan", "the level is NaN"),
        ("nan.npy", "0", "NaN at [0, 0, 5]"),
        ("flat.npy", "0", "[33, 1089], expected [any, any, any]"),
        ("empty.npy", "0", "holds no values"),
        ("text.npy", "0", "is no .npy array"),
        ("none.npy", "0", "No such file"),
    ];
    for (volume, level, words) in cases {
        let run = vitruvian(&["mesh", word(&path(volume)), "--level", level, "-o", word(&path("out.ply"))]);
        assert_eq!(run.status, 2, "{run:?}");
        assert!(run.err.contains(volume) && run.err.contains(words), "{words} in {run:?}");
        assert_eq!(run.err.lines().count(), 1, "{run:?}");
        assert_eq!(files(folder.path()), before, "{volume}");
    }
}

#[test]
fn voxels_of_a_sphere_fill_its_volume_and_mesh_back_to_it() {
    let folder = folder();
    let (mesh, voxels, back) =
        (folder.path().join("s.obj"), folder.path().join("s.npy"), folder.path().join("back.ply"));
    sphere(&mesh, 0.9, [0.3, -2.0, 1.0], 48);
    let run =
        vitruvian(&["voxelize", word(&mesh), "--resolution", "64", "-o", word(&voxels), "--json"]).done();
    let cube = run.json();
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let side = number(&cube["side"]);
    assert!((side - 1.8 / 0.9).abs() < 1e-3, "{cube}");
    let found = number(&cube["inside"]) * (side / 64.0).powi(3);
    let expected = read(&mesh).signed_volume();
    assert!((found / expected - 1.0).abs() < 0.01, "{found} m³ for {expected}");
    assert!(run.err.contains("origin"), "{}", run.err);

    // Cell centres are half a voxel from the cube's border.
    let spacing = side / 64.0;
    let origin: Vec<String> =
        (0..3).map(|axis| (number(&cube["origin"][axis]) + 0.5 * spacing).to_string()).collect();
    let (origin, spacing) = (origin.join(","), spacing.to_string());
    let place = ["--origin", &origin, "--spacing", &spacing];
    vitruvian(&[&["mesh", word(&voxels), "-o", word(&back)], &place[..]].concat()).done();
    let judged = vitruvian(&["evaluate", word(&back), word(&mesh), "--json"]).done().json();
    // A surface half way between cell centres errs by less than half a voxel, here 1.6 cm.
    assert!(number(&judged["measures"]["p2s_cm"]) < 50.0 * side / 64.0, "{judged}");
    assert!(number(&judged["measures"]["iou"]) > 0.97, "{judged}");
}

#[test]
fn a_mesh_that_cannot_be_voxelised_is_refused_by_name() {
    let folder = folder();
    let (mesh, out) = (folder.path().join("s.ply"), folder.path().join("v.npy"));
    sphere(&mesh, 1.0, [0.0; 3], 8);
    let run = vitruvian(&["voxelize", word(&mesh), "--resolution", "5000", "-o", word(&out)]);
    assert!(run.status == 2 && run.err.contains("5000") && !out.exists(), "{run:?}");
    std::fs::write(&mesh, "ply\n").expect("a writable folder");
    let run = vitruvian(&["voxelize", word(&mesh), "-o", word(&out)]);
    assert!(run.status == 2 && run.err.contains("s.ply") && !out.exists(), "{run:?}");
}

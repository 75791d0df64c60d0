//! `synthesize`, `reconstruct` and `evaluate` one after the other, with the committed graphs.

use std::fs;
use std::path::Path;

use vitruvian_conformance::convert::mesh_to_reference;
use vitruvian_reference::surface::topology::Topology;
use vitruvian_runtime::file;
use vitruvian_runtime::mesh::Mesh;

use crate::command::{capture, files, folder, vitruvian, word};

fn read_json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).expect("a report")).expect("JSON")
}

#[test]
fn a_capture_becomes_a_closed_body_near_the_truth() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let out = folder.path().join("out");
    vitruvian(&["reconstruct", word(&capture), "-o", word(&out), "--resolution", "64"]).done();
    let names: Vec<_> =
        files(&out).iter().map(|f| f.file_name().expect("a name").to_string_lossy().into_owned()).collect();
    assert_eq!(names, ["coarse.ply", "preview.png", "refined.ply", "report.json"]);
    for name in ["coarse.ply", "refined.ply"] {
        let mesh = mesh_to_reference(&file::mesh::read(&out.join(name)).expect("a mesh"));
        let topology = Topology::of(&mesh);
        assert!(topology.is_closed() && topology.is_oriented() && mesh.signed_volume() > 0.0, "{topology:?}");
    }

    let report = read_json(&out.join("report.json"));
    let judged = vitruvian(&["evaluate", word(&out), word(&capture), "--json"]).done().json();
    for stage in ["coarse", "refined"] {
        assert_eq!(judged["mean"][stage], report["truth"][stage], "{stage}");
        assert_eq!(report["surfaces"][stage]["field"]["dense_points"], 65 * 65 * 65);
    }
    // A body half as large, displaced by a limb's width or mirrored would not reach these.
    let refined = &report["truth"]["refined"];
    assert!(refined["iou"].as_f64() > Some(0.55) && refined["p2s_cm"].as_f64() < Some(3.0), "{refined}");
    assert_eq!(report["graphs"][0]["sha256"].as_str().map(str::len), Some(64));
    assert!(report["onnx_runtime"]["version"].as_str().is_some_and(|v| v.starts_with("1.")));
    let missed = vitruvian(&["evaluate", word(&out), word(&capture), "--min-iou", "0.9999"]);
    assert!(missed.status == 1 && missed.out.contains("refined"), "{missed:?}");
}

#[test]
fn a_view_that_cuts_the_body_off_is_named() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    fs::remove_file(capture.join("mesh.obj")).expect("the truth, which is not needed");
    let mask = capture.join("masks/yaw_090.png");
    let mut pixels = image::open(&mask).expect("a mask").into_luma8();
    // The picture's feet go on to its lower border.
    let feet =
        (0..pixels.height()).rev().find(|&y| (0..pixels.width()).any(|x| pixels.get_pixel(x, y).0[0] > 0));
    let feet = feet.expect("a body");
    let column = (0..pixels.width()).find(|&x| pixels.get_pixel(x, feet).0[0] > 0).expect("a foot");
    (feet..pixels.height()).for_each(|y| pixels.put_pixel(column, y, image::Luma([255])));
    pixels.save(&mask).expect("a writable mask");
    let out = folder.path().join("out");
    let words = ["reconstruct", word(&capture), "-o", word(&out), "--resolution", "32", "--no-refine"];
    let run = vitruvian(&words).done();
    assert!(run.err.contains("warning") && run.err.contains("\"yaw_090\""), "{}", run.err);
    assert_eq!(run.err.matches("warning").count(), 1, "the other views are whole: {}", run.err);
}

#[test]
fn the_same_seed_gives_the_same_bytes_of_captures_meshes_and_pictures() {
    let folder = folder();
    let runs = ["first", "second"].map(|name| folder.path().join(name));
    for run in &runs {
        let capture = capture(&run.join("captures"));
        fs::remove_file(capture.join("mesh.obj")).expect("the truth, which takes time to measure by");
        let out = run.join("out");
        vitruvian(&["reconstruct", word(&capture), "-o", word(&out), "--resolution", "32"]).done();
    }
    let [first, second] = [files(&runs[0]), files(&runs[1])];
    assert_eq!(first.len(), second.len());
    assert!(first.len() > 15, "{first:?}");
    for (a, b) in first.iter().zip(&second) {
        assert_eq!(a.strip_prefix(&runs[0]), b.strip_prefix(&runs[1]));
        // The report tells how long it took.
        if !a.ends_with("report.json") {
            assert!(fs::read(a).expect("a file") == fs::read(b).expect("a file"), "{}", a.display());
        }
    }
}

/// The meshes of a stage without and with `--dense`, and how many points were asked for each.
fn sparse_and_dense(stage: &str, resolution: &str, more: &[&str]) -> [(Mesh, u64); 2] {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    fs::remove_file(capture.join("mesh.obj")).expect("the truth, which takes time to measure by");
    [&[][..], &["--dense"]].map(|dense| {
        let out = folder.path().join(format!("out{}", dense.len()));
        let words = ["reconstruct", word(&capture), "-o", word(&out), "--resolution", resolution];
        vitruvian(&[&words[..], more, dense].concat()).done();
        let mesh = file::mesh::read(&out.join(format!("{stage}.ply"))).expect("a mesh");
        let report = read_json(&out.join("report.json"));
        let asked = report["surfaces"][stage]["field"]["asked"].as_u64().expect("a number of points");
        (mesh, asked)
    })
}

#[test]
fn asking_for_every_point_gives_the_same_mesh_up_to_128_cells() {
    for (stage, resolution) in [("refined", "66"), ("coarse", "128")] {
        let more: &[&str] = if stage == "coarse" { &["--no-refine"] } else { &[] };
        let [(sparse, _), (dense, _)] = sparse_and_dense(stage, resolution, more);
        assert!(sparse == dense, "the {stage} meshes differ at {resolution}³");
    }
}

#[test]
fn asking_near_the_surface_alone_gives_the_same_vertices_but_for_specks_between_coarse_points() {
    // Above 128 cells only every second point is asked at first.
    let [(sparse, asked), (dense, asked_of_all)] = sparse_and_dense("coarse", "160", &["--no-refine"]);
    assert!(asked < asked_of_all, "{asked} of {asked_of_all} points");
    // Both lists run through the lattice in the same order. A network may round a point's last bit otherwise among
    // other points: 1 µm is ten times that.
    let same = |a: &[f32; 3], b: &[f32; 3]| (0..3).all(|axis| (a[axis] - b[axis]).abs() < 1e-6);
    let mut rest = dense.vertices.iter();
    let found = sparse.vertices.iter().all(|vertex| rest.any(|other| same(vertex, other)));
    assert!(found, "a vertex is not of the dense mesh");
    let missed = dense.vertices.len() - sparse.vertices.len();
    assert!(missed * 50 < dense.vertices.len(), "{missed} of {} vertices are missed", dense.vertices.len());
}

#[test]
fn a_folder_of_captures_becomes_a_folder_of_results_and_a_table() {
    let folder = folder();
    let [captures, out] = ["captures", "out"].map(|name| folder.path().join(name));
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "2", "--seed", "21"]).done();
    let quick = ["--resolution", "32", "--no-refine", "--format", "obj"];
    let words = ["reconstruct", word(&captures), "-o", word(&out)];
    vitruvian(&[&words[..], &quick].concat()).done();
    for name in ["0000", "0001"] {
        assert!(out.join(name).join("coarse.obj").is_file() && !out.join(name).join("refined.obj").exists());
    }
    let sampling = ["--samples", "5000", "--iou-points", "50000"];
    let run = vitruvian(&[&["evaluate", word(&out), word(&captures)], &sampling[..]].concat()).done();
    let heads: Vec<_> = run.out.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(&heads[..4], ["capture", "0000", "0001", "mean"], "{}", run.out);
}

#[test]
fn results_of_another_kind_of_run_do_not_linger() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    fs::remove_file(capture.join("mesh.obj")).expect("the truth, which is not needed");
    let out = folder.path().join("out");
    let words = ["reconstruct", word(&capture), "-o", word(&out), "--resolution", "32"];
    vitruvian(&words).done();
    fs::write(out.join("notes.txt"), "mine").expect("a writable folder");
    vitruvian(&[&words[..], &["--no-refine"]].concat()).done();
    assert!(!out.join("refined.ply").exists(), "it is not of this run");
    assert!(out.join("notes.txt").exists() && out.join("coarse.ply").exists());
    assert!(read_json(&out.join("report.json"))["truth"].is_null());
}

//! `synthesize`, `reconstruct` and `evaluate` one after the other, with the committed graphs.

use std::fs;
use std::path::Path;

use vitruvian_conformance::convert::mesh_to_reference;
use vitruvian_reference::surface::topology::Topology;
use vitruvian_runtime::file;

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

#[test]
fn asking_for_every_point_gives_the_same_mesh() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    fs::remove_file(capture.join("mesh.obj")).expect("the truth, which is not needed");
    // Above 64 cells only every second point is asked at first.
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let words = ["reconstruct", word(&capture), "-o", word(&out), "--resolution", "66"];
        vitruvian(&[&words[..], more].concat()).done();
        let meshes =
            ["coarse.ply", "refined.ply"].map(|name| file::mesh::read(&out.join(name)).expect("a mesh"));
        (meshes, read_json(&out.join("report.json")))
    };
    let (sparse, sparse_report) = run("sparse", &[]);
    let (dense, dense_report) = run("dense", &["--dense"]);
    for (at, stage) in ["coarse", "refined"].into_iter().enumerate() {
        assert!(sparse[at].faces == dense[at].faces, "{stage}: the triangles differ");
        // A network may round a point's last bit otherwise among other points: 1 µm is a hundred times that.
        let apart =
            |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|axis| (a[axis] - b[axis]).abs()).fold(0.0, f32::max);
        let farthest =
            sparse[at].vertices.iter().zip(&dense[at].vertices).map(|(a, b)| apart(a, b)).fold(0.0, f32::max);
        assert!(
            sparse[at].vertices.len() == dense[at].vertices.len() && farthest < 1e-6,
            "{stage}: {farthest} m"
        );
        let asked = |report: &serde_json::Value| report["surfaces"][stage]["field"]["asked"].as_u64();
        assert!(asked(&sparse_report) < asked(&dense_report), "{sparse_report}");
    }
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

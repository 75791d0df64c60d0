//! `evaluate` on joints: files made elsewhere, results of `fit` and `regress`, curves, bounds and refusals.

use std::path::{Path, PathBuf};

use serde_json::Value;
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_runtime::capture::{self, picture};
use vitruvian_runtime::file::npy::{self, Values};
use vitruvian_runtime::file::npz::{self, Named, Npz};

use crate::command::{folder, vitruvian, word};

/// Where the 17 of Human3.6M stand in SPIN's 24.
const IN_J24: [usize; 17] = [14, 3, 4, 5, 2, 1, 0, 16, 12, 17, 18, 9, 10, 11, 8, 7, 6];

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn assert_near(value: &Value, expected: f64) {
    assert!((number(value) - expected).abs() < 1e-9, "{value}, expected {expected}");
}

fn write(path: &Path, arrays: &[(&str, &[usize], &[f64])]) {
    let named = |&(name, shape, values)| Named { name, shape, values: Values::F64(values) };
    npz::write(path, &arrays.iter().map(named).collect::<Vec<_>>()).expect("a writable folder");
}

fn numbers(path: &Path, name: &str) -> Vec<f64> {
    Npz::open(path).and_then(|mut npz| npz.array(name)).expect("an array").values
}

/// Points of no regularity within a metre.
fn cloud(points: usize, seed: f64) -> Vec<Vector3> {
    let at = |i: usize, a: usize| (seed + 12.9898 * (3 * i + a) as f64).sin();
    (0..points).map(|i| std::array::from_fn(|a| at(i, a))).collect()
}

fn flat(points: &[Vector3]) -> Vec<f64> {
    points.as_flattened().to_vec()
}

#[test]
fn regressed_joints_meet_a_file_of_truth_by_their_names() {
    let folder = folder();
    let [predicted, truth] = ["result.npz", "h36m_valid.npz"].map(|name| folder.path().join(name));
    // Two frames of truth in SPIN's rows, with the confidence of what Human3.6M lacks at 0.
    let frames = [cloud(17, 1.0), cloud(17, 2.0)];
    let mut s = vec![0.0; 2 * 24 * 4];
    let mut found = Vec::new();
    for (f, frame) in frames.iter().enumerate() {
        for (k, joint) in frame.iter().enumerate() {
            let at = 4 * (24 * f + IN_J24[k]);
            s[at..at + 3].copy_from_slice(joint);
            s[at + 3] = 1.0;
            // The left wrist (13) is 51 mm off; everything is somewhere else.
            let wrong = if k == 13 { 0.051 } else { 0.0 };
            found.push([joint[0] + 3.0 + wrong, joint[1] - 1.0, joint[2] + 2.0]);
        }
    }
    write(&truth, &[("S", &[2, 24, 4], &s)]);
    let zeros = [0.0; 144];
    write(&predicted, &[("pred_joints", &[2, 17, 3], &flat(&found)), ("pose", &[2, 72], &zeros)]);
    let run = vitruvian(&["evaluate", word(&predicted), word(&truth), "--json"]).done();
    let json = run.json();
    assert_near(&json["measures"]["mpjpe_mm"], 51.0 / 17.0);
    assert_near(&json["measures"]["error_mm"], {
        let far = |x: f64| 1000.0 * (x * x + 5.0).sqrt();
        (16.0 * far(3.0) + far(3.051)) / 17.0
    });
    assert_eq!((&json["joint_set"], &json["root"]), (&"h36m17 and j24".into(), &"the pelvis".into()));
    assert_eq!(json["per_joint"][13]["name"], "left_wrist");
    assert_near(&json["per_joint"][13]["mpjpe_mm"], 51.0);
    // 33 of 34 errors are below 5 mm; the thirty-fourth is passed from 55 mm on.
    assert_near(&json["curve"]["pck"][10], 100.0 * 16.0 / 17.0);
    assert_near(&json["curve"]["pck"][11], 100.0);
    assert_eq!(number(&json["curve"]["threshold_mm"][11]), 55.0);

    let of =
        |more: &[&str]| vitruvian(&[&["evaluate", word(&predicted), word(&truth), "--json"], more].concat());
    let json = of(&["--joints", "lsp14"]).done().json();
    assert_eq!((number(&json["measures"]["joints"]), &json["joint_set"]), (14.0, &"lsp14".into()));
    assert_near(&json["measures"]["mpjpe_mm"], 51.0 / 14.0);
    let json = of(&["--root", "mid-hip"]).done().json();
    assert_eq!(json["root"], "the middle of the hips");
    let json = of(&["--root", "origin"]).done().json();
    assert_eq!(json["measures"]["mpjpe_mm"], json["measures"]["error_mm"]);
    // The wrong order puts joints in wrong places.
    let json = of(&["--predicted-joints", "mpi17"]).done().json();
    assert!(number(&json["measures"]["mpjpe_mm"]) > 300.0);
    let refused = of(&["--joints", "smpl24"]);
    assert!(
        refused.status == 2 && refused.err.contains("result.npz: holds the joints h36m17"),
        "{refused:?}"
    );
}

#[test]
fn fourteen_joints_are_relative_to_the_hips_and_meet_seventeen() {
    let folder = folder();
    let [lsp, h36m] = ["lsp.npy", "h36m.npz"].map(|name| folder.path().join(name));
    let seventeen = cloud(17, 3.0);
    let fourteen = [6, 5, 4, 1, 2, 3, 16, 15, 14, 11, 12, 13, 8, 10].map(|k: usize| seventeen[k]);
    npy::write(&lsp, &[14, 3], Values::F64(&flat(&fourteen))).expect("a writable folder");
    write(&h36m, &[("joints3d", &[1, 17, 3], &flat(&seventeen))]);
    let run = vitruvian(&["evaluate", word(&lsp), word(&h36m)]).done();
    assert!(
        run.out.contains("1 frames of 14 joints (lsp14 and h36m17), relative to the middle of the hips"),
        "{run:?}"
    );
    let json = vitruvian(&["evaluate", word(&lsp), word(&h36m), "--json"]).done().json();
    assert!(number(&json["measures"]["mpjpe_mm"]) < 1e-9, "{json}");
    // SMPL's skeleton shares its limbs.
    let smpl = folder.path().join("smpl.npz");
    write(&smpl, &[("joints", &[24, 3], &flat(&cloud(24, 4.0)))]);
    let json = vitruvian(&["evaluate", word(&smpl), word(&lsp), "--json"]).done().json();
    assert_eq!(number(&json["measures"]["joints"]), 10.0);
}

#[test]
fn amass_and_3dpw_parameters_are_posed_and_compared() {
    let folder = folder();
    let [amass, pw3d, joints] = ["amass.npz", "3dpw.npz", "joints.npz"].map(|name| folder.path().join(name));
    let pose: Vec<f64> = (0..156).map(|i| 0.2 * f64::from(i).cos()).collect();
    write(
        &amass,
        &[
            ("poses", &[1, 156], &pose),
            ("betas", &[16], &[&[0.5; 10][..], &[0.0; 6]].concat()),
            ("trans", &[1, 3], &[1.0, 2.0, 3.0]),
            ("mocap_framerate", &[], &[120.0]),
        ],
    );
    // SMPL's hands, which AMASS' fingers stand for, move no joint.
    let smpl: Vec<f64> = pose[..66].iter().chain(&[0.7; 6]).copied().collect();
    write(
        &pw3d,
        &[
            ("poses", &[1, 1, 72], &smpl),
            ("betas", &[1, 10], &[0.5; 10]),
            ("trans", &[1, 1, 3], &[1.0, 2.0, 3.0]),
        ],
    );
    let run = vitruvian(&["evaluate", word(&amass), word(&pw3d), "--json"]).done();
    assert!(run.err.contains("amass.npz: array \"poses\" has 52 joints"), "{run:?}");
    assert!(number(&run.json()["measures"]["error_mm"]) < 1e-9, "{run:?}");
    // What `pose` makes of the same parameters is the same body.
    vitruvian(&["pose", "--params", word(&pw3d), "-o", word(&joints), "--exact"]).done();
    let run = vitruvian(&["evaluate", word(&amass), word(&joints), "--json"]).done();
    assert!(number(&run.json()["measures"]["error_mm"]) < 1e-9, "{run:?}");
}

#[test]
fn several_predictions_share_a_table_a_curve_and_the_bounds() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let truth = cloud(24, 5.0);
    let off = |by: f64| -> Vec<Vector3> {
        truth.iter().enumerate().map(|(k, [x, y, z])| [x + if k == 0 { 0.0 } else { by }, *y, *z]).collect()
    };
    let files = [("truth", 0.0), ("near", 0.021), ("far", 0.200)].map(|(name, by)| {
        let path = path(&format!("{name}.npz"));
        write(&path, &[("joints", &[24, 3], &flat(&off(by)))]);
        path
    });
    let [truth, near, far] = &files;
    let run = |more: &[&str]| vitruvian(&[&["evaluate", word(near), word(far), word(truth)], more].concat());
    let [svg, png] = ["curve.svg", "curve.png"].map(path);
    let text = run(&["--label", "a near one", "--label", "a far one", "--curve", word(&svg)]).done().out;
    assert!(text.lines().any(|line| line.starts_with("a near one") && line.contains("20.1")), "{text}");
    let drawn = std::fs::read_to_string(&svg).expect("a chart");
    assert!(
        drawn.contains("a near one: PCK 100.0, AUC 84.4") && drawn.contains("a far one: PCK 4.2"),
        "{drawn}"
    );
    let json = run(&["--json", "--curve", word(&png)]).done().json();
    picture::read_rgb(&png, Some((1440, 880))).expect("a picture");
    assert_eq!(json["predicted"][1]["label"], "far");
    assert_near(&json["predicted"][0]["measures"]["mpjpe_mm"], 21.0 * 23.0 / 24.0);
    assert_near(&json["predicted"][0]["curve"]["pck"][4], 100.0 / 24.0);
    assert_near(&json["predicted"][0]["curve"]["pck"][5], 100.0);

    assert_eq!(run(&["--max-mpjpe-mm", "192"]).status, 0);
    let missed = run(&["--max-mpjpe-mm", "191"]);
    assert!(
        missed.status == 1 && missed.err.contains("MPJPE 191.67 mm is above the bound 191 mm"),
        "{missed:?}"
    );
    assert_eq!(run(&["--max-pa-mpjpe-mm", "1"]).status, 1);
    let table = run(&["--per-joint"]).done().out;
    assert!(table.contains("left_wrist") && table.contains("200.0"), "{table}");

    let refusals: [(&[&str], &str); 3] = [
        (&["--label", "one"], "--label: 1 names for 2 predictions"),
        (&["--curve", "curve.pdf"], "curve.pdf: a chart is written as .svg or .png"),
        (&["--min-iou", "0.5"], "--min-iou: no IoU"),
    ];
    for (words, message) in refusals {
        let refused = run(words);
        assert!(refused.status == 2 && refused.err.contains(message), "{refused:?}");
    }
}

/// The result that `regress` would write for a capture if it found every body but for a shift of each.
fn regression(capture: &Path, out: &Path, views: &[&str], wrong_m: f64) {
    let body = capture.join("body.npz");
    let cameras = capture::read_cameras(capture).expect("cameras");
    let truth: Vec<Vector3> = numbers(&body, "joints").chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    let mut joints = Vec::new();
    for (i, name) in views.iter().enumerate() {
        let stem = name.trim_end_matches(".png");
        let camera = cameras.iter().find(|camera| camera.name == stem).expect("a camera of this name");
        let seen = camera.extrinsics.expect("a calibrated capture");
        for (k, &joint) in truth.iter().enumerate() {
            let [x, y, z] = seen.to_camera(joint);
            let wrong = if k == 20 { wrong_m * (i + 1) as f64 } else { 0.0 };
            joints.push([x + 0.1, y + wrong, z - 0.4]);
        }
    }
    std::fs::create_dir_all(out).expect("a writable folder");
    write(&out.join("joints.npz"), &[("joints", &[views.len(), 24, 3], &flat(&joints))]);
    let names: Vec<String> = views.iter().map(|name| (*name).to_owned()).collect();
    let poses = vec![0.0; 72 * views.len()];
    let arrays = [
        Named { name: "poses", shape: &[views.len(), 72], values: Values::F64(&poses) },
        Named { name: "names", shape: &[views.len()], values: Values::Text(&names) },
    ];
    npz::write(&out.join("params.npz"), &arrays).expect("a writable folder");
}

fn captures(folder: &Path, count: &str) -> (PathBuf, [String; 2]) {
    let captures = folder.join("captures");
    vitruvian(&["synthesize", "-o", word(&captures), "--count", count, "--views", "2", "--size", "64"])
        .done();
    let cameras = capture::read_cameras(&captures.join("0000")).expect("cameras");
    let names = [0, 1].map(|i: usize| cameras[i].name.clone());
    (captures, names)
}

#[test]
fn regressions_are_compared_in_the_axes_of_each_camera() {
    let folder = folder();
    let (captures, [a, b]) = captures(folder.path(), "3");
    let out = folder.path().join("out");
    // Images may come with their extension, and in any order.
    let with_extension = format!("{b}.png");
    regression(&captures.join("0000"), &out.join("0000"), &[&a, &b], 0.012);
    regression(&captures.join("0001"), &out.join("0001"), &[&with_extension, &a], 0.120);
    let run = vitruvian(&["evaluate", word(&out), word(&captures)]).done();
    assert!(run.out.contains("1 captures without a result: 0002"), "{run:?}");
    regression(&captures.join("0002"), &out.join("0002"), &[&b], 0.024);

    let evaluate = |predicted: &Path, truth: &Path, more: &[&str]| {
        vitruvian(&[&["evaluate", word(predicted), word(truth)], more].concat())
    };
    let json = evaluate(&out, &captures, &["--json"]).done().json();
    let mean_of = |wrong: &[f64]| wrong.iter().sum::<f64>() / wrong.len() as f64 / 24.0;
    assert_near(&json["captures"]["0000"]["mpjpe_mm"], mean_of(&[12.0, 24.0]));
    assert_near(&json["captures"]["0001"]["mpjpe_mm"], mean_of(&[120.0, 240.0]));
    assert_near(&json["measures"]["mpjpe_mm"], (18.0 + 180.0 + 24.0) / 3.0 / 24.0);
    assert_near(&json["median"]["mpjpe_mm"], 24.0 / 24.0);
    assert_near(&json["measures"]["frames"], 5.0);
    assert_eq!(json["per_joint"][20]["name"], "left_wrist");
    assert!(json["without_result"].as_array().is_some_and(Vec::is_empty));
    // Eq. 2.7 sees the shift too; alignment takes it away.
    assert!(number(&json["measures"]["error_mm"]) > 400.0);
    assert!(number(&json["measures"]["pa_mpjpe_mm"]) < 20.0);
    let table = evaluate(&out, &captures, &[]).done().out;
    assert!(table.contains("median") && table.contains("5 frames of 24 joints (smpl24)"), "{table}");
    assert_eq!(evaluate(&out, &captures, &["--max-mpjpe-mm", "3"]).status, 1);

    let json = evaluate(&out.join("0000"), &captures.join("0000"), &["--json"]).done().json();
    assert_near(&json["views"][&a]["mpjpe_mm"], 0.5);
    assert_near(&json["views"][&b]["mpjpe_mm"], 1.0);

    regression(&captures.join("0000"), &out.join("0000"), &[&a, &b], 0.0);
    let names = vec!["behind".to_owned(), b];
    let poses = [0.0; 144];
    let arrays = [
        Named { name: "poses", shape: &[2, 72], values: Values::F64(&poses) },
        Named { name: "names", shape: &[2], values: Values::Text(&names) },
    ];
    npz::write(&out.join("0000/params.npz"), &arrays).expect("a writable folder");
    let refused = evaluate(&out.join("0000"), &captures.join("0000"), &[]);
    assert!(refused.status == 2 && refused.err.contains("is of the image behind, but"), "{refused:?}");
    std::fs::remove_file(captures.join("0001/body.npz")).expect("a file");
    let refused = evaluate(&out.join("0001"), &captures.join("0001"), &[]);
    assert!(
        refused.status == 2 && refused.err.contains("0001/body.npz: there is no such file"),
        "{refused:?}"
    );
}

#[test]
fn a_fit_is_as_good_from_every_camera_as_in_the_world() {
    let folder = folder();
    let (captures, _) = captures(folder.path(), "1");
    let (capture, out) = (captures.join("0000"), folder.path().join("fit"));
    vitruvian(&["fit", word(&capture), "-o", word(&out)]).done();
    let evaluate = |more: &[&str]| {
        vitruvian(&[&["evaluate", word(&out), word(&capture), "--json"], more].concat()).done().json()
    };
    let (world, views) = (evaluate(&[]), evaluate(&["--per-view"]));
    assert_eq!(views["views"].as_object().map(serde_json::Map::len), Some(2));
    for measure in ["error_mm", "mpjpe_mm", "pa_mpjpe_mm"] {
        // The cameras are known, so that the rigid motion into their axes is the same for both.
        let (a, b) = (number(&world["measures"][measure]), number(&views["measures"][measure]));
        assert!((a - b).abs() < 1e-6, "{measure}: {a} in the world, {b} from the cameras");
    }
}

#[test]
fn a_regressor_of_joints_makes_results_and_truth_comparable() {
    let folder = folder();
    let (captures, _) = captures(folder.path(), "1");
    let (capture, out) = (captures.join("0000"), folder.path().join("fit"));
    vitruvian(&["fit", word(&capture), "-o", word(&out)]).done();
    let vertices = vitruvian_reference::body::mannequin().vertex_count();
    let regressor = folder.path().join("J_regressor_h36m.npy");
    // Each "joint" is the mean of four vertices.
    let mut matrix = vec![0.0; 17 * vertices];
    for (k, row) in matrix.chunks_exact_mut(vertices).enumerate() {
        (0..4).for_each(|i| row[(97 * k + 331 * i) % vertices] = 0.25);
    }
    npy::write(&regressor, &[17, vertices], Values::F64(&matrix)).expect("a writable folder");
    let of = |path: &Path| {
        vitruvian(&["evaluate", word(&out), word(path), "--regressor", word(&regressor), "--json"])
            .done()
            .json()
    };
    let json = of(&capture);
    assert_eq!((&json["joint_set"], number(&json["measures"]["joints"])), (&"h36m17".into(), 17.0));
    assert!(number(&json["measures"]["mpjpe_mm"]) < 20.0, "{json}");
}

#[test]
fn joints_that_cannot_be_compared_are_refused_in_one_line() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let [truth, frames, few, nan, mm, objects, other] =
        ["truth.npz", "frames.npz", "few.npz", "nan.npz", "mm.npz", "objects.npy", "other.npz"].map(path);
    let joints = flat(&cloud(24, 6.0));
    write(&truth, &[("joints", &[24, 3], &joints)]);
    write(&frames, &[("joints", &[2, 24, 3], &[&joints[..], &joints].concat())]);
    write(&few, &[("joints", &[7, 3], &joints[..21])]);
    let with_nan: Vec<f64> =
        joints.iter().enumerate().map(|(i, &x)| if i == 30 { f64::NAN } else { x }).collect();
    write(&nan, &[("joints", &[24, 3], &with_nan)]);
    write(&mm, &[("joints", &[24, 3], &joints.iter().map(|x| 1000.0 * x).collect::<Vec<_>>())]);
    let mut bytes = npy::encode(&[1], Values::F64(&[0.0]));
    let at = bytes.windows(3).position(|found| found == b"<f8").expect("a description");
    bytes[at..at + 3].copy_from_slice(b"|O8");
    std::fs::write(&objects, bytes).expect("a writable folder");
    write(&other, &[("heat", &[3], &[1.0; 3])]);
    let cases = [
        (&frames, "frames.npz: holds 2 frames, but"),
        (&few, "few.npz: holds 7 joints, but"),
        (&nan, "nan.npz: array \"joints\" holds NaN (frame 0, joint 10)"),
        (&mm, "mm.npz: array \"joints\" holds joints that span"),
        (&objects, "objects.npy: holds pickled Python objects"),
        (&other, "other.npz: array \"poses\" is missing"),
    ];
    for (predicted, words) in cases {
        let run = vitruvian(&["evaluate", word(predicted), word(&truth)]);
        assert!(
            run.status == 2 && run.err.contains(words) && run.err.lines().count() == 1,
            "{words}: {run:?}"
        );
    }
}

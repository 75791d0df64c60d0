//! `fit` as a user runs it: a capture becomes a body, a folder of captures a sequence, bad input one line.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Npz};

use crate::command::{Outcome, capture, files, folder, vitruvian, word};

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("a report")).expect("JSON")
}

fn change_json(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value = read_json(path);
    change(&mut value);
    fs::write(path, value.to_string()).expect("a writable file");
}

fn fit(capture: &Path, out: &Path, more: &[&str]) -> Outcome {
    let mut words = vec!["fit", word(capture), "-o", word(out)];
    words.extend(more);
    vitruvian(&words)
}

/// The mean distance of the joints in `out` from the capture's, millimetres; after alignment where `aligned`.
fn joint_error_mm(out: &Path, capture: &Path, aligned: bool) -> f64 {
    let judged = vitruvian(&["evaluate", word(out), word(capture), "--json"]).done().json();
    judged["measures"][if aligned { "pa_mpjpe_mm" } else { "error_mm" }].as_f64().expect("a number")
}

fn names(folder: &Path) -> Vec<String> {
    let name = |f: &PathBuf| f.file_name().expect("a name").to_string_lossy().into_owned();
    files(folder).iter().map(name).collect()
}

#[test]
fn exact_keypoints_give_the_body_back() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let out = folder.path().join("out");
    fit(&capture, &out, &[]).done();
    let overlays = ["000", "090", "180", "270"].map(|yaw| format!("overlay_yaw_{yaw}.png"));
    let mut expected = vec!["body.ply", "joints.npz", "params.npz", "report.json"];
    expected.splice(2..2, overlays.iter().map(String::as_str));
    assert_eq!(names(&out), expected);
    assert!(joint_error_mm(&out, &capture, false) < 0.05, "known cameras");

    let report = read_json(&out.join("report.json"));
    assert_eq!((&report["success"], &report["extrinsics"]), (&json!(true), &json!("known")));
    let last = report["joints"]["stages"].as_array().and_then(|s| s.last()).expect("a stage");
    assert!(last["iterations"].as_u64() > Some(0) && last["ending"].is_string(), "{last}");
    for (name, view) in report["views"].as_object().expect("views") {
        assert_eq!(view["residual"]["keypoints"], 24, "{name}");
        // The person is dressed: the bare body covers most of the mask, not all.
        assert!(view["iou"].as_f64() > Some(0.75), "{name}: {view}");
    }
    let mut params = Npz::open(&out.join("params.npz")).expect("parameters");
    let shape = |params: &mut Npz, key: &str| params.array::<f64>(key).expect(key).shape;
    assert_eq!(shape(&mut params, "poses"), [1, 72]);
    assert_eq!(shape(&mut params, "trans"), [1, 3]);
    assert_eq!(shape(&mut params, "R"), [4, 3, 3]);

    let unknown = folder.path().join("unknown");
    fit(&capture, &unknown, &["--cameras", "unknown", "--format", "obj"]).done();
    assert!(unknown.join("body.obj").is_file() && !unknown.join("body.ply").exists());
    assert!(joint_error_mm(&unknown, &capture, true) < 0.1, "unknown cameras");
    let world = read_json(&unknown.join("report.json"));
    assert_eq!(world["extrinsics"], "unknown");
}

#[test]
fn one_view_and_the_thesis_presets_run() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    for more in [
        ["--method", "smplify", "--cameras", "unknown"],
        ["--preset", "ch2", "--start", "identity"],
        ["--preset", "ch3", "--cameras", "unknown"],
    ] {
        let out = folder.path().join(more[1]);
        let ended = fit(&capture, &out, &more);
        assert!(ended.status == 0 || ended.status == 1, "{more:?}: {ended:?}");
        let report = read_json(&out.join("report.json"));
        assert_eq!(report["joints"]["stages"].as_array().map(Vec::len), Some(4), "{more:?}");
        assert_eq!(ended.status == 0, report["success"] == json!(true), "{more:?}: {report}");
    }
    assert_eq!(
        read_json(&folder.path().join("smplify/report.json"))["views"].as_object().map(|v| v.len()),
        Some(1)
    );
}

#[test]
fn a_sequence_is_resumed_where_it_stopped() {
    let folder = folder();
    let captures = folder.path().join("captures");
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "3", "--seed", "4", "--size", "128"]).done();
    let out = folder.path().join("out");
    fit(&captures, &out, &["--independent"]).done();
    let whole = fs::read(out.join("params.npz")).expect("all frames");
    let mut params = Npz::open(&out.join("params.npz")).expect("parameters");
    assert_eq!(params.array::<f64>("poses").expect("poses").shape, [3, 72]);
    assert_eq!(read_json(&out.join("report.json"))["frames"].as_array().map(Vec::len), Some(3));

    fs::remove_dir_all(out.join("0002")).expect("an interrupted run");
    fs::remove_file(out.join("params.npz")).expect("an interrupted run");
    let first = fs::metadata(out.join("0000/params.npz")).expect("a frame").modified().expect("a time");
    let resumed = fit(&captures, &out, &["--independent", "--resume"]).done();
    assert!(resumed.err.contains("2 of 3 captures were done already"), "{}", resumed.err);
    assert_eq!(fs::read(out.join("params.npz")).expect("all frames"), whole, "same bytes as in one go");
    let again = fs::metadata(out.join("0000/params.npz")).expect("a frame").modified().expect("a time");
    assert_eq!(first, again, "a finished frame is left alone");

    // A frame in which nobody is found fails alone, and what an earlier run made of it is not joined.
    let keypoints = captures.join("0001/keypoints");
    fs::rename(&keypoints, folder.path().join("kept")).expect("keypoints");
    let partly = fit(&captures, &out, &["--independent"]);
    assert!(partly.status == 2 && partly.err.contains("has no keypoints in any view"), "{partly:?}");
    let mut params = Npz::open(&out.join("params.npz")).expect("parameters");
    assert_eq!(params.array::<f64>("poses").expect("poses").shape, [2, 72]);
    fs::rename(folder.path().join("kept"), &keypoints).expect("keypoints");
    fit(&captures, &out, &["--independent", "--resume"]).done();
    assert_eq!(fs::read(out.join("params.npz")).expect("all frames"), whole, "mended");
    fs::write(out.join("0001/params.npz"), "PK").expect("a damaged result");
    let damaged = fit(&captures, &out, &["--independent", "--resume"]);
    assert!(damaged.status == 2 && damaged.err.contains("to fit this frame again"), "{damaged:?}");
    fs::remove_dir_all(out.join("0001")).expect("what it said");

    let other = fit(&captures, &out, &["--preset", "ch3", "--independent", "--resume"]);
    assert!(other.status == 2 && other.err.contains("was fitted with other options"), "{other:?}");
}

#[test]
fn bad_captures_are_refused_in_one_line_and_nothing_is_written() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let keypoints = capture.join("keypoints/yaw_090.json");
    let points = |value: &mut Value, change: &dyn Fn(usize, &mut Value)| {
        let list = value["people"][0]["pose_keypoints_2d"].as_array_mut().expect("numbers");
        list.iter_mut().enumerate().for_each(|(i, x)| change(i, x));
    };
    let each_file = |change: &dyn Fn(&mut Value)| {
        for yaw in ["000", "090", "180", "270"] {
            change_json(&capture.join(format!("keypoints/yaw_{yaw}.json")), |value| change(value));
        }
    };
    let refused = |expected: &[&str], more: &[&str]| {
        let out = folder.path().join("out");
        let ended = fit(&capture, &out, more);
        assert_eq!(ended.status, 2, "{ended:?}");
        assert_eq!(ended.err.trim_end().lines().count(), 1, "{}", ended.err);
        for part in expected {
            assert!(ended.err.contains(part), "{part}: {}", ended.err);
        }
        assert!(!out.exists(), "nothing is written");
    };
    refused(&["--preset none", "ch2, ch3"], &["--preset", "none"]);
    refused(&["--refine-pose", "--method silhouette"], &["--refine-pose", "--method", "smplify"]);
    refused(&["no-such-body.npz"], &["--body", "no-such-body.npz"]);

    let saved = fs::read(&keypoints).expect("keypoints");
    change_json(&keypoints, |value| {
        points(value, &|i, x| *x = if i % 3 == 2 { json!(-1.0) } else { x.take() })
    });
    refused(&["yaw_090"], &[]);
    fs::write(&keypoints, &saved).expect("a writable file");

    each_file(&|value| points(value, &|i, x| *x = if i % 3 == 2 && i > 8 { json!(0.0) } else { x.take() }));
    refused(&["3 usable keypoints at different places", "at least 4"], &[]);
    each_file(&|value| points(value, &|i, x| *x = if i % 3 == 2 { json!(0.0) } else { x.take() }));
    refused(&["0 usable keypoints"], &[]);
    fs::remove_dir_all(capture.join("keypoints")).expect("a capture without keypoints");
    refused(&["has no keypoints in any view", "keypoints/NAME.json"], &[]);
    change_json(&capture.join("cameras.json"), |value| {
        let camera = value["cameras"][2].as_object_mut().expect("a camera");
        camera.remove("R");
        camera.remove("t");
    });
}

#[test]
fn views_of_different_people_end_with_status_1_and_the_names_of_the_views() {
    let folder = folder();
    let captures = folder.path().join("captures");
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "2", "--seed", "7"]).done();
    let (one, other) = (captures.join("0000"), captures.join("0001"));
    fs::copy(other.join("keypoints/yaw_180.json"), one.join("keypoints/yaw_180.json")).expect("a copy");
    let out = folder.path().join("out");
    let ended = fit(&one, &out, &[]);
    assert!(ended.status == 1 && ended.err.contains("\"yaw_180\""), "{ended:?}");
    let report = read_json(&out.join("report.json"));
    assert_eq!((&report["success"], &report["verdict"]), (&json!(false), &json!("views-disagree")));
    assert!(out.join("overlay_yaw_180.png").is_file(), "what there is to see is there");
}

#[test]
fn masks_mend_what_noisy_keypoints_leave() {
    let folder = folder();
    let captures = folder.path().join("captures");
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "1", "--seed", "11", "--size", "320"]).done();
    let capture = captures.join("0000");
    for (view, yaw) in ["000", "090", "180", "270"].iter().enumerate() {
        change_json(&capture.join(format!("keypoints/yaw_{yaw}.json")), |value| {
            let list = value["people"][0]["pose_keypoints_2d"].as_array_mut().expect("numbers");
            for (i, x) in list.iter_mut().enumerate().filter(|(i, _)| i % 3 < 2) {
                // Something like noise of 2.5 px that is the same on every machine.
                let wave = (12.9898 * (i + 100 * view) as f64).sin() * 43758.5453;
                *x = json!(x.as_f64().expect("a pixel") + 8.6 * (wave - wave.floor() - 0.5));
            }
        });
    }
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        fit(&capture, &out, more).done();
        let report = read_json(&out.join("report.json"));
        let iou = report["mean_iou"].as_f64().expect("masks are there");
        (iou, joint_error_mm(&out, &capture, false), report)
    };
    let (joints, joints_mm, _) = run("joints", &[]);
    let (fixed, fixed_mm, report) = run("fixed", &["--method", "silhouette"]);
    let (refined, refined_mm, _) = run("refined", &["--method", "silhouette", "--refine-pose"]);
    let (betas, ..) = run("betas", &["--method", "silhouette", "--shape", "betas", "--schedule", "real"]);
    // Measured 0.893, 0.959, 0.994 and 0.902.
    assert!(fixed > joints + 0.03 && betas > joints && betas < fixed, "{joints} {betas} {fixed}");
    assert!(refined > 0.965, "{refined}");
    assert!(
        fixed_mm < 1.5 * joints_mm && refined_mm < 0.75 * joints_mm,
        "{joints_mm} {fixed_mm} {refined_mm}"
    );
    let stages = report["silhouettes"]["stages"].as_array().expect("stages");
    assert_eq!(stages.len(), 3, "Table 3.1");
    let offsets =
        Npz::open(&folder.path().join("fixed/params.npz")).expect("parameters").array::<f64>("offsets");
    assert_eq!(offsets.expect("offsets").shape[1], 3);

    let mask = capture.join("masks/yaw_180.png");
    image::GrayImage::new(320, 320).save(&mask).expect("a writable mask");
    let out = folder.path().join("out");
    let ended = fit(&capture, &out, &["--method", "silhouette"]);
    assert!(
        ended.status == 2 && ended.err.contains("\"yaw_180\"") && ended.err.contains("empty"),
        "{ended:?}"
    );
    fs::copy(capture.join("masks/yaw_090.png"), &mask).expect("another view's mask");
    let ended = fit(&capture, &out, &["--method", "silhouette"]);
    assert!(ended.status == 2 || ended.status == 1, "{ended:?}");
    assert!(ended.err.contains("\"yaw_180\""), "{ended:?}");
}

/// Writes the keypoints of every view as those of a detector's set: `joints` are SMPL's for each keypoint of the set, `None`
/// for one that is not found.
fn detected_as(capture: &Path, joints: &[Option<usize>]) {
    for yaw in ["000", "090", "180", "270"] {
        change_json(&capture.join(format!("keypoints/yaw_{yaw}.json")), |value| {
            let all = value["people"][0]["pose_keypoints_2d"].clone();
            let numbers: Vec<Value> = joints
                .iter()
                .flat_map(|joint| (0..3).map(|i| joint.map_or(json!(0.0), |j| all[3 * j + i].clone())))
                .collect();
            *value = json!({ "people": [{ "pose_keypoints_2d": numbers }] });
        });
    }
}

#[test]
fn keypoints_of_detectors_move_the_limbs_that_they_see() {
    // BODY_25 up to the ankles without the nose, and COCO's 17 without the face: what a mesh other than SMPL's has.
    let body_25 = [12, 17, 19, 21, 16, 18, 20, 0, 2, 5, 8, 1, 4, 7].map(Some);
    let coco_17 = [16, 17, 18, 19, 20, 21, 1, 2, 4, 5, 7, 8].map(Some);
    let sets = [
        ("body25", [&[None][..], &body_25, &[None; 10]].concat()),
        ("coco17", [&[None; 5][..], &coco_17].concat()),
    ];
    for (name, joints) in sets {
        let folder = folder();
        let capture = capture(&folder.path().join("captures"));
        detected_as(&capture, &joints);
        let out = folder.path().join(name);
        fit(&capture, &out, &[]).done();
        let read = |path: &Path| {
            let values = Npz::open(path).expect("joints").array::<f64>("joints").expect("joints").values;
            values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect::<Vec<[f64; 3]>>()
        };
        let (found, truth) = (read(&out.join("joints.npz")), read(&capture.join("body.npz")));
        for joint in [4, 5, 7, 8, 16, 17, 18, 19, 20, 21] {
            let far = (0..3).map(|a| (found[joint][a] - truth[joint][a]).powi(2)).sum::<f64>().sqrt();
            assert!(far < 1e-3, "{name}: joint {joint} is {far} m off");
        }
        let report = read_json(&out.join("report.json"));
        assert!(report["joints"]["left_out"].to_string().contains("nose"), "{name}: {report}");
    }
}

#[test]
fn a_mixture_from_a_file_is_a_prior_and_a_wrong_one_is_refused() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let prior = folder.path().join("prior.npz");
    let (k, n) = (2, 69);
    let write = |n: usize, diagonal: f64| {
        let means: Vec<f64> = (0..k * n).map(|i| 0.01 * (i % 7) as f64).collect();
        let unit = |i: usize| if i / n % n == i % n { diagonal } else { 0.0 };
        let covariances: Vec<f64> = (0..k * n * n).map(unit).collect();
        let shapes = [&[k, n][..], &[k, n, n], &[k]];
        let named = |name, shape, values| npz::Named { name, shape, values };
        let arrays = [
            named("means", shapes[0], Values::F64(&means)),
            named("covariances", shapes[1], Values::F64(&covariances)),
            named("weights", shapes[2], Values::F64(&[0.25, 0.75])),
        ];
        npz::write(&prior, &arrays).expect("a writable folder");
    };
    write(n, 0.05);
    let out = folder.path().join("out");
    let more = ["--preset", "ch3", "--prior", word(&prior)];
    fit(&capture, &out, &more).done();
    // The prior costs something: the thesis' presets are biased by it.
    let error = joint_error_mm(&out, &capture, false);
    assert!((0.05..60.0).contains(&error), "{error}");

    let refused = |expected: &str, more: &[&str]| {
        let ended = fit(&capture, &folder.path().join("none"), more);
        assert!(ended.status == 2 && ended.err.contains(expected), "{expected}: {ended:?}");
    };
    refused("--prior is for the thesis' presets", &["--prior", word(&prior)]);
    write(n, -0.05);
    refused("prior.npz", &more);
    write(60, 0.05);
    refused("60 numbers", &more);
}

//! `fit --method mv-smplify` as a user or a training loop runs it: a batch of scenes in one file, and captures with a start.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};
use vitruvian::synthesis::{Stance, Subject};
use vitruvian_reference::body::{BodyModel, mannequin};
use vitruvian_reference::fitting::Extrinsics;
use vitruvian_reference::linalg::matrix::{apply, mul};
use vitruvian_reference::linalg::vector::{Vector3, add, sub};
use vitruvian_reference::metric::joints::pa_mpjpe;
use vitruvian_reference::rotation::{logarithm, rodrigues};
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named, Npz};

use crate::command::{Outcome, capture, folder, vitruvian, word};

/// Scenes and views of the batches here.
const S: usize = 3;
const N: usize = 4;

/// An array that a test may spoil before it is written.
struct Plain {
    name: &'static str,
    shape: Vec<usize>,
    values: Vec<f64>,
}

fn write(path: &Path, arrays: &[Plain]) {
    let named = |a: &'_ Plain| -> (&'static str, Vec<usize>, Vec<f64>) {
        (a.name, a.shape.clone(), a.values.clone())
    };
    let copies: Vec<_> = arrays.iter().map(named).collect();
    let named: Vec<Named> = copies
        .iter()
        .map(|(name, shape, values)| Named { name, shape, values: Values::F64(values) })
        .collect();
    npz::write(path, &named).expect("a writable folder");
}

/// Noise that is the same on every machine, in −1 … 1.
fn wave(k: usize) -> f64 {
    let wave = (12.9898 * k as f64).sin() * 43758.5453;
    2.0 * (wave - wave.floor() - 0.5)
}

/// What a regressor might say of a person seen by a camera that turns the world by `r` and moves it by `t`: the pose with
/// errors of about 0.1 rad, no shape, the depth 5 % off. Returns \[72\] and \[3\].
fn estimate(
    body: &BodyModel,
    (pose, betas, trans): (&[f64], &[f64], Vector3),
    (r, t): (&[[f64; 3]; 3], Vector3),
    seed: usize,
) -> (Vec<f64>, Vector3) {
    let pelvis = body.skeleton().rest_joints(betas)[0];
    let root = logarithm(&mul(r, &rodrigues([pose[0], pose[1], pose[2]])));
    let place = sub(add(apply(r, add(pelvis, trans)), t), pelvis);
    let mut seen: Vec<f64> = root.into_iter().chain(pose[3..].iter().copied()).collect();
    seen.iter_mut().enumerate().for_each(|(k, x)| *x += 0.2 * wave(k + 100 * seed));
    (seen, [place[0], place[1], 1.05 * place[2]])
}

/// S people, each seen by N cameras with 1 px of noise, and a regressor's estimates; with the true joints of each.
fn batch() -> (Vec<Plain>, Vec<Vec<Vector3>>) {
    let body = mannequin();
    let skeleton = body.skeleton();
    let b = body.beta_count();
    let mut arrays = [
        ("poses", vec![S, N, 72]),
        ("betas", vec![S, N, b]),
        ("trans", vec![S, N, 3]),
        ("keypoints", vec![S, N, 24, 3]),
        ("K", vec![S, N, 3, 3]),
        ("J_template", vec![S, 24, 3]),
        ("J_shapedirs", vec![S, 24, 3, b]),
    ]
    .map(|(name, shape)| Plain { name, shape, values: Vec::new() });
    let mut truth = Vec::new();
    for scene in 0..S {
        let person = Subject::random(&body, Stance::Any, N, 5, scene as u64);
        let seen = person.observation(1.0, Extrinsics::Unknown);
        for (view, camera) in person.cameras.iter().enumerate() {
            let known = (&person.pose[..], &person.betas[..], person.trans);
            let (pose, trans) =
                estimate(&body, known, (&camera.rotation, camera.translation), N * scene + view);
            arrays[0].values.extend(pose);
            arrays[1].values.extend(vec![0.0; b]);
            arrays[2].values.extend(trans);
            for keypoint in &seen.views[view].keypoints {
                arrays[3].values.extend([keypoint.pixel_px[0], keypoint.pixel_px[1], keypoint.confidence]);
            }
            let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.principal_px);
            arrays[4].values.extend([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        }
        arrays[5].values.extend(skeleton.template.iter().flatten());
        arrays[6].values.extend(&skeleton.shapedirs);
        truth.push(person.posed.joints.clone());
    }
    (arrays.into(), truth)
}

fn fit(path: &Path, out: &Path, more: &[&str]) -> Outcome {
    let mut words = vec!["fit", word(path), "--method", "mv-smplify", "-o", word(out)];
    words.extend(more);
    vitruvian(&words)
}

fn read(path: &Path, name: &str, shape: &[usize]) -> Vec<f64> {
    let expected: Vec<_> = shape.iter().map(|&n| Some(n)).collect();
    Npz::open(path).and_then(|mut npz| npz.shaped::<f64>(name, &expected)).expect(name).values
}

/// PA-MPJPE, millimetres, of the joints of every scene's first view.
fn errors_mm(poses: &[f64], betas: &[f64], truth: &[Vec<Vector3>]) -> Vec<f64> {
    let skeleton = mannequin().skeleton();
    let b = skeleton.beta_count();
    let joints = |s: usize| skeleton.posed_joints(&poses[s * N * 72..][..72], &betas[s * b..][..b]);
    truth.iter().enumerate().map(|(s, truth)| 1000.0 * pa_mpjpe(&joints(s), truth)).collect()
}

#[test]
fn a_batch_comes_nearer_to_the_truth_on_any_number_of_threads() {
    let folder = folder();
    let [path, one, two] = ["batch.npz", "one.npz", "two.npz"].map(|name| folder.path().join(name));
    let (arrays, truth) = batch();
    write(&path, &arrays);
    for (threads, out) in [("1", &one), ("2", &two)] {
        let ended = Command::new(env!("CARGO_BIN_EXE_vitruvian"))
            .args(["fit", word(&path), "--method", "mv-smplify", "-o", word(out)])
            .env("RAYON_NUM_THREADS", threads)
            // No graph is asked: neither the library nor the models' folder is looked for.
            .env("ORT_DYLIB_PATH", "/nowhere")
            .current_dir(folder.path())
            .output()
            .expect("the built command starts");
        assert!(ended.status.success() && ended.stdout.is_empty() && ended.stderr.is_empty(), "{ended:?}");
    }
    assert_eq!(fs::read(&one).expect("fits"), fs::read(&two).expect("fits"), "same bytes");

    let b = mannequin().beta_count();
    let poses = read(&one, "poses", &[S, N, 72]);
    let betas = read(&one, "betas", &[S, b]);
    let before = errors_mm(&arrays[0].values, &vec![0.0; S * b], &truth);
    let after = errors_mm(&poses, &betas, &truth);
    for (before, after) in before.iter().zip(&after) {
        assert!(*after < 25.0 && after < &(0.6 * before), "{after} mm from {before} mm");
    }
    assert_eq!(read(&one, "valid", &[S]), [1.0; S]);
    let losses = read(&one, "loss", &[S, 24]);
    assert!(losses.iter().all(|loss| (0.0..400.0).contains(loss)), "{losses:?}");
    for scene in poses.chunks_exact(N * 72) {
        let bodies: Vec<&[f64]> = scene.chunks_exact(72).map(|pose| &pose[3..]).collect();
        assert!(bodies.windows(2).all(|pair| pair[0] == pair[1]), "one body pose for all views");
    }
    let trans = read(&one, "trans", &[S, N, 3]);
    assert!(trans.chunks_exact(3).all(|t| (3.0..5.0).contains(&t[2])), "{trans:?}");
}

#[test]
fn a_scene_that_says_too_little_does_not_stop_the_batch() {
    let folder = folder();
    let [path, out] = ["batch.npz", "fits.npz"].map(|name| folder.path().join(name));
    let (mut arrays, _) = batch();
    // Scene 1 is hidden, and what stands beside a confidence of zero is no data.
    for mark in arrays[3].values[N * 72..2 * N * 72].chunks_exact_mut(3) {
        mark.copy_from_slice(&[f64::NAN, f64::NAN, 0.0]);
    }
    write(&path, &arrays);
    let ended = fit(&path, &out, &[]).done();
    assert_eq!(ended.err.lines().count(), 1, "{}", ended.err);
    assert!(ended.err.contains("scene 1 is left as it was"), "{}", ended.err);
    assert_eq!(read(&out, "valid", &[S]), [1.0, 0.0, 1.0]);
    assert_eq!(read(&out, "loss", &[S, 24])[24..48], [f64::INFINITY; 24]);
    assert_eq!(read(&out, "poses", &[S, N, 72])[N * 72..2 * N * 72], arrays[0].values[N * 72..2 * N * 72]);
}

#[test]
fn a_view_that_says_too_little_is_left_out_and_the_others_are_fitted() {
    let folder = folder();
    let [path, out] = ["batch.npz", "fits.npz"].map(|name| folder.path().join(name));
    let (mut arrays, truth) = batch();
    // Views 0 and 2 of scene 1 keep three marks each.
    for view in [N, N + 2] {
        let marks = &mut arrays[3].values[view * 72..(view + 1) * 72];
        marks.chunks_exact_mut(3).skip(3).for_each(|mark| mark[2] = 0.0);
    }
    write(&path, &arrays);
    let ended = fit(&path, &out, &[]).done();
    assert_eq!(ended.err.lines().count(), 1, "{}", ended.err);
    assert!(ended.err.contains("scene 1, view 0, 2: fewer than 4 usable keypoints"), "{}", ended.err);
    assert_eq!(read(&out, "valid", &[S]), [1.0; S]);
    let [poses, trans] = [("poses", 72), ("trans", 3)].map(|(name, n)| read(&out, name, &[S, N, n]));
    for view in [N, N + 2] {
        assert_eq!(poses[view * 72..view * 72 + 3], arrays[0].values[view * 72..view * 72 + 3]);
        assert_eq!(trans[view * 3..view * 3 + 3], arrays[2].values[view * 3..view * 3 + 3]);
        assert_eq!(poses[view * 72 + 3..(view + 1) * 72], poses[(N + 1) * 72 + 3..(N + 2) * 72]);
    }
    assert_ne!(poses[(N + 1) * 72..(N + 1) * 72 + 3], arrays[0].values[(N + 1) * 72..(N + 1) * 72 + 3]);
    let b = mannequin().beta_count();
    let before = errors_mm(&arrays[0].values, &vec![0.0; S * b], &truth)[1];
    let after = errors_mm(&poses, &read(&out, "betas", &[S, b]), &truth)[1];
    assert!(after < 0.8 * before, "{after} mm from {before} mm");
}

#[test]
fn finite_numbers_that_overflow_leave_their_scene_as_it_was() {
    let folder = folder();
    let [path, out] = ["batch.npz", "fits.npz"].map(|name| folder.path().join(name));
    for (array, at) in [(0, 7), (1, 0), (3, 0), (4, 0), (6, 0)] {
        let (mut arrays, _) = batch();
        arrays[array].values[at] = 1e300;
        write(&path, &arrays);
        fit(&path, &out, &[]).done();
        for (name, shape) in [("poses", vec![S, N, 72]), ("trans", vec![S, N, 3])] {
            let numbers = read(&out, name, &shape);
            assert!(numbers.iter().all(|x| x.is_finite()), "{} {name}", arrays[array].name);
        }
        assert_eq!(read(&out, "valid", &[S])[1..], [1.0; S - 1], "{}", arrays[array].name);
    }
}

#[test]
fn bad_batches_are_refused_in_one_line_and_nothing_is_written() {
    let folder = folder();
    let [path, out] = ["batch.npz", "fits.npz"].map(|name| folder.path().join(name));
    let refused = |spoil: &dyn Fn(&mut Vec<Plain>), more: &[&str], expected: &[&str]| {
        let (mut arrays, _) = batch();
        spoil(&mut arrays);
        write(&path, &arrays);
        let ended = fit(&path, &out, more);
        assert_eq!(ended.status, 2, "{ended:?}");
        assert_eq!(ended.err.trim_end().lines().count(), 1, "{}", ended.err);
        for part in expected {
            assert!(ended.err.contains(part), "{part}: {}", ended.err);
        }
        assert!(ended.err.contains("batch.npz"), "{}", ended.err);
        assert!(ended.out.is_empty() && !out.exists(), "nothing is written");
    };
    let b = mannequin().beta_count();
    refused(&|a| drop(a.remove(3)), &[], &["\"keypoints\" is missing; the file holds poses"]);
    refused(&|a| drop(a.remove(6)), &[], &["\"J_shapedirs\" is missing"]);
    refused(
        &|a| a[0].shape = vec![S * N, 72],
        &[],
        &["\"poses\" has the shape [12, 72], expected [3, 4, 72]"],
    );
    let fewer_betas = |a: &mut Vec<Plain>| {
        a[1].shape[2] = b - 1;
        a[1].values.truncate(S * N * (b - 1));
    };
    refused(&fewer_betas, &[], &["\"J_shapedirs\" has the shape"]);
    let empty = |a: &mut Vec<Plain>| {
        a[1].shape[0] = 0;
        a[1].values.clear();
    };
    refused(&empty, &[], &["\"betas\"", "nothing to fit"]);
    let not_finite = |array: usize, at: usize, x: f64| move |a: &mut Vec<Plain>| a[array].values[at] = x;
    refused(&not_finite(0, (N + 2) * 72, f64::NAN), &[], &["\"poses\" scene 1, view 2 holds NaN"]);
    refused(&not_finite(3, (N + 3) * 72, f64::INFINITY), &[], &["\"keypoints\" scene 1, view 3 holds inf"]);
    refused(&not_finite(5, 2 * 72 + 5, f64::NAN), &[], &["\"J_template\" scene 2 holds NaN"]);
    refused(&not_finite(3, 2, -0.5), &[], &["\"keypoints\" scene 0, view 0, joint 0", "-0.5"]);
    // Of scene 1, view 2, joint 5.
    let too_sure = not_finite(3, ((N + 2) * 24 + 5) * 3 + 2, 1e200);
    refused(&too_sure, &[], &["\"keypoints\" scene 1, view 2, joint 5", "expected 0 to 1000"]);
    refused(&not_finite(4, 9, 0.0), &[], &["\"K\" scene 0, view 1", "above zero"]);
    refused(&not_finite(4, 1, 3.0), &[], &["\"K\" scene 0, view 0", "expected fx, 0, cx"]);
    let untouched = |_: &mut Vec<Plain>| {};
    refused(&untouched, &["--body", "B.npz"], &["--body is for captures"]);
    refused(&untouched, &["--start", "P.npz"], &["--start is for captures"]);
    refused(&untouched, &["--resume"], &["--resume is for captures"]);
    refused(&untouched, &["--prior", word(&path)], &["\"means\" is missing"]);

    let other = vitruvian(&["fit", word(&path), "-o", word(&out), "--method", "silhouette"]);
    assert!(other.status == 2 && other.err.contains("--method mv-smplify"), "{other:?}");
    let into_folder = fit(&path, folder.path(), &[]);
    assert!(into_folder.status == 2 && into_folder.err.contains("is a folder"), "{into_folder:?}");
    fs::write(&path, "no archive").expect("a writable file");
    let damaged = fit(&path, &out, &[]);
    assert!(damaged.status == 2 && damaged.err.contains("is no .npz archive"), "{damaged:?}");
}

/// Writes what a regressor might say of each view of the capture as `regress` writes it.
fn write_start(path: &Path, capture: &Path, views: usize) {
    let truth = capture.join("body.npz");
    let array = |name: &str| Npz::open(&truth).and_then(|mut npz| npz.array::<f64>(name)).expect(name).values;
    let (pose, betas, trans) = (array("poses"), array("betas"), array("trans"));
    let cameras: Value =
        serde_json::from_slice(&fs::read(capture.join("cameras.json")).expect("cameras")).expect("JSON");
    let number = |value: &Value| value.as_f64().expect("a number");
    let body = mannequin();
    let (mut poses, mut places) = (Vec::new(), Vec::new());
    for view in 0..views {
        let camera = &cameras["cameras"][view];
        let r = std::array::from_fn(|i| std::array::from_fn(|j| number(&camera["R"][i][j])));
        let t = std::array::from_fn(|i| number(&camera["t"][i]));
        let known = (&pose[..], &betas[..], [trans[0], trans[1], trans[2]]);
        let (pose, place) = estimate(&body, known, (&r, t), view);
        poses.extend(pose);
        places.extend(place);
    }
    let arrays = [
        Plain { name: "poses", shape: vec![views, 72], values: poses },
        Plain { name: "trans", shape: vec![views, 3], values: places },
    ];
    write(path, &arrays);
}

#[test]
fn a_capture_is_fitted_from_given_parameters_as_one_body_in_one_world() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let [start, out] = ["start.npz", "out"].map(|name| folder.path().join(name));
    write_start(&start, &capture, N);
    fit(&capture, &out, &["--start", word(&start)]).done();
    let expected = ["body.ply", "joints.npz", "params.npz", "report.json", "overlay_yaw_090.png"];
    assert!(expected.iter().all(|name| out.join(name).is_file()), "{out:?}");
    let report: Value =
        serde_json::from_slice(&fs::read(out.join("report.json")).expect("a report")).expect("JSON");
    assert_eq!((&report["success"], &report["verdict"]), (&json!(true), &json!("success")));
    assert_eq!((&report["extrinsics"], &report["joints"]["valid"]), (&json!("unknown"), &json!(true)));
    assert!(report["joints"]["loss_px2"]["left_wrist"].is_f64(), "{report}");
    // The cameras that are written see the body that is written where the keypoints are.
    for (name, view) in report["views"].as_object().expect("views") {
        assert!(view["residual"]["rms_px"].as_f64() < Some(12.0), "{name}: {view}");
    }
    let r = read(&out.join("params.npz"), "R", &[N, 3, 3]);
    assert_eq!(
        r[..9],
        [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "the world is the first camera's frame"
    );
    let judged = vitruvian(&["evaluate", word(&out), word(&capture), "--json"]).done().json();
    assert!(judged["measures"]["pa_mpjpe_mm"].as_f64() < Some(25.0), "{judged}");

    // The views of somebody else: written, but not to be trusted.
    let others = folder.path().join("others");
    vitruvian(&["synthesize", "-o", word(&others), "--count", "1", "--seed", "7"]).done();
    for yaw in ["090", "270"] {
        let name = format!("keypoints/yaw_{yaw}.json");
        fs::copy(others.join("0000").join(&name), capture.join(&name)).expect("a copy");
    }
    let mixed = folder.path().join("mixed");
    let ended = fit(&capture, &mixed, &["--start", word(&start)]);
    assert!(ended.status == 1 && ended.err.contains("far from the keypoints"), "{ended:?}");
    assert!(mixed.join("overlay_yaw_090.png").is_file(), "what there is to see is there");
}

#[test]
fn a_sequence_takes_each_capture_s_start_from_its_folder() {
    let folder = folder();
    let [captures, starts, out] = ["captures", "starts", "out"].map(|name| folder.path().join(name));
    let words =
        ["synthesize", "-o", word(&captures), "--count", "2", "--seed", "4", "--views", "1", "--size", "128"];
    vitruvian(&words).done();
    for name in ["0000", "0001"] {
        fs::create_dir_all(starts.join(name)).expect("a writable folder");
        write_start(&starts.join(name).join("params.npz"), &captures.join(name), 1);
    }
    fit(&captures, &out, &["--start", word(&starts)]).done();
    read(&out.join("params.npz"), "poses", &[2, 72]);
    assert!(out.join("0001/overlay_yaw_000.png").is_file());
}

#[test]
fn starts_and_options_that_do_not_fit_are_refused() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let [start, out] = ["start.npz", "out"].map(|name| folder.path().join(name));
    let refused = |path: &Path, more: &[&str], expected: &[&str]| {
        let mut words = vec!["fit", word(path), "-o", word(&out)];
        words.extend(more);
        let ended = vitruvian(&words);
        assert_eq!(ended.status, 2, "{ended:?}");
        assert_eq!(ended.err.trim_end().lines().count(), 1, "{}", ended.err);
        for part in expected {
            assert!(ended.err.contains(part), "{part}: {}", ended.err);
        }
        assert!(!out.exists(), "nothing is written");
    };
    let mv = |more: &[&'static str]| [&["--method", "mv-smplify"], more].concat();
    refused(&capture, &mv(&["--start", "identity"]), &["--start", "mv-smplify"]);
    refused(&capture, &mv(&["--start", "no-such.npz"]), &["no-such.npz"]);
    refused(&capture, &mv(&["--preset", "ch2", "--start", "no-such.npz"]), &["--preset ch2", "thesis"]);
    refused(&capture, &mv(&["--cameras", "known", "--start", "no-such.npz"]), &["--cameras known"]);
    refused(&capture, &mv(&["--refine-pose"]), &["--refine-pose"]);
    refused(&capture, &["--start", "params.npz"], &["--start params.npz", "mv-smplify"]);
    refused(&capture, &["--models", "m"], &["--models", "mv-smplify"]);

    let both = ["--start", word(&start), "--models", "m"];
    refused(
        &capture,
        &mv(&[])[..].iter().copied().chain(both).collect::<Vec<_>>(),
        &["--start and --models"],
    );
    let no_graph =
        ["fit", word(&capture), "-o", word(&out), "--method", "mv-smplify", "--models", word(folder.path())];
    let missing = vitruvian(&no_graph);
    assert!(missing.status == 3 && missing.err.contains("regressor.onnx") && !out.exists(), "{missing:?}");

    let with_start = |path: &PathBuf, expected: &[&str]| {
        refused(path, &["--method", "mv-smplify", "--start", word(&start)], expected);
    };
    write_start(&start, &capture, 3);
    with_start(&capture, &["start.npz", "holds 3 frames", "4 views"]);
    write_start(&start, &capture, N);
    let named = |names: [&str; N]| {
        let names = names.map(str::to_owned);
        let mut npz = Npz::open(&start).expect("a start");
        let poses = npz.array::<f64>("poses").expect("poses").values;
        let values = [
            Named { name: "poses", shape: &[N, 72], values: Values::F64(&poses) },
            Named { name: "names", shape: &[N], values: Values::Text(&names) },
        ];
        npz::write(&start, &values).expect("a writable folder");
    };
    named(["yaw_000", "yaw_090", "yaw_270", "yaw_180"]);
    with_start(&capture, &["start.npz", "is of the views yaw_000, yaw_090, yaw_270, yaw_180;"]);
    let b = mannequin().beta_count();
    let zeros = |name, shape: Vec<usize>| Plain { name, values: vec![0.0; shape.iter().product()], shape };
    let mut betas = zeros("betas", vec![N, b + 1]);
    betas.values.fill(0.5);
    write(&start, &[zeros("poses", vec![N, 72]), betas]);
    with_start(&capture, &["start.npz", "\"betas\"", &format!("the body has {b} betas")]);
    let mut nan = zeros("trans", vec![N, 3]);
    nan.values[5] = f64::NAN;
    write(&start, &[zeros("poses", vec![N, 72]), nan]);
    with_start(&capture, &["start.npz", "\"trans\"", "NaN"]);
}

//! Inputs that cannot be used: one line that names the file and the fix, status 2 (3 for a missing part), nothing written.

use std::fs;
use std::path::Path;

use image::RgbImage;
use vitruvian_runtime::capture::picture;

use crate::command::{capture, files, folder, models, vitruvian, word};

/// Spoils a capture, reconstructs it, and checks the refusal.
fn refused(spoil: impl Fn(&Path), words: &[&str]) {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    spoil(&capture);
    let before = files(folder.path());
    let out = folder.path().join("out");
    let run = vitruvian(&["reconstruct", word(&capture), "-o", word(&out), "--resolution", "32"]);
    assert_eq!(run.status, 2, "{run:?}");
    assert_eq!(run.err.lines().count(), 1, "one line: {}", run.err);
    for words in words {
        assert!(run.err.contains(words), "{words:?} in {}", run.err);
    }
    assert!(run.out.is_empty() && !out.exists(), "{run:?}");
    assert_eq!(files(folder.path()), before, "nothing is left behind");
}

/// Replaces the first `from` in a text file, which must be there.
fn edit(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).expect("a text file");
    assert!(text.contains(from), "{from} in {text}");
    fs::write(path, text.replacen(from, to, 1)).expect("a writable file");
}

#[test]
fn a_missing_mask() {
    refused(
        |capture| fs::remove_file(capture.join("masks/yaw_090.png")).expect("a mask"),
        &["camera \"yaw_090\"", "masks/yaw_090.png is missing"],
    );
}

#[test]
fn an_image_of_another_size() {
    refused(
        |capture| {
            picture::write_rgb(&capture.join("images/yaw_180.png"), &RgbImage::new(40, 30))
                .expect("an image");
        },
        &["images/yaw_180.png", "40 × 30", "512 × 512"],
    );
}

#[test]
fn an_image_that_is_none() {
    refused(
        |capture| fs::write(capture.join("images/yaw_000.png"), "not a picture").expect("an image"),
        &["images/yaw_000.png", "PNG"],
    );
}

#[test]
fn a_camera_without_intrinsics() {
    refused(
        |capture| edit(&capture.join("cameras.json"), "\"K\"", "\"k\""),
        &["cameras.json", "yaw_000", "K"],
    );
}

#[test]
fn a_number_that_is_none_in_the_intrinsics() {
    let spoil = |capture: &Path| {
        let path = capture.join("cameras.json");
        let text = fs::read_to_string(&path).expect("cameras");
        let start = text.find("\"K\"").expect("a K");
        let number = start + text[start..].find(|c: char| c.is_ascii_digit()).expect("a number");
        let end = number + text[number..].find(|c: char| !c.is_ascii_digit() && c != '.').expect("its end");
        fs::write(&path, format!("{}NaN{}", &text[..number], &text[end..])).expect("a writable file");
    };
    refused(spoil, &["cameras.json", "yaw_000", "K"]);
}

#[test]
fn a_camera_that_does_not_say_where_it_stands() {
    refused(|capture| edit(&capture.join("cameras.json"), "\"R\"", "\"r\""), &["yaw_000", "R"]);
}

#[test]
fn an_empty_mask() {
    refused(
        |capture| {
            picture::write_rgb(&capture.join("masks/yaw_270.png"), &RgbImage::new(512, 512)).expect("a mask")
        },
        &["\"yaw_270\"", "mask is empty"],
    );
}

#[test]
fn a_folder_that_is_no_capture() {
    refused(|capture| fs::remove_file(capture.join("cameras.json")).expect("cameras"), &["cameras.json"]);
}

#[test]
fn a_truth_that_is_no_mesh() {
    refused(
        |capture| fs::write(capture.join("mesh.obj"), "v 0 0\n").expect("a mesh"),
        &["mesh.obj", "line 1"],
    );
}

#[test]
fn one_bad_capture_among_good_ones_stops_before_anything_is_written() {
    let folder = folder();
    let [captures, out] = ["captures", "out"].map(|name| folder.path().join(name));
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "2", "--size", "128"]).done();
    fs::remove_file(captures.join("0001/masks/yaw_000.png")).expect("a mask");
    let run = vitruvian(&["reconstruct", word(&captures), "-o", word(&out)]);
    assert!(run.status == 2 && run.err.contains("0001") && !out.exists(), "{run:?}");
}

#[test]
fn graphs_that_are_none_or_of_another_kind_or_missing() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let (graphs, out) = (folder.path().join("models"), folder.path().join("out"));
    fs::create_dir(&graphs).expect("a writable folder");
    let fresh = || {
        for file in ["mf_pifu_encoder.onnx", "mf_pifu_query.onnx", "vsr_encoder.onnx", "vsr_query.onnx"] {
            fs::copy(models().join(file), graphs.join(file)).expect("a committed graph");
        }
    };
    let run = || {
        let words = ["reconstruct", word(&capture), "-o", word(&out), "--models", word(&graphs)];
        let run = vitruvian(&[&words[..], &["--resolution", "32"]].concat());
        assert!(run.out.is_empty() && !out.exists(), "{run:?}");
        assert_eq!(run.err.lines().count(), 1, "{run:?}");
        run
    };
    let names = |run: &crate::command::Outcome, words: &[&str]| {
        for words in words {
            assert!(run.err.contains(words), "{words:?} in {}", run.err);
        }
    };

    fresh();
    fs::copy(graphs.join("vsr_query.onnx"), graphs.join("mf_pifu_query.onnx")).expect("a graph");
    let wrong = run();
    assert_eq!(wrong.status, 2);
    names(&wrong, &["mf_pifu_query.onnx", "vitruvian.kind", "mf-pifu.query", "vsr.query"]);

    fresh();
    fs::write(graphs.join("vsr_encoder.onnx"), "not a graph").expect("a graph");
    let damaged = run();
    assert_eq!(damaged.status, 2);
    names(&damaged, &["vsr_encoder.onnx"]);

    fresh();
    fs::remove_file(graphs.join("vsr_query.onnx")).expect("a graph");
    let missing = run();
    assert_eq!(missing.status, 3);
    names(&missing, &["vsr_query.onnx"]);

    fs::remove_dir_all(&graphs).expect("a folder");
    let missing = run();
    assert_eq!(missing.status, 3);
    names(&missing, &[word(&graphs), "--models"]);
}

#[test]
fn results_that_would_replace_a_file() {
    let folder = folder();
    let out = folder.path().join("out");
    fs::write(&out, "mine").expect("a writable folder");
    for words in [&["reconstruct", "nowhere", "-o", word(&out)][..], &["demo", "-o", word(&out)]] {
        let run = vitruvian(words);
        assert!(run.status == 2 && run.err.contains("out: expected a folder"), "{run:?}");
        assert_eq!(fs::read_to_string(&out).expect("a file"), "mine");
    }
}

#[test]
fn a_resolution_that_is_out_of_range() {
    let run = vitruvian(&["reconstruct", "nowhere", "-o", "nowhere_either", "--resolution", "1"]);
    assert!(run.status == 2 && run.err.contains("--resolution 1"), "{run:?}");
}

//! `synthesize` and `dataset`: what they write, alone and with things around the people.

use std::fs;

use vitruvian_runtime::capture::{Capture, Need, Needs, View};
use vitruvian_runtime::file::npz::Npz;

use crate::command::{folder, vitruvian, word};

/// The views of a small capture made with further words.
fn views(words: &[&str]) -> Vec<View> {
    let folder = folder();
    let command = ["synthesize", "-o", word(folder.path()), "--seed", "6", "--size", "96"];
    vitruvian(&[&command[..], words].concat()).done();
    let all = Needs { keypoints: Need::Required, ..Needs::RECONSTRUCTION };
    Capture::read(&folder.path().join("0000"), all).expect("a capture").views
}

#[test]
fn surroundings_leave_cameras_and_people_alone_and_are_the_same_for_a_seed() {
    let plain = views(&[]);
    let places = views(&["--backgrounds"]);
    let among = views(&["--backgrounds", "--occlusion", "1"]);
    let again = views(&["--backgrounds", "--occlusion", "1"]);
    let mut hidden = 0;
    for (((plain, place), among), again) in plain.iter().zip(&places).zip(&among).zip(&again) {
        assert_eq!(plain.camera, among.camera);
        assert!(plain.mask == place.mask && plain.image != place.image, "a backdrop is behind the person");
        assert!(among.image == again.image && among.mask == again.mask, "one seed makes one capture");
        let points = |view: &View| view.keypoints.clone().expect("keypoints").points;
        for ([u, v, whole], [x, y, confidence]) in points(plain).into_iter().zip(points(among)) {
            assert_eq!(([u, v], whole), ([x, y], 1.0));
            hidden += usize::from(confidence == 0.0);
        }
    }
    assert!(hidden > 0, "furniture before every view hides some joint");
}

#[test]
fn probability_beyond_one_is_refused() {
    let folder = folder();
    for value in ["1.5", "-0.1", "nan", "often"] {
        let occlusion = format!("--occlusion={value}");
        let run = vitruvian(&["synthesize", "-o", word(folder.path()), &occlusion]);
        assert!(run.status == 2 && run.err.contains("--occlusion"), "{run:?}");
    }
}

#[test]
fn scenes_for_the_regressor_go_on_where_they_stopped() {
    let folder = folder();
    let words = ["dataset", "--for", "regressor", "-o", word(folder.path()), "--seed", "4", "--views", "2"];
    vitruvian(&[&words[..], &["--count", "1"]].concat()).done();
    let first = folder.path().join("scene_4_000000.npz");
    let written = fs::metadata(&first).expect("a scene").modified().expect("a time");
    vitruvian(&[&words[..], &["--count", "2"]].concat()).done();
    assert_eq!(fs::metadata(&first).expect("a scene").modified().expect("a time"), written);
    let mut scene = Npz::open(&folder.path().join("scene_4_000001.npz")).expect("a scene");
    scene.shaped::<f32>("images", &[2, 3, 160, 160].map(Some)).expect("images");
    scene.shaped::<f32>("masks", &[2, 160, 160].map(Some)).expect("masks");
    scene.shaped::<f32>("keypoints", &[2, 24, 3].map(Some)).expect("keypoints");
    scene.shaped::<f32>("J_shapedirs", &[24, 3, 10].map(Some)).expect("the skeleton");
}

#[test]
fn scenes_for_the_regressor_take_no_coarse_surfaces() {
    let folder = folder();
    let out = folder.path().join("out");
    let words =
        ["dataset", "--for", "regressor", "--coarse", "models/exported", "--count", "1", "--seed", "1"];
    let run = vitruvian(&[&words[..], &["-o", word(&out)]].concat());
    assert!(run.status == 2 && run.err.contains("--coarse") && !out.exists(), "{run:?}");
}

//! What `regress` refuses: one line that names the file or option and the fix, status 2 (3 for a missing part), nothing written.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{GrayImage, ImageFormat, Luma, RgbImage};
use tempfile::TempDir;
use vitruvian_runtime::capture::picture;

use crate::command::{Outcome, capture, files, folder, vitruvian, word};
use crate::regress::{Answer, Form};

/// A photograph of 64 × 48 pixels, a mask of its left upper quarter, and a graph.
struct Scene {
    folder: TempDir,
}

impl Scene {
    fn new() -> Scene {
        let scene = Scene { folder: folder() };
        picture::write_rgb(&scene.path("photo.png"), &RgbImage::new(64, 48)).expect("a writable folder");
        let quarter = GrayImage::from_fn(64, 48, |x, y| Luma([if x < 32 && y < 24 { 255 } else { 0 }]));
        picture::write_gray(&scene.path("mask.png"), &quarter).expect("a writable folder");
        Answer::upright().write(scene.folder.path());
        scene
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs with these words, in which @ stands for the scene's folder.
    fn run(&self, words: &[&str]) -> Outcome {
        let root = word(self.folder.path());
        let words: Vec<String> = words.iter().map(|w| w.replace('@', root)).collect();
        let out = self.path("out");
        vitruvian(&[&["regress".to_owned(), "-o".to_owned(), word(&out).to_owned()], &words[..]].concat())
    }

    /// Runs and checks the refusal.
    fn refused(&self, status: i32, words: &[&str], expected: &[&str]) {
        let before = files(self.folder.path());
        let run = self.run(words);
        assert_eq!(run.status, status, "{run:?}");
        assert_eq!(run.err.lines().count(), 1, "one line: {}", run.err);
        for words in expected {
            assert!(run.err.contains(words), "{words:?} in {}", run.err);
        }
        assert!(run.out.is_empty() && !self.path("out").exists(), "{run:?}");
        assert_eq!(files(self.folder.path()), before, "nothing is left behind");
    }

    /// Puts another graph in the place of the good one.
    fn graph(&self, bytes: Vec<u8>) {
        fs::write(self.path("answer.onnx"), bytes).expect("a writable folder");
    }
}

const GOOD: [&str; 3] = ["@/photo.png", "--graph", "@/answer.onnx"];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&GOOD[..], more].concat()
}

#[test]
fn the_scene_itself_is_accepted() {
    let scene = Scene::new();
    scene.run(&with(&["--mask", "@/mask.png"])).done();
    assert!(scene.path("out/overlay_photo.png").is_file());
}

#[test]
fn boxes_without_area_without_sense_too_small_or_outside_the_photograph() {
    let scene = Scene::new();
    for (text, words) in [
        ("10,10,0,20", "it has no area"),
        ("10,10,20,-5", "it has no area"),
        ("10,10,20", "expected four numbers x,y,width,height"),
        ("10,10,20,tall", "expected four numbers"),
        ("10,10,NaN,20", "expected four numbers"),
        ("64,10,20,20", "it lies outside"),
        ("-30,-30,20,20", "it lies outside"),
        ("10.4,10.4,1e-3,1e-3", "less than the 8 pixels"),
        ("10,10,1e-9,1e-9", "less than the 8 pixels"),
        ("10,10,.3,.3", "less than the 8 pixels"),
        ("10,10,1e9,1e9", "its side is more than"),
    ] {
        scene.refused(2, &with(&["--box", text]), &[words]);
    }
    scene.refused(
        2,
        &with(&["--box", "0,0,9,9", "--box", "0,0,9,9"]),
        &["--box is given 2 times for 1 photographs"],
    );
}

#[test]
fn masks_that_are_empty_a_speck_of_another_size_or_none() {
    let scene = Scene::new();
    let write = |mask: &GrayImage| picture::write_gray(&scene.path("mask.png"), mask).expect("writable");
    let words = with(&["--mask", "@/mask.png"]);
    write(&GrayImage::new(64, 48));
    scene.refused(2, &words, &["mask.png", "mask is empty"]);
    write(&GrayImage::from_fn(64, 48, |x, y| Luma([if (x, y) == (30, 20) { 255 } else { 0 }])));
    scene.refused(2, &words, &["photo.png", "1.2 pixels", "less than the 8 pixels"]);
    write(&GrayImage::new(48, 64));
    scene.refused(2, &words, &["mask.png: is 48 × 64 pixels", "photo.png is 64 × 48"]);
    fs::write(scene.path("mask.png"), "not a picture").expect("writable");
    scene.refused(2, &words, &["mask.png", "PNG"]);
    scene.refused(2, &with(&["--mask", "@/absent.png"]), &["absent.png"]);
}

#[test]
fn photographs_that_are_none_absent_or_of_one_name() {
    let scene = Scene::new();
    let photograph = fs::read(scene.path("photo.png")).expect("a photograph");
    fs::create_dir(scene.path("other")).expect("a writable folder");
    fs::write(scene.path("other/photo.png"), &photograph).expect("writable");
    scene.refused(2, &with(&["@/other/photo.png"]), &["photo.png", "both have the results \"photo\""]);
    fs::write(scene.path("photo.png"), &photograph[..photograph.len() - 20]).expect("writable");
    scene.refused(2, &GOOD, &["photo.png: cannot be decoded"]);
    let mut jpeg = Cursor::new(Vec::new());
    RgbImage::new(64, 48).write_to(&mut jpeg, ImageFormat::Jpeg).expect("memory");
    let jpeg = jpeg.into_inner();
    fs::write(scene.path("photo.png"), &jpeg[..jpeg.len() - 20]).expect("writable");
    scene.refused(2, &GOOD, &["photo.png: ends before its picture does"]);
    fs::write(scene.path("photo.png"), "not a picture").expect("writable");
    scene.refused(2, &GOOD, &["photo.png: cannot be decoded"]);
    fs::write(scene.path("notes.txt"), "not a picture").expect("writable");
    let words = ["@/notes.txt", "--graph", "@/answer.onnx"];
    scene.refused(2, &words, &["notes.txt: is neither a PNG nor a JPEG"]);
    fs::remove_file(scene.path("photo.png")).expect("a photograph");
    scene.refused(2, &GOOD, &["photo.png"]);
    fs::create_dir(scene.path("empty")).expect("a writable folder");
    scene.refused(2, &["@/empty", "--graph", "@/answer.onnx"], &["empty", "cameras.json"]);
    scene.refused(2, &["@/other", "@/empty", "--graph", "@/answer.onnx"], &["a folder is given by itself"]);
}

#[test]
fn focal_lengths_that_are_none() {
    let scene = Scene::new();
    for focal in ["0", "-800", "NaN", "inf"] {
        scene.refused(2, &with(&["--focal-px", focal]), &["--focal-px", "positive"]);
    }
}

#[test]
fn graphs_that_are_none_lack_an_output_or_have_another_shape_or_kind() {
    let scene = Scene::new();
    let answer = Answer::upright();
    let names = ["image", "pose", "betas", "camera"];
    let keys = [("kind", "regressor"), ("image_size", "8"), ("mean", "0,0,0"), ("std", "1,1,1")];
    let declared = |names: [&str; 4], keys: &[(&str, &str)]| {
        let graph = answer.bare_graph(Form::SixD, names);
        keys.iter()
            .fold(graph, |graph, (key, value)| graph.property(&format!("vitruvian.{key}"), value))
            .to_bytes()
    };

    scene.graph(b"a text, not a graph".to_vec());
    scene.refused(2, &GOOD, &["answer.onnx", "cannot load it as a graph"]);
    scene.graph(declared(["image", "pose", "betas", "cam"], &keys));
    scene.refused(2, &GOOD, &["answer.onnx: output \"camera\": it is missing", "\"cam\""]);
    scene.graph(declared(["image", "rotations", "betas", "camera"], &keys));
    scene.refused(2, &GOOD, &["output \"pose\": it is missing", "\"rotations\""]);
    scene.graph(declared(["image", "betas", "pose", "camera"], &keys));
    scene.refused(2, &GOOD, &["output \"pose\": found f32[1, 10], expected", "f32[?, 144]"]);
    scene.graph(declared(["picture", "pose", "betas", "camera"], &keys));
    scene.refused(2, &GOOD, &["input \"image\": it is missing"]);
    for (key, value) in
        [("kind", "vsr.encoder"), ("image_size", "9"), ("std", "1,0,1"), ("focal_length", "-5")]
    {
        let mut wrong: Vec<(&str, &str)> = keys.into_iter().filter(|(other, _)| *other != key).collect();
        if key != "kind" {
            scene.graph(declared(names, &wrong));
            let is_needed = key != "focal_length";
            let run = scene.run(&GOOD);
            assert_eq!(run.status == 2, is_needed, "{key}: {run:?}");
            assert!(!is_needed || run.err.contains(&format!("vitruvian.{key}\": it is missing")), "{run:?}");
            let _ = fs::remove_dir_all(scene.path("out"));
        }
        wrong.push((key, value));
        scene.graph(declared(names, &wrong));
        let place =
            if key == "image_size" { "input \"image\"".to_owned() } else { format!("vitruvian.{key}") };
        scene.refused(2, &GOOD, &["answer.onnx", &place]);
    }
    let vsr = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/exported/vsr_encoder.onnx");
    scene.refused(
        2,
        &["@/photo.png", "--graph", word(&vsr)],
        &["expected \"regressor\", found \"vsr.encoder\""],
    );
}

#[test]
fn answers_that_mean_no_body() {
    let scene = Scene::new();
    let good = Answer::upright();
    let spoil = |spoil: &dyn Fn(&mut Answer), words: &[&str]| {
        let mut answer = good.clone();
        spoil(&mut answer);
        scene.graph(answer.graph(Form::Matrices).to_bytes());
        scene.refused(2, &GOOD, &[&["answer.onnx", "photo.png"], words].concat());
    };
    spoil(&|answer| answer.rotations[5][1][1] = f64::NAN, &["output \"pose\"", "NaN"]);
    spoil(
        &|answer| answer.rotations[5] = [[2.0; 3]; 3],
        &["output \"pose\"", "joint 5", "no rotation matrix"],
    );
    spoil(&|answer| answer.camera[0] = 0.0, &["output \"camera\"", "its scale is 0"]);
    spoil(&|answer| answer.camera[0] = f64::NAN, &["output \"camera\"", "NaN"]);
    spoil(&|answer| answer.betas[3] = f64::INFINITY, &["output \"betas\"", "inf"]);
}

#[test]
fn bodies_that_lack_betas_or_joints() {
    let scene = Scene::new();
    let answer = Answer { betas: vec![0.0; 300], ..Answer::upright() };
    scene.graph(answer.graph(Form::SixD).to_bytes());
    scene.refused(2, &GOOD, &["the mannequin", "betas", "answer.onnx gives 300", "give a body with as many"]);
    fs::write(scene.path("body.npz"), "no archive").expect("writable");
    scene.refused(2, &with(&["--body", "@/body.npz"]), &["body.npz"]);
    scene.refused(2, &with(&["--body", "@/absent.npz"]), &["absent.npz"]);
}

#[test]
fn a_graph_that_is_not_there_is_a_missing_part() {
    let scene = Scene::new();
    scene.refused(3, &["@/photo.png", "--graph", "@/absent.onnx"], &["absent.onnx does not exist"]);
    scene.refused(3, &["@/photo.png", "--models", "@/nowhere"], &["nowhere", "--models"]);
    fs::create_dir(scene.path("models")).expect("writable");
    scene.refused(
        3,
        &["@/photo.png", "--models", "@/models"],
        &["models/regressor.onnx does not exist", "export"],
    );
}

#[test]
fn a_capture_says_itself_where_its_people_are() {
    let scene = Scene::new();
    let capture = capture(&scene.path("captures"));
    for (option, value) in [("--box", "0,0,9,9"), ("--mask", "@/mask.png"), ("--focal-px", "900")] {
        let words = [word(&capture), "--graph", "@/answer.onnx", option, value];
        scene.refused(2, &words, &[option, "a capture has its own masks and cameras"]);
    }
    let words = [word(&capture), "--graph", "@/answer.onnx"];
    picture::write_gray(&capture.join("masks/yaw_090.png"), &GrayImage::new(512, 512)).expect("writable");
    scene.refused(2, &words, &["camera \"yaw_090\"", "mask is empty"]);
    fs::remove_file(capture.join("masks/yaw_090.png")).expect("a mask");
    fs::remove_file(capture.join("images/yaw_180.png")).expect("a picture");
    scene.refused(2, &words, &["camera \"yaw_180\"", "images/yaw_180.png", "is missing"]);
}

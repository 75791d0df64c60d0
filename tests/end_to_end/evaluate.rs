//! `evaluate`: closed forms, bounds and refusals.

use image::{GrayImage, Luma};
use serde_json::Value;
use vitruvian_runtime::capture::picture;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named};

use crate::command::{folder, sphere, vitruvian, word};

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn concentric_spheres_have_the_distances_and_the_overlap_of_the_closed_form() {
    let folder = folder();
    let (inner, outer) = (folder.path().join("inner.ply"), folder.path().join("outer.obj"));
    sphere(&inner, 0.9, [0.0; 3], 96);
    sphere(&outer, 1.0, [0.0; 3], 96);
    let found = vitruvian(&["evaluate", word(&inner), word(&outer), "--json"]).done().json();
    let measures = &found["measures"];
    // 192 sectors cut a sphere of 1 m by 0.3 mm at most; 10⁶ points give the IoU ± 0.001.
    assert!((number(&measures["p2s_cm"]) - 10.0).abs() < 0.03, "{found}");
    assert!((number(&measures["completeness_cm"]) - 10.0).abs() < 0.03, "{found}");
    assert!((number(&measures["chamfer_l2"]) - 1.0).abs() < 0.006, "{found}");
    assert!((number(&measures["iou"]) - 0.729).abs() < 0.003, "{found}");
    assert_eq!(found["sampling"]["seed"], 0);
}

#[test]
fn a_stray_piece_counts_in_p2s_and_not_in_that_of_the_largest_piece() {
    let folder = folder();
    let [body, stray, both] = ["body.obj", "stray.obj", "both.obj"].map(|name| folder.path().join(name));
    sphere(&body, 1.0, [0.0; 3], 24);
    sphere(&stray, 0.3, [5.0, 0.0, 0.0], 24);
    let text = |path| std::fs::read_to_string(path).expect("a mesh");
    let first = text(&body).lines().filter(|line| line.starts_with("v ")).count();
    let mut joined = text(&body);
    for line in text(&stray).lines() {
        let moved = |word: &str| (word.parse::<usize>().expect("an index") + first).to_string();
        joined += &match line.strip_prefix("f ") {
            Some(face) => format!("f {}\n", face.split(' ').map(moved).collect::<Vec<_>>().join(" ")),
            None => format!("{line}\n"),
        };
    }
    std::fs::write(&both, joined).expect("a writable folder");
    let found = vitruvian(&["evaluate", word(&both), word(&body), "--json"]).done().json();
    let measures = &found["measures"];
    assert_eq!(measures["pieces"], 2);
    assert!(number(&measures["largest_piece_p2s_cm"]) < 1e-6, "{found}");
    // The stray sphere has 0.09/1.09 of the surface, about 4 m away.
    let expected = 100.0 * 0.09 / 1.09 * 4.0;
    assert!((number(&measures["p2s_cm"]) / expected - 1.0).abs() < 0.05, "{found}");
}

#[test]
fn a_bound_that_is_missed_ends_with_status_1_and_still_prints_the_result() {
    let folder = folder();
    let (inner, outer) = (folder.path().join("inner.ply"), folder.path().join("outer.ply"));
    sphere(&inner, 0.9, [0.0; 3], 24);
    sphere(&outer, 1.0, [0.0; 3], 24);
    let quick = ["--samples", "2000", "--iou-points", "20000"];
    let run = |bounds: &[&str]| {
        vitruvian(&[&["evaluate", word(&inner), word(&outer)], &quick[..], bounds].concat())
    };
    assert_eq!(run(&["--min-iou", "0.6", "--max-p2s-cm", "12"]).status, 0);
    let missed = run(&["--min-iou", "0.8"]);
    assert!(missed.status == 1 && missed.out.contains("P2S") && missed.err.contains("below"), "{missed:?}");
    let missed = run(&["--max-p2s-cm", "9"]);
    assert!(missed.status == 1 && missed.err.contains("above the bound 9 cm"), "{missed:?}");
    assert_eq!(run(&[]).out, run(&[]).out, "the same seed gives the same numbers");
}

#[test]
fn masks_overlap_by_the_share_of_their_union() {
    let folder = folder();
    let (a, b) = (folder.path().join("a.png"), folder.path().join("b.png"));
    let mask = |from: u32| GrayImage::from_fn(8, 4, |x, _| Luma([if x >= from { 255 } else { 0 }]));
    picture::write_gray(&a, &mask(2)).expect("a writable folder");
    picture::write_gray(&b, &mask(5)).expect("a writable folder");
    let run = vitruvian(&["evaluate", word(&a), word(&b), "--json", "--min-iou", "0.6"]);
    assert_eq!((run.status, number(&run.json()["iou"])), (1, 0.5));
    let folders = [folder.path().join("one"), folder.path().join("two")];
    for (path, from) in folders.iter().zip([2, 5]) {
        std::fs::create_dir(path).expect("a writable folder");
        picture::write_gray(&path.join("front.png"), &mask(from)).expect("a writable folder");
        picture::write_gray(&path.join("back.png"), &mask(5)).expect("a writable folder");
    }
    let run = vitruvian(&["evaluate", word(&folders[0]), word(&folders[1]), "--json"]).done();
    assert_eq!(number(&run.json()["iou"]), 0.75);
    picture::write_gray(&b, &GrayImage::new(7, 4)).expect("a writable folder");
    let run = vitruvian(&["evaluate", word(&a), word(&b)]);
    assert!(run.status == 2 && run.err.contains("a.png: is 8 × 4 pixels"), "{run:?}");
}

#[test]
fn joints_and_the_parameters_that_they_are_posed_from_are_the_same_body() {
    let folder = folder();
    let [params, moved] = ["params.npz", "moved.npz"].map(|name| folder.path().join(name));
    let captures = folder.path().join("captures");
    vitruvian(&["synthesize", "-o", word(&captures), "--views", "1", "--size", "64"]).done();
    let truth = captures.join("0000/body.npz");
    let mut body = npz::Npz::open(&truth).expect("a body");
    let [poses, betas, trans, joints] =
        ["poses", "betas", "trans", "joints"].map(|name| body.array::<f64>(name).expect("an array").values);
    let array = |name, shape, values| Named { name, shape, values: Values::F64(values) };
    let bare =
        [array("poses", &[1, 72][..], &poses), array("betas", &[10], &betas), array("trans", &[3], &trans)];
    npz::write(&params, &bare).expect("a writable folder");
    let found = vitruvian(&["evaluate", word(&params), word(&truth), "--json"]).done().json();
    assert!(number(&found["measures"]["error_mm"]) < 1e-9, "{found}");

    let shifted: Vec<f64> = joints.iter().enumerate().map(|(i, x)| x + [0.3, 0.4, 0.0][i % 3]).collect();
    npz::write(&moved, &[array("joints", &[24, 3], &shifted)]).expect("a writable folder");
    let found = vitruvian(&["evaluate", word(&moved), word(&truth), "--json"]).done().json();
    let measures = &found["measures"];
    assert!((number(&measures["error_mm"]) - 500.0).abs() < 1e-9, "{found}");
    assert!(number(&measures["mpjpe_mm"]) < 1e-9 && number(&measures["pa_mpjpe_mm"]) < 1e-9, "{found}");
    assert_eq!(number(&measures["pck_150"]), 100.0);

    npz::write(&moved, &[array("joints", &[23, 3], &shifted[..69])]).expect("a writable folder");
    let run = vitruvian(&["evaluate", word(&moved), word(&truth)]);
    assert!(run.status == 2 && run.err.contains("moved.npz") && run.err.contains("23 joints"), "{run:?}");
    let run = vitruvian(&["evaluate", word(&truth), word(&truth), "--min-iou", "0.5"]);
    assert!(run.status == 2 && run.err.contains("--min-iou"), "{run:?}");
}

#[test]
fn things_that_cannot_be_compared_are_refused() {
    let folder = folder();
    let (mesh, mask) = (folder.path().join("a.ply"), folder.path().join("a.png"));
    sphere(&mesh, 1.0, [0.0; 3], 8);
    picture::write_gray(&mask, &GrayImage::new(4, 4)).expect("a writable folder");
    let cases = [
        (word(&mesh), word(&mask), "give two of a kind"),
        (word(&mask), word(&mask), "both empty"),
        (word(folder.path()), word(&mesh), "give two of a kind"),
        (word(&mesh), "absent.ply", "absent.ply"),
        (word(&mesh), "Cargo.toml", "Cargo.toml: expected a folder, a mesh"),
    ];
    for (predicted, truth, words) in cases {
        let run = vitruvian(&["evaluate", predicted, truth]);
        assert!(run.status == 2 && run.err.contains(words), "{words} in {run:?}");
    }
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).expect("a writable folder");
    let run = vitruvian(&["evaluate", word(&empty), word(folder.path())]);
    assert!(run.status == 2 && run.err.contains("vitruvian reconstruct"), "{run:?}");
}

//! `regress` with graphs that know the answer: what the command does around the network, to rounding.

use std::fs;
use std::path::{Path, PathBuf};

use vitruvian_conformance::onnx::builder::{GraphBuilder, int};
use vitruvian_reference::body::mannequin;
use vitruvian_reference::linalg::matrix::{Matrix3, apply, mul};
use vitruvian_reference::linalg::vector::{Vector3, add, distance, sub};
use vitruvian_reference::rotation::{logarithm, rodrigues, to_six_d};
use vitruvian_runtime::capture::{Camera, Capture, Needs};
use vitruvian_runtime::file::npz::Npz;
use vitruvian_runtime::person_crop::{PersonBox, crop};

use crate::command::{capture, files, folder, vitruvian, word};

/// The side of the images that the graphs here take.
pub const SIZE: usize = 8;

/// How a graph of these tests writes its pose.
#[derive(Clone, Copy, PartialEq)]
pub enum Form {
    Matrices,
    SixD,
    AxisAngle,
}

/// What the network is to say, whatever it sees.
#[derive(Clone)]
pub struct Answer {
    pub rotations: Vec<Matrix3>,
    pub betas: Vec<f64>,
    pub camera: [f64; 3],
}

impl Answer {
    /// A person upright before the camera.
    pub fn upright() -> Answer {
        let mut rotations = vec![rodrigues([0.0; 3]); 24];
        rotations[0] = rodrigues([std::f64::consts::PI, 0.0, 0.0]);
        Answer { rotations, betas: vec![0.5; 10], camera: [0.9, 0.0, 0.2] }
    }

    fn pose(&self, form: Form) -> Vec<f32> {
        let numbers = self.rotations.iter().flat_map(|r| match form {
            Form::Matrices => r.as_flattened().to_vec(),
            Form::SixD => to_six_d(r).to_vec(),
            Form::AxisAngle => logarithm(r).to_vec(),
        });
        numbers.map(|x| x as f32).collect()
    }

    /// A graph of one image that says so; without what it declares, and with tensors of these names.
    pub fn bare_graph(&self, form: Form, names: [&str; 4]) -> GraphBuilder {
        let [image, pose, betas, camera] = names;
        let mut graph = GraphBuilder::new(17)
            .input(image, &[1, 3, SIZE, SIZE])
            .node("GlobalAveragePool", &[image], &["mean"], vec![])
            .node("Flatten", &["mean"], &["colours"], vec![int("axis", 1)]);
        let values = [
            (pose, self.pose(form)),
            (betas, self.betas.iter().map(|&x| x as f32).collect()),
            (camera, self.camera.map(|x| x as f32).to_vec()),
        ];
        for (name, constant) in values {
            let (zeros, ones, flat) =
                (format!("{name}.zeros"), format!("{name}.constant"), format!("{name}.flat"));
            let last = if name == pose && form == Form::Matrices { flat.as_str() } else { name };
            graph = graph
                .constant(&zeros, &[3, constant.len()], &vec![0.0; 3 * constant.len()])
                .constant(&ones, &[1, constant.len()], &constant)
                .node("Gemm", &["colours", &zeros, &ones], &[last], vec![]);
            if last != name {
                graph = graph.integers("pose.shape", &[4], &[1, 24, 3, 3]).node(
                    "Reshape",
                    &[last, "pose.shape"],
                    &[name],
                    vec![],
                );
            }
            graph = graph.output(name);
        }
        graph
    }

    /// A graph that declares everything.
    pub fn graph(&self, form: Form) -> GraphBuilder {
        let graph = self.bare_graph(form, ["image", "pose", "betas", "camera"]);
        DECLARED.iter().fold(graph, |graph, (key, value)| graph.property(&format!("vitruvian.{key}"), value))
    }

    /// Writes [`Answer::graph`] and returns its path.
    pub fn write(&self, folder: &Path) -> PathBuf {
        let path = folder.join("answer.onnx");
        fs::write(&path, self.graph(Form::SixD).to_bytes()).expect("a writable folder");
        path
    }
}

/// What the graphs here declare.
const DECLARED: [(&str, &str); 6] = [
    ("kind", "regressor"),
    ("version", "1"),
    ("image_size", "8"),
    ("mean", "0.485,0.456,0.406"),
    ("std", "0.229,0.224,0.225"),
    ("focal_length", "178.57"),
];

/// The numbers of an array in an archive.
fn numbers(path: &Path, name: &str) -> (Vec<usize>, Vec<f64>) {
    let array = Npz::open(path).and_then(|mut npz| npz.array::<f64>(name)).expect("an array of the archive");
    (array.shape, array.values)
}

fn vectors(values: &[f64]) -> Vec<Vector3> {
    values.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect()
}

/// What a perfect network says about a view of a capture whose truth is known, and the person's place in camera axes.
fn truth(folder: &Path, camera: &Camera, mask: &image::GrayImage) -> (Answer, Vector3) {
    let file = folder.join("body.npz");
    let [poses, betas, trans] = ["poses", "betas", "trans"].map(|name| numbers(&file, name).1);
    let extrinsics = camera.extrinsics.expect("a camera that stands somewhere");
    let mut rotations: Vec<Matrix3> = vectors(&poses).into_iter().map(rodrigues).collect();
    rotations[0] = mul(&extrinsics.r, &rotations[0]);
    // X_c = R (R_0 (x − J) + J + trans) + t: the body turns about its pelvis J.
    let pelvis = mannequin().rest_joints(&betas)[0];
    let place = add(apply(&extrinsics.r, add(pelvis, [trans[0], trans[1], trans[2]])), extrinsics.t);
    let place = sub(place, pelvis);

    let person = PersonBox::of_mask(mask).expect("a body");
    let cut = crop(&image::RgbImage::new(camera.width, camera.height), &person, 8).expect("a crop");
    let (focal, side) = (camera.focal_length_px(), f64::from(cut.side_px));
    let offset = |axis: usize| {
        let middle = cut.origin_px[axis] as f64 + 0.5 * side;
        place[axis] - (middle - camera.k[axis][2]) * place[2] / focal
    };
    let seen = [2.0 * focal / (place[2] * side), offset(0), offset(1)];
    (Answer { rotations, betas, camera: seen }, place)
}

#[test]
fn a_network_that_is_right_puts_the_body_where_it_is_in_the_photograph() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let views = Capture::read(&capture, Needs::RECONSTRUCTION).expect("a capture").views;
    let joints = vectors(&numbers(&capture.join("body.npz"), "joints").1);
    for (view, form) in views.iter().zip([Form::SixD, Form::Matrices, Form::AxisAngle]) {
        let (answer, place) = truth(&capture, &view.camera, view.mask.as_ref().expect("a mask"));
        let graph = folder.path().join("right.onnx");
        fs::write(&graph, answer.graph(form).to_bytes()).expect("a writable folder");
        let out = folder.path().join("out");
        let run = vitruvian(&["regress", word(&capture), "-o", word(&out), "--graph", word(&graph)]).done();
        assert!(run.err.contains("4 bodies") && run.err.contains("X_c = body + trans"), "{}", run.err);

        let row = views.iter().position(|other| other.camera.name == view.camera.name).expect("itself");
        let (shape, trans) = numbers(&out.join("params.npz"), "trans");
        assert_eq!(shape, [4, 3]);
        assert!(distance(vectors(&trans)[row], place) < 1e-5, "{:?} {place:?}", vectors(&trans)[row]);
        let (shape, found) = numbers(&out.join("joints.npz"), "joints");
        assert_eq!(shape, [4, 24, 3]);
        let camera = &view.camera;
        for (found, joint) in vectors(&found)[24 * row..].iter().zip(&joints) {
            let expected = camera.extrinsics.expect("known").to_camera(*joint);
            // The network's answer has passed through f32.
            assert!(distance(*found, expected) < 1e-5, "{found:?} {expected:?}");
        }
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(out.join("report.json")).expect("a report")).expect("JSON");
        let error = &report["photographs"][&camera.name]["truth"]["mpjpe_mm"];
        assert!(error.as_f64().is_some_and(|mm| mm < 0.01), "{error}");
        assert!(report["conventions"]["trans"].as_str().is_some_and(|words| words.contains("trans_z = 2 f")));

        // The mesh covers the mask: its outline is where the person's is.
        let mesh = vitruvian_runtime::file::mesh::read(&out.join(format!("body_{}.ply", camera.name)));
        let seen: Vec<[f64; 2]> = mesh
            .expect("a mesh")
            .vertices
            .iter()
            .filter_map(|vertex| camera.project_from_camera(vertex.map(f64::from)))
            .collect();
        let person = PersonBox::of_mask(view.mask.as_ref().expect("a mask")).expect("a body");
        for axis in 0..2 {
            let low = seen.iter().map(|uv| uv[axis]).fold(f64::INFINITY, f64::min);
            let high = seen.iter().map(|uv| uv[axis]).fold(f64::NEG_INFINITY, f64::max);
            let middle = 0.5 * (low + high);
            assert!((middle - person.center_px[axis]).abs() < 4.0, "{middle} {person:?}");
        }
    }
}

#[test]
fn every_photograph_has_its_row_mesh_and_overlay_and_the_same_again_has_the_same_bytes() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let graph = Answer::upright().write(folder.path());
    let photographs = ["yaw_090", "yaw_000"].map(|name| capture.join(format!("images/{name}.png")));
    let outs = ["first", "second"].map(|name| folder.path().join(name));
    let mut words = vec!["regress", word(&photographs[0]), word(&photographs[1]), "--graph", word(&graph)];
    words.extend(["--box", "100,40,200,400", "--box", "-20,0,300.5,512", "--focal-px", "800"]);
    for out in &outs {
        vitruvian(&[&words[..], &["-o", word(out)]].concat()).done();
    }
    let names: Vec<String> = files(&outs[0])
        .iter()
        .map(|f| f.file_name().expect("a name").to_string_lossy().into_owned())
        .collect();
    let expected = [
        "body_yaw_000.ply",
        "body_yaw_090.ply",
        "joints.npz",
        "overlay_yaw_000.png",
        "overlay_yaw_090.png",
        "params.npz",
        "report.json",
    ];
    assert_eq!(names, expected);
    for name in names.iter().filter(|name| *name != "report.json") {
        let [a, b] = [0, 1].map(|i| fs::read(outs[i].join(name)).expect("a file"));
        assert!(a == b, "{name}");
    }

    let params = outs[0].join("params.npz");
    let mut npz = Npz::open(&params).expect("an archive");
    assert_eq!(npz.texts("names").expect("names"), ["yaw_090", "yaw_000"], "in the order of the words");
    // Side 1.2·400 around (200, 240); and 1.2·512 around (130.25, 256), truncated towards zero.
    assert_eq!(numbers(&params, "crop").1, [-40.0, 0.0, 480.0, -176.0, -51.0, 614.0]);
    assert_eq!(
        numbers(&params, "K"),
        (vec![2, 3, 3], [[800.0, 0.0, 256.0, 0.0, 800.0, 256.0, 0.0, 0.0, 1.0]; 2].concat())
    );
    let depth = 2.0 * 800.0 / (f64::from(0.9_f32) * 480.0);
    assert!((numbers(&params, "trans").1[2] - depth).abs() < 1e-12, "{depth}");
    assert_eq!(numbers(&params, "poses").0, [2, 72]);

    // Parameters and joints as `pose` understands them.
    let posed = folder.path().join("posed.npz");
    vitruvian(&["pose", "--params", word(&params), "-o", word(&posed), "--exact"]).done();
    let (again, joints) = (numbers(&posed, "joints").1, numbers(&outs[0].join("joints.npz"), "joints").1);
    assert!(again.iter().zip(&joints).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn a_photograph_alone_is_taken_whole_under_an_assumed_lens_and_the_words_say_so() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let graph = Answer::upright().write(folder.path());
    let (photograph, out) = (capture.join("images/yaw_180.png"), folder.path().join("out"));
    let words = ["regress", word(&photograph), "-o", word(&out), "--graph", word(&graph), "--format", "obj"];
    let run = vitruvian(&words).done();
    assert!(run.err.contains("no box and no mask") && run.err.contains("assumed"), "{}", run.err);
    assert!(out.join("body_yaw_180.obj").is_file() && run.out.is_empty());
    let params = out.join("params.npz");
    assert_eq!(numbers(&params, "crop").1, [0.0, 0.0, 512.0]);
    assert_eq!(numbers(&params, "K").1[0], 512.0_f64.hypot(512.0));

    // A mask says more than nothing, and meshes of another format do not linger.
    let mask = capture.join("masks/yaw_180.png");
    let words =
        ["regress", word(&photograph), "-o", word(&out), "--graph", word(&graph), "--mask", word(&mask)];
    let run = vitruvian(&words).done();
    assert!(!run.err.contains("no box and no mask"), "{}", run.err);
    assert!(numbers(&params, "crop").1[2] < 512.0);
    assert!(out.join("body_yaw_180.ply").is_file() && !out.join("body_yaw_180.obj").exists());
}

#[test]
fn a_folder_of_captures_becomes_a_folder_of_results() {
    let folder = folder();
    let [captures, out] = ["captures", "out"].map(|name| folder.path().join(name));
    vitruvian(&["synthesize", "-o", word(&captures), "--count", "2", "--seed", "4", "--size", "128"]).done();
    let graph = Answer::upright().write(folder.path());
    let run = vitruvian(&["regress", word(&captures), "-o", word(&out), "--graph", word(&graph)]).done();
    assert_eq!(run.err.matches("4 bodies").count(), 2, "{}", run.err);
    for name in ["0000", "0001"] {
        assert!(
            out.join(name).join("params.npz").is_file()
                && out.join(name).join("overlay_yaw_270.png").is_file()
        );
    }
}

#[test]
fn an_export_made_by_others_runs_with_a_side_file() {
    let folder = folder();
    let capture = capture(&folder.path().join("captures"));
    let path = folder.path().join("hmr.onnx");
    let names = ["input.1", "pred_rotmat", "pred_shape", "pred_cam"];
    let graph = Answer::upright().bare_graph(Form::Matrices, names);
    fs::write(&path, graph.to_bytes()).expect("a writable folder");
    let side = "kind = \"regressor\"\nimage_size = 8\nmean = [0.485, 0.456, 0.406]\nstd = [0.229, 0.224, 0.225]\n\
                [tensors]\nimage = \"input.1\"\npose = \"pred_rotmat\"\nbetas = \"pred_shape\"\ncamera = \"pred_cam\"\n";
    fs::write(path.with_extension("toml"), side).expect("a writable folder");
    let out = folder.path().join("out");
    vitruvian(&["regress", word(&capture), "-o", word(&out), "--graph", word(&path)]).done();
    let poses = numbers(&out.join("params.npz"), "poses").1;
    assert!(
        (poses[0].abs() - std::f64::consts::PI).abs() < 1e-6 && poses[1..72].iter().all(|x| x.abs() < 1e-6)
    );
}

use image::{Rgb, RgbImage};

use super::camera::{assumed_intrinsics, crop_intrinsics, crop_translation};
use super::*;
use crate::file::npy;
use crate::person_crop::goldens::GOLDENS;
use crate::person_crop::tests::photograph;
use crate::person_crop::{PersonBox, crop as cut};
use crate::rotation::rodrigues;
use crate::session::Session;
use crate::test_graph::{Attribute, Element, GraphBuilder, Side};

use Side::{Fixed, Free};

const SIZE: u64 = 4;

/// A pose that differs from joint to joint.
fn axis_angle(joint: usize) -> [f64; 3] {
    let x = joint as f64;
    [0.1 * x - 1.0, 0.5 - 0.07 * x, (0.3 * x).sin()]
}

/// The numbers of one joint as a graph of this form writes them.
fn written(form: PoseForm, joint: usize) -> Vec<f32> {
    let r = rodrigues(axis_angle(joint));
    let numbers = match form {
        PoseForm::Matrices => r.as_flattened().to_vec(),
        PoseForm::SixD => r.iter().flat_map(|row| [row[0], row[1]]).collect(),
        PoseForm::AxisAngle => axis_angle(joint).to_vec(),
    };
    numbers.into_iter().map(|x| x as f32).collect()
}

/// What a graph of these tests is made of.
#[derive(Clone)]
struct Plan {
    batch: Side,
    pose_sides: Vec<u64>,
    bias: Vec<f32>,
    names: [&'static str; 4],
    metadata: bool,
}

impl Plan {
    fn new(form: PoseForm, pose_sides: &[u64]) -> Plan {
        let bias = (0..JOINTS).flat_map(|joint| written(form, joint)).collect();
        let names = ["image", "pose", "betas", "camera"];
        Plan { batch: Free("N"), pose_sides: pose_sides.to_vec(), bias, names, metadata: true }
    }

    /// camera = the image's mean colour (normalised); betas = twice it; pose = a constant.
    fn graph(&self) -> Vec<u8> {
        let [image, pose, betas, camera] = self.names;
        let mut zeros_then_shape = vec![0];
        zeros_then_shape.extend(self.pose_sides.iter().map(|&side| side as i64));
        let mut sides = vec![self.batch];
        sides.extend(self.pose_sides.iter().map(|&side| Fixed(side)));
        let width = self.bias.len() as u64;
        let mut graph = GraphBuilder::default()
            .input(image, Element::F32, &[self.batch, Fixed(3), Fixed(SIZE), Fixed(SIZE)])
            .integers("places", &[2, 3])
            .integers("shape", &zeros_then_shape)
            .numbers("nothing", &[3, width], &vec![0.0; 3 * width as usize])
            .numbers("bias", &[width], &self.bias)
            .node("ReduceMean", &[image, "places"], &[camera], &[("keepdims", Attribute::Int(0))])
            .node("Add", &[camera, camera], &[betas], &[])
            .node("MatMul", &[camera, "nothing"], &["zero"], &[])
            .node("Add", &["zero", "bias"], &["flat"], &[])
            .node("Reshape", &["flat", "shape"], &[pose], &[])
            .output(pose, Element::F32, &sides)
            .output(betas, Element::F32, &[self.batch, Fixed(3)])
            .output(camera, Element::F32, &[self.batch, Fixed(3)]);
        if self.metadata {
            for (key, value) in KEYS {
                graph = graph.metadata(&format!("vitruvian.{key}"), value);
            }
        }
        graph.to_bytes()
    }

    fn load(&self) -> Result<Regressor> {
        let session = Session::from_bytes("graph.onnx", &self.graph(), &Settings::default())?;
        let contract = Contract::of(&session)?;
        Regressor::of(Graph { session, contract })
    }

    fn complaint(&self, crops: &[Crop]) -> String {
        self.load().and_then(|mut regressor| regressor.regress(crops)).expect_err("a fault").to_string()
    }
}

const KEYS: [(&str, &str); 5] =
    [("kind", "regressor"), ("version", "1"), ("image_size", "4"), ("mean", "0,0,0"), ("std", "1,1,1")];

fn crop(colour: [u8; 3]) -> Crop {
    let side = SIZE as u32;
    Crop { image: RgbImage::from_pixel(side, side, Rgb(colour)), origin_px: [0, 0], side_px: side }
}

const FORMS: [(PoseForm, &[u64]); 8] = [
    (PoseForm::Matrices, &[24, 3, 3]),
    (PoseForm::Matrices, &[24, 9]),
    (PoseForm::Matrices, &[216]),
    (PoseForm::SixD, &[144]),
    (PoseForm::SixD, &[24, 3, 2]),
    (PoseForm::SixD, &[24, 6]),
    (PoseForm::AxisAngle, &[72]),
    (PoseForm::AxisAngle, &[24, 3]),
];

#[test]
fn every_form_of_a_pose_is_the_same_rotations_and_images_keep_their_order() {
    let crops: Vec<Crop> = (1..=19).map(|i| crop([10 * i, 255 - 10 * i, 7])).collect();
    for (form, sides) in FORMS {
        for batch in [Free("N"), Fixed(1), Fixed(5)] {
            let mut regressor = Plan { batch, ..Plan::new(form, sides) }.load().expect("a regressor");
            assert_eq!((regressor.pose_form(), regressor.beta_count()), (form, Some(3)));
            let found = regressor.regress(&crops).expect("numbers");
            assert_eq!(found.len(), crops.len(), "{form:?} {batch:?}");
            for (i, one) in found.iter().enumerate() {
                for (joint, rotation) in one.rotations.iter().enumerate() {
                    let expected = rodrigues(axis_angle(joint));
                    for (a, b) in rotation.as_flattened().iter().zip(expected.as_flattened()) {
                        // f32 keeps 6e-8; angles up to 2 rad turn their own rounding into twice that.
                        assert!((a - b).abs() < 3e-7, "{form:?} joint {joint}: {rotation:?} {expected:?}");
                    }
                }
                let red = f64::from(10.0 * (i + 1) as f32 / 255.0);
                assert!((one.camera[0] - red).abs() < 1e-6 && (one.betas[0] - 2.0 * red).abs() < 1e-6, "{i}");
            }
        }
    }
}

#[test]
fn numbers_that_mean_nothing_are_refused_with_the_graph_the_output_and_the_image() {
    let good = crop([200, 100, 100]);
    for (form, index, value, words) in [
        (PoseForm::SixD, 13, f32::NAN, "graph.onnx: output \"pose\": image 0: number 13 is NaN"),
        (PoseForm::AxisAngle, 71, f32::INFINITY, "output \"pose\": image 0: number 71 is inf"),
        (PoseForm::Matrices, 9, 2.5, "output \"pose\": image 0: joint 1 is [2.5,"),
    ] {
        let mut plan = Plan::new(form, &[(JOINTS * form.width()) as u64]);
        plan.bias[index] = value;
        let message = plan.complaint(std::slice::from_ref(&good));
        assert!(message.contains(words), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    let mut plan = Plan::new(PoseForm::SixD, &[144]);
    plan.bias[6..12].copy_from_slice(&[1.0, 2.0, 0.5, 1.0, 0.25, 0.5]);
    let message = plan.complaint(std::slice::from_ref(&good));
    assert!(
        message.contains("joint 1 is [1.0, 2.0, 0.5, 1.0, 0.25, 0.5], two parallel columns"),
        "{message}"
    );

    // The scale is the mean red: black is no camera, and only in the second of three images.
    let crops = [good.clone(), crop([0, 100, 100]), good];
    let message = Plan::new(PoseForm::SixD, &[144]).complaint(&crops);
    assert!(message.starts_with("graph.onnx: output \"camera\": image 1: its scale is 0,"), "{message}");
}

#[test]
fn a_crop_of_another_size_is_refused() {
    let mut wrong = crop([9; 3]);
    wrong.image = RgbImage::new(5, 4);
    let message = Plan::new(PoseForm::SixD, &[144]).complaint(&[wrong]);
    assert_eq!(message, "image 0: the crop is 5 × 4 pixels, the graph takes 4 × 4");
}

#[test]
fn a_pose_of_another_length_is_refused_with_every_form_that_there_is() {
    let mut plan = Plan::new(PoseForm::SixD, &[150]);
    plan.bias = vec![0.0; 150];
    let message = plan.complaint(&[]);
    assert!(
        message.contains("output \"pose\": found f32[N, 150], expected f32[?, 24, 3, 3] or f32[?, 144]"),
        "{message}"
    );
}

#[test]
fn a_foreign_export_runs_with_the_names_and_keys_of_its_side_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("spin.onnx");
    let mut plan = Plan::new(PoseForm::Matrices, &[24, 3, 3]);
    plan.names = ["input.1", "pred_rotmat", "pred_shape", "camera"];
    plan.metadata = false;
    std::fs::write(&path, plan.graph()).expect("a writable folder");
    let load = |side: &str| {
        std::fs::write(path.with_extension("toml"), side).expect("a writable folder");
        Regressor::load(&path, &Settings::default())
    };
    let keys = "kind = \"regressor\"\nimage_size = 4\nmean = [0.485, 0.456, 0.406]\nstd = [0.229, 0.224, 0.225]\n\
                focal_length = 89.5\n";
    let names = "[tensors]\nimage = \"input.1\"\npose = \"pred_rotmat\"\nbetas = \"pred_shape\"\n";
    let mut regressor = load(&format!("{keys}{names}")).expect("a complete contract");
    assert_eq!(regressor.focal_length_px(), 89.5);
    let found = regressor.regress(&[crop([255, 128, 0])]).expect("numbers");
    assert!((found[0].camera[0] - (1.0 - 0.485) / 0.229).abs() < 1e-6, "{:?}", found[0].camera);

    let message = load(keys).expect_err("other names").to_string();
    assert!(
        message.contains("input \"image\": it is missing") && message.contains("\"input.1\""),
        "{message}"
    );
    let message =
        load(&format!("{keys}{}", names.replace("pred_shape", "shape"))).expect_err("no such tensor");
    assert!(
        message
            .to_string()
            .contains("tensor \"shape\" (for \"betas\"): the graph has no such input or output"),
        "{message}"
    );
}

#[test]
fn a_missing_graph_is_a_missing_component() {
    let error = Regressor::load("nowhere.onnx", &Settings::default()).expect_err("no file");
    assert_eq!(error.exit_status(), 3);
    assert!(error.to_string().contains("nowhere.onnx does not exist"), "{error}");
}

/// u = K X / z.
fn projected(k: &Matrix3, [x, y, z]: [f64; 3]) -> [f64; 2] {
    [(k[0][0] * x + k[0][1] * y) / z + k[0][2], k[1][1] * y / z + k[1][2]]
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Points of a body two metres high and one deep around its origin.
fn points() -> Vec<[f64; 3]> {
    let places = [-1.0, -0.4, 0.0, 0.3, 1.0];
    let corners = places.iter().flat_map(|&x| places.iter().map(move |&y| [0.6 * x, y, 0.5 * x * y]));
    corners.chain([[0.0, 0.0, 0.5], [0.2, -0.3, -0.5]]).collect()
}

fn placed(origin_px: [i64; 2], side_px: u32) -> Crop {
    Crop { image: RgbImage::new(1, 1), origin_px, side_px }
}

#[test]
fn under_the_crop_s_own_pinhole_both_cameras_see_the_same() {
    let (crop, camera, size) = (placed([-31, 57], 415), [0.83, 0.11, -0.07], 128);
    let focal = FOCAL_AT_224_PX * f64::from(size) / 224.0;
    let k = crop_intrinsics(&crop, focal, size);
    let (t, own) = (full_image_translation(camera, &crop, &k), crop_translation(camera, focal, size));
    for (a, b) in t.iter().zip(own) {
        assert!((a - b).abs() < 1e-12 * own[2], "{t:?} {own:?}");
    }
    // The crop's picture in the photograph: u = origin + u'·b/S.
    let middle = 0.5 * f64::from(size);
    for x in points() {
        let [a, b] = projected(&[[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]], add(x, own));
        let back = [a, b].map(|u| u * f64::from(crop.side_px) / f64::from(size));
        let seen = projected(&k, add(x, t));
        for axis in 0..2 {
            let expected = crop.origin_px[axis] as f64 + back[axis];
            assert!((seen[axis] - expected).abs() < 1e-9, "{seen:?} {expected}");
        }
    }
}

#[test]
fn under_another_lens_the_pictures_differ_by_the_perspective_alone() {
    let (camera, size) = ([0.9, 0.05, 0.2], 224);
    for (crop, k) in [
        (placed([400, 20], 700), assumed_intrinsics(1280, 720, None)),
        (placed([0, 0], 300), assumed_intrinsics(640, 480, Some(500.0))),
    ] {
        let own = crop_intrinsics(&crop, FOCAL_AT_224_PX, size);
        let (t, far) =
            (full_image_translation(camera, &crop, &k), crop_translation(camera, FOCAL_AT_224_PX, size));
        let scale = 0.5 * camera[0] * f64::from(crop.side_px);
        for x in points() {
            let (seen, weak) = (projected(&k, add(x, t)), projected(&own, add(x, far)));
            let (near_share, far_share) = (x[2] / (t[2] + x[2]), x[2] / (far[2] + x[2]));
            for axis in 0..2 {
                let p = own[axis][2] + scale * (x[axis] + camera[1 + axis]);
                let expected = far_share * (p - own[axis][2]) - near_share * (p - k[axis][2]);
                assert!((seen[axis] - weak[axis] - expected).abs() < 1e-9, "{x:?}");
            }
            if x[2] == 0.0 {
                assert!(
                    (seen[0] - weak[0]).hypot(seen[1] - weak[1]) < 1e-9,
                    "points at the origin's depth coincide"
                );
            }
        }
    }
}

#[test]
fn a_camera_with_two_focal_lengths_and_skew_keeps_the_origin_in_its_place() {
    let (crop, camera) = (placed([250, 90], 360), [1.1, -0.2, 0.3]);
    let k = [[900.0, 3.0, 310.0], [0.0, 700.0, 260.0], [0.0, 0.0, 1.0]];
    let t = full_image_translation(camera, &crop, &k);
    let seen = projected(&k, t);
    let scale = 0.5 * 1.1 * 360.0;
    let expected = [250.0 + 180.0 - 0.2 * scale, 90.0 + 180.0 + 0.3 * scale];
    assert!((seen[0] - expected[0]).hypot(seen[1] - expected[1]) < 1e-9, "{seen:?} {expected:?}");
    assert!((t[2] - (900.0_f64 * 700.0).sqrt() / scale).abs() < 1e-12);
}

/// ImageNet's numbers, as torchvision's networks take them.
const IMAGENET: Normalization =
    Normalization { mean: [0.485, 0.456, 0.406], std: [0.229, 0.224, 0.225], background: 0.0 };

#[test]
fn a_photograph_enters_the_network_as_pytorch_and_pillow_give_it() {
    // By PyTorch 2.15.0 and Pillow 13.0.0; regenerate with python runtime/goldens/regressor_input.py.
    let golden: npy::Array<f32> =
        npy::parse(include_bytes!("../../goldens/regressor_input.npy")).expect("a NumPy file");
    let mut rest = golden.values.as_slice();
    let photograph = photograph();
    let mut off = 0;
    for case in &GOLDENS {
        let (expected, others) = rest.split_at(3 * (case.size * case.size) as usize);
        rest = others;
        let person = PersonBox { center_px: case.center_px, side_px: case.side_px };
        let ours = cut(&photograph, &person, case.size).expect("a crop");

        // The same pixels: the same numbers, bit for bit.
        let pixels = RgbImage::from_raw(case.size, case.size, case.pixels.to_vec()).expect("its size");
        let found = normalised(&Crop { image: pixels, ..ours.clone() }, &IMAGENET);
        assert!(found.iter().zip(expected).all(|(a, b)| a.to_bits() == b.to_bits()), "{}", case.name);

        // The whole way: Pillow rounds to bytes between its two passes, which is one level of 255 at most.
        for ((at, found), expected) in normalised(&ours, &IMAGENET).indexed_iter().zip(expected) {
            let level = 1.0 / 255.0 / IMAGENET.std[at.0];
            assert!((found - expected).abs() < 1.001 * level, "{} {at:?}: {found} {expected}", case.name);
            off += usize::from(found != expected);
        }
    }
    assert!(rest.is_empty(), "{} numbers more than pixels", rest.len());
    // Seen: 341 of 2739, nearly all in the photograph's noise.
    assert!(off < golden.values.len() / 6, "{off} of {} numbers are a level off", golden.values.len());
}

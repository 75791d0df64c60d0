//! Parameters are read back as written, under every name and shape; what does not fit is refused by name.

use super::*;
use crate::file::npz::Npz;
use proptest::prelude::*;
use std::path::PathBuf;
use tempfile::TempDir;

const BODY: Counts = Counts { vertices: 2, joints: 3, betas: 2 };
const SMPL: Counts = Counts { vertices: 6890, joints: 24, betas: 10 };

fn file(arrays: &[(&str, &[usize], Values<'_>)]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("params.npz");
    let named: Vec<Named<'_>> =
        arrays.iter().map(|&(name, shape, values)| Named { name, shape, values }).collect();
    npz::write(&path, &named).unwrap();
    (folder, path)
}

fn read_arrays(arrays: &[(&str, &[usize], Values<'_>)]) -> std::result::Result<Parameters, String> {
    let (_folder, path) = file(arrays);
    read(&path, &BODY).map_err(|error| error.to_string())
}

fn count(n: usize) -> Vec<f64> {
    (0..n).map(|i| i as f64).collect()
}

#[test]
fn what_is_written_is_read_back() {
    let view = |name: &str, x: f64| View {
        name: name.into(),
        k: [[400.0 + x, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]],
        extrinsics: Extrinsics { r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], t: [x, 2.0, 3.0] },
    };
    let mut parameters = Parameters {
        poses: vec![count(9), vec![0.1; 9]],
        betas: vec![vec![0.5, -1.0]],
        trans: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
        offsets: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]],
        views: vec![view("front", 0.25), view("left side", 0.5)],
    };
    let (_folder, path) = file(&[]);
    write(&path, &parameters).unwrap();
    assert_eq!(read(&path, &BODY).unwrap(), parameters);
    assert_eq!(parameters.betas_of(1), [0.5, -1.0]);

    parameters.betas = vec![vec![1.0], vec![2.0]];
    parameters.offsets.clear();
    parameters.views.clear();
    write(&path, &parameters).unwrap();
    assert_eq!(Npz::open(&path).unwrap().names(), ["poses", "betas", "trans"]);
    let back = read(&path, &BODY).unwrap();
    assert_eq!((back.betas_of(1), back.frame_count()), (&[2.0][..], 2));
}

#[test]
fn every_accepted_shape_of_a_pose_is_the_same_pose() {
    let values = count(9);
    for shape in [&[9][..], &[1, 9], &[3, 3], &[1, 3, 3]] {
        for name in ["poses", "pose", "fullpose"] {
            let found = read_arrays(&[(name, shape, Values::F64(&values))]).unwrap();
            assert_eq!(found.poses, std::slice::from_ref(&values), "{name} {shape:?}");
            assert_eq!((found.betas, found.trans), (vec![vec![]], vec![[0.0; 3]]));
        }
    }
    let two = count(18);
    let found =
        read_arrays(&[("poses", &[2, 3, 3], Values::F64(&two)), ("transl", &[3], Values::F32(&[0.5; 3]))]);
    let found = found.unwrap();
    assert_eq!(found.poses[1], two[9..]);
    assert_eq!(found.trans, [[0.5; 3]; 2], "one translation serves every frame");
}

#[test]
fn a_pose_in_parts_is_joined_in_the_order_of_the_joints() {
    let (root, rest) = ([1.0, 2.0, 3.0, 11.0, 12.0, 13.0], count(12));
    let arrays: [(&str, &[usize], _); 3] = [
        ("pose_body", &[2, 6], Values::F64(&rest)),
        ("gender", &[1], Values::U8(&[0])),
        ("root_orient", &[2, 3], Values::F64(&root)),
    ];
    let expected = [[&root[..3], &rest[..6]].concat(), [&root[3..], &rest[6..]].concat()];
    assert_eq!(read_arrays(&arrays).unwrap().poses, expected);
    let flat: [(&str, &[usize], _); 2] =
        [("global_orient", &[3], Values::F64(&root[..3])), ("body_pose", &[6], Values::F64(&rest[..6]))];
    assert_eq!(read_arrays(&flat).unwrap().poses, expected[..1]);

    let uneven = read_arrays(&[arrays[2], ("body_pose", &[1, 6], Values::F64(&rest[..6]))]).unwrap_err();
    assert!(
        uneven.contains("\"body_pose\" has the shape [1, 6], but \"root_orient\" has [2, 3]"),
        "{uneven}"
    );
    let short = read_arrays(&[arrays[2], ("body_pose", &[2, 3], Values::F64(&rest[..6]))]).unwrap_err();
    assert!(short.contains("make 6 numbers a frame; the body has 3 joints and takes 9"), "{short}");
}

#[test]
fn refusals_name_the_array_and_both_shapes() {
    let poses: (&str, &[usize], _) = ("poses", &[2, 9], Values::F64(&[0.0; 18]));
    let refusal = |extra: (&str, &[usize], Values<'_>)| read_arrays(&[poses, extra]).unwrap_err();
    let cases = [
        (
            ("betas", &[3][..], Values::F64(&[0.5; 3])),
            "\"betas\" has 3 numbers; the body has 2 betas: keep betas[..., :2]",
        ),
        (
            ("betas", &[3, 1], Values::F64(&[0.0; 3])),
            "\"betas\" has the shape [3, 1], expected [B] or [2, B]",
        ),
        (
            ("trans", &[3, 3], Values::F64(&[0.0; 9])),
            "\"trans\" has the shape [3, 3], expected [3] or [2, 3]",
        ),
        (("trans", &[3], Values::F64(&[0.0, f64::NAN, 0.0])), "\"trans\" holds NaN (element 1)"),
        (("betas", &[1], Values::F32(&[f32::INFINITY])), "\"betas\" holds inf (element 0)"),
        (("offsets", &[3, 3], Values::F64(&[0.0; 9])), "\"offsets\" has the shape [3, 3], expected [2, 3]"),
    ];
    for (array, words) in cases {
        let message = refusal(array);
        assert!(message.contains("params.npz") && message.contains(words), "{message}");
    }
    for (shape, words) in [
        (
            &[2, 72][..],
            "has the shape [2, 72]; the body has 3 joints and takes [9] or [F, 9]; 72 is SMPL's 24 joints",
        ),
        (&[2, 3, 3, 3], "rotation matrices"),
        (&[2, 4, 9], "has the shape [2, 4, 9]: 2 people; give each a file of its own"),
        (&[0, 9], "holds no frames"),
        (&[], "has the shape []"),
    ] {
        let zeros = vec![0.0; shape.iter().product()];
        let message = read_arrays(&[("poses", shape, Values::F64(&zeros))]).unwrap_err();
        assert!(message.contains(words), "{message}");
    }
    let none = read_arrays(&[("joints", &[3, 3], Values::F64(&[0.0; 9]))]).unwrap_err();
    assert!(none.contains("\"poses\" is missing") && none.ends_with("the file holds joints"), "{none}");
}

#[test]
fn an_amass_pose_for_a_body_of_24_joints_is_refused_with_the_way_out() {
    let (_folder, path) = file(&[("poses", &[1, 156], Values::F64(&[0.0; 156]))]);
    let message = read(&path, &SMPL).unwrap_err().to_string();
    assert!(message.contains("SMPL-H's 52 joints") && message.contains("poses[:, :66]"), "{message}");
    assert_eq!(read(&path, &Counts { joints: 52, ..SMPL }).unwrap().poses[0].len(), 156);
}

#[test]
fn for_joints_alone_an_amass_file_is_read_with_a_word_about_what_was_left_away() {
    let poses = count(2 * 156);
    let betas: Vec<f64> = (0..16).map(|i| 0.1 * f64::from(i)).collect();
    let gender = ["female".to_string()];
    let (_folder, path) = file(&[
        ("trans", &[2, 3], Values::F64(&[0.5; 6])),
        ("gender", &[1], Values::Text(&gender)),
        ("mocap_framerate", &[], Values::F64(&[120.0])),
        ("betas", &[16], Values::F64(&betas)),
        ("dmpls", &[2, 8], Values::F64(&[0.0; 16])),
        ("poses", &[2, 156], Values::F64(&poses)),
    ]);
    let (found, words) = read_for_joints(&path, &SMPL).unwrap();
    assert_eq!(found.poses[1], [&poses[156..156 + 66], &[0.0; 6]].concat());
    assert_eq!((found.betas_of(1), found.trans[0]), (&betas[..10], [0.5; 3]));
    assert!(words[0].contains("has 52 joints; of them the 22"), "{words:?}");
    assert!(words[1].contains("has 16 numbers; of them the 10"), "{words:?}");
    assert_eq!(read_for_joints(&path, &BODY).unwrap_err().to_string().matches("52 joints").count(), 1);

    let (body, hands) = (count(63), [0.0; 90]);
    let (_folder, path) = file(&[
        ("root_orient", &[1, 3], Values::F64(&[9.0; 3])),
        ("pose_body", &[1, 63], Values::F64(&body)),
        ("pose_hand", &[1, 90], Values::F64(&hands)),
    ]);
    let (found, words) = read_for_joints(&path, &SMPL).unwrap();
    assert_eq!(found.poses[0], [&[9.0; 3][..], &body, &[0.0; 6]].concat());
    assert_eq!(words.len(), 1);
}

#[test]
fn betas_that_the_body_lacks_are_refused_even_if_they_are_zero() {
    let found = read_arrays(&[
        ("poses", &[9], Values::F64(&[0.0; 9])),
        ("shape", &[1, 4], Values::F64(&[1.0, 2.0, 0.0, 0.0])),
    ]);
    assert!(found.unwrap_err().to_string().contains("has 4 numbers; the body has 2 betas"));
}

#[test]
fn spin_s_results_and_hmr_s_theta_are_parameters() {
    let (pose, betas, theta) = (count(2 * 72), count(2 * 10), count(2 * 85));
    let (_folder, path) = file(&[
        ("pred_joints", &[2, 17, 3], Values::F64(&[0.0; 102])),
        ("pose", &[2, 72], Values::F64(&pose)),
        ("betas", &[2, 10], Values::F64(&betas)),
        ("camera", &[2, 3], Values::F64(&[0.0; 6])),
    ]);
    let found = read(&path, &SMPL).unwrap();
    assert_eq!((&found.poses[1][..], found.betas_of(1)), (&pose[72..], &betas[10..]));

    let (_folder, path) = file(&[("theta", &[2, 85], Values::F64(&theta))]);
    let found = read(&path, &SMPL).unwrap();
    assert_eq!((found.poses[1][0], found.poses[1][71], found.betas_of(1)[0]), (88.0, 159.0, 160.0));
    assert!(read(&path, &BODY).unwrap_err().to_string().contains("SMPL's 24 joints; the body has 3"));
    let (_folder, path) = file(&[("theta", &[82], Values::F64(&theta[..82]))]);
    assert!(read(&path, &SMPL).unwrap_err().to_string().contains("[82], expected [F, 85]"));
}

#[test]
fn one_actor_of_3dpw_is_read() {
    let (poses, trans) = (count(18), count(6));
    let found = read_arrays(&[
        ("poses", &[1, 2, 9], Values::F64(&poses)),
        ("betas", &[1, 2], Values::F64(&[0.5, 0.25])),
        ("trans", &[1, 2, 3], Values::F64(&trans)),
        ("genders", &[1], Values::Text(&["m".to_string()])),
    ]);
    let found = found.unwrap();
    assert_eq!((&found.poses[1][..], found.trans[1]), (&poses[9..], [3.0, 4.0, 5.0]));
    assert_eq!(found.betas_of(1), [0.5, 0.25]);
}

#[test]
fn cameras_need_all_three_arrays_and_may_lack_names() {
    let eye = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let arrays: [(&str, &[usize], _); 4] = [
        ("poses", &[9], Values::F64(&eye)),
        ("R", &[1, 3, 3], Values::F64(&eye)),
        ("K", &[1, 3, 3], Values::F64(&eye)),
        ("t", &[1, 3], Values::F64(&eye[..3])),
    ];
    let views = read_arrays(&arrays).unwrap().views;
    assert_eq!((views.len(), views[0].name.as_str(), views[0].extrinsics.t), (1, "0", [1.0, 0.0, 0.0]));
    assert!(read_arrays(&arrays[..3]).unwrap().views.is_empty());
    let names = ["a".to_string(), "b".to_string()];
    let mut named = arrays.to_vec();
    named.push(("camera_names", &[2], Values::Text(&names)));
    assert!(read_arrays(&named).unwrap_err().contains("\"camera_names\" holds 2 names for 1 cameras"));
}

proptest! {
    #[test]
    fn arrays_of_any_shape_never_panic(
        name in prop::sample::select(vec!["poses", "global_orient", "betas", "trans", "R", "t", "K", "offsets"]),
        shape in prop::collection::vec(0usize..4, 0..4), whole in any::<bool>(),
    ) {
        let values = vec![1.0; shape.iter().product()];
        let ones = [1.0; 9];
        let mut arrays: Vec<(&str, &[usize], Values<'_>)> = vec![
            ("body_pose", &[1, 6], Values::F64(&ones[..6])),
            ("R", &[1, 3, 3], Values::F64(&ones)),
            ("K", &[1, 3, 3], Values::F64(&ones)),
            ("t", &[1, 3], Values::F64(&ones[..3])),
        ];
        if whole && name != "poses" {
            arrays.push(("poses", &[1, 9], Values::F64(&ones)));
        }
        arrays.retain(|array| array.0 != name);
        arrays.push((name, &shape, Values::F64(&values)));
        let _ = read_arrays(&arrays);
    }
}

//! `pose`: the reference's body in exact form, within 20 µm in fast form, in every format, and refusals.

use std::path::{Path, PathBuf};

use vitruvian_reference::body::mannequin;
use vitruvian_runtime::file::mesh::Format;
use vitruvian_runtime::file::npy::Values;
use vitruvian_runtime::file::npz::{self, Named, Npz};
use vitruvian_runtime::file::params::{self, Parameters};

use crate::command::{files, folder, vitruvian, word};

/// Rest, turns of 10⁻⁴, a root near π and beyond it, 1000 rad, far away; 70 frames, so that the blocks of the writer meet.
fn parameters() -> Parameters {
    let wave = |f: usize, n: usize, size: f64| size * (1.7 * f as f64 + 0.9 * n as f64).sin();
    let mut poses: Vec<Vec<f64>> = (0..70).map(|f| (0..72).map(|n| wave(f, n, 0.8)).collect()).collect();
    poses[0] = vec![0.0; 72];
    poses[1] = (0..72).map(|n| wave(1, n, 1e-4)).collect();
    poses[2][..3].copy_from_slice(&[std::f64::consts::PI, 0.0, 0.0]);
    poses[3][..3].copy_from_slice(&[0.0, std::f64::consts::PI - 1e-9, 1e-9]);
    poses[4] = (0..72).map(|n| wave(4, n, 1000.0)).collect();
    let mut trans: Vec<[f64; 3]> = (0..70).map(|f| [0.1 * f as f64, -1.0, 4.0]).collect();
    trans[5] = [1e6, -2e5, 3e4];
    let betas = (0..70).map(|f| (0..10).map(|l| wave(f, l, 2.0)).collect()).collect();
    Parameters { poses, betas, trans, ..Parameters::default() }
}

fn write(folder: &Path, parameters: &Parameters) -> PathBuf {
    let path = folder.join("params.npz");
    params::write(&path, parameters).expect("a writable folder");
    path
}

fn array(path: &Path, name: &str, shape: &[usize]) -> Vec<f64> {
    let mut npz = Npz::open(path).expect("an archive");
    let array = npz.array::<f64>(name).expect("an array");
    assert_eq!(array.shape, shape);
    array.values
}

#[test]
fn every_frame_is_the_reference_s_body() {
    let folder = folder();
    let parameters = parameters();
    let params = write(folder.path(), &parameters);
    let body = mannequin();
    let expected: Vec<_> =
        (0..70).map(|f| body.pose(&parameters.poses[f], &parameters.betas[f], parameters.trans[f])).collect();
    let out = folder.path().join("posed.npz");
    for (words, bound) in [(&["--exact"][..], 1e-7), (&[], 2e-5)] {
        vitruvian(&[&["pose", "--params", word(&params), "-o", word(&out)], words].concat()).done();
        let vertices = array(&out, "vertices", &[70, body.vertex_count(), 3]);
        let joints = array(&out, "joints", &[70, 24, 3]);
        let expected_vertices = expected.iter().flat_map(|posed| posed.vertices.as_flattened());
        let expected_joints = expected.iter().flat_map(|posed| posed.joints.as_flattened());
        let worst = |found: &[f64], expected: &mut dyn Iterator<Item = &f64>| {
            found.iter().zip(expected).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()))
        };
        let vertex = worst(&vertices, &mut expected_vertices.into_iter());
        let joint = worst(&joints, &mut expected_joints.into_iter());
        assert!(vertex <= bound && joint <= 1e-7, "{words:?}: vertices {vertex:e} m, joints {joint:e} m");
    }
    let once = std::fs::read(&out).expect("a file");
    vitruvian(&["pose", "--params", word(&params), "-o", word(&out)]).done();
    assert_eq!(once, std::fs::read(&out).expect("a file"), "same input, same bytes");
}

#[test]
fn offsets_move_the_skin_and_not_the_joints() {
    let folder = folder();
    let body = mannequin();
    let offsets: Vec<[f64; 3]> = body.v_template.iter().map(|v| [0.02 * v[1], 0.01, 0.0]).collect();
    let pose: Vec<f64> = (0..72).map(|n| 0.4 * f64::from(n).cos()).collect();
    let expected = body.pose_with_offsets(&pose, &[0.5], &offsets, [0.0; 3]);
    let parameters = Parameters {
        poses: vec![pose],
        betas: vec![vec![0.5]],
        trans: vec![[0.0; 3]],
        offsets,
        ..Parameters::default()
    };
    let params = write(folder.path(), &parameters);
    let out = folder.path().join("posed.npz");
    for words in [&["--exact"][..], &[]] {
        vitruvian(&[&["pose", "--params", word(&params), "-o", word(&out)], words].concat()).done();
        let vertices = array(&out, "vertices", &[1, body.vertex_count(), 3]);
        for (found, expected) in vertices.iter().zip(expected.vertices.as_flattened()) {
            assert!((found - expected).abs() < 2e-5, "{words:?}: {found}, expected {expected}");
        }
    }
}

#[test]
fn one_frame_is_one_mesh_and_several_are_numbered() {
    let folder = folder();
    let mut parameters = parameters();
    parameters.poses.truncate(2);
    parameters.betas.truncate(2);
    parameters.trans.truncate(2);
    let params = write(folder.path(), &parameters);
    let body = mannequin();
    for name in ["body.ply", "body.obj", "body.glb"] {
        let run =
            vitruvian(&["pose", "--params", word(&params), "-o", word(&folder.path().join(name))]).done();
        assert!(run.out.is_empty() && run.err.contains("2 frames of 8798 vertices and 24 joints"), "{run:?}");
    }
    let names: Vec<String> = files(folder.path())
        .iter()
        .map(|p| p.file_name().unwrap_or_default().to_string_lossy().into())
        .collect();
    let numbered = [
        "body_0000.glb",
        "body_0000.obj",
        "body_0000.ply",
        "body_0001.glb",
        "body_0001.obj",
        "body_0001.ply",
    ];
    assert_eq!(names, [&numbered[..], &["params.npz"]].concat());
    for (f, pose) in parameters.poses.iter().enumerate() {
        let expected = body.pose(pose, &parameters.betas[f], parameters.trans[f]);
        for extension in ["ply", "obj"] {
            let path = folder.path().join(format!("body_000{f}.{extension}"));
            let mesh = vitruvian_runtime::file::mesh::read(&path).expect("a mesh");
            assert_eq!(mesh.faces, body.faces);
            for (found, expected) in mesh.vertices.as_flattened().iter().zip(expected.vertices.as_flattened())
            {
                assert!((f64::from(*found) - expected).abs() < 2e-5, "{found}, expected {expected}");
            }
        }
    }

    parameters.poses.truncate(1);
    parameters.betas.truncate(1);
    parameters.trans.truncate(1);
    let params = write(folder.path(), &parameters);
    let out = folder.path().join("single");
    vitruvian(&["pose", "--params", word(&params), "-o", word(&out), "--format", "obj"]).done();
    assert!(vitruvian_runtime::file::obj::read(&out).is_ok() && Format::of(&out).is_err());
}

/// An array's name, shape and values.
type Entry<'a> = (&'a str, &'a [usize], &'a [f64]);

/// Runs `pose` on these arrays and returns what it says, which must be one line, with status 2 and nothing written.
fn refused(arrays: &[Entry<'_>], words: &[&str]) -> String {
    let folder = folder();
    let params = folder.path().join("params.npz");
    let named: Vec<Named<'_>> = arrays
        .iter()
        .map(|&(name, shape, values)| Named { name, shape, values: Values::F64(values) })
        .collect();
    npz::write(&params, &named).expect("a writable folder");
    let before = files(folder.path());
    let out = folder.path().join("out.npz");
    let run = vitruvian(&[&["pose", "--params", word(&params), "-o", word(&out)], words].concat());
    assert_eq!((run.status, run.err.lines().count()), (2, 1), "{run:?}");
    assert!(run.out.is_empty() && files(folder.path()) == before, "nothing is left behind: {run:?}");
    run.err
}

#[test]
fn parameters_that_do_not_fit_the_body_are_refused_in_one_line() {
    let zeros = [0.0; 165];
    let nan: Vec<f64> = (0..72).map(|n| if n == 40 { f64::NAN } else { 0.0 }).collect();
    let poses: Entry<'_> = ("poses", &[1, 72], &zeros[..72]);
    let cases: [(&[Entry<'_>], &str); 9] = [
        (&[poses, ("betas", &[11], &zeros[..11])], "\"betas\" has 11 numbers; the body has 10 betas"),
        (&[("poses", &[1, 75], &zeros[..75])], "the body has 24 joints and takes [72] or [F, 72]"),
        (&[("poses", &[1, 156], &zeros[..156])], "SMPL-H's 52 joints"),
        (&[("poses", &[1, 72], &nan)], "\"poses\" holds NaN (element 40)"),
        (&[poses, ("trans", &[2, 3], &zeros[..6])], "\"trans\" has the shape [2, 3], expected [3] or [1, 3]"),
        (&[("poses", &[0, 72], &[])], "\"poses\" holds no frames"),
        (&[("joints", &[24, 3], &zeros[..72])], "\"poses\" is missing"),
        (&[poses, ("betas", &[1], &[1e300])], "these betas put vertex 0 at"),
        (&[poses, ("trans", &[3], &[f64::INFINITY, 0.0, 0.0])], "\"trans\" holds inf"),
    ];
    for (arrays, words) in cases {
        let message = refused(arrays, &[]);
        assert!(message.contains("params.npz") && message.contains(words), "{words} in {message}");
    }
    let huge = [1.79e308; 3];
    let exact = refused(&[poses, ("betas", &[1], &huge[..1]), ("trans", &[3], &huge)], &["--exact"]);
    assert!(exact.contains("frame 0 puts the body beyond the range of numbers"), "{exact}");
}

#[test]
fn files_that_are_missing_or_of_another_kind_are_refused() {
    let folder = folder();
    let params = write(folder.path(), &parameters());
    let text = folder.path().join("text.npz");
    std::fs::write(&text, "no archive").expect("a writable folder");
    let (absent, out) = (folder.path().join("absent.npz"), folder.path().join("out.npz"));
    let cases = [
        (vec!["--params", word(&absent)], "absent.npz"),
        (vec!["--params", word(&text)], "text.npz: is no .npz archive"),
        (
            vec!["--params", word(&params), "--body", word(&params)],
            "params.npz: array \"v_template\" is missing",
        ),
        (vec!["--params", word(&params), "--body", word(&absent)], "absent.npz"),
    ];
    for (words, said) in cases {
        let run = vitruvian(&[&["pose", "-o", word(&out)], &words[..]].concat());
        assert!(run.status == 2 && run.err.contains(said) && !out.exists(), "{said} in {run:?}");
        assert_eq!(run.err.lines().count(), 1, "{run:?}");
    }
    let stl = folder.path().join("body.stl");
    let run = vitruvian(&["pose", "--params", word(&params), "-o", word(&stl)]);
    assert!(run.status == 2 && run.err.contains("none of .npz, .ply, .obj and .glb"), "{run:?}");
    let nowhere = folder.path().join("none/body.npz");
    let run = vitruvian(&["pose", "--params", word(&params), "-o", word(&nowhere)]);
    assert!(run.status == 2 && run.err.contains("none/body.npz"), "{run:?}");
}

#[test]
fn what_was_posed_is_evaluated_like_its_parameters() {
    let folder = folder();
    let params = write(folder.path(), &parameters());
    let posed = folder.path().join("posed.npz");
    vitruvian(&["pose", "--params", word(&params), "-o", word(&posed)]).done();
    let found = vitruvian(&["evaluate", word(&posed), word(&params), "--json"]).done().json();
    assert!(found["measures"]["error_mm"].as_f64().is_some_and(|error| error < 1e-6), "{found}");
    assert_eq!(found["measures"]["frames"], 70);

    let parts = folder.path().join("parts.npz");
    let poses = parameters().poses.concat();
    let root: Vec<f64> = poses.chunks_exact(72).flat_map(|pose| pose[..3].to_vec()).collect();
    let rest: Vec<f64> = poses.chunks_exact(72).flat_map(|pose| pose[3..].to_vec()).collect();
    let named = |name, shape, values| Named { name, shape, values: Values::F64(values) };
    npz::write(&parts, &[named("root_orient", &[70, 3], &root), named("pose_body", &[70, 69], &rest)])
        .expect("a writable folder");
    let found = vitruvian(&["evaluate", word(&parts), word(&params), "--json"]).done().json();
    assert!(found["measures"]["error_mm"].as_f64().is_some_and(|error| error > 1.0), "other betas: {found}");
}

//! `intri.yml` and `extri.yml`: OpenCV's FileStorage as EasyMocap writes it.
//!
//! The subset that such files use: a `%YAML:1.0` line, top-level keys, lists of names, numbers, and matrices
//! `!!opencv-matrix` with `rows`, `cols`, `dt` and `data`. General YAML readers refuse both the directive (a colon
//! where YAML has a space) and the tag.
//!
//! | file | key | holds |
//! |---|---|---|
//! | both | `names` | the cameras |
//! | intri | `K_NAME` | 3×3 |
//! | intri | `dist_NAME` | k1, k2, p1, p2[, k3] (absent: no distortion) |
//! | extri | `Rot_NAME` or `R_NAME` | the rotation, 3×3 or as a Rodrigues vector |
//! | extri | `T_NAME` | t in metres |
//!
//! # Conventions
//! OpenCV's pixel (0, 0) is the *centre* of the first pixel, ours its outer corner: c_x and c_y grow by ½ here.

use std::collections::BTreeMap;
use std::path::Path;

use super::camera::Extrinsics;
use super::geometry::rotation_matrix;
use crate::error::{Error, Result};
use crate::file;

const MAX_BYTES: u64 = 16 << 20;

/// One camera of an `intri.yml`: everything but the image size, which these files do not hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The camera's name.
    pub name: String,
    /// K with the origin at the image's corner.
    pub k: [[f64; 3]; 3],
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
    /// From `extri.yml`, if that was given.
    pub extrinsics: Option<Extrinsics>,
}

enum Node {
    List(Vec<String>),
    Scalar,
    Matrix { rows: usize, cols: usize, data: Vec<f64> },
}

type Document = BTreeMap<String, Node>;

/// Reads the cameras named in `intri`, with extrinsics from `extri` where there is such a file.
///
/// # Errors
/// A file cannot be read or is no FileStorage YAML, or a camera lacks a matrix or has one of another shape; the
/// message names the file and the camera.
pub fn read(intri: &Path, extri: Option<&Path>) -> Result<Vec<Calibrated>> {
    let load = |path: &Path| {
        let text = file::read_text(path, MAX_BYTES)?;
        parse(&text).map_err(|message| Error::file(path, message))
    };
    let inner = load(intri)?;
    let outer = match extri {
        Some(path) => Some((path, load(path)?)),
        None => None,
    };
    let Some(Node::List(names)) = inner.get("names") else {
        return Err(Error::file(
            intri,
            "holds no list \"names\"; expected the cameras' names as EasyMocap writes them",
        ));
    };
    if names.is_empty() {
        return Err(Error::file(intri, "its list \"names\" is empty; expected at least one camera"));
    }
    let mut cameras = Vec::with_capacity(names.len());
    for name in names {
        let fail = |path: &Path, message: String| Error::camera(path, name, message);
        if cameras.iter().any(|c: &Calibrated| c.name == *name) {
            return Err(fail(intri, "is named twice".into()));
        }
        let mut k = matrix3(&inner, &format!("K_{name}")).map_err(|m| fail(intri, m))?;
        k[0][2] += 0.5;
        k[1][2] += 0.5;
        let distortion = distortion(&inner, &format!("dist_{name}")).map_err(|m| fail(intri, m))?;
        let extrinsics = match &outer {
            None => None,
            Some((path, outer)) => Some(extrinsics(outer, name).map_err(|m| fail(path, m))?),
        };
        cameras.push(Calibrated { name: name.clone(), k, distortion, extrinsics });
    }
    Ok(cameras)
}

fn matrix<'a>(document: &'a Document, key: &str) -> std::result::Result<(usize, usize, &'a [f64]), String> {
    match document.get(key) {
        Some(Node::Matrix { rows, cols, data }) => Ok((*rows, *cols, data)),
        Some(_) => Err(format!("\"{key}\" is no matrix; expected {key}: !!opencv-matrix")),
        None => {
            Err(format!("has no \"{key}\"; expected {key}: !!opencv-matrix with rows, cols, dt and data"))
        }
    }
}

fn matrix3(document: &Document, key: &str) -> std::result::Result<[[f64; 3]; 3], String> {
    match matrix(document, key)? {
        (3, 3, data) => Ok(std::array::from_fn(|i| std::array::from_fn(|j| data[3 * i + j]))),
        (rows, cols, _) => Err(format!("\"{key}\" is {rows}×{cols}; expected 3×3")),
    }
}

fn distortion(document: &Document, key: &str) -> std::result::Result<[f64; 5], String> {
    if !document.contains_key(key) {
        return Ok([0.0; 5]);
    }
    let (_, _, data) = matrix(document, key)?;
    // OpenCV's longer models (rational, thin prism, tilt) are accepted only where their extra terms are zero.
    if !matches!(data.len(), 4 | 5 | 8 | 12 | 14) || data.iter().skip(5).any(|&x| x != 0.0) {
        return Err(format!(
            "\"{key}\" has {} numbers; expected k1, k2, p1, p2, k3: calibrate with that model",
            data.len()
        ));
    }
    Ok(std::array::from_fn(|i| data.get(i).copied().unwrap_or(0.0)))
}

fn extrinsics(document: &Document, name: &str) -> std::result::Result<Extrinsics, String> {
    let keys = [format!("Rot_{name}"), format!("R_{name}")];
    let key = keys.iter().find(|k| document.contains_key(*k)).unwrap_or(&keys[1]);
    let r = match matrix(document, key)? {
        (3, 3, _) => matrix3(document, key)?,
        (3, 1, v) | (1, 3, v) => rotation_matrix([v[0], v[1], v[2]]),
        (rows, cols, _) => {
            return Err(format!("\"{key}\" is {rows}×{cols}; expected 3×3, or 3×1 (a Rodrigues vector)"));
        }
    };
    let key = format!("T_{name}");
    match matrix(document, &key)? {
        (3, 1, t) | (1, 3, t) => Ok(Extrinsics { r, t: [t[0], t[1], t[2]] }),
        (rows, cols, _) => Err(format!("\"{key}\" is {rows}×{cols}; expected 3×1")),
    }
}

fn parse(text: &str) -> std::result::Result<Document, String> {
    let mut document = Document::new();
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim_end())).peekable();
    while let Some((number, line)) = lines.next() {
        if line.is_empty() || line.starts_with(['%', '#']) || line == "---" || line == "..." {
            continue;
        }
        let (key, value) = line
            .split_once(':')
            .filter(|_| !line.starts_with([' ', '\t']))
            .ok_or_else(|| format!("line {number}: expected \"key: value\", found \"{}\"", shorten(line)))?;
        // Everything that is indented, or is an item of a list, belongs to this key.
        let mut body = vec![value.trim()];
        while let Some((_, next)) =
            lines.next_if(|(_, l)| l.is_empty() || l.starts_with([' ', '\t', '-']) && *l != "---")
        {
            body.push(next.trim());
        }
        let node = node(&body).map_err(|message| format!("line {number}: \"{key}\": {message}"))?;
        if document.insert(unquote(key), node).is_some() {
            return Err(format!("line {number}: \"{key}\" stands there twice"));
        }
    }
    Ok(document)
}

fn node(body: &[&str]) -> std::result::Result<Node, String> {
    if body[0].starts_with("!!opencv-matrix") {
        return matrix_node(&body[1..]);
    }
    if let Some(flow) = body[0].strip_prefix('[') {
        let joined = std::iter::once(flow).chain(body[1..].iter().copied()).collect::<Vec<_>>().join(" ");
        let inner = joined.trim_end().strip_suffix(']').ok_or("its list has no closing bracket")?;
        return Ok(Node::List(inner.split(',').map(unquote).filter(|s| !s.is_empty()).collect()));
    }
    let items: Vec<&str> = body[1..].iter().copied().filter(|l| !l.is_empty()).collect();
    if body[0].is_empty() && items.iter().all(|l| l.starts_with('-')) {
        return Ok(Node::List(items.iter().map(|l| unquote(&l[1..])).collect()));
    }
    Ok(Node::Scalar)
}

fn matrix_node(lines: &[&str]) -> std::result::Result<Node, String> {
    let joined = lines.join(" ");
    let size = |key: &str| -> std::result::Result<usize, String> {
        let field = lines.iter().find_map(|l| l.strip_prefix(key)?.trim_start().strip_prefix(':'));
        field.and_then(|v| v.trim().parse().ok()).ok_or_else(|| format!("has no readable {key}"))
    };
    let (rows, cols) = (size("rows")?, size("cols")?);
    let after = joined.split_once("data:").map(|(_, rest)| rest.trim()).ok_or("has no data")?;
    let inner = after.strip_prefix('[').and_then(|t| t.split_once(']')).map(|(inner, _)| inner);
    let inner = inner.ok_or("its data is no list in brackets")?;
    let data: Vec<f64> = inner
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| {
            number(word).ok_or_else(|| format!("its data holds \"{}\", which is no number", shorten(word)))
        })
        .collect::<std::result::Result<_, _>>()?;
    if rows.checked_mul(cols) != Some(data.len()) {
        return Err(format!("declares {rows}×{cols} but holds {} numbers", data.len()));
    }
    Ok(Node::Matrix { rows, cols, data })
}

/// Rust reads OpenCV's `1.` and `1e+00`; its `.Nan` and `.Inf` lose their dot first.
fn number(word: &str) -> Option<f64> {
    let (sign, digits) = word.strip_prefix('-').map_or((1.0, word), |rest| (-1.0, rest));
    let digits = digits.strip_prefix('.').filter(|d| d.starts_with(char::is_alphabetic)).unwrap_or(digits);
    digits.parse::<f64>().ok().map(|x| sign * x)
}

fn unquote(word: &str) -> String {
    let word = word.trim();
    let inner = |q: char| word.strip_prefix(q).and_then(|w| w.strip_suffix(q));
    inner('"').or_else(|| inner('\'')).unwrap_or(word).to_owned()
}

fn shorten(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// As cv2.FileStorage writes it (four-space indents, dots without digits, data over several lines).
    const INTRI: &str = "%YAML:1.0\n---\nnames:\n   - \"01\"\n   - '02'\nK_01: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 9.8e+02, 0., 4.9e+02,\n       0., 9.81e+02, 5.1e+02, 0.,\n       0., 1. ]\ndist_01: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -2.5e-01, .1, 0., 0., 0. ]\n# by EasyMocap's own writer:\nK_02: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data: [980.000000, 0.000000, 490.000000, 0.000000, 981.000000, 510.000000, 0.000000, 0.000000, 1.000000]\nH_02: 1080.000\n";
    const EXTRI: &str = "%YAML:1.0\n---\nnames: [ \"01\", \"02\" ]\nR_01: !!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: [0.0, 0.0, 1.5707963267948966]\nRot_01: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data: [0, -1, 0, 1, 0, 0, 0, 0, 1]\nT_01: !!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: [1, 2, 3]\nR_02: !!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: [0.0, 0.0, 1.5707963267948966]\nT_02: !!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: [1, 2, 3]\n";

    fn cameras(intri: &str, extri: Option<&str>) -> Result<Vec<Calibrated>> {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("intri.yml"), folder.path().join("extri.yml"));
        std::fs::write(&a, intri).unwrap();
        std::fs::write(&b, extri.unwrap_or("")).unwrap();
        read(&a, extri.map(|_| b.as_path()))
    }

    #[test]
    fn both_writers_of_the_format_are_understood_and_the_pixel_origin_moves_to_the_corner() {
        let found = cameras(INTRI, Some(EXTRI)).unwrap();
        assert_eq!(found[0].name, "01");
        assert_eq!(found[0].k, [[980.0, 0.0, 490.5], [0.0, 981.0, 510.5], [0.0, 0.0, 1.0]]);
        assert_eq!(found[0].distortion, [-0.25, 0.1, 0.0, 0.0, 0.0]);
        assert_eq!(found[1].k, found[0].k);
        assert_eq!(found[1].distortion, [0.0; 5]);
        let (a, b) = (found[0].extrinsics.unwrap(), found[1].extrinsics.unwrap());
        assert_eq!(a.t, [1.0, 2.0, 3.0]);
        for i in 0..3 {
            for j in 0..3 {
                assert!((a.r[i][j] - b.r[i][j]).abs() < 1e-15, "matrix and Rodrigues vector agree");
            }
        }
        assert_eq!(cameras(INTRI, None).unwrap()[0].extrinsics, None);
    }

    #[test]
    fn faults_name_the_camera_and_the_key() {
        let fault = |intri: &str, extri: &str| cameras(intri, Some(extri)).unwrap_err().to_string();
        assert!(fault(&INTRI.replace("K_02", "Q_02"), EXTRI).contains("camera \"02\": has no \"K_02\""));
        assert!(fault(INTRI, &EXTRI.replace("T_02", "t_02")).contains("camera \"02\": has no \"T_02\""));
        assert!(fault(&INTRI.replace("names", "nomes"), EXTRI).contains("no list \"names\""));
        assert!(fault(&INTRI.replace("9.8e+02", "many"), EXTRI).contains("\"many\", which is no number"));
        assert!(fault(&INTRI.replace("-2.5e-01, ", ""), EXTRI).contains("declares 1×5 but holds 4"));
        assert!(fault("names", EXTRI).contains("line 1"));
        assert!(number(".Nan").unwrap().is_nan() && number("-.Inf") == Some(f64::NEG_INFINITY));
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0usize..900, to in any::<u8>(), junk in ".{0,200}") {
            let mut bytes = format!("{INTRI}{EXTRI}").into_bytes();
            let n = bytes.len();
            bytes[at % n] = to;
            let _ = parse(&String::from_utf8_lossy(&bytes));
            bytes.truncate(at % n);
            let _ = parse(&String::from_utf8_lossy(&bytes));
            let _ = parse(&junk);
        }
    }
}
